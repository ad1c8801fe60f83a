"""What meshes of others announce, held against their bytes before a library parses them.

STL is read here as a whole: its counts are all that there is to it.
"""

import io
import json
import re
import struct
from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray

MOST_CORNERS = 60_000_000
"""Of triangles in a GLB, whose nodes can show one mesh many times."""

_STL_ROW = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attributes", "<u2")])
_STL_HEAD = 84
_STL_VERTEX = re.compile(rb"^[ \t]*vertex([^\n]*)", re.MULTILINE)
_OBJ_VERTEX = re.compile(rb"^[ \t]*v[ \t]", re.MULTILINE)
_OBJ_FACE = re.compile(rb"^[ \t]*f[ \t]+([^\r\n#]*)", re.MULTILINE)
_MOST_PROPERTIES = 1000
_PLY_SIZES = {
    **dict.fromkeys(("char", "uchar", "int8", "uint8"), 1),
    **dict.fromkeys(("short", "ushort", "int16", "uint16"), 2),
    **dict.fromkeys(("int", "uint", "int32", "uint32", "float", "float32"), 4),
    **dict.fromkeys(("double", "float64"), 8),
}


def stl_corners(data: bytes) -> NDArray[np.float64]:
    """Return the corners of an STL file's triangles, (triangles, 3, 3), text or binary.

    Raises
    ------
    ValueError
        If its length is not what its header announces, and it is no whole text either.
    """
    if len(data) >= _STL_HEAD:
        (triangles,) = struct.unpack_from("<I", data, 80)
        if len(data) == _STL_HEAD + _STL_ROW.itemsize * triangles:
            rows = np.frombuffer(data, _STL_ROW, offset=_STL_HEAD)
            return np.asarray(rows["corners"], dtype=np.float64)
    text = data.lower()
    if b"\n" not in text:
        text = text.replace(b"\r", b"\n")
    if not text.lstrip().startswith(b"solid") or not text.rfind(b"endsolid") > text.rfind(
        b"vertex"
    ):
        msg = "damaged or cut short: its length is not what its header announces"
        raise ValueError(msg)
    found = _STL_VERTEX.findall(text)
    facets = text.count(b"endfacet")
    if len(found) != 3 * facets:
        msg = f"{facets} facets with {len(found)} corners"
        raise ValueError(msg)
    if not found:
        return np.empty((0, 3, 3))
    return np.loadtxt(io.BytesIO(b"\n".join(found)), ndmin=2, comments=None).reshape(-1, 3, 3)


def check_ply(data: bytes) -> None:
    """Raise ValueError where a PLY's header announces more than its bytes can hold."""
    end = data.find(b"end_header")
    if end < 0:
        msg = "no line end_header"
        raise ValueError(msg)
    head = data[:end].decode("latin-1")
    counts: list[int] = []
    least: list[int] = []
    names: set[tuple[int, str]] = set()
    for line in head.splitlines():
        words = line.split()
        if words[:1] == ["element"]:
            if len(words) != 3 or not words[2].isascii() or not words[2].isdigit():
                msg = f"expected a count in {line.strip()[:60]!r}"
                raise ValueError(msg)
            counts.append(int(words[2]))
            least.append(0)
        elif words[:1] == ["property"] and counts:
            least[-1] += _PLY_SIZES[words[2 if words[1] == "list" else 1]]
            name = len(counts), words[-1]
            if name in names or len(names) == _MOST_PROPERTIES:
                msg = f"the property {words[-1]!r} twice, or too many of them"
                raise ValueError(msg)
            names.add(name)
    there = len(data) - end
    is_text = re.search(r"^format ascii", head, re.MULTILINE) is not None
    if is_text:
        body = data[end:].strip()  # with the header's last line
        least, there = [1] * len(counts), max(body.count(b"\n"), body.count(b"\r"))
    announced = sum(count * each for count, each in zip(counts, least, strict=True))
    if announced > there:
        msg = f"its header announces {'lines' if is_text else 'bytes'} that are not there"
        raise ValueError(msg)


