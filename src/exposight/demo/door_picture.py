"""The door as a picture of it needs it: few triangles, and where a camera looks."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial import cKDTree

from exposight.twin.part import DOOR, MeshSettings, mesh_sheet

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from exposight.geometry import PinholeCamera, RigidTransform

_COARSE = MeshSettings(
    lattice_mm=7.0,
    fine_curvature_per_mm=0.03,
    rim_spacing_mm=2.0,
    border_spacing_mm=6.0,
    growth=1.4,
    arc_steps=1,
)
"""Some 50 000 triangles for one skin: enough for a picture, and quick to draw."""

_BORDER_STEPS = 80  # points on each side of the image
_HEIGHT_ROUNDS = 4  # the sheet is nearly flat against the distance: two already settle it


@dataclass(frozen=True, kw_only=True, eq=False)
class DoorMesh:
    """The inner skin of the door.

    Parameters
    ----------
    vertices : (n, 3) ndarray of float32, mm
        In the part's frame.
    faces : (m, 3) ndarray of int32
        Anticlockwise seen from inside the car.
    """

    vertices: NDArray[np.float32]
    faces: NDArray[np.int32]


def door_mesh() -> DoorMesh:
    """Mesh the door's inner skin coarsely: the same shape, holes and all."""
    sheet = mesh_sheet(DOOR, _COARSE)
    used, faces = np.unique(sheet.faces[~sheet.outer], return_inverse=True)
    return DoorMesh(
        vertices=sheet.vertices[used].astype(np.float32),
        faces=faces.reshape(-1, 3).astype(np.int32),
    )


def field_of_view_mm(
    camera: PinholeCamera, camera_from_part: RigidTransform, mesh: DoorMesh
) -> NDArray[np.float64]:
    """Return the border of the image on the door, (n, 3) mm, a closed line.

    Beyond the door it follows the height of the door's nearest edge.

    Parameters
    ----------
    camera : PinholeCamera
        The camera.
    camera_from_part : RigidTransform
        Where the part stands.
    mesh : DoorMesh
        The door.
    """
    right, bottom = camera.width - 1.0, camera.height - 1.0
    corners = np.array([[0.0, 0.0], [right, 0.0], [right, bottom], [0.0, bottom], [0.0, 0.0]])
    steps = np.linspace(0.0, 1.0, _BORDER_STEPS)[:, None]
    border = np.concatenate([a + (b - a) * steps for a, b in pairwise(corners)])
    part_from_camera = camera_from_part.inverse()
    slopes = np.column_stack([camera.undistort(border), np.ones(len(border))])
    directions = slopes @ part_from_camera.rotation.T
    origin = part_from_camera.translation_mm
    tree, heights = cKDTree(mesh.vertices[:, :2]), mesh.vertices[:, 2].astype(np.float64)
    z = np.zeros(len(border))
    for _ in range(_HEIGHT_ROUNDS):
        points = origin + directions * ((z - origin[2]) / directions[:, 2])[:, None]
        z = heights[tree.query(points[:, :2])[1]]
    return np.asarray(points)
