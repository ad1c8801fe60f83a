"""Depth images: the distance along the camera's axis of every pixel, as most depth cameras save it.

With the camera they are organised clouds. A step of their numbers may be 1 mm, 0.1 mm, 1 m or
anything else, which the files do not say.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from exposight.cell.cloud import Cloud
from exposight.cell.image_files import decoded_image, is_image
from exposight.cell.sensor import ActiveSensor
from exposight.contradictions import settle
from exposight.contradictions.depths import depth_scale, fitting_scales
from exposight.errors import CloudError, FormatError, ImageError
from exposight.files import parsing, read_array, read_bytes
from exposight.geometry import PinholeCamera, grid_camera, grid_ratio

_IMAGE_SUFFIXES = frozenset({".png", ".tif", ".tiff"})
_NPY = b"\x93NUMPY"

DEPTH_SUFFIXES: tuple[str, ...] = (*sorted(_IMAGE_SUFFIXES), ".npy")
"""File suffixes of depth images."""


def is_depth_image(path: Path) -> bool:
    """Tell by content, shape and name whether a file is a depth image and not a cloud.

    An .npy file is one where its array has two dimensions, and not three columns.
    """
    start = b""
    if path.is_file():
        with path.open("rb") as file:
            start = file.read(8)
    if is_image(start):
        return True
    if not start.startswith(_NPY):
        return path.suffix.lower() in _IMAGE_SUFFIXES and not start.startswith(b"ply")
    try:
        with parsing(path, "array"):
            shape = np.load(path, mmap_mode="r", allow_pickle=False).shape
    except FormatError:  # `read_cloud` says what it is
        return False
    return len(shape) == 2 and shape[1] != 3


def read_depth(path: Path) -> NDArray[np.float64]:
    """Read a depth image in the file's own steps.

    Parameters
    ----------
    path : Path
        A PNG of 16 bits, a TIFF of 16 bits or of floating-point numbers, or an .npy array of
        (rows, columns).

    Returns
    -------
    (rows, columns) ndarray of float64
        NaN where the file has 0, which is no depth, or a number that is not finite.

    Raises
    ------
    MissingFileError
        If it is not there.
    FormatError
        If it is no such file; 8 bits are no depth but a picture of it.
    """
    data = read_bytes(path, "depth image")
    if data.startswith(_NPY) or (path.suffix.lower() == ".npy" and not is_image(data)):
        array = read_array(data, path, "depth image")
    elif is_image(data) or path.suffix.lower() in _IMAGE_SUFFIXES:
        try:
            array = decoded_image(data, path)
        except ImageError as error:
            raise FormatError(str(error)) from error
    else:
        msg = (
            f"{path}: depth images are read from {', '.join(DEPTH_SUFFIXES)}, got the suffix "
            f"{path.suffix!r}; convert it without changing its numbers"
        )
        raise FormatError(msg)
    if (
        array.ndim != 2
        or array.size == 0
        or array.dtype.kind not in "uif"
        or array.dtype.itemsize < 2
    ):
        found = f"{array.dtype} of shape {array.shape}"
        msg = (
            f"{path}: expected a depth image of one channel, in 16 bits or floating-point numbers, "
            f"got {found}; pictures of depth, of 8 bits or in colour, hold none"
        )
        raise FormatError(msg)
    depth: NDArray[np.float64] = np.array(array, dtype=np.float64)
    depth[~np.isfinite(depth) | (depth == 0.0)] = np.nan
    return depth


def cloud_from_depth(depth: ArrayLike, camera: PinholeCamera, *, scale_mm: float) -> Cloud:
    """Return the organised cloud of a depth image.

    Parameters
    ----------
    depth : (rows, columns) array_like
        Z along the camera's axis, not the distance from it; 0, NaN and infinity where there is
        none. Of the camera's size, or of a whole fraction of it, whose pixels are then taken for
        means of the image's.
    camera : PinholeCamera
        That the depth is of: a rectified one for depth from stereo.
    scale_mm : float, mm
        Of a step: 1 of depth in mm, 0.1 of tenths, 1000 of metres.

    Raises
    ------
    CloudError
        If the depth is no image of the camera, lies behind it, or the scale is not above 0.
    """
    steps = np.asarray(depth, dtype=np.float64)
    if steps.ndim != 2 or grid_ratio(steps.shape, (camera.height, camera.width)) is None:
        msg = (
            f"depth must be (rows, columns) of the camera's {camera.height} × {camera.width} px, "
            f"or half, a third, … of both, got shape {steps.shape}"
        )
        raise CloudError(msg)
    if not 0.0 < scale_mm < np.inf:
        msg = f"the scale of depth must be above 0 mm a step, got {scale_mm:g}"
        raise CloudError(msg)
    rows, columns = steps.shape
    z = np.where(np.isfinite(steps) & (steps != 0.0), steps * scale_mm, np.nan)
    if (z < 0.0).any():
        msg = "depth below 0 lies behind the camera; expected Z along its axis, forward"
        raise CloudError(msg)
    rays = grid_camera(camera, (rows, columns)).rays()
    return Cloud(points=np.concatenate([rays * z[..., None], z[..., None]], axis=-1))


def read_depth_cloud(path: Path, sensor: ActiveSensor, *, scale_mm: float | None = None) -> Cloud:
    """Read a depth image and return the cloud of a sensor's first camera.

    Parameters
    ----------
    path : Path
        As `read_depth`.
    sensor : ActiveSensor
        Its first camera gives the rays, its working distance what depths can be.
    scale_mm : float, mm
        Of a step. The files do not say it; without it the error says which would fit.

    Raises
    ------
    MissingFileError, FormatError
        As `read_depth`.
    CloudError
        As `cloud_from_depth`, or if the scale is not given.
    ContradictionError
        If at this scale no depth lies within the sensor's working distance.
    """
    depth = read_depth(path)
    known = depth[np.isfinite(depth)]
    if scale_mm is None:
        fitting = " or ".join(
            f"{each:g}" for each in fitting_scales(known, sensor.working_distance_mm)
        )
        near_mm, far_mm = sensor.working_distance_mm
        hint = (
            f"{fitting} would put it within the sensor's working distance of {near_mm:g} to "
            f"{far_mm:g} mm"
            if fitting
            else "1 is usual"
        )
        msg = (
            f"{path}: how many mm a step of the depth is, the file does not say; give "
            f"--depth-scale (in Python scale_mm): {hint}"
        )
        raise CloudError(msg)
    try:
        cloud = cloud_from_depth(depth, sensor.camera, scale_mm=scale_mm)
    except CloudError as error:
        msg = f"{path}: {error}"
        raise CloudError(msg) from error
    settle([depth_scale(known, scale_mm, sensor.working_distance_mm)])
    return cloud
