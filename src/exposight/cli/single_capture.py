"""A capture that stands alone: its files and numbers on the command line, no campaign's folder."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import TYPE_CHECKING, Literal, cast, get_args

import numpy as np
import typer

from exposight.cell import Capture, Cloud, MemoryCampaign, Part, read_cloud, read_features
from exposight.cli.arguments import pose_from_file, pose_from_text, sensor_from
from exposight.errors import CloudError
from exposight.imaging import BitDepth, read_frames

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.typing import NDArray

    from exposight.cell import CaptureSource
    from exposight.geometry import RigidTransform
    from exposight.observing import ObservationTable


_TOO_NEAR = 500.0
"""A cloud in m lies 1000 times nearer than one in mm; none in mm lies 500 times too near."""


class CloudUnit(StrEnum):
    """Units that a cloud may come in."""

    MM = "mm"
    CM = "cm"
    M = "m"

    @property
    def mm(self) -> float:
        """How many mm it is."""
        return {"mm": 1.0, "cm": 10.0, "m": 1000.0}[self]


@dataclass(frozen=True, kw_only=True)
class SingleCapture:
    """What the command line says about a capture that stands alone; None where it says nothing."""

    image: Path | None
    bit_depth: int | None
    cloud: Path | None
    cloud_unit: CloudUnit | None
    features: Path | None
    sensor: str | None
    exposure_ms: float | None
    pose: Path | None
    robot_pose: tuple[str, str] | None

    def given(self) -> list[str]:
        """Return the options that were given."""
        return [option for option, value in self._options().items() if value is not None]

    def _options(self) -> dict[str, object]:
        return {f"--{name.replace('_', '-')}": value for name, value in vars(self).items()}

    def campaign(self) -> MemoryCampaign:
        """Read the files and return a campaign of this one capture.

        Raises
        ------
        typer.BadParameter
            If an option is missing, or the pose is given twice.
        ExposightError
            If a file cannot be used.
        """
        if (
            self.image is None
            or self.cloud is None
            or self.features is None
            or self.sensor is None
            or self.exposure_ms is None
            or (self.pose is None) == (self.robot_pose is None)
        ):
            raise typer.BadParameter(self._lacks())
        capture = Capture(
            view=self.image.stem,
            exposure_ms=self.exposure_ms,
            image=_read_image(self.image, self.bit_depth or 8),
            cloud=_read_cloud(self.cloud, self.cloud_unit or CloudUnit.MM),
            camera_from_part=self._camera_from_part(),
            bit_depth=self.bit_depth or 8,
        )
        part = Part(name=self.features.stem, features=read_features(self.features))
        sensor = sensor_from(self.sensor)
        return MemoryCampaign(name=str(self.image), sensor=sensor, part=part, captures=[capture])

    def _camera_from_part(self) -> RigidTransform:
        if self.robot_pose is not None:
            return pose_from_text(*self.robot_pose)
        return pose_from_file(cast("Path", self.pose))

    def _lacks(self) -> str:
        needed = ("--image", "--cloud", "--features", "--sensor", "--exposure-ms")
        given = self.given()
        if not given:
            return (
                f"give a campaign's folder, or a single capture by {', '.join(needed)} and --pose "
                "or --robot-pose"
            )
        missing = [option for option in needed if option not in given]
        if "--pose" not in given and "--robot-pose" not in given:
            missing.append("--pose or --robot-pose")
        if missing:
            return f"a single capture also needs {', '.join(missing)}"
        return "give the pose once, by --pose or --robot-pose"


def _read_image(path: Path, bit_depth: int) -> NDArray[np.uint8] | NDArray[np.uint16]:
    if bit_depth not in get_args(BitDepth):
        msg = f"--bit-depth must be 8, 12 or 16, got {bit_depth}"
        raise typer.BadParameter(msg)
    stack = read_frames([path], bit_depth=cast("Literal[8, 12, 16]", bit_depth))
    return cast("NDArray[np.uint8] | NDArray[np.uint16]", stack.frames[0])


def _read_cloud(path: Path, unit: CloudUnit) -> Cloud:
    cloud = read_cloud(path)
    return cloud if unit is CloudUnit.MM else Cloud(points=unit.mm * cloud.points)


def check_cloud_unit(source: CaptureSource, table: ObservationTable) -> None:
    """Refuse clouds in another unit than mm: each p_norm would be 0, which nobody measured.

    Parameters
    ----------
    source : CaptureSource
        What was observed.
    table : ObservationTable
        Its observations.

    Raises
    ------
    CloudError
        If no feature has a point and the cloud lies far too near to the sensor.
    """
    measured = table.measured()
    if len(measured) == 0 or (measured.array(["p_norm"]) > 0.0).any():
        return
    clouds = (capture.cloud for capture in source.captures())
    cloud = next((own for own in clouds if own is not None and own.n_valid), None)
    if cloud is None:
        return
    features_mm = source.sensor.camera_from_tcp.apply(measured.array(["x_mm", "y_mm", "z_mm"]))
    expected_mm = float(np.median(np.linalg.norm(features_mm, axis=1)))
    found = float(np.median(np.linalg.norm(cloud.valid_points, axis=1)))
    if found * _TOO_NEAR > expected_mm:
        return
    msg = (
        f"every p_norm is 0: features are expected {expected_mm:.0f} mm from the camera, and the "
        f"cloud's points lie {found:.3g} from it, so its unit is m, not mm; say --cloud-unit m for "
        "a single capture, or multiply the clouds by 1000 before they are put into a campaign"
    )
    raise CloudError(msg)
