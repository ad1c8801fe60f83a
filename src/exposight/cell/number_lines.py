"""Lines of numbers as programs print them, with every spelling of a number that is missing."""

import io
import re
import warnings
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

_ODD_NAN = re.compile(rb"[-+]?(?:\d*\.#[A-Za-z]+\d*|nan\(\w*\))", re.IGNORECASE)
"""What C libraries of Windows print: 1.#QNAN, -1.#IND00, 1.#INF, rounded 1.#J; -nan(ind)."""


def with_plain_nan(text: bytes) -> bytes:
    """Return a text in which numbers that are missing are spelled nan.

    C libraries of Windows have spellings of their own: ``1.#QNAN``, ``-1.#IND``, ``-nan(ind)``.
    Infinity, ``1.#INF``, counts as missing, too.
    """
    text = text.replace(b"-nan(ind)", b"nan")  # the commonest, many times as quickly
    if b"#" not in text and b"(" not in text:
        return text
    return _ODD_NAN.sub(b"nan", text)


def numbers_of_lines(
    text: bytes, columns: Sequence[int], *, most: int | None = None
) -> NDArray[np.float64]:
    """Return some columns of a text of numbers with blanks between them.

    Parameters
    ----------
    text : bytes
        Lines of numbers; empty ones are skipped.
    columns : sequence of int
        Which are wanted, from 0.
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
    if most == 0 or not text.strip():
        return np.zeros((0, len(columns)))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # of empty lines
        return np.loadtxt(
            io.BytesIO(text), comments=None, usecols=tuple(columns), max_rows=most, ndmin=2
        )
