"""One reader of text tables in the dialects that programs and spreadsheets write.

Encoding, separator, decimal mark, thousands marks, comments, units below the names, a count of the
lines, a column that counts the rows and words for missing values are recognised; what two readings
fit equally well is asked (``docs/formats.md``, Text tables).
"""

import re
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from exposight.errors import FormatError, did_you_mean, first_ten
from exposight.files.durable import read_bytes
from exposight.files.reading import Reading, current_reading, recognised
from exposight.files.text_tables.column_units import is_unit
from exposight.files.text_tables.encodings import decode, encoding_remark
from exposight.files.text_tables.table_layout import Expected, find_layout
from exposight.files.text_tables.written_numbers import is_missing, is_plain, to_numbers

_MARKS = ("point", "comma")
_COUNTING_NAMES = frozenset({"index", "idx"})
_OPEN_QUOTE = re.compile(r'(?:^|[;,|\t])\s*"[^"]*(?:""[^"]*)*$')
_CELL_LINES = 20
"""Lines that a cell may have."""
_UNNAMED = re.compile(r"(?:Unnamed: ?\d+(?:[._]level_\d+)?(?:\.\d+)?)?", re.IGNORECASE)


@dataclass(frozen=True, kw_only=True)
class TextTable:
    """The cells of a text table.

    Parameters
    ----------
    source : str
        Where it came from, for messages.
    header : tuple of str
        The columns' names as they stand there; empty where the table has none.
    rows : tuple of tuple of str
        Cells without blanks around them; words for a missing value are empty.
    lines : tuple of int
        The line in the file of each row.
    separator, decimal, encoding : str
        As `Reading` names them.
    remarks : tuple of str
        What was recognised beyond commas, decimal points and UTF-8.
    thousands : frozenset of str
        Marks between the thousands of numbers.
    """

    source: str
    header: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    lines: tuple[int, ...]
    separator: str = "comma"
    decimal: str = "point"
    encoding: str = "utf-8"
    remarks: tuple[str, ...] = ()
    thousands: frozenset[str] = field(default=frozenset(), repr=False)

    def __len__(self) -> int:
        return len(self.rows)

    @property
    def columns(self) -> int:
        """Number of columns."""
        return len(self.header) or (len(self.rows[0]) if self.rows else 0)

    def say(self) -> None:
        """Say what was recognised."""
        recognised(self.source, *self.remarks)

    def texts(self, column: str | int) -> list[str]:
        """Return the cells of a column, by its name in the header or its place."""
        place = self._place(column)
        return [row[place] for row in self.rows]

    def numbers(self, *columns: str | int, rows: int | None = None) -> NDArray[np.float64]:
        """Return the numbers of a column, (n,), or of several, (n, k); NaN where a cell is empty.

        With `rows`, of the first rows only.

        Raises
        ------
        FormatError
            If a cell is no number; the first ten are named, and how many there are.
        """
        read, faults = [], []
        for column in columns:
            place = self._place(column)
            cells = [row[place] for row in self.rows[:rows]]
            values, wrong = to_numbers(cells, self.decimal, self.thousands)
            read.append(values)
            name = self.header[place] if self.header else f"column {place + 1}"
            faults += [(self.lines[row], name, cells[row]) for row in wrong]
        if faults:
            faults.sort(key=lambda fault: fault[0])
            shown = [f"line {line}, {name}: {cell!r}" for line, name, cell in faults]
            msg = (
                f"{self.source}: expected numbers with a decimal {self.decimal}, got "
                f"{first_ten(shown, ', ')}"
            )
            raise FormatError(msg)
        if len(read) == 1:
            return read[0]
        return np.stack(read, axis=-1) if read else np.zeros((len(self.rows), 0))

    def _place(self, column: str | int) -> int:
        if isinstance(column, int):
            return column
        if column in self.header:
            return self.header.index(column)
        msg = (
            f"{self.source}: no column {column!r}, it has {', '.join(self.header)}"
            f"{did_you_mean(column, self.header)}"
        )
        raise FormatError(msg)


def read_table(
    path: str | Path,
    what: str,
    *,
    reading: Reading | None = None,
    header: bool | None = True,
    least: int = 1,
) -> TextTable:
    """Read a text table in any dialect.

    Parameters
    ----------
    path : path
    what : str
        What it is, for messages: "feature list".
    reading : Reading, optional
        What somebody says of the file; the rest is recognised, or asked.
    header : bool, optional
        Whether its first line names the columns; None recognises it.
    least : int
        Columns that it must have.

    Raises
    ------
    MissingFileError
        If it is not there.
    FormatError
        If it is no table, or not as `reading` says; rows with other numbers of cells are named.
    AmbiguousError
        If two readings fit equally well.
    """
    data = read_bytes(Path(path), what)
    return parse_table(data, path, what=what, reading=reading, header=header, least=least)


