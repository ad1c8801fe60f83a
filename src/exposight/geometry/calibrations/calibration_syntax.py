"""Syntax of calibration files: bytes to nested maps, lists, numbers and text.

OpenCV's YAML, XML and JSON, plain YAML, JSON and TOML, text with headings or ``name=value`` lines,
NumPy's and MATLAB's archives. Python's parsers do it, with limits: no aliases, no document types,
no pickle, nothing above `LARGEST_BYTES`. A map of rows, columns and data, and text that is a
printed matrix, become arrays; what the names mean is left to others.
"""

import json
import re
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import yaml

from exposight.errors import FormatError
from exposight.files import (
    BaseLoader,
    check_yaml,
    parse_apart,
    parse_toml,
    read_array,
    read_arrays,
)
from exposight.geometry.calibrations.printed_values import (
    DEEPEST,
    LARGEST_BYTES,
    SyntaxFault,
    Tree,
    parse_text,
    settled,
)

_MAT_PARSER = Path(__file__).with_name("mat_parser.py")


def parse_tree(data: bytes, suffix: str) -> Tree:
    """Parse a calibration file by its content, text also by its name's suffix, in lower case.

    Raises
    ------
    SyntaxFault
        If it is none of them, or cut off, or announces more or fewer numbers than it has.
    """
    if len(data) > LARGEST_BYTES:
        msg = f"{len(data) / 1e6:.1f} MB, and a calibration has less than {LARGEST_BYTES / 1e6:g}"
        raise SyntaxFault(msg)
    return _parsed(data, suffix)


def _parsed(data: bytes, suffix: str) -> Tree:
    if data.startswith((b"PK\x03\x04", b"PK\x05\x06")):
        return parse_npz(data)
    if data.startswith(b"\x93NUMPY"):
        return {"matrix": np.asarray(read_array(data, "it", "calibration"), dtype=np.float64)}
    if data.startswith((b"\x89HDF", b"MATLAB 7.3")):
        msg = "a MATLAB file of version 7.3; save it with save(…, '-v7') and toStruct(params)"
        raise SyntaxFault(msg)
    if data.startswith(b"MATLAB 5.0"):
        return parse_mat(data)
    text = _decoded(data)
    if text.startswith("<"):
        return _xml(text)
    if text.startswith('{"') or (text.startswith(("{", "[")) and suffix == ".json"):
        return _json(text)
    if text.startswith("{"):  # YAML's flow style looks alike
        try:
            return _json(text)
        except SyntaxFault:
            return _yaml_or_text(text)
    if suffix == ".toml":
        return settled(parse_toml(text, "the file", "calibration in TOML"), "matrix")
    if text.startswith("# oST") or suffix in {".ini", ".csv"}:
        return parse_text(text)
    return _yaml_or_text(text)


def _decoded(data: bytes) -> str:
    for encoding in ("utf-16",) if data[:2] in (b"\xff\xfe", b"\xfe\xff") else ("utf-8-sig",):
        try:
            text = data.decode(encoding)
        except UnicodeDecodeError:
            text = data.decode("cp1252", errors="replace")
    if "\0" in text:
        msg = "it is no text"
        raise SyntaxFault(msg)
    return text.replace("\r\n", "\n").replace("\r", "\n").lstrip()


# -- JSON, XML, YAML ----------------------------------------------------------------------------


def _once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    content: dict[str, Any] = {}
    for key, value in pairs:
        if key in content:
            msg = f"the key {key!r} is there twice"
            raise SyntaxFault(msg)
        content[key] = value
    return content


def _json(text: str) -> Tree:
    try:
        return settled(json.loads(text, object_pairs_hook=_once), "matrix")
    except json.JSONDecodeError as error:
        msg = f"line {error.lineno}: {error.msg}; was it cut off?"
        raise SyntaxFault(msg) from error


def _xml(text: str) -> Tree:
    if re.search(r"<!(DOCTYPE|ENTITY)", text, re.IGNORECASE):
        msg = "an XML file with a document type; remove its <!DOCTYPE>"
        raise SyntaxFault(msg)
    text = re.sub(r"^<\?xml[^>]*\?>", "", text)  # it is decoded already
    try:
        root = ElementTree.fromstring(text)
    except ElementTree.ParseError as error:
        msg = f"line {error.position[0]}: {str(error).partition(':')[0]}; was it cut off?"
        raise SyntaxFault(msg) from error
    if root.tag != "opencv_storage":
        msg = f"its root is <{root.tag}>, expected <opencv_storage>"
        raise SyntaxFault(msg)
    return settled(_element(root, 0) if len(root) else {}, "matrix")


def _element(element: ElementTree.Element, depth: int) -> Any:
    children = list(element)
    if depth > DEEPEST or not children:
        text = (element.text or "").strip()
        return text.strip('"')
    if all(child.tag == "_" for child in children):
        return [_element(child, depth + 1) for child in children]
    return _once([(child.tag, _element(child, depth + 1)) for child in children])


_BLOCKS = re.compile(r"^\s*(rows|cols|data|FX|CX)\s*:", re.MULTILINE)
"""Lines of matrices in YAML: what has them is no other text, however it was cut off."""


