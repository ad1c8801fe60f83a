"""Do rows of a rectified pair correspond? Some corners are looked for above and below their row.

Matching compares rows with rows. Swapped images, raw ones taken for rectified, or those of another
camera give disparities all the same, of chance; but the corners of the first image are then not on
their row of the second.
"""

from collections.abc import Mapping
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from exposight.contradictions import Contradiction
from exposight.contradictions.epipolar import rows_correspond
from exposight.imaging.rectification import RectifiedPair

_CORNERS = 120
_REACH_PX = 10
"""Squares of 21 × 21 px are compared: some dots, more than noise."""
_LEAST_ROWS, _SHARE_OF_ROWS = 16, 0.03
"""So far above and below is looked: this many px, or this share of the image's height."""
_WIDE_SHARE_OF_ROWS = 0.1
_WIDE_FOUND = 0.3
"""Where hardly a corner is found near its row, all of the second image's columns are looked at, and
more rows; if that finds this share of the corners, they say how far off rows are."""
_LEAST_CORRELATION = 0.7
_UNIQUE_BY = 0.1
"""The second best place must correlate this much less."""
_ON_ROW_PX = 1.0


class RowOffsets(NamedTuple):
    """How far below its row each corner was found, px, and how many were looked for."""

    offsets_px: NDArray[np.float64]
    looked_for: int

    @property
    def on_row(self) -> float:
        """Share of the corners looked for that are on their row."""
        near = np.count_nonzero(np.abs(self.offsets_px) <= _ON_ROW_PX)
        return near / self.looked_for if self.looked_for else 0.0


def check_rows(
    first_image: NDArray[np.uint8],
    second_image: NDArray[np.uint8],
    pair: RectifiedPair,
    *,
    depth_limits_mm: tuple[float, float],
    others: Mapping[str, RectifiedPair] | None = None,
) -> Contradiction | None:
    """Check that corners of the first image lie on the same row of the second, both rectified.

    Parameters
    ----------
    first_image, second_image : (rows, columns) ndarray of uint8
        As recorded, of the cameras' sizes.
    pair : RectifiedPair
        The cameras.
    depth_limits_mm : (float, float), mm
        Nearest and farthest Z in the first camera's frame.
    others : mapping of str to RectifiedPair, optional
        What else the cameras may be, to be tried where rows do not correspond.
    """
    turned = pair.turn(first_image, second_image)
    found = _row_offsets(*turned, pair.disparity_range(depth_limits_mm))
    if rows_correspond(found.offsets_px, found.looked_for) is None and found.on_row >= 0.5:
        return None
    tried: dict[str, float] = {}
    if first_image.shape == second_image.shape:
        swapped = pair.turn(second_image, first_image)
        reach = pair.disparity_range(depth_limits_mm)
        tried["swapping both images"] = _row_offsets(*swapped, reach).on_row
        if turned[0] is not first_image:
            as_they_are = _row_offsets(first_image, second_image, reach).on_row
            tried["taking the images as rectified already (--rectified)"] = as_they_are
    for name, other in (others or {}).items():
        reach = other.disparity_range(depth_limits_mm)
        tried[name] = _row_offsets(*other.turn(first_image, second_image), reach).on_row
    contradiction = rows_correspond(found.offsets_px, found.looked_for, tried)
    if contradiction is None:  # perhaps they lie where nothing was looked for
        width = float(turned[0].shape[1])
        wide = _row_offsets(*turned, (-width, width), _WIDE_SHARE_OF_ROWS)
        if len(wide.offsets_px) > _WIDE_FOUND * wide.looked_for:
            contradiction = rows_correspond(wide.offsets_px, wide.looked_for, tried)
    return contradiction


def _row_offsets(
    first: NDArray[np.uint8],
    second: NDArray[np.uint8],
    disparities_px: tuple[float, float],
    share_of_rows: float = _SHARE_OF_ROWS,
) -> RowOffsets:
    """Look for the first rectified image's corners in the second."""
    rows = first.shape[0]
    off = max(_LEAST_ROWS, round(share_of_rows * rows))
    least, greatest = (round(each) for each in disparities_px)
    reach = _REACH_PX
    # Where a match may be: within the second image for the least disparity at any rate.
    inside = np.zeros(first.shape, dtype=np.uint8)
    inside[reach + 2 : -reach - 2, max(least, 0) + reach + 2 : -reach - 2] = 1
    whole = inside.copy()
    whole[:, : min(greatest + reach + 2, first.shape[1])] = 0
    # Spread: a grid of corners, not the strongest alone.
    corners = cv2.goodFeaturesToTrack(
        first,
        maxCorners=_CORNERS,
        qualityLevel=0.02,
        minDistance=max(4.0, np.sqrt(first.size / _CORNERS) / 2),
        mask=whole if whole.mean() > 0.1 else inside,
    )
    if corners is None:
        return RowOffsets(np.empty(0), 0)
    offsets = []
    for x, y in corners.reshape(-1, 2).round().astype(int):
        template = first[y - reach : y + reach + 1, x - reach : x + reach + 1]
        top, bottom = max(y - off - reach, 0), min(y + off + reach + 1, second.shape[0])
        left = max(x - greatest - reach - 1, 0)
        right = min(x - least + reach + 2, second.shape[1])
        area = second[top:bottom, left:right]
        if area.shape[0] < template.shape[0] or area.shape[1] < template.shape[1]:
            continue
        scores = cv2.matchTemplate(area, template, cv2.TM_CCOEFF_NORMED)
        scores = np.nan_to_num(scores, posinf=0.0, neginf=0.0)
        row, column = np.unravel_index(int(np.argmax(scores)), scores.shape)
        best = float(scores[row, column])
        rest = scores.copy()
        rest[max(row - 3, 0) : row + 4, max(column - 3, 0) : column + 4] = -1.0
        if best >= _LEAST_CORRELATION and float(rest.max()) <= best - _UNIQUE_BY:
            offsets.append(
                float(row) - (y - reach - top) + _vertex(scores[:, column].tolist(), int(row))
            )
    return RowOffsets(np.array(offsets), len(corners))


def _vertex(scores: list[float], place: int) -> float:
    """Return how far beside its greatest sample a curve peaks, by a parabola."""
    if not 0 < place < len(scores) - 1:
        return 0.0
    before, at, after = scores[place - 1 : place + 2]
    bend = before - 2.0 * at + after
    return 0.5 * (before - after) / bend if bend < 0.0 else 0.0
