"""The page's colours: the same thing has the same colour in every figure."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray


INK = "#1d2733"
MUTED = "#5c6773"
GRID = "#e6e9ec"
ACCENT = "#0b6477"
"""Headings, controls, models and their predictions."""
BAND = "rgba(11, 100, 119, 0.16)"
"""The accent, thinned: a model's 2σ band."""
OUTSIDE = "#b5651d"
"""Predictions outside the training data's range."""
CLIPPED = "#e5322d"
"""Pixels at full scale."""
NO_POINT = "#2f6fd0"
"""Pixels that gave no 3D point."""

P_NORM_SCALE = (
    "#440154", "#482475", "#414487", "#355f8d", "#2a788e", "#21918c",
    "#22a884", "#44bf70", "#7ad151", "#bddf26", "#fde725",
)  # fmt: skip
"""p_norm from 0 to 1: viridis, which people with colour-blindness and grey printers can order."""

EXPOSURE_SCALE = (
    "#1b0c41", "#4a0c6b", "#781c6d", "#a52c60", "#cf4446", "#ed6925", "#fb9b06",
)  # fmt: skip
"""Exposure time, short to long: inferno without its palest end, which white paper swallows."""


def rgb(colour: str) -> tuple[int, int, int]:
    """Return the red, green and blue, 0–255, of a colour written ``#rrggbb``."""
    return int(colour[1:3], 16), int(colour[3:5], 16), int(colour[5:7], 16)


def scale_rgb(scale: tuple[str, ...], values: ArrayLike) -> NDArray[np.float64]:
    """Return the colours of values on a scale.

    Parameters
    ----------
    scale : tuple of str
        Colours, evenly spaced from 0 to 1.
    values : (...) array_like
        Values beyond 0 and 1 take the scale's ends.

    Returns
    -------
    (..., 3) ndarray
        Red, green and blue, 0–255.
    """
    stops = np.linspace(0.0, 1.0, len(scale))
    channels = np.array([rgb(colour) for colour in scale], dtype=np.float64)
    numbers = np.asarray(values, dtype=np.float64)
    return np.stack([np.interp(numbers, stops, channels[:, i]) for i in range(3)], axis=-1)


def plotly_scale(scale: tuple[str, ...]) -> list[list[float | str]]:
    """Return a scale as plotly wants it: pairs of place and colour."""
    last = len(scale) - 1
    return [[index / last, colour] for index, colour in enumerate(scale)]


def css_gradient(scale: tuple[str, ...]) -> str:
    """Return a scale as a CSS gradient from left to right."""
    return f"linear-gradient(to right, {', '.join(scale)})"
