"""Hollow cylinders about features: which points are inside, which pixels their ring covers.

Eq. 4 of the paper counts the points inside a hollow cylinder about a hole; Eqs. 6 and 7 count the
pixels of its projection at the feature's plane. Slots and pockets need the same with another
outline, so the cylinder's axis may be widened to a *core* rectangle: a point's radius is then its
distance to that rectangle. A point core gives the circular ring of a hole, a segment the stadium of
a slot, a rectangle the rounded frame of a pocket.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numba
import numpy as np

from exposight.errors import CloudError, FeatureError
from exposight.geometry.poses import check_points

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from exposight.geometry.cameras import PinholeCamera
    from exposight.geometry.poses import RigidTransform

_ARC_POINTS = 32  # of an outline, on each of its four arcs and four straight sides


def _outline_weights() -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return what the outline's (n, 2) points take of the outer radius and of the core.

    A polygon through a circle cuts it short between its corners, so the corners lie outside, half
    a step off the axes; then the sides from one arc to the next touch the border.
    """
    step = np.pi / 2 / _ARC_POINTS
    angle = (np.arange(4 * _ARC_POINTS) + 0.5) * step
    corners = np.stack([np.cos(angle), np.sin(angle)], axis=1) / np.cos(step / 2)
    both = np.concatenate([corners, np.sign(corners)], axis=1).reshape(4, _ARC_POINTS, 4)
    sides = np.linspace(both[:, -1], np.roll(both[:, 0], -1, axis=0), _ARC_POINTS + 2, axis=1)
    weights = np.concatenate([both, sides[:, 1:-1]], axis=1).reshape(-1, 4)
    return weights[:, :2].copy(), weights[:, 2:].copy()


_OUTLINE_ROUND, _OUTLINE_CORE = _outline_weights()


@dataclass(frozen=True, kw_only=True)
class HollowCylinder:
    """The region about a feature whose points are counted, in the feature's frame.

    Parameters
    ----------
    inner_mm, outer_mm : float, mm
        Radii of the ring, both measured from the core; inner 0 gives a full cylinder.
    height_mm : float, mm
        Extent along the feature's z axis, half of it on either side of the ring's plane.
    core_half_size_mm : (float, float), mm
        Half extents of the core along the feature's x and y axes; (0, 0) for a circular ring.
    plane_z_mm : float, mm
        Where along the feature's z axis the ring's plane lies; 0 for everything flat.

    Raises
    ------
    FeatureError
        If a size is not finite, a radius or height is not positive, or inner ≥ outer.
    """

    inner_mm: float
    outer_mm: float
    height_mm: float
    core_half_size_mm: tuple[float, float] = (0.0, 0.0)
    plane_z_mm: float = 0.0

    def __post_init__(self) -> None:
        numbers = (
            self.inner_mm,
            self.outer_mm,
            self.height_mm,
            *self.core_half_size_mm,
            self.plane_z_mm,
        )
        if not np.isfinite(numbers).all():
            msg = f"the sizes of a hollow cylinder must be finite, got {numbers} mm"
            raise FeatureError(msg)
        if not 0 <= self.inner_mm < self.outer_mm or self.height_mm <= 0:
            msg = (
                "a hollow cylinder needs 0 ≤ inner < outer and a height above 0, got inner "
                f"{self.inner_mm:g}, outer {self.outer_mm:g}, height {self.height_mm:g} mm"
            )
            raise FeatureError(msg)
        if min(self.core_half_size_mm) < 0:
            msg = f"a core's half size must not be negative, got {self.core_half_size_mm} mm"
            raise FeatureError(msg)

    @property
    def bounding_radius_mm(self) -> float:
        """Radius of a sphere about the feature's origin that holds the whole cylinder."""
        across = self.outer_mm + float(np.hypot(*self.core_half_size_mm))
        along = abs(self.plane_z_mm) + self.height_mm / 2
        return float(np.hypot(across, along))

    def contains(self, points: ArrayLike) -> NDArray[np.bool_]:
        """Tell which points lie inside (Eq. 4), borders included.

        Parameters
        ----------
        points : (..., 3) array_like, mm
            Points in the feature's frame; missing ones (NaN) are outside.

        Returns
        -------
        (...) ndarray of bool

        Raises
        ------
        CloudError
            If the points are not (..., 3).
        """
        xyz = check_points(points)
        across_x = np.maximum(np.abs(xyz[..., 0]) - self.core_half_size_mm[0], 0.0)
        across_y = np.maximum(np.abs(xyz[..., 1]) - self.core_half_size_mm[1], 0.0)
        radius = np.hypot(across_x, across_y)
        along = np.abs(xyz[..., 2] - self.plane_z_mm)
        inside = (
            (radius >= self.inner_mm) & (radius <= self.outer_mm) & (along <= self.height_mm / 2)
        )
        return np.asarray(inside)

    def outline(self, z_mm: float | None = None) -> NDArray[np.float64]:
        """Return a polygon in the feature's frame that circumscribes the outer border.

        Straight sides carry points as well, as a lens bends them.

        Parameters
        ----------
        z_mm : float, mm, optional
            Where along z the polygon lies; default is the ring's plane.

        Returns
        -------
        (n, 3) ndarray, mm
        """
        xyz = np.empty((len(_OUTLINE_ROUND), 3))
        xyz[:, :2] = self.outer_mm * _OUTLINE_ROUND + self.core_half_size_mm * _OUTLINE_CORE
        xyz[:, 2] = self.plane_z_mm if z_mm is None else z_mm
        return xyz


