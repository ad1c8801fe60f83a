"""Arrays in NPY files and in ZIP archives (NPZ), whose sizes are checked before memory is taken.

A header of a hundred bytes can announce a thousand gigabytes, and a ZIP archive of a megabyte can
hold a gigabyte of zeros. So an array's announced size is held against the bytes that are there, and
all that an archive announces against a limit, before either is believed.
"""

import io
import math
import re
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from exposight.errors import FormatError
from exposight.files.foreign import parsing

MOST_MEMBERS = 1000
"""Files in an archive."""

MOST_UNPACKED = 2**30
"""Bytes that all files of an archive hold together, unless its reader says otherwise."""

ARRAY = ".npy"
"""Ending of arrays' names in archives."""

_MAGIC = b"\x93NUMPY"
_LONGEST_HEADER = 10_000
_MOST_AXES = 32
_ENTRY = b"PK\x01\x02"
_PIECE = 2**20
_ENCRYPTED = 0x1

# Keys in any order, as programs other than numpy write them. No expression is ever evaluated.
_ENTRY_OF_HEADER = r"'[a-z_]+'\s*:\s*(?:'[^']*'|True|False|\([\dL, ]*\))\s*"
_HEADER = re.compile(rf"\{{\s*(?:{_ENTRY_OF_HEADER},\s*){{2}}{_ENTRY_OF_HEADER}(?:,\s*)?\}}")
_DESCRIPTION = re.compile(r"'descr'\s*:\s*'([<>|=]?)([A-Za-z?])(\d*)'")
_ORDER = re.compile(r"'fortran_order'\s*:\s*(True|False)")
_SHAPE = re.compile(r"'shape'\s*:\s*\(([\dL, ]*)\)")
_SIZES = {"b": (1,), "i": (1, 2, 4, 8), "u": (1, 2, 4, 8), "f": (2, 4, 8), "c": (8, 16)}


def read_array(
    data: bytes | bytearray, source: Path | str, what: str, *, kinds: str = "biuf"
) -> NDArray[Any]:
    """Return the array of an NPY file.

    Parameters
    ----------
    data : bytes
        The file's content.
    source : Path or str
        The file, for messages.
    what : str
        What it should be, for messages: ``point cloud``.
    kinds : str
        Which kinds of numpy's types may come: b, i, u, f, c, S and U. Never objects or records.

    Returns
    -------
    ndarray
        In the machine's byte order; of a bytearray it may share the memory.

    Raises
    ------
    FormatError
        If it is no NPY file, its bytes are fewer or more than its header announces, or its type is
        another.
    """
    with parsing(source, f"{what} in NPY"):
        dtype, order, shape, start = _header(data, source, what, kinds)
        announced = math.prod(shape) * dtype.itemsize
        if announced != len(data) - start:
            msg = (
                f"{source} is not a readable {what}: its header announces {announced} bytes "
                f"(shape {shape}, {dtype}), and {len(data) - start} are there; was it cut off?"
            )
            raise FormatError(msg)
        array = np.frombuffer(data, dtype=dtype, offset=start).reshape(shape, order=order)
        # numpy takes any bytes for truth values and characters, and stumbles over them later.
        most, stored = {"b": (1, "u1"), "U": (0x10FFFF, "u4")}.get(dtype.kind, (0, ""))
        codes = np.dtype(stored or "u1").newbyteorder(dtype.byteorder)
        if stored and (np.frombuffer(data, codes, offset=start) > most).any():
            msg = f"{source} is not a readable {what}: it holds bytes that no {dtype} is"
            raise FormatError(msg)
        return array.astype(dtype.newbyteorder("="), copy=not array.flags.writeable)


def read_arrays(
    data: bytes,
    source: Path | str,
    what: str,
    *,
    kinds: str = "biuf",
    most_bytes: int = MOST_UNPACKED,
    wanted: Callable[[str], bool] = lambda _: True,
) -> dict[str, NDArray[Any]]:
    """Return the arrays of an NPZ file, or of another ZIP archive, by their names.

    Parameters
    ----------
    data : bytes
        The archive.
    source, what, kinds
        As in `read_array`.
    most_bytes : int
        That all files of the archive may hold together, unpacked.
    wanted : callable
        Says of an array's name whether it is to be read.

    Raises
    ------
    FormatError
        As `read_members` and `read_array`.
    """
    members = read_members(
        data,
        source,
        what,
        most_bytes=most_bytes,
        wanted=lambda name: name.endswith(ARRAY) and wanted(name.removesuffix(ARRAY)),
    )
    return {
        name.removesuffix(ARRAY): read_array(member, f"{source}: {name}", what, kinds=kinds)
        for name, member in members.items()
    }


