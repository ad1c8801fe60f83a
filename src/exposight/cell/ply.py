"""PLY point clouds: NaN kept, vertex order kept, and the image's size where the file tells it.

Scanners write the size of an organised cloud as ``obj_info num_cols`` and ``obj_info num_rows``,
with one vertex per pixel. General mesh readers drop these lines, hence a reader of our own.
"""

from __future__ import annotations

import io
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.lib.recfunctions import structured_to_unstructured

from exposight.errors import DamagedFileError, FormatError

if TYPE_CHECKING:
    from numpy.typing import NDArray


_TYPES = {
    "char": "i1",
    "int8": "i1",
    "uchar": "u1",
    "uint8": "u1",
    "short": "i2",
    "int16": "i2",
    "ushort": "u2",
    "uint16": "u2",
    "int": "i4",
    "int32": "i4",
    "uint": "u4",
    "uint32": "u4",
    "float": "f4",
    "float32": "f4",
    "double": "f8",
    "float64": "f8",
}
_BYTE_ORDERS = {"ascii": "=", "binary_little_endian": "<", "binary_big_endian": ">"}


@dataclass(frozen=True, kw_only=True)
class _Element:
    """One element of a PLY file; a property of type None is a list."""

    name: str
    count: int
    properties: tuple[tuple[str, str | None], ...]

    def dtype(self, byte_order: str, path: Path) -> np.dtype[np.void]:
        fields = []
        for name, code in self.properties:
            if code is None:
                msg = (
                    f"{path}: element {self.name!r} holds the list {name!r}; expected only numbers "
                    "up to and in element 'vertex': export the cloud as plain points"
                )
                raise FormatError(msg)
            fields.append((name, byte_order + code))
        try:
            return np.dtype(fields)
        except ValueError as error:
            msg = f"{path}: element {self.name!r} names a property twice ({error})"
            raise FormatError(msg) from error


@dataclass(frozen=True, kw_only=True)
class _Header:
    encoding: str
    elements: tuple[_Element, ...]
    size: tuple[int, int] | None
    length: int

    @property
    def byte_order(self) -> str:
        return _BYTE_ORDERS[self.encoding]


def points_from_ply(data: bytes, path: Path) -> NDArray[np.floating]:
    """Read the vertices of a PLY file, ASCII or binary.

    Parameters
    ----------
    data : bytes
        The whole file.
    path : Path
        Its name, for messages.

    Returns
    -------
    (rows, columns, 3) or (n, 3) ndarray
        Organised where the file gives ``obj_info num_cols`` and ``num_rows``.

    Raises
    ------
    FormatError
        If it is no PLY file or has no vertices with x, y and z.
    DamagedFileError
        If it is cut off.
    """
    header = _read_header(data, path)
    names = [element.name for element in header.elements]
    if "vertex" not in names:
        msg = f"{path}: expected an element 'vertex', got {', '.join(names) or 'no element'}"
        raise FormatError(msg)
    vertex = header.elements[names.index("vertex")]
    before = header.elements[: names.index("vertex")]
    columns = [name for name, _ in vertex.properties]
    if not {"x", "y", "z"} <= set(columns):
        msg = f"{path}: expected vertices with x, y and z, got {', '.join(columns)}"
        raise FormatError(msg)
    read = _read_ascii if header.encoding == "ascii" else _read_binary
    points = read(data, header, before, vertex, path)
    if header.size is None:
        return points
    rows, cols = header.size
    if rows * cols != vertex.count:
        msg = (
            f"{path}: {rows} rows × {cols} columns (obj_info) need {rows * cols} vertices, got "
            f"{vertex.count}; export one vertex per pixel, missing ones as NaN or 0 0 0"
        )
        raise FormatError(msg)
    return points.reshape(rows, cols, 3)


def ply_from_points(points: NDArray[np.float32]) -> bytes:
    """Write points as binary little-endian PLY, the image's size as ``obj_info``.

    Parameters
    ----------
    points : (rows, columns, 3) or (n, 3) ndarray of float32, mm
        Missing points are written as NaN, so that the order stays.
    """
    lines = ["ply", "format binary_little_endian 1.0", "comment coordinates in mm"]
    if points.ndim == 3:
        lines += [f"obj_info num_cols {points.shape[1]}", f"obj_info num_rows {points.shape[0]}"]
    lines += [f"element vertex {points.size // 3}"]
    lines += [f"property float {axis}" for axis in "xyz"]
    header = "\n".join([*lines, "end_header", ""])
    return header.encode("ascii") + points.astype("<f4", copy=False).tobytes()


