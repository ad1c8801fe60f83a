"""Stereo by codes: the projector coordinate that both cameras decode says which pixels match.

A point of the surface has one projector coordinate whoever looks at it. So the coordinate of a
pixel of the first camera is looked up along its epipolar line in the map of the second, between
whose pixels it is interpolated, and the point is triangulated from both cameras; the projector only
has to stand still, and no calibration of it is needed (Scharstein and Szeliski, *High-accuracy
stereo depth maps using structured light*, CVPR 2003).
"""

import math
from collections.abc import Collection
from dataclasses import replace

import numba
import numpy as np
from numpy.typing import NDArray

from exposight.cell import Cloud
from exposight.compiled import njit
from exposight.contradictions import settle
from exposight.contradictions.epipolar import rows_correspond
from exposight.errors import ImageError
from exposight.imaging.decoded import DecodedMap
from exposight.imaging.rectification import ON_GRID_PX, RectifiedPair
from exposight.imaging.stereo_match import MatchOutcome, StereoMatch, check_sizes
from exposight.imaging.turned_maps import NOISE_PX, STEEPEST, turned_map

_MATCHED, _NOT_DECODED, _, _, _NO_PARTNER, _AMBIGUOUS, _OUTSIDE = map(np.uint8, MatchOutcome)
_SAME_PLACE_PX = 1.5
"""Crossings of one surface by noise lie no farther apart than there are of them, and this."""
_SAME_SURFACE_PX = 1.0
"""A pixel whose disparity differs by more from both neighbours in its row, or in its column, mixes
two surfaces."""
_RIVAL_PX = 4.0
"""Pixels that match within 1 px of one place and differ by more in disparity are of different
surfaces."""
_NEAREST_MM, _FARTHEST_MM = 1.0, 1e9
"""In place of limits of 0 and infinity."""
_FEW = 0.05
"""If so few of the decoded pixels match, the recordings may be swapped."""


def match_codes(
    first: DecodedMap,
    second: DecodedMap,
    pair: RectifiedPair,
    *,
    depth_limits_mm: tuple[float, float],
) -> Cloud:
    """Triangulate the points whose projector coordinate both cameras decoded.

    Parameters
    ----------
    first, second : DecodedMap
        Of the images of both cameras, as recorded, of the same projected patterns.
    pair : RectifiedPair
        The cameras (`rectify`).
    depth_limits_mm : (float, float), mm
        Nearest and farthest Z in the first camera's frame.

    Returns
    -------
    Cloud
        Organised like the first image, in the first camera's frame; NaN where a coordinate was not
        decoded, is hidden from the second camera, or appears there in more places than one.

    Raises
    ------
    ImageError
        If a map is not of its camera's size, both do not code the same axes of the same projector,
        the coded axis runs along the baseline, or the limits make no sense.
    ContradictionError
        If both axes are coded, and the codes show that rows of the rectified images do not
        correspond.
    """
    return stereo_by_codes(first, second, pair, depth_limits_mm=depth_limits_mm).cloud


def stereo_by_codes(
    first: DecodedMap,
    second: DecodedMap,
    pair: RectifiedPair,
    *,
    depth_limits_mm: tuple[float, float],
    despite: Collection[str] = (),
) -> StereoMatch:
    """Match as `match_codes`, and tell why the other pixels have no point.

    Parameters
    ----------
    despite : collection of str
        Names of checks that are to be passed over (`settle`).
    """
    check_sizes(pair, first.image_shape, second.image_shape)
    _check_maps(first, second)
    match, offsets_px = _match(first, second, pair, depth_limits_mm)
    tried = {}
    looked_for = int(np.count_nonzero(first.valid))
    if match.cloud.n_valid < _FEW * looked_for and first.image_shape == second.image_shape:
        swapped = _match(second, first, pair, depth_limits_mm)[0].cloud.n_valid
        tried["swapping both recordings"] = swapped / max(np.count_nonzero(second.valid), 1)
    found = settle([rows_correspond(offsets_px, looked_for, tried)], despite)
    return replace(match, contradictions=found)


