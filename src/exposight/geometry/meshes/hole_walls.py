"""Walls of holes in closed surfaces: bands of triangles that face an axis and go once round it.

A wall ends in edges that are convex, where the hole opens, or concave, where it has a floor. So
rounded and chamfered rims, which no limit of sharpness finds, are found like sharp ones; a pin's
wall faces away from its axis.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from exposight.geometry.meshes.mesh_edges import (
    bend_deg,
    joined_faces,
    joined_points,
    smoothed_normals,
)
from exposight.geometry.meshes.mesh_mending import MendedMesh
from exposight.geometry.meshes.rim_shapes import RimShape, fit_rim
from exposight.workers import Progress, ignore_progress

_CONVEX_DEG, _MOST_CONVEX_DEG, _CONCAVE_DEG = -2.0, -7.0, 100.0
"""Triangles of one wall meet within this bend: noise, and the corners of a rectangle. Where most
of a mesh bends, as a scan does, a convex one may be 5 times the median, up to the second number."""

_MIDDLE_DEG = 35.0
"""Among triangles along one axis a convex bend of up to 30° is noise."""

_OFF_WALL_DEG = 4.0
"""By how much a wall's normals may leave the plane across its axis."""

_FACING = 0.97
"""This share of a wall's area faces its axis."""

_FLAT_DEG = 0.02
_NOISE_DEG, _SMOOTH_DEG, _SMOOTH_ROUNDS = 0.2, 20.0, 20
"""From which median bend on normals are smoothed, over which angles, and how often."""

_HOLLOW_SHARE, _HOLLOW_DEG = 0.1, 20.0
"""A wall lower than this share of its width that ends in a floor by less than this bend is a band
of a rounded hollow, not of a hole."""

_BREAK_DEG = 8.0
"""What is tilted by less than this against the surface is the surface and no rounded edge."""


@dataclass(frozen=True, kw_only=True, eq=False)
class WallEnd:
    """One end of a hole's wall.

    Parameters
    ----------
    opens : bool
        Whether the surface turns outward there; else there is a floor.
    level_mm : float
        Along the wall's axis: of the surface where it opens, of the wall's end otherwise.
    rim_mm : float
        Of the wall's end itself.
    break_mm : float
        How far a rounding, chamfer or countersink at the rim reaches beyond the wall.
    shape : RimShape
        Of the wall at this end.
    n_points : int
        Corners of the rim.
    bend_deg : float
        By how much the surface bends there, median; 0 on a border.
    """

    opens: bool
    level_mm: float
    rim_mm: float
    break_mm: float
    shape: RimShape
    n_points: int
    bend_deg: float


@dataclass(frozen=True, kw_only=True, eq=False)
class HoleWall:
    """A hole's wall.

    Parameters
    ----------
    axes : (3, 3) ndarray
        Rows: two directions across, and the axis.
    ends : tuple of WallEnd
        At the axis' far and near end.
    """

    axes: NDArray[np.float64]
    ends: tuple[WallEnd, WallEnd]


def hole_walls(
    mended: MendedMesh, progress: Progress = ignore_progress
) -> tuple[list[HoleWall], int]:
    """Return the walls of holes, slots and cutouts, and how many more are of another outline."""
    mesh, edges = mended.mesh, mended.edges
    bends = bend_deg(mesh.vertices, mended.normals, edges)
    inner = np.isfinite(bends)
    if _is_noisy(bends[inner]):
        progress("smoothing normals", 0, 0)
        normals = smoothed_normals(
            mended.normals, mended.areas, edges.sides, edges.of_faces, _SMOOTH_DEG, _SMOOTH_ROUNDS
        )
        mended = replace(mended, normals=normals)
        bends = bend_deg(mesh.vertices, normals, edges)
    usual = float(np.median(np.abs(bends[inner]))) if inner.any() else 0.0
    convex = max(min(_CONVEX_DEG, -5 * usual), _MOST_CONVEX_DEG)
    joins = inner & (bends > convex) & (bends < _CONCAVE_DEG)
    number = joined_faces(len(mesh.faces), edges.sides, joins)
    turning = np.zeros(number.max() + 1)
    concave = joins & (bends > 0.05)
    np.add.at(turning, number[edges.sides[concave, 0]], bends[concave])
    sizes = np.bincount(number, minlength=len(turning))
    # A wall turns once round: two rows of corners at least see 360° at their edges.
    chosen = np.flatnonzero((sizes >= 6) & (turning >= 300.0))
    order = np.argsort(number, kind="stable")
    starts = np.concatenate([[0], np.cumsum(sizes)])
    search = _Search(mended, bends, joins)
    walls: list[HoleWall] = []
    others = 0
    for done, one in enumerate(chosen):
        progress("searching walls", done, len(chosen))
        found, unknown = search.walls_in(order[starts[one] : starts[one + 1]])
        walls.extend(found)
        others += unknown
    progress("searching walls", len(chosen), len(chosen))
    return walls, others


