"""Pictures of captures: clipped and missing pixels marked, rings coloured by their quality.

Grey values are brightened for display, by the square root, because stripes are often dark; every
number on a page is of the unchanged values.
"""

import base64
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from exposight.cell import Capture
from exposight.errors import ImageError
from exposight.observing import FeatureView
from exposight.report.palette import CLIPPED, NO_POINT, P_NORM_SCALE, rgb, scale_rgb

_FULL_SCALE = 255.0
_TINT_OPACITY = 0.45
_JPEG_QUALITY = 90
_FRAME_WIDTH_PX = 1000
_MARGIN = 0.06
"""Share of the rings' extent that is shown around them."""
_RING, _HALO = 1 / 270, 1 / 145
"""Widths of a ring and of the white round it, as shares of the picture's width."""
_NAMED = 30
"""More features than these are shown without names, their rings as thin as they are."""
_FILL_OPACITY, _EDGE_OPACITY = 0.15, 0.95
_CLOSE_PX = 340
_CLOSE_MARGIN_PX = 14
_LINE_PX, _CLOSE_HALO_PX = 2, 5
_HALF = 127
_FONT = cv2.FONT_HERSHEY_DUPLEX
_FONT_SCALE = 0.95
"""Still read where three frames stand side by side, at a third of their width."""


@dataclass(frozen=True, kw_only=True)
class Picture:
    """A picture on a page.

    Parameters
    ----------
    address : str
        The encoded picture itself, as a data address.
    alternative : str
        What it shows, for who cannot see it.
    title : str
        Stands below it.
    width, height : int
        In px.
    """

    address: str
    alternative: str
    title: str
    width: int
    height: int


def picture(pixels: NDArray[np.uint8], title: str, alternative: str, *, photo: bool) -> Picture:
    """Encode (rows, columns, 3) red, green, blue: a photo as JPEG, fine marks as PNG."""
    if photo:
        # full colour resolution: single red pixels would blur away
        sampling = [cv2.IMWRITE_JPEG_SAMPLING_FACTOR, cv2.IMWRITE_JPEG_SAMPLING_FACTOR_444]
        kind, options = "jpeg", [cv2.IMWRITE_JPEG_QUALITY, _JPEG_QUALITY, *sampling]
    else:
        kind, options = "png", [cv2.IMWRITE_PNG_COMPRESSION, 9]
    done, data = cv2.imencode(f".{kind}", pixels[..., ::-1], options)
    if not done:
        msg = f"a picture of shape {pixels.shape} could not be encoded as {kind}"
        raise ImageError(msg)
    return Picture(
        address=f"data:image/{kind};base64,{base64.b64encode(bytes(data)).decode()}",
        alternative=alternative,
        title=title,
        width=pixels.shape[1],
        height=pixels.shape[0],
    )


def brighten(grey: NDArray[np.uint8] | NDArray[np.float32]) -> NDArray[np.float64]:
    """Return grey values, 0–255, as display values, 0–255: the square root, for dark stripes."""
    return np.asarray(np.sqrt(np.asarray(grey, dtype=np.float64) / _FULL_SCALE) * _FULL_SCALE)


def marked_picture(capture: Capture) -> NDArray[np.uint8]:
    """Mark a stripe image's clipped pixels red, and those without a 3D point blue.

    Returns
    -------
    (rows, columns, 3) ndarray of uint8
        Red, green, blue; the whole image.
    """
    grey = capture.grey_levels()
    pixels = np.repeat(brighten(grey)[..., None], 3, axis=2)
    cloud = capture.cloud
    if cloud is not None and cloud.organised:
        missing = on_grid(~cloud.valid, grey.shape)
        _blend(pixels, missing, np.array(rgb(NO_POINT), dtype=np.float64), _TINT_OPACITY)
    pixels[grey >= _FULL_SCALE] = rgb(CLIPPED)
    return np.rint(pixels).astype(np.uint8)


