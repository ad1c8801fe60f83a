"""Where the rows of a text table are: comments, names, counts and titles above them."""

import contextlib
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from exposight.errors import AmbiguousError, FormatError
from exposight.files.reading import Reading
from exposight.files.text_tables.cell_splits import MARKS, Candidate, Split
from exposight.files.text_tables.columns import looks_like_names
from exposight.files.text_tables.separators import ragged_rows, recognise_split
from exposight.files.text_tables.written_numbers import is_missing, is_plain

COMMENTS = ("//", "#", "%")
_SAMPLE = 400
"""Lines from which the dialect is recognised, unless they leave it open."""
_FIRST = 50
"""Lines below a title that must fit before all are tried."""
_SEPARATOR_LINE = re.compile(r'"?sep=(.|\\t)"?', re.IGNORECASE)
_TITLE_LINES = 30
"""Lines of a title above the names."""


@dataclass(frozen=True, kw_only=True)
class Layout:
    """Where the rows of a text table are, and how they become cells.

    Parameters
    ----------
    candidate : Candidate
    names : list of str
        The header's cells; empty where there is none.
    rows : list of list of str
        Cells of each row, empty ones at its end included.
    numbers : list of int
        Their lines in the file, from 1.
    remarks : list of str
        What was recognised.
    """

    candidate: Candidate
    names: list[str]
    rows: list[list[str]]
    numbers: list[int]
    remarks: list[str]


@dataclass(frozen=True, kw_only=True)
class Expected:
    """What a text table is expected to be.

    Parameters
    ----------
    source : str or Path
        For messages.
    what : str
        What it is, for messages.
    reading : Reading
        What somebody says.
    header : bool or None
        Whether its first line names the columns; None recognises it.
    least : int
        Columns that it must have.
    """

    source: str | Path
    what: str
    reading: Reading
    header: bool | None
    least: int


@dataclass(frozen=True, kw_only=True)
class _Sorted:
    """Lines of a text table, with their numbers, apart from the comment above them."""

    lines: list[str]
    numbers: list[int]
    comment: str
    remarks: list[str]


def find_layout(lines: Sequence[str], expected: Expected) -> Layout:
    """Return where the rows of a text table are, and how they become cells.

    Raises
    ------
    FormatError, AmbiguousError
        As `exposight.files.read_table`.
    """
    if lines and (match := _SEPARATOR_LINE.fullmatch(lines[0].strip())):
        told = _told(expected.reading, match[1].replace("\\t", "\t"), expected.source)
        lines, expected = ["", *lines[1:]], replace(expected, reading=told)
    found = _sorted(lines, expected)
    if not found.lines and not found.comment:
        msg = f"{expected.source} is empty; expected the rows of the {expected.what}"
        raise FormatError(msg)
    found = _without_titles(found)
    try:
        return _laid_out(found, expected)
    except FormatError:
        layout = _below_others(found, expected)
        if layout is None:
            raise
        return layout


def _sorted(lines: Sequence[str], expected: Expected) -> _Sorted:
    body: list[tuple[int, str]] = []
    late: list[tuple[int, str]] = []
    comment = ""
    for number, line in enumerate(lines, start=1):
        bare = line.strip()
        if not bare.strip(";,|\t "):
            continue
        if not bare.startswith(COMMENTS) or is_word(bare):
            body.append((number, line))
        elif body:
            late.append((number, line))
        else:
            comment = bare.lstrip("/#%")
    remarks: list[str] = []
    named = expected.header is not False and len(body) == 1 and not has_number(body[0][1])
    if late and named:
        body += late  # rows whose names begin so: #1, #2
    elif late:
        shown = f"{len(late)} comment line{'s' * (len(late) > 1)}"
        remarks.append(f"{shown} below the first row left out")
    rows, numbers = [line for _, line in body], [number for number, _ in body]
    remarks += _without_count(rows, numbers, expected)
    return _Sorted(lines=rows, numbers=numbers, comment=comment, remarks=remarks)


def _without_titles(found: _Sorted) -> _Sorted:
    """Leave out the lines above the names that fill two cells at most where names fill more.

    Spreadsheets give a title as many separators as the rows have.
    """
    for mark in (";", "\t", ",", "|"):
        filled = [
            sum(bool(cell.strip(' "')) for cell in line.split(mark)) if mark in line else 0
            for line in found.lines[: _TITLE_LINES + 1]
        ]
        names = next((k for k, count in enumerate(filled) if count > 2), 0)
        if not names or not all(0 < count <= 2 for count in filled[:names]):
            continue
        if len(found.lines) <= names + 1 or has_number(found.lines[names]):
            continue
        shown = f"{names} line{'s' * (names > 1)} above the names left out"
        return replace(
            found,
            lines=found.lines[names:],
            numbers=found.numbers[names:],
            remarks=[*found.remarks, shown],
        )
    return found


def _below_others(found: _Sorted, expected: Expected) -> Layout | None:
    """Return the layout below lines of a title, as programs write them above a table, or None."""
    if not expected.header:
        return None
    for skipped in range(1, min(_TITLE_LINES, len(found.lines) - 2) + 1):
        if has_number(found.lines[skipped]) or has_number(found.lines[skipped], mostly=True):
            continue
        below = replace(
            found, lines=found.lines[skipped:], numbers=found.numbers[skipped:], comment=""
        )
        wanted = replace(expected, least=max(expected.least, 3))
        first = replace(below, lines=below.lines[:_FIRST], numbers=below.numbers[:_FIRST])
        is_long = len(below.lines) > 2 * _FIRST
        try:
            with contextlib.suppress(AmbiguousError):  # further lines may settle it
                _laid_out(first if is_long else below, wanted)
        except FormatError:
            continue
        try:
            layout = _laid_out(below, wanted)
        except FormatError:  # what does not fit stands below other titles as well
            return None
        if all(layout.names):
            shown = f"{skipped} line{'s' * (skipped > 1)} above the names left out"
            return replace(layout, remarks=[*layout.remarks, shown])
    return None


