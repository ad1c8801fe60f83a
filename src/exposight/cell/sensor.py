"""An active 3D sensor: cameras, projector, TCP, and the exposure times it can take."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

from exposight.cell.sensor_document import (
    SENSOR_FORMAT,
    SENSOR_VERSION,
    CameraDocument,
    ExposureDocument,
    ProjectorDocument,
    SensorDocument,
    pose_from_rows,
    rows_from_pose,
)
from exposight.errors import FormatError, InputError, MissingFileError, SensorError
from exposight.files.documents import check_header, parse_json, validate
from exposight.files.durable import write_durably
from exposight.geometry import PinholeCamera, RigidTransform


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
    camera_from_projector: RigidTransform

    @property
    def width(self) -> int:
        """Columns of the pattern."""
        return self.camera.width

    @property
    def height(self) -> int:
        """Rows of the pattern."""
        return self.camera.height


@dataclass(frozen=True, kw_only=True)
class ActiveSensor:
    """A structured-light or active stereo sensor.

    Parameters
    ----------
    name : str
        What people call it.
    cameras : tuple of PinholeCamera
        One, or two for stereo; clouds are in the first one's frame and organised like its image.
    first_from_camera : tuple of RigidTransform
        Where each camera is, seen from the first, so the first entry is the identity.
    projector : Projector or None
        None where it is not known.
    camera_from_tcp : RigidTransform
        Where the tool centre point is, seen from the first camera: origin in the middle plane of
        the working volume, axes parallel to the camera's.
    exposure_min_ms, exposure_max_ms, exposure_increment_ms : float, ms
        Exposure times it can take: minimum, maximum, and the step between settings.
    working_distance_mm : (float, float), mm
        Nearest and farthest distance along the first camera's axis at which it measures.

    Raises
    ------
    SensorError
        If anything of that is missing or contradicts itself.
    """

    name: str
    cameras: tuple[PinholeCamera, ...]
    first_from_camera: tuple[RigidTransform, ...]
    projector: Projector | None
    camera_from_tcp: RigidTransform
    exposure_min_ms: float
    exposure_max_ms: float
    exposure_increment_ms: float
    working_distance_mm: tuple[float, float]

    def __post_init__(self) -> None:
        object.__setattr__(self, "cameras", tuple(self.cameras))
        object.__setattr__(self, "first_from_camera", tuple(self.first_from_camera))
        for name in ("exposure_min_ms", "exposure_max_ms", "exposure_increment_ms"):
            object.__setattr__(self, name, float(getattr(self, name)))
        near, far = self.working_distance_mm
        object.__setattr__(self, "working_distance_mm", (float(near), float(far)))
        fault = self._fault()
        if fault:
            msg = f"sensor {self.name!r}: {fault}"
            raise SensorError(msg)

    def _fault(self) -> str:
        if not self.name.strip():
            return "a sensor needs a name"
        if not self.cameras or len(self.cameras) != len(self.first_from_camera):
            return (
                "a sensor needs at least one camera and a pose for each, got "
                f"{len(self.cameras)} cameras and {len(self.first_from_camera)} poses"
            )
        if self.first_from_camera[0] != RigidTransform():
            return "the first pose in first_from_camera must be the identity"
        low, high, step = self.exposure_min_ms, self.exposure_max_ms, self.exposure_increment_ms
        if not (all(map(math.isfinite, (low, high, step))) and 0 < low <= high and step > 0):
            return (
                "exposure times need 0 < minimum ≤ maximum and an increment above 0 in ms, got "
                f"{low:g}, {high:g} and {step:g}"
            )
        near, far = self.working_distance_mm
        if not (math.isfinite(far) and 0 < near < far):
            return f"working distances need 0 < near < far in mm, got {near:g} and {far:g}"
        return ""

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
        if not self.exposure_min_ms <= exposure_ms <= self.exposure_max_ms:
            msg = (
                f"sensor {self.name!r} takes exposure times from {self.exposure_min_ms:g} to "
                f"{self.exposure_max_ms:g} ms, got {exposure_ms:g} ms; choose one in that range, "
                "and check the unit"
            )
            raise SensorError(msg)
        return float(exposure_ms)

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
        above = self.check_exposure(exposure_ms) - self.exposure_min_ms
        span = self.exposure_max_ms - self.exposure_min_ms
        # Without the slack a span of 2.9999999 increments would lose its last setting.
        last = math.floor(span / self.exposure_increment_ms + 1e-6)
        steps = min(round(above / self.exposure_increment_ms), last)
        # Nanoseconds are finer than any camera: rounding only drops the dust of the sum.
        return round(self.exposure_min_ms + steps * self.exposure_increment_ms, 6)

    def to_json(self) -> str:
        """Return the sensor as a JSON document (``docs/formats.md``)."""
        projector = None
        if self.projector is not None:
            projector = ProjectorDocument(
                camera=CameraDocument.describe(self.projector.camera),
                camera_from_projector=rows_from_pose(self.projector.camera_from_projector),
            )
        document = SensorDocument(
            format=SENSOR_FORMAT,
            version=SENSOR_VERSION,
            name=self.name,
            cameras=tuple(map(CameraDocument.describe, self.cameras)),
            first_from_camera=tuple(map(rows_from_pose, self.first_from_camera)),
            projector=projector,
            camera_from_tcp=rows_from_pose(self.camera_from_tcp),
            exposure=ExposureDocument(
                min_ms=self.exposure_min_ms,
                max_ms=self.exposure_max_ms,
                increment_ms=self.exposure_increment_ms,
            ),
            working_distance_mm=self.working_distance_mm,
        )
        return document.model_dump_json(indent=2) + "\n"

    @classmethod
    def from_json(cls, text: str, *, source: str = "the sensor's JSON") -> ActiveSensor:
        """Read a sensor from a JSON document.

        Parameters
        ----------
        text : str
            The document.
        source : str
            Where it comes from, for messages.

        Raises
        ------
        FormatError
            If it is not such a document, a key is missing or unknown, or a value is impossible.
        VersionError
            If a newer version of exposight wrote it.
        """
        raw = parse_json(text, source)
        check_header(raw, format_name=SENSOR_FORMAT, newest=SENSOR_VERSION, source=source)
        document = validate(SensorDocument, text, source)
        try:
            return cls._from_document(document)
        except InputError as error:
            msg = f"{source}: {error}"
            raise FormatError(msg) from error

    @classmethod
    def _from_document(cls, document: SensorDocument) -> ActiveSensor:
        projector = None
        if document.projector is not None:
            projector = Projector(
                camera=document.projector.camera.build(),
                camera_from_projector=pose_from_rows(document.projector.camera_from_projector),
            )
        near, far = document.working_distance_mm
        return cls(
            name=document.name,
            cameras=tuple(camera.build() for camera in document.cameras),
            first_from_camera=tuple(map(pose_from_rows, document.first_from_camera)),
            projector=projector,
            camera_from_tcp=pose_from_rows(document.camera_from_tcp),
            exposure_min_ms=document.exposure.min_ms,
            exposure_max_ms=document.exposure.max_ms,
            exposure_increment_ms=document.exposure.increment_ms,
            working_distance_mm=(near, far),
        )


def read_sensor(path: Path) -> ActiveSensor:
    """Read a sensor's JSON file.

    Raises
    ------
    MissingFileError
        If it is not there.
    FormatError
        If it is not such a file, a key is missing or unknown, or a value is impossible.
    VersionError
        If a newer version of exposight wrote it.
    """
    path = Path(path)
    if not path.is_file():
        msg = f"no sensor file at {path}; `write_sensor` or a preset makes one"
        raise MissingFileError(msg)
    try:
        text = path.read_text(encoding="utf-8")
    except UnicodeDecodeError as error:
        msg = f"{path} is not UTF-8 text; expected a sensor's JSON"
        raise FormatError(msg) from error
    return ActiveSensor.from_json(text, source=str(path))


def write_sensor(path: Path, sensor: ActiveSensor) -> None:
    """Write a sensor's JSON file; the file is whole or absent.

    Raises
    ------
    FileError
        If the disk refuses.
    """
    write_durably(path, sensor.to_json().encode())
