"""Meshes as CAD programs and scanners leave them, made fit to be searched; faults are counted."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from exposight import errors
from exposight.compiled import njit
from exposight.geometry.meshes.mesh_edges import (
    MeshEdges,
    face_normals,
    joined_points,
    mesh_edges,
    repeated_faces,
    weld,
)
from exposight.geometry.meshes.triangle_meshes import Mesh, spelled
from exposight.tables import count, counted

CRACK_MM = 0.01
"""Borders that are nearer to each other than this are one edge: no cutter makes such a gap."""

_SAME = 1e-7
"""Vertices nearer to each other than this share of the mesh's size are one, as float32 has it."""


@dataclass(frozen=True, kw_only=True, eq=False)
class MendedMesh:
    """A mesh whose triangles share vertices and run the same way round.

    Parameters
    ----------
    mesh : Mesh
        Without repeated triangles.
    edges : MeshEdges
        Its edges.
    normals : (m, 3) ndarray, areas : (m,) ndarray of mm²
        Of its triangles.
    body : (m,) ndarray of int32
        Number of the connected surface that each triangle belongs to.
    closed : (b,) ndarray of bool
        Whether each surface encloses a volume.
    notes : tuple of str
        What was mended, and what was left.
    """

    mesh: Mesh
    edges: MeshEdges
    normals: NDArray[np.float64]
    areas: NDArray[np.float64]
    body: NDArray[np.int32]
    closed: NDArray[np.bool_]
    notes: tuple[str, ...]


def mend_mesh(mesh: Mesh, source: str = "the mesh") -> MendedMesh:
    """Join vertices, close cracks, drop repeated triangles and turn flipped ones.

    Parameters
    ----------
    mesh : Mesh
        As it was read.
    source : str
        What it is, for errors.

    Raises
    ------
    FormatError
        If a surface has but one side, or more than one edge in fifty belongs to more than two
        triangles: no outside can be told.
    """
    notes: list[str] = []
    lowest, highest = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
    size_mm = float(np.linalg.norm(highest - lowest))
    joined = _renumbered(mesh, weld(mesh.vertices, max(_SAME * size_mm, 1e-9)))
    joined = _without_repeated(joined, notes)
    edges = mesh_edges(joined.faces, len(joined.vertices))
    joined, edges = _cracks_closed(joined, edges, notes)
    joined, edges = _gaps_filled(joined, edges, notes)
    crowded = edges.n_faces > 2
    if crowded.sum() > 0.02 * len(crowded):
        msg = (
            f"{source}: {_share(crowded)} belong to more than two triangles, the first at "
            f"{_places(joined, edges, crowded)} mm, so that inside and outside cannot be told; "
            "export one body as a surface without inner walls"
        )
        raise errors.FormatError(msg)
    if crowded.any():
        notes.append(
            f"{_share(crowded)} belong to more than two triangles, such as at "
            f"{_places(joined, edges, crowded)} mm: holes that touch them may be missed"
        )
    flipped, body, one_sided = _flipped(edges.sides, edges.of_faces, edges.n_faces, edges.same_way)
    if one_sided >= 0:
        msg = (
            f"{source}: the surface at {spelled(joined.vertices[joined.faces[one_sided, 0]])} mm "
            "has but one side, as a Möbius strip has, so that inside and outside cannot be told; "
            "export it again"
        )
        raise errors.FormatError(msg)
    border = np.bincount(body[edges.sides[edges.n_faces == 1, 0]], minlength=body.max() + 1)
    closed = border == 0
    flipped = _turned_outward(joined, flipped, body, closed, notes)
    faces = joined.faces.copy()
    faces[flipped] = faces[flipped][:, ::-1]
    joined = replace(joined, faces=faces)
    if flipped.any():
        edges = mesh_edges(faces, len(joined.vertices))
    normals, areas = face_normals(joined.vertices, faces)
    return MendedMesh(
        mesh=joined,
        edges=edges,
        normals=normals,
        areas=areas,
        body=body,
        closed=closed,
        notes=tuple(notes),
    )