def _laid_out(found: _Sorted, expected: Expected) -> Layout:
    """Find the line of names, then the split of the lines."""
    body, numbers, commented, header = found.lines, found.numbers, found.comment, expected.header
    source, names = expected.source, None
    if body and header is not False and not has_number(body[0], mostly=bool(header)):
        names, body, numbers = body[0], body[1:], numbers[1:]
    elif commented and header is not False and (not body or looks_like_names(commented)):
        names = commented
    elif header:
        msg = (
            f"{source}: expected a line with the columns' names above the rows of the "
            f"{expected.what}, got {(body or [commented])[0].strip()[:60]!r}"
        )
        raise FormatError(msg)
    by_comment = names is not None and names == commented
    try:
        candidate = _recognise(body, numbers, names, expected)
        if by_comment and candidate.unnamed:
            msg = f"{source}: the comment {commented.strip()[:60]!r} does not name all columns"
            raise FormatError(msg)
    except FormatError:
        if not by_comment or header:
            raise
        names, by_comment = None, False  # a comment that has other words than names
        candidate = _recognise(body, numbers, names, expected)
    split, width = candidate.split, candidate.columns
    rows = [split.cells(line) for line in body]
    if any(len(cells) != width and (len(cells) < width or any(cells[width:])) for cells in rows):
        msg = f"{source}: {ragged_rows(candidate, body, numbers)}"
        raise FormatError(msg)
    heads = [] if names is None else split.names(names)
    if heads and len(heads) < width:  # R does not name the column of row names
        heads = ["", *heads]
    said = ["the names of the columns in a comment"] if by_comment else []
    return Layout(
        candidate=candidate,
        names=heads[:width],
        rows=rows,
        numbers=numbers,
        remarks=[*_split_remarks(split, candidate), *said, *found.remarks],
    )


def _recognise(
    body: list[str], numbers: list[int], names: str | None, expected: Expected
) -> Candidate:
    source, reading, least = expected.source, expected.reading, expected.least
    if len(body) > 2 * _SAMPLE:
        step = len(body) // _SAMPLE
        sample = sorted({*range(_SAMPLE), *range(0, len(body), step)})
        some, places = [body[k] for k in sample], [numbers[k] for k in sample]
        found = recognise_split(
            some, names, source, reading, numbers=places, least=least, sampled=True
        )
        if found is not None:
            return found
    found = recognise_split(body, names, source, reading, numbers=numbers, least=least)
    assert found is not None  # it asks, of all lines
    return found


def is_word(line: str) -> bool:
    """Return whether a line begins with a word such as #N/A, and so is no comment."""
    return line.startswith("#") and is_missing(re.split(r"[;,|\s]", line, maxsplit=1)[0])


def _told(reading: Reading, mark: str, source: str | Path) -> Reading:
    """Return the reading that a first line ``sep=;`` tells."""
    name = next(
        (name for name, own in MARKS.items() if own == mark), "blank" if mark == " " else ""
    )
    if not name:
        msg = (
            f"{source}: its first line says that {mark!r} separates, expected one of , ; | or a tab"
        )
        raise FormatError(msg)
    return reading.over(Reading(separator=name))


def has_number(line: str, *, mostly: bool = False) -> bool:
    """Return whether a line holds a cell that is a number, or most are: it is no line of names."""
    ways = [r"[;,|\t]"] if re.search(r"[;,|\t]", line) else []
    if not re.search(r"[;|\t]", line):
        ways.append(r"\s+")  # which may separate numbers with decimal commas
    for marks in ways:
        cells = [cell.strip().strip('"').strip() for cell in re.split(marks, line.strip())]
        filled = [cell for cell in cells if cell]
        numbers = sum(is_plain(cell, "point") or is_plain(cell, "comma") for cell in filled)
        if numbers > (len(filled) // 2 if mostly else 0) or all(map(is_missing, filled)):
            return True
    return False


def _without_count(body: list[str], numbers: list[int], expected: Expected) -> list[str]:
    """Leave out a line above the rows that tells how many there are; return what to say of it.

    Raises
    ------
    FormatError
        If there are others than it tells.
    """
    named = len(body) > 1 and expected.header is not False and not has_number(body[0])
    start = 1 if named else 0
    count = body[start].strip(" ;,|\t") if len(body) >= start + 2 else ""
    if not count.isdigit():
        return []
    if re.fullmatch(r"[+-]?\d+(?:\.\d*)?", body[start + 1].strip()):
        return []
    told, held = int(count), len(body) - start - 1
    if told != held:
        msg = (
            f"{expected.source} is cut off or wrong: line {numbers[start]} announces {told} rows, "
            f"it holds {held}"
        )
        raise FormatError(msg)
    del body[start], numbers[start]
    return ["a line that counts the rows"]


def _split_remarks(split: Split, candidate: Candidate) -> list[str]:
    """Return what to say of separator and decimal mark; nothing of commas and points."""
    shown = {"semicolon": "semicolons", "tab": "tabs", "pipe": "pipes", "blank": "blanks"}
    remarks = []
    if split.separator in shown and candidate.columns > 1:
        remarks.append(f"{shown[split.separator]} between the cells")
    if split.decimal == "comma":
        remarks.append("decimal commas")
    for mark in sorted(candidate.thousands):
        name = {",": "commas", ".": "points", "'": "apostrophes", "’": "apostrophes"}.get(
            mark, "blanks"
        )
        remarks.append(f"{name} between thousands")
    return remarks
