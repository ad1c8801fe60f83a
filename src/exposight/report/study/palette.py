"""Colours and marks of features: the same in every figure of the study, still or interactive.

What a feature is for shows without colour, too: marks of features that trained are filled, those of
unseen ones open; the mark's shape follows the feature's number.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

_TRAINING = (
    "#0072b2", "#d55e00", "#009e73", "#aa3377", "#8c6d00", "#332288", "#117a8b", "#882255",
    "#555555",
)  # fmt: skip
_UNSEEN = ("#e08a00", "#3f9fdc", "#c2589a", "#6a9a00")
_OUTSIDE = ("#a0522d", "#2f5f9f", "#2aa5b8", "#dc4458", "#a08a00")
_MARKS = (
    ("o", "circle"),
    ("s", "square"),
    ("^", "triangle-up"),
    ("D", "diamond"),
    ("v", "triangle-down"),
    ("P", "cross"),
    ("X", "x"),
    ("p", "pentagon"),
    ("*", "star"),
)
_LINES = (("-", "solid"), ("--", "dash"), ("-.", "dashdot"), (":", "dot"))
_PALEST = 0.45
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
    symbol : str
        Plotly's.
    filled : bool
        Filled for features that trained, open for unseen ones.
    """

    colour: str
    mark: str
    symbol: str
    filled: bool


@dataclass(frozen=True, kw_only=True)
class PlaceStyle:
    """How one of several places of the same feature is drawn, in the feature's colour.

    Parameters
    ----------
    line : str
        Matplotlib's name of its line.
    dash : str
        Plotly's.
    opacity : float
        1 for the first place, less for each that follows.
    """

    line: str
    dash: str
    opacity: float


def place_styles(count: int) -> list[PlaceStyle]:
    """Return the styles of so many places, in their order."""
    return [
        PlaceStyle(
            line=_LINES[index % len(_LINES)][0],
            dash=_LINES[index % len(_LINES)][1],
            opacity=1.0 - (1.0 - _PALEST) * index / max(1, count - 1),
        )
        for index in range(count)
    ]


def feature_style(name: str) -> FeatureStyle:
    """Return a feature's style; it depends on the name alone.

    The paper's names have a colour each. Any other name, as a recorded campaign may have, takes the
    training features' colours in an order that follows from its letters.
    """
    found = _NAME.fullmatch(name)
    group = (found.group(2) or "") if found else ""
    number = int(found.group(1)) - 1 if found else sum(name.encode())
    colours = _COLOURS[group]
    mark, symbol = _MARKS[number % len(_MARKS)]
    filled = group == ""
    return FeatureStyle(
        colour=colours[number % len(colours)],
        mark=mark,
        symbol=symbol if filled else f"{symbol}-open",
        filled=filled,
    )


def feature_order(name: str) -> tuple[str, int, str]:
    """Return the key that sorts f10 after f9, and test features after all that train."""
    found = _NAME.fullmatch(name)
    return (found.group(2) or "", int(found.group(1)), name) if found else ("~", 0, name)
