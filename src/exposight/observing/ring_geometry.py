"""How good a ring's points are, beyond their number: form, gaps, and the hole's rim.

Deviations are of the points in the hollow cylinder from the plane that fits them best (least
squares, orthogonal). Their range between the 2.5th and the 97.5th percentile is the robust form
error that ISO 10360-13 takes for a plane.

A hole's rim lies between the last pixel with a point on the plane and the first without, on the
way to the hole's centre: along the image's rows where these cross the rim more steeply, along its
columns elsewhere. Both pixels' rays meet the plane on either side of the rim, so their middle is
the rim but for half a pixel, which is as often too much as too little; taking the innermost points
themselves would make every hole larger by a pixel. A circle is fitted to the middles (geometric
least squares, trimmed), where they cover enough of the angle.
"""

from __future__ import annotations

from collections.abc import Sequence

import numba
import numpy as np
from numpy.typing import NDArray

from exposight.compiled import njit
from exposight.geometry import PixelBox, packed_boxes, packed_cylinders
from exposight.observing.masks import FeatureView
from exposight.observing.point_search import PointSearch

FloatArray = NDArray[np.float64]

COLUMNS = (
    "sigma_z_mm", "plane_std_mm", "form_error_mm", "largest_gap_deg",
    "diameter_mm", "diameter_error_mm", "centre_error_mm",
)  # fmt: skip
"""What `ring_geometry` measures, in this order."""

_FEWEST_POINTS = 20
"""A plane takes three parameters from them, and two points of a hundred lie beyond its range."""
_FEWEST_EDGES = 12
_SECTORS, _FEWEST_SECTORS = 36, 27
"""The rim must be seen in three quarters of the angle: less leaves diameter and centre mixed up."""
_LEAST, _MOST = 0.4, 1.6
"""Shares of the nominal radius between which a rim is looked for."""
_ON_PLANE = 6.0
"""Points within so many robust standard deviations belong to the plane; a hole's wall does not."""
_LEAST_ON_PLANE_MM = 0.02
_OFF_CIRCLE_PX = 0.75
"""Half a pixel is what the middle may be off, along a row or column; trimming leaves that."""
_ROBUST, _QUARTILES = 1.4826, 1.349
"""Standard deviations of the normal distribution in a median deviation, and between quartiles."""


def ring_geometry(
    views: Sequence[FeatureView], search: PointSearch, counts: NDArray[np.int64]
) -> list[dict[str, float | None]]:
    """Measure rings that are visible.

    Parameters
    ----------
    views : sequence of n FeatureView
        Visible features.
    search : PointSearch
        The capture's cloud (`point_search`).
    counts : (n,) ndarray of int
        Points of each ring (`PointSearch.count`).

    Returns
    -------
    list of n dict
        `COLUMNS` by name; None where there are too few points, the feature is no hole, too little
        of its rim is seen, or the cloud tells no standard deviations.
    """
    if not views or search.camera is None:
        return [dict.fromkeys(COLUMNS) for _ in views]
    regions = packed_cylinders(
        [view.region for view in views], [view.camera_from_feature for view in views]
    )
    nominal = np.array(
        [view.feature.radius_mm if view.feature.kind == "hole" else 0.0 for view in views]
    )
    centres = search.camera.project([view.camera_from_feature.translation_mm for view in views])
    measured = np.full((len(views), len(COLUMNS)), np.nan)
    rays, boxes = search.camera.rays(), [search.box(view) for view in views]
    if search.by_slice is None or search.is_large:
        points, sigma = search.whole
        _measure(
            points, sigma, rays, packed_boxes(boxes), regions, nominal, centres, counts, measured
        )
    else:
        for i, view in enumerate(views):
            points, sigma = search.raster(view)
            box = boxes[i]
            whole = PixelBox(top=0, bottom=len(points), left=0, right=points.shape[1])
            _measure(
                points,
                sigma,
                rays[box.top : box.bottom, box.left : box.right],
                packed_boxes([whole]),
                regions[i : i + 1],
                nominal[i : i + 1],
                centres[i : i + 1] - (box.left, box.top),
                counts[i : i + 1],
                measured[i : i + 1],
            )
    rows = [[None if np.isnan(value) else value for value in row] for row in measured.tolist()]
    return [dict(zip(COLUMNS, row, strict=True)) for row in rows]


