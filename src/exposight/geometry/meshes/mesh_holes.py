"""Holes, slots, cutouts and balls found in a triangle mesh, without a CAD kernel."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from exposight.geometry.meshes.hole_walls import HoleWall, WallEnd, hole_walls
from exposight.geometry.meshes.mesh_edges import joined_points
from exposight.geometry.meshes.mesh_mending import MendedMesh
from exposight.geometry.meshes.rim_shapes import RimShape, fit_rim
from exposight.tables import counted
from exposight.workers import Progress, ignore_progress

Depth = Literal["through", "blind", "sheet", "ball"]

BREAK_SHARE, BREAK_MM = 0.25, 0.5
"""A rounding or chamfer no wider than this share of the radius, or this, is an edge break: the hole
has the radius of its wall. What is wider is a countersink, and its outermost circle counts."""

LEAST_MM, MOST_SHARE = 0.5, 0.4
"""Least radius of a hole, and the greatest as a share of the part's greatest extent: what is wider
is the part's own shape, as a tube's bore."""

_COAXIAL_DEG, _COAXIAL_MM, _TOUCHING_MM = 1.0, 0.05, 0.05
_BALL_RMS, _BALL_FACES = 2e-3, 60
_ALIKE_MM = 0.05


@dataclass(frozen=True, kw_only=True, eq=False)
class Opening:
    """Where a hole meets the surface, seen from one side.

    Parameters
    ----------
    hole : int
        Number of the hole; both openings of a through hole have the same.
    outline : {'circle', 'slot', 'rectangle', 'ball'}
    centre_mm : (3,) ndarray
        On the surface; of a ball its centre.
    normal : (3,) ndarray
        Outward, away from the material.
    direction : (3,) ndarray
        Of the length, in the surface.
    radius_mm, length_mm, width_mm : float
        As in `RimShape`.
    depth : {'through', 'blind', 'sheet', 'ball'}
        'sheet' where the surface has no thickness.
    depth_mm : float
        From the surface to the other side or the floor; 0 for a sheet.
    edge : str
        What is at the rim: rounded, countersunk, counterbored; empty where it is sharp.
    n_points : int
        Corners of the rim.
    rms_mm : float
        By how much they leave the outline.
    """

    hole: int
    outline: Literal["circle", "slot", "rectangle", "ball"]
    centre_mm: NDArray[np.float64]
    normal: NDArray[np.float64]
    direction: NDArray[np.float64]
    radius_mm: float
    length_mm: float
    width_mm: float
    depth: Depth
    depth_mm: float
    edge: str
    n_points: int
    rms_mm: float


@dataclass(frozen=True, kw_only=True)
class FoundHoles:
    """What was found.

    Parameters
    ----------
    openings : tuple of Opening
        By hole, then by side.
    notes : tuple of str
        What was left out, and why.
    """

    openings: tuple[Opening, ...]
    notes: tuple[str, ...]


def find_holes(
    mended: MendedMesh,
    radius_mm: tuple[float, float] | None = None,
    progress: Progress = ignore_progress,
) -> FoundHoles:
    """Find holes, slots, cutouts and balls.

    Parameters
    ----------
    mended : MendedMesh
        Of `mend_mesh`.
    radius_mm : (float, float), optional
        Half of the least and the greatest width; by default `LEAST_MM`, and `MOST_SHARE` of the
        greatest extent.
    progress : Progress

    Notes
    -----
    A hole in a solid is a wall that faces its axis and goes once round it (`hole_walls`); in a
    surface without thickness it is a border with the material outside. Coaxial walls that touch
    are one hole, of which the outermost rim is reported on each side.
    """
    extent = float(np.ptp(mended.mesh.vertices, axis=0).max())
    least, most = radius_mm or (LEAST_MM, MOST_SHARE * extent)
    walls, odd_walls = hole_walls(mended, progress)
    openings: list[Opening] = []
    for number, stack in enumerate(_stacks(walls)):
        openings.extend(_of_stack(stack, number))
    rims, odd_rims, cracks = _border_rims(mended, 1 + max((o.hole for o in openings), default=-1))
    openings.extend(rims)
    openings.extend(_balls(mended, 1 + max((o.hole for o in openings), default=-1)))
    fitting = [o for o in openings if least <= o.width_mm / 2 <= most]
    notes = []
    if odd_walls + odd_rims:
        notes.append(
            f"{counted(odd_walls + odd_rims, 'opening')} left out whose outline is no circle, slot "
            "or rectangle"
        )
    if cracks:
        notes.append(f"{counted(cracks, 'border')} of the surface are cracks or gaps, not rims")
    if len(fitting) < len(openings):
        sizes = [o.width_mm / 2 for o in openings if not least <= o.width_mm / 2 <= most]
        notes.append(
            f"{counted(len(sizes), 'opening')} left out whose radius or half width, "
            f"{min(sizes):.4g} to {max(sizes):.4g} mm, is not within {least:.4g} to {most:.4g} mm"
        )
    return FoundHoles(openings=tuple(fitting), notes=tuple(notes))


def _place(wall: HoleWall, end: WallEnd) -> NDArray[np.float64]:
    return np.array([*end.shape.centre_mm, end.level_mm]) @ wall.axes


def _rim_place(wall: HoleWall, end: WallEnd) -> NDArray[np.float64]:
    return np.array([*end.shape.centre_mm, end.rim_mm]) @ wall.axes


def _stacks(walls: Sequence[HoleWall]) -> list[list[HoleWall]]:
    """Return sets of coaxial walls of which each touches another."""
    if not walls:
        return []
    middles = np.array([(_place(w, w.ends[0]) + _place(w, w.ends[1])) / 2 for w in walls])
    axes = np.array([w.axes[2] for w in walls])
    links = []
    for i, wall in enumerate(walls):
        away = middles[i + 1 :] - middles[i]
        parallel = np.abs(axes[i + 1 :] @ axes[i]) > math.cos(math.radians(_COAXIAL_DEG))
        off = np.linalg.norm(away - np.outer(away @ axes[i], axes[i]), axis=1)
        limit = _COAXIAL_MM + 0.01 * wall.ends[0].shape.width_mm
        for other in i + 1 + np.flatnonzero(parallel & (off < limit)):
            if _touch(wall, walls[other]):
                links.append((i, other))
    sides = np.array(links, dtype=np.int32).reshape(-1, 2)
    number = joined_points(len(walls), sides)
    return [[walls[i] for i in np.flatnonzero(number == k)] for k in range(number.max() + 1)]


def _touch(one: HoleWall, other: HoleWall) -> bool:
    """Tell whether a floor of one wall is where the other opens."""
    axis = one.axes[2]
    for a in one.ends:
        for b in other.ends:
            gap = abs(float(axis @ (_rim_place(one, a) - _rim_place(other, b))))
            widths = a.break_mm + b.break_mm + abs(a.shape.width_mm - b.shape.width_mm) / 2
            if a.opens != b.opens and gap <= _TOUCHING_MM + widths:
                return True
    return False


def _of_stack(stack: list[HoleWall], number: int) -> list[Opening]:
    """Return the openings of a hole whose walls lie one behind the other."""
    axis = stack[0].axes[2]
    ends = [(wall, end) for wall in stack for end in wall.ends]
    places = np.array([float(axis @ _place(wall, end)) for wall, end in ends])
    far, near = int(np.argmax(places)), int(np.argmin(places))
    depth_mm = float(places[far] - places[near])
    through = ends[far][1].opens and ends[near][1].opens
    openings = []
    for at, outward in ((far, axis), (near, -axis)):
        wall, end = ends[at]
        if end.opens:
            depth: Depth = "through" if through else "blind"
            openings.append(
                _opening(wall, end, outward, number, depth, depth_mm, stepped=len(stack) > 1)
            )
    return openings


def _opening(
    wall: HoleWall,
    end: WallEnd,
    outward: NDArray[np.float64],
    number: int,
    depth: Depth,
    depth_mm: float,
    *,
    stepped: bool,
) -> Opening:
    shape, edge = end.shape, "counterbored" if stepped else ""
    beyond = end.break_mm
    if beyond > max(BREAK_SHARE * shape.width_mm / 2, BREAK_MM):
        edge = f"countersunk from {shape.radius_mm:.4g} mm"
        shape = replace(
            shape,
            length_mm=shape.length_mm + 2 * beyond,
            width_mm=shape.width_mm + 2 * beyond,
            radius_mm=shape.radius_mm + beyond,
        )
    elif beyond > 0.01:
        edge = f"{edge + ', ' if edge else ''}edge broken {beyond:.2g} mm"
    return replace(
        _outlined(shape, number, _place(wall, end), wall.axes, end.n_points),
        normal=outward,
        depth=depth,
        depth_mm=depth_mm,
        edge=edge,
    )


def _outlined(
    shape: RimShape,
    number: int,
    centre_mm: NDArray[np.float64],
    axes: NDArray[np.float64],
    n_points: int,
) -> Opening:
    """Return an outline across axes (3, 3), of which the last is outward, as a sheet's opening."""
    angle = shape.direction_rad
    return Opening(
        hole=number,
        outline=shape.outline,
        centre_mm=centre_mm,
        normal=axes[2],
        direction=np.array([math.cos(angle), math.sin(angle), 0.0]) @ axes,
        radius_mm=shape.radius_mm,
        length_mm=shape.length_mm,
        width_mm=shape.width_mm,
        depth="sheet",
        depth_mm=0.0,
        edge="",
        n_points=n_points,
        rms_mm=shape.rms_mm,
    )


