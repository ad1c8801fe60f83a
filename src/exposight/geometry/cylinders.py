"""Hollow cylinders about features: which pixels their rings cover, which points they hold.

Eq. 4 of the paper counts the points inside a hollow cylinder about a hole; Eqs. 6 and 7 count the
pixels of its projection at the feature's plane. Slots and pockets need the same with another
outline, so the cylinder's axis may be widened to a *core* rectangle: a point's radius is then its
distance to that rectangle. A point core gives the circular ring of a hole, a segment the stadium of
a slot, a rectangle the rounded frame of a pocket.

A part has hundreds of features and an image millions of pixels, so the counting is compiled and
shared between the cores, feature by feature; each looks only at the pixels onto which it projects.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numba
import numpy as np
from numpy.typing import NDArray

from exposight.compiled import njit
from exposight.errors import CloudError, FeatureError
from exposight.geometry.cameras import PinholeCamera
from exposight.geometry.poses import RigidTransform, StackedPoses

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

    @cached_property
    def ring_outline(self) -> NDArray[np.float64]:
        """The `outline` of the ring's plane, computed once."""
        outline = self.outline()
        outline.setflags(write=False)
        return outline

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


_RING_MARGIN_PX = 1


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


def pixel_boxes(
    outlines: NDArray[np.float64], camera: PinholeCamera, margin_px: int
) -> list[PixelBox]:
    """Return boxes of pixels outside which no ray meets what lies within given outlines.

    Parameters
    ----------
    outlines : (n, m, 3) ndarray, mm
        n outlines of m points in the camera's frame.
    camera : PinholeCamera
        Gives the frame, to which the boxes are cut.
    margin_px : int
        Added on every side.
    """
    pixels = camera.project(outlines)
    projects = np.asarray(np.isfinite(pixels).all(axis=(1, 2)))
    behind = outlines[:, :, 2].max(axis=1) <= 0
    # What cannot be projected in part is not bounded by the rest: search the whole frame for it.
    size = np.array([camera.width, camera.height])
    low = np.where(projects[:, None], np.floor(pixels.min(axis=1)) - margin_px, 0)
    high = np.where(projects[:, None], np.ceil(pixels.max(axis=1)) + margin_px + 1, size)
    high[behind] = 0
    # Cut before the conversion: positions can exceed every integer.
    edges = np.clip(np.concatenate([low, high], axis=1), 0, np.tile(size, 2)).astype(np.int64)
    return [
        PixelBox(top=top, bottom=bottom, left=left, right=right)
        for left, top, right, bottom in edges.tolist()
    ]


def outlines_in_camera(
    cylinders: Sequence[HollowCylinder],
    poses: StackedPoses,
    end: float = 0.0,
) -> NDArray[np.float64]:
    """Return the outlines of n hollow cylinders in the camera's frame, (n, m, 3) mm.

    Poses are ``camera_from_feature``; the end is −1 or 1 for the cylinders' ends, 0 for the ring's
    plane.
    """
    if end:
        outlines = [c.outline(c.plane_z_mm + end * c.height_mm / 2) for c in cylinders]
    else:
        outlines = [c.ring_outline for c in cylinders]
    turned = np.stack(outlines) @ poses.rotations.transpose(0, 2, 1)
    return np.asarray(turned + poses.translations_mm[:, None, :])


def ring_pixels(
    cylinders: Sequence[HollowCylinder], camera: PinholeCamera, poses: Sequence[RigidTransform]
) -> list[tuple[NDArray[np.int64], NDArray[np.int64]]]:
    """Return the pixels that the rings of hollow cylinders cover (Eqs. 6 and 7).

    A pixel counts when the ray through its centre, bent by the lens, meets the ring's plane inside
    the ring. Nothing is rasterised: polygon filling counts the border and makes small rings up to a
    fifth too large. Of a ring that is partly behind the camera or out of the frame, the pixels that
    see the rest are returned; none, where nothing is left.

    Parameters
    ----------
    cylinders : sequence of n HollowCylinder
        The regions, in their features' frames.
    camera : PinholeCamera
        The camera whose pixels are counted.
    poses : sequence of n RigidTransform
        ``camera_from_feature`` of each.

    Returns
    -------
    list of n (rows, columns)
        Each (m,) ndarray of int, in row-major order.
    """
    if not cylinders:
        return []
    boxes = pixel_boxes(
        outlines_in_camera(cylinders, StackedPoses.of(poses)), camera, _RING_MARGIN_PX
    )
    rays, regions, edges = camera.rays(), packed_cylinders(cylinders, poses), packed_boxes(boxes)
    ends = np.cumsum(_count_ring_pixels(rays, regions, edges))
    starts = np.concatenate([[0], ends[:-1]])
    rows = np.empty(int(ends[-1]), dtype=np.int64)
    columns = np.empty_like(rows)
    _fill_ring_pixels(rays, regions, edges, starts, rows, columns)
    spans = zip(starts.tolist(), ends.tolist(), strict=True)
    return [(rows[start:end], columns[start:end]) for start, end in spans]