def read_members(
    data: bytes,
    source: Path | str,
    what: str,
    *,
    most_bytes: int = MOST_UNPACKED,
    wanted: Callable[[str], bool] = lambda _: True,
) -> dict[str, bytearray]:
    """Return the files in a ZIP archive by their names.

    Parameters
    ----------
    data, source, what, most_bytes
        As in `read_arrays`.
    wanted : callable
        Says of a file's name whether it is to be read.

    Raises
    ------
    FormatError
        If it is no such archive or damaged, has a name twice, more than `MOST_MEMBERS` files, or
        more bytes in them than it may.
    """
    fault = f"{source} is not a readable {what}: "
    # Each costs the library memory before it can be asked how many there are.
    if data.count(_ENTRY) > 2 * MOST_MEMBERS:
        msg = f"{fault}an archive of more than {MOST_MEMBERS} files"
        raise FormatError(msg)
    with parsing(source, what), zipfile.ZipFile(io.BytesIO(data)) as archive:
        entries = archive.infolist()
        names = [entry.filename for entry in entries]
        if len(set(names)) < len(names):
            twice = next(name for name in names if names.count(name) > 1)
            msg = f"{fault}its archive holds {twice!r} twice"
            raise FormatError(msg)
        total = sum(entry.file_size for entry in entries)
        if len(entries) > MOST_MEMBERS or total > most_bytes:
            msg = (
                f"{fault}its archive announces {len(entries)} files of {total} bytes; up to "
                f"{MOST_MEMBERS} files and {most_bytes} bytes are read"
            )
            raise FormatError(msg)
        return {
            entry.filename: _unpacked(archive, entry, fault)
            for entry in entries
            if wanted(entry.filename)
        }


def _unpacked(archive: zipfile.ZipFile, entry: zipfile.ZipInfo, fault: str) -> bytearray:
    """Return a file's content, never more of it than its entry announces."""
    if entry.flag_bits & _ENCRYPTED:
        msg = f"{fault}{entry.filename!r} in its archive is encrypted"
        raise FormatError(msg)
    if entry.compress_type not in {zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED}:
        msg = (  # the library unpacks the others without a limit
            f"{fault}{entry.filename!r} is compressed by another method than ZIP's own; pack it "
            "with deflate, or not at all"
        )
        raise FormatError(msg)
    # Deflate makes at most 1032 bytes of one, so the rest is a lie that would only take memory.
    if entry.file_size > 1040 * entry.compress_size + 64:
        msg = f"{fault}{entry.filename!r} announces more bytes than its archive can hold"
        raise FormatError(msg)
    content = bytearray(entry.file_size)
    view, done = memoryview(content), 0
    with archive.open(entry) as file:
        while piece := file.read(_PIECE):
            view[done : done + len(piece)] = piece
            done += len(piece)
    if done != len(content):
        msg = f"{fault}{entry.filename!r} in its archive is cut off"
        raise FormatError(msg)
    return content


def _header(
    data: bytes | bytearray, source: Path | str, what: str, kinds: str
) -> tuple[np.dtype[Any], Any, tuple[int, ...], int]:
    """Return type, order and shape that an NPY file announces, and where its numbers begin."""
    fault = f"{source} is not a readable {what}: "
    if not data.startswith(_MAGIC) or len(data) < 12:
        msg = f"{fault}expected an array of numpy (NPY)"
        raise FormatError(msg)
    size = 2 if data[6] == 1 else 4
    start = 8 + size + int.from_bytes(data[8 : 8 + size], "little")
    if data[6] not in {1, 2, 3} or data[7] != 0 or start > min(len(data), _LONGEST_HEADER):
        msg = f"{fault}the header of its array is damaged, or of a later version of NPY"
        raise FormatError(msg)
    header = bytes(data[8 + size : start]).decode("latin-1").strip()
    if "'|O'" in header or "'O'" in header:
        msg = f"{fault}its array holds Python objects, which are never read; save numbers alone"
        raise FormatError(msg)
    found = [pattern.findall(header) for pattern in (_DESCRIPTION, _ORDER, _SHAPE)]
    if not _HEADER.fullmatch(header) or any(len(each) != 1 for each in found):
        msg = f"{fault}the header of its array is damaged, or its array holds records"
        raise FormatError(msg)
    ((byte_order, kind, digits),), (order,), (axes,) = found
    kind = "b" if kind == "?" else kind
    itemsize = int(digits[:10] or 1)
    is_known = itemsize in _SIZES.get(kind, ()) or (kind in "SU" and digits)
    if kind not in kinds or not is_known:
        msg = f"{fault}its array holds values of the type {kind}{digits}; expected real numbers"
        if kind == "c":
            msg += ", got complex ones"
        raise FormatError(msg)
    shape = tuple(int(each.strip().rstrip("L")) for each in axes.split(",") if each.strip())
    if len(shape) > _MOST_AXES:
        msg = f"{fault}its array has {len(shape)} axes"
        raise FormatError(msg)
    name = "?" if kind == "b" else f"{kind}{itemsize}"
    return np.dtype(f"{byte_order}{name}"), "F" if order == "True" else "C", shape, start