def _yaml_or_text(text: str) -> Tree:
    try:
        tree = _yaml(text)
    except (yaml.YAMLError, SyntaxFault) as fault:
        foreign = text.startswith("%YAML") or (isinstance(fault, SyntaxFault) and "!" in str(fault))
        if foreign or _BLOCKS.search(text):
            raise _yaml_fault(fault) from fault
        try:
            from_text = parse_text(text)
        except SyntaxFault as other:
            of_text = "twice" in str(other) and not isinstance(fault, SyntaxFault)
            raise (other if of_text else _yaml_fault(fault)) from fault
        if not _has_arrays(from_text):
            raise _yaml_fault(fault) from fault
        return from_text
    if isinstance(tree, dict):
        return tree
    if isinstance(tree, np.ndarray) and text.startswith(("[", "- ")):
        return {"matrix": tree}
    return parse_text(text)


def _has_arrays(tree: Tree) -> bool:
    if isinstance(tree, dict):
        return any(map(_has_arrays, tree.values()))
    return isinstance(tree, np.ndarray)


def _yaml_fault(error: Exception) -> SyntaxFault:
    if isinstance(error, SyntaxFault):
        return error
    mark = getattr(error, "context_mark", None) or getattr(error, "problem_mark", None)
    problem = getattr(error, "problem", None) or str(error)
    return SyntaxFault(f"line {mark.line + 1}: {problem}" if mark else problem)


def _yaml(text: str) -> Tree:
    """Parse the first document; OpenCV's first line is none of YAML's, and need not be there."""
    body = re.sub(
        r"^(%YAML[^\n]*\n|[ \t]*#[^\n]*\n|[ \t]*\n)+", lambda m: "\n" * m[0].count("\n"), text
    )
    body = re.sub(r"^\s*---[ \t]*(?=\n|$)", lambda m: m[0].replace("---", ""), body)
    body = body.replace("\t", "  ")
    try:
        check_yaml(body)
    except FormatError as error:
        raise SyntaxFault(str(error)) from error
    loader = BaseLoader(body)
    try:
        node = loader.get_node() if loader.check_node() else None
    finally:
        loader.dispose()
    if node is None:
        return {}
    return settled(_plain(node), "matrix")


def _plain(node: yaml.Node) -> Any:
    if "python/object" in node.tag or "python/name" in node.tag:
        msg = (
            f"line {node.start_mark.line + 1}: {node.tag.rpartition(':')[2]}! is a Python object; "
            "write arrays with .tolist()"
        )
        raise SyntaxFault(msg)
    if isinstance(node, yaml.MappingNode):
        return _once([(str(k.value), _plain(v)) for k, v in node.value])
    if isinstance(node, yaml.SequenceNode):
        return [_plain(each) for each in node.value]
    return node.value


def parse_npz(data: bytes) -> Tree:
    """Return the arrays of an .npz file."""
    arrays = read_arrays(data, "it", "calibration", kinds="biufUS", most_bytes=4 * LARGEST_BYTES)
    return {name: _of_numpy(array) for name, array in arrays.items()}


def _of_numpy(value: Any, depth: int = 0) -> Tree:
    if isinstance(value, Mapping):
        if depth > DEEPEST:
            msg = f"it is nested more than {DEEPEST} deep"
            raise SyntaxFault(msg)
        return {str(key): _of_numpy(each, depth + 1) for key, each in value.items()}
    array = np.asarray(value)
    if array.dtype.kind in "biuf":
        return float(array) if array.ndim == 0 else array.astype(np.float64)
    if array.dtype.kind in "US":
        return str(array) if array.ndim == 0 else [str(each) for each in array.reshape(-1)]
    return f"a value of the type {array.dtype}"


def parse_mat(data: bytes) -> Tree:
    """Return the variables of a .mat file up to version 7; structures are maps."""
    place, unpacked = 128, 0
    order = "little" if data[126:128] == b"IM" else "big"
    while place + 8 <= len(data):
        kind = int.from_bytes(data[place : place + 4], order)  # type: ignore[arg-type]
        length = int.from_bytes(data[place + 4 : place + 8], order)  # type: ignore[arg-type]
        if kind == 15:
            piece = zlib.decompressobj()
            packed = data[place + 8 : place + 8 + length]
            unpacked += len(piece.decompress(packed, 4 * LARGEST_BYTES))
            _check_unpacked(unpacked)
        place += 8 + length
    arrays = parse_apart(_MAT_PARSER, data, source="it", what="MATLAB file", seconds=30.0)
    return _of_described(json.loads(str(arrays["tree"])), arrays)


def _of_described(node: Any, arrays: Mapping[str, Any]) -> Tree:
    if isinstance(node, dict):
        return {name: _of_described(each, arrays) for name, each in node.items()}
    return _of_numpy(arrays[f"array{node}"])


def _check_unpacked(size: int) -> None:
    if size >= 4 * LARGEST_BYTES:
        msg = f"{size / 1e6:.0f} MB when it is unpacked, and a calibration has a few numbers"
        raise SyntaxFault(msg)
