"""A decoded map as the rectified camera sees it: projector coordinates along epipolar lines.

Coordinates are interpolated between the recorded pixels, but not across an edge, where neighbours
see different surfaces.
"""

import math
from typing import NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray

from exposight.compiled import njit
from exposight.errors import ImageError
from exposight.imaging.decoded import DecodedMap
from exposight.imaging.rectification import ON_GRID_PX, RectifiedPair

STEEPEST = 4.0
"""Neighbours on one surface differ by up to this times the median: it may be tilted by 75°."""
NOISE_PX = 1.0
"""And by this in projector px: codes are whole numbers, and noisy."""
_FLATTEST = 0.2
"""A coordinate that changes less along the epipolar lines than across them, by this, does not say
where on them a point lies."""
_LEAST_SLOPE = 0.05
"""Projector px a px: less than any projector's, to divide by."""
_SAMPLED = 7
"""Every so many rows and columns are enough for medians."""


class TurnedMap(NamedTuple):
    """A camera's decoded map on the rectified image's pixels."""

    name: str
    """The axis that changes more along the rows: ``column`` as a rule."""
    other_name: str
    coordinate: NDArray[np.float64]
    other: NDArray[np.float64]
    """The other axis; empty where it is not coded."""
    limit: float
    """By how many projector px neighbours on one surface differ at most."""
    other_slope: float
    """Change of the other axis down the rows, projector px a px."""


def turned_map(second: DecodedMap, pair: RectifiedPair) -> TurnedMap:
    """Return the second camera's map as the rectified camera sees it.

    Parameters
    ----------
    second : DecodedMap
        Of the image as recorded.
    pair : RectifiedPair
        The cameras.

    Raises
    ------
    ImageError
        If the coordinate hardly changes along the rows.
    """
    coded = {
        name: coordinate
        for name, coordinate in (("column", second.column), ("row", second.row))
        if coordinate is not None
    }
    slopes = {name: _slope(coordinate, axis=1) for name, coordinate in coded.items()}
    name = max(slopes, key=lambda each: slopes[each])
    if second.valid.any() and slopes[name] <= _FLATTEST * _slope(coded[name], axis=0):
        msg = (
            f"the coded {name}s change by {slopes[name]:.2g} projector px from pixel to pixel "
            "along the line between both cameras, which does not say where on it a point lies; "
            "project patterns across that line as well"
        )
        raise ImageError(msg)
    other_name = "row" if name == "column" else "column"
    pixels = pair.second_pixels()
    turned = {
        each: _turned(coordinate, pixels, _limit(coordinate)) for each, coordinate in coded.items()
    }
    return TurnedMap(
        name,
        other_name,
        turned[name],
        turned.get(other_name, np.empty((0, 0))),
        _limit(coded[name]),
        max(_slope(coded[other_name], axis=0), _LEAST_SLOPE) if other_name in coded else math.nan,
    )


def _slope(coordinate: NDArray[np.float64], axis: int) -> float:
    """Return the mean change from pixel to pixel without the largest; 0 where there is none."""
    sampled = coordinate[::_SAMPLED] if axis == 1 else coordinate[:, ::_SAMPLED]
    steps = np.abs(np.diff(sampled, axis=axis))
    steps = steps[np.isfinite(steps)]
    # No median: whole codes have steps of 0 and 1. The largest are edges.
    return float(np.mean(steps[steps <= np.percentile(steps, 98)])) if steps.size else 0.0


def _limit(coordinate: NDArray[np.float64]) -> float:
    slope = max(_slope(coordinate, axis=0), _slope(coordinate, axis=1))
    return STEEPEST * slope + NOISE_PX


@njit(parallel=True, error_model="numpy")
def _turned(
    coordinate: NDArray[np.float64], pixels: NDArray[np.float32], limit: float
) -> NDArray[np.float64]:
    """Interpolate a map at pixels (2, rows, columns); NaN beside missing pixels and edges."""
    turned = np.empty(pixels.shape[1:])
    rows, columns = coordinate.shape
    for r in numba.prange(turned.shape[0]):
        for c in range(turned.shape[1]):
            turned[r, c] = np.nan
            u, v = np.float64(pixels[0, r, c]), np.float64(pixels[1, r, c])
            column, row = math.floor(u + 0.5), math.floor(v + 0.5)
            if not (0 <= column < columns and 0 <= row < rows):
                continue
            if abs(u - column) < ON_GRID_PX and abs(v - row) < ON_GRID_PX:
                turned[r, c] = coordinate[row, column]
                continue
            left, top = math.floor(u), math.floor(v)
            if not (0 <= left < columns - 1 and 0 <= top < rows - 1):
                continue
            across, down = u - left, v - top
            a, b = coordinate[top, left], coordinate[top, left + 1]
            p, q = coordinate[top + 1, left], coordinate[top + 1, left + 1]
            if max(max(a, b), max(p, q)) - min(min(a, b), min(p, q)) <= limit and not (
                np.isnan(a) or np.isnan(b) or np.isnan(p) or np.isnan(q)
            ):
                above = a + across * (b - a)
                below = p + across * (q - p)
                turned[r, c] = above + down * (below - above)
    return turned
