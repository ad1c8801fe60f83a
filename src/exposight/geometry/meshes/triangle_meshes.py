"""Triangle meshes in files: PLY, STL, OBJ, GLB and STEP are read, PLY is written.

A part's unit is told by its file, or asked for.
"""

import io
import logging
import re
import tempfile
import warnings
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Self

import numpy as np
import trimesh
from numpy.typing import NDArray

from exposight import errors
from exposight.files import (
    UNITS_MM,
    ambiguous,
    current_reading,
    parse_apart,
    parsing,
    read_bytes,
    recognised,
)
from exposight.geometry.meshes.mesh_checks import check_glb, check_obj, check_ply, stl_corners

STEP_SUFFIXES = (".step", ".stp")
MESH_SUFFIXES = (".ply", ".stl", ".obj", ".glb")
PART_SUFFIXES = (*MESH_SUFFIXES, *STEP_SUFFIXES)

_CHORD_MM, _CHORD_RAD = 0.01, 0.15
"""How finely STEP is cut into triangles: by how far chords leave a curve, and by how much they
turn. Rims' corners lie on the true circle, so that radii do not suffer from either."""

_NAMED_UNIT = re.compile(
    rb"(?:\bunits?\b\s*(?:=|:|\bis\b|\bare\b|\bin\b)?\s*|\bcoordinates in )"
    rb"[\"']?(mm|millimet(?:er|re)s?|cm|centimet(?:er|re)s?|m|met(?:er|re)s?|in|inch(?:es)?)\b",
    re.IGNORECASE,
)
_HEADER_BYTES = 4096

_FACE = np.dtype([("count", "u1"), ("corners", "<i4", (3,)), ("finish", "u1")])
_CHECKS = {"ply": check_ply, "glb": check_glb, "obj": check_obj}
_STEP_PARSER = Path(__file__).with_name("step_parser.py")
_STEP_SECONDS, _STEP_SECONDS_PER_MB = 9.0, 60.0
_STEP_GB, _STEP_GB_PER_MB = 1.0, 0.2
"""Time and memory that a STEP file may take to be cut into triangles; faceted bodies take about
half of both."""
_FARTHEST = 1e9
"""Coordinate of a vertex, in any unit, up to which squares of areas are numbers."""
_FLAT = 1e-12
"""A triangle's height over its longest edge, below which it has no area."""
_logger = logging.getLogger(__name__)


@dataclass(frozen=True, kw_only=True, eq=False)
class Mesh:
    """Triangles as a file holds them, open or closed, of one body or several.

    Parameters
    ----------
    vertices : (n, 3) ndarray of float64, mm
        Several may be at the same place.
    faces : (m, 3) ndarray of int32
        Corners of the triangles, in any orientation.
    finish : (m,) ndarray of uint8, optional
        The property ``finish`` of a PLY file's faces.
    colours : (m, 4) ndarray of uint8, optional
        Red, green, blue and opacity of the triangles.
    """

    vertices: NDArray[np.float64]
    faces: NDArray[np.int32]
    finish: NDArray[np.uint8] | None = None
    colours: NDArray[np.uint8] | None = None

    def with_faces(self, chosen: NDArray[np.bool_] | NDArray[np.integer]) -> Self:
        """Return the mesh of some of its triangles."""
        return replace(
            self,
            faces=self.faces[chosen],
            finish=None if self.finish is None else self.finish[chosen],
            colours=None if self.colours is None else self.colours[chosen],
        )


def spelled(point: NDArray[np.float64]) -> str:
    """Return a point as messages show it."""
    return "(" + ", ".join(f"{number:.6g}" for number in point) + ")"


def unit_of(path: Path) -> str:
    """Return the unit that a mesh file is written in unless somebody says otherwise.

    GLB is in metres by its standard (glTF 2.0, section 3.4), the others have none and are taken to
    be in mm.
    """
    return "m" if path.suffix.lower() == ".glb" else "mm"