@dataclass(frozen=True, kw_only=True)
class PixelBox:
    """A rectangle of pixels: rows [top, bottom) and columns [left, right)."""

    top: int
    bottom: int
    left: int
    right: int

    @property
    def empty(self) -> bool:
        """True where no pixel is left."""
        return self.top >= self.bottom or self.left >= self.right


def pixel_box(pixels: NDArray[np.float64], camera: PinholeCamera, margin_px: int) -> PixelBox:
    """Return the pixels of a frame that hold all given positions, and a margin.

    Parameters
    ----------
    pixels : (n, 2) ndarray, px
        u and v, at least one, none NaN.
    camera : PinholeCamera
        Gives the frame, to which the box is cut.
    margin_px : int
        Added on every side.
    """
    size = (camera.width, camera.height)
    # Cut before the conversion: positions can exceed every integer.
    lowest = np.clip(np.floor(pixels.min(axis=0)) - margin_px, 0, size)
    highest = np.clip(np.ceil(pixels.max(axis=0)) + margin_px + 1, 0, size)
    return PixelBox(
        top=int(lowest[1]), bottom=int(highest[1]), left=int(lowest[0]), right=int(highest[0])
    )


def ring_pixels(
    cylinder: HollowCylinder, camera: PinholeCamera, camera_from_feature: RigidTransform
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the pixels that a hollow cylinder's ring covers (Eqs. 6 and 7).

    A pixel counts when the ray through its centre, bent by the lens, meets the ring's plane inside
    the ring. Nothing is rasterised: polygon filling counts the border and makes small rings up to a
    fifth too large. Of a ring that is partly behind the camera or out of the frame, the pixels that
    see the rest are returned; none, where nothing is left.

    Parameters
    ----------
    cylinder : HollowCylinder
        The region, in the feature's frame.
    camera : PinholeCamera
        The camera whose pixels are counted.
    camera_from_feature : RigidTransform
        Where the feature is.

    Returns
    -------
    rows, columns : (n,) ndarray of int
        In row-major order.
    """
    box = _search_box(camera_from_feature.apply(cylinder.outline()), camera)
    if box.empty:
        nothing = np.zeros(0, dtype=np.int64)
        return nothing, nothing
    rows, columns = _ring_pixels_in_box(
        camera.rays(),
        camera_from_feature.rotation,
        camera_from_feature.translation_mm,
        _sizes(cylinder),
        (box.top, box.bottom, box.left, box.right),
    )
    return rows, columns


def _search_box(outline: NDArray[np.float64], camera: PinholeCamera) -> PixelBox:
    """Return a box of pixels outside which no ray meets the region within an outline."""
    if outline[:, 2].max() <= 0:
        return PixelBox(top=0, bottom=0, left=0, right=0)
    corners = camera.project(outline)
    if np.isfinite(corners).all():
        return pixel_box(corners, camera, margin_px=1)
    # Part of it cannot be projected, so the corners do not bound the rest: search everywhere.
    return PixelBox(top=0, bottom=camera.height, left=0, right=camera.width)


def count_points_inside(
    cylinder: HollowCylinder, points: NDArray[np.float32], camera_from_feature: RigidTransform
) -> int:
    """Count the points inside a hollow cylinder (Eq. 4), compiled.

    Parameters
    ----------
    cylinder : HollowCylinder
        The region, in the feature's frame.
    points : (rows, columns, 3) or (n, 3) ndarray of float32, mm
        Points in the camera frame; missing ones (NaN) do not count.
    camera_from_feature : RigidTransform
        Where the feature is.

    Raises
    ------
    CloudError
        If the points are neither (rows, columns, 3) nor (n, 3).
    """
    if points.ndim not in {2, 3} or points.shape[-1] != 3:
        msg = f"points must be (rows, columns, 3) or (n, 3), got shape {points.shape}"
        raise CloudError(msg)
    organised = points if points.ndim == 3 else points[None]
    count = _count_inside(
        organised,
        camera_from_feature.rotation,
        camera_from_feature.translation_mm,
        _sizes(cylinder),
    )
    return int(count)


def _sizes(cylinder: HollowCylinder) -> NDArray[np.float64]:
    return np.array(
        [
            cylinder.inner_mm,
            cylinder.outer_mm,
            cylinder.height_mm / 2,
            *cylinder.core_half_size_mm,
            cylinder.plane_z_mm,
        ]
    )


@numba.njit(inline="always")
def _squared_radius(x: float, y: float, half_x: float, half_y: float) -> float:
    across_x = abs(x) - half_x
    across_y = abs(y) - half_y
    across_x = across_x if across_x > 0.0 else 0.0
    across_y = across_y if across_y > 0.0 else 0.0
    return across_x * across_x + across_y * across_y


# Both loops below are written without branches, so that the compiler can do several pixels in one
# instruction; whether a pixel counts is decided by comparisons that a NaN fails.


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _ring_pixels_in_box(
    rays: NDArray[np.float64],
    rotation: NDArray[np.float64],
    origin: NDArray[np.float64],
    sizes: NDArray[np.float64],
    box: tuple[int, int, int, int],
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    inner2, outer2, half_x, half_y = sizes[0] * sizes[0], sizes[1] * sizes[1], sizes[3], sizes[4]
    top, bottom, left, right = box
    xx, xy, xz = rotation[0, 0], rotation[1, 0], rotation[2, 0]
    yx, yy, yz = rotation[0, 1], rotation[1, 1], rotation[2, 1]
    zx, zy, zz = rotation[0, 2], rotation[1, 2], rotation[2, 2]
    ox, oy, oz = origin[0], origin[1], origin[2]
    plane = zx * ox + zy * oy + zz * oz + sizes[5]
    origin_x = xx * ox + xy * oy + xz * oz
    origin_y = yx * ox + yy * oy + yz * oz
    inside = np.empty((bottom - top, right - left), dtype=np.bool_)
    for v in range(bottom - top):
        row = rays[top + v, left:right]
        for u in range(right - left):
            ray_x, ray_y = row[u, 0], row[u, 1]
            depth = plane / (zx * ray_x + zy * ray_y + zz)
            x = depth * (xx * ray_x + xy * ray_y + xz) - origin_x
            y = depth * (yx * ray_x + yy * ray_y + yz) - origin_y
            radius2 = _squared_radius(x, y, half_x, half_y)
            inside[v, u] = (depth > 0.0) & (radius2 >= inner2) & (radius2 <= outer2)
    n = int(np.sum(inside))
    rows = np.empty(n, dtype=np.int64)
    columns = np.empty(n, dtype=np.int64)
    i = 0
    for v in range(bottom - top):
        for u in range(right - left):
            if inside[v, u]:
                rows[i] = v + top
                columns[i] = u + left
                i += 1
    return rows, columns


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _count_inside(
    points: NDArray[np.float32],
    rotation: NDArray[np.float64],
    origin: NDArray[np.float64],
    sizes: NDArray[np.float64],
) -> int:
    inner2, outer2, half_x, half_y = sizes[0] * sizes[0], sizes[1] * sizes[1], sizes[3], sizes[4]
    half_height, plane_z = sizes[2], sizes[5]
    r00, r10, r20 = rotation[0, 0], rotation[1, 0], rotation[2, 0]
    r01, r11, r21 = rotation[0, 1], rotation[1, 1], rotation[2, 1]
    r02, r12, r22 = rotation[0, 2], rotation[1, 2], rotation[2, 2]
    ox, oy, oz = origin[0], origin[1], origin[2]
    count = 0
    for i in range(points.shape[0]):
        row = points[i]
        for j in range(points.shape[1]):
            dx = row[j, 0] - ox
            dy = row[j, 1] - oy
            dz = row[j, 2] - oz
            x = r00 * dx + r10 * dy + r20 * dz
            y = r01 * dx + r11 * dy + r21 * dz
            along = abs(r02 * dx + r12 * dy + r22 * dz - plane_z)
            radius2 = _squared_radius(x, y, half_x, half_y)
            count += (along <= half_height) & (radius2 >= inner2) & (radius2 <= outer2)
    return count
