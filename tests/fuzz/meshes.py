"""Triangle meshes of others: STL, OBJ, PLY, GLB and STEP."""

from __future__ import annotations

import json
import struct
from collections.abc import Callable
from importlib.util import find_spec
from pathlib import Path
from random import Random

import numpy as np
import trimesh
from tests.fuzz.clouds import Fault, count_in, cut, cut_lines, line_twice, many_lines
from tests.fuzz.formats import Format, Sample
from tests.geometry.step_files import facets

from exposight.geometry.meshes.triangle_meshes import Mesh, mesh_to_ply, read_mesh, read_part_mesh


def _solid() -> trimesh.Trimesh:
    return trimesh.creation.box((30.0, 20.0, 10.0))


def _exported(*types: str) -> Callable[[Path], list[Sample]]:
    def samples(folder: Path) -> list[Sample]:
        found = []
        for file_type in types:
            path = folder / f"{file_type}.{file_type.partition('_')[0]}"
            content = _solid().export(file_type=file_type)
            path.write_bytes(content.encode() if isinstance(content, str) else content)
            found.append(Sample(path))
        return found

    return samples


def _ply_samples(folder: Path) -> list[Sample]:
    box = _solid()
    own, binary, text = (folder / f"{name}.ply" for name in ("own", "binary", "text"))
    finish = np.arange(len(box.faces), dtype=np.uint8) % 3
    own.write_bytes(mesh_to_ply(box.vertices, box.faces, finish, ["bare", "primer", "paint"]))
    binary.write_bytes(box.export(file_type="ply"))
    content = box.export(file_type="ply", encoding="ascii")
    text.write_bytes(content.encode() if isinstance(content, str) else content)
    return [Sample(own), Sample(binary), Sample(text)]


def _wrong_mesh(mesh: Mesh) -> str:
    vertices, faces = mesh.vertices, mesh.faces
    if vertices.ndim != 2 or vertices.shape[1] != 3 or not np.isfinite(vertices).all():
        return f"vertices of {vertices.shape}, or not finite"
    if faces.ndim != 2 or faces.shape[1] != 3 or not len(faces):
        return f"faces of {faces.shape}"
    if faces.min() < 0 or faces.max() >= len(vertices):
        return "faces number vertices that are not there"
    if mesh.finish is not None and mesh.finish.shape != (len(faces),):
        return "finishes do not fit the faces"
    if mesh.colours is not None and mesh.colours.shape != (len(faces), 4):
        return "colours do not fit the faces"
    return ""


def _stl_count(data: bytes, random: Random) -> bytes:
    count = random.choice((0, 11, 13, 2**31, 2**32 - 1))
    return data[:80] + struct.pack("<I", count) + data[84:]


def _face_beyond(data: bytes, random: Random) -> bytes | None:
    """Let the last face of a binary PLY with three corners number a vertex that is not there."""
    if b"ascii" in data:
        return None
    tail = 1 if b"finish" in data else 0
    corner = struct.pack("<i", random.choice((8, -1, 2**31 - 1, -(2**31))))
    end = len(data) - tail
    return data[: end - 4] + corner + data[end:]


_PLY_FAULTS: dict[str, Fault] = {
    "a count of elements that is not there": count_in(rb"element \w+ (\d+)"),
    "an element more than there is": count_in(rb"element (?:vertex|face) (\d+)", (b"13", b"14")),
    "a property twice": line_twice(rb"property (?:float|double) y\n"),
    "100 000 properties": many_lines(rb"property (?:float|double) z\n", b"property float a%d\n"),
    "a face of a vertex that is not there": _face_beyond,
    "cut off": lambda data, random: (cut_lines if b"ascii" in data else cut())(data, random),
}


# -- GLB ------------------------------------------------------------------------------------------


def _glb(data: bytes, change: Callable[[dict], None]) -> bytes:
    """Return a GLB with another JSON, whose lengths are right."""
    (length,) = struct.unpack_from("<I", data, 12)
    tree = json.loads(data[20 : 20 + length])
    change(tree)
    text = json.dumps(tree).encode()
    text += b" " * (-len(text) % 4)
    rest = data[20 + length :]
    size = struct.pack("<I", 20 + len(text) + len(rest))
    return data[:8] + size + struct.pack("<I", len(text)) + b"JSON" + text + rest


