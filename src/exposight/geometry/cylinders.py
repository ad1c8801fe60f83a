"""Hollow cylinders about features.

Eq. 4 of the paper counts the points inside a hollow cylinder about a hole; Eqs. 6 and 7 count the
pixels of its projection at the feature's plane. Slots and pockets need the same with another
outline, so the cylinder's axis may be widened to a *core* rectangle: a point's radius is then its
distance to that rectangle. A point core gives the circular ring of a hole, a segment the stadium of
a slot, a rectangle the rounded frame of a pocket.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from exposight.errors import FeatureError
from exposight.geometry.poses import check_points

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

_ARC_POINTS = 32  # of an outline, on each of its four arcs and four straight sides


def _outline_weights() -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return what the outline's (n, 2) points take of the outer radius and of the core.

    A polygon through a circle cuts it short between its corners, so the corners lie outside, half
    a step off the axes; then the sides from one arc to the next touch the border.
    """
    step = np.pi / 2 / _ARC_POINTS
    angle = (np.arange(4 * _ARC_POINTS) + 0.5) * step
    corners = np.stack([np.cos(angle), np.sin(angle)], axis=1) / np.cos(step / 2)
    both = np.concatenate([corners, np.sign(corners)], axis=1).reshape(4, _ARC_POINTS, 4)
    sides = np.linspace(both[:, -1], np.roll(both[:, 0], -1, axis=0), _ARC_POINTS + 2, axis=1)
    weights = np.concatenate([both, sides[:, 1:-1]], axis=1).reshape(-1, 4)
    return weights[:, :2].copy(), weights[:, 2:].copy()


_OUTLINE_ROUND, _OUTLINE_CORE = _outline_weights()


@dataclass(frozen=True, kw_only=True)
class HollowCylinder:
    """The region about a feature whose points are counted, in the feature's frame.

    Parameters
    ----------
    inner_mm, outer_mm : float, mm
        Radii of the ring, both measured from the core; inner 0 gives a full cylinder.
    height_mm : float, mm
        Extent along the feature's z axis, half of it on either side of the ring's plane.
    core_half_size_mm : (float, float), mm
        Half extents of the core along the feature's x and y axes; (0, 0) for a circular ring.
    plane_z_mm : float, mm
        Where along the feature's z axis the ring's plane lies; 0 for everything flat.

    Raises
    ------
    FeatureError
        If a size is not finite, a radius or height is not positive, or inner ≥ outer.
    """

    inner_mm: float
    outer_mm: float
    height_mm: float
    core_half_size_mm: tuple[float, float] = (0.0, 0.0)
    plane_z_mm: float = 0.0

    def __post_init__(self) -> None:
        numbers = (
            self.inner_mm,
            self.outer_mm,
            self.height_mm,
            *self.core_half_size_mm,
            self.plane_z_mm,
        )
        if not np.isfinite(numbers).all():
            msg = f"the sizes of a hollow cylinder must be finite, got {numbers} mm"
            raise FeatureError(msg)
        if not 0 <= self.inner_mm < self.outer_mm or self.height_mm <= 0:
            msg = (
                "a hollow cylinder needs 0 ≤ inner < outer and a height above 0, got inner "
                f"{self.inner_mm:g}, outer {self.outer_mm:g}, height {self.height_mm:g} mm"
            )
            raise FeatureError(msg)
        if min(self.core_half_size_mm) < 0:
            msg = f"a core's half size must not be negative, got {self.core_half_size_mm} mm"
            raise FeatureError(msg)

    @property
    def bounding_radius_mm(self) -> float:
        """Radius of a sphere about the feature's origin that holds the whole cylinder."""
        across = self.outer_mm + float(np.hypot(*self.core_half_size_mm))
        along = abs(self.plane_z_mm) + self.height_mm / 2
        return float(np.hypot(across, along))

    def contains(self, points: ArrayLike) -> NDArray[np.bool_]:
        """Decide which points lie inside (Eq. 4), borders included.

        Parameters
        ----------
        points : (..., 3) array_like, mm
            Points in the feature's frame; missing ones (NaN) are outside.

        Returns
        -------
        (...) ndarray of bool

        Raises
        ------
        CloudError
            If the points are not (..., 3).
        """
        xyz = check_points(points)
        across_x = np.maximum(np.abs(xyz[..., 0]) - self.core_half_size_mm[0], 0.0)
        across_y = np.maximum(np.abs(xyz[..., 1]) - self.core_half_size_mm[1], 0.0)
        radius = np.hypot(across_x, across_y)
        along = np.abs(xyz[..., 2] - self.plane_z_mm)
        inside = (
            (radius >= self.inner_mm) & (radius <= self.outer_mm) & (along <= self.height_mm / 2)
        )
        return np.asarray(inside)

    def outline(self, z_mm: float | None = None) -> NDArray[np.float64]:
        """Return a polygon in the feature's frame that circumscribes the outer border.

        Straight sides carry points as well, as a lens bends them.

        Parameters
        ----------
        z_mm : float, mm, optional
            Where along z the polygon lies; default is the ring's plane.

        Returns
        -------
        (n, 3) ndarray, mm
        """
        xyz = np.empty((len(_OUTLINE_ROUND), 3))
        xyz[:, :2] = self.outer_mm * _OUTLINE_ROUND + self.core_half_size_mm * _OUTLINE_CORE
        xyz[:, 2] = self.plane_z_mm if z_mm is None else z_mm
        return xyz
