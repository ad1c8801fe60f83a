"""A part's mesh as people bring it, in mm: its unit is told by the file, or asked for."""

import re
import tempfile
from importlib.util import find_spec
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from exposight import errors
from exposight.files import ambiguous, current_reading, read_bytes, recognised
from exposight.geometry.meshes.triangle_meshes import MESH_SUFFIXES, MESH_UNITS_MM, Mesh, read_mesh

STEP_SUFFIXES = (".step", ".stp")
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
        {name: f"the part is {_size(size * scale)}" for name, scale in MESH_UNITS_MM.items()},
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
    import cascadio

    with tempfile.TemporaryDirectory() as folder:
        cut = Path(folder) / "part.glb"
        why: object = "no faces in it"
        try:
            why = cascadio.step_to_glb(
                str(path), str(cut), tol_linear=_CHORD_MM, tol_angular=_CHORD_RAD
            )
            if not why and cut.is_file():
                return read_mesh(cut)
        except errors.ExposightError as error:
            why = str(error).replace(str(cut), "its triangles")
        except Exception as error:  # OpenCASCADE raises whatever it meets
            why = error
    msg = f"{path} cannot be read as STEP ({why}); export it again (AP214 or AP242)"
    raise errors.DamagedFileError(msg)
