"""Syntax of calibration files: bytes to nested maps, lists, numbers and text.

OpenCV's YAML, XML and JSON, plain YAML and JSON, text with headings or ``name=value`` lines,
NumPy's and MATLAB's archives. Python's parsers do it, with limits: no aliases, no document types,
no pickle, nothing above `LARGEST_BYTES`. A map of rows, columns and data, and text that is a
printed matrix, become arrays; what the names mean is left to others.
"""

import io
import json
import re
import zipfile
import zlib
from collections.abc import Iterator, Mapping
from typing import Any, TypeAlias
from xml.etree import ElementTree

import numpy as np
import yaml
from numpy.typing import NDArray

from exposight.errors import FormatError

LARGEST_BYTES = 5_000_000
"""Larger files are no calibrations."""
_DEEPEST = 30

Tree: TypeAlias = dict[str, "Tree"] | list["Tree"] | NDArray[np.float64] | float | str
"""Maps, lists, arrays, numbers, text."""

_NUMBER = r"[-+]?(?:\d+(?:\.\d*)?|\.\d+)(?:[eE][-+]?\d+)?|[-+]?\.?(?:nan|inf(?:inity)?)"
_IS_NUMBER = re.compile(_NUMBER, re.IGNORECASE)
_NUMBERS = (
    rf"[\s\[\](,;|]*(?:{_NUMBER})(?:[\s\[\]),;|]+(?:{_NUMBER}))*[\s\[\]),;|]*"  # with brackets
)
_IS_PRINTED = re.compile(rf"(?:array\()?{_NUMBERS}", re.IGNORECASE)


class SyntaxFault(FormatError):
    """A file that cannot be parsed; the message says why, and has no path."""


def parse_tree(data: bytes, suffix: str) -> tuple[Tree, str]:
    """Parse a calibration file by its content.

    Parameters
    ----------
    data : bytes
        The file.
    suffix : str
        Of its name, in lower case; it matters for text alone.

    Returns
    -------
    Tree
        Its content.
    str
        Its syntax: OpenCV XML, JSON, YAML, text, NumPy or MATLAB.

    Raises
    ------
    SyntaxFault
        If it is none of them, or cut off, or announces more or fewer numbers than it has.
    """
    if len(data) > LARGEST_BYTES:
        msg = f"{len(data) / 1e6:.1f} MB, and a calibration has less than {LARGEST_BYTES / 1e6:g}"
        raise SyntaxFault(msg)
    try:
        return _parsed(data, suffix)
    except SyntaxFault:
        raise
    except RecursionError as error:
        msg = "it is nested too deeply"
        raise SyntaxFault(msg) from error
    except Exception as error:
        # Parsers of foreign formats raise what they like on damaged files.
        msg = f"{type(error).__name__}: {' '.join(str(error).split())[:200]}"
        raise SyntaxFault(msg) from error


def _parsed(data: bytes, suffix: str) -> tuple[Tree, str]:
    if data.startswith((b"PK\x03\x04", b"PK\x05\x06")):
        return _npz(data), "NumPy"
    if data.startswith(b"\x93NUMPY"):
        array = np.load(io.BytesIO(data), allow_pickle=False)
        return {"matrix": np.asarray(array, dtype=np.float64)}, "NumPy"
    if data.startswith((b"\x89HDF", b"MATLAB 7.3")):
        msg = "a MATLAB file of version 7.3; save it with save(…, '-v7') and toStruct(params)"
        raise SyntaxFault(msg)
    if data.startswith(b"MATLAB 5.0"):
        return _mat(data), "MATLAB"
    text = _decoded(data)
    if text.startswith("<"):
        return _xml(text), "OpenCV XML"
    if text.startswith("{") or (text.startswith("[") and suffix == ".json"):
        return _json(text), "JSON"
    if text.startswith("# oST") or suffix in {".ini", ".csv"}:
        return _text(text), "text"
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


# -- values -------------------------------------------------------------------------------------


