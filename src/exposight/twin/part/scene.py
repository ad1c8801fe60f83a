"""A scene: a closed mesh, the finish of each triangle, and the features that are measured on it."""

from __future__ import annotations

import io
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path

import numpy as np
import trimesh
from numpy.typing import NDArray

from exposight import errors
from exposight.cell import ActiveSensor, Feature, Part, read_features, write_features, write_sensor
from exposight.files import make_folder, write_durably
from exposight.twin.part.corner_normals import corner_normals
from exposight.twin.part.finishes import Finishes, Zone
from exposight.twin.part.surfaces import FINISHES, SURFACES, Surface

_REACH_MM = 5.0
"""A feature's ring ends this far beyond its edge, so there must be mesh at least that near."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Scene:
    """What light falls on.

    Parameters
    ----------
    vertices : (n, 3) ndarray of float64, mm
        In the part's frame.
    faces : (m, 3) ndarray of int32
        Corners of the triangles, anticlockwise seen from outside the material.
    face_finish : (m,) ndarray of uint8
        Index of each triangle's finish in `surfaces`.
    part : Part
        The part and its features.
    surfaces : mapping of str to Surface
        How each finish reflects; the order is that of the indices.
    zones : tuple of Zone
        Where the finish is another one than the triangle's.

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

    def __post_init__(self) -> None:
        vertices = np.ascontiguousarray(self.vertices, dtype=np.float64)
        faces = np.ascontiguousarray(self.faces, dtype=np.int32)
        finish = np.ascontiguousarray(self.face_finish, dtype=np.uint8)
        Finishes(zones=self.zones).check_names(self.surfaces)
        fault = _fault(vertices, faces, finish, tuple(self.surfaces))
        if fault:
            msg = f"the mesh of part {self.part.name!r}: {fault}"
            raise errors.InputError(msg)
        object.__setattr__(self, "vertices", vertices)
        object.__setattr__(self, "faces", faces)
        object.__setattr__(self, "face_finish", finish)

    @cached_property
    def _face_crosses(self) -> NDArray[np.float64]:
        """(m, 3) mm²: outward normals of the triangles, twice as long as their areas."""
        a, b, c = (self.vertices[self.faces[:, i]] for i in range(3))
        return np.asarray(np.cross(b - a, c - a))

    def face_normals(self) -> NDArray[np.float64]:
        """Return the outward unit normals (m, 3) of the triangles; NaN for one without area."""
        crosses = self._face_crosses
        lengths = np.linalg.norm(crosses, axis=1, keepdims=True)
        with np.errstate(invalid="ignore"):
            return np.asarray(crosses / lengths)

    def corner_normals(self) -> NDArray[np.float32]:
        """Return unit normals (m, 3, 3) at the triangles' corners, for shading.

        Smooth over curved faces, those of the triangles on flat ones (`corner_normals`).
        """
        return corner_normals(self.vertices, self.faces)

    def with_finishes(
        self, finishes: Finishes, face_colours: NDArray[np.uint8] | None = None
    ) -> Scene:
        """Return the scene with what a document says about its finish.

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
        finish, surfaces = finishes.of_faces(self.face_finish, self.surfaces, face_colours)
        zones = (*(() if finishes.finish else self.zones), *finishes.zones)
        return replace(self, face_finish=finish, surfaces=surfaces, zones=zones)

    def volume_mm3(self) -> float:
        """Return the enclosed volume in mm³ (divergence theorem); above 0 where faces look out."""
        first = self.vertices[self.faces[:, 0]]
        return float((first * self._face_crosses).sum() / 6)


def _fault(
    vertices: NDArray[np.float64],
    faces: NDArray[np.int32],
    finish: NDArray[np.uint8],
    names: tuple[str, ...],
) -> str:
    for name, array in (("vertices", vertices), ("faces", faces)):
        if array.ndim != 2 or array.shape[1] != 3 or len(array) == 0:
            return f"{name} must have the shape (n, 3) with n > 0, got {array.shape}"
    if not np.isfinite(vertices).all():
        return "every vertex must be finite, got NaN or infinity; export the mesh again"
    if faces.min() < 0 or faces.max() >= len(vertices):
        return (
            f"faces must number vertices from 0 to {len(vertices) - 1}, got "
            f"{faces.min()} to {faces.max()}"
        )
    if finish.shape != (len(faces),):
        return f"face_finish needs one entry for each of {len(faces)} faces, got {finish.shape}"
    if not 0 < len(names) <= 256:
        return f"it may have from 1 to 256 surfaces, got {len(names)}"
    if finish.max() >= len(names):
        named = ", ".join(f"{i} {name}" for i, name in enumerate(names))
        return f"face_finish must be one of {named}, got {finish.max()}"
    return ""


def check_scene(scene: Scene) -> Scene:
    """Return a scene whose mesh is a closed body with the features on it.

    Parameters
    ----------
    scene : Scene
        To be checked.

    Raises
    ------
    InputError
        If the mesh is not watertight, its triangles do not all look outwards, or one of them has
        no area.
    FeatureError
        If a feature lies away from the mesh.
    """
    fault = _open_fault(scene.faces, len(scene.vertices))
    if not fault and scene.volume_mm3() <= 0:
        fault = "its triangles look inwards; turn all of them round"
    if not fault and not scene._face_crosses.any(axis=1).all():
        index = int(np.flatnonzero(~scene._face_crosses.any(axis=1))[0])
        fault = f"triangle {index} has no area; merge its corners"
    if fault:
        msg = f"the mesh of part {scene.part.name!r}: {fault}"
        raise errors.InputError(msg)
    for feature in scene.part.features:
        _check_on_mesh(scene, feature)
    return scene


def _open_fault(faces: NDArray[np.int32], n_vertices: int) -> str:
    """Say where a mesh is open: each directed edge must be there once, and its reverse once."""
    starts = faces.astype(np.int64).ravel()
    ends = np.roll(faces, -1, axis=1).astype(np.int64).ravel()
    forth = np.sort(starts * n_vertices + ends)
    back = np.sort(ends * n_vertices + starts)
    if np.array_equal(forth, back) and (np.diff(forth) > 0).all():
        return ""
    single = np.setdiff1d(forth, back, assume_unique=False)
    if single.size:
        start, end = divmod(int(single[0]), n_vertices)
        return (
            f"expected a watertight body, got {single.size} open edges, the first between vertices "
            f"{start} and {end}; close its holes, merge vertices at the same place, and turn all "
            "triangles outwards"
        )
    return "expected a watertight body, got edges with more than two triangles; remove doubled ones"


def _check_on_mesh(scene: Scene, feature: Feature) -> None:
    sides_mm = (feature.length_mm or 0.0, feature.width_mm or 0.0)
    reach = max(feature.radius_mm, max(sides_mm) / 2) + _REACH_MM
    offset = scene.vertices - feature.part_from_feature.translation_mm
    distance = float(np.sqrt(np.einsum("ij,ij->i", offset, offset).min()))
    if distance > reach:
        msg = (
            f"feature {feature.name!r} lies {distance:.3g} mm from the nearest vertex of part "
            f"{scene.part.name!r}, more than its ring's {reach:.3g} mm; check that mesh and "
            "features have the same frame, and are in mm"
        )
        raise errors.FeatureError(msg)


MESH_FILE, FEATURES_FILE, SENSOR_FILE = "door.ply", "features.csv", "sensor.json"

_FACE = np.dtype([("count", "u1"), ("corners", "<i4", (3,)), ("finish", "u1")])


def export_scene(folder: Path, scene: Scene, sensor: ActiveSensor) -> None:
    """Write a scene for other programs: `MESH_FILE`, `FEATURES_FILE` and `SENSOR_FILE`.

    Parameters
    ----------
    folder : Path
        Made if it is not there; files of these names are replaced.
    scene : Scene
        What to write.
    sensor : ActiveSensor
        The sensor that looks at it.

    Raises
    ------
    FileError
        If the disk refuses.
    """
    folder = make_folder(Path(folder), "a scene")
    write_durably(folder / MESH_FILE, _ply(scene))
    write_features(folder / FEATURES_FILE, scene.part.features)
    write_sensor(folder / SENSOR_FILE, sensor)


def read_scene(folder: Path, name: str = "door") -> Scene:
    """Read and check a scene that `export_scene` or another program wrote.

    Parameters
    ----------
    folder : Path
        Holds `MESH_FILE` and `FEATURES_FILE`. Without a property ``finish`` the mesh is bare.
    name : str
        The part's name.

    Raises
    ------
    MissingFileError, FormatError, DamagedFileError
        If a file is not there, or is not what it should be.
    InputError, FeatureError
        If the mesh is not watertight, or the features are not on it.
    """
    path = Path(folder) / MESH_FILE
    if not path.is_file():
        msg = f"no mesh at {path}; expected a PLY file as `export_scene` writes it"
        raise errors.MissingFileError(msg)
    features = read_features(Path(folder) / FEATURES_FILE)
    data = path.read_bytes()
    try:
        mesh = trimesh.load_mesh(io.BytesIO(data), file_type="ply", process=False)
    except Exception as error:  # trimesh raises whatever its parser meets
        msg = f"{path} cannot be read as a PLY mesh ({error}); export it again"
        raise errors.DamagedFileError(msg) from error
    if not isinstance(mesh, trimesh.Trimesh) or len(mesh.faces) == 0:
        msg = f"{path} holds no triangles; expected a closed triangle mesh"
        raise errors.FormatError(msg)
    return check_scene(
        Scene(
            vertices=mesh.vertices,
            faces=mesh.faces,
            face_finish=_finish(mesh, data, path),
            part=Part(name=name, features=features),
        )
    )


def _finish(mesh: trimesh.Trimesh, data: bytes, path: Path) -> NDArray[np.uint8]:
    """Return the finish of each triangle; bare where the file says nothing about it."""
    if b"property uchar finish" not in data[: data.find(b"end_header")]:
        return np.zeros(len(mesh.faces), dtype=np.uint8)
    try:
        finish = mesh.metadata["_ply_raw"]["face"]["data"]["finish"]
    except (KeyError, ValueError, TypeError, IndexError) as error:
        msg = f"{path}: the faces' property 'finish' cannot be read; export the mesh again"
        raise errors.FormatError(msg) from error
    return np.asarray(finish, dtype=np.uint8).ravel()


def _ply(scene: Scene) -> bytes:
    named = ", ".join(f"{i} {name}" for i, name in enumerate(FINISHES))
    header = [
        "ply",
        "format binary_little_endian 1.0",
        "comment coordinates in mm",
        f"comment finish: {named}",
        f"element vertex {len(scene.vertices)}",
        *(f"property double {axis}" for axis in "xyz"),
        f"element face {len(scene.faces)}",
        "property list uchar int vertex_indices",
        "property uchar finish",
        "end_header",
        "",
    ]
    faces = np.empty(len(scene.faces), dtype=_FACE)
    faces["count"] = 3
    faces["corners"] = scene.faces
    faces["finish"] = scene.face_finish
    vertices = np.ascontiguousarray(scene.vertices, dtype="<f8")
    return "\n".join(header).encode("ascii") + vertices.tobytes() + faces.tobytes()
