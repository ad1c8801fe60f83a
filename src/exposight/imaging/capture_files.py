"""Images and clouds of captures in files, and what their files do not tell."""

from dataclasses import dataclass
from pathlib import Path
from typing import cast

import numpy as np

from exposight import cell
from exposight.errors import InputError
from exposight.imaging.frame_files import Alignment, Channel, read_frames


@dataclass(frozen=True, kw_only=True)
class CaptureForm:
    """What files of captures do not tell themselves.

    Parameters
    ----------
    brightness_source : str
        What images are (`exposight.cell.BrightnessSource`).
    bit_depth : int, 8 to 16
        Of images.
    alignment : {'low', 'high'}
        Which bits of 16 hold the grey level.
    saturation_level : int, optional
        Grey level from which on the sensor saturates, where that is below full scale. Such pixels
        are taken as full scale, so that they count as clipped.
    channel : {'red', 'green', 'blue'}, optional
        Which channel of colour images is read.
    cloud_unit : {'mm', 'cm', 'm'}, optional
        Of clouds; mm by default.
    cloud_axes : (str, str, str), optional
        Which of the file's axes are the camera's x, y and z.
    depth_scale_mm : float, optional
        Of depth images: mm a step.
    """

    brightness_source: cell.BrightnessSource = "stripe"
    bit_depth: cell.BitDepth = 8
    alignment: Alignment = "low"
    saturation_level: int | None = None
    channel: Channel | None = None
    cloud_unit: str | None = None
    cloud_axes: tuple[str, str, str] | None = None
    depth_scale_mm: float | None = None

    def image(self, path: Path) -> cell.Image:
        """Read an image; raises as `read_frames`."""
        stack = read_frames(
            [path],
            bit_depth=self.bit_depth,
            alignment=self.alignment,
            channel=self.channel,
            saturation_level=self.saturation_level,
        )
        image = stack.frames[0]
        if stack.clipping_level < stack.full_scale:
            image = np.where(image < stack.clipping_level, image, stack.full_scale)
        return cast("cell.Image", image.astype(stack.frames.dtype))

    def cloud(self, path: Path, sensor: cell.ActiveSensor) -> cell.Cloud:
        """Read a cloud, or a depth image as one.

        Raises
        ------
        InputError
            If the form says of one what only the other has.
        ExposightError
            As `read_cloud` and `read_depth_cloud`.
        """
        if not cell.is_depth_image(path):
            if self.depth_scale_mm is not None:
                msg = f"--depth-scale is of depth images; {path} is a point cloud (--cloud-unit)"
                raise InputError(msg)
            return cell.read_cloud(
                path, unit=self.cloud_unit or "mm", axes=self.cloud_axes or ("x", "y", "z")
            )
        if self.cloud_unit is not None or self.cloud_axes is not None:
            msg = f"{path} is a depth image: its unit is --depth-scale MM, its axes the camera's"
            raise InputError(msg)
        return cell.read_depth_cloud(path, sensor, scale_mm=self.depth_scale_mm)
