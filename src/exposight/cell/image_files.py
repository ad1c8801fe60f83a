"""Image files by their content, whatever they are called."""

import struct
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from exposight.errors import ImageError

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
        The whole file: PNG, TIFF, BMP, JPEG, PGM or another that OpenCV reads.
    path : Path
        Its name, for messages.

    Raises
    ------
    ImageError
        If it is no image, is cut off, or has several pages.
    """
    pages = _pages(data)
    if pages > 1:
        msg = (
            f"{path}: a TIFF of {pages} pages; which one is meant the file does not say: save each "
            "page as a file of its own"
        )
        raise ImageError(msg)
    image = None
    if data:
        try:
            image = cv2.imdecode(np.frombuffer(data, dtype=np.uint8), cv2.IMREAD_UNCHANGED)
        except cv2.error:  # too many pixels, say
            image = None
    if image is None:
        msg = (
            f"{path}: cannot be read as an image; it may be truncated: copy or record it again "
            "(PNG, TIFF, BMP, JPEG and PGM are read)"
        )
        raise ImageError(msg)
    return np.asarray(image)


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
