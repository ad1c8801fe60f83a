"""Image files by their content, whatever they are called."""

import os
import re
import struct
from contextlib import suppress
from pathlib import Path
from typing import Any
from zlib import crc32

import cv2
import numpy as np
from numpy.typing import NDArray

from exposight.errors import ImageError

if "OPENCV_LOG_LEVEL" not in os.environ:
    # OpenCV tells on standard error, in C++'s words, what we say in ours.
    cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)

MOST_PIXELS = 400_000_000
"""Of an image; cameras have up to 150 million."""
_MOST_BYTES = 2_000_000_000
"""Of an image, decoded."""
_MOST_PACKED = 1400
"""Bytes that one byte of a file can stand for: 1032 by deflate, 1340 by LZW, fewer by JPEG."""

_PNG = b"\x89PNG\r\n\x1a\n"
_FILM = frozenset({b"acTL", b"fcTL", b"fdAT"})
_SIGNATURES = (b"\x89PNG", b"II*\0", b"MM\0*", b"\xff\xd8\xff")
_REDUCED = 1
"""Bit of TIFF's NewSubfileType that marks a smaller copy of another page."""
_MOST_PAGES = 1000


def is_image(start: bytes) -> bool:
    """Tell by its first bytes whether a file is a PNG, TIFF or JPEG image."""
    return start.startswith(_SIGNATURES)


def is_lossy(data: bytes) -> bool:
    """Tell whether an image is JPEG, whose compression changes grey levels."""
    return data.startswith(b"\xff\xd8\xff")


def decoded_image(data: bytes, path: Path) -> NDArray[Any]:
    """Return an image as its file holds it: bits, channels (BGR) and orientation unchanged.

    Parameters
    ----------
    data : bytes
        The whole file: PNG, TIFF, BMP, JPEG or PGM.
    path : Path
        Its name, for messages.

    Raises
    ------
    ImageError
        If it is no image, is cut off, has several pages or too many pixels. Its header is held
        against its length and the limits before it is decoded.
    """
    pages = _pages(data)
    if pages > 1:
        msg = (
            f"{path}: a TIFF of {pages} pages; which one is meant the file does not say: save each "
            "page as a file of its own"
        )
        raise ImageError(msg)
    size = _announced(data)
    if size is not None and _is_whole(data):
        _check_size(size, len(data), path)
        with suppress(cv2.error):
            image = cv2.imdecode(np.frombuffer(data, dtype=np.uint8), cv2.IMREAD_UNCHANGED)
            if image is not None and image.shape[:2] == size[:2]:
                return np.asarray(image)
    msg = (
        f"{path}: cannot be read as an image; it may be truncated: copy or record it again "
        "(PNG, TIFF, BMP, JPEG and PGM are read)"
    )
    raise ImageError(msg)


def announced_pixels(data: bytes) -> int | None:
    """Return how many pixels an image's header announces; None where it is no header of one."""
    size = _announced(data)
    return None if size is None else size[0] * size[1]


def _check_size(size: tuple[int, int, int], there: int, path: Path) -> None:
    """Raise where an image's header announces what no camera records, or its bytes cannot hold."""
    rows, columns, pixel_bytes = size
    if rows * columns > MOST_PIXELS or rows * columns * pixel_bytes > _MOST_BYTES:
        msg = (
            f"{path}: an image of {rows} rows × {columns} columns of {pixel_bytes} bytes; up to "
            f"{MOST_PIXELS} pixels and {_MOST_BYTES} bytes are read"
        )
        raise ImageError(msg)
    if rows * columns * pixel_bytes > _MOST_PACKED * there:
        msg = (
            f"{path} is truncated or wrong: its header announces {rows} rows × {columns} columns, "
            f"more than {there} bytes can hold; copy or record it again"
        )
        raise ImageError(msg)


def _is_whole(data: bytes) -> bool:
    """Tell whether a file reaches its end, as far as its decoder takes what is missing for grey."""
    if data.startswith(_PNG):
        return _has_whole_chunks(data)
    if is_lossy(data):
        return data.rfind(b"\xff\xd9") > data.rfind(b"\xff\xda")
    return True


def _has_whole_chunks(data: bytes) -> bool:
    """Tell whether a PNG's chunks, one header and no film, are there with right checksums."""
    at, heads, view = len(_PNG), 0, memoryview(data)
    while at + 12 <= len(data):
        length, kind = struct.unpack_from(">I4s", data, at)
        at += 12 + length
        body, check = view[at - 8 - length : at - 4], view[at - 4 : at]
        if at > len(data) or crc32(body) != int.from_bytes(check, "big"):
            return False
        heads += kind == b"IHDR"
        if kind == b"IEND":
            return bool(heads == 1)
        if kind in _FILM:
            return False
    return False