def _is_noisy(bends: NDArray[np.float32]) -> bool:
    """Tell whether a surface bends everywhere and both ways, as scans do and CAD does not."""
    if not len(bends) or float(np.median(np.abs(bends))) < _NOISE_DEG:
        return False
    if float((np.abs(bends) < _FLAT_DEG).mean()) > 0.05:
        return False
    return 0.35 < float((bends > 0).mean()) < 0.65


class _Search:
    def __init__(
        self, mended: MendedMesh, bends: NDArray[np.float32], joins: NDArray[np.bool_]
    ) -> None:
        self.mended, self.bends, self.joins = mended, bends, joins
        self.local = np.full(len(mended.mesh.faces), -1, dtype=np.int32)

    def walls_in(self, faces: NDArray[np.int64]) -> tuple[list[HoleWall], int]:
        """Return the walls among some triangles that hang together."""
        others = 0
        for axis in self._axes(faces):
            normals = self.mended.normals[faces]
            across = np.abs(normals @ axis) < math.sin(math.radians(_OFF_WALL_DEG))
            if across.sum() < 6:
                continue
            walls = []
            for band in self._bands(faces[across]):
                found = self._wall(band)
                if isinstance(found, HoleWall):
                    walls.append(found)
                else:
                    others += found
            if walls:
                return walls, 0
        return [], min(others, 1)

    def _axes(self, faces: NDArray[np.int64]) -> Iterator[NDArray[np.float64]]:
        """Yield directions that may be a wall's axis, each once."""
        mesh = self.mended
        normals, areas = mesh.normals[faces], mesh.areas[faces]
        spread = (normals * areas[:, None]).T @ normals
        seen: list[NDArray[np.float64]] = []
        own = np.unique(mesh.edges.of_faces[faces])
        own = own[self.joins[own] & (self.bends[own] > 0.05)]
        ends = mesh.mesh.vertices[mesh.edges.ends[own]]
        along = ends[:, 1] - ends[:, 0]
        lengths = np.linalg.norm(along, axis=1)
        weights = lengths * self.bends[own]
        along = along / lengths[:, None]
        bent = (along * weights[:, None]).T @ along
        heavy = np.argsort(-weights, kind="stable")[:: max(1, len(weights) // 3000)][:12]
        candidates = [
            np.linalg.eigh(spread)[1][:, 0],
            np.linalg.eigh(bent)[1][:, 2],
            np.linalg.eigh(spread)[1][:, 2],
            *along[heavy],
        ]
        for axis in candidates:
            if all(abs(axis @ other) < math.cos(math.radians(2.0)) for other in seen):
                seen.append(axis)
                yield axis

    def _bands(self, faces: NDArray[np.int64]) -> Iterator[NDArray[np.int64]]:
        """Yield the sets of triangles that hang together within one wall."""
        self.local[faces] = np.arange(len(faces))
        edges = np.unique(self.mended.edges.of_faces[faces])
        edges = edges[np.abs(self.bends[edges] - _MIDDLE_DEG) < _CONCAVE_DEG - _MIDDLE_DEG]
        sides = self.local[self.mended.edges.sides[edges]]
        within = np.asarray((sides >= 0).all(axis=1))
        number = joined_faces(len(faces), sides, within)
        self.local[faces] = -1
        order = np.argsort(number, kind="stable")
        for band in np.split(order, np.cumsum(np.bincount(number))[:-1]):
            if len(band) >= 6:
                yield faces[band]

    def _wall(self, band: NDArray[np.int64]) -> HoleWall | int:
        """Return the wall that a band is; 1 for one of another outline, 0 where it is none."""
        mesh = self.mended
        normals, areas = mesh.normals[band], mesh.areas[band]
        vectors = np.linalg.eigh((normals * areas[:, None]).T @ normals)[1]
        axis = vectors[:, 0]
        axes = np.array([vectors[:, 2], np.cross(axis, vectors[:, 2]), axis])
        corners = np.unique(mesh.mesh.faces[band])
        if not self._goes_round(band, corners, normals @ axes.T):
            return 0
        local = mesh.mesh.vertices[corners] @ axes.T
        middle = (local.min(axis=0) + local.max(axis=0))[:2] / 2
        centres = mesh.mesh.vertices[mesh.mesh.faces[band]].mean(axis=1) @ axes.T
        inward = np.einsum("ij,ij->i", (normals @ axes.T)[:, :2], centres[:, :2] - middle) < 0
        if areas[inward].sum() < _FACING * areas.sum():
            return 0
        return self._with_ends(band, axes, middle)

    def _goes_round(
        self, band: NDArray[np.int64], corners: NDArray[np.int32], normals: NDArray[np.float64]
    ) -> bool:
        """Tell whether normals point to all sides and the band is closed upon itself."""
        angles = np.sort(np.arctan2(normals[:, 1], normals[:, 0]))
        gaps = np.diff(np.append(angles, angles[0] + 2 * math.pi))
        if math.degrees(gaps.max()) > _CONCAVE_DEG:
            return False
        n_edges = len(np.unique(self.mended.edges.of_faces[band]))
        return len(corners) - n_edges + len(band) <= 0  # Euler's: 0 for a ring, 1 for a sheet

    def _with_ends(
        self, band: NDArray[np.int64], axes: NDArray[np.float64], middle: NDArray[np.float64]
    ) -> HoleWall | int:
        edges = self.mended.edges
        self.local[band] = 1
        own = np.unique(edges.of_faces[band])
        inside = (edges.sides[own] >= 0) & (self.local[edges.sides[own]] == 1)
        border = own[inside.sum(axis=1) == 1]
        on_second = inside[inside.sum(axis=1) == 1][:, 1]
        ends = edges.ends[border].copy()
        # Along the way round of the wall's own triangle: which sides ends[] has run of the first.
        turned = on_second & ~edges.same_way[border]
        ends[turned] = ends[turned][:, ::-1]
        found: list[WallEnd | None] = []
        unknown = 0
        for upper in (True, False):
            loop = self._rim(ends, border, axes, middle, upper=upper)
            end = None if loop is None else self._end(*loop, axes, upper=upper)
            unknown |= loop is not None and end is None
            found.append(end)
        self.local[band] = -1
        far, near = found
        if far is None or near is None:
            return int(unknown)
        if abs(far.rim_mm - near.rim_mm) < _HOLLOW_SHARE * far.shape.width_mm and any(
            not end.opens and end.bend_deg < _HOLLOW_DEG for end in (far, near)
        ):
            return 1
        return HoleWall(axes=axes, ends=(far, near))

    def _rim(
        self,
        ends: NDArray[np.int32],
        border: NDArray[np.int64],
        axes: NDArray[np.float64],
        middle: NDArray[np.float64],
        *,
        upper: bool,
    ) -> tuple[NDArray[np.int32], NDArray[np.int64]] | None:
        """Return the edges of the loop that goes once round the axis at one end."""
        corners, local = np.unique(ends, return_inverse=True)
        local = local.reshape(-1, 2)
        loops = joined_points(len(corners), local)[local[:, 0]]
        places = self.mended.mesh.vertices[corners] @ axes.T
        away = places[:, :2] - middle
        angle = np.arctan2(away[:, 1], away[:, 0])
        step = angle[local[:, 1]] - angle[local[:, 0]]
        step = (step + math.pi) % (2 * math.pi) - math.pi
        turns = np.bincount(loops, step) / (2 * math.pi)
        # Triangles run anticlockwise seen from the axis, so that the upper end turns anticlockwise.
        wanted = np.flatnonzero(np.abs(turns - (1.0 if upper else -1.0)) < 0.1)
        if not len(wanted):
            return None
        heights = np.bincount(loops, places[local[:, 0], 2]) / np.bincount(loops)
        best = wanted[np.argmax(heights[wanted] * (1.0 if upper else -1.0))]
        return ends[loops == best], border[loops == best]

    def _end(
        self,
        ends: NDArray[np.int32],
        border: NDArray[np.int64],
        axes: NDArray[np.float64],
        *,
        upper: bool,
    ) -> WallEnd | None:
        corners, local = np.unique(ends, return_inverse=True)
        places = self.mended.mesh.vertices[corners] @ axes.T
        segments = local.reshape(-1, 2)
        shape = fit_rim(places[:, :2], segments)
        if shape is None:
            return None
        lengths = np.linalg.norm(places[segments[:, 1]] - places[segments[:, 0]], axis=1)
        bends = self.bends[border]
        concave = np.nansum(np.where(bends > 0, lengths, 0.0))
        opens = concave < 0.5 * lengths.sum()
        sign = 1.0 if upper else -1.0
        about = np.column_stack([places[:, :2] - shape.centre_mm, np.ones(len(places))])
        (_, _, level), *_ = np.linalg.lstsq(about, places[:, 2], rcond=None)
        beyond, surface = 0.0, float(level)
        if opens:
            beyond, surface = self._edge_break(border, axes, shape, float(level), sign)
        return WallEnd(
            opens=bool(opens),
            level_mm=surface,
            rim_mm=float(level),
            break_mm=beyond,
            shape=shape,
            n_points=len(corners),
            bend_deg=float(np.median(np.nan_to_num(np.abs(bends)))),
        )

    def _edge_break(
        self,
        border: NDArray[np.int64],
        axes: NDArray[np.float64],
        shape: RimShape,
        level: float,
        sign: float,
    ) -> tuple[float, float]:
        """Follow what is neither wall nor surface; return how wide it is and where it ends."""
        mesh, edges = self.mended, self.mended.edges
        reach = max(shape.width_mm, 5.0)
        least, most = (math.sin(math.radians(a)) for a in (_OFF_WALL_DEG, 90 - _BREAK_DEG))
        centre, steep = np.array([*shape.centre_mm, 0.0]), False
        front = np.unique(edges.sides[border])
        front = front[front >= 0]
        front = front[self.local[front] < 0]
        seen, tilted = [front], []
        self.local[front] = 2
        while len(front) and not steep:
            normals = mesh.normals[front] @ axes.T
            corners = mesh.mesh.vertices[mesh.mesh.faces[front]] @ axes.T
            away = corners.mean(axis=1) - centre
            rising, inward = sign * normals[:, 2], (normals * away)[:, :2].sum(axis=1) < 0
            own = (rising > least) & (rising < most) & inward
            front, corners = front[own], corners[own].reshape(-1, 3)
            # A slanting surface is not an edge's: it goes on.
            steep = len(front) > 0 and shape.beyond_mm(corners[:, :2]).max() > reach
            tilted.append(corners)
            beside = np.unique(edges.sides[edges.of_faces[front]])
            beside = beside[beside >= 0]
            front = beside[self.local[beside] < 0]
            self.local[front] = 2
            seen.append(front)
        self.local[np.concatenate(seen)] = -1
        if steep or not any(map(len, tilted)):
            return 0.0, level
        points = np.concatenate(tilted)
        rise = sign * (points[:, 2] - level)
        top = float(np.quantile(rise, 0.95))
        if not top > 0:
            return 0.0, level
        outer = points[rise > top - 0.05 * top, :2]
        beyond = float(np.median(shape.beyond_mm(outer)))
        return (beyond, level + sign * top) if beyond > 0 else (0.0, level)
