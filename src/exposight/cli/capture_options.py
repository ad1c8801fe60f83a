"""What files of captures do not tell, as options."""

from dataclasses import dataclass
from typing import Annotated, Literal

from cyclopts import Parameter

from exposight import cell
from exposight.imaging import Alignment, CaptureForm, Channel


@dataclass(frozen=True, kw_only=True)
class CaptureOptions:
    """What files of captures do not tell themselves.

    Parameters
    ----------
    brightness_source
        What the image is: one stripe image (by default), the stripes' mean, a texture image, or one
        of random dots.
    bit_depth
        Bit depth of the image (8 by default).
    alignment
        Which bits of 16 hold the grey level: low (by default) or high.
    saturation_level
        Grey level from which on the sensor saturates, where that is below full scale. Such pixels
        are taken as full scale, so that they count as clipped.
    channel
        Which channel of a colour image is read.
    cloud_unit
        Unit of the cloud (mm by default); its file does not say.
    cloud_axes
        Which of the file's axes are the camera's x (right), y (down) and z (ahead): x -y -z for a
        cloud made for viewers that use OpenGL.
    depth_scale
        Of a depth image: mm a step, 0.1 where it is in tenths of a mm; its file does not say.
    """

    brightness_source: cell.BrightnessSource | None = None
    bit_depth: cell.BitDepth | None = None
    alignment: Alignment | None = None
    saturation_level: int | None = None
    channel: Channel | None = None
    cloud_unit: Literal["mm", "cm", "m"] | None = None
    cloud_axes: Annotated[tuple[str, str, str] | None, Parameter(allow_leading_hyphen=True)] = None
    depth_scale: Annotated[float | None, Parameter(metavar="MM")] = None

    @property
    def form(self) -> CaptureForm:
        """The same, for what reads the files."""
        return CaptureForm(
            brightness_source=self.brightness_source or "stripe",
            bit_depth=self.bit_depth or 8,
            alignment=self.alignment or "low",
            saturation_level=self.saturation_level,
            channel=self.channel,
            cloud_unit=self.cloud_unit,
            cloud_axes=self.cloud_axes,
            depth_scale_mm=self.depth_scale,
        )