def _glb_of(change: Callable[[dict, Random], None]) -> Fault:
    return lambda data, random: _glb(data, lambda tree: change(tree, random))


def _accessor_count(tree: dict, random: Random) -> None:
    random.choice(tree["accessors"])["count"] = random.choice((-1, 0, 10**9, 2**63, 1.5))


def _accessor_without_view(tree: dict, random: Random) -> None:
    accessor = tree["accessors"][random.randrange(2)]
    del accessor["bufferView"]
    accessor["count"] = 10**9


def _cycle(tree: dict, _: Random) -> None:
    tree["nodes"].append({"children": [0], "name": "again"})
    tree["nodes"][0]["children"] = [len(tree["nodes"]) - 1]


def _doubling(tree: dict, _: Random) -> None:
    """Let 40 nodes have the next one as a child twice: 2^40 bodies."""
    start = len(tree["nodes"])
    mesh = next(each["mesh"] for each in tree["nodes"] if "mesh" in each)
    tree["nodes"] += [{"children": [start + k + 1] * 2} for k in range(40)] + [{"mesh": mesh}]
    tree["scenes"][0]["nodes"].append(start)


def _wrong_view(tree: dict, random: Random) -> None:
    view = random.choice(tree["bufferViews"])
    view[random.choice(("byteOffset", "byteLength"))] = random.choice((-4, 10**9, 2**63))


def _index_beyond(data: bytes, _: Random) -> bytes:
    """Let the first corner of the first triangle be a vertex that is not there."""
    (length,) = struct.unpack_from("<I", data, 12)
    tree = json.loads(data[20 : 20 + length])
    primitive = tree["meshes"][0]["primitives"][0]
    view = tree["bufferViews"][tree["accessors"][primitive["indices"]]["bufferView"]]
    at = 28 + length + view.get("byteOffset", 0)
    return data[:at] + b"\xff" * 4 + data[at + 4 :]


def _lengths(data: bytes, random: Random) -> bytes:
    at = random.choice((8, 12))
    return data[:at] + struct.pack("<I", random.choice((0, 7, 2**31, 2**32 - 1))) + data[at + 4 :]


_GLB_FAULTS: dict[str, Fault] = {
    "a count that is not there": _glb_of(_accessor_count),
    "a billion zeros": _glb_of(_accessor_without_view),
    "a cycle of nodes": _glb_of(_cycle),
    "nodes that double": _glb_of(_doubling),
    "bytes that are not there": _glb_of(_wrong_view),
    "a corner that is not there": _index_beyond,
    "lengths that lie": _lengths,
    "cut off": cut(),
}


def _step_samples(folder: Path) -> list[Sample]:
    path = folder / "part.step"
    box = _solid()
    path.write_text(facets(box.vertices, box.faces))
    return [Sample(path)]


def _obj_corner(data: bytes, random: Random) -> bytes | None:
    at = data.rfind(b"\nf ")
    corner = random.choice((b"9999", b"-9999", b"0", b"99999999999999999999", b"1e9"))
    return data[: at + 3] + corner + b" 1 2\n"


FORMATS: tuple[Format, ...] = (
    Format(
        "STL mesh, text", _exported("stl_ascii"), read_mesh, _wrong_mesh, {"cut off": cut_lines}
    ),
    Format(
        "STL mesh, binary",
        _exported("stl"),
        read_mesh,
        _wrong_mesh,
        {"another count": _stl_count, "cut off": cut()},
        text=False,
    ),
    Format("OBJ mesh", _exported("obj"), read_mesh, _wrong_mesh, {"a corner": _obj_corner}),
    Format("PLY mesh", _ply_samples, read_mesh, _wrong_mesh, _PLY_FAULTS),
    Format("GLB mesh", _exported("glb"), read_mesh, _wrong_mesh, _GLB_FAULTS),
)
if find_spec("cascadio") is not None:
    FORMATS += (
        Format(
            "STEP part", _step_samples, read_part_mesh, _wrong_mesh, {"cut off": cut(0)}, slow=True
        ),
    )
