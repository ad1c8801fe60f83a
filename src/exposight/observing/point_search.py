"""Counting a cloud's points inside hollow cylinders (Eq. 4) without touching most of the cloud.

An organised cloud whose points lie where their pixels look needs only the pixels onto which the
cylinder projects. Any other cloud is sorted once along its longest side, so that a cylinder needs
only the slice beside it. Both give the very count that testing every point would.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

import numpy as np

from exposight.geometry import PixelBox, count_points_inside

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from exposight.cell import Cloud
    from exposight.geometry import PinholeCamera
    from exposight.observing.masks import FeatureView

_SAMPLES = 4096
_STRAY_PX = 1.0
"""How far a point may lie beside its pixel for the cloud to count as the camera's own."""


class PointSearch(Protocol):
    """Counts the points inside features' hollow cylinders."""

    def count(self, views: Sequence[FeatureView]) -> NDArray[np.int64]:
        """Return the paper's n_points (Eq. 4) of each."""
        ...


def point_search(cloud: Cloud, camera: PinholeCamera) -> PointSearch:
    """Choose the quickest exact way to search a cloud.

    Parameters
    ----------
    cloud : Cloud
        Points in the camera's frame, mm.
    camera : PinholeCamera
        The camera whose pixels an organised cloud has.
    """
    if cloud.organised and _follows_pixels(cloud, camera):
        return _ByPixel(cloud.points)
    return _BySlice(cloud.points[cloud.valid])


def _follows_pixels(cloud: Cloud, camera: PinholeCamera) -> bool:
    """Tell whether an organised cloud's points project back onto their own pixels."""
    if cloud.points.shape[:2] != (camera.height, camera.width):
        return False
    valid = np.flatnonzero(cloud.valid)
    if valid.size == 0:
        return True
    chosen = valid[:: max(1, valid.size // _SAMPLES)]
    rows, columns = np.divmod(chosen, camera.width)
    stray = camera.project(cloud.points[rows, columns]) - np.column_stack([columns, rows])
    return bool((np.abs(stray) <= _STRAY_PX).all())  # NaN, behind the camera, is not


class _ByPixel:
    def __init__(self, points: NDArray[np.float32]) -> None:
        self._points = points

    def count(self, views: Sequence[FeatureView]) -> NDArray[np.int64]:
        return _count(views, self._points, [view.search_box for view in views])


class _BySlice:
    def __init__(self, points: NDArray[np.float32]) -> None:
        self._axis = int(np.argmax(np.ptp(points, axis=0))) if len(points) else 0
        self._points = points[np.argsort(points[:, self._axis], kind="stable")]
        self._coordinate = np.ascontiguousarray(self._points[:, self._axis])

    def count(self, views: Sequence[FeatureView]) -> NDArray[np.int64]:
        return _count(views, self._points, [self._slice(view) for view in views])

    def _slice(self, view: FeatureView) -> PixelBox:
        centre = view.camera_from_feature.translation_mm[self._axis]
        reach = view.region.bounding_radius_mm
        # float32 neighbours of the bounds: searching float32 values must not lose a border point
        low = np.nextafter(np.float32(centre - reach), np.float32(-np.inf))
        high = np.nextafter(np.float32(centre + reach), np.float32(np.inf))
        start = int(np.searchsorted(self._coordinate, low, side="left"))
        stop = int(np.searchsorted(self._coordinate, high, side="right"))
        return PixelBox(top=0, bottom=1, left=start, right=stop)


def _count(
    views: Sequence[FeatureView], points: NDArray[np.float32], boxes: Sequence[PixelBox]
) -> NDArray[np.int64]:
    return count_points_inside(
        [view.region for view in views],
        points,
        [view.camera_from_feature for view in views],
        boxes,
    )
