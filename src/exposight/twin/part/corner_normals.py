"""Normals for shading: one for each corner of each triangle, so that flat faces stay flat.

One normal a vertex would bend a coarse mesh's large triangles towards whatever adjoins them. Here a
corner's normal is the mean of those triangles at its vertex that turn away from its own by no more
than the crease angle, whichever way round they are. Each is weighted by its angle at the vertex, so
that it does not matter how a face is cut, and by the area of the flat face that it belongs to, so
that a large face beside a finely cut fillet keeps its normal ("face weighted normals").
"""

import math

import numba
import numpy as np
from numpy.typing import NDArray

from exposight.compiled import njit

CREASE_DEG = 29.0
"""Faces that meet at more than this have an edge between them.

CAD kernels cut curved faces into steps of up to 0.5 rad = 28.6°; chamfers begin at 30°.
"""
_FLAT_COSINE = math.cos(math.radians(0.03))
"""Triangles that turn less than this belong to one flat face: single precision in a file tilts a
triangle of 0.3 mm, 0.5 m from the origin, by 0.01°."""
_MERGED = 1e-6
"""Vertices nearer than this share of the mesh's diagonal are one, as in files without indices."""


def corner_normals(
    vertices: NDArray[np.float64], faces: NDArray[np.int32], crease_deg: float = CREASE_DEG
) -> NDArray[np.float32]:
    """Return the unit normals (m, 3, 3) at the corners of m triangles, each to its triangle's side.

    Parameters
    ----------
    vertices : (n, 3) ndarray of float64, mm
        Finite. Those at the same place count as one.
    faces : (m, 3) ndarray of int32
        In any orientation.
    crease_deg : float, degrees
        Triangles that turn by more are not smoothed over.

    Notes
    -----
    A triangle without area has normals of length 0, and no influence.
    """
    low = vertices.min(axis=0)
    tolerance = _MERGED * float(np.linalg.norm(vertices.max(axis=0) - low))
    place = _places(vertices, low, max(tolerance, 1e-300))
    at = place[faces].ravel()
    starts = np.zeros(len(vertices) + 1, dtype=np.int64)
    np.cumsum(np.bincount(at, minlength=len(vertices)), out=starts[1:])
    corners = np.argsort(at, kind="stable").astype(np.int32)
    normals = np.empty((len(faces), 3))
    angles = np.empty((len(faces), 3))
    areas = np.empty(len(faces))
    _measure(vertices, faces, normals, angles, areas)
    _join_flat(normals, areas, starts, corners)
    weights = angles * areas[:, np.newaxis]
    out = np.zeros((len(faces), 3, 3), dtype=np.float32)
    _average(normals, weights, starts, corners, at, math.cos(math.radians(crease_deg)), out)
    return out


@njit(error_model="numpy")
def _places(
    vertices: NDArray[np.float64], low: NDArray[np.float64], tolerance: float
) -> NDArray[np.int32]:
    """Return for each vertex the first one at its place, by way of a table of cells in space."""
    n = len(vertices)
    size = 16
    while size < 2 * n:
        size *= 2
    heads = np.full(size, -1, dtype=np.int32)
    following = np.full(n, -1, dtype=np.int32)
    place = np.empty(n, dtype=np.int32)
    first, last = np.empty(3, dtype=np.int64), np.empty(3, dtype=np.int64)
    for i in range(n):
        for j in range(3):
            x = vertices[i, j] - low[j]
            first[j] = math.floor((x - tolerance) / (4.0 * tolerance))
            last[j] = math.floor((x + tolerance) / (4.0 * tolerance))
        match = i
        for cx in range(first[0], last[0] + 1):
            for cy in range(first[1], last[1] + 1):
                for cz in range(first[2], last[2] + 1):
                    k = heads[_slot(cx, cy, cz, size)]
                    while k >= 0 and match == i:
                        dx = vertices[k, 0] - vertices[i, 0]
                        dy = vertices[k, 1] - vertices[i, 1]
                        dz = vertices[k, 2] - vertices[i, 2]
                        if dx * dx + dy * dy + dz * dz <= tolerance * tolerance:
                            match = k
                        k = following[k]
        place[i] = match
        if match == i:
            for j in range(3):
                first[j] = math.floor((vertices[i, j] - low[j]) / (4.0 * tolerance))
            slot = _slot(first[0], first[1], first[2], size)
            following[i] = heads[slot]
            heads[slot] = i
    return place


