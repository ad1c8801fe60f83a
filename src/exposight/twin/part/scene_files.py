"""Scenes in files: a mesh, its features and a sensor, and a document that says which is which."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
import tomli_w
from pydantic import Field

from exposight.cell import (
    ActiveSensor,
    Part,
    read_features,
    read_sensor,
    write_features,
    write_sensor,
)
from exposight.errors import FormatError, InputError, MissingFileError
from exposight.files import (
    LARGEST_DOCUMENT,
    DocumentFormat,
    check_plain,
    make_folder,
    parse_toml,
    read_text,
    spelled,
    write_durably,
)
from exposight.geometry.meshes.triangle_meshes import (
    MESH_SUFFIXES,
    join_meshes,
    mesh_to_ply,
    read_mesh,
    unit_of,
)
from exposight.twin.part.corner_normals import CREASE_DEG
from exposight.twin.part.finishes import Finishes
from exposight.twin.part.scene import Scene, check_scene
from exposight.twin.part.surfaces import SURFACES

SCENE_FILE, FEATURES_FILE, SENSOR_FILE = "scene.toml", "features.csv", "sensor.json"


@dataclass(frozen=True, kw_only=True)
class SceneDocument(Finishes):
    """What ``scene.toml`` says, `Finishes` included; its paths begin at its folder.

    Parameters
    ----------
    mesh : str or tuple of str
        The part's mesh, or several that make it up.
    name : str, optional
        The part's name; by default that of its first mesh.
    unit : {'mm', 'cm', 'm', 'inch'}, optional
        Of all meshes; by default m for GLB and mm for the others.
    features : str, optional
        The list of features; by default ``features.csv`` or the CSV file called after the mesh.
    sensor : str, optional
        A sensor's document that belongs to the scene.
    obstacles : tuple of str
        Meshes of what shades and hides the part.
    crease_deg : float, degrees, 0 to 90
        As for `Scene`.

    Raises
    ------
    InputError
        If no mesh is named, or a finish is not known.
    """

    mesh: str | tuple[str, ...]
    name: str | None = None
    unit: Literal["mm", "cm", "m", "inch"] | None = None
    features: str | None = None
    sensor: str | None = None
    obstacles: tuple[str, ...] = ()
    crease_deg: Annotated[float, Field(ge=0, le=90)] = CREASE_DEG

    def __post_init__(self) -> None:
        super().__post_init__()
        self.check_names()
        check_plain(self.name or "", "the part", InputError)
        if not self.mesh:
            msg = "key 'mesh' must name the part's mesh"
            raise InputError(msg)

    @property
    def meshes(self) -> tuple[str, ...]:
        """All meshes of the part."""
        return (self.mesh,) if isinstance(self.mesh, str) else self.mesh


SCENE_FORMAT = DocumentFormat("exposight scene", 1, SceneDocument)


def is_scene(path: Path) -> bool:
    """Tell whether a path looks like a scene. A PLY file alone may as well be a cloud."""
    if path.is_dir():
        return (path / SCENE_FILE).is_file() or (
            (path / FEATURES_FILE).is_file() and bool(_meshes_in(path))
        )
    suffix = path.suffix.lower()
    if suffix == ".toml" and path.is_file():
        small = path.stat().st_size <= LARGEST_DOCUMENT
        return small and SCENE_FORMAT.name in path.read_text("utf-8", errors="replace")
    return suffix in MESH_SUFFIXES and suffix != ".ply"


def find_scene(path: Path) -> tuple[SceneDocument, Path]:
    """Return what a scene consists of, and the folder at which its paths begin.

    Parameters
    ----------
    path : Path
        A folder that holds `SCENE_FILE` or one mesh, a scene's document, or a mesh.

    Raises
    ------
    MissingFileError
        If there is none, or no features.
    FormatError, VersionError
        If its document is wrong, or a folder without one has several meshes.
    """
    path = Path(path)
    if path.is_dir() and not (path / SCENE_FILE).is_file():
        meshes = _meshes_in(path)
        if len(meshes) > 1:
            names = ", ".join(mesh.name for mesh in meshes)
            msg = (
                f"{path} holds several meshes, {names}: name one, or say in {path / SCENE_FILE} "
                "which are the part and which are obstacles"
            )
            raise FormatError(msg)
        path = meshes[0] if meshes else path
    if path.is_dir():
        path /= SCENE_FILE
    suffix = path.suffix.lower()
    if not path.is_file() or suffix not in (".toml", *MESH_SUFFIXES):
        msg = (
            f"no scene at {path}; expected a mesh ({', '.join(MESH_SUFFIXES)}), a folder with one, "
            f"or a document as {SCENE_FILE}; exposight simulate PLAN --export-scene FOLDER writes "
            "an example"
        )
        raise MissingFileError(msg)
    if suffix == ".toml":
        document = _read_document(path)
    else:
        sensor = SENSOR_FILE if path.with_name(SENSOR_FILE).is_file() else None
        document = SceneDocument(mesh=path.name, sensor=sensor)
    if document.features is None:
        lists = (f"{Path(document.meshes[0]).stem}.csv", FEATURES_FILE)
        features = next((name for name in lists if path.with_name(name).is_file()), None)
        if features is None:
            msg = (
                f"no features of the scene {path}; expected {' or '.join(lists)} in its folder: a "
                "plan needs features to measure (docs/formats.md, Features)"
            )
            raise MissingFileError(msg)
        document = replace(document, features=features)
    return document, path.parent


def _meshes_in(folder: Path) -> list[Path]:
    return sorted(path for path in folder.iterdir() if path.suffix.lower() in MESH_SUFFIXES)


def _read_document(path: Path) -> SceneDocument:
    raw = parse_toml(read_text(path, "scene in TOML"), path, "scene in TOML")
    return SCENE_FORMAT.from_dict(raw, str(path))


def read_scene(path: Path) -> Scene:
    """Read and check a scene of `export_scene`, of another program, or of a mesh and features.

    Parameters
    ----------
    path : Path
        As for `find_scene`. Triangles without the property ``finish`` of a PLY file are bare.

    Raises
    ------
    MissingFileError, FormatError, DamagedFileError, VersionError
        If a file is not there, or is not what it should be.
    FeatureError
        If a feature does not lie on the part.
    """
    document, folder = find_scene(path)
    first = folder / document.meshes[0]
    part, obstacles = (
        [read_mesh(folder / name, document.unit) for name in names]
        for names in (document.meshes, document.obstacles)
    )
    mesh = join_meshes([*part, *obstacles])
    bare = np.zeros(len(mesh.faces), dtype=np.uint8)
    scene = Scene(
        vertices=mesh.vertices,
        faces=mesh.faces,
        face_finish=bare if mesh.finish is None else mesh.finish,
        surfaces=document.check_names(),
        part=Part(
            name=document.name or spelled(first.stem),
            features=read_features(folder / str(document.features)),
        ),
        n_obstacle_faces=sum(len(mesh.faces) for mesh in obstacles),
        crease_deg=document.crease_deg,
    )
    try:
        scene = scene.with_finishes(document, mesh.colours)
    except InputError as error:
        msg = f"the scene {path}: {error}"
        raise FormatError(msg) from error
    return check_scene(scene, document.unit or unit_of(first))


def scene_sensor(path: Path) -> ActiveSensor | None:
    """Return the sensor that belongs to a scene, None where it names none.

    Parameters
    ----------
    path : Path
        As for `find_scene`.

    Raises
    ------
    MissingFileError, FormatError, VersionError
        As for `find_scene`, and if the sensor's document is missing or wrong.
    """
    document, folder = find_scene(path)
    return None if document.sensor is None else read_sensor(folder / document.sensor)


def exported_files(scene: Scene, *, with_sensor: bool = True) -> dict[str, str]:
    """Return what `export_scene` writes: what each file is, and its name."""
    stem = re.sub(r"[^\w.-]+", "-", scene.part.name)
    obstacles = {"obstacles": f"{stem}-obstacles.ply"} if scene.n_obstacle_faces else {}
    return {
        "scene": SCENE_FILE,
        "mesh": f"{stem}.ply",
        **obstacles,
        "features": FEATURES_FILE,
        **({"sensor": SENSOR_FILE} if with_sensor else {}),
    }


def export_scene(folder: Path, scene: Scene, sensor: ActiveSensor | None = None) -> None:
    """Write a scene for other programs, and for `read_scene`: the `exported_files`.

    Parameters
    ----------
    folder : Path
        Made if it is not there; files of these names are replaced.
    scene : Scene
        What to write.
    sensor : ActiveSensor, optional
        The sensor that looks at it.

    Raises
    ------
    FileError
        If the disk refuses.
    """
    folder = make_folder(Path(folder), "a scene")
    names = exported_files(scene, with_sensor=sensor is not None)
    further = {name: it for name, it in scene.surfaces.items() if SURFACES.get(name) != it}
    finishes = Finishes(surfaces=further, zones=scene.zones)
    numbers = {name: number for number, name in enumerate(finishes.check_names())}
    renumbered = np.array([numbers[name] for name in scene.surfaces])[scene.face_finish]
    scene = replace(scene, face_finish=renumbered, surfaces=finishes.check_names())
    n = len(scene.part_faces)
    write_durably(folder / names["mesh"], _ply(scene, slice(n)))
    if "obstacles" in names:
        write_durably(folder / names["obstacles"], _ply(scene, slice(n, None)))
    write_features(folder / FEATURES_FILE, scene.part.features)
    if sensor is not None:
        write_sensor(folder / SENSOR_FILE, sensor)
    document: dict[str, object] = {
        "format": SCENE_FORMAT.name,
        "version": SCENE_FORMAT.version,
        "name": scene.part.name,
        **{key: names[key] for key in ("mesh", "features", "sensor") if key in names},
    }
    if "obstacles" in names:
        document["obstacles"] = [names["obstacles"]]
    if scene.crease_deg != CREASE_DEG:
        document["crease_deg"] = scene.crease_deg
    document |= finishes.table()
    write_durably(folder / SCENE_FILE, tomli_w.dumps(document).encode())


def _ply(scene: Scene, which: slice) -> bytes:
    """Return some of a scene's triangles with the vertices that they need."""
    vertices, faces = scene.vertices, scene.faces[which]
    if scene.n_obstacle_faces:
        needed, corners = np.unique(faces, return_inverse=True)
        vertices, faces = vertices[needed], corners.reshape(faces.shape).astype(np.int32)
    return mesh_to_ply(vertices, faces, scene.face_finish[which], scene.surfaces)
