"""Pictures of the recording: features' rings on the stripe image, and three exposures side by side.

The pictures only show what the result holds. Grey values are brightened for display, by the square
root, because the recorded stripes are dark; every number on the page is of the unchanged values.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import cv2
import numpy as np

from exposight.errors import ImageError
from exposight.report.colours import (
    CLIPPED,
    NO_POINT,
    P_NORM_SCALE,
    css_gradient,
    rgb,
    scale_rgb,
)
from exposight.report.markup import escape, figure, image_tag, number
from exposight.report.selection import (
    nominal_capture,
    object_crop,
    ring_values,
    visible_views,
)

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from exposight.cell import Capture
    from exposight.demo import DemoResult

__all__ = ["p_norm_legend", "ring_figure", "sweep_figure"]

_FULL_SCALE = 255.0
_FILL_OPACITY = 0.22
_EDGE_OPACITY = 0.95
_TINT_OPACITY = 0.45
_JPEG_QUALITY = 90


@dataclass(frozen=True, kw_only=True)
class _Swatch:
    colour: str
    meaning: str


def brighten(grey: NDArray[np.uint8] | NDArray[np.float32]) -> NDArray[np.float64]:
    """Return grey values, 0–255, as display values, 0–255: the square root, for dark stripes."""
    return np.asarray(np.sqrt(np.asarray(grey, dtype=np.float64) / _FULL_SCALE) * _FULL_SCALE)


def ring_picture(result: DemoResult) -> NDArray[np.uint8]:
    """Draw the masks of all visible features, coloured by p_norm, on the nominal stripe image.

    Returns
    -------
    (rows, columns, 3) ndarray of uint8
        Red, green, blue; the whole image.
    """
    capture = nominal_capture(result)
    picture = _grey_picture(capture)
    values = ring_values(result, capture.exposure_ms)
    for view in visible_views(result):
        p_norm = values.get(view.feature.name)
        if p_norm is None:
            continue
        colour = scale_rgb(P_NORM_SCALE, p_norm)
        edge = mask_edge(view.rows, view.columns)
        _blend(picture, view.rows, view.columns, colour, _FILL_OPACITY)
        _blend(picture, view.rows[edge], view.columns[edge], colour, _EDGE_OPACITY)
    return np.rint(picture).astype(np.uint8)


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
    picture = _grey_picture(capture)
    grey = capture.grey_levels()
    if capture.cloud.organised:
        rows, columns = np.nonzero(~capture.cloud.valid)
        _blend(picture, rows, columns, np.array(rgb(NO_POINT), dtype=np.float64), _TINT_OPACITY)
    picture[grey >= _FULL_SCALE] = rgb(CLIPPED)
    return np.rint(picture).astype(np.uint8)


def ring_figure(number_: int, result: DemoResult) -> str:
    """Return the figure of the stripe image with the rings."""
    capture = nominal_capture(result)
    crop = object_crop(result)
    picture = crop.of(ring_picture(result))
    tag = image_tag(
        _png(picture),
        "image/png",
        "Stripe image with the rings of all features, coloured by p_norm",
        (crop.width, crop.height),
    )
    content = (
        '<label class="zoom"><input type="checkbox" aria-label="show the picture in full size">'
        f"{tag}<span>click to enlarge</span></label>"
    )
    caption = (
        f"The stripe image at the nominal {number(capture.exposure_ms)} ms with the rings in which "
        "brightness is averaged and points are counted, coloured by <i>p</i><sub>norm</sub>: see "
        "that they lie on smooth surface, and that nearly every pixel gave a point (yellow), for "
        "features were placed where this very cloud is whole. Cropped to the object, brightened "
        "for display."
    )
    return figure(number_, content, caption, p_norm_legend())


def sweep_figure(number_: int, result: DemoResult) -> str:
    """Return the figure of the sweep's captures side by side, clipped and missing pixels marked."""
    crop = object_crop(result)
    pictures = []
    for capture in result.sweep:
        picture = crop.of(marked_picture(capture))
        origin = "emulated" if capture.emulated else "recorded"
        title = f"{number(capture.exposure_ms)} ms, {origin}"
        tag = image_tag(
            _jpeg(picture),
            "image/jpeg",
            f"Stripe image at {title}; clipped pixels red, pixels without a point blue",
            (crop.width, crop.height),
        )
        pictures.append(f"<div>{tag}<p>{escape(title)}</p></div>")
    caption = (
        "Three steps of the exposure sweep: see how dark surfaces lose their points where the "
        "exposure is short, and bright ones where it is long. The fringes move from frame to "
        "frame, so a pixel that is blue here may be clipped in another frame. Same crop and "
        "brightening as above."
    )
    swatches = (
        _Swatch(colour=CLIPPED, meaning="clipped in this image (grey value 255)"),
        _Swatch(colour=NO_POINT, meaning="no 3D point"),
    )
    return figure(
        number_, f'<div class="side">{"".join(pictures)}</div>', caption, _swatches(swatches)
    )


def p_norm_legend() -> str:
    """Return the colour bar of p_norm."""
    return (
        '<div class="legend"><span><i>p</i><sub>norm</sub> (1)</span>'
        f'<span>0</span><span class="bar" style="background:{css_gradient(P_NORM_SCALE)}"></span>'
        "<span>1 and above</span></div>\n"
    )


def _swatches(swatches: tuple[_Swatch, ...]) -> str:
    items = "".join(
        f'<span><span class="swatch" style="background:{item.colour}"></span> '
        f"{escape(item.meaning)}</span>"
        for item in swatches
    )
    return f'<div class="legend">{items}</div>\n'


def _grey_picture(capture: Capture) -> NDArray[np.float64]:
    return np.repeat(brighten(capture.grey_levels())[..., None], 3, axis=2)


def _blend(
    picture: NDArray[np.float64],
    rows: NDArray[np.int64],
    columns: NDArray[np.int64],
    colour: NDArray[np.float64],
    opacity: float,
) -> None:
    picture[rows, columns] = (1 - opacity) * picture[rows, columns] + opacity * colour


def _png(picture: NDArray[np.uint8]) -> bytes:
    return _encode(picture, ".png", [cv2.IMWRITE_PNG_COMPRESSION, 9])


def _jpeg(picture: NDArray[np.uint8]) -> bytes:
    # full colour resolution: single red pixels would blur away
    sampling = [cv2.IMWRITE_JPEG_SAMPLING_FACTOR, cv2.IMWRITE_JPEG_SAMPLING_FACTOR_444]
    return _encode(picture, ".jpg", [cv2.IMWRITE_JPEG_QUALITY, _JPEG_QUALITY, *sampling])


def _encode(picture: NDArray[np.uint8], suffix: str, options: list[int]) -> bytes:
    done, data = cv2.imencode(suffix, picture[..., ::-1], options)
    if not done:
        msg = f"a picture of shape {picture.shape} could not be encoded as {suffix}"
        raise ImageError(msg)
    return bytes(data)
