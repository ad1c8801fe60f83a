"""An active 3D sensor: cameras, projector, TCP and exposure times; its JSON; the paper's two.

Each figure of the presets is given with its source. What the paper does not give is marked as
assumed; replace it with your own sensor's calibration (`write_sensor`, edit, `read_sensor`).

Table 7 gives each projector's "transformation between camera and projector" as a position and
"(0, −20, 0)°". The norm of the first is 0.234 m at 19.98° off the image plane, so that one of the
devices lies in the other's image plane. Read as ``projector_from_camera``, turned by 180° about z
(as if Table 7's x ran against the TCP's), it puts the projectors at (234, 0, 0) mm and
(241, −50, −136) mm in the camera's frame, turned by Ry(−20°): their axes cross the cameras' at 643
and 526 mm, near the TCPs at 600 and 500 mm; the RandomDot's specified field lights the measuring
field; and surfaces at +x are lit more strongly, as Sect. 3.4.8 reports. Read as
``camera_from_projector`` instead, the stereo planes would lie 179 to 480 mm before a projector that
is specified from 500 mm on; without the half turn the bright side would be −x.
"""

from __future__ import annotations

import json
import math
import os
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import MappingProxyType
from typing import Annotated, Any

import numpy as np
from pydantic import Field

from exposight.contradictions import Contradiction, settle
from exposight.contradictions.rigs import axes_crossing, baseline
from exposight.errors import SensorError, did_you_mean
from exposight.files import DocumentFormat, StoredAs, check_plain, read_text, write_durably
from exposight.geometry import PinholeCamera, RigidTransform

_Row = Annotated[tuple[float, ...], Field(min_length=4, max_length=4)]
_Rows = Annotated[tuple[_Row, ...], Field(min_length=4, max_length=4)]

StoredPose = Annotated[
    RigidTransform,
    StoredAs(_Rows, write=lambda pose: pose.to_matrix().tolist(), read=RigidTransform.from_matrix),
]
"""A pose that files hold as a 4×4 matrix, row by row, translation in mm."""


@dataclass(frozen=True, kw_only=True)
class Projector:
    """A pattern projector: a camera with light running the other way.

    Parameters
    ----------
    camera : PinholeCamera
        Size of the pattern in px and the lens.
    camera_from_projector : RigidTransform
        Where it is, seen from the sensor's first camera.
    """

    camera: PinholeCamera
    camera_from_projector: StoredPose

    @property
    def width(self) -> int:
        """Columns of the pattern."""
        return self.camera.width

    @property
    def height(self) -> int:
        """Rows of the pattern."""
        return self.camera.height


@dataclass(frozen=True, kw_only=True)
class ExposureRange:
    """Exposure times that a sensor can take, all in ms.

    Parameters
    ----------
    min_ms, max_ms : float, ms
        Shortest and longest.
    increment_ms : float, ms
        The step between settings.

    Raises
    ------
    SensorError
        Unless 0 < minimum ≤ maximum and the increment is above 0.
    """

    min_ms: float
    max_ms: float
    increment_ms: float

    def __post_init__(self) -> None:
        numbers = low, high, step = [*map(float, (self.min_ms, self.max_ms, self.increment_ms))]
        if not (0 < low <= high < math.inf and 0 < step < math.inf):
            msg = (
                "exposure times need 0 < minimum ≤ maximum and an increment above 0 in ms, got "
                f"{low:g}, {high:g} and {step:g}"
            )
            raise SensorError(msg)
        for name, number in zip(("min_ms", "max_ms", "increment_ms"), numbers, strict=True):
            object.__setattr__(self, name, number)


