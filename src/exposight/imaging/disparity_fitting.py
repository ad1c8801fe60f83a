"""Disparities to a fraction of a pixel: windows of both images fitted to each other."""

import math

import numba
import numpy as np
from numpy.typing import NDArray

from exposight.compiled import njit

DISPARITY_STEP = 16
"""The matcher's disparities come in 1/16 px, and their number must be a multiple of 16."""
_REFINED_REACH_PX = 3
"""Disparities are fitted in a square of 7 × 7 px: two to three dots."""
_REFINEMENTS = 2
"""A third moves the points by less than a tenth of their noise."""
_LARGEST_CORRECTION_PX = 0.75
"""The matcher is right to half a pixel; a little more for its noise."""


@njit(parallel=True, error_model="numpy")
def refined_disparity(
    first: NDArray[np.uint8], second: NDArray[np.uint8], steps: NDArray[np.int16], lowest: int
) -> NDArray[np.float32]:
    """Return disparities in px, fitted to the grey values round each pixel; NaN where none.

    Least squares by Gauss-Newton, window against window, mean brightness removed. The matcher's own
    1/16 px lean towards whole ones, by up to a quarter.

    Parameters
    ----------
    first, second : (rows, columns) ndarray of uint8
        Rectified images.
    steps : (rows, columns) ndarray of int16
        The matcher's disparities, `DISPARITY_STEP` a px.
    lowest : int, px
        Below it there is no match.
    """
    rows, columns = steps.shape
    refined = np.empty((rows, columns), dtype=np.float32)
    for r in numba.prange(rows):
        for c in range(columns):
            refined[r, c] = np.nan
            if steps[r, c] < lowest * DISPARITY_STEP:
                continue
            start = steps[r, c] / DISPARITY_STEP
            d = start
            for _ in range(_REFINEMENTS):
                d += _correction(first, second, r, c, d)
            # Farther away it has left for another match.
            refined[r, c] = d if abs(d - start) < _LARGEST_CORRECTION_PX else start
    return refined


@njit(inline="always", error_model="numpy")
def _correction(
    first: NDArray[np.uint8], second: NDArray[np.uint8], r: int, c: int, d: float
) -> float:
    """Return one Gauss-Newton step of the disparity in px; 0 at the border or without gradient."""
    rows, columns = first.shape
    left = math.floor(c - d)
    reach = _REFINED_REACH_PX
    if (
        r < reach
        or r >= rows - reach
        or c < reach
        or c >= columns - reach
        or left < reach + 1
        or left >= columns - reach - 2
    ):
        return 0.0
    t = c - d - left
    # Cubic convolution (Keys 1981) along the row, and its derivative.
    w0, w1 = ((2.0 - t) * t - 1.0) * t / 2.0, ((3.0 * t - 5.0) * t * t + 2.0) / 2.0
    w2, w3 = ((4.0 - 3.0 * t) * t + 1.0) * t / 2.0, (t - 1.0) * t * t / 2.0
    g0, g1 = ((4.0 - 3.0 * t) * t - 1.0) / 2.0, (9.0 * t - 10.0) * t / 2.0
    g2, g3 = ((8.0 - 9.0 * t) * t + 1.0) / 2.0, (3.0 * t - 2.0) * t / 2.0
    n, sum_e, sum_g, sum_eg, sum_gg = 0.0, 0.0, 0.0, 0.0, 0.0
    for i in range(-reach, reach + 1):
        for j in range(-reach, reach + 1):
            a, b = np.float64(second[r + i, left + j - 1]), np.float64(second[r + i, left + j])
            p, q = np.float64(second[r + i, left + j + 1]), np.float64(second[r + i, left + j + 2])
            e = np.float64(first[r + i, c + j]) - (w0 * a + w1 * b + w2 * p + w3 * q)
            g = g0 * a + g1 * b + g2 * p + g3 * q
            n += 1.0
            sum_e += e
            sum_g += g
            sum_eg += e * g
            sum_gg += g * g
    square = sum_gg - sum_g * sum_g / n
    if not square > n:  # a slope of 1 grey level a px
        return 0.0
    # A greater disparity takes the partner to the left, against the gradient.
    return -(sum_eg - sum_e * sum_g / n) / square