def mesh_fault(vertices: NDArray[np.float64], faces: NDArray[np.int32]) -> str:
    """Say what keeps arrays from being a mesh; empty where nothing does."""
    for name, array in (("vertices", vertices), ("faces", faces)):
        if array.ndim != 2 or array.shape[1] != 3 or len(array) == 0:
            return f"{name} must have the shape (n, 3) with n > 0, got {array.shape}"
    if not np.isfinite(vertices).all():
        return "every vertex must be finite, got NaN or infinity; export the mesh again"
    if np.abs(vertices).max() > _FARTHEST:
        return f"no part has vertices {np.abs(vertices).max():g} away; export the mesh again"
    if faces.min() < 0 or faces.max() >= len(vertices):
        return (
            f"faces must number vertices from 0 to {len(vertices) - 1}, got "
            f"{faces.min()} to {faces.max()}"
        )
    return ""


def read_mesh(path: Path, unit: str | None = None) -> Mesh:
    """Read the triangles of a file; all bodies in it are one mesh.

    Parameters
    ----------
    path : Path
        Its suffix, one of `MESH_SUFFIXES`, says what it is.
    unit : str, optional
        A key of `UNITS_MM`; default is `unit_of`.

    Raises
    ------
    MissingFileError, DamagedFileError
        If it is not there, or cannot be read.
    FormatError
        If it is another kind of file, holds no triangles, or they make no sense.

    Notes
    -----
    Triangles without area are left out, and logged.
    """
    suffix = path.suffix.lower()
    if suffix not in MESH_SUFFIXES:
        msg = f"{path}: a mesh ends in {', '.join(MESH_SUFFIXES)}, got {path.suffix!r}"
        raise errors.FormatError(msg)
    mesh = _parsed(read_bytes(path, "triangle mesh"), suffix[1:], path)
    scale = UNITS_MM[unit or unit_of(path)]
    return replace(mesh, vertices=mesh.vertices * scale)


def _parsed(data: bytes, file_type: str, path: Path) -> Mesh:
    """Return the triangles of a file that have an area, in its unit."""
    with parsing(path, f"{file_type.upper()} mesh"), np.errstate(all="ignore"):
        mesh = join_meshes(_bodies(data, file_type))
    if not len(mesh.faces):
        msg = f"{path} holds no triangles; expected a triangle mesh"
        raise errors.FormatError(msg)
    fault = mesh_fault(mesh.vertices, mesh.faces)
    if mesh.finish is not None and len(mesh.finish) != len(mesh.faces):
        fault = "with the property 'finish' all faces must be triangles; export the mesh again"
    if fault:
        msg = f"{path}: {fault}"
        raise errors.FormatError(msg)
    keep = _with_area(mesh.vertices, mesh.faces)
    if not keep.any():
        msg = f"{path} holds no triangle that has an area; export it again"
        raise errors.FormatError(msg)
    if not keep.all():
        _logger.warning("%s: %d triangles without area are left out", path, (~keep).sum())
    return mesh.with_faces(keep)


def read_part_mesh(path: Path, unit: str | None = None) -> Mesh:
    """Read a part's mesh in mm.

    Parameters
    ----------
    path : Path
        One of `PART_SUFFIXES`.
    unit : {'mm', 'cm', 'm', 'inch'}, optional
        What the file is written in. By default that of a comment in it, m for GLB, STEP's own; else
        the reading's, and without one it is asked for.

    Raises
    ------
    AmbiguousError
        If the file does not tell its unit.
    InputError
        If STEP, which has its own unit, is given another.
    MissingFileError, FormatError, DamagedFileError
        If it is not there, or cannot be read.
    """
    suffix = path.suffix.lower()
    if suffix not in PART_SUFFIXES:
        msg = f"{path}: a part ends in {', '.join(PART_SUFFIXES)}, got {path.suffix!r}"
        raise errors.FormatError(msg)
    if suffix in STEP_SUFFIXES:
        if unit is not None:
            msg = f"{path}: a STEP file tells its unit itself; leave out the unit {unit}"
            raise errors.InputError(msg)
        return _read_step(path)
    if suffix == ".glb":
        return read_mesh(path, unit)
    told = unit or _told_unit(path) or current_reading().unit
    if told is not None:
        return read_mesh(path, told)
    mesh = read_mesh(path, "mm")
    size = np.ptp(mesh.vertices, axis=0)
    raise ambiguous(
        path,
        f"its unit is not told ({path.suffix[1:].upper()} has none).",
        "unit",
        {name: f"the part is {_size(size * scale)}" for name, scale in UNITS_MM.items()},
    )