@dataclass(frozen=True, kw_only=True)
class ActiveSensor:
    """A structured-light or active stereo sensor.

    Parameters
    ----------
    name : str
        Name of the sensor.
    cameras : tuple of PinholeCamera
        One, or two for stereo; clouds are in the first one's frame and organised like its image.
    first_from_camera : tuple of RigidTransform
        Where each camera is, seen from the first, so the first entry is the identity.
    projector : Projector or None
        None where it is not known.
    camera_from_tcp : RigidTransform
        Where the tool centre point is, seen from the first camera: origin in the middle plane of
        the working volume, axes parallel to the camera's.
    exposure : ExposureRange
        Exposure times that it can take.
    working_distance_mm : (float, float), mm
        Nearest and farthest distance along the first camera's axis at which it measures.
    simulated : mapping of str to object
        What the simulated cell shall know of it: electronics, lenses, patterns (`exposight.twin`
        reads it). Nothing else looks at it.

    Raises
    ------
    SensorError
        If anything of that is missing or contradicts itself.
    ContradictionError
        If its devices cannot stand so close to each other, or so far apart.
    """

    name: str
    cameras: tuple[PinholeCamera, ...]
    first_from_camera: tuple[StoredPose, ...]
    projector: Projector | None
    camera_from_tcp: StoredPose
    exposure: ExposureRange
    working_distance_mm: tuple[float, float]
    simulated: Mapping[str, Any] = field(default_factory=dict, hash=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "cameras", tuple(self.cameras))
        object.__setattr__(self, "first_from_camera", tuple(self.first_from_camera))
        near, far = self.working_distance_mm
        object.__setattr__(self, "working_distance_mm", (float(near), float(far)))
        fault = self._fault()
        if fault:
            msg = f"sensor {self.name!r}: {fault}"
            raise SensorError(msg)
        settle(self.contradictions())

    def _fault(self) -> str:
        if not self.name.strip():
            return "a sensor needs a name"
        check_plain(self.name, "the sensor", SensorError)
        if not self.cameras or len(self.cameras) != len(self.first_from_camera):
            return (
                "a sensor needs at least one camera and a pose for each, got "
                f"{len(self.cameras)} cameras and {len(self.first_from_camera)} poses"
            )
        if self.first_from_camera[0] != RigidTransform():
            return "the first pose in first_from_camera must be the identity"
        near, far = self.working_distance_mm
        if not (math.isfinite(far) and 0 < near < far):
            return f"working distances need 0 < near < far in mm, got {near:g} and {far:g}"
        return ""

    def contradictions(self) -> tuple[Contradiction, ...]:
        """Return what of the devices' places cannot be, or may not be meant."""
        devices = {f"camera 1 and {i}": pose for i, pose in enumerate(self.first_from_camera, 1)}
        del devices["camera 1 and 1"]
        if self.projector is not None:
            devices["camera and projector"] = self.projector.camera_from_projector
        found = [
            baseline(
                float(np.linalg.norm(pose.translation_mm)),
                f"{what} of sensor {self.name!r}",
                self.working_distance_mm,
            )
            for what, pose in devices.items()
        ]
        found += [
            axes_crossing(
                pose.rotation,
                pose.translation_mm,
                f"{what} of sensor {self.name!r}",
                self.working_distance_mm,
            )
            for what, pose in devices.items()
        ]
        return tuple(each for each in found if each is not None)

    @property
    def camera(self) -> PinholeCamera:
        """The first camera, in whose frame and image clouds are."""
        return self.cameras[0]

    def check_exposure(self, exposure_ms: float) -> float:
        """Return an exposure time that the sensor can take.

        Parameters
        ----------
        exposure_ms : float, ms
            Need not be a multiple of the increment: cameras report what they really took.

        Raises
        ------
        SensorError
            If it is outside the sensor's range, or not a number.
        """
        if not self.exposure.min_ms <= exposure_ms <= self.exposure.max_ms:
            raise self._outside(exposure_ms)
        return float(exposure_ms)

    def check_taken_exposure(self, exposure_ms: float) -> float:
        """Return an exposure time that the sensor can have taken, as it was read back.

        Parameters
        ----------
        exposure_ms : float, ms
            At the ends of the range less than an increment outside it: devices round.

        Raises
        ------
        SensorError
            If it is farther outside, or not a number.
        """
        low, high, step = self.exposure.min_ms, self.exposure.max_ms, self.exposure.increment_ms
        if not low - step < exposure_ms < high + step:
            raise self._outside(exposure_ms)
        return float(exposure_ms)

    def _outside(self, exposure_ms: float) -> SensorError:
        return SensorError(
            f"sensor {self.name!r} takes exposure times from {self.exposure.min_ms:g} to "
            f"{self.exposure.max_ms:g} ms, got {exposure_ms:g} ms; choose one in that range, "
            "and check the unit"
        )

    def nearest_exposure(self, exposure_ms: float) -> float:
        """Return the exposure time nearest to a wish that the sensor can be set to.

        Settings are the minimum plus whole increments, up to the maximum.

        Parameters
        ----------
        exposure_ms : float, ms
            The wish, inside the sensor's range.

        Raises
        ------
        SensorError
            If it is outside the sensor's range, or not a number.
        """
        exposure = self.exposure
        above = self.check_exposure(exposure_ms) - exposure.min_ms
        # Without the slack a span of 2.9999999 increments would lose its last setting.
        last = math.floor((exposure.max_ms - exposure.min_ms) / exposure.increment_ms + 1e-6)
        steps = min(round(above / exposure.increment_ms), last)
        # Nanoseconds are finer than any camera: rounding only drops the dust of the sum.
        return round(exposure.min_ms + steps * exposure.increment_ms, 6)

    def to_json(self) -> str:
        """Return the sensor as a JSON document (``docs/formats.md``).

        Without a table ``simulated`` it is of version 1, which older versions of exposight read.
        """
        if self.simulated:
            return _FORMAT.to_json(self)
        plain = json.loads(replace(_FORMAT, version=1).to_json(self))
        del plain["simulated"]
        return json.dumps(plain, indent=2, ensure_ascii=False) + "\n"

    @classmethod
    def from_json(cls, text: str, *, source: str = "the sensor's JSON") -> ActiveSensor:
        """Read a sensor from a JSON document, called `source` in messages.

        Raises
        ------
        FormatError
            If it is not such a document, a key is missing or unknown, or a value is impossible.
        VersionError
            If a newer version of exposight wrote it.
        """
        return _FORMAT.from_json(text, source)