def _match(
    first: DecodedMap,
    second: DecodedMap,
    pair: RectifiedPair,
    depth_limits_mm: tuple[float, float],
) -> tuple[StereoMatch, NDArray[np.float32]]:
    """Match; also return how many px off their rows the matches lie, where both axes are coded."""
    near_mm, far_mm = max(depth_limits_mm[0], _NEAREST_MM), min(depth_limits_mm[1], _FARTHEST_MM)
    lowest_px, highest_px = pair.disparity_range((near_mm, far_mm))
    along = turned_map(second, pair)
    decoded = [getattr(first, name) for name in (along.name, along.other_name)]
    none = np.empty((0, 0))
    disparity = np.empty(first.image_shape)
    places = np.empty((*first.image_shape, 2), dtype=np.int32)
    outcome = np.empty(first.image_shape, dtype=np.uint8)
    row_offsets_px = np.empty(first.image_shape, dtype=np.float32)
    lows, order = _sorted(along.coordinate, along.limit)
    _look_up(
        pair.first.rays(),
        decoded[0],
        none if decoded[1] is None else decoded[1],
        first.valid,
        along.coordinate,
        along.other,
        lows,
        order,
        along.limit,
        along.other_slope,
        pair.rectified_from_first,
        (pair.camera.fx, pair.camera.cx, pair.camera.cy),
        (lowest_px, highest_px),
        disparity,
        places,
        outcome,
        row_offsets_px,
    )
    rows, columns = along.coordinate.shape
    _drop_rivals(places, (rows, columns), disparity, outcome)
    points = np.empty((*first.image_shape, 3), dtype=np.float32)
    _fill_points(
        pair.first.rays(),
        disparity,
        pair.rectified_from_first[2],
        pair.camera.fx * pair.baseline_mm,
        (near_mm, far_mm),
        points,
        outcome,
    )
    offsets = row_offsets_px[np.isfinite(row_offsets_px)]
    return StereoMatch(cloud=Cloud(points=points), outcome=outcome), offsets


def _check_maps(first: DecodedMap, second: DecodedMap) -> None:
    said = [
        (
            each.projector_width,
            each.projector_height,
            each.column is not None,
            each.row is not None,
        )
        for each in (first, second)
    ]
    if said[0] != said[1]:
        sizes = " and ".join(f"{width} × {height} px" for width, height, _, _ in said)
        msg = (
            "both cameras must decode the same axes of the same patterns, got projectors of "
            f"{sizes}; decode both recordings with one sequence"
        )
        raise ImageError(msg)


@njit(parallel=True, error_model="numpy")
def _sorted(
    coordinate: NDArray[np.float64], limit: float
) -> tuple[NDArray[np.float64], NDArray[np.int32]]:
    """Sort each row's pairs of neighbours by their lower coordinate; infinite where no surface."""
    rows, columns = coordinate.shape
    lows = np.empty((rows, columns))
    order = np.empty((rows, columns), dtype=np.int32)
    for r in numba.prange(rows):
        low = np.full(columns, np.inf)
        for c in range(columns - 1):
            a, b = coordinate[r, c], coordinate[r, c + 1]
            if abs(a - b) <= limit:  # False for NaN
                low[c] = min(a, b)
        index = np.argsort(low)
        for i in range(columns):
            order[r, i] = index[i]
            lows[r, i] = low[index[i]]
    return lows, order


@njit(inline="always", error_model="numpy")
def _crossing(
    wanted: float,
    other_wanted: float,
    coordinate: NDArray[np.float64],
    other: NDArray[np.float64],
    lows: NDArray[np.float64],
    order: NDArray[np.int32],
    limit: float,
    reach: tuple[float, float],
    other_limit: float,
    row: int,
) -> tuple[float, np.uint8]:
    """Return where a row has a coordinate, in px, and the outcome."""
    start, end = 0, lows.shape[1]
    least = wanted - limit
    while start < end:
        middle = (start + end) // 2
        if lows[row, middle] < least:
            start = middle + 1
        else:
            end = middle
    # First all places; then, if they are of more than one surface, those with the other coordinate.
    for use_other in range(2):
        n, total, first, last = 0, 0.0, np.inf, -np.inf
        for i in range(start, lows.shape[1]):
            low = lows[row, i]
            if low > wanted:
                break
            c = order[row, i]
            a, b = coordinate[row, c], coordinate[row, c + 1]
            if max(a, b) < wanted:
                continue
            x = c + ((wanted - a) / (b - a) if a != b else 0.5)
            if not reach[0] <= x <= reach[1]:
                continue
            if use_other:
                nearest = other[row, c] if x - c < 0.5 else other[row, c + 1]
                if not abs(nearest - other_wanted) <= other_limit:
                    continue
            n += 1
            total += x
            first, last = min(first, x), max(last, x)
        if n == 0:
            return np.nan, _NO_PARTNER
        if last - first <= n - 1 + _SAME_PLACE_PX:
            return total / n, _MATCHED
        if other.size == 0:
            break
    return np.nan, _AMBIGUOUS