@njit(inline="always")
def _slot(x: int, y: int, z: int, size: int) -> int:
    mixed = (x * 73856093) ^ (y * 19349663) ^ (z * 83492791)  # Teschner et al. 2003
    return (mixed ^ (mixed >> 17)) & (size - 1)


@njit(parallel=True, error_model="numpy")
def _measure(
    vertices: NDArray[np.float64],
    faces: NDArray[np.int32],
    normals: NDArray[np.float64],
    angles: NDArray[np.float64],
    areas: NDArray[np.float64],
) -> None:
    """Fill unit normals, angles at the corners and areas; all 0 for a triangle without area."""
    for i in numba.prange(len(faces)):
        a, b, c = vertices[faces[i, 0]], vertices[faces[i, 1]], vertices[faces[i, 2]]
        ux, uy, uz = b[0] - a[0], b[1] - a[1], b[2] - a[2]
        vx, vy, vz = c[0] - a[0], c[1] - a[1], c[2] - a[2]
        x, y, z = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
        twice = math.sqrt(x * x + y * y + z * z)
        areas[i] = 0.5 * twice
        scale = 1.0 / twice if twice > 0.0 else 0.0
        normals[i, 0], normals[i, 1], normals[i, 2] = x * scale, y * scale, z * scale
        uu, vv = ux * ux + uy * uy + uz * uz, vx * vx + vy * vy + vz * vz
        uv = ux * vx + uy * vy + uz * vz
        angles[i, 0] = math.atan2(twice, uv)
        angles[i, 1] = math.atan2(twice, uu - uv)
        angles[i, 2] = math.atan2(twice, vv - uv)


@njit(error_model="numpy")
def _join_flat(
    normals: NDArray[np.float64],
    areas: NDArray[np.float64],
    starts: NDArray[np.int64],
    corners: NDArray[np.int32],
) -> None:
    """Replace each triangle's area by that of all that join it without a turn."""
    parent = np.arange(len(areas))
    for place in range(len(starts) - 1):
        for i in range(starts[place] + 1, starts[place + 1]):
            one = corners[i] // 3
            for j in range(starts[place], i):
                other = corners[j] // 3
                if abs(_cosine(normals, one, other)) > _FLAT_COSINE:
                    parent[_root(parent, one)] = _root(parent, other)
    total = np.zeros(len(areas))
    for i in range(len(areas)):
        total[_root(parent, i)] += areas[i]
    for i in range(len(areas)):
        areas[i] = total[_root(parent, i)]


@njit(inline="always")
def _cosine(normals: NDArray[np.float64], i: int, j: int) -> float:
    n, m = normals[i], normals[j]
    return float(n[0] * m[0] + n[1] * m[1] + n[2] * m[2])


@njit()
def _root(parent: NDArray[np.int64], i: int) -> int:
    while parent[i] != i:
        parent[i] = parent[parent[i]]
        i = parent[i]
    return i


@njit(parallel=True, error_model="numpy")
def _average(
    normals: NDArray[np.float64],
    weights: NDArray[np.float64],
    starts: NDArray[np.int64],
    corners: NDArray[np.int32],
    at: NDArray[np.int32],
    crease: float,
    out: NDArray[np.float32],
) -> None:
    for face in numba.prange(len(normals)):
        for k in range(3):
            x, y, z = 0.0, 0.0, 0.0
            place = at[3 * face + k]
            for i in range(starts[place], starts[place + 1]):
                other, corner = corners[i] // 3, corners[i] % 3
                cosine = _cosine(normals, face, other)
                if abs(cosine) >= crease:
                    weight = math.copysign(weights[other, corner], cosine)
                    x += weight * normals[other, 0]
                    y += weight * normals[other, 1]
                    z += weight * normals[other, 2]
            length = math.sqrt(x * x + y * y + z * z)
            if length > 0.0:
                out[face, k, 0], out[face, k, 1], out[face, k, 2] = (
                    x / length,
                    y / length,
                    z / length,
                )
