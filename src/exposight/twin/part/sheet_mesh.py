"""A closed triangle mesh of a pressed sheet, without a CAD kernel.

In the part's (x, y) plane, points are laid out as a triangular lattice, finer where the sheet
bends, and as rings round the holes that grow coarser outwards; Delaunay's triangulation joins
them. The plane is lifted onto the inner skin, offset by the thickness onto the outer skin, and
every border (outline, opening, holes) is closed by a wall with rounded edges.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import Delaunay

from exposight.twin.part.sheet_shape import Hole, SheetShape


@dataclass(frozen=True, kw_only=True)
class MeshSettings:
    """How finely a sheet is cut into triangles.

    Parameters
    ----------
    lattice_mm : float, mm
        Edge of the triangles on smooth sheet; half of it where the sheet bends.
    fine_curvature_per_mm : float, 1/mm
        The sheet counts as bent where its curvature exceeds this.
    rim_spacing_mm : float, mm
        Edge of the triangles along a hole's rim.
    border_spacing_mm : float, mm
        Edge of the triangles along the outline and the opening.
    growth : float
        Each ring of points round a hole is this much coarser than the one inside it.
    arc_steps : int
        Edges across the rounded edge of a border.
    """

    lattice_mm: float
    fine_curvature_per_mm: float
    rim_spacing_mm: float
    border_spacing_mm: float
    growth: float
    arc_steps: int


@dataclass(frozen=True, kw_only=True, eq=False)
class SheetMesh:
    """A closed mesh and which skin each triangle belongs to.

    Parameters
    ----------
    vertices : (n, 3) ndarray of float64, mm
        In the part's frame.
    faces : (m, 3) ndarray of int32
        Anticlockwise seen from outside the material.
    outer : (m,) ndarray of bool
        Whether the triangle belongs to the outer skin, its rounded edges included.
    """

    vertices: NDArray[np.float64]
    faces: NDArray[np.int32]
    outer: NDArray[np.bool_]


def mesh_sheet(shape: SheetShape, settings: MeshSettings) -> SheetMesh:
    """Triangulate a sheet.

    Parameters
    ----------
    shape : SheetShape
        The sheet. Holes must lie several lattice edges apart and away from its borders.
    settings : MeshSettings
        How finely.

    Returns
    -------
    SheetMesh
        Watertight; its genus is the number of holes and the opening.
    """
    loops = [
        shape.outline.outline(settings.border_spacing_mm),
        shape.opening.outline(settings.border_spacing_mm)[::-1],
    ]
    rings: list[NDArray[np.float64]] = []
    for hole in shape.holes:
        rim, *others = _rings(shape, hole, settings)
        loops.append(rim[::-1])
        rings.extend(others)
    xy = np.concatenate([*loops, *rings, _lattice(shape, settings)])
    sizes = [len(loop) for loop in loops]
    return _close(shape, xy, _triangulate(xy, sizes), sizes, settings.arc_steps)


def _ring_sizes(shape: SheetShape, hole: Hole, settings: MeshSettings) -> list[tuple[float, float]]:
    """Return the rings round a hole: radius and spacing of the points, mm, inside out."""
    radius, spacing = hole.radius_mm + shape.rim_mm, settings.rim_spacing_mm
    sizes = [(radius, spacing)]
    finest = settings.lattice_mm / 2  # of the lattice, which may bend from the last ring on
    while spacing < finest:
        spacing = min(spacing * settings.growth, finest)
        radius += spacing * math.sqrt(3) / 2
        sizes.append((radius, spacing))
    return sizes


def _rings(shape: SheetShape, hole: Hole, settings: MeshSettings) -> list[NDArray[np.float64]]:
    """Return rings of points (n, 2) round a hole, the first where the rounded edge begins.

    They are circles, or of a slot stadiums, in the hole's own plane, not in the part's (x, y)
    plane, so that a hole is round also where the sheet is tilted.
    """
    across = [
        _ring(radius, hole.straight_mm, spacing, 0.5 * (i % 2))
        for i, (radius, spacing) in enumerate(_ring_sizes(shape, hole, settings))
    ]
    ends = np.cumsum([len(ring) for ring in across])
    return np.split(_below(shape, hole, np.concatenate(across)), ends[:-1])


def _ring(radius: float, straight: float, spacing: float, shift: float) -> NDArray[np.float64]:
    """Return evenly spaced points (n, 2) at a radius round a segment along x, anticlockwise."""
    quarter = math.pi / 2 * radius
    length = 4 * quarter + 2 * straight
    count = math.ceil(length / spacing)
    at = length * (np.arange(count) + shift) / count
    back = np.clip(at - quarter, 0.0, straight)
    forth = np.clip(at - straight - 3 * quarter, 0.0, straight)
    angle = (at - back - forth) / radius
    x = straight / 2 - back + forth + radius * np.cos(angle)
    return np.stack([x, radius * np.sin(angle)], axis=1)


def _below(shape: SheetShape, hole: Hole, across_mm: NDArray[np.float64]) -> NDArray[np.float64]:
    """Find (x, y) of the skin's points that have given coordinates (n, 2) in the hole's plane."""
    frame = shape.frame(hole.centre_mm, hole.direction)
    origin, axes = frame.translation_mm, frame.rotation[:, :2]
    xy = origin[:2] + across_mm @ axes[:2].T
    for _ in range(6):  # exact at once on a pad; the crown's correction shrinks a hundredfold
        missing = across_mm - (shape.points(xy) - origin) @ axes
        xy = xy + missing @ axes[:2].T
    return np.asarray(xy)


def _lattice(shape: SheetShape, settings: MeshSettings) -> NDArray[np.float64]:
    """Return the lattice's points (n, 2), finer where the sheet bends, away from every border."""
    fine = settings.lattice_mm / 2
    low, high = shape.outline.bounds_mm()
    n_columns, n_rows = np.ceil((high - low) / (fine, fine * math.sqrt(3) / 2)).astype(int) + 1
    row, column = np.mgrid[:n_rows, :n_columns]
    xy = np.stack([column + 0.5 * (row % 2), row * math.sqrt(3) / 2], axis=-1) * fine + low
    # Every second point of every second row is the same lattice at twice the spacing.
    coarse = (row % 2 == 0) & (column % 2 == row // 2 % 2)
    height = shape.height_mm(xy.reshape(-1, 2)).reshape(row.shape)
    points = xy[coarse | _bends(height, settings.fine_curvature_per_mm * fine**2)]
    clear = 0.7 * settings.border_spacing_mm  # no point lies in the circle about a border's edge
    keep = (shape.outline.distance_mm(points) < -clear) & (
        shape.opening.distance_mm(points) > clear
    )
    for hole in shape.holes:
        outermost, spacing = _ring_sizes(shape, hole, settings)[-1]
        beyond = outermost - hole.radius_mm + 0.6 * spacing
        reach = hole.radius_mm + hole.straight_mm / 2 + beyond
        near = np.flatnonzero(np.abs(points - hole.centre_mm).max(axis=1) <= reach)
        keep[near] &= hole.distance_mm(points[near]) > beyond
    return np.asarray(points[keep])


def _bends(height: NDArray[np.float64], limit_mm: float) -> NDArray[np.bool_]:
    """Tell where a triangular lattice's heights bend: second differences along x or y."""
    bends = np.zeros(height.shape, dtype=bool)
    along = height[:, 2:] - 2 * height[:, 1:-1] + height[:, :-2]
    bends[:, 1:-1] |= np.abs(along) > limit_mm
    across = height[4:] - 2 * height[2:-2] + height[:-4]  # rows two apart: √3 spacings
    bends[2:-2] |= np.abs(across) > 3 * limit_mm
    return bends


def _triangulate(xy: NDArray[np.float64], loop_sizes: Sequence[int]) -> NDArray[np.int64]:
    """Join points; triangles that fill a hole or a dent of the outline are left out.

    Such a triangle, and no other, has all three corners on the same loop: every loop is convex, and
    neighbours inside the sheet are closer to it than its own curvature's centre.
    """
    triangles = Delaunay(xy).simplices
    loop = np.full(len(xy), -1)
    loop[: sum(loop_sizes)] = np.repeat(np.arange(len(loop_sizes)), loop_sizes)
    of = loop[triangles]
    filling = (of[:, 0] >= 0) & (of[:, 0] == of[:, 1]) & (of[:, 0] == of[:, 2])
    triangles = triangles[~filling]
    corners = xy[triangles]
    first, second = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    clockwise = first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0] < 0
    triangles[clockwise] = triangles[clockwise][:, ::-1]
    return np.asarray(triangles, dtype=np.int64)