def _border_rims(mended: MendedMesh, first: int) -> tuple[list[Opening], int, int]:
    """Return the rims of surfaces without thickness, odd ones, and cracks."""
    edges, points = mended.edges, mended.mesh.vertices
    border = np.flatnonzero(edges.n_faces == 1)
    if not len(border):
        return [], 0, 0
    corners, local = np.unique(edges.ends[border], return_inverse=True)
    local = local.reshape(-1, 2)
    loop = joined_points(len(corners), local)[local[:, 0]]
    order = np.argsort(loop, kind="stable")
    loops = np.split(order, np.cumsum(np.bincount(loop))[:-1])
    rims: list[Opening] = []
    odd = cracks = 0
    for own in loops:
        ends, faces = edges.ends[border[own]], edges.sides[border[own], 0]
        along = points[ends[:, 1]] - points[ends[:, 0]]
        around = float(np.linalg.norm(along, axis=1).sum())
        middle = points[np.unique(ends)].mean(axis=0)
        # Twice the vector area: a border runs with the material on its left.
        area = np.cross(points[ends[:, 0]] - middle, points[ends[:, 1]] - middle).sum(axis=0)
        if len(own) < 4 or np.linalg.norm(area) < 1e-3 * around**2:
            cracks += 1
            continue
        normal = mended.normals[faces].T @ mended.areas[faces]
        normal = normal / max(float(np.linalg.norm(normal)), 1e-12)
        if area @ normal > 0 or abs(area @ normal) < 0.7 * np.linalg.norm(area):
            continue  # the outer outline, or the end of a tube
        rim = _rim_on_sheet(points, ends, mended.normals[faces], first + len(rims))
        if rim is None:
            odd += 1
        else:
            rims.append(rim)
    return rims, odd, cracks