def _read_header(data: bytes, path: Path) -> _Header:
    if not data.startswith(b"ply"):
        msg = f"{path} is no PLY file: it must begin with the line 'ply'"
        raise FormatError(msg)
    end = data.find(b"end_header")
    length = data.find(b"\n", end) + 1
    if end < 0 or length == 0:
        msg = f"{path} is cut off: its PLY header has no line 'end_header'"
        raise DamagedFileError(msg)
    encoding = ""
    elements: list[_Element] = []
    size: dict[str, int] = {}
    for line in data[:end].decode("latin-1").splitlines()[1:]:
        words = line.split()
        try:
            match words:
                case [] | ["comment", *_]:
                    continue
                case ["format", encoding, "1.0"] if encoding in _BYTE_ORDERS:
                    continue
                case ["obj_info", ("num_cols" | "num_rows") as key, number]:
                    size[key] = int(number)
                case ["obj_info", *_]:
                    continue
                case ["element", name, number]:
                    elements.append(_Element(name=name, count=int(number), properties=()))
                case ["property", "list", count, item, name] if {count, item} <= _TYPES.keys():
                    elements[-1] = _with_property(elements[-1], name, None)
                case ["property", item, name] if item in _TYPES:
                    elements[-1] = _with_property(elements[-1], name, _TYPES[item])
                case _:
                    msg = f"{path}: unknown line {line.strip()!r} in the PLY header"
                    raise FormatError(msg)
        except (ValueError, IndexError) as error:
            msg = f"{path}: the line {line.strip()!r} in the PLY header cannot be understood"
            raise FormatError(msg) from error
    if not encoding:
        msg = f"{path}: the PLY header has no format line; expected {' or '.join(_BYTE_ORDERS)}"
        raise FormatError(msg)
    rows_and_columns = None
    if size.keys() == {"num_cols", "num_rows"}:
        rows_and_columns = (size["num_rows"], size["num_cols"])
    return _Header(
        encoding=encoding, elements=tuple(elements), size=rows_and_columns, length=length
    )


def _with_property(element: _Element, name: str, code: str | None) -> _Element:
    properties = (*element.properties, (name, code))
    return _Element(name=element.name, count=element.count, properties=properties)


def _read_binary(
    data: bytes, header: _Header, before: tuple[_Element, ...], vertex: _Element, path: Path
) -> NDArray[np.floating]:
    skipped = sum(e.count * e.dtype(header.byte_order, path).itemsize for e in before)
    dtype = vertex.dtype(header.byte_order, path)
    offset = header.length + skipped
    there = max(len(data) - offset, 0) // dtype.itemsize
    if there < vertex.count:
        msg = (
            f"{path} is cut off: its header announces {vertex.count} vertices, it holds {there}; "
            "copy or export it again"
        )
        raise DamagedFileError(msg)
    vertices = np.frombuffer(data, dtype, count=vertex.count, offset=offset)
    # Without a copy where x, y and z lie side by side, as they nearly always do.
    return structured_to_unstructured(vertices[["x", "y", "z"]])


def _read_ascii(
    data: bytes, header: _Header, before: tuple[_Element, ...], vertex: _Element, path: Path
) -> NDArray[np.floating]:
    columns = [name for name, _ in vertex.properties]
    vertex.dtype(header.byte_order, path)  # refuses lists
    if vertex.count == 0:
        return np.zeros((0, 3))
    try:
        points = np.loadtxt(
            io.BytesIO(data[header.length :]),
            skiprows=sum(element.count for element in before),
            max_rows=vertex.count,
            usecols=[columns.index(axis) for axis in "xyz"],
            ndmin=2,
        )
    except ValueError as error:
        msg = f"{path}: a vertex cannot be read ({error}); expected {' '.join(columns)} on a line"
        raise FormatError(msg) from error
    if len(points) < vertex.count:
        msg = (
            f"{path} is cut off: its header announces {vertex.count} vertices, it holds "
            f"{len(points)}; copy or export it again"
        )
        raise DamagedFileError(msg)
    return points
