"""PLY point clouds: NaN kept, vertex order kept, and the image's size where the file gives it.

Scanners write the size of an organised cloud as ``obj_info num_cols`` and ``obj_info num_rows``,
with one vertex per pixel, or with an element ``range_grid`` that gives each pixel its vertex.
General mesh readers drop these lines, hence this reader.
"""

import re
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from exposight.cell.cloud_formats.ply_elements import (
    BinaryBody,
    Body,
    Element,
    Numbers,
    Property,
    TextBody,
)
from exposight.errors import DamagedFileError, FormatError
from exposight.files import recognised

_DIGITS = re.compile(r"[0-9]{1,19}")
_CODES = {"i1": "char int8", "u1": "uchar uint8", "i2": "short int16", "u2": "ushort uint16"}
_CODES |= {"i4": "int int32", "u4": "uint uint32", "f4": "float float32", "f8": "double float64"}
_TYPES = {name: code for code, names in _CODES.items() for name in names.split()}
_COUNT_TYPES = {name: code for name, code in _TYPES.items() if code[0] != "f"}
_BYTE_ORDERS = {"ascii": "=", "binary_little_endian": "<", "binary_big_endian": ">"}

SIGMA = "sigma_z"
"""The property of a vertex that holds the standard deviation of its z, in the unit of z."""

_COORDINATES = (
    ("x", "y", "z"),
    ("X", "Y", "Z"),
    ("x_mm", "y_mm", "z_mm"),
    ("px", "py", "pz"),
    ("pos_x", "pos_y", "pos_z"),
    ("position_x", "position_y", "position_z"),
)
"""Names of a vertex' coordinates; the first that are there are taken, small letters or capitals."""

_MOST_ELEMENTS, _MOST_PROPERTIES = 100, 1000
"""Of a file, and of an element; more are no scanner's."""

_SIZE_KEYS = {"num_cols": "columns", "width": "columns", "num_rows": "rows", "height": "rows"}


@dataclass(kw_only=True)
class _Header:
    """What a header says; `told` and `remarked` are sizes in obj_info lines and in comments."""

    encoding: str = ""
    elements: list[Element] = field(default_factory=list)
    told: dict[str, int] = field(default_factory=dict)
    remarked: dict[str, int] = field(default_factory=dict)

    def element(self, name: str) -> Element | None:
        return next((each for each in self.elements if each.name == name), None)


def points_from_ply(data: bytes, path: Path) -> tuple[Numbers, Numbers | None]:
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
        Organised where the file gives a size (``obj_info num_cols`` and ``num_rows``, comments
        ``width`` and ``height``, elements of PCL and Photoneo), or has a ``range_grid``.
    (rows, columns) or (n,) ndarray, or None
        Standard deviations of z, where vertices have a property ``sigma_z``.

    Raises
    ------
    FormatError
        If it is no PLY file or has no vertices with x, y and z.
    DamagedFileError
        If it is cut off.
    """
    if not data.startswith(b"ply"):
        msg = f"{path} is no PLY file: it must begin with the line 'ply'"
        raise FormatError(msg)
    end = data.find(b"end_header")
    start = _next_line(data, end)
    if end < 0 or start == 0:
        msg = f"{path} is cut off: its PLY header has no line 'end_header'"
        raise DamagedFileError(msg)
    header = _read_header(data[:end].decode("latin-1"), path)
    vertex = header.element("vertex")
    if vertex is None:
        got = ", ".join(each.name for each in header.elements) or "no element"
        msg = f"{path}: expected an element 'vertex', got {got}"
        raise FormatError(msg)
    body: Body
    if header.encoding == "ascii":
        text = data[start:] if b"\n" in data[start:] else data[start:].replace(b"\r", b"\n")
        body = TextBody(text, header.elements, path)
    else:
        order = _BYTE_ORDERS[header.encoding]
        body = BinaryBody(data, start, order, header.elements, path)
    body.require_all()
    names = _coordinates(vertex, path)
    has_sigma = any(each.name == SIGMA for each in vertex.properties)
    points = body.numbers(vertex, [*names, SIGMA] if has_sigma else names)
    points = _organised(points, header, body, path)
    return points[..., :3], points[..., 3] if has_sigma else None


def ply_from_points(points: NDArray[np.float32], sigma: NDArray[np.float32] | None = None) -> bytes:
    """Write points as binary little-endian PLY, the image's size as ``obj_info``.

    Parameters
    ----------
    points : (rows, columns, 3) or (n, 3) ndarray of float32, mm
        Missing points are written as NaN, so that the order stays.
    sigma : (rows, columns) or (n,) ndarray of float32, mm, optional
        Standard deviations of z, written as the property ``sigma_z``.
    """
    lines = ["ply", "format binary_little_endian 1.0", "comment coordinates in mm"]
    if points.ndim == 3:
        lines += [f"obj_info num_cols {points.shape[1]}", f"obj_info num_rows {points.shape[0]}"]
    lines += [f"element vertex {points.size // 3}"]
    lines += [f"property float {axis}" for axis in "xyz"]
    if sigma is not None:
        lines += [f"property float {SIGMA}"]
        points = np.concatenate([points, sigma[..., None]], axis=-1)
    header = "\n".join([*lines, "end_header", ""])
    return header.encode("ascii") + points.astype("<f4", copy=False).tobytes()


def _next_line(data: bytes, end: int) -> int:
    """Return where the line after the header's last begins; 0 where there is none."""
    after = end + len(b"end_header")
    if data[after : after + 1] == b"\r" and data[after + 1 : after + 2] != b"\n":
        return after + 1  # lines that end like those of old Macintosh programs
    return data.find(b"\n", end) + 1