@njit(parallel=True, error_model="numpy")
def _measure(
    points: NDArray[np.float32],
    sigma: NDArray[np.float32],
    rays: FloatArray,
    edges: NDArray[np.int64],
    regions: FloatArray,
    nominal: FloatArray,
    centres: FloatArray,
    counts: NDArray[np.int64],
    measured: FloatArray,
) -> None:
    """Fill measured (n, 7); sigma is empty where it is not known, nominal 0 where no hole."""
    for i in numba.prange(len(regions)):
        region, out = regions[i], measured[i]
        ring = np.empty((4, counts[i]))
        n = _collect(points, sigma, edges[i], region, ring)
        out[3] = _largest_gap(ring[0, :n], ring[1, :n])
        if n < _FEWEST_POINTS:
            continue
        if sigma.size:
            out[0] = _median(ring[3, :n])
        plane = np.zeros(4)
        kept = np.ones(n, dtype=np.bool_)
        if not _fit_plane(ring, n, kept, plane):
            continue
        deviation = _deviations(ring, n, plane)
        out[1] = np.sqrt((deviation * deviation).sum() / (n - 3))
        ordered = np.sort(deviation)
        out[2] = _quantile(ordered, 0.975) - _quantile(ordered, 0.025)
        if nominal[i] == 0.0:
            continue
        spread = (_quantile(ordered, 0.75) - _quantile(ordered, 0.25)) / _QUARTILES
        middle = _quantile(ordered, 0.5)
        for j in range(n):
            kept[j] = abs(deviation[j] - middle) <= 3.0 * spread + _LEAST_ON_PLANE_MM
        if not _fit_plane(ring, n, kept, plane):
            continue
        plane[3] = max(_ON_PLANE * spread, _LEAST_ON_PLANE_MM)
        rim = np.empty((3, 2 * (edges[i, 1] - edges[i, 0] + edges[i, 3] - edges[i, 2]) + 4))
        found = _find_rim(points, rays, edges[i], region, nominal[i], centres[i], plane, rim)
        circle = np.zeros(3)
        if found >= _FEWEST_EDGES and _fit_circle(rim, found, nominal[i], circle):
            out[4] = 2.0 * circle[2]
            out[5] = 2.0 * (circle[2] - nominal[i])
            across = np.sqrt(1.0 + plane[1] * plane[1])
            x = -plane[0] * plane[1] / across
            y = -plane[0] * plane[2] / (across * np.sqrt(across * across + plane[2] * plane[2]))
            out[6] = np.hypot(circle[0] - x, circle[1] - y)


@njit(inline="always", error_model="numpy")
def _in_feature(u: float, v: float, w: float, region: FloatArray) -> tuple[float, float, float]:
    """Return a point in the feature's frame, z from the ring's plane."""
    x, y, z = u - region[9], v - region[10], w - region[11]
    return (
        region[0] * x + region[1] * y + region[2] * z,
        region[3] * x + region[4] * y + region[5] * z,
        region[6] * x + region[7] * y + region[8] * z - region[16],
    )


@njit(error_model="numpy")
def _collect(
    points: NDArray[np.float32],
    sigma: NDArray[np.float32],
    edges: NDArray[np.int64],
    region: FloatArray,
    ring: FloatArray,
) -> int:
    """Fill ring with x, y, z and sigma of the points in the hollow cylinder; return how many."""
    n = 0
    for r in range(edges[0], edges[1]):
        for c in range(edges[2], edges[3]):
            w = points[r, c, 2]
            if np.isnan(w):
                continue
            x, y, z = _in_feature(points[r, c, 0], points[r, c, 1], w, region)
            beyond_x = max(abs(x) - region[14], 0.0)
            beyond_y = max(abs(y) - region[15], 0.0)
            square = beyond_x * beyond_x + beyond_y * beyond_y
            if (
                square >= region[12]
                and square <= region[13]
                and abs(z) <= region[17]
                and n < ring.shape[1]
            ):
                ring[0, n], ring[1, n], ring[2, n] = x, y, z
                if sigma.size:
                    ring[3, n] = sigma[r, c]
                n += 1
    return n


@njit(error_model="numpy")
def _largest_gap(x: FloatArray, y: FloatArray) -> float:
    """Return the largest angle about the centre without a point, degrees; 360 without any."""
    if len(x) < 2:
        return 360.0
    bins = 360
    first, last = np.full(bins, np.inf), np.full(bins, -np.inf)
    for j in range(len(x)):
        turn = x[j] / max(abs(x[j]) + abs(y[j]), 1e-12)  # rises with the angle, as -cosine
        turn = 1.0 - turn if y[j] >= 0.0 else 3.0 + turn
        k = min(int(turn * bins / 4.0), bins - 1)
        first[k] = min(first[k], turn)
        last[k] = max(last[k], turn)
    gap, before, start = 0.0, np.nan, np.nan
    for k in range(bins):
        if last[k] < 0.0:
            continue
        angle = _degrees(first[k])
        if np.isnan(before):
            start = angle
        else:
            gap = max(gap, angle - before)
        before = _degrees(last[k])
    return max(gap, start + 360.0 - before)


