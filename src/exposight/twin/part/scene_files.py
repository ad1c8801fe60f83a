"""A scene as files that other programs can open: a PLY mesh, the features, the sensor.

The mesh's ``face`` element carries a property ``finish``, the number of each triangle's finish;
programs that do not know it pass over it.
"""

from __future__ import annotations

import io
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import trimesh

from exposight.cell import Part, read_features, write_features, write_sensor
from exposight.errors import DamagedFileError, FormatError, MissingFileError
from exposight.files import make_folder, write_durably
from exposight.twin.part.scene import Scene, check_scene
from exposight.twin.part.surfaces import FINISHES

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from exposight.cell import ActiveSensor


MESH_FILE, FEATURES_FILE, SENSOR_FILE = "door.ply", "features.csv", "sensor.json"

_VERTEX = np.dtype([("x", "<f8"), ("y", "<f8"), ("z", "<f8")])
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
        raise MissingFileError(msg)
    features = read_features(Path(folder) / FEATURES_FILE)
    data = path.read_bytes()
    try:
        mesh = trimesh.load_mesh(io.BytesIO(data), file_type="ply", process=False)
    except Exception as error:  # trimesh raises whatever its parser meets
        msg = f"{path} cannot be read as a PLY mesh ({error}); export it again"
        raise DamagedFileError(msg) from error
    if not isinstance(mesh, trimesh.Trimesh) or len(mesh.faces) == 0:
        msg = f"{path} holds no triangles; expected a closed triangle mesh"
        raise FormatError(msg)
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
        raise FormatError(msg) from error
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
    vertices = np.ascontiguousarray(scene.vertices, dtype="<f8").view(_VERTEX)
    return "\n".join(header).encode("ascii") + vertices.tobytes() + faces.tobytes()
