"""Circles, slots and rounded rectangles fitted to the outlines of holes.

Corners of a triangulated outline lie on the true curve, the chords between them inside it: fits go
to the corners, so that a coarse tessellation has the same radius as a fine one.
"""

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

Outline = Literal["circle", "slot", "rectangle"]

LEAST_CORNERS = 8
"""A circle has at least so many; a hexagon socket is none."""

_MOST_APART_DEG = 60.0
"""Corners of a circle are nowhere further apart, seen from its centre."""

_LONGER = 1.02
"""A slot's length over its width, at least."""

_STRAIGHT_SHARE = 0.02
"""A corner at which a loop turns by less than this share of what others turn is none."""

_CHORD_SHARE = 0.05
"""Chords leave an outline by no more than this share of its width, as an octagon's do."""

_RMS_MM, _RMS_SHARE = 0.015, 0.012
"""Corners leave an outline by no more than this, or this share of its half width (RMS)."""


@dataclass(frozen=True, kw_only=True)
class RimShape:
    """An outline in its plane.

    Parameters
    ----------
    outline : {'circle', 'slot', 'rectangle'}
    centre_mm : (float, float)
    direction_rad : float
        Of its length, from the first axis towards the second; 0 for a circle.
    length_mm, width_mm : float
        Overall; both the diameter for a circle.
    radius_mm : float
        Of a circle, a slot's ends, a rectangle's corners.
    rms_mm, worst_mm : float
        By how much its points leave it.
    """

    outline: Outline
    centre_mm: tuple[float, float]
    direction_rad: float
    length_mm: float
    width_mm: float
    radius_mm: float
    rms_mm: float
    worst_mm: float

    def beyond_mm(self, points_mm: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return how far points (n, 2) lie outside the outline; negative inside."""
        half = (self.length_mm / 2 - self.radius_mm, self.width_mm / 2 - self.radius_mm)
        return _beyond(points_mm, (*self.centre_mm, self.direction_rad, *half, self.radius_mm))


def fit_rim(points_mm: NDArray[np.float64], segments: NDArray[np.int64]) -> RimShape | None:
    """Return the outline that points lie on; None where it is none of those known.

    Parameters
    ----------
    points_mm : (n, 2) ndarray
        Corners, each once.
    segments : (k, 2) ndarray of int
        The points that edges join, for the direction of straight sides.
    """
    if len(points_mm) < 4:
        return None
    points_mm, segments = _without_flat_corners(points_mm, segments)
    circle = _circle(points_mm)
    if circle is not None and circle.rms_mm <= 0.002 * circle.radius_mm:
        return circle
    long = _elongated(points_mm, segments)
    middles = points_mm[segments].mean(axis=1)
    fits = [shape for shape in (circle, *long) if shape is not None and _good(shape, middles)]
    if not fits:
        return None
    best = min(fits, key=lambda shape: shape.rms_mm)
    for simpler in fits:  # in the order of their number of sizes
        if simpler.rms_mm <= max(2.0 * best.rms_mm, 1e-4 * simpler.width_mm):
            return simpler
    return best


def _without_flat_corners(
    points: NDArray[np.float64], segments: NDArray[np.int64]
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Leave out corners at which a loop goes straight on: they lie on a chord, not on the curve.

    A mesh whose triangles were cut into smaller ones has such.
    """
    n = len(points)
    if len(segments) != n or (np.bincount(segments.ravel(), minlength=n) != 2).any():
        return points, segments  # no single loop
    order = np.argsort(segments.ravel(), kind="stable").reshape(n, 2)
    others = segments.ravel()[order ^ 1]  # the far ends of each point's two segments
    a, b = points[others[:, 0]] - points, points - points[others[:, 1]]
    turn = np.abs(np.arctan2(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0], (a * b).sum(axis=1)))
    kept = turn > _STRAIGHT_SHARE * np.quantile(turn, 0.9)
    if kept.all() or kept.sum() < 4:
        return points, segments
    joined = _next_kept(others, kept)
    number = np.cumsum(kept) - 1
    return points[kept], number[joined]