def _close(
    shape: SheetShape,
    xy: NDArray[np.float64],
    triangles: NDArray[np.int64],
    loop_sizes: Sequence[int],
    arc_steps: int,
) -> SheetMesh:
    """Make two skins of the triangulation and join them by walls along its loops."""
    inner, normals = shape.points(xy), shape.normals(xy)
    vertices = [inner, inner + shape.thickness_mm * normals]
    # Anticlockwise in (x, y) is anticlockwise seen from +z, the outside.
    faces = [triangles[:, ::-1], triangles + len(xy)]
    outer = [np.zeros(len(triangles), dtype=bool), np.ones(len(triangles), dtype=bool)]
    n_vertices, start = 2 * len(xy), 0
    beyond_mm, depth_mm = _rim_profile(shape, arc_steps)
    for size in loop_sizes:
        loop = slice(start, start + size)
        outward = _away_from_sheet(inner[loop], normals[loop])
        rows = [np.arange(start, start + size)]
        for beyond, depth in zip(beyond_mm, depth_mm, strict=True):
            vertices.append(inner[loop] + beyond * outward + depth * normals[loop])
            rows.append(np.arange(n_vertices, n_vertices + size))
            n_vertices += size
        rows.append(rows[0] + len(xy))
        start += size
        for i, (upper, lower) in enumerate(pairwise(rows)):
            faces.append(_strip(upper, lower))
            outer.append(np.full(2 * size, i > arc_steps))
    return SheetMesh(
        vertices=np.concatenate(vertices),
        faces=np.concatenate(faces).astype(np.int32),
        outer=np.concatenate(outer),
    )