def count_points_inside(
    cylinders: Sequence[HollowCylinder],
    points: NDArray[np.float32],
    poses: Sequence[RigidTransform],
    boxes: Sequence[PixelBox] | None = None,
) -> NDArray[np.int64]:
    """Count the points inside hollow cylinders (Eq. 4).

    Parameters
    ----------
    cylinders : sequence of n HollowCylinder
        The regions, in their features' frames.
    points : (rows, columns, 3) or (m, 3) ndarray of float32, mm
        Points in the camera frame; missing ones (NaN) do not count.
    poses : sequence of n RigidTransform
        ``camera_from_feature`` of each.
    boxes : sequence of n PixelBox, optional
        Which rows and columns of the points to look at, for each; all by default. Points in an
        (m, 3) array are the columns of row 0.

    Returns
    -------
    (n,) ndarray of int

    Raises
    ------
    CloudError
        If the points are neither (rows, columns, 3) nor (m, 3).
    """
    if points.ndim not in {2, 3} or points.shape[-1] != 3:
        msg = f"points must be (rows, columns, 3) or (n, 3), got shape {points.shape}"
        raise CloudError(msg)
    organised = np.ascontiguousarray(points if points.ndim == 3 else points[None])
    if not cylinders:
        return np.zeros(0, dtype=np.int64)
    if boxes is None:
        whole = PixelBox(top=0, bottom=organised.shape[0], left=0, right=organised.shape[1])
        boxes = [whole] * len(cylinders)
    counts = _count_points(organised, packed_cylinders(cylinders, poses), packed_boxes(boxes))
    return np.asarray(counts)


def packed_cylinders(
    cylinders: Sequence[HollowCylinder], poses: Sequence[RigidTransform]
) -> NDArray[np.float64]:
    """Pack n cylinders and poses into (n, 18) numbers for compiled loops.

    Parameters
    ----------
    cylinders : sequence of n HollowCylinder
        In their features' frames.
    poses : sequence of n RigidTransform
        ``camera_from_feature`` of each.

    Returns
    -------
    (n, 18) ndarray
        The feature's x, y and z axes and its origin in the camera's frame, squares of inner and
        outer radius, half sizes of the core, z of the ring's plane, half the height; mm.
    """
    packed = np.empty((len(cylinders), 18))
    for row, cylinder, pose in zip(packed, cylinders, poses, strict=True):
        row[0:9] = pose.rotation.T.reshape(-1)  # x, y and z axis, one after the other
        row[9:12] = pose.translation_mm
        row[12] = cylinder.inner_mm**2
        row[13] = cylinder.outer_mm**2
        row[14:16] = cylinder.core_half_size_mm
        row[16] = cylinder.plane_z_mm
        row[17] = cylinder.height_mm / 2
    return packed


def packed_boxes(boxes: Sequence[PixelBox]) -> NDArray[np.int64]:
    """Return (n, 4): top, bottom, left and right of each box, for compiled loops."""
    return np.array([(box.top, box.bottom, box.left, box.right) for box in boxes], dtype=np.int64)


# The loops below have no branch and no division in them, so that the compiler can do several pixels
# in one instruction. Whether one counts is decided by comparisons, all of which a NaN fails.


@njit(inline="always")
def _squared_radius(x: float, y: float, half_x: float, half_y: float) -> float:
    across_x = abs(x) - half_x
    across_y = abs(y) - half_y
    across_x = across_x if across_x > 0.0 else 0.0
    across_y = across_y if across_y > 0.0 else 0.0
    return across_x * across_x + across_y * across_y