def check_obj(data: bytes) -> None:
    """Raise ValueError where a face of an OBJ has corners that are no vertices of it."""
    text = data.replace(b"\\\n", b" ").replace(b"\\\r\n", b" ")
    vertices = len(_OBJ_VERTEX.findall(text))
    corners = re.sub(rb"/\S*", b"", b" ".join(_OBJ_FACE.findall(text))).split()
    numbers = np.abs(np.array(corners, dtype=bytes).astype(np.int64))
    if numbers.size and not 1 <= numbers.min() <= numbers.max() <= vertices:
        msg = f"its faces must number vertices from 1 to {vertices}, or back from -1"
        raise ValueError(msg)


def check_glb(data: bytes) -> None:
    """Raise ValueError where a GLB's JSON announces what its bytes do not hold, or its nodes loop.

    Notes
    -----
    KeyError, TypeError and others are raised of a JSON that is no glTF.
    """
    magic, version, length, size, kind = struct.unpack_from("<4sIII4s", data)
    if (magic, version, kind) != (b"glTF", 2, b"JSON") or length != len(data):
        msg = "no GLB of version 2, or its length is not what its header announces"
        raise ValueError(msg)
    if 20 + size > len(data):
        msg = "cut short within its JSON"
        raise ValueError(msg)
    tree = json.loads(data[20 : 20 + size])
    there = max(len(data) - 28 - size, 0)
    views, accessors = tree.get("bufferViews", []), tree.get("accessors", [])
    for view in views:
        if not 0 <= _whole(view.get("byteOffset", 0)) <= there - _whole(view["byteLength"]):
            msg = "a part of its bytes lies beyond its end"
            raise ValueError(msg)
    for accessor in accessors:
        if "bufferView" not in accessor:
            msg = "its arrays are compressed or sparse; export it without compression"
            raise ValueError(msg)
        view = views[_whole(accessor["bufferView"])]
        # Every element takes a byte at least, and one more lies `byteStride` on.
        if _whole(accessor.get("byteOffset", 0)) + _whole(accessor["count"]) > view["byteLength"]:
            msg = f"an array of {accessor['count']} elements is not in its bytes"
            raise ValueError(msg)
    _check_nodes(tree)


def _whole(number: Any) -> int:
    if type(number) is not int or number < 0:
        msg = f"expected a count, got {str(number)[:60]}"
        raise ValueError(msg)
    return number


def _check_nodes(tree: dict[str, Any]) -> None:
    """Raise where nodes are no tree, or show more triangles than may be."""
    nodes, accessors = tree.get("nodes", []), tree.get("accessors", [])
    children = [_whole(child) for node in nodes for child in node.get("children", [])]
    roots = [_whole(root) for scene in tree.get("scenes", []) for root in scene.get("nodes", [])]
    below = set(children)
    if len(below) < len(children) or below & set(roots):
        msg = "a node of it has two parents"
        raise ValueError(msg)
    left, reached = [k for k in range(len(nodes)) if k not in below], 0
    while left:
        reached += 1
        left += nodes[left.pop()].get("children", [])
    if reached < len(nodes):
        msg = "its nodes go round in a circle"
        raise ValueError(msg)
    corners = [_corners(mesh["primitives"], accessors) for mesh in tree.get("meshes", [])]
    shown = sum(corners) + sum(corners[_whole(node["mesh"])] for node in nodes if "mesh" in node)
    if shown > 2 * MOST_CORNERS:
        msg = f"its nodes show {shown // 3} triangles; up to {MOST_CORNERS // 3} are read"
        raise ValueError(msg)


def _corners(primitives: Iterable[dict[str, Any]], accessors: list[dict[str, Any]]) -> int:
    used = (each.get("indices", each["attributes"]["POSITION"]) for each in primitives)
    return sum(int(accessors[_whole(place)]["count"]) for place in used)
