"""Whether features lie on a mesh: what counts is how near its surface comes to their rings."""

import math
from collections.abc import Sequence
from dataclasses import replace

import numba
import numpy as np
from numpy.typing import NDArray

from exposight.cell.part import Feature, Part
from exposight.compiled import njit
from exposight.errors import FeatureError
from exposight.files import UNITS_MM


def check_placement(
    part: Part, vertices: NDArray[np.float64], faces: NDArray[np.int32], unit: str = "mm"
) -> None:
    """Check that the mesh of a part passes through the measured region of each of its features.

    Parameters
    ----------
    part : Part
        Its features are checked.
    vertices : (n, 3) ndarray of float64, mm
        In the part's frame.
    faces : (m, 3) ndarray of int32
        Triangles of the part.
    unit : str
        What the mesh's file was taken to be written in, a key of `UNITS_MM`.

    Raises
    ------
    FeatureError
        If it does not; the message says how far away the surface is, and whether it would do so if
        the file were written in another unit.
    """
    on_surface = _on_surface(part.features, vertices, faces)
    if on_surface.all():
        return
    feature = part.features[int(np.argmin(on_surface))]
    centre = feature.part_from_feature.translation_mm
    remedy = "check that mesh and features have the same frame and unit"
    for other, scale_mm in UNITS_MM.items():
        scaled = vertices * (scale_mm / UNITS_MM[unit])
        if other != unit and _on_surface(part.features, scaled, faces).all():
            remedy = (
                f"with a mesh in {other} instead of {unit} every feature would lie on it: set "
                f'unit = "{other}" in its scene.toml (of a mesh alone: --mesh-unit {other}), or '
                "write the features in mm"
            )
            break
    msg = (
        f"feature {feature.name!r} at {_spelled(centre)} mm lies "
        f"{_distance_mm(vertices, faces, centre):.4g} mm from the nearest surface of part "
        f"{part.name!r}, none of which is in its measured region; the part reaches from "
        f"{_spelled(vertices[faces].min(axis=(0, 1)))} to "
        f"{_spelled(vertices[faces].max(axis=(0, 1)))} mm; {remedy}"
    )
    raise FeatureError(msg)