def _announced(data: bytes) -> tuple[int, int, int] | None:
    """Return the rows, columns and bytes of a pixel that an image's header announces, or None."""
    try:
        if data.startswith(_PNG):
            columns, rows, bits, kind = struct.unpack_from(">IIBB", data, 16)
            samples = {0: 1, 2: 3, 3: 3, 4: 4, 6: 4}.get(kind, 4)
            size = rows, columns, samples * max(bits // 8, 1)
        elif data.startswith((b"II*\0", b"MM\0*")):
            size = _tiff_size(data)
        elif is_lossy(data):
            size = _jpeg_size(data)
        elif data.startswith(b"BM"):
            is_old = struct.unpack_from("<I", data, 14)[0] == 12
            form, at = ("<HHHH", 18) if is_old else ("<iiHH", 18)
            columns, rows, _, bits = struct.unpack_from(form, data, at)
            size = abs(rows), columns, max(bits // 8, 3)
        elif match := _PNM.match(data):
            samples = 3 if match[1] in b"36" else 1
            size = int(match[3]), int(match[2]), samples * (1 if len(match[4]) < 4 else 2)
        else:
            return None
    except struct.error:
        return None
    return size if min(size) > 0 else None


_PNM = re.compile(
    rb"P([2356])(?:\s|#[^\n]{0,1000}\n)+(\d{1,9})(?:\s|#[^\n]{0,1000}\n)+(\d{1,9})"
    rb"(?:\s|#[^\n]{0,1000}\n)+(\d{1,5})\s"
)


def _jpeg_size(data: bytes) -> tuple[int, int, int]:
    """Return the size in a JPEG's frame header; zeros where it has none before its data."""
    at = 2
    while True:
        mark, length = struct.unpack_from(">HH", data, at)
        if mark == 0xFFFF:  # filled up
            at += 1
        elif 0xFFC0 <= mark <= 0xFFCF and mark not in {0xFFC4, 0xFFC8, 0xFFCC}:
            rows, columns, samples = struct.unpack_from(">HHB", data, at + 5)
            return rows, columns, samples
        elif mark < 0xFF01 or mark == 0xFFDA or length < 2:
            return 0, 0, 0
        else:
            at += 2 + length


def _tiff_size(data: bytes) -> tuple[int, int, int]:
    """Return the size of a TIFF's first page, or of its tiles where those are larger."""
    order = "<" if data.startswith(b"II") else ">"
    (at,) = struct.unpack_from(order + "I", data, 4)
    (entries,) = struct.unpack_from(order + "H", data, at)
    told = {256: 0, 257: 0, 258: 1, 277: 1, 322: 0, 323: 0}
    for k in range(entries):
        tag, kind, count = struct.unpack_from(order + "HHI", data, at + 2 + 12 * k)
        if tag in told:
            form = order + ("H" if kind == 3 else "I")
            where = at + 10 + 12 * k
            if kind == 3 and count > 2:  # one for each channel, elsewhere
                (where,) = struct.unpack_from(order + "I", data, where)
            (told[tag],) = struct.unpack_from(form, data, where)
    struct.unpack_from(order + "I", data, at + 2 + 12 * entries)  # its end is there
    columns, rows, bits, samples, tile_columns, tile_rows = told.values()
    if tile_columns > columns + 4096 or tile_rows > rows + 4096:
        return 0, 0, 0
    return rows, columns, max(bits // 8, 1) * samples


def _pages(data: bytes) -> int:
    """Return how many pages a TIFF has, without smaller copies of others; 1 of other images."""
    order = {b"II*\0": "<", b"MM\0*": ">"}.get(data[:4])
    if order is None:
        return 1
    pages, seen = 0, set[int]()
    (at,) = struct.unpack_from(order + "I", data.ljust(8, b"\0"), 4)
    while at and at not in seen and at + 2 <= len(data) and len(seen) < _MOST_PAGES:
        seen.add(at)
        (entries,) = struct.unpack_from(order + "H", data, at)
        end = at + 2 + 12 * entries
        if end + 4 > len(data):
            break
        tags = (struct.unpack_from(order + "HHII", data, at + 2 + 12 * k) for k in range(entries))
        pages += not any(tag == 254 and value & _REDUCED for tag, _, _, value in tags)
        (at,) = struct.unpack_from(order + "I", data, end)
    return max(pages, 1)
