"""Grey values of a ring: in the capture's image, and in what its frame stack tells of each pixel.

The paper uses the mean i_avg alone and names standard deviation and median as promising further
inputs (Sect. 3.3.8); they come from one histogram, so they cost nothing beside it. The columns of
the stack (`exposight.cell.StackImages`) are what one capture tells of other exposure times.
"""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from exposight import cell
from exposight.compiled import njit
from exposight.quantities import STACK_PERCENTS

_SHARES = np.array(STACK_PERCENTS) / 100.0
_STACK_COLUMNS = {
    name: tuple(f"{column}_p{percent:02d}" for percent in STACK_PERCENTS)
    for name, column in (("mean", "i_mean"), ("maximum", "i_max"), ("modulation", "i_mod"))
}


def ring_brightness(
    capture: cell.Capture, rows: NDArray[np.int64], columns: NDArray[np.int64]
) -> dict[str, Any]:
    """Measure the grey values of a mask's pixels in the capture's image and its stack.

    Parameters
    ----------
    capture : Capture
    rows, columns : (n,) ndarray of int, n ≥ 1
        The mask's pixels.

    Returns
    -------
    dict of str to float
        ``i_avg``, the paper's local light intensity, ``i_std``, ``i_median``, ``i_p05``, ``i_p95``
        on the 8-bit scale 0–255, whatever the image's depth, and ``clipped_share``: columns of an
        observation table. So are those of the stack (``docs/formats.md``), where there is one.
    """
    full_scale = capture.full_scale
    histogram = np.bincount(capture.image[rows, columns], minlength=full_scale + 1)
    levels = np.flatnonzero(histogram)
    counts = histogram[levels]
    grey = np.asarray(levels * (cell.GREY_MAX / full_scale))
    n = rows.size
    mean = float(counts @ grey) / n
    p05, median, p95 = _percentiles(grey, counts, (5.0, 50.0, 95.0))
    return {
        "i_avg": mean,
        "i_std": float(np.sqrt(counts @ (grey - mean) ** 2 / n)),
        "i_median": median,
        "i_p05": p05,
        "i_p95": p95,
        "clipped_share": float(histogram[full_scale]) / n,
        **_ring_stack(capture, rows, columns),
    }


def _percentiles(
    grey: NDArray[np.float64], counts: NDArray[np.int64], percents: tuple[float, ...]
) -> list[float]:
    """Interpolate linearly between order statistics, as NumPy's default does."""
    last = np.cumsum(counts)
    position = np.array(percents) / 100.0 * (last[-1] - 1)
    below = grey[np.searchsorted(last, np.floor(position), side="right")]
    above = grey[np.searchsorted(last, np.ceil(position), side="right")]
    values: list[float] = (below + (position - np.floor(position)) * (above - below)).tolist()
    return values


def _ring_stack(
    capture: cell.Capture, rows: NDArray[np.int64], columns: NDArray[np.int64]
) -> dict[str, float]:
    """Measure brightness without the pattern, brightest frame and amplitude of a mask's pixels."""
    stack, n = capture.stack, rows.size
    images = {} if stack is None else stack.images()
    if "mean" not in images and capture.brightness_source in cell.EVEN_SOURCES:
        images["mean"] = capture.image
    scale = cell.GREY_MAX / capture.full_scale
    measured: dict[str, float] = {}
    for name, image in images.items():
        per_level, limit = scale, 0.0
        if name == "modulation":
            per_level = 0.5 * scale  # the swing is twice the amplitude
            if stack is not None and stack.min_modulation is not None:
                limit = stack.min_modulation / per_level
        levels = np.empty(_SHARES.size)
        total, n_clipped, n_low = _measure_levels(
            image, rows, columns, capture.full_scale, limit, _SHARES, levels
        )
        measured |= zip(_STACK_COLUMNS[name], (levels * per_level).tolist(), strict=True)
        if name == "mean":
            measured["i_mean"] = total * scale / n
        elif name == "maximum":
            measured["stack_clipped_share"] = n_clipped / n
        elif stack is not None and stack.min_modulation is not None:
            measured["low_modulation_share"] = n_low / n
    return measured


@njit(error_model="numpy")
def _measure_levels(
    image: cell.Image,
    rows: NDArray[np.int64],
    columns: NDArray[np.int64],
    full_scale: int,
    limit: float,
    shares: NDArray[np.float64],
    levels: NDArray[np.float64],
) -> tuple[int, int, int]:
    """Fill the levels below which shares of the pixels lie, linear between order statistics.

    Returns the levels' sum, and how many are at full scale and below the limit.
    """
    counts = np.zeros(full_scale + 1, dtype=np.int64)
    total = 0
    for i in range(rows.size):
        level = int(image[rows[i], columns[i]])
        counts[level] += 1
        total += level
    n_clipped, n_low = int(counts[full_scale]), 0
    below = 0
    for level in range(full_scale + 1):
        if level < limit:
            n_low += int(counts[level])
        below += int(counts[level])
        counts[level] = below
    for i in range(shares.size):
        position = shares[i] * (rows.size - 1)
        low = int(np.searchsorted(counts, math.floor(position), side="right"))
        high = int(np.searchsorted(counts, math.ceil(position), side="right"))
        levels[i] = low + (position - math.floor(position)) * (high - low)
    return total, n_clipped, n_low