def _read_header(text: str, path: Path) -> _Header:
    """Return the encoding, the elements in their order, and the image's size."""
    header = _Header()
    for line in text.splitlines()[1:]:
        try:
            match line.split():
                case ["format", encoding, "1.0"] if encoding in _BYTE_ORDERS:
                    if header.encoding not in {"", encoding}:
                        raise ValueError(encoding)  # two formats
                    header.encoding = encoding
                case ["obj_info", key, number] if key in _SIZE_KEYS:
                    told = header.told.setdefault(_SIZE_KEYS[key], _count(number))
                    if told != _count(number):
                        raise ValueError(key)  # two sizes
                case ["comment", key, number] if key in _SIZE_KEYS and _DIGITS.fullmatch(number):
                    header.remarked[_SIZE_KEYS[key]] = int(number)
                case [] | ["comment" | "obj_info", *_]:
                    continue
                case ["element", name, number]:
                    if header.element(name) is not None or len(header.elements) == _MOST_ELEMENTS:
                        raise ValueError(name)  # twice, or too many
                    header.elements.append(Element(name=name, count=_count(number)))
                case ["property", "list", counts, item, name] if item in _TYPES:
                    code, count_code = _TYPES[item], _COUNT_TYPES[counts]
                    _add(header.elements[-1], Property(name=name, code=code, count_code=count_code))
                case ["property", item, name] if item in _TYPES:
                    _add(header.elements[-1], Property(name=name, code=_TYPES[item]))
                case _:
                    msg = f"{path}: unknown line {line.strip()!r} in the PLY header"
                    raise FormatError(msg)
        except (ValueError, LookupError) as error:
            msg = f"{path}: the line {line.strip()!r} in the PLY header cannot be understood"
            raise FormatError(msg) from error
    if not header.encoding:
        msg = f"{path}: the PLY header has no format line; expected {' or '.join(_BYTE_ORDERS)}"
        raise FormatError(msg)
    # Elements without properties have no rows.
    header.elements = [each for each in header.elements if each.properties]
    return header


def _count(number: str) -> int:
    """Return a count, which is written in digits alone: int() takes -1, +1, 1_0 and ١ as well."""
    if not _DIGITS.fullmatch(number):
        raise ValueError(number)
    return int(number)