def faces_under(
    part: Part, vertices: NDArray[np.float64], faces: NDArray[np.int32]
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Return points on the middle line of each feature's ring, and the triangle nearest to each.

    Parameters
    ----------
    part, vertices, faces
        As for `check_placement`.

    Returns
    -------
    (k, n, 3) ndarray, mm
        In the part's frame.
    (k, n) ndarray of int
        Indices into `faces`; −1 where no triangle is as near as the measured region reaches.
    """
    points, reaches_mm = _ring_middles(part.features, 2)
    nearest = np.full(points.shape[:2], -1, dtype=np.int64)
    _find_nearest(vertices, faces, points, reaches_mm, nearest)
    return points, nearest


def _spelled(point: NDArray[np.float64]) -> str:
    return "(" + ", ".join(f"{number:.6g}" for number in point) + ")"


def _on_surface(
    features: Sequence[Feature], vertices: NDArray[np.float64], faces: NDArray[np.int32]
) -> NDArray[np.bool_]:
    """Tell for each feature whether the surface comes near the middle line of its ring."""
    near = np.zeros(len(features), dtype=np.bool_)
    _find_near(vertices, faces, *_ring_middles(features, 8), near)
    return near


def _ring_middles(
    features: Sequence[Feature], every: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return points (k, n, 3) on the rings' middle lines, and half the heights of the regions.

    Of each outline's points one in `every` is taken.
    """
    middles, reaches_mm = [], []
    for feature in features:
        region = feature.measured_region()
        middle_mm = (region.inner_mm + region.outer_mm) / 2
        middle = replace(region, inner_mm=0.0, outer_mm=middle_mm).outline()[::every]
        middles.append(feature.part_from_feature.apply(middle))
        reaches_mm.append(region.height_mm / 2)
    return np.array(middles), np.array(reaches_mm)


@njit(parallel=True, error_model="numpy")
def _find_near(
    vertices: NDArray[np.float64],
    faces: NDArray[np.int32],
    points: NDArray[np.float64],
    reaches: NDArray[np.float64],
    near: NDArray[np.bool_],
) -> None:
    """Tell which sets of points (k, n, 3) have one whose distance to a triangle is in reach."""
    for k in numba.prange(len(points)):
        reach = reaches[k]
        low, high = np.empty(3), np.empty(3)
        for j in range(3):
            low[j] = points[k, :, j].min() - reach
            high[j] = points[k, :, j].max() + reach
        for i in range(len(faces)):
            a, b, c = vertices[faces[i, 0]], vertices[faces[i, 1]], vertices[faces[i, 2]]
            apart = False
            for j in range(3):
                apart |= max(a[j], b[j], c[j]) < low[j] or min(a[j], b[j], c[j]) > high[j]
            if apart:
                continue
            for p in points[k]:
                if _squared_distance(p, a, b, c) <= reach * reach:
                    near[k] = True
                    break
            if near[k]:
                break


@njit(error_model="numpy")
def _find_nearest(
    vertices: NDArray[np.float64],
    faces: NDArray[np.int32],
    points: NDArray[np.float64],
    reaches: NDArray[np.float64],
    nearest: NDArray[np.int64],
) -> None:
    """Fill the index of the triangle nearest to each point (k, n, 3), of those in reach."""
    n_sets, n_points = points.shape[:2]
    low, high = np.empty((n_sets, 3)), np.empty((n_sets, 3))
    least = np.empty((n_sets, n_points))
    for k in range(n_sets):
        least[k] = reaches[k] ** 2
        for j in range(3):
            low[k, j] = points[k, :, j].min() - reaches[k]
            high[k, j] = points[k, :, j].max() + reaches[k]
    bottom, top = np.empty(3), np.empty(3)
    for i in range(len(faces)):
        a, b, c = vertices[faces[i, 0]], vertices[faces[i, 1]], vertices[faces[i, 2]]
        for j in range(3):
            bottom[j], top[j] = min(a[j], b[j], c[j]), max(a[j], b[j], c[j])
        for k in range(n_sets):
            if (
                top[0] < low[k, 0]
                or bottom[0] > high[k, 0]
                or top[1] < low[k, 1]
                or bottom[1] > high[k, 1]
                or top[2] < low[k, 2]
                or bottom[2] > high[k, 2]
            ):
                continue
            for p in range(n_points):
                beside = 0.0
                for j in range(3):
                    beside += max(bottom[j] - points[k, p, j], points[k, p, j] - top[j], 0.0) ** 2
                if beside > least[k, p]:
                    continue
                squared = _squared_distance(points[k, p], a, b, c)
                if squared <= least[k, p]:
                    least[k, p], nearest[k, p] = squared, i


@njit(error_model="numpy")
def _distance_mm(
    vertices: NDArray[np.float64], faces: NDArray[np.int32], point: NDArray[np.float64]
) -> float:
    """Return the distance from a point to the nearest triangle."""
    least = math.inf
    for i in range(len(faces)):
        a, b, c = vertices[faces[i, 0]], vertices[faces[i, 1]], vertices[faces[i, 2]]
        least = min(least, _squared_distance(point, a, b, c))
    return math.sqrt(least)


@njit(error_model="numpy")
def _squared_distance(
    p: NDArray[np.float64],
    a: NDArray[np.float64],
    b: NDArray[np.float64],
    c: NDArray[np.float64],
) -> float:
    """Return the squared distance from a point to a triangle, also one without area."""
    ux, uy, uz = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    vx, vy, vz = c[0] - a[0], c[1] - a[1], c[2] - a[2]
    wx, wy, wz = p[0] - a[0], p[1] - a[1], p[2] - a[2]
    uu, uv, vv = (
        ux * ux + uy * uy + uz * uz,
        ux * vx + uy * vy + uz * vz,
        vx * vx + vy * vy + vz * vz,
    )
    wu, wv = wx * ux + wy * uy + wz * uz, wx * vx + wy * vy + wz * vz
    square = uu * vv - uv * uv
    s, t = vv * wu - uv * wv, uu * wv - uv * wu
    if square > 0.0 and s >= 0.0 and t >= 0.0 and s + t <= square:  # its foot is inside
        s, t = s / square, t / square
        x, y, z = wx - s * ux - t * vx, wy - s * uy - t * vy, wz - s * uz - t * vz
        return float(x * x + y * y + z * z)
    return min(_from_edge(p, a, b), _from_edge(p, b, c), _from_edge(p, c, a))


@njit(error_model="numpy")
def _from_edge(p: NDArray[np.float64], a: NDArray[np.float64], b: NDArray[np.float64]) -> float:
    ux, uy, uz = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    x, y, z = p[0] - a[0], p[1] - a[1], p[2] - a[2]
    uu = ux * ux + uy * uy + uz * uz
    t = (x * ux + y * uy + z * uz) / uu if uu > 0.0 else 0.0
    t = min(max(t, 0.0), 1.0)
    x, y, z = x - t * ux, y - t * uy, z - t * uz
    return float(x * x + y * y + z * z)
