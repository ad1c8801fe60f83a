"""A camera from its data sheet: resolution and field of view, or focal length and pixel size."""

import numpy as np

from exposight.errors import SensorError
from exposight.geometry.cameras import PinholeCamera

_SQUARE = 0.1
"""Pixels are square: focal lengths of width and height differ by less, unless a figure is wrong."""


def uncalibrated_camera(
    resolution: tuple[int, int],
    *,
    field_of_view_mm: tuple[float, float] | None = None,
    distance_mm: float | None = None,
    field_of_view_deg: tuple[float, float] | None = None,
    focal_length_mm: float | None = None,
    pixel_size_um: float | None = None,
) -> PinholeCamera:
    """Return a pinhole camera without distortion whose principal point is the image's middle.

    Good for finding features in images and planning exposures, not for triangulating.

    Parameters
    ----------
    resolution : (int, int), px
        Width and height.
    field_of_view_mm, distance_mm : (float, float) and float, mm
        Width and height of what the image shows at a distance: f = width in px · distance / width.
    field_of_view_deg : (float, float), degrees
        Horizontal and vertical angle.
    focal_length_mm, pixel_size_um : float, mm and µm

    Raises
    ------
    SensorError
        If a number is not positive, none of the three ways is given, or pixels would not be square.
    """
    width, height = resolution
    lengths = (*(field_of_view_mm or ()), distance_mm, focal_length_mm, pixel_size_um)
    if min(width, height, *(each for each in lengths if each is not None)) <= 0:
        msg = "resolution, field of view, distance, focal length and pixel size must be positive"
        raise SensorError(msg)
    if field_of_view_mm is not None and distance_mm is not None:
        fx, fy = (
            width * distance_mm / field_of_view_mm[0],
            height * distance_mm / field_of_view_mm[1],
        )
    elif field_of_view_deg is not None:
        if not all(0 < angle < 175 for angle in field_of_view_deg):
            msg = f"a field of view must be 0 to 175 degrees, got {field_of_view_deg}"
            raise SensorError(msg)
        half = np.tan(np.radians(field_of_view_deg) / 2)
        fx, fy = width / 2 / half[0], height / 2 / half[1]
    elif focal_length_mm is not None and pixel_size_um is not None:
        fx = fy = 1000.0 * focal_length_mm / pixel_size_um
    else:
        msg = "a camera needs a field of view in mm with its distance, or in degrees, or a focal "
        msg += "length and a pixel size"
        raise SensorError(msg)
    if abs(fx / fy - 1) > _SQUARE:
        msg = (
            f"{width} × {height} px over this field of view makes focal lengths of {fx:.0f} and "
            f"{fy:.0f} px, and pixels are square: check width and height, which may be exchanged, "
            "and that both are of the whole image"
        )
        raise SensorError(msg)
    return PinholeCamera(
        width=width, height=height, fx=fx, fy=fy, cx=(width - 1) / 2, cy=(height - 1) / 2
    )
