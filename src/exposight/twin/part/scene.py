"""A scene: triangles, the finish of each, and the features that are measured on them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from exposight import errors
from exposight.cell import Part
from exposight.cell.placement import check_placement, faces_under
from exposight.geometry.meshes.triangle_meshes import mesh_fault
from exposight.twin.part.corner_normals import CREASE_DEG, corner_normals
from exposight.twin.part.finishes import Finishes, Zone, finish_at, zone_table
from exposight.twin.part.surfaces import SURFACES, Surface


@dataclass(frozen=True, kw_only=True, eq=False)
class Scene:
    """What light falls on.

    Parameters
    ----------
    vertices : (n, 3) ndarray of float64, mm
        In the part's frame.
    faces : (m, 3) ndarray of int32
        Corners of the triangles: both sides of each are seen, and bodies need not be closed.
    face_finish : (m,) ndarray of uint8
        Index of each triangle's finish in `surfaces`.
    part : Part
        The part and its features.
    surfaces : mapping of str to Surface
        How each finish reflects; the order is that of the indices.
    zones : tuple of Zone
        Where the finish is another one than the triangle's.
    n_obstacle_faces : int
        So many triangles at the end are fixtures, clamps and the like: they shade and hide, and
        carry no features.
    crease_deg : float, degrees, 0 to 90
        Surfaces that meet at more than this have an edge between them (`corner_normals`).

    Raises
    ------
    InputError
        If an array has another shape, a vertex is not finite, or an index leads nowhere.
    """

    vertices: NDArray[np.float64]
    faces: NDArray[np.int32]
    face_finish: NDArray[np.uint8]
    part: Part
    surfaces: Mapping[str, Surface] = field(default_factory=lambda: SURFACES)
    zones: tuple[Zone, ...] = ()
    n_obstacle_faces: int = 0
    crease_deg: float = CREASE_DEG

    def __post_init__(self) -> None:
        for name, dtype in (("vertices", "f8"), ("faces", "i4"), ("face_finish", "u1")):
            array = np.ascontiguousarray(getattr(self, name), dtype=dtype)
            object.__setattr__(self, name, array)
        Finishes(zones=self.zones).check_names(self.surfaces)
        fault = _fault(self)
        if fault:
            msg = f"the mesh of part {self.part.name!r}: {fault}"
            raise errors.InputError(msg)

    def corner_normals(self) -> NDArray[np.float32]:
        """Return unit normals (m, 3, 3) at the triangles' corners, for shading.

        Smooth over curved faces, those of the triangles on flat ones (`corner_normals`).
        """
        return corner_normals(self.vertices, self.faces, self.crease_deg)

    def with_finishes(
        self, finishes: Finishes, face_colours: NDArray[np.uint8] | None = None
    ) -> Scene:
        """Return the scene with what a document says about its part's finish.

        Parameters
        ----------
        finishes : Finishes
            A finish of the whole part goes over this scene's zones, too.
        face_colours : (m, 3 or 4) ndarray of uint8, optional
            Red, green and blue of the triangles.

        Raises
        ------
        InputError
            As for `Finishes.of_faces`.
        """
        finish, surfaces = finishes.of_faces(
            self.face_finish, self.surfaces, face_colours, len(self.part_faces)
        )
        zones = (*(() if finishes.finish else self.zones), *finishes.zones)
        return replace(self, face_finish=finish, surfaces=surfaces, zones=zones)

    def part_with_finishes(self) -> Part:
        """Return the part whose features name the finish under most of their ring."""
        points, nearest = faces_under(self.part, self.vertices, self.part_faces)
        zones, names = zone_table(self.zones, self.surfaces), tuple(self.surfaces)
        features = []
        for feature, ring, faces in zip(self.part.features, points, nearest, strict=True):
            finishes = [
                finish_at(zones, tuple(point), self.face_finish[face])
                for point, face in zip(ring.tolist(), faces, strict=True)
                if face >= 0
            ]
            finish = names[max(finishes, key=finishes.count)] if finishes else ""
            features.append(replace(feature, finish=finish))
        return replace(self.part, features=tuple(features))

    @property
    def part_faces(self) -> NDArray[np.int32]:
        """The triangles of the part itself, without obstacles."""
        return self.faces[: len(self.faces) - self.n_obstacle_faces]


def check_scene(scene: Scene, unit: str = "mm") -> Scene:
    """Return a scene whose features all lie on its part.

    Parameters
    ----------
    scene : Scene
        To be checked.
    unit : str
        What its mesh was taken to be written in, for the message (`check_placement`).

    Raises
    ------
    FeatureError
        If a feature lies away from the part's surface.
    """
    check_placement(scene.part, scene.vertices, scene.part_faces, unit)
    return scene


def _fault(scene: Scene) -> str:
    fault = mesh_fault(scene.vertices, scene.faces)
    if fault:
        return fault
    finish, names = scene.face_finish, tuple(scene.surfaces)
    if finish.shape != (len(scene.faces),):
        return (
            f"face_finish needs one entry for each of {len(scene.faces)} faces, got {finish.shape}"
        )
    if not 0 < len(names) <= 256:
        return f"it may have from 1 to 256 surfaces, got {len(names)}"
    if finish.max() >= len(names):
        named = ", ".join(f"{i} {name}" for i, name in enumerate(names))
        return f"face_finish must be one of {named}, got {finish.max()}"
    if not 0 <= scene.n_obstacle_faces < len(scene.faces):
        return (
            f"n_obstacle_faces must leave some of {len(scene.faces)} triangles to the part, got "
            f"{scene.n_obstacle_faces}"
        )
    if not 0 <= scene.crease_deg <= 90:
        return f"crease_deg must be from 0 to 90, got {scene.crease_deg}"
    return ""