def _rim_on_sheet(
    points: NDArray[np.float64],
    ends: NDArray[np.int32],
    normals: NDArray[np.float64],
    number: int,
) -> Opening | None:
    corners, local = np.unique(ends, return_inverse=True)
    own = points[corners]
    centre = own.mean(axis=0)
    axes = np.linalg.svd(own - centre, full_matrices=False)[2]
    if axes[2] @ normals.sum(axis=0) < 0:
        axes = axes * np.array([1.0, -1.0, -1.0])[:, None]
    axes[1] = np.cross(axes[2], axes[0])
    places = (own - centre) @ axes.T
    shape = fit_rim(places[:, :2], local.reshape(-1, 2))
    if shape is None or np.abs(places[:, 2]).max() > 0.2 * shape.width_mm:
        return None
    place = centre + np.array([*shape.centre_mm, 0.0]) @ axes
    return _outlined(shape, number, place, axes, len(corners))


def _balls(mended: MendedMesh, first: int) -> list[Opening]:
    """Return closed surfaces that are spheres, as reference balls are."""
    sizes = np.bincount(mended.body, minlength=len(mended.closed))
    chosen = np.flatnonzero(mended.closed & (sizes >= _BALL_FACES))
    balls: list[Opening] = []
    order = np.argsort(mended.body, kind="stable")
    starts = np.concatenate([[0], np.cumsum(sizes)])
    for number in chosen:
        faces = mended.mesh.faces[order[starts[number] : starts[number + 1]]]
        points = mended.mesh.vertices[np.unique(faces)]
        middle = points.mean(axis=0)
        away = points - middle
        found, *_ = np.linalg.lstsq(
            np.column_stack([2 * away, np.ones(len(away))]), (away**2).sum(axis=1), rcond=None
        )
        radius = math.sqrt(max(float(found[3] + found[:3] @ found[:3]), 0.0))
        off = np.linalg.norm(away - found[:3], axis=1) - radius
        rms = float(np.sqrt(np.mean(off**2)))
        extents = np.ptp(points, axis=0)
        if rms > _BALL_RMS * radius or extents.min() < 1.9 * radius:
            continue  # a shallow cap lies on a sphere, too
        balls.append(
            Opening(
                hole=first + len(balls),
                outline="ball",
                centre_mm=middle + found[:3],
                normal=np.array([0.0, 0.0, 1.0]),
                direction=np.array([1.0, 0.0, 0.0]),
                radius_mm=radius,
                length_mm=2 * radius,
                width_mm=2 * radius,
                depth="ball",
                depth_mm=0.0,
                edge="",
                n_points=len(points),
                rms_mm=rms,
            )
        )
    return balls
