"""A capture that stands alone: its files and numbers on the command line, no campaign's folder."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import TYPE_CHECKING, cast

import numpy as np
import typer

from exposight.cell import (
    BIT_DEPTHS,
    BitDepth,
    Capture,
    MemoryCampaign,
    Part,
    read_cloud,
    read_features,
    sensor_named_or_read,
)
from exposight.geometry import parse_pose, read_pose
from exposight.imaging import read_frames

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.typing import NDArray

    from exposight.geometry import RigidTransform


class CloudUnit(StrEnum):
    """Units that a cloud may come in."""

    MM = "mm"
    CM = "cm"
    M = "m"


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
            cloud=read_cloud(self.cloud, unit=(self.cloud_unit or CloudUnit.MM).value),
            camera_from_part=self._camera_from_part(),
            bit_depth=self.bit_depth or 8,
        )
        part = Part(name=self.features.stem, features=read_features(self.features))
        sensor = sensor_named_or_read(self.sensor)
        return MemoryCampaign(name=str(self.image), sensor=sensor, part=part, captures=[capture])

    def _camera_from_part(self) -> RigidTransform:
        if self.robot_pose is not None:
            return parse_pose(*self.robot_pose)
        return read_pose(cast("Path", self.pose))

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
    if bit_depth not in BIT_DEPTHS:
        msg = f"--bit-depth must be one of {', '.join(map(str, BIT_DEPTHS))}, got {bit_depth}"
        raise typer.BadParameter(msg)
    stack = read_frames([path], bit_depth=cast("BitDepth", bit_depth))
    return cast("NDArray[np.uint8] | NDArray[np.uint16]", stack.frames[0])
