"""Grids at a fraction of an image's resolution: clouds and depth of every second or fourth pixel.

Sensors save clouds at half or a quarter of the image's rows and columns. A grid's pixel is either
one of the image's, each ratio-th from pixel 0 on, or the mean of ratio × ratio of them. Which one
it is, the points tell: they lie where the grid's pixels look.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from exposight.errors import SensorError
from exposight.geometry.cameras import PinholeCamera

_LARGEST_RATIO = 16
_SAMPLED = 2000
"""So many points tell where a grid's pixels look."""


def grid_ratio(grid: tuple[int, ...], image: tuple[int, ...]) -> int | None:
    """Return how many pixels of an image a grid's pixel takes along either axis.

    Parameters
    ----------
    grid, image : (rows, columns)
        Their sizes. Of 641 columns every second one is 321, their means are 320.

    Returns
    -------
    int or None
        1 for the image's own grid; None where the grid is no whole fraction of it.
    """
    if len(grid) != 2:
        return None
    for ratio in range(1, _LARGEST_RATIO + 1):
        if all(
            fine // ratio <= coarse <= -(-fine // ratio)
            for coarse, fine in zip(grid, image, strict=True)
        ):
            return ratio if min(grid) > 0 else None
    return None


def averaged_camera(camera: PinholeCamera, ratio: int) -> PinholeCamera:
    """Return the camera of images averaged over ratio × ratio px; what is left over is cut off.

    Raises
    ------
    SensorError
        If the ratio is no whole number from 1 on, or no pixel is left.
    """
    if int(ratio) != ratio or not 1 <= ratio <= min(camera.width, camera.height):
        msg = (
            f"images of {camera.width} × {camera.height} px can be averaged over whole numbers of "
            f"pixels from 1 on, got {ratio}"
        )
        raise SensorError(msg)
    return _coarser(camera, (camera.height // ratio, camera.width // ratio), ratio, (ratio - 1) / 2)


def grid_camera(
    camera: PinholeCamera, grid: tuple[int, int], points: NDArray[np.floating] | None = None
) -> PinholeCamera:
    """Return the camera whose pixels a grid has.

    Parameters
    ----------
    camera : PinholeCamera
        The image's.
    grid : (rows, columns)
        A whole fraction of the image (`grid_ratio`).
    points : (rows, columns, 3) ndarray, mm, optional
        In the camera's frame; NaN where missing. Where they lie tells whether the grid's pixels are
        every so-many-th of the image's or means. Without any, means.

    Raises
    ------
    SensorError
        If the grid is no whole fraction of the image.
    """
    ratio = grid_ratio(grid, (camera.height, camera.width))
    if ratio is None:
        msg = (
            f"a grid of {grid[0]} rows × {grid[1]} columns is no whole fraction of the camera's "
            f"{camera.height} × {camera.width}"
        )
        raise SensorError(msg)
    if ratio == 1:
        return camera
    means = _coarser(camera, grid, ratio, (ratio - 1) / 2)
    single = _coarser(camera, grid, ratio, 0.0)
    if points is None:
        return means
    return min((means, single), key=lambda each: _off_px(each, points))


def _coarser(
    camera: PinholeCamera, grid: tuple[int, int], ratio: int, centre_px: float
) -> PinholeCamera:
    """Return the camera whose pixel i is the image's ratio · i + centre."""
    return replace(
        camera,
        width=grid[1],
        height=grid[0],
        fx=camera.fx / ratio,
        fy=camera.fy / ratio,
        cx=(camera.cx - centre_px) / ratio,
        cy=(camera.cy - centre_px) / ratio,
        skew=camera.skew / ratio,
    )


def _off_px(camera: PinholeCamera, points: NDArray[np.floating]) -> float:
    """Return the median distance of points from their own pixels, in the camera's px."""
    rows, columns = np.nonzero(np.isfinite(points[..., 2]))
    if not rows.size:
        return 0.0
    some = slice(None, None, max(1, rows.size // _SAMPLED))
    pixels = camera.project(points[rows[some], columns[some]])
    off = np.linalg.norm(pixels - np.stack([columns[some], rows[some]], axis=-1), axis=-1)
    off = off[np.isfinite(off)]
    return float(np.median(off)) if off.size else 0.0
