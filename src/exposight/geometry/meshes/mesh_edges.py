"""How triangles hang together: vertices at one place, edges with the triangles at both sides."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from exposight.compiled import njit

_HASH = 1_000_003


@dataclass(frozen=True, kw_only=True, eq=False)
class MeshEdges:
    """The edges of a mesh, each once.

    Parameters
    ----------
    ends : (k, 2) ndarray of int32
        Vertices, in the order of the first triangle that has the edge.
    sides : (k, 2) ndarray of int32
        The first two triangles that have it; −1 where there is none.
    n_faces : (k,) ndarray of int32
        How many have it: 1 on a border, 2 inside a surface.
    same_way : (k,) ndarray of bool
        Whether the second runs along it like the first: one of them is flipped.
    of_faces : (m, 3) ndarray of int32
        The edges of each triangle: from corner 0 to 1, 1 to 2 and 2 to 0.
    """

    ends: NDArray[np.int32]
    sides: NDArray[np.int32]
    n_faces: NDArray[np.int32]
    same_way: NDArray[np.bool_]
    of_faces: NDArray[np.int32]


def mesh_edges(faces: NDArray[np.int32], n_vertices: int) -> MeshEdges:
    """Return the edges of triangles (m, 3) over vertices that are welded."""
    ends, sides, n_faces, same_way, of_faces = _edges(
        np.ascontiguousarray(faces, dtype=np.int32), n_vertices
    )
    return MeshEdges(ends=ends, sides=sides, n_faces=n_faces, same_way=same_way, of_faces=of_faces)


@njit(error_model="numpy")
def weld(vertices: NDArray[np.float64], cell_mm: float) -> NDArray[np.int32]:
    """Return for each vertex (n,) the first one that is in the same cell of a grid."""
    n = len(vertices)
    size = 1
    while size < 2 * n:
        size *= 2
    table = np.full(size, -1, dtype=np.int32)
    keys = np.empty((n, 3), dtype=np.int64)
    first = np.empty(n, dtype=np.int32)
    for i in range(n):
        for j in range(3):
            keys[i, j] = np.int64(math.floor(vertices[i, j] / cell_mm + 0.5))
        x, y, z = keys[i, 0], keys[i, 1], keys[i, 2]
        mixed = np.uint64((x * _HASH + y) * _HASH + z)
        mixed ^= mixed >> np.uint64(29)
        mixed *= np.uint64(0xBF58476D1CE4E5B9)
        mixed ^= mixed >> np.uint64(32)
        place = np.int64(mixed & np.uint64(size - 1))
        while True:
            at = table[place]
            if at < 0:
                table[place] = i
                first[i] = i
                break
            if keys[at, 0] == x and keys[at, 1] == y and keys[at, 2] == z:
                first[i] = at
                break
            place = (place + 1) & (size - 1)
    return first


@njit(error_model="numpy")
def repeated_faces(faces: NDArray[np.int32], n_vertices: int) -> NDArray[np.bool_]:
    """Tell which triangles (m,) have the same corners as an earlier one, in any order."""
    m = len(faces)
    head = np.full(n_vertices, -1, dtype=np.int32)
    following = np.empty(m, dtype=np.int32)
    repeated = np.zeros(m, dtype=np.bool_)
    for f in range(m):
        a, b, c = faces[f, 0], faces[f, 1], faces[f, 2]
        low, high = min(a, b, c), max(a, b, c)
        middle = a + b + c - low - high
        other = head[low]
        while other >= 0:
            p, q, r = faces[other, 0], faces[other, 1], faces[other, 2]
            if max(p, q, r) == high and p + q + r - low - high == middle:
                repeated[f] = True
                break
            other = following[other]
        if not repeated[f]:
            following[f] = head[low]
            head[low] = f
    return repeated


@njit(error_model="numpy")
def _edges(
    faces: NDArray[np.int32], n_vertices: int
) -> tuple[
    NDArray[np.int32],
    NDArray[np.int32],
    NDArray[np.int32],
    NDArray[np.bool_],
    NDArray[np.int32],
]:
    m = len(faces)
    head = np.full(n_vertices, -1, dtype=np.int32)
    following = np.empty(3 * m, dtype=np.int32)
    ends = np.empty((3 * m, 2), dtype=np.int32)
    sides = np.full((3 * m, 2), -1, dtype=np.int32)
    n_faces = np.zeros(3 * m, dtype=np.int32)
    same_way = np.zeros(3 * m, dtype=np.bool_)
    of_faces = np.empty((m, 3), dtype=np.int32)
    n = 0
    for f in range(m):
        for k in range(3):
            a, b = faces[f, k], faces[f, (k + 1) % 3]
            low = min(a, b)
            e = head[low]
            while e >= 0 and max(ends[e, 0], ends[e, 1]) != max(a, b):
                e = following[e]
            if e < 0:
                e = n
                n += 1
                ends[e, 0], ends[e, 1] = a, b
                following[e] = head[low]
                head[low] = e
            elif n_faces[e] == 1:
                same_way[e] = ends[e, 0] == a
            if n_faces[e] < 2:
                sides[e, n_faces[e]] = f
            n_faces[e] += 1
            of_faces[f, k] = e
    return ends[:n].copy(), sides[:n].copy(), n_faces[:n].copy(), same_way[:n].copy(), of_faces


@njit(error_model="numpy")
def face_normals(
    vertices: NDArray[np.float64], faces: NDArray[np.int32]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the triangles' unit normals (m, 3), 0 without area, and their areas (m,) mm²."""
    normals = np.zeros((len(faces), 3))
    areas = np.zeros(len(faces))
    for f in range(len(faces)):
        a, b, c = faces[f, 0], faces[f, 1], faces[f, 2]
        p, q, r = vertices[a], vertices[b], vertices[c]
        ux, uy, uz = q[0] - p[0], q[1] - p[1], q[2] - p[2]
        vx, vy, vz = r[0] - p[0], r[1] - p[1], r[2] - p[2]
        x, y, z = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
        length = math.sqrt(x * x + y * y + z * z)
        areas[f] = length / 2
        if length > 0.0:
            normals[f, 0], normals[f, 1], normals[f, 2] = x / length, y / length, z / length
    return normals, areas


