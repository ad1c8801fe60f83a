"""What the camera saw in the new view: whole frames, and unseen features close by."""

from __future__ import annotations

from typing import TYPE_CHECKING

import cv2
import numpy as np

from exposight.report.colours import P_NORM_SCALE, scale_rgb
from exposight.report.door.words import exposure_title
from exposight.report.images import (
    jpeg,
    marked_legend,
    marked_picture,
    p_norm_legend,
    png,
    zoomable,
)
from exposight.report.markup import escape, figure, fixed, image_tag, number

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from exposight.demo import DoorResult, NewView


_FRAME_WIDTH_PX = 1000
_RING_WIDTH_PX = 9
_HALO_WIDTH_PX = 17
"""White round the rings, so that a dark colour shows on a dark sheet."""
_MARGIN_PX = 14
_CLOSE_PX = 340
_HALF = 127
_LINE_PX = 2
_CLOSE_HALO_PX = 5
_FONT = cv2.FONT_HERSHEY_DUPLEX
_FONT_SCALE = 0.95
"""Still read where three frames stand side by side, at a third of their width."""


def frame_figure(number_: int, result: DoorResult) -> str:
    """Return the figure of the three whole frames."""
    view = result.new_view
    tiles = []
    for index in range(len(view.captures)):
        picture = framed_picture(view, index)
        title = exposure_title(view, index)
        alternative = (
            f"Stripe image at {title}; clipped pixels red, pixels without a point blue, rings "
            "coloured by measured p_norm"
        )
        size = (picture.shape[1], picture.shape[0])
        tag = image_tag(jpeg(picture), "image/jpeg", alternative, size)
        tiles.append(f"<div>{zoomable(tag)}<p>{escape(title)}</p></div>")
    caption = (
        "One view, three exposure times. Bare metal is the difficult case: glare clips while the "
        "sheet beside it is still too dark, so no single exposure time serves every feature. "
        "Rings are coloured by their measured <i>p</i><sub>norm</sub>. A pixel needs a valid "
        "value in all stripe images, so one that is blue here may be clipped in another. "
        "Brightened for display."
    )
    content = f'<div class="side over">{"".join(tiles)}</div>'
    return figure(number_, content, caption, marked_legend() + p_norm_legend())


def framed_picture(view: NewView, index: int) -> NDArray[np.uint8]:
    """Draw one capture with its marks, rings and names, small enough for a page.

    Returns
    -------
    (rows, columns, 3) ndarray of uint8
        Red, green, blue.
    """
    picture = marked_picture(view.captures[index])
    factor = _FRAME_WIDTH_PX / picture.shape[1]
    halo, wide = (
        cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (width, width))
        for width in (_HALO_WIDTH_PX, _RING_WIDTH_PX)
    )
    for seen, p_norm in zip(view.views, view.p_norm[:, index], strict=True):
        ring: NDArray[np.uint8] = np.zeros(picture.shape[:2], dtype=np.uint8)
        ring[seen.rows, seen.columns] = 1
        picture[cv2.dilate(ring, halo) > 0] = 255
        picture[cv2.dilate(ring, wide) > 0] = scale_rgb(P_NORM_SCALE, p_norm).astype(np.uint8)
    small = cv2.resize(picture, None, fx=factor, fy=factor, interpolation=cv2.INTER_AREA)
    for seen in view.views:
        place = (
            int(factor * seen.columns.max()) + 8,
            int(factor * seen.rows.mean()) + 9,
        )
        for colour, thickness in (((0, 0, 0), 6), ((255, 255, 255), 2)):
            cv2.putText(
                small, seen.feature.name, place, _FONT, _FONT_SCALE, colour, thickness, cv2.LINE_AA
            )
    return np.asarray(small, dtype=np.uint8)


def close_figure(number_: int, result: DoorResult) -> str:
    """Return the figure of the unseen features' neighbourhoods at the three exposure times."""
    view = result.new_view
    marked = [marked_picture(capture) for capture in view.captures]
    tiles = []
    for i, seen in enumerate(view.views):
        if seen.feature.name in result.train_features:
            continue
        for index, whole in enumerate(marked):
            picture = close_picture(whole, view, i, index)
            alternative = f"{seen.feature.name} at {exposure_title(view, index)}"
            tag = image_tag(
                png(picture), "image/png", alternative, (picture.shape[1], picture.shape[0])
            )
            tiles.append(f"<div>{tag}<p>{_close_title(view, i, index)}</p></div>")
    caption = (
        "The features that no model has seen, at full resolution, under the same three exposure "
        "times. The two circles bound the ring in which brightness is averaged and points are "
        "counted; their colour is the measured <i>p</i><sub>norm</sub>. Inside the holes there is "
        "no sheet, so no 3D point at any exposure time."
    )
    content = f'<div class="side close">{"".join(tiles)}</div>'
    return figure(number_, content, caption, marked_legend() + p_norm_legend())


def close_picture(
    whole: NDArray[np.uint8], view: NewView, feature: int, index: int
) -> NDArray[np.uint8]:
    """Cut a feature's neighbourhood from a marked picture, magnified, with its ring's outline."""
    seen = view.views[feature]
    reach = int(max(np.ptp(seen.rows), np.ptp(seen.columns))) // 2 + _MARGIN_PX
    row, column = int(seen.rows.mean()), int(seen.columns.mean())
    top, left = max(row - reach, 0), max(column - reach, 0)
    picture = whole[top : row + reach + 1, left : column + reach + 1]
    ring: NDArray[np.uint8] = np.zeros(picture.shape[:2], dtype=np.uint8)
    ring[seen.rows - top, seen.columns - left] = 1
    size = (_CLOSE_PX, round(_CLOSE_PX * picture.shape[0] / picture.shape[1]))
    large = cv2.resize(picture, size, interpolation=cv2.INTER_NEAREST)
    mask = cv2.resize(ring * 255, size, interpolation=cv2.INTER_LINEAR) > _HALF
    outlines, _ = cv2.findContours(mask.astype(np.uint8), cv2.RETR_LIST, cv2.CHAIN_APPROX_NONE)
    own = scale_rgb(P_NORM_SCALE, view.p_norm[feature, index]).tolist()
    for colour, thickness in (((255.0, 255.0, 255.0), _CLOSE_HALO_PX), (own, _LINE_PX)):
        cv2.drawContours(large, outlines, -1, colour, thickness, cv2.LINE_AA)
    return np.asarray(large, dtype=np.uint8)


def _close_title(view: NewView, feature: int, index: int) -> str:
    taken = view.taken
    return (
        f"{escape(taken.features[feature])}, {number(taken.exposures_ms[index])} ms: "
        f"<i>p</i><sub>norm</sub> {fixed(view.p_norm[feature, index], 2)}, predicted "
        f"{fixed(taken.p_norm[feature, index], 2)} ± "
        f"{fixed(2 * taken.p_norm_std[feature, index], 2)}"
    )