def _scalar(text: str) -> Tree:
    """Return a number, a printed matrix, or the text itself."""
    text = text.strip()
    if _IS_NUMBER.fullmatch(text):
        return _float(text)
    if len(text) < 3 or not _IS_PRINTED.fullmatch(text):
        return text
    bare = text.removeprefix("array(")
    rows = [re.findall(_NUMBER, row, re.IGNORECASE) for row in re.split(r"[\];\n]", bare)]
    numbers = [[_float(each) for each in row] for row in rows if row]
    if len(numbers) == 1 or len({len(row) for row in numbers}) != 1:
        return np.array([each for row in numbers for each in row])
    return np.array(numbers)


def _float(text: str) -> float:
    return float(text.lower().replace(".nan", "nan").replace(".inf", "inf"))


def _matrix(rows: int, columns: int, data: NDArray[np.float64], name: str) -> NDArray[np.float64]:
    """Return numbers in rows and columns.

    A vector may have other than the announced numbers: releases of ROS wrote 5 for 8 coefficients.
    """
    data = data.reshape(-1)
    if rows == 1 and data.size in {4, 5, 8, 12, 14}:
        return data.reshape(1, -1)
    if rows * columns != data.size:
        msg = f"'{name}' announces {rows} × {columns} numbers and has {data.size}; was it cut off?"
        raise SyntaxFault(msg)
    return data.reshape(rows, columns)


def as_numbers(value: object) -> NDArray[np.float64] | None:
    """Return nested lists of numbers as an array; None for anything else."""
    if isinstance(value, np.ndarray):
        return np.asarray(value, dtype=np.float64)
    if not isinstance(value, list):
        return None
    parts = [as_numbers(each) if isinstance(each, list | np.ndarray) else each for each in value]
    if all(isinstance(each, float) for each in parts):
        return np.array(parts, dtype=np.float64)
    arrays = [each for each in parts if isinstance(each, np.ndarray)]
    if len(arrays) != len(parts) or len({each.shape for each in arrays}) != 1:
        return None
    return np.stack(arrays)


def _settled(value: Any, name: str, depth: int = 0) -> Tree:
    """Return what a parser gave as a tree: matrices as arrays, text of numbers as numbers."""
    if depth > _DEEPEST:
        msg = f"it is nested more than {_DEEPEST} deep"
        raise SyntaxFault(msg)
    if isinstance(value, Mapping):
        if (matrix := _announced(value, name, depth)) is not None:
            return matrix
        return {str(key): _settled(each, str(key), depth + 1) for key, each in value.items()}
    if isinstance(value, list | tuple):
        settled = [_settled(each, name, depth + 1) for each in value]
        if len(settled) == 1 and isinstance(settled[0], np.ndarray) and isinstance(value[0], str):
            return settled[0]  # [0.1 0.2 0.3]: numbers without commas
        numbers = as_numbers(settled)
        return settled if numbers is None else numbers
    if isinstance(value, bool) or value is None:
        return str(value)
    if isinstance(value, int | float):
        return float(value)
    if isinstance(value, str):
        return _scalar(value)
    return str(value)


def _announced(value: Mapping[str, Any], name: str, depth: int) -> NDArray[np.float64] | None:
    """Return the matrix of a map of rows, cols (or sizes) and data; None where it is none."""
    lower = {str(key).lower(): each for key, each in value.items()}
    if "data" not in lower or not ({"rows", "cols"} <= set(lower) or "sizes" in lower):
        return None
    data = as_numbers(_settled(lower["data"], name, depth + 1))
    if data is None:
        single = _settled(lower["data"], name, depth + 1)
        if not isinstance(single, float):
            msg = f"'{name}' is no matrix of numbers"
            raise SyntaxFault(msg)
        data = np.array([single])
    if "sizes" in lower:
        listed = _settled(lower["sizes"], name)
        sizes = as_numbers(listed if isinstance(listed, list | np.ndarray) else [listed])
        if sizes is None or not sizes.size:
            msg = f"'{name}' announces {lower['sizes']!r} rows and columns"
            raise SyntaxFault(msg)
        shape = np.array([_whole(each, name) for each in sizes.reshape(-1)], dtype=float)
    else:
        shape = np.array([_whole(lower["rows"], name), _whole(lower["cols"], name)], dtype=float)
    channels = re.fullmatch(r"(\d*)[a-z]", str(lower.get("dt", "d")))
    if channels is None:
        msg = f"'{name}' is of the type {lower['dt']!r}; expected one kind of number, such as d"
        raise SyntaxFault(msg)
    if shape.size == 1:
        shape = np.append(shape, 1.0)
    columns = int(np.prod(shape[1:])) * int(channels[1] or 1)
    return _matrix(int(shape[0]), columns, data, name)


