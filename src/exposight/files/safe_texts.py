"""Texts that no spreadsheet computes and no terminal obeys, in tables and names.

A spreadsheet computes a cell that begins with ``=``, ``+``, ``-`` or ``@``, which may run programs.
exposight writes an apostrophe before such a text and takes it off again when it reads.
"""

import io
import re
from collections.abc import Iterator

import polars as pl

from exposight.errors import ExposightError, FormatError

_PIECE_ROWS = 50_000

LONGEST_NAME = 255
"""Characters; file systems stop there, too."""

_FORMULA = r"^'*[=+\-@\t\r]"
_NUMBER = r"^[+-]?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][+-]?[0-9]+)?$"
_begins_formula, _is_number = re.compile(_FORMULA), re.compile(_NUMBER)

_TURNING = "\u061c\u200e\u200f\u2028-\u202e\u2066-\u2069"  # and what ends lines
_CONTROL = f"[\\x00-\\x1f\\x7f-\\x9f{_TURNING}]"
_UNREADABLE = re.compile(f"[\\x00-\\x1f\\x7f-\\x9f{_TURNING}\ud800-\udfff]")


def csv_of(frame: pl.DataFrame, *, separator: str = ",", header: bool = True) -> bytes:
    """Return a frame as CSV in UTF-8; its texts, and the names of its columns, are `guarded`.

    Parameters
    ----------
    frame : polars.DataFrame
    separator : str
        Between cells.
    header : bool
        Whether the names of the columns are the first line.
    """
    return b"".join(csv_pieces(frame, separator=separator, header=header))


def csv_pieces(
    frame: pl.DataFrame, *, separator: str = ",", header: bool = True
) -> Iterator[bytes]:
    """Yield what `csv_of` returns in pieces, which take less memory than the whole."""
    for first in range(0, max(frame.height, 1), _PIECE_ROWS):
        rows = frame.slice(first, _PIECE_ROWS)
        yield _piece(rows, separator=separator, header=header and first == 0)


def _piece(frame: pl.DataFrame, *, separator: str, header: bool) -> bytes:
    texts = pl.col(pl.String)
    formulas = texts.str.contains(_FORMULA) & ~texts.str.contains(_NUMBER)
    safe = frame.with_columns(pl.when(formulas).then("'" + texts).otherwise(texts).name.keep())
    buffer = io.BytesIO()
    safe.rename({name: guarded(name) for name in safe.columns}).write_csv(
        buffer, separator=separator, include_header=header
    )
    return buffer.getvalue()


def without_guards(frame: pl.DataFrame) -> pl.DataFrame:
    """Return a frame that was read from what `csv_of` wrote as it was before."""
    texts = pl.col(pl.String)
    was_guarded = texts.str.starts_with("'") & texts.str.contains(_FORMULA)
    plain = frame.with_columns(
        pl.when(was_guarded).then(texts.str.slice(1)).otherwise(texts).name.keep()
    )
    return plain.rename({name: unguarded(name) for name in plain.columns})


def guarded(text: str) -> str:
    """Return a text with an apostrophe before it where a spreadsheet would compute it.

    A text that begins with apostrophes before such a character gets one more, so that `unguarded`
    gives every text back.
    """
    return f"'{text}" if _begins_formula.match(text) and not _is_number.match(text) else text


def unguarded(text: str) -> str:
    """Return the text that was `guarded`."""
    return text[1:] if text.startswith("'") and _begins_formula.match(text) else text


def spelled(text: str) -> str:
    r"""Return a text with what cannot be shown spelled out: ``\x1b``."""
    return _UNREADABLE.sub(lambda found: ascii(found[0])[1:-1], text)


def check_plain(
    name: str,
    what: str,
    error: type[ExposightError] = FormatError,
    *,
    longest: int = LONGEST_NAME,
) -> str:
    r"""Return a name that has no control characters, nor such that turn the writing round.

    Halves of characters are none either: no file in UTF-8 can hold them. Nor is a name endless.

    Parameters
    ----------
    name : str
    what : str
        What it names, for messages: ``the view``.
    error : type
        What is raised, where a value has errors of its own kind.
    longest : int
        Characters that it may have.

    Raises
    ------
    FormatError
        If it has one, which the message spells: ``\x1b``, or is longer.
    """
    if len(name) > longest:
        msg = f"{what} '{spelled(name[:20])}…' has {len(name)} characters, and may have {longest}"
        raise error(msg)
    found = _UNREADABLE.search(name)
    if found:
        msg = (
            f"{what} '{spelled(name)}' holds the control character {spelled(found[0])}, which "
            "terminals and pages obey; leave it out"
        )
        raise error(msg)
    return name


def has_control_characters(column: pl.Series) -> pl.Series:
    """Tell of each text of a column whether `check_plain` refuses it."""
    return column.str.contains(_CONTROL)