_FORMAT = DocumentFormat("exposight sensor", 2, ActiveSensor)  # 2: with a table ``simulated``


def read_sensor(path: Path) -> ActiveSensor:
    """Read a sensor's JSON file.

    Raises
    ------
    MissingFileError
        If it is not there.
    FormatError, VersionError
        As `ActiveSensor.from_json`.
    """
    return ActiveSensor.from_json(read_text(path, "sensor file"), source=str(path))


def write_sensor(path: Path, sensor: ActiveSensor) -> None:
    """Write a sensor's JSON file; the file is whole or absent.

    Raises
    ------
    FileError
        If the disk refuses.
    """
    write_durably(path, sensor.to_json().encode())


def _ideal_camera(width: int, height: int, focal_length_px: float) -> PinholeCamera:
    """Square pixels, principal point in the image's middle, no distortion: assumed throughout."""
    return PinholeCamera(
        width=width,
        height=height,
        fx=focal_length_px,
        fy=focal_length_px,
        cx=(width - 1) / 2,
        cy=(height - 1) / 2,
    )


def _ahead(distance_mm: float) -> RigidTransform:
    return RigidTransform(translation_mm=np.array([0.0, 0.0, distance_mm]))


def _read_from_table_7(x: float, y: float, z: float) -> RigidTransform:
    """Return the pose of a projector that Table 7 gives as (x, y, z) mm and (0, −20, 0)°."""
    half_turn = RigidTransform(rotation=np.diag([-1.0, -1.0, 1.0]))
    projector_from_camera = RigidTransform.from_fanuc_wpr((x, y, z), 0.0, -20.0, 0.0)
    return half_turn @ projector_from_camera.inverse() @ half_turn


def _comet_pro_ae() -> ActiveSensor:
    # Sect. 3.2.1: 4 megapixels. Table 7: a field of 0.59 m × 0.39 m at 0.60 m. 2464 × 1632 is the
    # size of 4 megapixels at that aspect (assumed), and the field's width gives the focal length.
    width, height = 2464, 1632
    focal_length_px = width * 600.0 / 590.0
    projector = Projector(
        # 1920 × 1200 px is assumed. Table 7 gives no projector's field, but the real one covers the
        # measuring field: 1580 px is the longest focal length, rounded down to tens, that lights
        # the whole field at 0.40, 0.60 and 0.80 m from that position.
        camera=_ideal_camera(1920, 1200, 1580.0),
        camera_from_projector=_read_from_table_7(220.0, 0.0, 80.0),
    )
    return ActiveSensor(
        name="ZEISS COMET Pro AE",
        cameras=(_ideal_camera(width, height, focal_length_px),),
        first_from_camera=(RigidTransform(),),
        projector=projector,
        # Sect. 3.1.2: the TCP lies in the middle plane of the working volume; Table 7: 0.60 m. That
        # it lies on the camera's axis is assumed.
        camera_from_tcp=_ahead(600.0),
        # Table 7: 1–1000 ms. The increment is assumed: the paper's exposure times are whole ms.
        exposure=ExposureRange(min_ms=1.0, max_ms=1000.0, increment_ms=1.0),
        working_distance_mm=(400.0, 800.0),  # Table 7: planes at 0.40, 0.60 and 0.80 m
    )


