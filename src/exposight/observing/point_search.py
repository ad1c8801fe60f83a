"""Counting a cloud's points inside hollow cylinders (Eq. 4) without touching most of the cloud.

Points of an organised cloud that lie where their pixels look are found by those pixels: only the
ones onto which the cylinder projects need be looked at. All other points are sorted once along
their longest side, so that a cylinder needs only the slice beside it. Together they give the very
count that testing every point would.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numba
import numpy as np

from exposight.compiled import njit
from exposight.geometry import PixelBox, count_points_inside

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from exposight.cell import Cloud
    from exposight.geometry import PinholeCamera
    from exposight.observing.masks import FeatureView

_STRAY_PX = 1.0
"""How far beside its pixel a point may lie to be found by it; less than a search box's margin."""


class PointSearch:
    """Counts a cloud's points inside features' hollow cylinders; `point_search` makes one.

    Parameters
    ----------
    by_pixel : (h, w, 3) ndarray of float32 or None
        Points that lie where their pixels look; others are NaN.
    by_slice : (n, 3) ndarray of float32 or None
        All other points.
    """

    def __init__(
        self, by_pixel: NDArray[np.float32] | None, by_slice: NDArray[np.float32] | None
    ) -> None:
        self._by_pixel, self._by_slice = by_pixel, by_slice
        if by_slice is not None:
            self._axis = int(np.argmax(np.ptp(by_slice, axis=0))) if len(by_slice) else 0
            self._by_slice = by_slice[np.argsort(by_slice[:, self._axis], kind="stable")]
            self._coordinate = np.ascontiguousarray(self._by_slice[:, self._axis])

    def count(self, views: Sequence[FeatureView]) -> NDArray[np.int64]:
        """Return the paper's n_points (Eq. 4) of each feature."""
        counts = np.zeros(len(views), dtype=np.int64)
        if self._by_pixel is not None:
            counts += _count(views, self._by_pixel, [view.search_box for view in views])
        if self._by_slice is not None:
            counts += _count(views, self._by_slice, [self._slice(view) for view in views])
        return counts

    def _slice(self, view: FeatureView) -> PixelBox:
        centre = view.camera_from_feature.translation_mm[self._axis]
        reach = view.region.bounding_radius_mm
        # float32 neighbours of the bounds: searching float32 values must not lose a border point
        low = np.nextafter(np.float32(centre - reach), np.float32(-np.inf))
        high = np.nextafter(np.float32(centre + reach), np.float32(np.inf))
        start = int(np.searchsorted(self._coordinate, low, side="left"))
        stop = int(np.searchsorted(self._coordinate, high, side="right"))
        return PixelBox(top=0, bottom=1, left=start, right=stop)


def point_search(cloud: Cloud, camera: PinholeCamera) -> PointSearch:
    """Choose the quickest exact way to search a cloud.

    Parameters
    ----------
    cloud : Cloud
        Points in the camera's frame, mm.
    camera : PinholeCamera
        The camera whose pixels an organised cloud has.
    """
    if not cloud.organised or cloud.valid.shape != (camera.height, camera.width):
        return PointSearch(None, cloud.valid_points)
    allowed_x, allowed_y = _STRAY_PX / camera.fx, _STRAY_PX / camera.fy
    stray, n_stray = _find_strays(cloud.points, camera.rays(), allowed_x, allowed_y)
    if n_stray == 0:
        return PointSearch(cloud.points, None)
    if n_stray == cloud.n_valid:
        return PointSearch(None, cloud.valid_points)
    following = cloud.points.copy()
    following[stray] = np.nan
    return PointSearch(following, cloud.points[stray])


@njit(parallel=True)
def _find_strays(
    points: NDArray[np.float32], rays: NDArray[np.float64], allowed_x: float, allowed_y: float
) -> tuple[NDArray[np.bool_], int]:
    """Mark the points that do not lie where their pixels look, and count them."""
    stray = np.empty(points.shape[:2], dtype=np.bool_)
    count = 0
    for v in numba.prange(points.shape[0]):
        row, ray, marks = points[v], rays[v], stray[v]
        in_row = 0
        for u in range(row.shape[0]):
            x, y, z = row[u, 0], row[u, 1], row[u, 2]
            # False behind the camera, and where the lens model gives the pixel no ray
            near = (abs(x - ray[u, 0] * z) <= allowed_x * z) & (
                abs(y - ray[u, 1] * z) <= allowed_y * z
            )
            marks[u] = (z == z) & (not near)  # a missing point is NaN, and strays nowhere
            in_row += marks[u]
        count += in_row
    return stray, count


def _count(
    views: Sequence[FeatureView], points: NDArray[np.float32], boxes: Sequence[PixelBox]
) -> NDArray[np.int64]:
    return count_points_inside(
        [view.region for view in views],
        points,
        [view.camera_from_feature for view in views],
        boxes,
    )