def _rim_profile(
    shape: SheetShape, arc_steps: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return how far beyond the skin's border and how deep each row of a wall lies, mm."""
    angle = np.linspace(0.0, math.pi / 2, arc_steps + 1)[1:]
    beyond = shape.rim_mm * np.sin(angle)
    depth = shape.rim_mm * (1 - np.cos(angle))
    return np.concatenate([beyond, beyond[::-1]]), np.concatenate(
        [depth, shape.thickness_mm - depth[::-1]]
    )


def _away_from_sheet(
    loop: NDArray[np.float64], normals: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the unit directions in the surface that point away from the sheet along a loop.

    Loops run with the sheet on their left, seen from outside the part.
    """
    along = np.roll(loop, -1, axis=0) - np.roll(loop, 1, axis=0)
    outward = np.cross(along, normals)
    return np.asarray(outward / np.linalg.norm(outward, axis=1, keepdims=True))


def _strip(upper: NDArray[np.int64], lower: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the triangles between two rows of a wall, seen from off the sheet."""
    upper_next, lower_next = np.roll(upper, -1), np.roll(lower, -1)
    return np.concatenate(
        [
            np.stack([upper, upper_next, lower_next], axis=1),
            np.stack([upper, lower_next, lower], axis=1),
        ]
    )
