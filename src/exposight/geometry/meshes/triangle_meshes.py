"""Triangle meshes in files: PLY, STL, OBJ and GLB are read, PLY is written."""

import io
import logging
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
import trimesh
from numpy.typing import NDArray

from exposight import errors
from exposight.files import read_bytes

MESH_SUFFIXES = (".ply", ".stl", ".obj", ".glb")

MESH_UNITS_MM: Mapping[str, float] = MappingProxyType(
    {"mm": 1.0, "cm": 10.0, "m": 1000.0, "inch": 25.4}
)
"""Units of length in which meshes are written."""

_FACE = np.dtype([("count", "u1"), ("corners", "<i4", (3,)), ("finish", "u1")])
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
        A key of `MESH_UNITS_MM`; default is `unit_of`.

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
    data = read_bytes(path, "triangle mesh")
    try:
        mesh = join_meshes(_bodies(data, suffix[1:]))
    except Exception as error:  # trimesh raises whatever its parser meets
        # A file that is no binary STL is tried as text, for whose encoding a module may be missing.
        why = "damaged or cut short" if isinstance(error, ModuleNotFoundError) else error
        msg = f"{path} cannot be read as a {suffix[1:].upper()} mesh ({why}); export it again"
        raise errors.DamagedFileError(msg) from error
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
    return Mesh(
        vertices=mesh.vertices * MESH_UNITS_MM[unit or unit_of(path)],
        faces=mesh.faces[keep],
        finish=None if mesh.finish is None else mesh.finish[keep],
        colours=None if mesh.colours is None else mesh.colours[keep],
    )


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
