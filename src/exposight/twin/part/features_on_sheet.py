"""Features of a sheet that are no holes: pressed pockets, balls that stand on it, points of it."""

from dataclasses import dataclass

import numpy as np
import trimesh
from numpy.typing import NDArray

from exposight.cell import Feature
from exposight.geometry import RigidTransform
from exposight.twin.part.presses import Pocket, PressProfile, RoundedPolygon
from exposight.twin.part.sheet_shape import SheetShape

_BALL_SUBDIVISIONS = 4
"""Of an icosahedron: 5120 triangles, within 0.2 % of the ball's radius."""


@dataclass(frozen=True, kw_only=True)
class PocketFeature:
    """A pocket pressed into the sheet, its length along the part's x axis.

    Parameters
    ----------
    name : str
        The feature's name.
    x_mm, y_mm : float, mm
        Its centre.
    length_mm, width_mm : float, mm
        From foot to foot of its wall, along x and y.
    floor_radius_mm : float, mm
        Radius of the corners of its floor.
    profile : PressProfile
        Of its wall.
    """

    name: str
    x_mm: float
    y_mm: float
    length_mm: float
    width_mm: float
    floor_radius_mm: float
    profile: PressProfile

    @property
    def press(self) -> Pocket:
        """What is pressed into the sheet."""
        x = self.length_mm / 2 - self.profile.width_mm
        y = self.width_mm / 2 - self.profile.width_mm
        floor = RoundedPolygon.rectangle(
            self.x_mm - x, self.x_mm + x, self.y_mm - y, self.y_mm + y, self.floor_radius_mm
        )
        return Pocket(floor=floor, profile=self.profile)

    def feature(self, shape: SheetShape) -> Feature:
        """Return the feature on a sheet that has `press`: its plane is that of the sheet round it.

        Parameters
        ----------
        shape : SheetShape
            The sheet.
        """
        floor = shape.frame(np.array([self.x_mm, self.y_mm]))
        # The floor is the sheet moved along z, so its normal is the sheet's.
        pose = RigidTransform(
            rotation=floor.rotation,
            translation_mm=floor.translation_mm - np.array([0.0, 0.0, self.profile.depth_mm]),
        )
        return Feature(
            name=self.name,
            kind="pocket",
            part_from_feature=pose,
            radius_mm=self.floor_radius_mm + self.profile.width_mm,
            length_mm=self.length_mm,
            width_mm=self.width_mm,
        )


@dataclass(frozen=True, kw_only=True)
class Ball:
    """A ball that stands on the inside, let in by half the sheet's thickness.

    Parameters
    ----------
    name : str
        The feature's name.
    x_mm, y_mm : float, mm
        Where it stands.
    radius_mm : float, mm
        Its radius.
    """

    name: str
    x_mm: float
    y_mm: float
    radius_mm: float

    def feature(self, shape: SheetShape) -> Feature:
        """Return the feature on a sheet.

        Parameters
        ----------
        shape : SheetShape
            The sheet.
        """
        foot = shape.frame(np.array([self.x_mm, self.y_mm]))
        above = self.radius_mm - shape.thickness_mm / 2
        pose = RigidTransform(
            rotation=foot.rotation, translation_mm=foot.translation_mm - above * foot.z_axis
        )
        return Feature(
            name=self.name, kind="sphere", part_from_feature=pose, radius_mm=self.radius_mm
        )

    def mesh(self, shape: SheetShape) -> tuple[NDArray[np.float64], NDArray[np.int32]]:
        """Return its surface, a closed body: vertices (n, 3) mm and triangles (m, 3).

        Parameters
        ----------
        shape : SheetShape
            The sheet.
        """
        ball = trimesh.creation.icosphere(subdivisions=_BALL_SUBDIVISIONS, radius=self.radius_mm)
        centre = self.feature(shape).part_from_feature.translation_mm
        return np.asarray(ball.vertices) + centre, np.asarray(ball.faces, dtype=np.int32)


@dataclass(frozen=True, kw_only=True)
class SurfacePoint:
    """A point of the inner skin that is measured by the disc about it.

    Parameters
    ----------
    name : str
        The feature's name.
    x_mm, y_mm : float, mm
        Where it is.
    radius_mm : float, mm
        Radius of the disc.
    """

    name: str
    x_mm: float
    y_mm: float
    radius_mm: float

    def feature(self, shape: SheetShape) -> Feature:
        """Return the feature on a sheet.

        Parameters
        ----------
        shape : SheetShape
            The sheet.
        """
        return Feature(
            name=self.name,
            kind="surface_point",
            part_from_feature=shape.frame(np.array([self.x_mm, self.y_mm])),
            radius_mm=self.radius_mm,
        )