@njit(parallel=True, error_model="numpy")
def _look_up(
    rays: NDArray[np.float64],
    first: NDArray[np.float64],
    first_other: NDArray[np.float64],
    valid: NDArray[np.bool_],
    coordinate: NDArray[np.float64],
    other: NDArray[np.float64],
    lows: NDArray[np.float64],
    order: NDArray[np.int32],
    limit: float,
    other_slope: float,
    rotation: NDArray[np.float64],
    numbers: tuple[float, float, float],
    disparities: tuple[float, float],
    disparity: NDArray[np.float64],
    places: NDArray[np.int32],
    outcome: NDArray[np.uint8],
    row_offsets: NDArray[np.float32],
) -> None:
    """Fill disparities in px, the second image's pixels, outcomes, and matches' rows, off by px."""
    focal, cx, cy = numbers
    rows = coordinate.shape[0]
    other_limit = STEEPEST * other_slope + NOISE_PX
    for r in numba.prange(disparity.shape[0]):
        for c in range(disparity.shape[1]):
            disparity[r, c] = np.nan
            row_offsets[r, c] = np.nan
            x, y = rays[r, c, 0], rays[r, c, 1]
            if not valid[r, c] or np.isnan(x):
                outcome[r, c] = _NOT_DECODED
                continue
            ahead = rotation[2, 0] * x + rotation[2, 1] * y + rotation[2, 2]
            u = (rotation[0, 0] * x + rotation[0, 1] * y + rotation[0, 2]) / ahead * focal + cx
            v = (rotation[1, 0] * x + rotation[1, 1] * y + rotation[1, 2]) / ahead * focal + cy
            top = math.floor(v)
            down = v - top
            if down > 1.0 - ON_GRID_PX:
                top, down = top + 1, 0.0
            one_row = down < ON_GRID_PX
            if not (0 <= top < rows and (one_row or top < rows - 1)):
                outcome[r, c] = _NO_PARTNER
                continue
            wanted = first[r, c]
            other_wanted = np.nan
            if first_other.size:
                other_wanted = first_other[r, c]
            reach = (u - disparities[1], u - disparities[0])
            partner, result = _crossing(
                wanted, other_wanted, coordinate, other, lows, order, limit, reach, other_limit, top
            )
            if result == _MATCHED and not one_row:
                below, result = _crossing(
                    wanted, other_wanted, coordinate, other, lows, order, limit, reach,
                    other_limit, top + 1,
                )  # fmt: skip
                if result == _MATCHED and abs(below - partner) > _SAME_PLACE_PX:
                    result = _AMBIGUOUS
                partner += down * (below - partner)
            if result == _MATCHED and other.size:
                nearest = other[top, math.floor(partner + 0.5)]
                row_offsets[r, c] = (other_wanted - nearest) / other_slope
                if not abs(other_wanted - nearest) <= other_limit:
                    result = _NO_PARTNER
            outcome[r, c] = result
            if result == _MATCHED:
                disparity[r, c] = u - partner
                places[r, c, 0], places[r, c, 1] = math.floor(v + 0.5), math.floor(partner + 0.5)


@njit(error_model="numpy")
def _drop_rivals(
    places: NDArray[np.int32],
    shape: tuple[int, int],
    disparity: NDArray[np.float64],
    outcome: NDArray[np.uint8],
) -> None:
    """Drop matches of different surfaces with one place of the second image: one hides the other.

    Which of them the second camera sees, the code does not say.
    """
    least = np.full(shape, np.inf, dtype=np.float32)
    greatest = np.full(shape, -np.inf, dtype=np.float32)
    for r in range(disparity.shape[0]):
        for c in range(disparity.shape[1]):
            d = disparity[r, c]
            if np.isnan(d):
                continue
            row, column = places[r, c, 0], places[r, c, 1]
            least[row, column] = min(least[row, column], d)
            greatest[row, column] = max(greatest[row, column], d)
    for r in range(disparity.shape[0]):
        for c in range(disparity.shape[1]):
            d = disparity[r, c]
            if np.isnan(d):
                continue
            row, column = places[r, c, 0], places[r, c, 1]
            for near in range(max(column - 1, 0), min(column + 2, shape[1])):
                if greatest[row, near] - d > _RIVAL_PX or d - least[row, near] > _RIVAL_PX:
                    disparity[r, c] = np.nan
                    outcome[r, c] = _AMBIGUOUS
                    break


@njit(parallel=True, error_model="numpy")
def _fill_points(
    rays: NDArray[np.float64],
    disparity: NDArray[np.float64],
    towards: NDArray[np.float64],
    focal_baseline: float,
    depth_limits: tuple[float, float],
    points: NDArray[np.float32],
    outcome: NDArray[np.uint8],
) -> None:
    """Fill points (rows, columns, 3); a pixel that sees two surfaces lies on neither."""
    rows, columns = disparity.shape
    for r in numba.prange(rows):
        for c in range(columns):
            points[r, c, :] = np.nan
            d = disparity[r, c]
            if np.isnan(d):
                continue
            beside = (c > 0 and abs(disparity[r, c - 1] - d) <= _SAME_SURFACE_PX) or (
                c < columns - 1 and abs(disparity[r, c + 1] - d) <= _SAME_SURFACE_PX
            )
            above = (r > 0 and abs(disparity[r - 1, c] - d) <= _SAME_SURFACE_PX) or (
                r < rows - 1 and abs(disparity[r + 1, c] - d) <= _SAME_SURFACE_PX
            )
            if not (beside and above):
                outcome[r, c] = _AMBIGUOUS
                continue
            x, y = rays[r, c, 0], rays[r, c, 1]
            z = focal_baseline / (d * (towards[0] * x + towards[1] * y + towards[2]))
            if not depth_limits[0] <= z <= depth_limits[1]:
                outcome[r, c] = _OUTSIDE
                continue
            points[r, c, 0] = x * z
            points[r, c, 1] = y * z
            points[r, c, 2] = z
