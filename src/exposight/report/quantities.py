"""What measured quantities are called in tables and on axes: the paper's letters, and units."""

from __future__ import annotations

from exposight.quantities import quantity


def column_name(name: str) -> str:
    """Return a column's name as the paper prints it, in HTML that plotly's texts take, too."""
    return quantity(name).html


def column_math(name: str) -> str:
    """Return a column's name as the paper prints it, for pictures drawn by matplotlib."""
    return quantity(name).math


def axis_title(name: str) -> str:
    """Return what stands at an axis: the column's name, in brackets its unit; HTML."""
    return quantity(name).axis_html


def axis_math(name: str) -> str:
    """Return what stands at an axis of a picture drawn by matplotlib."""
    return quantity(name).axis_math