def _whole(value: object, name: str) -> int:
    number = _scalar(str(value))
    if not isinstance(number, float) or number != int(number) or not 0 <= number <= 1e6:
        msg = f"'{name}' announces {value!r} rows or columns"
        raise SyntaxFault(msg)
    return int(number)


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
        return _settled(json.loads(text, object_pairs_hook=_once), "matrix")
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
    return _settled(_element(root, 0) if len(root) else {}, "matrix")


def _element(element: ElementTree.Element, depth: int) -> Any:
    children = list(element)
    if depth > _DEEPEST or not children:
        text = (element.text or "").strip()
        return text.strip('"')
    if all(child.tag == "_" for child in children):
        return [_element(child, depth + 1) for child in children]
    return _once([(child.tag, _element(child, depth + 1)) for child in children])


def _yaml_or_text(text: str) -> tuple[Tree, str]:
    try:
        tree = _yaml(text)
    except (yaml.YAMLError, SyntaxFault) as fault:
        if text.startswith("%YAML") or (isinstance(fault, SyntaxFault) and "!" in str(fault)):
            raise _yaml_fault(fault) from fault
        try:
            from_text = _text(text)
        except SyntaxFault:
            raise _yaml_fault(fault) from fault
        if not _has_arrays(from_text):
            raise _yaml_fault(fault) from fault
        return from_text, "text"
    if isinstance(tree, dict):
        return tree, "YAML"
    if isinstance(tree, np.ndarray):
        return {"matrix": tree}, "YAML"
    return _text(text), "text"


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
    loader = yaml.BaseLoader(body.replace("\t", "  "))
    try:
        node = loader.get_node() if loader.check_node() else None
    finally:
        loader.dispose()
    if node is None:
        return {}
    return _settled(_plain(node, set(), 0), "matrix")


def _plain(node: yaml.Node, seen: set[int], depth: int) -> Any:
    if depth > _DEEPEST:
        msg = f"it is nested more than {_DEEPEST} deep"
        raise SyntaxFault(msg)
    if id(node) in seen:
        msg = f"line {node.start_mark.line + 1}: an alias; write out what it stands for"
        raise SyntaxFault(msg)
    seen.add(id(node))
    if "python/object" in node.tag or "python/name" in node.tag:
        msg = (
            f"line {node.start_mark.line + 1}: {node.tag.rpartition(':')[2]}! is a Python object; "
            "write arrays with .tolist()"
        )
        raise SyntaxFault(msg)
    if isinstance(node, yaml.MappingNode):
        if any(key.value == "<<" for key, _ in node.value):
            msg = f"line {node.start_mark.line + 1}: a merge key; write out what it stands for"
            raise SyntaxFault(msg)
        return _once([(str(k.value), _plain(v, seen, depth + 1)) for k, v in node.value])
    if isinstance(node, yaml.SequenceNode):
        return [_plain(each, seen, depth + 1) for each in node.value]
    return node.value


# -- text ---------------------------------------------------------------------------------------

_NAME = re.compile(r"[A-Za-z_][\w .()/-]*")
_SECTION = re.compile(r"\s*\[\s*([A-Za-z_][^\]]*?)\s*\]\s*")


