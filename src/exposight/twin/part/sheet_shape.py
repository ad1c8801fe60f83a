"""The shape of a pressed sheet as a height field: crown, pockets, beads, flat pads, holes, slots.

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
from exposight.geometry import RigidTransform, rotation_facing
from exposight.twin.part.presses import Press, RoundedPolygon, distance_to_segment

Side = Literal["inside", "outside"]

_SLOPE_STEP_MM = 1e-3
"""Step of the central differences that give slopes: their error is about 1e-9 on a 3 mm bend."""


@dataclass(frozen=True, kw_only=True)
class Hole:
    """A round hole or a slot through the sheet, and the feature that it is.

    Parameters
    ----------
    name : str
        The feature's name.
    x_mm, y_mm : float, mm
        Its centre on the inner skin.
    radius_mm : float, mm
        Radius of its wall; of a slot's ends.
    side : {'inside', 'outside'}
        The side it is measured from.
    orientation_deg : (float, float), degrees, optional
        (w, p) of the feature before a sensor that stands squarely before that side; the hole then
        gets a pad of its own. Without it the hole takes the sheet as it is.
    length_mm : float, mm, optional
        Overall length of a slot; without it the hole is round.
    direction_deg : float, degrees
        Direction of a slot's length, from x towards y.
    """

    name: str
    x_mm: float
    y_mm: float
    radius_mm: float
    side: Side = "inside"
    orientation_deg: tuple[float, float] | None = None
    length_mm: float | None = None
    direction_deg: float = 0.0

    @property
    def centre_mm(self) -> NDArray[np.float64]:
        """(2,) mm: the centre on the inner skin."""
        return np.array([self.x_mm, self.y_mm])

    @property
    def straight_mm(self) -> float:
        """Length of a slot's straight sides; 0 for a round hole."""
        return 0.0 if self.length_mm is None else self.length_mm - 2 * self.radius_mm

    @property
    def direction(self) -> NDArray[np.float64]:
        """(2,): unit vector along the length."""
        angle = math.radians(self.direction_deg)
        return np.array([math.cos(angle), math.sin(angle)])

    def distance_mm(self, xy: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the distance of points (n, 2) mm to its wall, negative inside."""
        end = self.straight_mm / 2 * self.direction
        to_middle = distance_to_segment(xy, self.centre_mm - end, self.centre_mm + end)
        return to_middle - self.radius_mm

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
            reach = hole.radius_mm + hole.straight_mm / 2 + self.pad_margin_mm + self.pad_blend_mm
            near = np.flatnonzero(np.abs(offset).max(axis=1) < reach)
            beyond = (hole.distance_mm(xy[near]) - self.pad_margin_mm) / self.pad_blend_mm
            share = 1.0 - _smooth_step(beyond)
            height[near] += share * (centre_height + offset[near] @ slope - height[near])
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

    def frame(
        self, centre_mm: NDArray[np.float64], direction: NDArray[np.float64] | None = None
    ) -> RigidTransform:
        """Return ``part_from_…`` at a point (2,) mm: origin on the inner skin, z into the material.

        The x axis follows a direction (2,) as seen along z; default is the part's x axis.
        """
        hint = (1.0, 0.0, 0.0) if direction is None else (*direction, 0.0)
        return RigidTransform(
            rotation=rotation_facing(self.normals(centre_mm[None])[0], hint),
            translation_mm=self.points(centre_mm[None])[0],
        )

    def feature(self, hole: Hole) -> Feature:
        """Return the feature that a hole is, in the part's frame, on the side it is seen from."""
        pose = inner = self.frame(hole.centre_mm, hole.direction)
        if hole.side == "outside":
            pose = RigidTransform(
                rotation=rotation_facing(-inner.z_axis, (*hole.direction, 0.0)),
                translation_mm=inner.translation_mm + self.thickness_mm * inner.z_axis,
            )
        slot = hole.length_mm is not None
        return Feature(
            name=hole.name,
            kind="slot" if slot else "hole",
            part_from_feature=pose,
            radius_mm=hole.radius_mm,
            length_mm=hole.length_mm,
            width_mm=2 * hole.radius_mm if slot else None,
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