@njit(inline="always", error_model="numpy")
def _degrees(turn: float) -> float:
    """Return the angle, 0 to 360°, of a place on the square |x| + |y| = 1, 0 to 4."""
    x = 1.0 - turn if turn < 2.0 else turn - 3.0
    y = 1.0 - abs(x)
    angle = np.degrees(np.arctan2(y, x))
    return float(angle if turn < 2.0 else 360.0 - angle)


@njit(error_model="numpy")
def _fit_plane(ring: FloatArray, n: int, kept: NDArray[np.bool_], plane: FloatArray) -> bool:
    """Fit z = p₀ + p₁·x + p₂·y to the points kept; False where they lie on a line."""
    count, mean_x, mean_y, mean_z = 0, 0.0, 0.0, 0.0
    for j in range(n):
        if kept[j]:
            count += 1
            mean_x += ring[0, j]
            mean_y += ring[1, j]
            mean_z += ring[2, j]
    if count < _FEWEST_POINTS:
        return False
    mean_x, mean_y, mean_z = mean_x / count, mean_y / count, mean_z / count
    xx, xy, yy, xz, yz = 0.0, 0.0, 0.0, 0.0, 0.0
    for j in range(n):
        if kept[j]:
            x, y, z = ring[0, j] - mean_x, ring[1, j] - mean_y, ring[2, j] - mean_z
            xx += x * x
            xy += x * y
            yy += y * y
            xz += x * z
            yz += y * z
    determinant = xx * yy - xy * xy
    if not determinant > 1e-4 * (xx + yy) * (xx + yy):
        return False
    plane[1] = (yy * xz - xy * yz) / determinant
    plane[2] = (xx * yz - xy * xz) / determinant
    plane[0] = mean_z - plane[1] * mean_x - plane[2] * mean_y
    return True


@njit(error_model="numpy")
def _deviations(ring: FloatArray, n: int, plane: FloatArray) -> FloatArray:
    """Return the points' distances from a plane, mm."""
    scale = 1.0 / np.sqrt(1.0 + plane[1] * plane[1] + plane[2] * plane[2])
    out = np.empty(n)
    for j in range(n):
        out[j] = scale * (ring[2, j] - plane[0] - plane[1] * ring[0, j] - plane[2] * ring[1, j])
    return out


@njit(error_model="numpy")
def _median(values: FloatArray) -> float:
    """Return the median of those that are no NaN."""
    known = np.sort(values[~np.isnan(values)])
    return _quantile(known, 0.5) if len(known) else np.nan


@njit(inline="always", error_model="numpy")
def _quantile(ordered: FloatArray, share: float) -> float:
    """Return a quantile of ascending numbers, linear between them."""
    place = share * (len(ordered) - 1)
    low = int(place)
    high = min(low + 1, len(ordered) - 1)
    return float(ordered[low] + (place - low) * (ordered[high] - ordered[low]))


@njit(inline="always", error_model="numpy")
def _on_plane(
    points: NDArray[np.float32], r: int, c: int, region: FloatArray, plane: FloatArray
) -> bool:
    """Tell whether there is a point of the ring's plane, no farther out than the ring."""
    w = points[r, c, 2]
    if np.isnan(w):
        return False
    x, y, z = _in_feature(points[r, c, 0], points[r, c, 1], w, region)
    off = z - plane[0] - plane[1] * x - plane[2] * y
    steep = 1.0 + plane[1] * plane[1] + plane[2] * plane[2]
    return bool(off * off <= plane[3] * plane[3] * steep and x * x + y * y <= region[13])


@njit(inline="always", error_model="numpy")
def _hit(ray: FloatArray, region: FloatArray, plane: FloatArray) -> tuple[float, float]:
    """Return where a pixel's ray meets the plane, in two coordinates on it, mm."""
    dx = region[0] * ray[0] + region[1] * ray[1] + region[2]
    dy = region[3] * ray[0] + region[4] * ray[1] + region[5]
    dz = region[6] * ray[0] + region[7] * ray[1] + region[8]
    ox = -(region[0] * region[9] + region[1] * region[10] + region[2] * region[11])
    oy = -(region[3] * region[9] + region[4] * region[10] + region[5] * region[11])
    oz = -(region[6] * region[9] + region[7] * region[10] + region[8] * region[11]) - region[16]
    away = (plane[0] + plane[1] * ox + plane[2] * oy - oz) / (dz - plane[1] * dx - plane[2] * dy)
    x, y = ox + away * dx, oy + away * dy
    z = plane[1] * x + plane[2] * y
    across = np.sqrt(1.0 + plane[1] * plane[1])
    steep = np.sqrt(across * across + plane[2] * plane[2])
    return (
        (x + plane[1] * z) / across,
        (-plane[1] * plane[2] * x + across * across * y + plane[2] * z) / (across * steep),
    )