def _rc_visard_65() -> ActiveSensor:
    # Roboception's hardware specification: 1280 × 960 px, 61° × 48°, baseline 65 mm. 61° across
    # gives the focal length; with square pixels the height is then 47.7°.
    width, height = 1280, 960
    focal_length_px = width / 2 / math.tan(math.radians(61.0 / 2))
    camera = _ideal_camera(width, height, focal_length_px)
    projector = Projector(
        # Roboception: the RandomDot's field is 62° × 48°. 1800 × 1334 px is assumed: at the TCP
        # a pixel is then as wide as the camera's, and a dot about 3 of them.
        camera=_ideal_camera(1800, 1334, 900.0 / math.tan(math.radians(31.0))),
        camera_from_projector=_read_from_table_7(180.0, -50.0, 210.0),
    )
    return ActiveSensor(
        name="Roboception rc_visard 65 with RandomDot projector",
        cameras=(camera, camera),
        # Rectified pair: the second (right) camera stands one baseline along +x.
        first_from_camera=(
            RigidTransform(),
            RigidTransform(translation_mm=np.array([65.0, 0.0, 0.0])),
        ),
        projector=projector,
        # Table 7: the middle one of three planes is at 0.50 m. On the left camera's axis: assumed.
        camera_from_tcp=_ahead(500.0),
        # Table 7: 0.07–18 ms. The increment is assumed: 1 µs, the unit of GenICam's ExposureTime.
        exposure=ExposureRange(min_ms=0.07, max_ms=18.0, increment_ms=0.001),
        working_distance_mm=(100.0, 1000.0),  # Table 7: planes at 0.10, 0.50 and 1.00 m
    )


PRESETS: Mapping[str, ActiveSensor] = MappingProxyType(
    {"comet-pro-ae": _comet_pro_ae(), "rc-visard-65": _rc_visard_65()}
)
"""The paper's sensors (Table 7), by name."""


def sensor_preset(name: str) -> ActiveSensor:
    """Return one of the paper's sensors (Table 7).

    Parameters
    ----------
    name : {'comet-pro-ae', 'rc-visard-65'}
        ZEISS COMET Pro AE (structured light) or Roboception rc_visard 65 (active stereo).

    Raises
    ------
    SensorError
        If there is no such preset.
    """
    if name in PRESETS:
        return PRESETS[name]
    msg = f"no sensor preset is called {name!r}; there are {', '.join(PRESETS)}"
    raise SensorError(msg + did_you_mean(name, PRESETS))


def sensor_named_or_read(name_or_path: str | Path) -> ActiveSensor:
    """Return the sensor that a preset's name or the path of a JSON file stands for.

    Parameters
    ----------
    name_or_path : str or path
        A key of `PRESETS`, or a sensor's JSON file.

    Raises
    ------
    SensorError
        If it is neither.
    FileError
        If the file cannot be read as a sensor.
    """
    name, path = str(name_or_path), Path(name_or_path)
    if name in PRESETS:
        return PRESETS[name]
    if os.path.isfile(path) or path.suffix.lower() == ".json":  # noqa: PTH113 - no error where a name is too long
        return read_sensor(path)
    msg = (
        f"no sensor '{name}': expected one of the presets {', '.join(PRESETS)}, or the JSON file "
        "of a sensor (every campaign folder has its own, sensor.json)"
    )
    raise SensorError(msg + did_you_mean(name, PRESETS))


def preset_name(sensor: ActiveSensor) -> str | None:
    """Return the name of the preset that a sensor is, or None where it is another sensor."""
    return next((name for name, preset in PRESETS.items() if preset == sensor), None)
