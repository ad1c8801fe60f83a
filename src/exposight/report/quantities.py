"""What measured quantities are called in tables and on axes: the paper's letters, and units."""

from __future__ import annotations

from exposight.models import UNITS
from exposight.report.markup import escape

_SYMBOLS = {
    "p_norm": ("p", "norm"),
    "exposure_ms": ("t", "exp"),
    "i_avg": ("i", "avg"),
    "x_mm": ("x", "tcp"),
    "y_mm": ("y", "tcp"),
    "z_mm": ("z", "tcp"),
    "w_deg": ("w", "tcp"),
    "p_deg": ("p", "tcp"),
    "r_deg": ("r", "tcp"),
    "radius_mm": ("r", "f"),
}


def column_name(name: str) -> str:
    """Return a column's name as the paper prints it, in HTML that plotly's texts take, too."""
    if name not in _SYMBOLS:
        return escape(name)
    letter, index = _SYMBOLS[name]
    return f"<i>{letter}</i><sub>{index}</sub>"


def column_math(name: str) -> str:
    """Return a column's name as the paper prints it, for pictures drawn by matplotlib.

    Letters of quantities are italic, words below them upright (ISO 80000-1).
    """
    if name not in _SYMBOLS:
        return name
    letter, index = _SYMBOLS[name]
    return f"${letter}_\\mathrm{{{index}}}$"


def axis_title(name: str) -> str:
    """Return what stands at an axis: the column's name, in brackets its unit; HTML."""
    return f"{column_name(name)} ({UNITS[name]})"


def axis_math(name: str) -> str:
    """Return what stands at an axis of a picture drawn by matplotlib."""
    return f"{column_math(name)} ({UNITS[name]})"