@njit(error_model="numpy")
def _find_rim(
    points: NDArray[np.float32],
    rays: FloatArray,
    edges: NDArray[np.int64],
    region: FloatArray,
    nominal: float,
    centre: FloatArray,
    plane: FloatArray,
    rim: FloatArray,
) -> int:
    """Fill rim with places on the plane and the pixel's size there; return how many."""
    found = 0
    u, v = int(np.rint(centre[0])), int(np.rint(centre[1]))
    if not (edges[2] <= u < edges[3] and edges[0] <= v < edges[1]):
        return 0
    pitch = np.empty(2)
    x, y = _hit(rays[v, u], region, plane)
    for axis in range(2):  # of pixels beside each other in a row, in a column
        below, right = min(v + axis, edges[1] - 1), min(u + 1 - axis, edges[3] - 1)
        x_in, y_in = _hit(rays[below, right], region, plane)
        pitch[axis] = max(np.hypot(x - x_in, y - y_in), 1e-9)
    for axis in range(2):  # along rows, along columns
        first, last = (edges[0], edges[1]) if axis == 0 else (edges[2], edges[3])
        low, high = (edges[2], edges[3]) if axis == 0 else (edges[0], edges[1])
        start, middle = (u, v) if axis == 0 else (v, u)
        reach = int(_MOST * nominal / pitch[1 - axis]) + 1
        for line in range(max(first, middle - reach), min(last, middle + reach + 1)):
            for step in (-1, 1):
                nearest = max(abs(line - middle), int(_LEAST * nominal / pitch[axis]))
                at = start + step * nearest
                while low <= at < high:
                    r, c = (line, at) if axis == 0 else (at, line)
                    if _on_plane(points, r, c, region, plane):
                        break
                    at += step
                if abs(at - start) == nearest or not low <= at < high:
                    continue
                r, c = (line, at) if axis == 0 else (at, line)
                s, d = (line, at - step) if axis == 0 else (at - step, line)
                x, y = _hit(rays[r, c], region, plane)
                x_in, y_in = _hit(rays[s, d], region, plane)
                middle_x, middle_y = 0.5 * (x + x_in), 0.5 * (y + y_in)
                radius = np.hypot(middle_x, middle_y)
                if _LEAST * nominal <= radius <= _MOST * nominal:
                    rim[0, found], rim[1, found] = middle_x, middle_y
                    rim[2, found] = np.hypot(x - x_in, y - y_in)
                    found += 1
    return found


@njit(error_model="numpy")
def _fit_circle(rim: FloatArray, n: int, nominal: float, circle: FloatArray) -> bool:
    """Fill circle with centre and radius; False where there is none, or too little of it."""
    x, y = rim[0, :n], rim[1, :n]
    pitch = float(np.median(rim[2, :n]))
    circle[2] = np.median(np.sqrt(x * x + y * y))
    kept = np.ones(n, dtype=np.bool_)
    off = np.empty(n)
    for iteration in range(20):
        normal, right = np.zeros((3, 3)), np.zeros(3)
        row = np.ones(3)
        for j in range(n):
            dx, dy = x[j] - circle[0], y[j] - circle[1]
            radius = max(np.hypot(dx, dy), 1e-9)
            off[j] = radius - circle[2]
            row[0], row[1] = dx / radius, dy / radius
            if kept[j]:
                for a in range(3):
                    right[a] += row[a] * off[j]
                    for b in range(3):
                        normal[a, b] += row[a] * row[b]
        if np.linalg.det(normal) < 1e-6 * n**3:
            return False
        change = np.linalg.solve(normal, right)
        circle += change
        if iteration > 2 and np.abs(change).max() < 1e-7 * nominal:
            break
        limit = 2.5 * _ROBUST * np.median(np.abs(off))
        if iteration < 3:
            limit *= 1.6
        limit = max(limit, _OFF_CIRCLE_PX * pitch)
        for j in range(n):
            kept[j] = abs(off[j]) <= limit
    return _is_seen(x, y, off, kept, circle, pitch)


@njit(error_model="numpy")
def _is_seen(
    x: FloatArray,
    y: FloatArray,
    off: FloatArray,
    kept: NDArray[np.bool_],
    circle: FloatArray,
    pitch: float,
) -> bool:
    """Tell whether places kept lie round a circle, within a pixel and in enough sectors."""
    sectors = np.zeros(_SECTORS, dtype=np.bool_)
    total, count = 0.0, 0
    for j in range(len(x)):
        if kept[j]:
            angle = np.arctan2(y[j] - circle[1], x[j] - circle[0]) / (2.0 * np.pi) + 0.5
            sectors[min(int(angle * _SECTORS), _SECTORS - 1)] = True
            total += off[j] * off[j]
            count += 1
    enough = count >= _FEWEST_EDGES and sectors.sum() >= _FEWEST_SECTORS
    return bool(enough and np.sqrt(total / count) <= pitch)
