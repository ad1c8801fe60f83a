"""The shape of a pressed sheet as a height field: crown, pockets, beads, flat pads, holes.

The sheet's inner skin is the surface z = height(x, y) of the part's frame, z pointing into the
material; the outer skin lies one thickness further along the normal. Everything is made of few
parts that a press shop knows: a *crown* (the gentle curvature of the whole), *pockets* and *beads*
(pressed in by a bend radius and a wall angle), and *pads* (flat spots of a chosen orientation round
a hole).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from exposight.cell import Feature
from exposight.errors import InputError
from exposight.geometry import RigidTransform, rotation_facing

Side = Literal["inside", "outside"]

_SLOPE_STEP_MM = 1e-3
"""Step of the central differences that give slopes: their error is about 1e-9 on a 3 mm bend."""


@dataclass(frozen=True, kw_only=True)
class Hole:
    """A round hole through the sheet, and the feature that it is.

    Parameters
    ----------
    name : str
        The feature's name.
    x_mm, y_mm : float, mm
        Its centre on the inner skin.
    radius_mm : float, mm
        Radius of its wall.
    side : {'inside', 'outside'}
        The side it is measured from.
    orientation_deg : (float, float), degrees, optional
        (w, p) of the feature before a sensor that stands squarely before that side; the hole then
        gets a pad of its own. Without it the hole takes the sheet as it is.
    """

    name: str
    x_mm: float
    y_mm: float
    radius_mm: float
    side: Side = "inside"
    orientation_deg: tuple[float, float] | None = None

    @property
    def centre_mm(self) -> NDArray[np.float64]:
        """(2,) mm: the centre on the inner skin."""
        return np.array([self.x_mm, self.y_mm])

    @property
    def pad_slope(self) -> NDArray[np.float64] | None:
        """(2,): slopes dz/dx and dz/dy of its pad, None where it has none."""
        if self.orientation_deg is None:
            return None
        w, p = np.radians(self.orientation_deg)
        # A sensor before the outside is turned by 180° about y: x and z change sign, and the
        # material lies on the other side of the surface, so only y remains turned.
        upright = -1.0 if self.side == "outside" else 1.0
        return np.array([-math.tan(p), upright * math.tan(w) / math.cos(p)])


@dataclass(frozen=True, kw_only=True)
class SheetShape:
    """A whole pressed sheet.

    Parameters
    ----------
    outline, opening : RoundedPolygon
        Outer border of the skins, and one large opening in them; the wall stands `rim_mm` beyond.
    thickness_mm : float, mm
        Of the sheet.
    rim_mm : float, mm
        Radius of the rounded edge of every border, on both skins.
    pad_margin_mm : float, mm
        How far a pad is flat beyond its hole's edge.
    pad_blend_mm : float, mm
        Width over which a pad goes over into the sheet round it.
    slope_deg : (float, float), degrees
        Slopes along x and y at the part's origin.
    crown_mm : (float, float), mm
        Radii of curvature along x and y; the sheet is convex seen from outside.
    presses : tuple of Press
        Pockets and beads; where a pad lies over one, the pad is what is there.
    holes : tuple of Hole
        Every hole.
    neighbours : tuple of Press
        Pockets and beads beside holes, pressed into their pads; none reaches a ring.
    """

    outline: RoundedPolygon
    opening: RoundedPolygon
    thickness_mm: float
    rim_mm: float
    pad_margin_mm: float
    pad_blend_mm: float
    slope_deg: tuple[float, float]
    crown_mm: tuple[float, float]
    presses: tuple[Press, ...]
    holes: tuple[Hole, ...]
    neighbours: tuple[Press, ...] = ()

    def height_mm(self, xy: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return z of the inner skin, (n,) mm, at points (n, 2) mm."""
        height = self._height_without_pads_mm(xy)
        for hole, slope, centre_height in self._pads:
            offset = xy - hole.centre_mm
            flat = hole.radius_mm + self.pad_margin_mm
            near = np.flatnonzero(np.abs(offset).max(axis=1) < flat + self.pad_blend_mm)
            offset = offset[near]
            beyond = (np.linalg.norm(offset, axis=1) - flat) / self.pad_blend_mm
            share = 1.0 - _smooth_step(beyond)
            height[near] += share * (centre_height + offset @ slope - height[near])
        _press_in(height, xy, self.neighbours)
        return height

    def normals(self, xy: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the unit normals (n, 3) into the material at points (n, 2) mm."""
        step = np.eye(2) * _SLOPE_STEP_MM
        slopes = [
            (self.height_mm(xy + d) - self.height_mm(xy - d)) / (2 * _SLOPE_STEP_MM) for d in step
        ]
        normals = np.stack([-slopes[0], -slopes[1], np.ones(len(xy))], axis=1)
        return np.asarray(normals / np.linalg.norm(normals, axis=1, keepdims=True))

    def points(self, xy: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the points (n, 3) mm of the inner skin above points (n, 2) mm."""
        return np.column_stack([xy, self.height_mm(xy)])

    def frame(self, hole: Hole) -> RigidTransform:
        """Return ``part_from_hole``: origin on the inner skin, z into the material."""
        centre = hole.centre_mm[None]
        return RigidTransform(
            rotation=rotation_facing(self.normals(centre)[0]),
            translation_mm=self.points(centre)[0],
        )

    def feature(self, hole: Hole) -> Feature:
        """Return the feature that a hole is, in the part's frame, on the side it is seen from."""
        inner = self.frame(hole)
        pose = inner
        if hole.side == "outside":
            pose = RigidTransform(
                rotation=rotation_facing(-inner.z_axis),
                translation_mm=inner.translation_mm + self.thickness_mm * inner.z_axis,
            )
        return Feature(
            name=hole.name, kind="hole", part_from_feature=pose, radius_mm=hole.radius_mm
        )

    @cached_property
    def _pads(self) -> tuple[tuple[Hole, NDArray[np.float64], float], ...]:
        """Holes with a pad, the pad's slope, and its height at the hole's centre."""
        pads = []
        for hole in self.holes:
            slope = hole.pad_slope
            if slope is not None:
                height = float(self._height_without_pads_mm(hole.centre_mm[None])[0])
                pads.append((hole, slope, height))
        return tuple(pads)

    def _height_without_pads_mm(self, xy: NDArray[np.float64]) -> NDArray[np.float64]:
        slope = np.tan(np.radians(self.slope_deg))
        height = np.asarray(xy @ slope - (xy**2) @ (0.5 / np.array(self.crown_mm)))
        _press_in(height, xy, self.presses)
        return height


def _press_in(
    height_mm: NDArray[np.float64], xy: NDArray[np.float64], presses: tuple[Press, ...]
) -> None:
    """Add to the heights (n,) at points (n, 2), mm, what presses make of them."""
    for press in presses:
        low, high = press.bounds_mm()
        reach = press.profile.width_mm
        near = np.flatnonzero(((xy > low - reach) & (xy < high + reach)).all(axis=1))
        height_mm[near] += press.profile.rise_mm(press.distance_mm(xy[near]))


def _smooth_step(share: NDArray[np.float64]) -> NDArray[np.float64]:
    """Go from 0 to 1 with no jump in slope or curvature (a quintic)."""
    s = np.clip(share, 0.0, 1.0)
    return np.asarray(s**3 * (10.0 + s * (6.0 * s - 15.0)))


@dataclass(frozen=True, kw_only=True)
class RoundedPolygon:
    """A convex polygon with rounded corners, in the part's (x, y) plane.

    Parameters
    ----------
    corners_mm : tuple of (float, float), mm
        Corners before rounding, anticlockwise or clockwise.
    radius_mm : float, mm
        Radius of the corners; the polygon must be more than twice as wide everywhere.
    """

    corners_mm: tuple[tuple[float, float], ...]
    radius_mm: float

    @classmethod
    def rectangle(
        cls, left: float, right: float, top: float, bottom: float, radius_mm: float
    ) -> RoundedPolygon:
        """Return a rounded rectangle from its four sides in mm."""
        corners = ((left, top), (right, top), (right, bottom), (left, bottom))
        return cls(corners_mm=corners, radius_mm=radius_mm)

    @cached_property
    def _corners(self) -> NDArray[np.float64]:
        """The corners with the polygon on the left of each side."""
        corners = np.array(self.corners_mm, dtype=np.float64)
        x, y = corners.T
        area = float(np.sum(x * np.roll(y, -1) - y * np.roll(x, -1)))
        return corners if area > 0 else corners[::-1]

    @cached_property
    def _outward(self) -> NDArray[np.float64]:
        """Outward unit normal of the side that begins at each corner."""
        along = np.roll(self._corners, -1, axis=0) - self._corners
        along /= np.linalg.norm(along, axis=1, keepdims=True)
        return np.stack([along[:, 1], -along[:, 0]], axis=1)

    @cached_property
    def _centres(self) -> NDArray[np.float64]:
        """Centres of the corners' arcs."""
        after, before = self._outward, np.roll(self._outward, 1, axis=0)
        levels = np.stack(
            [(normal * self._corners).sum(axis=1) - self.radius_mm for normal in (before, after)],
            axis=1,
        )
        normals = np.stack([before, after], axis=1)
        return np.asarray(np.linalg.solve(normals, levels[..., None])[..., 0])

    def bounds_mm(self) -> NDArray[np.float64]:
        """Return (2, 2) mm: the smallest and the largest x and y."""
        centres = self._centres
        return np.stack(
            [centres.min(axis=0) - self.radius_mm, centres.max(axis=0) + self.radius_mm]
        )

    def distance_mm(self, xy: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the distance of points (n, 2) mm to the border, negative inside."""
        inside = np.full(len(xy), -np.inf)
        outside = np.full(len(xy), np.inf)
        starts, ends = self._centres, np.roll(self._centres, -1, axis=0)
        for start, end, normal in zip(starts, ends, self._outward, strict=True):
            inside = np.maximum(inside, (xy - start) @ normal)
            outside = np.minimum(outside, _distance_to_segment(xy, start, end))
        return np.where(inside < 0, inside, outside) - self.radius_mm

    def outline(self, spacing_mm: float) -> NDArray[np.float64]:
        """Return points (n, 2) mm along the border, at most `spacing_mm` apart."""
        points = []
        centres, normals = self._centres, self._outward
        for i, (centre, after) in enumerate(zip(centres, normals, strict=True)):
            before = normals[i - 1]
            start = math.atan2(before[1], before[0])
            turn = math.remainder(math.atan2(after[1], after[0]) - start, 2 * math.pi)
            steps = max(math.ceil(abs(turn) * self.radius_mm / spacing_mm), 1)
            angle = start + turn * np.arange(steps) / steps
            points.append(
                centre + self.radius_mm * np.stack([np.cos(angle), np.sin(angle)], axis=1)
            )
            begin = centre + self.radius_mm * after
            side = centres[(i + 1) % len(centres)] - centre
            steps = max(math.ceil(float(np.linalg.norm(side)) / spacing_mm), 1)
            points.append(begin + side * (np.arange(steps) / steps)[:, None])
        return np.concatenate(points)


def _distance_to_segment(
    xy: NDArray[np.float64], start: NDArray[np.float64], end: NDArray[np.float64]
) -> NDArray[np.float64]:
    along = end - start
    share = np.clip((xy - start) @ along / max(float(along @ along), 1e-12), 0.0, 1.0)
    return np.asarray(np.linalg.norm(xy - start - share[:, None] * along, axis=1))


@dataclass(frozen=True, kw_only=True)
class PressProfile:
    """The cross-section of a pressed wall: an arc, a straight flank, an arc back.

    Parameters
    ----------
    depth_mm : float, mm
        How far the sheet is pressed along z: above 0 away from the inside, below 0 towards it.
    bend_mm : float, mm
        Bend radius of both arcs on the inner skin.
    wall_deg : float, degrees
        Steepness of the flank.

    Raises
    ------
    InputError
        If the two arcs alone are already deeper than the depth.
    """

    depth_mm: float
    bend_mm: float
    wall_deg: float

    def __post_init__(self) -> None:
        if self._straight_mm < 0:
            msg = (
                f"a wall of {self.wall_deg:g}° with a bend radius of {self.bend_mm:g} mm is deeper "
                f"than {abs(self.depth_mm):g} mm; lower the angle or the radius"
            )
            raise InputError(msg)

    @property
    def _arc_mm(self) -> float:
        return self.bend_mm * math.sin(math.radians(self.wall_deg))

    @property
    def _straight_mm(self) -> float:
        wall = math.radians(self.wall_deg)
        return (abs(self.depth_mm) - 2 * self._arc_drop_mm) / math.tan(wall)

    @property
    def width_mm(self) -> float:
        """Width of the wall, seen from above."""
        return 2 * self._arc_mm + self._straight_mm

    def rise_mm(self, distance_mm: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the displacement along z at distances from the edge of the pressed floor."""
        from_floor = np.clip(distance_mm, 0.0, self._arc_mm)
        from_foot = np.clip(self.width_mm - distance_mm, 0.0, self._arc_mm)
        flank = np.clip(distance_mm - self._arc_mm, 0.0, self._straight_mm)
        lost = self.bend_mm - np.sqrt(self.bend_mm**2 - from_floor**2)
        lost += flank * math.tan(math.radians(self.wall_deg))
        lost += (self._arc_drop_mm - self.bend_mm) + np.sqrt(self.bend_mm**2 - from_foot**2)
        return np.asarray(math.copysign(1.0, self.depth_mm) * (abs(self.depth_mm) - lost))

    @property
    def _arc_drop_mm(self) -> float:
        return self.bend_mm * (1 - math.cos(math.radians(self.wall_deg)))


@dataclass(frozen=True, kw_only=True)
class Pocket:
    """A flat floor pressed away from the inside, or a platform pressed towards it."""

    floor: RoundedPolygon
    profile: PressProfile

    def bounds_mm(self) -> NDArray[np.float64]:
        """Return (2, 2) mm: the smallest and the largest x and y of the floor."""
        return self.floor.bounds_mm()

    def distance_mm(self, xy: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the distance of points (n, 2) mm to the floor, at most 0 on it."""
        return self.floor.distance_mm(xy)


@dataclass(frozen=True, kw_only=True)
class Bead:
    """A straight bead with round ends; its crest runs from start to end."""

    start_mm: tuple[float, float]
    end_mm: tuple[float, float]
    profile: PressProfile

    def bounds_mm(self) -> NDArray[np.float64]:
        """Return (2, 2) mm: the smallest and the largest x and y of the crest."""
        ends = np.array([self.start_mm, self.end_mm], dtype=np.float64)
        return np.stack([ends.min(axis=0), ends.max(axis=0)])

    def distance_mm(self, xy: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the distance of points (n, 2) mm to the crest."""
        return _distance_to_segment(xy, np.array(self.start_mm), np.array(self.end_mm))


@dataclass(frozen=True, kw_only=True)
class RingBead:
    """A bead whose crest is a circle."""

    centre_mm: tuple[float, float]
    radius_mm: float
    profile: PressProfile

    def bounds_mm(self) -> NDArray[np.float64]:
        """Return (2, 2) mm: the smallest and the largest x and y of the crest."""
        centre = np.array(self.centre_mm, dtype=np.float64)
        return np.stack([centre - self.radius_mm, centre + self.radius_mm])

    def distance_mm(self, xy: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the distance of points (n, 2) mm to the crest."""
        from_centre = np.linalg.norm(xy - np.array(self.centre_mm), axis=1)
        return np.asarray(np.abs(from_centre - self.radius_mm))


Press = Pocket | Bead | RingBead
"""Something pressed into the sheet, with a profile, bounds and the distance to its floor."""
