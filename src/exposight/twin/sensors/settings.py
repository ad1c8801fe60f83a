"""What a simulated sensor is beyond its document: electronics, lenses, patterns, limits.

The table stands under ``simulated`` in the sensor's document and under ``simulated.sensor`` in a
plan; what neither says is the paper's sensor's of the same kind (one camera: structured light, two:
active stereo).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from typing import Any, Literal

import numpy as np

from exposight import imaging
from exposight.cell import GREY_MAX, ActiveSensor, full_scale, sensor_preset
from exposight.errors import SensorError
from exposight.files import validate
from exposight.twin.light import CameraLens, ProjectorLens, lamp_of, projector_of
from exposight.twin.sensors.exposure import CameraElectronics
from exposight.twin.sensors.patterns import DotPattern, fringe_sequence

BrightnessImage = Literal["mean", "first"]

STRIPE_LIMITS = imaging.DecodingLimits(min_modulation=6.0, max_residual=0.2)
"""When a pixel counts as decoded. With 6 grey levels p_norm still rises at a brightness of 20 to
25, as in the paper's Fig. 10."""

DOT_PROJECTOR = ProjectorLens(
    # Roboception: the RandomDot's lens has 12 mm, f/1.4. Fully open it would blur the dots away at
    # either end of the working volume, so it is taken as stopped down to f/4 (assumed): a pupil of
    # 3 mm, a quarter of which times the preset's 1498 px is the defocus.
    defocus_px_mm=1123.0
)

DOT_CAMERA = CameraElectronics(
    # The rule, chosen once from Table 9: the stereo sensor's observations with p_norm ≥ 0.75 were
    # taken at 0.09 to 18 ms and have 12 to 241 grey levels. Bare sheet at the TCP, turned to the
    # middle of its training features' range (w = 5°, p = −0.5°), has the middle, 126 grey levels,
    # at 9 ms. All else as in the structured-light sensor's camera (assumed): Roboception does not
    # publish it.
    electrons_per_ms=4.3e9
)

DOT_DEPTHS_MM = (200.0, 1000.0)
"""Depths that are matched. Roboception's data sheet: from 0.2 m; the paper's Table 7: the farthest
plane at 1.00 m."""


_OF_ONE_CAMERA = {"sequence", "fringes", "steps", "image", "limits", "max_depth_noise_mm"}
_OF_TWO_CAMERAS = {"dots", "matching", "depth_limits_mm"}


@dataclass(frozen=True, kw_only=True)
class MattWhite:
    """The sensitivity as a user can measure it: on matt white at the TCP, facing the camera.

    Parameters
    ----------
    grey_levels : float, grey levels 0–255
        Brightness of the image above the black level: the mean over the patterns' phases.
    exposure_ms : float, ms
        Exposure time of that image.

    Raises
    ------
    SensorError
        If one of them is not above 0, or beyond the grey levels.
    """

    grey_levels: float
    exposure_ms: float

    def __post_init__(self) -> None:
        if not (0 < self.grey_levels <= GREY_MAX and 0 < self.exposure_ms < math.inf):
            msg = (
                "matt_white needs grey_levels above 0 and up to 255 and an exposure_ms above 0, "
                f"got {self.grey_levels:g} and {self.exposure_ms:g}"
            )
            raise SensorError(msg)