def _share(which: NDArray[np.bool_]) -> str:
    return f"{count(int(which.sum()))} of {counted(len(which), 'edge')}"


def _places(mesh: Mesh, edges: MeshEdges, which: NDArray[np.bool_]) -> str:
    return spelled(mesh.vertices[edges.ends[np.flatnonzero(which)[0], 0]])


def _renumbered(mesh: Mesh, first: NDArray[np.int32]) -> Mesh:
    """Return a mesh whose faces use only the first of each set of vertices; others go."""
    used = np.zeros(len(first), dtype=bool)
    faces = first[mesh.faces]
    used[faces.ravel()] = True
    number = np.cumsum(used, dtype=np.int32) - 1
    faces = number[faces].astype(np.int32)
    collapsed = (
        (faces[:, 0] == faces[:, 1]) | (faces[:, 1] == faces[:, 2]) | (faces[:, 2] == faces[:, 0])
    )
    mesh = replace(mesh, vertices=np.ascontiguousarray(mesh.vertices[used]), faces=faces)
    return mesh.with_faces(~collapsed) if collapsed.any() else mesh


def _without_repeated(mesh: Mesh, notes: list[str]) -> Mesh:
    repeated = repeated_faces(mesh.faces, len(mesh.vertices))
    if not repeated.any():
        return mesh
    notes.append(f"{counted(int(repeated.sum()), 'repeated triangle')} dropped")
    return mesh.with_faces(~repeated)


def _cracks_closed(mesh: Mesh, edges: MeshEdges, notes: list[str]) -> tuple[Mesh, MeshEdges]:
    """Join vertices of borders that lie within `CRACK_MM` of each other."""
    border = np.unique(edges.ends[edges.n_faces == 1])
    if not len(border):
        return mesh, edges
    spans = mesh.vertices[edges.ends[edges.n_faces == 1]]
    lengths = np.linalg.norm(spans[:, 1] - spans[:, 0], axis=1)
    reach = min(CRACK_MM, 0.25 * float(np.quantile(lengths, 0.05)))
    pairs = cKDTree(mesh.vertices[border]).query_pairs(reach, output_type="ndarray")
    if not len(pairs):
        return mesh, edges
    first = np.arange(len(mesh.vertices), dtype=np.int32)
    for low, high in np.sort(border[pairs], axis=1):
        first[high] = min(first[high], first[low])
    before = int((edges.n_faces == 1).sum())
    mesh = _renumbered(mesh, first)
    edges = mesh_edges(mesh.faces, len(mesh.vertices))
    after = int((edges.n_faces == 1).sum())
    notes.append(
        f"cracks of less than {reach:.2g} mm closed: {count(before)} open edges became "
        f"{count(after)}"
    )
    return mesh, edges


def _gaps_filled(mesh: Mesh, edges: MeshEdges, notes: list[str]) -> tuple[Mesh, MeshEdges]:
    """Fill gaps of one triangle: no feature has three corners."""
    border = np.flatnonzero(edges.n_faces == 1)
    if not len(border):
        return mesh, edges
    corners, local = np.unique(edges.ends[border], return_inverse=True)
    local = local.reshape(-1, 2)
    loop = joined_points(len(corners), local)
    n_corners, n_edges = np.bincount(loop), np.bincount(loop[local[:, 0]])
    gaps = (n_corners == 3) & (n_edges == 3)
    own = gaps[loop[local[:, 0]]]
    # A triangle that hangs together with nothing has three open edges, too.
    beside = edges.sides[border[own], 0].reshape(-1)
    order = np.argsort(loop[local[own, 0]], kind="stable").reshape(-1, 3)
    alone = (beside[order] == beside[order][:, :1]).all(axis=1)
    order = order[~alone]
    if not len(order):
        return mesh, edges
    ends = edges.ends[border[own]][order]
    first, second = ends[:, 0, 0], ends[:, 0, 1]
    third = ends.reshape(-1, 6).sum(axis=1) // 2 - first - second
    faces = np.column_stack([second, first, third])
    notes.append(f"{counted(len(faces), 'missing triangle')} filled in")
    n_faces = len(mesh.faces)
    mesh = mesh.with_faces(np.append(np.arange(n_faces), beside[order][:, 0]))
    mesh.faces[n_faces:] = faces
    return mesh, mesh_edges(mesh.faces, len(mesh.vertices))