def _size(extents_mm: NDArray[np.float64]) -> str:
    scale, unit = (1000.0, "m") if extents_mm.max() >= 5000 else (1.0, "mm")
    return " × ".join(f"{extent / scale:.4g}" for extent in extents_mm) + f" {unit}"


def _told_unit(path: Path) -> str | None:
    """Return the unit that a comment in a file's head names."""
    head = read_bytes(path, "triangle mesh")[:_HEADER_BYTES]
    suffix = path.suffix.lower()
    if suffix == ".stl":
        lines = [head[:80]]
    elif suffix == ".ply":
        lines = [each for each in head.split(b"\n") if each.startswith((b"comment", b"obj_info"))]
    else:
        lines = [each for each in head.split(b"\n") if each.startswith(b"#")]
    units = {_unit(match.decode().lower()) for line in lines for match in _NAMED_UNIT.findall(line)}
    if len(units) > 1:
        msg = f"{path} names several units, {' and '.join(sorted(units))}: say one with --unit"
        raise errors.FormatError(msg)
    if not units:
        return None
    (unit,) = units
    if b"comment coordinates in mm" not in head:
        recognised(path, f"in {unit}, as a comment says")
    return unit


def _unit(word: str) -> str:
    if word.startswith("in"):
        return "inch"
    if word.startswith("c"):
        return "cm"
    return "mm" if word.startswith("mi") or word == "mm" else "m"


def _read_step(path: Path) -> Mesh:
    data = read_bytes(path, "STEP file")
    if not data.lstrip()[:12].upper().startswith(b"ISO-10303-21"):
        msg = f"{path}: a STEP file begins with ISO-10303-21, got {data[:20]!r}"
        raise errors.FormatError(msg)
    if b"END-ISO-10303-21" not in data[-4096:].upper():
        msg = f"{path}: the end of the STEP file, END-ISO-10303-21, is missing; copy it again"
        raise errors.DamagedFileError(msg)
    if find_spec("cascadio") is None:
        msg = (
            f"{path}: STEP needs the extra [cad]: pip install 'exposight[cad]' (cascadio); or "
            "export the part as STL, OBJ, PLY or GLB"
        )
        raise errors.FormatError(msg)
    size_mb = len(data) / 1e6
    with tempfile.TemporaryDirectory() as folder:
        cut = parse_apart(
            _STEP_PARSER,
            data,
            source=path,
            what="STEP part",
            seconds=_STEP_SECONDS + _STEP_SECONDS_PER_MB * size_mb,
            memory_gb=_STEP_GB + _STEP_GB_PER_MB * size_mb,
            folder=folder,
            chord_mm=f"{_CHORD_MM:g}",
            chord_rad=f"{_CHORD_RAD:g}",
        )
    if not len(cut["glb"]):
        msg = f"{path} holds no faces; export it again (AP214 or AP242)"
        raise errors.FormatError(msg)
    mesh = _parsed(cut["glb"].tobytes(), "glb", path)
    return replace(mesh, vertices=mesh.vertices * UNITS_MM["m"])


def join_meshes(meshes: Sequence[Mesh]) -> Mesh:
    """Return several meshes as one; finish and colours are 0 where only others have them."""
    starts = np.cumsum([0, *(len(mesh.vertices) for mesh in meshes)])
    faces = [mesh.faces + start for mesh, start in zip(meshes, starts[:-1], strict=True)]
    finish = [np.zeros(len(m.faces), np.uint8) if m.finish is None else m.finish for m in meshes]
    colours = [
        np.zeros((len(mesh.faces), 4), np.uint8) if mesh.colours is None else mesh.colours
        for mesh in meshes
    ]
    return Mesh(
        vertices=np.concatenate([np.empty((0, 3)), *(mesh.vertices for mesh in meshes)]),
        faces=np.concatenate([np.empty((0, 3)), *faces]).astype(np.int32),
        finish=np.concatenate(finish) if any(m.finish is not None for m in meshes) else None,
        colours=np.concatenate(colours) if any(m.colours is not None for m in meshes) else None,
    )