def parse_table(
    data: bytes,
    source: str | Path,
    *,
    what: str = "table",
    reading: Reading | None = None,
    header: bool | None = True,
    least: int = 1,
) -> TextTable:
    """Read the bytes of a text table; see `read_table`."""
    reading = current_reading(reading)
    text, encoding = decode(data, source, reading.encoding)
    expected = Expected(source=source, what=what, reading=reading, header=header, least=least)
    layout = find_layout(_lines(text), expected)
    remarks = [encoding_remark(encoding, given=reading.encoding is not None), *layout.remarks]
    width = layout.candidate.columns
    plain = frozenset("0123456789" if "#" not in text else "")  # 1.#QNAN begins with a digit
    rows = [
        ["" if cell[:1] not in plain and is_missing(cell) else cell for cell in cells[:width]]
        for cells in layout.rows
    ]
    names, numbers = layout.names, layout.numbers
    names, rows, numbers, said = _without_units(names, rows, numbers)
    remarks += said
    names, rows, said = _without_index(names, rows)
    remarks += said
    names, rows = _without_empty(names, rows)
    return TextTable(
        source=str(source),
        header=tuple(names),
        rows=tuple(map(tuple, rows)),
        lines=tuple(numbers),
        separator=layout.candidate.split.separator,
        decimal=layout.candidate.split.decimal,
        encoding=encoding,
        remarks=tuple(filter(None, remarks)),
        thousands=layout.candidate.thousands,
    )


def _lines(text: str) -> list[str]:
    """Return lines by any of the three newlines, without other characters that Python splits at.

    Spreadsheets write cells of several lines in quotes: they become one line, blank ones follow.
    """
    lines = text.replace("\r\n", "\n").replace("\r", "\n").split("\n")
    if '"' not in text:
        return lines
    for first, line in enumerate(lines):
        last = first
        while _OPEN_QUOTE.search(line) and line.count('"') % 2 and last + 1 < len(lines):
            last += 1
            line = f"{line} {lines[last]}"
            if last - first > _CELL_LINES:
                break
        else:
            lines[first : last + 1] = [line, *[""] * (last - first)]
    return lines


def _without_units(
    names: list[str], rows: list[list[str]], numbers: list[int]
) -> tuple[list[str], list[list[str]], list[int], list[str]]:
    """Put units that stand in a line below the names behind these."""
    first = rows[0] if rows and names else []
    told = [k for k, cell in enumerate(first) if re.search(r"[^\W\d_]|[°%]", cell)]
    if not told or not all(not cell or is_unit(cell) for cell in first):
        return names, rows, numbers, []
    if not any(is_plain(row[k], mark) for row in rows[1:] for k in told for mark in _MARKS):
        return names, rows, numbers, []
    joined = [
        f"{name} [{cell.strip('[]()')}]" if cell else name
        for name, cell in zip(names, first, strict=True)
    ]
    return joined, rows[1:], numbers[1:], ["units in a line below the names"]


def _without_index(
    names: list[str], rows: list[list[str]]
) -> tuple[list[str], list[list[str]], list[str]]:
    """Leave out first columns that only count the rows, as pandas and R write them."""
    remarks = []
    while len(names) > 1 and rows:
        cells = [row[0] for row in rows]
        unnamed = _UNNAMED.fullmatch(names[0]) is not None
        if not unnamed and names[0].lower() not in _COUNTING_NAMES:
            break
        labels = all(map(str.isdecimal, cells))
        counting = labels and [int(cell) - int(cells[0]) for cell in cells] == [*range(len(cells))]
        if not (counting and int(cells[0]) in {0, 1}) and not (
            unnamed and labels and len(set(cells)) == len(cells)
        ):
            break
        shown = f"column {names[0]!r}" if names[0] else "a first column without a name"
        remarks.append(f"{shown} counts the rows and is left out")
        names, rows = names[1:], [row[1:] for row in rows]
    return names, rows, remarks


def _without_empty(names: list[str], rows: list[list[str]]) -> tuple[list[str], list[list[str]]]:
    """Leave out columns that have neither a name nor a cell."""
    kept = [k for k, name in enumerate(names) if name or any(row[k] for row in rows)]
    if len(kept) == len(names):
        return names, rows
    return [names[k] for k in kept], [[row[k] for k in kept] for row in rows]