def _turned_outward(
    mesh: Mesh,
    flipped: NDArray[np.bool_],
    body: NDArray[np.int32],
    closed: NDArray[np.bool_],
    notes: list[str],
) -> NDArray[np.bool_]:
    """Return which triangles to turn: of each surface the fewer, of a closed one those inward."""
    n_bodies = len(closed)
    sizes = np.bincount(body, minlength=n_bodies)
    n_flipped = np.bincount(body, flipped, minlength=n_bodies)
    other_way = n_flipped > sizes / 2
    flipped = flipped ^ other_way[body]
    mixed = int(np.minimum(n_flipped, sizes - n_flipped).sum())
    if mixed:
        notes.append(
            f"{counted(mixed, 'flipped triangle')} turned to run the same way round as their "
            "neighbours"
        )
    a, b, c = (mesh.vertices[mesh.faces[:, i]] for i in range(3))
    six_volumes = np.einsum("ij,ij->i", a, np.cross(b, c)) * np.where(flipped, -1.0, 1.0)
    volumes = np.bincount(body, six_volumes, minlength=n_bodies)
    inward = closed & (volumes < 0)
    if inward.any():
        lows = np.full((n_bodies, 3), np.inf)
        highs = np.full((n_bodies, 3), -np.inf)
        np.minimum.at(lows, body, np.minimum(np.minimum(a, b), c))
        np.maximum.at(highs, body, np.maximum(np.maximum(a, b), c))
        for number in np.flatnonzero(inward):
            around = (lows < lows[number]).all(axis=1) & (highs > highs[number]).all(axis=1)
            inward[number] = not (around & closed).any()  # else it is a hollow inside another
    if inward.any():
        turned = int(sizes[inward].sum())
        notes.append(
            f"{counted(int(inward.sum()), 'closed surface')} with normals inward turned "
            f"({counted(turned, 'triangle')})"
        )
    return flipped ^ inward[body]


@njit(error_model="numpy")
def _flipped(
    sides: NDArray[np.int32],
    of_faces: NDArray[np.int32],
    n_faces: NDArray[np.int32],
    same_way: NDArray[np.bool_],
) -> tuple[NDArray[np.bool_], NDArray[np.int32], int]:
    """Return which triangles run the other way than the first of their surface, and surfaces.

    The last number is a triangle at which both ways meet, −1 without one.
    """
    m = len(of_faces)
    flipped = np.zeros(m, dtype=np.bool_)
    body = np.full(m, -1, dtype=np.int32)
    queue = np.empty(m, dtype=np.int32)
    one_sided, number = -1, 0
    for start in range(m):
        if body[start] >= 0:
            continue
        body[start] = number
        queue[0], done, n = start, 0, 1
        while done < n:
            f = queue[done]
            done += 1
            for k in range(3):
                e = of_faces[f, k]
                if n_faces[e] != 2:
                    continue
                other = sides[e, 1] if sides[e, 0] == f else sides[e, 0]
                turned = flipped[f] ^ same_way[e]
                if body[other] < 0:
                    body[other] = number
                    flipped[other] = turned
                    queue[n] = other
                    n += 1
                elif flipped[other] != turned:
                    one_sided = f
        number += 1
    return flipped, body, one_sided
