"""What is pressed into a sheet: pockets and beads, by the cross-section of their wall.

A press moves the sheet along z by what its profile says at a distance from its floor (of a bead,
from its crest).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from exposight.errors import InputError


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
            outside = np.minimum(outside, distance_to_segment(xy, start, end))
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
        return distance_to_segment(xy, np.array(self.start_mm), np.array(self.end_mm))


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


def distance_to_segment(
    xy: NDArray[np.float64], start: NDArray[np.float64], end: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the distances (n,) of points (n, 2) to a segment between two points (2,), mm."""
    along = end - start
    share = np.clip((xy - start) @ along / max(float(along @ along), 1e-12), 0.0, 1.0)
    return np.asarray(np.linalg.norm(xy - start - share[:, None] * along, axis=1))
