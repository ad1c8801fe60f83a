"""Grey images: bit depths, full scale, and the 8-bit scale on which brightness is given."""

from typing import Any, Literal, TypeAlias, cast, get_args

import cv2
import numpy as np
from numpy.typing import NDArray

from exposight.errors import ImageError

Image: TypeAlias = "NDArray[np.uint8] | NDArray[np.uint16]"

BitDepth = Literal[8, 9, 10, 11, 12, 13, 14, 15, 16]
"""Bits of a grey level: 8 in uint8, more in the low bits of uint16."""

BIT_DEPTHS: tuple[int, ...] = get_args(BitDepth)

GREY_MAX = 255.0
"""Full scale of the paper's grey levels, on which brightness is given whatever the bit depth."""

# Of nine combinations measured on stripe images, whole ones and such that are mostly 0, the
# quickest to write and to read, and within a tenth of the smallest.
_PNG_OPTIONS = (
    *(cv2.IMWRITE_PNG_COMPRESSION, 1),
    *(cv2.IMWRITE_PNG_STRATEGY, cv2.IMWRITE_PNG_STRATEGY_RLE),
    *(cv2.IMWRITE_PNG_FILTER, cv2.IMWRITE_PNG_FILTER_UP),
)


def full_scale(bit_depth: int) -> int:
    """Return the largest grey level of a bit depth, at which a pixel counts as clipped.

    Raises
    ------
    ImageError
        If there is no such bit depth.
    """
    if bit_depth not in BIT_DEPTHS:
        msg = (
            f"a bit depth must be a whole number from {BIT_DEPTHS[0]} to {BIT_DEPTHS[-1]}, got "
            f"{bit_depth}"
        )
        raise ImageError(msg)
    return int(2**bit_depth) - 1


def check_levels(image: NDArray[Any], bit_depth: int, name: str) -> Image:
    """Return an image, or a stack of images, whose grey levels are of the bit depth said.

    Parameters
    ----------
    image : ndarray
        uint8 for 8 bits, uint16 for more, which use the low bits.
    bit_depth : int
        Bits of a grey level, 8 to 16.
    name : str
        What it is, for messages.

    Raises
    ------
    ImageError
        If there is no such bit depth, or the type or a grey level is another's.
    """
    highest = full_scale(bit_depth)
    expected = np.dtype(np.uint8 if bit_depth == 8 else np.uint16)
    if image.dtype != expected:
        msg = (
            f"{name}: expected {bit_depth} bits in {expected}, got {image.dtype}; say its true bit "
            f"depth ({BIT_DEPTHS[0]} to {BIT_DEPTHS[-1]}), or convert it"
        )
        raise ImageError(msg)
    if 8 < bit_depth < 16 and int(image.max()) > highest:
        msg = (
            f"{name}: grey levels of {bit_depth} bits go up to {highest}, got {int(image.max())}; "
            "say the true bit depth, or, if the camera writes the high bits of 16, shift the "
            f'values right by {16 - bit_depth} (of files: alignment "high")'
        )
        raise ImageError(msg)
    return image


def right_aligned(image: NDArray[Any], bit_depth: int, name: str) -> Image:
    """Return an image whose grey levels stand in the high bits of 16 with these in the low bits.

    Parameters
    ----------
    image : ndarray of uint16
        Its low bits are 0, or repeat the highest ones, as drivers fill them.
    bit_depth : int
        Bits of a grey level, 8 to 16.
    name : str
        What it is, for messages.

    Raises
    ------
    ImageError
        If it is not of 16 bits, or the low bits hold something else.
    """
    full_scale(bit_depth)  # refuses others
    if image.dtype != np.uint16:
        msg = f"{name}: grey levels in the high bits need an image of uint16, got {image.dtype}"
        raise ImageError(msg)
    low = image & np.uint16((1 << (16 - bit_depth)) - 1)
    if low.any() and not np.array_equal(low, image >> np.uint16(bit_depth)):
        used = int(np.bitwise_or.reduce(image, axis=None))
        lowest = (used & -used).bit_length() - 1
        msg = (
            f"{name}: of {bit_depth} bits in the high bits of 16 the low {16 - bit_depth} are 0 or "
            f"repeat the highest, but bit {lowest} is used here; say the true bit depth, or "
            'alignment "low"'
        )
        raise ImageError(msg)
    levels = image >> np.uint16(16 - bit_depth)
    return cast("Image", levels.astype(np.uint8) if bit_depth == 8 else levels)


def read_only(image: NDArray[Any], bit_depth: int, name: str) -> Image:
    """Return a grey image that nobody can change: a copy, unless it is one already.

    Cameras fill the same buffer with their next image.

    Parameters
    ----------
    image, bit_depth, name
        As for `check_levels`.

    Raises
    ------
    ImageError
        If it is no grey image, or not of the bit depth said.
    """
    if image.ndim != 2 or image.size == 0:
        what = "a colour image" if image.ndim == 3 else "an array"
        msg = (
            f"{name}: a capture needs a grey image of shape (rows, columns), got {what} of shape "
            f"{image.shape}; convert it to grey"
        )
        raise ImageError(msg)
    checked = check_levels(image, bit_depth, name)
    if checked.flags.writeable or checked.base is not None:
        checked = checked.copy()
        checked.setflags(write=False)
    return checked


def png_bytes(image: Image) -> bytes:
    """Return a grey image as the content of a lossless PNG file.

    Raises
    ------
    ImageError
        If PNG has nothing for such an array.
    """
    done, encoded = cv2.imencode(".png", image, _PNG_OPTIONS)
    if not done:
        msg = f"an image of shape {image.shape} and type {image.dtype} cannot be written as PNG"
        raise ImageError(msg)
    return bytes(encoded.tobytes())
