"""How a sensor is written as JSON: the schema alone, checked by pydantic (``docs/formats.md``)."""

from __future__ import annotations

from typing import Annotated, Final, Literal

from pydantic import Field

from exposight.files.documents import StrictDocument
from exposight.geometry import PinholeCamera, RigidTransform

SENSOR_FORMAT: Final = "exposight sensor"
SENSOR_VERSION = 1

_Row = Annotated[tuple[float, ...], Field(min_length=4, max_length=4)]
PoseMatrix = Annotated[tuple[_Row, ...], Field(min_length=4, max_length=4)]
"""A 4×4 pose, row by row, translation in mm."""


def rows_from_pose(pose: RigidTransform) -> PoseMatrix:
    """Return a pose as four rows of four numbers, translation in mm."""
    return tuple(tuple(map(float, row)) for row in pose.to_matrix())


def pose_from_rows(rows: PoseMatrix) -> RigidTransform:
    """Return the pose that four rows of four numbers describe."""
    return RigidTransform.from_matrix(rows)


class CameraDocument(StrictDocument):
    """Intrinsic parameters of a camera or projector, in px."""

    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float
    skew: float
    distortion: tuple[float, ...]

    @classmethod
    def describe(cls, camera: PinholeCamera) -> CameraDocument:
        """Return the document of a camera."""
        return cls(
            width=int(camera.width),
            height=int(camera.height),
            fx=float(camera.fx),  # numpy's numbers are not JSON's
            fy=float(camera.fy),
            cx=float(camera.cx),
            cy=float(camera.cy),
            skew=float(camera.skew),
            distortion=camera.distortion,
        )

    def build(self) -> PinholeCamera:
        """Return the camera."""
        return PinholeCamera(
            width=self.width,
            height=self.height,
            fx=self.fx,
            fy=self.fy,
            cx=self.cx,
            cy=self.cy,
            skew=self.skew,
            distortion=self.distortion,
        )


class ProjectorDocument(StrictDocument):
    """A projector and where it is."""

    camera: CameraDocument
    camera_from_projector: PoseMatrix


class ExposureDocument(StrictDocument):
    """The exposure times that a sensor can take, in ms."""

    min_ms: float
    max_ms: float
    increment_ms: float


class SensorDocument(StrictDocument):
    """A whole sensor."""

    format: Literal["exposight sensor"]
    version: int
    name: str
    cameras: tuple[CameraDocument, ...]
    first_from_camera: tuple[PoseMatrix, ...]
    projector: ProjectorDocument | None
    camera_from_tcp: PoseMatrix
    exposure: ExposureDocument
    working_distance_mm: Annotated[tuple[float, ...], Field(min_length=2, max_length=2)]