def _bodies(data: bytes, file_type: str) -> list[Mesh]:
    """Return the meshes in a file where they stand, in its unit."""
    if file_type == "stl":
        corners = stl_corners(data)
        faces = np.arange(3 * len(corners), dtype=np.int32).reshape(-1, 3)
        return [Mesh(vertices=corners.reshape(-1, 3), faces=faces)]
    if file_type in _CHECKS:
        _CHECKS[file_type](data)
    with warnings.catch_warnings():
        # numpy warns, and no more, of numbers that it cannot read.
        warnings.simplefilter("error", DeprecationWarning)
        scene = trimesh.load_scene(io.BytesIO(data), file_type=file_type, process=False)
    bodies = []
    for node in scene.graph.nodes_geometry:
        pose, name = scene.graph[node]
        body = scene.geometry[name]
        if not isinstance(body, trimesh.Trimesh) or not len(body.faces):
            continue
        ply = body.metadata.get("_ply_raw")  # what trimesh itself makes nothing of
        values = ply["face"]["data"] if ply else {}  # by name, or rows of a structured array
        named = getattr(getattr(values, "dtype", None), "names", None) or values
        finish = values["finish"] if "finish" in named else None
        bodies.append(
            Mesh(
                vertices=trimesh.transform_points(body.vertices, pose),
                faces=body.faces,
                finish=None if finish is None else np.asarray(finish, dtype=np.uint8).ravel(),
                colours=_colours(body, body.visual),
            )
        )
    return bodies


def _colours(body: trimesh.Trimesh, visual: Any) -> NDArray[np.uint8] | None:
    if visual.kind is None:
        return None
    if visual.kind != "texture":
        return np.asarray(visual.face_colors)
    of_vertices = np.asarray(visual.to_color().vertex_colors)  # or one for all
    of_vertices = np.broadcast_to(of_vertices, (len(body.vertices), 4))
    return np.asarray(of_vertices[body.faces].mean(axis=1).round(), dtype=np.uint8)


def _with_area(vertices: NDArray[np.float64], faces: NDArray[np.int32]) -> NDArray[np.bool_]:
    a, b, c = (vertices[faces[:, i]] for i in range(3))
    longest = np.max([((p - q) ** 2).sum(axis=1) for p, q in ((a, b), (b, c), (c, a))], axis=0)
    return np.asarray(np.linalg.norm(np.cross(b - a, c - a), axis=1) > _FLAT * longest)


def mesh_to_ply(
    vertices: NDArray[np.float64],
    faces: NDArray[np.int32],
    finish: NDArray[np.uint8],
    finishes: Iterable[str],
) -> bytes:
    """Return a mesh as a PLY file.

    Parameters
    ----------
    vertices : (n, 3) ndarray of float64, mm
        In the part's frame.
    faces : (m, 3) ndarray of int32
        Corners of the triangles.
    finish : (m,) ndarray of uint8
        Index of each triangle's finish.
    finishes : iterable of str
        Their names, for a comment.
    """
    named = ", ".join(f"{i} {name}" for i, name in enumerate(finishes))
    header = [
        "ply",
        "format binary_little_endian 1.0",
        "comment coordinates in mm",
        f"comment finish: {named}",
        f"element vertex {len(vertices)}",
        *(f"property double {axis}" for axis in "xyz"),
        f"element face {len(faces)}",
        "property list uchar int vertex_indices",
        "property uchar finish",
        "end_header",
        "",
    ]
    rows = np.empty(len(faces), dtype=_FACE)
    rows["count"] = 3
    rows["corners"] = faces
    rows["finish"] = finish
    coordinates = np.ascontiguousarray(vertices, dtype="<f8")
    return "\n".join(header).encode("ascii", "replace") + coordinates.tobytes() + rows.tobytes()
