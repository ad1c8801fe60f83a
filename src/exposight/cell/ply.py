"""PLY point clouds: NaN kept, vertex order kept, and the image's size where the file gives it.

Scanners write the size of an organised cloud as ``obj_info num_cols`` and ``obj_info num_rows``,
with one vertex per pixel. General mesh readers drop these lines, hence this reader.
"""

import io
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.lib.recfunctions import structured_to_unstructured
from numpy.typing import NDArray

from exposight.errors import DamagedFileError, FormatError

_CODES = {"i1": "char int8", "u1": "uchar uint8", "i2": "short int16", "u2": "ushort uint16"}
_CODES |= {"i4": "int int32", "u4": "uint uint32", "f4": "float float32", "f8": "double float64"}
_TYPES = {name: code for code, names in _CODES.items() for name in names.split()}
_BYTE_ORDERS = {"ascii": "=", "binary_little_endian": "<", "binary_big_endian": ">"}


@dataclass
class _Element:
    """One element of a PLY file; a property without a type is a list."""

    name: str
    count: int
    properties: dict[str, str] = field(default_factory=dict)

    def dtype(self, byte_order: str, path: Path) -> np.dtype[np.void]:
        for name, code in self.properties.items():
            if not code:
                msg = (
                    f"{path}: element {self.name!r} holds the list {name!r}; expected only numbers "
                    "up to and in element 'vertex': export the cloud as plain points"
                )
                raise FormatError(msg)
        return np.dtype([(name, byte_order + code) for name, code in self.properties.items()])


SIGMA = "sigma_z"
"""The property of a vertex that holds the standard deviation of its z, in the unit of z."""

_Floats = NDArray[np.floating]


def points_from_ply(data: bytes, path: Path) -> tuple[_Floats, _Floats | None]:
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
    start = data.find(b"\n", end) + 1
    if end < 0 or start == 0:
        msg = f"{path} is cut off: its PLY header has no line 'end_header'"
        raise DamagedFileError(msg)
    encoding, elements, size = _read_header(data[:end].decode("latin-1"), path)
    names = [element.name for element in elements]
    if "vertex" not in names:
        msg = f"{path}: expected an element 'vertex', got {', '.join(names) or 'no element'}"
        raise FormatError(msg)
    before, vertex = elements[: names.index("vertex")], elements[names.index("vertex")]
    if not {"x", "y", "z"} <= vertex.properties.keys():
        got = ", ".join(vertex.properties)
        msg = f"{path}: expected vertices with x, y and z, got {got}"
        raise FormatError(msg)
    wanted = [*"xyz", SIGMA] if SIGMA in vertex.properties else list("xyz")
    if encoding == "ascii":
        points = _read_ascii(data[start:], before, vertex, path, wanted)
    else:
        points = _read_binary(data, start, _BYTE_ORDERS[encoding], before, vertex, path, wanted)
    if len(points) < vertex.count:
        msg = (
            f"{path} is cut off: its header announces {vertex.count} vertices, it holds "
            f"{len(points)}; copy or export it again"
        )
        raise DamagedFileError(msg)
    sigma = points[:, 3] if len(wanted) > 3 else None
    if size.keys() != {"num_cols", "num_rows"}:
        return points[:, :3], sigma
    rows, columns = size["num_rows"], size["num_cols"]
    if rows * columns != vertex.count:
        msg = (
            f"{path}: {rows} rows × {columns} columns (obj_info) need {rows * columns} vertices, "
            f"got {vertex.count}; export one vertex per pixel, missing ones as NaN or 0 0 0"
        )
        raise FormatError(msg)
    if sigma is not None:
        sigma = sigma.reshape(rows, columns)
    return points[:, :3].reshape(rows, columns, 3), sigma


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


def _read_header(header: str, path: Path) -> tuple[str, list[_Element], dict[str, int]]:
    """Return the encoding, the elements in their order, and the image's size."""
    encoding, elements, size = "", list[_Element](), dict[str, int]()
    for line in header.splitlines()[1:]:
        try:
            match line.split():
                case [] | ["comment", *_]:
                    continue
                case ["format", encoding, "1.0"] if encoding in _BYTE_ORDERS:
                    continue
                case ["obj_info", ("num_cols" | "num_rows") as key, number]:
                    size[key] = int(number)
                case ["obj_info", *_]:
                    continue
                case ["element", name, number]:
                    elements.append(_Element(name, int(number)))
                case ["property", "list", _, _, name]:
                    elements[-1].properties[name] = ""
                case ["property", item, name] if item in _TYPES:
                    if name in elements[-1].properties:
                        raise ValueError(name)  # twice
                    elements[-1].properties[name] = _TYPES[item]
                case _:
                    msg = f"{path}: unknown line {line.strip()!r} in the PLY header"
                    raise FormatError(msg)
        except (ValueError, IndexError) as error:
            msg = f"{path}: the line {line.strip()!r} in the PLY header cannot be understood"
            raise FormatError(msg) from error
    if not encoding:
        msg = f"{path}: the PLY header has no format line; expected {' or '.join(_BYTE_ORDERS)}"
        raise FormatError(msg)
    return encoding, elements, size


def _read_binary(
    data: bytes,
    start: int,
    byte_order: str,
    before: list[_Element],
    vertex: _Element,
    path: Path,
    wanted: list[str],
) -> _Floats:
    """Return the vertices that are there, at most as many as announced."""
    dtype = vertex.dtype(byte_order, path)
    offset = start + sum(e.count * e.dtype(byte_order, path).itemsize for e in before)
    count = min(max(len(data) - offset, 0) // dtype.itemsize, vertex.count)
    vertices = np.frombuffer(memoryview(data)[offset:], dtype, count=count)
    # Without a copy where x, y and z lie side by side, as they nearly always do.
    return structured_to_unstructured(vertices[wanted])


def _read_ascii(
    body: bytes, before: list[_Element], vertex: _Element, path: Path, wanted: list[str]
) -> _Floats:
    """Return the vertices that are there, at most as many as announced."""
    vertex.dtype("=", path)  # refuses lists
    if vertex.count == 0:
        return np.zeros((0, len(wanted)))
    columns = list(vertex.properties)
    try:
        return np.loadtxt(
            io.BytesIO(body),
            skiprows=sum(element.count for element in before),
            max_rows=vertex.count,
            usecols=[columns.index(name) for name in wanted],
            ndmin=2,
        )
    except ValueError as error:
        msg = f"{path}: a vertex cannot be read ({error}); expected {' '.join(columns)} on a line"
        raise FormatError(msg) from error
