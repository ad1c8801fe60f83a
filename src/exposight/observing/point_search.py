"""A feature's points in a cloud, found quickly and exactly.

Points inside the hollow cylinder (Eq. 4) are counted without touching most of the cloud. Those of
an organised cloud that lie where their pixels look are found by those pixels: only the ones onto
which the cylinder projects need be looked at. All other points are sorted once along their longest
side, so that a cylinder needs only the slice beside it. Together they give the very count that
testing every point would.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import numba
import numpy as np
from numpy.typing import NDArray

from exposight.cell import Cloud
from exposight.compiled import njit
from exposight.geometry import (
    PinholeCamera,
    PixelBox,
    count_points_inside,
    grid_camera,
    grid_ratio,
    ring_pixels,
)
from exposight.observing.masks import FeatureView

_NO_SIGMA = np.empty((1, 0), dtype=np.float32)

_LARGE = 200_000
"""Points from which on projecting all of them once costs less than those near each feature."""

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
    camera : PinholeCamera, optional
        Whose pixels they are; the camera of the cloud's own grid, where that is coarser.
    ratio : int
        Of the image's grid to the cloud's.
    sigma : (h, w) ndarray and (n,) ndarray of float32, optional
        Standard deviations of z of both, mm; empty where not known.
    """

    def __init__(
        self,
        by_pixel: NDArray[np.float32] | None,
        by_slice: NDArray[np.float32] | None,
        camera: PinholeCamera | None = None,
        ratio: int = 1,
        sigma: tuple[NDArray[np.float32], NDArray[np.float32]] = (_NO_SIGMA, _NO_SIGMA[0]),
    ) -> None:
        self.by_pixel, self.by_slice, self.camera, self._ratio = by_pixel, by_slice, camera, ratio
        self.sigma_by_pixel, self._sigma_by_slice = sigma
        if by_slice is not None:
            self._axis = int(np.argmax(np.ptp(by_slice, axis=0))) if len(by_slice) else 0
            order = np.argsort(by_slice[:, self._axis], kind="stable")
            self.by_slice = by_slice[order]
            if self._sigma_by_slice.size:
                self._sigma_by_slice = self._sigma_by_slice[order]
            self._coordinate = np.ascontiguousarray(self.by_slice[:, self._axis])

    def count(self, views: Sequence[FeatureView]) -> NDArray[np.int64]:
        """Return the paper's n_points (Eq. 4) of each feature."""
        counts = np.zeros(len(views), dtype=np.int64)
        if self.by_pixel is not None:
            counts += _count(views, self.by_pixel, [view.search_box for view in views])
        if self.by_slice is not None:
            counts += _count(views, self.by_slice, [self._slice(view) for view in views])
        return counts

    def pixels(self, views: Sequence[FeatureView]) -> NDArray[np.int64]:
        """Return the paper's n_max,2D (Eq. 6) of each feature: pixels of the cloud's own grid."""
        if self.camera is None or self._ratio == 1:
            return np.array([view.n_pixels for view in views], dtype=np.int64)
        poses = [view.camera_from_feature for view in views]
        rings = ring_pixels([view.region for view in views], self.camera, poses) if views else ()
        return np.array([rows.size for rows, _ in rings], dtype=np.int64)

    def box(self, view: FeatureView) -> PixelBox:
        """Return a feature's search box in pixels of the cloud's grid."""
        box, ratio = view.search_box, self._ratio
        if ratio == 1 or self.camera is None:
            return box
        return PixelBox(
            top=box.top // ratio,
            bottom=min(-(-box.bottom // ratio), self.camera.height),
            left=box.left // ratio,
            right=min(-(-box.right // ratio), self.camera.width),
        )

    def raster(self, view: FeatureView) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Return the points that the pixels of a feature's search box see, and their sigma.

        Points that lie elsewhere than where their pixels look are projected; of several in a pixel
        one remains.

        Returns
        -------
        (h, w, 3) ndarray of float32, mm
            NaN where there is none.
        (h, w) ndarray of float32, mm
            Empty where not known.
        """
        box, camera = self.box(view), self.camera
        if self.is_large:
            points, sigma = self.whole
            crop = slice(box.top, box.bottom), slice(box.left, box.right)
            return points[crop], sigma[crop] if sigma.size else _NO_SIGMA
        shape = (box.bottom - box.top, box.right - box.left)
        rows, columns = slice(box.top, box.bottom), slice(box.left, box.right)
        points = np.full((*shape, 3), np.nan, dtype=np.float32)
        known = self._sigma_by_slice.size or self.sigma_by_pixel.size
        sigma = np.full(shape, np.nan, dtype=np.float32) if known else _NO_SIGMA
        if self.by_pixel is not None:
            points[:] = self.by_pixel[rows, columns]
            if self.sigma_by_pixel.size:
                sigma[:] = self.sigma_by_pixel[rows, columns]
        if self.by_slice is None or camera is None:
            return points, sigma
        part = self._slice(view)
        near = self.by_slice[part.left : part.right]
        with np.errstate(invalid="ignore"):
            pixels = np.rint(camera.project(near)) - (box.left, box.top)
            inside = ((pixels >= 0) & (pixels < shape[::-1])).all(axis=1)
        u, v = pixels[inside].astype(np.int64).T
        points[v, u] = near[inside]
        if self._sigma_by_slice.size:
            sigma[v, u] = self._sigma_by_slice[part.left : part.right][inside]
        return points, sigma

    @property
    def is_large(self) -> bool:
        """True where points are put on the camera's pixels once, and not for each feature."""
        return self.by_slice is not None and len(self.by_slice) > _LARGE and self.camera is not None

    @cached_property
    def whole(self) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """The points that all pixels see, (h, w, 3) in mm, and their sigma (`raster`)."""
        if self.by_slice is None or self.camera is None:
            return np.asarray(self.by_pixel), self.sigma_by_pixel
        shape = (self.camera.height, self.camera.width)
        points, sigma = np.full((*shape, 3), np.nan, dtype=np.float32), _NO_SIGMA
        if self.by_pixel is not None:
            points[:] = self.by_pixel
        if self._sigma_by_slice.size or self.sigma_by_pixel.size:
            sigma = np.full(shape, np.nan, dtype=np.float32)
            if self.sigma_by_pixel.size:
                sigma[:] = self.sigma_by_pixel
        ahead = self.by_slice[:, 2] > 0
        near = self.by_slice[ahead]
        pixels = self.camera.project(near)
        inside = self.camera.in_frame(pixels)
        u, v = np.rint(pixels[inside]).astype(np.int64).T
        points[v, u] = near[inside]
        if self._sigma_by_slice.size:
            sigma[v, u] = self._sigma_by_slice[ahead][inside]
        return points, sigma

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
        The camera whose pixels an organised cloud has, or a whole fraction of them (`grid_ratio`).
    """
    sigma = _NO_SIGMA if cloud.sigma_z_mm is None else cloud.sigma_z_mm
    listed = (_NO_SIGMA, sigma[cloud.valid] if sigma.size else _NO_SIGMA[0])
    ratio = grid_ratio(cloud.valid.shape, (camera.height, camera.width))
    if ratio is None:
        return PointSearch(None, cloud.valid_points, camera, sigma=listed)
    if ratio > 1:
        rows, columns = cloud.valid.shape
        grid = grid_camera(camera, (rows, columns), cloud.points)
        return PointSearch(None, cloud.valid_points, grid, ratio, listed)
    allowed_x, allowed_y = _STRAY_PX / camera.fx, _STRAY_PX / camera.fy
    stray, n_stray = _find_strays(cloud.points, camera.rays(), allowed_x, allowed_y)
    if n_stray == 0:
        return PointSearch(cloud.points, None, camera, sigma=(sigma, _NO_SIGMA[0]))
    if n_stray == cloud.n_valid:
        return PointSearch(None, cloud.valid_points, camera, sigma=listed)
    following = cloud.points.copy()
    following[stray] = np.nan
    return PointSearch(
        following,
        cloud.points[stray],
        camera,
        sigma=(sigma, sigma[stray] if sigma.size else sigma[0]),
    )


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
