"""Numbers as they are written: decimal comma, thousands marks, the words for a missing value."""

import re
from collections.abc import Iterable, Sequence

import numpy as np
import polars as pl
from numpy.typing import NDArray

_MISSING = re.compile(
    r"""
    | [+-]?(?:nan|snan|qnan)(?:\([^)]*\))?      # C, Windows: -nan(ind), nan(snan)
    | [+-]?1[.,]\#(?:qnan|snan|ind|nan)0*       # older Windows: 1.#QNAN, -1.#IND00
    | <?na>? | n/a | n\.a\. | n\.\s?def\.? | nat | null | none
    | \#(?:n/?a|nv|div/0!|value!|wert!|ref!|bezug!|num!|zahl!|name\??|null!|n/d|valeur!)   # Excel
    | -{1,3} | [–—]{1,2}                        # dashes, which German typists write
    """,
    re.IGNORECASE | re.VERBOSE,
)
"""Words for a value that is not there, and the empty cell."""

_LONGEST = 12
"""Characters of the longest such word."""

_INFINITE = re.compile(r"([+-]?)(?:inf|infinity|1[.,]#inf0*)", re.IGNORECASE)

_PLAIN = {
    "point": re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eEdD][+-]?\d+)?"),
    "comma": re.compile(r"[+-]?(?:\d+(?:,\d+)?|,\d+)(?:[eEdD][+-]?\d+)?"),
}
_GROUPED = {
    "point": re.compile(
        r"[+-]?[1-9]\d{0,2}(?P<mark>[,'’\u00a0\u202f ])\d{3}(?:(?P=mark)\d{3})*(?:\.\d*)?"
    ),
    "comma": re.compile(
        r"[+-]?[1-9]\d{0,2}(?P<mark>[.'’\u00a0\u202f ])\d{3}(?:(?P=mark)\d{3})*(?:,\d+)?"
    ),
}
_MINUS = str.maketrans("−", "-")


def is_missing(cell: str) -> bool:
    """Return whether a cell is empty or holds a word for a missing value."""
    if len(cell) > _LONGEST or (cell.lstrip("+-")[:1].isdigit() and "#" not in cell):
        return False  # most cells, at once
    return _MISSING.fullmatch(cell) is not None


def is_plain(cell: str, decimal: str) -> bool:
    """Return whether a cell is a number without thousands marks; infinity is one."""
    cell = cell.translate(_MINUS)
    return bool(_PLAIN[decimal].fullmatch(cell) or _INFINITE.fullmatch(cell))


def thousands_mark(cell: str, decimal: str) -> str:
    """Return the mark between the thousands of a number, empty where it is not such a number."""
    match = _GROUPED[decimal].fullmatch(cell.translate(_MINUS))
    return match["mark"] if match else ""


_STAND_INS = frozenset(
    {sign * (10.0**digits - 1.0) for digits in range(4, 10) for sign in (1, -1)}
    | {-999.0, -32768.0, 1e10, -1e10, 1e20, -1e20, 1e30, -1e30}
)
"""Numbers that programs write for a value that is not there: -999, 9999, …"""


def stand_ins(values: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return where a column's numbers stand for missing values, (n,): -999, 9999 and the like.

    Only where they are farther from the other numbers than these are from one another or from 0,
    so that a part may reach to -999 mm.
    """
    alike = np.isin(values, list(_STAND_INS))
    others = values[~alike & np.isfinite(values)]
    if not alike.any() or not others.size:
        return np.zeros_like(alike)
    low, high = float(others.min()), float(others.max())
    away = np.maximum(low - values, values - high)
    far = ((high > low) & (away > high - low)) | (np.abs(values) > 2.0 * max(-low, high))
    return np.asarray(alike & far)


def to_numbers(
    cells: Sequence[str], decimal: str, thousands: Iterable[str] = ()
) -> tuple[NDArray[np.float64], list[int]]:
    """Return the numbers of cells, (n,), NaN for empty ones, and where cells are no numbers.

    Parameters
    ----------
    cells : sequence of str
    decimal : {'point', 'comma'}
    thousands : iterable of str
        Marks between thousands that the numbers may have.
    """
    values = _cast(cells, decimal)
    wrong: list[int] = []
    marks = frozenset(thousands)
    for place in np.flatnonzero(np.isnan(values)).tolist():
        cell = cells[place].translate(_MINUS)
        if is_missing(cell):
            continue
        infinite = _INFINITE.fullmatch(cell)
        mark = thousands_mark(cell, decimal)
        if infinite:
            values[place] = -np.inf if infinite[1] == "-" else np.inf
        elif _PLAIN[decimal].fullmatch(cell) or (mark and mark in marks):
            plain = cell.replace(mark, "") if mark else cell
            values[place] = float(re.sub("[dD]", "e", plain.replace(",", ".")))
        else:
            wrong.append(place)
    return values, wrong


def _cast(cells: Sequence[str], decimal: str) -> NDArray[np.float64]:
    """Return the numbers of cells that are written plainly, NaN for all others."""
    written = pl.Series(cells, dtype=pl.String)
    plain = written.str.contains(
        r"^[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?$"
        if decimal == "point"
        else r"^[+-]?\d+(,\d+)?([eE][+-]?\d+)?$"
    )
    if decimal == "comma":
        written = written.str.replace(",", ".", literal=True)
    numbers = written.str.strip_prefix("+").cast(pl.Float64, strict=False)
    values = np.where(plain.to_numpy(), numbers.to_numpy(), np.nan)
    return np.asarray(values, dtype=np.float64)