def _add(element: Element, new: Property) -> None:
    if len(element.properties) == _MOST_PROPERTIES:
        msg = "too many properties"
        raise ValueError(msg)
    if any(each.name == new.name for each in element.properties):
        raise ValueError(new.name)  # twice
    element.properties.append(new)


def _coordinates(vertex: Element, path: Path) -> list[str]:
    """Return the names of a vertex' coordinates."""
    plain = [each.name for each in vertex.properties if not each.count_code]
    by_lower_case = {name.lower(): name for name in reversed(plain)}
    for names in _COORDINATES:
        if set(names) <= set(plain):
            return list(names)
        if all(name in by_lower_case for name in names):
            return [by_lower_case[name] for name in names]
    got = ", ".join(each.name for each in vertex.properties)
    msg = f"{path}: expected vertices with x, y and z, got {got}"
    raise FormatError(msg)


def _organised(points: Numbers, header: _Header, body: Body, path: Path) -> Numbers:
    """Return vertices with the rows and columns that the file gives them, if it does."""
    grid = header.element("range_grid")
    rows, columns = header.told.get("rows"), header.told.get("columns")
    if grid is not None and grid.has_lists and grid.count:
        return _from_grid(points, grid, body, path, rows, columns)
    if rows is not None and columns is not None:
        if rows * columns != len(points):
            msg = (
                f"{path}: {rows} rows × {columns} columns (obj_info) need {rows * columns} "
                f"vertices, got {len(points)}; export one vertex per pixel, missing ones as NaN or "
                "0 0 0"
            )
            raise FormatError(msg)
        return points.reshape(rows, columns, -1)
    told_by = "comments"
    size = header.told | header.remarked
    if len(size) < 2:
        told_by, size = _size_in_elements(header, body)
    if len(size) < 2:
        return points
    rows, columns = size["rows"], size["columns"]
    if rows * columns == len(points):
        recognised(path, f"{rows} rows × {columns} columns by its {told_by}")
        return points.reshape(rows, columns, -1)
    if told_by == "comments":
        recognised(
            path,
            f"{len(points)} points without rows and columns: comments tell of {rows} × {columns}",
        )
    return points


_SIZE_NAMES = (("viewporty", "viewportx"), ("frame_height", "frame_width"))
"""Rows and columns in an element of one row: PCL's ``camera``, Photoneo's frame parameters."""


def _size_in_elements(header: _Header, body: Body) -> tuple[str, dict[str, int]]:
    """Return the size that an element tells, and which; none where a size has one row."""
    for element in header.elements:
        names = [each.name for each in element.properties if not each.count_code]
        for pair in _SIZE_NAMES:
            if element.count == 1 and set(pair) <= set(names):
                rows, columns = (int(value) for value in body.numbers(element, list(pair))[0])
                if rows > 1:
                    return f"element {element.name}", {"rows": rows, "columns": columns}
    return "", {}


def _from_grid(
    points: Numbers, grid: Element, body: Body, path: Path, rows: int | None, columns: int | None
) -> Numbers:
    """Return vertices at the pixels of a range grid, NaN where a pixel has none."""
    if rows is None or columns is None or rows * columns != grid.count:
        told = f"got {rows} × {columns}" if rows and columns else "got none"
        msg = (
            f"{path}: a range grid of {grid.count} pixels needs obj_info num_rows and num_cols "
            f"whose product that is, {told}; export it again"
        )
        raise FormatError(msg)
    name = next(each.name for each in grid.properties if each.count_code)
    counts, index = body.entries(grid, name)
    if counts.max() > 1 or index.max() >= len(points) or index.min() < -1:
        msg = (
            f"{path}: each pixel of its range grid must name none or one of its {len(points)} "
            "vertices, counted from 0; export it again"
        )
        raise DamagedFileError(msg)
    dtype = np.result_type(points.dtype, np.float32)  # whole numbers have no NaN
    organised = np.full((grid.count, points.shape[1]), np.nan, dtype=dtype)
    some = index >= 0
    organised[some] = points[index[some]]
    recognised(path, f"range grid of {rows} rows × {columns} columns")
    return organised.reshape(rows, columns, -1)