def ringed_picture(
    marked: NDArray[np.uint8], views: Sequence[FeatureView], p_norm: NDArray[np.float64]
) -> NDArray[np.uint8]:
    """Draw rings coloured by p_norm, with names where there are few, cut to the rings' extent.

    Parameters
    ----------
    marked : (rows, columns, 3) ndarray of uint8
        A whole image, see `marked_picture`.
    views : sequence of FeatureView
        The n features that it shows.
    p_norm : (n,) ndarray
        NaN where a feature was not measured.

    Returns
    -------
    (rows, columns, 3) ndarray of uint8
        Red, green, blue, small enough for a page.
    """
    pixels = marked.copy()
    colours = scale_rgb(P_NORM_SCALE, np.nan_to_num(p_norm))
    named = len(views) <= _NAMED
    for view, colour, value in zip(views, colours, p_norm, strict=True):
        if np.isnan(value):
            continue
        ring = np.zeros(pixels.shape[:2], dtype=np.uint8)
        ring[view.rows, view.columns] = 1
        if named:
            pixels[_widened(ring, _HALO) > 0] = 255
            pixels[_widened(ring, _RING) > 0] = colour.astype(np.uint8)
            continue
        inner = cv2.erode(ring, cv2.getStructuringElement(cv2.MORPH_CROSS, (3, 3)))
        for mask, opacity in ((inner > 0, _FILL_OPACITY), (ring > inner, _EDGE_OPACITY)):
            _blend(pixels, mask, colour, opacity)
    rows, columns = (
        _extent(np.concatenate([getattr(view, side) for view in views]), size)
        for side, size in zip(("rows", "columns"), pixels.shape[:2], strict=True)
    )
    factor = min(1.0, _FRAME_WIDTH_PX / (columns.stop - columns.start))
    cut = pixels[rows, columns]
    small = cv2.resize(cut, None, fx=factor, fy=factor, interpolation=cv2.INTER_AREA)
    for view in views if named else ():
        place = (
            round(factor * (view.columns.max() - columns.start)) + 8,
            round(factor * (view.rows.mean() - rows.start)) + 9,
        )
        for ink, thickness in (((0, 0, 0), 6), ((255, 255, 255), 2)):
            cv2.putText(
                small, view.feature.name, place, _FONT, _FONT_SCALE, ink, thickness, cv2.LINE_AA
            )
    return np.asarray(small, dtype=np.uint8)


def close_picture(marked: NDArray[np.uint8], view: FeatureView, p_norm: float) -> NDArray[np.uint8]:
    """Cut a feature's neighbourhood from a marked picture, magnified, with its ring's outline."""
    reach = int(max(np.ptp(view.rows), np.ptp(view.columns))) // 2 + _CLOSE_MARGIN_PX
    row, column = int(view.rows.mean()), int(view.columns.mean())
    top, left = max(row - reach, 0), max(column - reach, 0)
    pixels = marked[top : row + reach + 1, left : column + reach + 1]
    ring = np.zeros(pixels.shape[:2], dtype=np.uint8)
    ring[view.rows - top, view.columns - left] = 1
    size = (_CLOSE_PX, round(_CLOSE_PX * pixels.shape[0] / pixels.shape[1]))
    large = cv2.resize(pixels, size, interpolation=cv2.INTER_NEAREST)
    smooth = cv2.resize(255 * ring, size, interpolation=cv2.INTER_LINEAR)
    edges, _ = cv2.findContours(
        (smooth > _HALF).astype(np.uint8), cv2.RETR_CCOMP, cv2.CHAIN_APPROX_NONE
    )
    colour = scale_rgb(P_NORM_SCALE, p_norm).tolist()
    cv2.drawContours(large, edges, -1, (255, 255, 255), _CLOSE_HALO_PX, cv2.LINE_AA)
    cv2.drawContours(large, edges, -1, colour, _LINE_PX, cv2.LINE_AA)
    return np.asarray(large, dtype=np.uint8)


def _widened(ring: NDArray[np.uint8], share: float) -> NDArray[np.uint8]:
    width = max(3, round(share * ring.shape[1]) | 1)
    kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (width, width))
    return np.asarray(cv2.dilate(ring, kernel), dtype=np.uint8)


def on_grid(image: NDArray[np.generic], shape: tuple[int, ...]) -> NDArray[Any]:
    """Return an image (rows, columns) on a finer or coarser grid of the same view: nearest pixels.

    Clouds may have half or a quarter of the image's rows and columns.
    """
    if image.shape == shape:
        return image
    rows, columns = (
        np.arange(size) * there // size for size, there in zip(shape, image.shape, strict=True)
    )
    return np.asarray(image[np.ix_(rows, columns)])


def _blend(
    pixels: NDArray[np.float64] | NDArray[np.uint8],
    mask: NDArray[np.bool_],
    colour: NDArray[np.float64],
    opacity: float,
) -> None:
    mixed = (1 - opacity) * pixels[mask] + opacity * colour
    pixels[mask] = mixed if pixels.dtype == np.float64 else np.rint(mixed)


def _extent(places: NDArray[np.int64], size: int) -> slice:
    low, high = int(places.min()), int(places.max())
    margin = round(_MARGIN * (high - low)) + 20
    return slice(max(0, low - margin), min(size, high + margin + 1))
