"""Brightness of a feature's ring in one stripe image (Sect. 3.1.2), and its spread (Sect. 3.3.8).

The paper uses the mean i_avg alone and names standard deviation and median as promising further
inputs; they come from one histogram, so they cost nothing beside it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from exposight.cell import GREY_MAX

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from exposight.cell import Capture


@dataclass(frozen=True, kw_only=True)
class RingBrightness:
    """Statistics of a ring's grey values on the 8-bit scale 0–255, whatever the image's depth.

    Parameters
    ----------
    i_avg : float
        Mean: the paper's local light intensity.
    i_std, i_median, i_p05, i_p95 : float
        Standard deviation, median, 5th and 95th percentile.
    clipped_share : float
        Share of pixels at full scale, 0–1.
    """

    i_avg: float
    i_std: float
    i_median: float
    i_p05: float
    i_p95: float
    clipped_share: float


def ring_brightness(
    capture: Capture, rows: NDArray[np.int64], columns: NDArray[np.int64]
) -> RingBrightness:
    """Measure the grey values of a mask's pixels.

    Parameters
    ----------
    capture : Capture
        Its stripe image is read.
    rows, columns : (n,) ndarray of int, n ≥ 1
        The mask's pixels.
    """
    full_scale = capture.full_scale
    histogram = np.bincount(capture.image[rows, columns], minlength=full_scale + 1)
    levels = np.flatnonzero(histogram)
    counts = histogram[levels]
    grey = np.asarray(levels * (GREY_MAX / full_scale))
    n = rows.size
    mean = float(counts @ grey) / n
    p05, median, p95 = _percentiles(grey, counts, (5.0, 50.0, 95.0))
    return RingBrightness(
        i_avg=mean,
        i_std=float(np.sqrt(counts @ (grey - mean) ** 2 / n)),
        i_median=median,
        i_p05=p05,
        i_p95=p95,
        clipped_share=float(histogram[full_scale]) / n,
    )


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