def _next_kept(others: NDArray[np.int64], kept: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Return pairs of kept points (k, 2) that follow each other along a loop."""
    start = int(np.flatnonzero(kept)[0])
    pairs, last, before, here = [], start, start, int(others[start, 0])
    for _ in range(len(others)):
        if kept[here]:
            pairs.append((last, here))
            last = here
        if here == start:
            break
        following = others[here, 1] if others[here, 0] == before else others[here, 0]
        before, here = here, int(following)
    return np.array(pairs, dtype=np.int64).reshape(-1, 2)


def _good(shape: RimShape, middles: NDArray[np.float64]) -> bool:
    deepest = float(shape.beyond_mm(middles).min())
    if deepest < -_CHORD_SHARE * shape.width_mm:
        return False  # a hexagon's corners lie on a rectangle, its sides do not
    limit = max(_RMS_MM, _RMS_SHARE * shape.width_mm / 2)
    return shape.rms_mm <= min(limit, 0.1 * shape.width_mm) and shape.worst_mm <= 5 * limit


def _circle(points: NDArray[np.float64]) -> RimShape | None:
    if len(points) < LEAST_CORNERS:
        return None
    middle = points.mean(axis=0)
    away = points - middle
    design = np.column_stack([2 * away, np.ones(len(away))])
    (x, y, c), *_ = np.linalg.lstsq(design, (away**2).sum(axis=1), rcond=None)
    square = c + x * x + y * y
    if not square > 0:
        return None
    found = np.array([x, y, math.sqrt(square)])
    for _ in range(5):  # Gauss–Newton on the distances themselves
        off = away - found[:2]
        distance = np.hypot(*off.T)
        if not distance.min() > 0:
            return None
        slopes = np.column_stack([-off / distance[:, None], -np.ones(len(off))])
        step, *_ = np.linalg.lstsq(slopes, found[2] - distance, rcond=None)
        found = found + step
    x, y, radius = found.tolist()
    angles = np.sort(np.arctan2(away[:, 1] - y, away[:, 0] - x))
    gaps = np.diff(np.append(angles, angles[0] + 2 * math.pi))
    apart = np.unique(np.round(angles, 3))
    if math.degrees(gaps.max()) > _MOST_APART_DEG or len(apart) < LEAST_CORNERS or radius <= 0:
        return None
    residual = np.hypot(away[:, 0] - x, away[:, 1] - y) - radius
    return RimShape(
        outline="circle",
        centre_mm=(float(middle[0] + x), float(middle[1] + y)),
        direction_rad=0.0,
        length_mm=2 * radius,
        width_mm=2 * radius,
        radius_mm=radius,
        rms_mm=float(np.sqrt(np.mean(residual**2))),
        worst_mm=float(np.abs(residual).max()),
    )


def _elongated(points: NDArray[np.float64], segments: NDArray[np.int64]) -> list[RimShape]:
    """Return the slot and the rectangle that fit best, in this order."""
    along = points[segments[:, 1]] - points[segments[:, 0]]
    lengths = np.hypot(*along.T)
    if not lengths.max() > 0:
        return []
    # Straight sides have the most length in one direction.
    turned = np.degrees(np.arctan2(along[:, 1], along[:, 0])) % 180.0
    apart = np.abs((turned[:, None] - turned[None, :200] + 90.0) % 180.0 - 90.0)
    mass = (lengths[:, None] * (apart < 1.5)).sum(axis=0)
    direction = math.radians(turned[int(np.argmax(mass))])
    axes = np.array([[math.cos(direction), math.sin(direction)]])
    axes = np.vstack([axes, [-axes[0, 1], axes[0, 0]]])
    local = points @ axes.T
    low, high = local.min(axis=0), local.max(axis=0)
    size = high - low
    if size[1] > size[0]:
        direction, size = direction + math.pi / 2, size[::-1]
    if not size.min() > 0:
        return []
    x, y = (low + high) / 2 @ axes
    shapes = []
    short = 0.5 * float(size[1])
    rounded = len(points) >= LEAST_CORNERS
    if rounded:
        slot = _fitted(points, [x, y, direction, size[0] / 2 - short, short], "slot")
        if slot is not None and slot.length_mm > _LONGER * slot.width_mm:
            shapes.append(slot)
    corners = np.abs(points @ axes.T - (low + high) / 2)
    if size[0] != (high - low)[0]:
        corners = corners[:, ::-1]
    # Of a rounded corner the points nearest to a side's ends tell its radius.
    on_side = np.abs(corners[:, 1] - size[1] / 2) < 1e-3 * size[1]
    reach = corners[on_side, 0].max(initial=0.0)
    radius = float(np.clip(size[0] / 2 - reach, 0.0, short))
    if not rounded:
        radius = 0.0
    start = [x, y, direction, size[0] / 2 - radius, size[1] / 2 - radius]
    rectangle = _fitted(points, [*start, radius] if rounded else start, "rectangle")
    if rectangle is not None:
        shapes.append(rectangle)
    return shapes


def _fitted(points: NDArray[np.float64], start: list[float], outline: Outline) -> RimShape | None:
    def residual(sizes: NDArray[np.float64]) -> NDArray[np.float64]:
        return _beyond(points, _six(sizes, outline))

    scale = np.full(len(start), max(start[3], start[4], 1e-6))
    scale[2] = 1.0
    found = least_squares(residual, start, x_scale=scale, method="trf", max_nfev=60)
    x, y, direction, a, b, radius = _six(found.x, outline)
    if a < -1e-9 or b < -1e-9 or radius < -1e-6 or a + radius <= 0 or b + radius <= 0:
        return None
    a, b, radius = max(a, 0.0), max(b, 0.0), max(radius, 0.0)
    if a < b:
        a, b, direction = b, a, direction + math.pi / 2
    off = found.fun
    if outline == "rectangle" and radius < 1e-3 * (b + radius):
        radius, a, b = 0.0, a + radius, b + radius
    return RimShape(
        outline=outline,
        centre_mm=(float(x), float(y)),
        direction_rad=float((direction + math.pi / 2) % math.pi - math.pi / 2),
        length_mm=2 * (a + radius),
        width_mm=2 * (b + radius),
        radius_mm=radius,
        rms_mm=float(np.sqrt(np.mean(off**2))),
        worst_mm=float(np.abs(off).max()),
    )


def _six(
    sizes: NDArray[np.float64], outline: Outline
) -> tuple[float, float, float, float, float, float]:
    """Return centre, direction, half sizes of the core and radius of what is fitted."""
    x, y, direction, a, b, *rest = (float(size) for size in sizes)
    if outline == "slot":
        return x, y, direction, a, 0.0, b
    return x, y, direction, a, b, rest[0] if rest else 0.0


def _beyond(points: NDArray[np.float64], sizes: tuple[float, ...]) -> NDArray[np.float64]:
    """Return the distance of points to a rounded box: a core of half sizes a, b and a radius."""
    x, y, direction, a, b, radius = sizes
    c, s = math.cos(direction), math.sin(direction)
    away = points - (x, y)
    across = np.abs(np.column_stack([away @ (c, s), away @ (-s, c)])) - (a, b)
    outside = np.hypot(*np.maximum(across, 0.0).T)
    inside = np.minimum(across.max(axis=1), 0.0)
    return np.asarray(outside + inside - radius)
