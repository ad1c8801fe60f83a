"""Lines of numbers as programs print them, with every spelling of a number that is missing."""

import io
import re
import warnings
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from exposight.files import recognised

_ODD_NAN = re.compile(rb"[-+]?(?:\d*\.#[A-Za-z]+\d*|nan\(\w*\))", re.IGNORECASE)
"""What C libraries of Windows print: 1.#QNAN, -1.#IND00, 1.#INF, rounded 1.#J; -nan(ind)."""

_LOOKED_AT = 65_536
"""Bytes in which decimal commas are looked for."""


def with_plain_nan(text: bytes) -> bytes:
    """Return a text in which numbers that are missing are spelled nan.

    C libraries of Windows have spellings of their own: ``1.#QNAN``, ``-1.#IND``, ``-nan(ind)``.
    Infinity, ``1.#INF``, counts as missing, too.
    """
    text = text.replace(b"-nan(ind)", b"nan")  # the commonest, many times as quickly
    if b"#" not in text and b"(" not in text:
        return text
    return _ODD_NAN.sub(b"nan", text)


def lines_of(text: bytes) -> int:
    """Return how many lines a text has at most, whatever ends them, without empty ones behind."""
    text = text.rstrip()
    return text.count(b"\n") + text.count(b"\r") - text.count(b"\r\n") + 1


def numbers_of_lines(
    text: bytes, columns: Sequence[int], source: Path, *, most: int | None = None
) -> NDArray[np.float64]:
    """Return some columns of a text of numbers with blanks between them.

    Parameters
    ----------
    text : bytes
        Lines of numbers; empty ones are skipped.
    columns : sequence of int
        Which are wanted, from 0.
    source : Path
        Where it came from; that it has decimal commas, as programs on some computers write them, is
        said.
    most : int, optional
        Lines to read.

    Returns
    -------
    (n, len(columns)) ndarray
        As many rows as there are, at most `most`; numbers that are missing are NaN.

    Raises
    ------
    ValueError
        If a line has too few numbers, or something else.
    """
    text = with_plain_nan(text)
    if _has_decimal_commas(text):
        recognised(source, "decimal commas")
        text = text.replace(b",", b".")
    if most is not None:  # is allocated before a line is read
        most = min(most, lines_of(text))
    if most == 0 or not text.strip():
        return np.zeros((0, len(columns)))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # of empty lines
        return np.loadtxt(
            io.BytesIO(text), comments=None, usecols=tuple(columns), max_rows=most, ndmin=2
        )


def _has_decimal_commas(text: bytes) -> bool:
    """Tell whether numbers between blanks have commas, and none a point."""
    start = text[:_LOOKED_AT]
    return b"," in start and b"." not in start


def rows_before_cut(
    text: bytes, columns: Sequence[int], source: Path, announced: int
) -> int | None:
    """Return how many rows stand before the one within which a text ends.

    Parameters
    ----------
    text, columns, source
        As of `numbers_of_lines`, which could not read them.
    announced : int
        Rows that there should be.

    Returns
    -------
    int or None
        None where the text does not end early, or something else is wrong with it.
    """
    whole = text[: text.rfind(b"\n") + 1]
    if whole.count(b"\n") >= announced:
        return None
    try:
        return len(numbers_of_lines(whole, columns, source))
    except ValueError:
        return None