@dataclass(frozen=True, kw_only=True)
class SensorSettings:
    """Everything about a simulated sensor that its document's geometry does not say.

    Parameters
    ----------
    camera : CameraElectronics
        Of all cameras; a second one has a fixed pattern of its own.
    lens : CameraLens
        Of all cameras.
    projector : ProjectorLens
        Contrast, blur and focus of the patterns.
    matt_white : MattWhite, optional
        In place of the camera's ``electrons_per_ms``.
    sequence : PatternSequence, optional
        Patterns of a sensor with one camera, as the decoder reads them.
    fringes : tuple of float
        In place of a sequence: periods of each fringe over the projector's columns.
    steps : int
        Phase steps of each of the `fringes`.
    image : {'mean', 'first'}
        A capture's image, in which brightness is averaged: the mean of the finest shifted images,
        or the first of them.
    limits : DecodingLimits
        When a pixel of structured light counts as decoded.
    max_depth_noise_mm : float, mm, optional
        Points whose predicted standard deviation of depth exceeds this are dropped
        (`exposight.imaging.with_sigma_z`), as scanners' own filters do; None keeps them.
    dots : DotPattern
        The slide of a sensor with two cameras.
    matching : StereoLimits
        When a match of two cameras counts.
    depth_limits_mm : (float, float), mm, optional
        Depths that two cameras match; the sensor's working distance by default.

    Raises
    ------
    SensorError
        If the depth noise is not above 0, or there are fewer than three steps.
    """

    camera: CameraElectronics = field(default_factory=CameraElectronics)
    lens: CameraLens = field(default_factory=CameraLens)
    projector: ProjectorLens = field(default_factory=ProjectorLens)
    matt_white: MattWhite | None = None
    sequence: imaging.PatternSequence | None = None
    fringes: tuple[float, ...] = (1.0, 8.0, 64.0)
    steps: int = 4
    image: BrightnessImage = "mean"
    limits: imaging.DecodingLimits = STRIPE_LIMITS
    max_depth_noise_mm: float | None = None
    dots: DotPattern = field(default_factory=DotPattern)
    matching: imaging.StereoLimits = field(default_factory=imaging.StereoLimits)
    depth_limits_mm: tuple[float, float] | None = None

    def __post_init__(self) -> None:
        if self.max_depth_noise_mm is not None and not self.max_depth_noise_mm > 0:
            msg = f"max_depth_noise_mm must be above 0 mm, got {self.max_depth_noise_mm:g}"
            raise SensorError(msg)
        if self.steps < 3:
            msg = f"a fringe needs at least 3 steps, got {self.steps}"
            raise SensorError(msg)


def kind_settings(sensor: ActiveSensor) -> SensorSettings:
    """Return the settings of the paper's sensor of the same kind, scaled to a sensor's projector.

    Parameters
    ----------
    sensor : ActiveSensor
        With a projector. Its blur is that of the same pupil: in px it grows with the focal length.

    Raises
    ------
    SensorError
        If it has no projector.
    """
    stereo = len(sensor.cameras) > 1
    kind = sensor_preset("rc-visard-65" if stereo else "comet-pro-ae")
    settings = SensorSettings()
    if stereo:
        same = (sensor.cameras, sensor.first_from_camera) == (kind.cameras, kind.first_from_camera)
        depths_mm = DOT_DEPTHS_MM if same else None
        settings = SensorSettings(
            camera=DOT_CAMERA, projector=DOT_PROJECTOR, depth_limits_mm=depths_mm
        )
    longer = projector_of(sensor).camera.fx / projector_of(kind).camera.fx
    lens = settings.projector
    if longer != 1.0:
        lens = replace(lens, defocus_px_mm=lens.defocus_px_mm * longer)
    return replace(settings, projector=lens)


def sensor_settings(sensor: ActiveSensor, table: Mapping[str, Any]) -> SensorSettings:
    """Return a sensor's settings: its kind's, its document's table, and another table over both.

    Parameters
    ----------
    sensor : ActiveSensor
        With a projector; its `simulated` is read.
    table : mapping of str to object
        What a plan says, key by key.

    Raises
    ------
    FormatError
        If a key is unknown or a value impossible; the message names it.
    SensorError, ImageError
        If two keys contradict each other, or there is no such sequence.
    """
    given = _merged(dict(sensor.simulated), table)
    source = f"sensor {sensor.name!r}, simulated"
    if isinstance(given.get("sequence"), str):
        given["sequence"] = asdict(imaging.sequence_named_or_read(given["sequence"]))
    camera = given.get("camera", {})
    camera = camera if isinstance(camera, Mapping) else {}
    for one, other, both in (
        ("sequence", "fringes", "sequence" in given and "fringes" in given),
        ("sequence", "steps", "sequence" in given and "steps" in given),
        (
            "matt_white",
            "camera.electrons_per_ms",
            "matt_white" in given and "electrons_per_ms" in camera,
        ),
    ):
        if both:
            msg = f"{source}: {one} and {other} exclude each other; give one of them"
            raise SensorError(msg)
    stereo = len(sensor.cameras) > 1
    foreign = given.keys() & (_OF_ONE_CAMERA if stereo else _OF_TWO_CAMERAS)
    if foreign:
        does = (
            "has two cameras, which match dots" if stereo else "has one camera and decodes patterns"
        )
        msg = f"{source}: it {does}; leave out {', '.join(sorted(foreign))}"
        raise SensorError(msg)
    settings = validate(SensorSettings, _merged(asdict(kind_settings(sensor)), given), source)
    if settings.sequence is not None and settings.sequence.bit_depth != settings.camera.bit_depth:
        if "bit_depth" in camera:
            msg = (
                f"{source}: the camera has {settings.camera.bit_depth} bits, the sequence "
                f"{settings.sequence.bit_depth}; say the same in both"
            )
            raise SensorError(msg)
        depth = settings.sequence.bit_depth
        settings = replace(settings, camera=replace(settings.camera, bit_depth=depth))
    return settings