@njit()
def _ring_row(
    ray: NDArray[np.float64], region: NDArray[np.float64], inside: NDArray[np.bool_]
) -> int:
    """Mark which rays of a row meet the ring, and count them.

    A ray d meets the plane z = z₀ of the feature at depth s = (z·o + z₀) / (z·d), o the feature's
    origin. Everything is multiplied by z·d instead of divided by it.
    """
    xx, xy, xz = region[0], region[1], region[2]
    yx, yy, yz = region[3], region[4], region[5]
    zx, zy, zz = region[6], region[7], region[8]
    ox, oy, oz = region[9], region[10], region[11]
    inner2, outer2, half_x, half_y = region[12], region[13], region[14], region[15]
    distance = zx * ox + zy * oy + zz * oz + region[16]
    origin_x = xx * ox + xy * oy + xz * oz
    origin_y = yx * ox + yy * oy + yz * oz
    count = 0
    for u in range(ray.shape[0]):
        dx, dy = ray[u, 0], ray[u, 1]
        slope = zx * dx + zy * dy + zz
        x = distance * (xx * dx + xy * dy + xz) - origin_x * slope
        y = distance * (yx * dx + yy * dy + yz) - origin_y * slope
        scale = abs(slope)
        radius2 = _squared_radius(x, y, half_x * scale, half_y * scale)
        hit = (
            (distance * slope > 0.0)
            & (radius2 >= inner2 * scale * scale)
            & (radius2 <= outer2 * scale * scale)
        )
        inside[u] = hit
        count += hit
    return count


@njit(parallel=True)
def _count_ring_pixels(
    rays: NDArray[np.float64], regions: NDArray[np.float64], edges: NDArray[np.int64]
) -> NDArray[np.int64]:
    counts = np.zeros(len(regions), dtype=np.int64)
    for i in numba.prange(len(regions)):
        top, bottom, left, right = edges[i]
        inside = np.empty(max(right - left, 0), dtype=np.bool_)
        count = 0
        for v in range(top, bottom):
            count += _ring_row(rays[v, left:right], regions[i], inside)
        counts[i] = count
    return counts


@njit(parallel=True)
def _fill_ring_pixels(
    rays: NDArray[np.float64],
    regions: NDArray[np.float64],
    edges: NDArray[np.int64],
    starts: NDArray[np.int64],
    rows: NDArray[np.int64],
    columns: NDArray[np.int64],
) -> None:
    for i in numba.prange(len(regions)):
        top, bottom, left, right = edges[i]
        inside = np.empty(max(right - left, 0), dtype=np.bool_)
        n = starts[i]
        for v in range(top, bottom):
            if _ring_row(rays[v, left:right], regions[i], inside) == 0:
                continue
            for u in range(right - left):
                if inside[u]:
                    rows[n] = v
                    columns[n] = left + u
                    n += 1


@njit()
def _points_in_row(points: NDArray[np.float32], region: NDArray[np.float64]) -> int:
    xx, xy, xz = region[0], region[1], region[2]
    yx, yy, yz = region[3], region[4], region[5]
    zx, zy, zz = region[6], region[7], region[8]
    ox, oy, oz = region[9], region[10], region[11]
    inner2, outer2, half_x, half_y = region[12], region[13], region[14], region[15]
    plane_z, half_height = region[16], region[17]
    count = 0
    for j in range(points.shape[0]):
        dx = points[j, 0] - ox
        dy = points[j, 1] - oy
        dz = points[j, 2] - oz
        radius2 = _squared_radius(
            xx * dx + xy * dy + xz * dz, yx * dx + yy * dy + yz * dz, half_x, half_y
        )
        along = abs(zx * dx + zy * dy + zz * dz - plane_z)
        count += (along <= half_height) & (radius2 >= inner2) & (radius2 <= outer2)
    return count


@njit(parallel=True)
def _count_points(
    points: NDArray[np.float32], regions: NDArray[np.float64], edges: NDArray[np.int64]
) -> NDArray[np.int64]:
    counts = np.zeros(len(regions), dtype=np.int64)
    for i in numba.prange(len(regions)):
        top, bottom, left, right = edges[i]
        count = 0
        for v in range(top, bottom):
            count += _points_in_row(points[v, left:right], regions[i])
        counts[i] = count
    return counts