def bend_deg(
    vertices: NDArray[np.float64], normals: NDArray[np.float64], edges: MeshEdges
) -> NDArray[np.float32]:
    """Return by how much a surface bends at each edge (k,), degrees.

    Above 0 where it is concave as in an inner corner, below 0 where it is convex, NaN where not
    exactly two triangles that run the same way round meet.
    """
    return _bends(vertices, normals, edges.ends, edges.sides, edges.n_faces, edges.same_way)


@njit(error_model="numpy")
def _bends(
    vertices: NDArray[np.float64],
    normals: NDArray[np.float64],
    ends: NDArray[np.int32],
    sides: NDArray[np.int32],
    n_faces: NDArray[np.int32],
    same_way: NDArray[np.bool_],
) -> NDArray[np.float32]:
    bends = np.full(len(ends), np.nan, dtype=np.float32)
    for e in range(len(ends)):
        if n_faces[e] != 2 or same_way[e]:
            continue
        p, q = normals[sides[e, 0]], normals[sides[e, 1]]
        x = p[1] * q[2] - p[2] * q[1]
        y = p[2] * q[0] - p[0] * q[2]
        z = p[0] * q[1] - p[1] * q[0]
        cosine = p[0] * q[0] + p[1] * q[1] + p[2] * q[2]
        a, b = ends[e, 0], ends[e, 1]
        # Along the edge of the first triangle, normals turn one way at a convex edge.
        along = (
            x * (vertices[b, 0] - vertices[a, 0])
            + y * (vertices[b, 1] - vertices[a, 1])
            + z * (vertices[b, 2] - vertices[a, 2])
        )
        angle = math.degrees(math.atan2(math.sqrt(x * x + y * y + z * z), cosine))
        bends[e] = -angle if along > 0.0 else angle
    return bends


@njit(error_model="numpy")
def joined_faces(
    n_faces: int, sides: NDArray[np.int32], joins: NDArray[np.bool_]
) -> NDArray[np.int32]:
    """Return the number of the connected set that each of `n_faces` triangles is in.

    Parameters
    ----------
    n_faces : int
    sides : (k, 2) ndarray of int32
        Triangles at the edges.
    joins : (k,) ndarray of bool
        Which edges join their two triangles.
    """
    parent = np.arange(n_faces).astype(np.int32)
    for e in range(len(sides)):
        if not joins[e]:
            continue
        a, b = sides[e, 0], sides[e, 1]
        while parent[a] != a:
            parent[a] = parent[parent[a]]
            a = parent[a]
        while parent[b] != b:
            parent[b] = parent[parent[b]]
            b = parent[b]
        parent[max(a, b)] = min(a, b)
    number = np.empty(n_faces, dtype=np.int32)
    n = 0
    for f in range(n_faces):
        if parent[f] == f:
            number[f] = n
            n += 1
        else:  # parents come before their children
            number[f] = number[parent[f]]
    return number


def joined_points(n_points: int, segments: NDArray[np.signedinteger]) -> NDArray[np.int32]:
    """Return the number of the connected set that each of `n_points` is in.

    Parameters
    ----------
    n_points : int
    segments : (k, 2) ndarray of int
        Points that hang together.
    """
    sides = np.ascontiguousarray(segments, dtype=np.int32)
    return joined_faces(n_points, sides, np.ones(len(sides), dtype=np.bool_))


@njit(error_model="numpy")
def smoothed_normals(
    normals: NDArray[np.float64],
    areas: NDArray[np.float64],
    sides: NDArray[np.int32],
    of_faces: NDArray[np.int32],
    width_deg: float,
    rounds: int,
) -> NDArray[np.float64]:
    """Return normals (m, 3) averaged with those of neighbours that face alike, edges kept sharp.

    Parameters
    ----------
    normals : (m, 3) ndarray, areas : (m,) ndarray
        Of the triangles.
    sides, of_faces : ndarray of int32
        As in `MeshEdges`.
    width_deg : float, degrees
        Neighbours count by a Gaussian of this width over the angle between normals.
    rounds : int
        How often.
    """
    m = len(normals)
    narrow = 1.0 / (2.0 * math.radians(width_deg) ** 2)
    old = normals
    for _ in range(rounds):
        new = np.empty((m, 3))
        for f in range(m):
            x, y, z = old[f, 0] * areas[f], old[f, 1] * areas[f], old[f, 2] * areas[f]
            for k in range(3):
                e = of_faces[f, k]
                other = sides[e, 1] if sides[e, 0] == f else sides[e, 0]
                if other < 0:
                    continue
                away = 0.0
                for j in range(3):
                    away += (old[f, j] - old[other, j]) ** 2
                weight = areas[other] * math.exp(-away * narrow)
                x += weight * old[other, 0]
                y += weight * old[other, 1]
                z += weight * old[other, 2]
            length = math.sqrt(x * x + y * y + z * z)
            if length > 0.0:
                new[f, 0], new[f, 1], new[f, 2] = x / length, y / length, z / length
            else:
                new[f, 0], new[f, 1], new[f, 2] = old[f, 0], old[f, 1], old[f, 2]
        old = new
    return old
