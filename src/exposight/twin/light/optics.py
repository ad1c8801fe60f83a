"""Lenses and lamps, and a scene made ready for rays."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Literal

from exposight.cell import ActiveSensor, Projector
from exposight.errors import InputError, SensorError
from exposight.geometry.ray_casting import RayCaster
from exposight.twin.part import Scene
from exposight.twin.part.finishes import zone_table
from exposight.twin.part.surfaces import surface_table

Lighting = Literal["I", "II", "III"]
"""Scenarios of Sect. 4.1 of the paper: I closed cell, II its LED on, III cell open to the hall."""

AMBIENT_SHARE: Mapping[Lighting, float] = MappingProxyType(
    # Table 4: with the LED, and with the cell open, the exposure time was overestimated by 2 and
    # 3 ms on exposures of 15 to 115 ms, mean 65 (Sect. 4.1.2): the image was 3.1 % and 4.6 %
    # brighter than the stripes alone, whose mean is half of the full light. The closed cell with
    # tinted windows, seen through the band-pass filter, is taken as nearly dark (assumed).
    {"I": 0.001, "II": 0.5 * 2.0 / 65.0, "III": 0.5 * 3.0 / 65.0}
)
"""Ambient irradiance as a share of the fully lit projector's at the TCP, facing it."""


def ambient_share(lighting: Lighting | float) -> float:
    """Return the ambient light of a scenario or of a number, as a share (`AMBIENT_SHARE`).

    Raises
    ------
    InputError
        If there is no such scenario, or the number is negative or not finite.
    """
    if isinstance(lighting, str):
        if lighting in AMBIENT_SHARE:
            return AMBIENT_SHARE[lighting]
    elif 0 <= lighting < math.inf:
        return float(lighting)
    msg = (
        f"lighting must be one of {', '.join(AMBIENT_SHARE)}, or the ambient light as a share of "
        f"the projector's from 0 up, got {lighting!r}"
    )
    raise InputError(msg)


@dataclass(frozen=True, kw_only=True)
class ProjectorLens:
    """How sharp and how deep a projector's pattern is.

    Parameters
    ----------
    contrast : float
        c₀: modulation of a coarse stripe pattern in the projected light.
    sharp_blur_px : float, projector px
        Standard deviation of the blur in focus.
    defocus_px_mm : float, projector px · mm
        Blur's standard deviation for a defocus |1/z − 1/z_focus| of 1/mm: ¼ of the lens's pupil in
        mm times the focal length in px, as a disc of diameter d has the standard deviation d/4.
    focus_mm : float, mm, optional
        Distance along the optical axis at which the pattern is sharp; default is the TCP's.

    Raises
    ------
    SensorError
        If a number makes no sense.
    """

    # First prototype of the twin, for the paper's structured-light sensor: c₀ = 0.9, and
    # σ² = 0.7² + (3.0·|1/z − 1/z_focus|)² with z in m; at 1580 px that is a pupil of 7.6 mm, at the
    # bright end: a DMD engine at f/2.4 has 4.3 to 6.1 mm. It decides how much position matters for
    # quality once brightness is given.
    contrast: float = 0.9
    sharp_blur_px: float = 0.7
    defocus_px_mm: float = 3000.0
    focus_mm: float | None = None

    def __post_init__(self) -> None:
        blurs = (self.sharp_blur_px, self.defocus_px_mm)
        if (
            not 0 < self.contrast <= 1
            or not all(0 <= blur < math.inf for blur in blurs)
            or (self.focus_mm is not None and not 0 < self.focus_mm < math.inf)
        ):
            msg = (
                "a projector's lens needs a contrast above 0 and up to 1, blurs of 0 or more and "
                f"a focus in front of it, got {self}"
            )
            raise SensorError(msg)


@dataclass(frozen=True, kw_only=True)
class CameraLens:
    """How a camera's lens spreads and dims the light.

    Parameters
    ----------
    spread_px : float, px
        Standard deviation of the Gaussian point-spread function, pixel aperture included.
    vignetting_exponent : float
        Irradiance falls with this power of the cosine of the angle off the optical axis.

    Raises
    ------
    SensorError
        If a number makes no sense, or the spread is above 0.8 px: five pixels must hold it.
    """

    # A square pixel alone has 0.29 px; with diffraction at f/8 and 450 nm on pixels of 5.5 µm
    # (σ ≈ 0.42·λ·f/# = 0.27 px) 0.40 px. 0.5 px leaves some room for aberrations (assumed).
    spread_px: float = 0.5
    # Natural vignetting, the cos⁴ law.
    vignetting_exponent: float = 4.0

    def __post_init__(self) -> None:
        if not 0 <= self.spread_px <= 0.8 or not 0 <= self.vignetting_exponent < math.inf:
            msg = (
                "a camera's lens needs a spread from 0 to 0.8 px and a vignetting exponent of 0 "
                f"or more, got {self}"
            )
            raise SensorError(msg)


def projector_of(sensor: ActiveSensor) -> Projector:
    """Return a sensor's projector.

    Raises
    ------
    SensorError
        If its document has none.
    """
    if sensor.projector is None:
        msg = f"sensor {sensor.name!r} has no projector; the simulated cell needs one"
        raise SensorError(msg)
    return sensor.projector


class SceneTracer(RayCaster):
    """A scene made ready for rays: build it once, trace many views.

    Parameters
    ----------
    scene : Scene
        What light falls on.
    """

    def __init__(self, scene: Scene) -> None:
        super().__init__(scene.vertices, scene.faces)
        self.face_finish = scene.face_finish
        self.surfaces = surface_table(scene.surfaces)
        self.zones = zone_table(scene.zones, scene.surfaces)
        self.corner_normals = scene.corner_normals().reshape(-1, 3)