def with_table(sensor: ActiveSensor, table: Mapping[str, Any]) -> ActiveSensor:
    """Return a sensor whose document says what another table says over its own."""
    return replace(sensor, simulated=_merged(dict(sensor.simulated), table)) if table else sensor


def sequence_of(sensor: ActiveSensor, settings: SensorSettings) -> imaging.PatternSequence:
    """Return the patterns of a sensor with one camera: the settings' sequence or fringes."""
    if settings.sequence is not None:
        return settings.sequence
    sequence = fringe_sequence(settings.fringes, projector_of(sensor), settings.steps)
    return replace(sequence, bit_depth=settings.camera.bit_depth)


def matt_white_radiance(sensor: ActiveSensor, settings: SensorSettings, passed: float) -> float:
    """Return the light of matt white at the TCP, facing the camera, behind its lens, 1/mm².

    Parameters
    ----------
    sensor : ActiveSensor
        With a projector.
    settings : SensorSettings
        Both lenses are read.
    passed : float
        Share of the projector's light that the patterns pass on average.

    Raises
    ------
    SensorError
        If the projector lights the plate from behind.
    """
    # the part's frame: the TCP's
    lamp = lamp_of(sensor, sensor.camera_from_tcp, settings.projector)
    facing = -lamp.centre_mm[2] / float(np.linalg.norm(lamp.centre_mm))
    if facing <= 0:
        msg = f"sensor {sensor.name!r}: its projector lights a plate at the TCP from behind"
        raise SensorError(msg)
    x, y, z = sensor.camera_from_tcp.translation_mm
    dimmed = (z / math.sqrt(x * x + y * y + z * z)) ** settings.lens.vignetting_exponent
    return float(passed * lamp.irradiance_at_tcp * facing / math.pi * dimmed)


def electrons_on_matt_white(
    sensor: ActiveSensor, settings: SensorSettings, passed: float
) -> CameraElectronics:
    """Return a camera with the sensitivity that `MattWhite` stands for.

    Parameters
    ----------
    sensor : ActiveSensor
        With a projector.
    settings : SensorSettings
        Has `matt_white`; without it the camera is returned as it is.
    passed : float
        Share of the projector's light that the patterns pass on average.

    Raises
    ------
    SensorError
        If the projector lights the plate from behind, or the image would clip: nobody can have
        measured it.
    """
    camera, white = settings.camera, settings.matt_white
    if white is None:
        return camera
    peak = 1.0 + settings.projector.contrast if len(sensor.cameras) == 1 else 1.0
    unclipped = (GREY_MAX - camera.black_level) / peak
    if white.grey_levels > unclipped:
        msg = (
            f"sensor {sensor.name!r}: matt_white says {white.grey_levels:g} grey levels above the "
            f"black level, but its image clips beyond {unclipped:.0f}; measure it at a shorter "
            "exposure time"
        )
        raise SensorError(msg)
    radiance = matt_white_radiance(sensor, settings, passed)
    grey = white.grey_levels * full_scale(camera.bit_depth) / GREY_MAX
    electrons = grey / camera.gain - camera.dark_current_e_per_s * white.exposure_ms / 1000.0
    if electrons <= 0:
        msg = f"sensor {sensor.name!r}: its dark current alone is brighter than matt_white says"
        raise SensorError(msg)
    return replace(camera, electrons_per_ms=electrons / (white.exposure_ms * radiance))


def _merged(base: dict[str, Any], table: Mapping[str, Any]) -> dict[str, Any]:
    """Return a table with another laid over it; tables in both are laid over each other."""
    merged = dict(base)
    for key, value in table.items():
        below = merged.get(key)
        if isinstance(below, Mapping) and isinstance(value, Mapping) and key != "sequence":
            value = {**below, **value}
        merged[key] = value
    return merged
