"""Colours and marks: the same thing looks the same in every figure.

What a feature is for shows without colour, too: marks of features that trained are filled, those of
unseen ones open; the mark's shape follows the feature's number.
"""

import re
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

INK = "#1d2733"
MUTED = "#5c6773"
GRID = "#e6e9ec"
ACCENT = "#0b6477"
"""Headings, controls, models and their predictions."""
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

SPREAD_SCALE = ("#f4f6f8", "#d3dae1", "#aab7c4", "#7f90a2", "#586a7d")
"""2σ: the darker the less sure."""

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


_TRAINING = (
    "#0072b2", "#d55e00", "#009e73", "#aa3377", "#8c6d00", "#332288", "#117a8b", "#882255",
    "#555555",
)  # fmt: skip
_UNSEEN = ("#e08a00", "#3f9fdc", "#c2589a", "#6a9a00")
_OUTSIDE = ("#a0522d", "#2f5f9f", "#2aa5b8", "#dc4458", "#a08a00")
_MARKS = ("o", "s", "^", "D", "v", "P", "X", "p", "*")
_NAME = re.compile(r"f(\d+)(_test|_out)?")
_COLOURS = {"": _TRAINING, "_test": _UNSEEN, "_out": _OUTSIDE}


@dataclass(frozen=True, kw_only=True)
class FeatureStyle:
    """How one feature is drawn.

    Parameters
    ----------
    colour : str
        ``#rrggbb``.
    mark : str
        Matplotlib's name of its mark.
    filled : bool
        Filled for features that trained, open for unseen ones.
    """

    colour: str
    mark: str
    filled: bool


def feature_style(name: str) -> FeatureStyle:
    """Return a feature's style; it depends on the name alone.

    The paper's names have a colour each. Any other name, as a recorded campaign may have, takes the
    training features' colours in an order that follows from its letters.
    """
    parts = _NAME.fullmatch(name)
    group = (parts.group(2) or "") if parts else ""
    number = int(parts.group(1)) - 1 if parts else sum(name.encode())
    colours = _COLOURS[group]
    return FeatureStyle(
        colour=colours[number % len(colours)],
        mark=_MARKS[number % len(_MARKS)],
        filled=group == "",
    )


def feature_order(name: str) -> tuple[str, int, str]:
    """Return the key that sorts f10 after f9, and test features after all that train."""
    parts = _NAME.fullmatch(name)
    return (parts.group(2) or "", int(parts.group(1)), name) if parts else ("~", 0, name)
