"""PCD point clouds of all versions of the format, and of programs that leave out half the header.

Compressed data are packed by LZF (which pypcd4 brings along), a field after the other.
"""

import re
from dataclasses import dataclass
from pathlib import Path

import lzf
import numpy as np
from numpy.typing import NDArray

from exposight.cell.cloud_formats.number_lines import numbers_of_lines, rows_before_cut
from exposight.errors import DamagedFileError, FormatError
from exposight.files import recognised

_KEYS = ("version", "fields", "size", "type", "count", "width", "height", "viewpoint", "points")
_FIELD_KEYS = ("fields", "columns")
"""Version .5 has columns."""
_TYPES = {"F4", "F8", "U1", "U2", "U4", "U8", "I1", "I2", "I4", "I8"}
_MOST_PACKED = 300
"""LZF packs at most 264 bytes into 3."""
_MOST_FIELDS = 1000
_LONGEST_POINT = 2**24
"""Bytes of a point; descriptors of some thousand numbers occur."""

_ENCODINGS = {
    "ascii": "ascii",
    "binary": "binary",
    "binary_compressed": "binary_compressed",
    "binaryscompressed": "binary_compressed",  # pypcd4 writes so
}


@dataclass(frozen=True, kw_only=True)
class _Header:
    """What a header says; what stands in its lines' order is a tuple."""

    fields: tuple[str, ...]
    types: tuple[str, ...]
    counts: tuple[int, ...]
    rows: int
    columns: int
    points: int
    encoding: str

    @property
    def row_bytes(self) -> int:
        return sum(int(t[1]) * n for t, n in zip(self.types, self.counts, strict=True))


def is_pcd(data: bytes) -> bool:
    """Tell by its first lines whether a file is a PCD file, whatever it is called."""
    for line in data[:2048].split(b"\n"):
        words = line.decode("latin-1").lower().split()
        if words and not words[0].startswith("#"):
            return words[0] == "version" or words[0] in _FIELD_KEYS
        if words[:2] == ["#", ".pcd"]:
            return True
    return False


def points_from_pcd(data: bytes, path: Path) -> NDArray[np.floating]:
    """Read the points of a PCD file, ASCII, binary or compressed.

    Parameters
    ----------
    data : bytes
        The whole file, of version .5, 0.6 or 0.7; ``COUNT``, ``VIEWPOINT``, ``HEIGHT`` and, of
        text, ``SIZE`` and ``TYPE`` may be left out.
    path : Path
        Its name, for messages.

    Returns
    -------
    (rows, columns, 3) or (n, 3) ndarray
        Organised where ``HEIGHT`` is above 1.

    Raises
    ------
    FormatError
        If it is no PCD file, or has no fields x, y and z.
    DamagedFileError
        If it is cut off.
    """
    header, body = _header(data, path)
    names = [name.lower() for name in header.fields]
    exact = all(axis in header.fields for axis in "xyz")
    if not set("xyz") <= set(names):
        msg = f"{path}: expected the fields x, y and z, got {', '.join(header.fields)}"
        raise FormatError(msg)
    wanted = [(list(header.fields) if exact else names).index(axis) for axis in "xyz"]
    points: NDArray[np.floating]
    if header.encoding == "ascii":
        points = _from_text(body, header, wanted, path)
    else:
        points = _from_binary(body, header, wanted, path)
    if header.rows * header.columns != header.points or len(points) != header.points:
        raise _cut_off(header, len(points), path)
    return points.reshape(header.rows, header.columns, 3) if header.rows > 1 else points


def _cut_off(header: _Header, found: int, path: Path) -> DamagedFileError:
    return DamagedFileError(
        f"{path} is cut off or wrong: its header announces {header.rows} rows × {header.columns} "
        f"columns and {header.points} points, it holds {found}; copy or export it again"
    )


def _header(data: bytes, path: Path) -> tuple[_Header, bytes]:
    """Return what a header says, and what follows it."""
    said: dict[str, list[str]] = {}
    at = 0
    while "data" not in said:
        end = data.find(b"\n", at)
        line = data[at : end if end >= 0 else len(data)].decode("latin-1")
        words = line.split("#", 1)[0].split()
        key = words[0].lower() if words else ""
        if key and key not in {*_KEYS, "columns", "data"}:
            msg = (
                f"{path} is no PCD file: {line.strip()[:60]!r} is none of its header's lines; "
                "expected VERSION, FIELDS, SIZE, TYPE, COUNT, WIDTH, HEIGHT, POINTS and DATA"
            )
            raise FormatError(msg)
        if end < 0 and key != "data":
            msg = f"{path} is no PCD file, or is cut off: its header has no line DATA"
            raise FormatError(msg)
        key = "fields" if key == "columns" else key
        if said.setdefault(key, words[1:]) != words[1:]:
            msg = f"{path}: its PCD header has {key.upper()} twice, and differently"
            raise FormatError(msg)
        at = end + 1 if end >= 0 else len(data)
    try:
        header = _understood(said)
    except (ValueError, LookupError) as error:
        got = "; ".join(f"{key.upper()} {' '.join(words)}" for key, words in said.items())
        msg = f"{path}: the PCD header cannot be understood ({error}), got {got[:300]}"
        raise FormatError(msg) from error
    if len(view := said.get("viewpoint", [])) == 7 and re.search(r"[1-9]", "".join(view[:3])):
        recognised(path, f"its VIEWPOINT {' '.join(view)} is not applied")
    return header, data[at:]


