"""What pictures of captures have in common: brightening, marked pixels, rings, legends, encoding.

Grey values are brightened for display, by the square root, because stripes are often dark; every
number on a page is of the unchanged values.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import cv2
import numpy as np

from exposight.errors import ImageError
from exposight.report.colours import CLIPPED, NO_POINT, P_NORM_SCALE, css_gradient, rgb
from exposight.report.markup import escape

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from exposight.cell import Capture


_FULL_SCALE = 255.0
_TINT_OPACITY = 0.45
_JPEG_QUALITY = 90


@dataclass(frozen=True, kw_only=True)
class _Swatch:
    colour: str
    meaning: str


def brighten(grey: NDArray[np.uint8] | NDArray[np.float32]) -> NDArray[np.float64]:
    """Return grey values, 0–255, as display values, 0–255: the square root, for dark stripes."""
    return np.asarray(np.sqrt(np.asarray(grey, dtype=np.float64) / _FULL_SCALE) * _FULL_SCALE)


def mask_edge(rows: NDArray[np.int64], columns: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Tell which pixels of a mask, (n,) rows and columns, have a neighbour outside it."""
    top, left = int(rows.min()) - 1, int(columns.min()) - 1
    mask = np.zeros((int(rows.max()) - top + 2, int(columns.max()) - left + 2), dtype=np.uint8)
    mask[rows - top, columns - left] = 1
    inner = cv2.erode(mask, cv2.getStructuringElement(cv2.MORPH_CROSS, (3, 3)))
    return np.asarray(inner[rows - top, columns - left] == 0)


def marked_picture(capture: Capture) -> NDArray[np.uint8]:
    """Mark a stripe image's clipped pixels red, and those without a 3D point blue.

    Returns
    -------
    (rows, columns, 3) ndarray of uint8
        Red, green, blue; the whole image.
    """
    picture = grey_picture(capture)
    grey = capture.grey_levels()
    cloud = capture.cloud
    if cloud is not None and cloud.organised:
        rows, columns = np.nonzero(~cloud.valid)
        blend(picture, rows, columns, np.array(rgb(NO_POINT), dtype=np.float64), _TINT_OPACITY)
    picture[grey >= _FULL_SCALE] = rgb(CLIPPED)
    return np.rint(picture).astype(np.uint8)


def p_norm_legend() -> str:
    """Return the colour bar of p_norm."""
    return (
        '<div class="legend"><span><i>p</i><sub>norm</sub> (1)</span>'
        f'<span>0</span><span class="bar" style="background:{css_gradient(P_NORM_SCALE)}"></span>'
        "<span>1 and above</span></div>\n"
    )


def marked_legend() -> str:
    """Return the legend of `marked_picture`."""
    swatches = (
        _Swatch(colour=CLIPPED, meaning="clipped in this image (grey value 255)"),
        _Swatch(colour=NO_POINT, meaning="no 3D point"),
    )
    items = "".join(
        f'<span><span class="swatch" style="background:{item.colour}"></span> '
        f"{escape(item.meaning)}</span>"
        for item in swatches
    )
    return f'<div class="legend">{items}</div>\n'


def zoomable(tag: str) -> str:
    """Return an image that a click shows larger."""
    return (
        '<label class="zoom"><input type="checkbox" aria-label="show the picture in full size">'
        f"{tag}<span>click to enlarge</span></label>"
    )


def grey_picture(capture: Capture) -> NDArray[np.float64]:
    """Return a capture's image, brightened, as (rows, columns, 3) red, green and blue, 0–255."""
    return np.repeat(brighten(capture.grey_levels())[..., None], 3, axis=2)


def blend(
    picture: NDArray[np.float64],
    rows: NDArray[np.int64],
    columns: NDArray[np.int64],
    colour: NDArray[np.float64],
    opacity: float,
) -> None:
    """Lay a colour over pixels of a picture, in place."""
    picture[rows, columns] = (1 - opacity) * picture[rows, columns] + opacity * colour


def png(picture: NDArray[np.uint8]) -> bytes:
    """Return a picture as a PNG file."""
    return _encode(picture, ".png", [cv2.IMWRITE_PNG_COMPRESSION, 9])


def jpeg(picture: NDArray[np.uint8]) -> bytes:
    """Return a picture as a JPEG file."""
    # full colour resolution: single red pixels would blur away
    sampling = [cv2.IMWRITE_JPEG_SAMPLING_FACTOR, cv2.IMWRITE_JPEG_SAMPLING_FACTOR_444]
    return _encode(picture, ".jpg", [cv2.IMWRITE_JPEG_QUALITY, _JPEG_QUALITY, *sampling])


def _encode(picture: NDArray[np.uint8], suffix: str, options: list[int]) -> bytes:
    done, data = cv2.imencode(suffix, picture[..., ::-1], options)
    if not done:
        msg = f"a picture of shape {picture.shape} could not be encoded as {suffix}"
        raise ImageError(msg)
    return bytes(data)