def _text(text: str) -> dict[str, Tree]:
    """Parse lines of numbers under headings, ``name=value`` lines, and ``[sections]``."""
    tree: dict[str, Tree] = {}
    for section, name, lines in _blocks(text):
        value = _block_value(lines)
        where = tree
        if section:
            inner = tree.setdefault(section, {})
            assert isinstance(inner, dict)
            where = inner
        if name in where:
            msg = f"'{name}' is there twice"
            raise SyntaxFault(msg)
        where[name] = value
    return tree


def _blocks(text: str) -> Iterator[tuple[str, str, list[str]]]:
    """Yield section, name and lines of each value; sections that come again are numbered."""
    section, name, lines, unnamed = "", "", list[str](), 0
    sections: dict[str, int] = {}
    for raw in [*text.splitlines(), ""]:
        line = raw.partition("#")[0].partition("%")[0].strip()
        line = line.removeprefix("//").strip()
        if _is_numeric(line):
            lines.append(line)
            continue
        if lines:
            unnamed += not name
            yield section, name or f"matrix{unnamed}", lines
            name, lines = "", []
        if (found := _SECTION.fullmatch(line)) is not None:
            count = sections[found[1]] = sections.get(found[1], 0) + 1
            section, name = found[1] if count == 1 else f"{found[1]} {count}", ""
        elif (pair := re.split("[=:]", line, maxsplit=1))[-1].strip() and len(pair) == 2:
            if _NAME.fullmatch(pair[0].strip()):
                yield section, pair[0].strip(), [pair[1].strip()]
        elif line:
            name = line.rstrip(":= ")


def _is_numeric(line: str) -> bool:
    return bool(line) and _IS_PRINTED.fullmatch(line) is not None


def _block_value(lines: list[str]) -> Tree:
    joined = "\n".join(lines)
    if "." not in joined and re.search(r"\d,\d", joined) and re.search(r"[;\t]|\d +-?\d", joined):
        joined = joined.replace(",", ".")  # 2210,5;0;811,25
    return _scalar(joined.replace("|", " "))


# -- archives -----------------------------------------------------------------------------------


def _npz(data: bytes) -> Tree:
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        _check_unpacked(sum(info.file_size for info in archive.infolist()))
    try:
        with np.load(io.BytesIO(data), allow_pickle=False) as arrays:
            content = {name: arrays[name] for name in arrays.files}
    except ValueError as error:
        if "pickle" in str(error).lower():
            msg = "it holds Python objects; save arrays alone: np.savez(…, K=K, D=D, R=R, T=T)"
            raise SyntaxFault(msg) from error
        raise
    return {name: _of_numpy(array) for name, array in content.items()}


def _of_numpy(value: Any, depth: int = 0) -> Tree:
    if isinstance(value, Mapping):
        if depth > _DEEPEST:
            msg = f"it is nested more than {_DEEPEST} deep"
            raise SyntaxFault(msg)
        return {str(key): _of_numpy(each, depth + 1) for key, each in value.items()}
    array = np.asarray(value)
    if array.dtype.kind in "biuf":
        return float(array) if array.ndim == 0 else array.astype(np.float64)
    if array.dtype.kind in "US":
        return str(array) if array.ndim == 0 else [str(each) for each in array.reshape(-1)]
    return f"a value of the type {array.dtype}"


def _mat(data: bytes) -> Tree:
    # scipy takes a tenth of a second to import, and few calibrations are MATLAB's.
    from scipy.io import loadmat

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
    content = loadmat(io.BytesIO(data), simplify_cells=True)
    return {name: _of_numpy(value) for name, value in content.items() if not name.startswith("__")}


def _check_unpacked(size: int) -> None:
    if size >= 4 * LARGEST_BYTES:
        msg = f"{size / 1e6:.0f} MB when it is unpacked, and a calibration has a few numbers"
        raise SyntaxFault(msg)