def _understood(said: dict[str, list[str]]) -> _Header:
    """Return a header's lines as what they mean; KeyError, ValueError where they mean nothing."""
    fields = tuple(said["fields"])
    encoding = _ENCODINGS.get(said["data"][0].lower())
    if encoding is None:
        msg = f"expected DATA ascii, binary or binary_compressed, got {said['data'][0]!r}"
        raise ValueError(msg)
    if encoding != "ascii" and not {"size", "type"} <= said.keys():
        msg = "binary data need SIZE and TYPE"
        raise ValueError(msg)
    if len(fields) > _MOST_FIELDS:
        msg = f"{len(fields)} fields, more than {_MOST_FIELDS}"
        raise ValueError(msg)
    counts = tuple(map(_count, said.get("count", ["1"] * len(fields))))
    sizes = said.get("size", ["4"] * len(fields))
    types = tuple(
        f"{t.upper()}{s}" for t, s in zip(said.get("type", ["F"] * len(fields)), sizes, strict=True)
    )
    if not len(fields) == len(counts) == len(types) or min(counts) < 1 or not set(types) <= _TYPES:
        msg = "FIELDS, SIZE, TYPE and COUNT differ in length, or name no type"
        raise ValueError(msg)
    if sum(map(int, sizes)) * max(counts) > _LONGEST_POINT:
        msg = "a point cannot be so long"
        raise ValueError(msg)
    rows = _count(said.get("height", ["1"])[0])
    columns = _count((said.get("width") or said["points"])[0])
    points = _count(said["points"][0]) if "points" in said else rows * columns
    return _Header(
        fields=fields,
        types=types,
        counts=counts,
        rows=rows,
        columns=columns,
        points=points,
        encoding=encoding,
    )


def _count(word: str) -> int:
    """Return a count, which is written in digits alone: int() takes -1, +1 and 1_0 as well."""
    if not word.isascii() or not word.isdigit() or len(word) > 19:
        msg = f"expected a count, got {word[:30]!r}"
        raise ValueError(msg)
    return int(word)


def _from_text(body: bytes, header: _Header, wanted: list[int], path: Path) -> NDArray[np.float64]:
    starts = np.concatenate([[0], np.cumsum(header.counts)])
    columns = [int(starts[i]) for i in wanted]
    try:
        return numbers_of_lines(body, columns, path, most=header.points + 1)
    except ValueError as error:
        found = rows_before_cut(body, columns, path, header.points)
        if found is not None:
            raise _cut_off(header, found, path) from error
        msg = f"{path}: a point cannot be read ({error}); expected {' '.join(header.fields)}"
        raise FormatError(msg) from error


def _from_binary(
    body: bytes, header: _Header, wanted: list[int], path: Path
) -> NDArray[np.floating]:
    """Return the points that are there, of a point after the other or a field after the other."""
    widths = [int(t[1]) * n for t, n in zip(header.types, header.counts, strict=True)]
    starts = [sum(widths[:i]) for i in wanted]
    dtypes = [np.dtype("<" + header.types[i].lower()) for i in wanted]
    if header.encoding == "binary":
        count = min(len(body) // header.row_bytes, header.points)
        if starts == [0, 4, 8] and set(dtypes) == {np.dtype("<f4")} and header.row_bytes == 12:
            return np.frombuffer(body, "<f4", count=3 * count).reshape(-1, 3)
        layout = np.dtype(
            {
                "names": list("xyz"),
                "formats": dtypes,
                "offsets": starts,
                "itemsize": header.row_bytes,
            }
        )
        rows: NDArray[np.void] = np.frombuffer(body, layout, count=count)
        return np.stack([rows[axis] for axis in "xyz"], axis=-1)
    unpacked = _unpacked(body, header, path)
    n = header.points
    columns = [
        np.frombuffer(unpacked, dtype, n * header.counts[i], start * n)[:: header.counts[i]]
        for i, dtype, start in zip(wanted, dtypes, starts, strict=True)
    ]
    return np.stack(columns, axis=-1)


def _unpacked(body: bytes, header: _Header, path: Path) -> bytes:
    """Return the data of a compressed file, whose lengths are checked before it is unpacked."""
    size = header.points * header.row_bytes
    if size == 0:
        return b""
    packed_size, unpacked_size = (int.from_bytes(body[i : i + 4], "little") for i in (0, 4))
    packed = body[8 : 8 + packed_size]
    if len(packed) < packed_size or unpacked_size != size or size > _MOST_PACKED * packed_size:
        raise _cut_off(header, 0, path)
    try:
        unpacked = lzf.decompress(packed, size)
    except (ValueError, RuntimeError) as error:
        msg = f"{path}: its compressed data are damaged ({error}); copy or export it again"
        raise DamagedFileError(msg) from error
    if unpacked is None or len(unpacked) != size:
        raise _cut_off(header, 0, path)
    return bytes(unpacked)
