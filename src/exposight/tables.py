"""Tables: a frame and its columns, from which terminal, page and CSV file follow."""

from __future__ import annotations

import html
import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import polars as pl

from exposight.quantities import QUANTITIES, quantity

NO_VALUE = "–"


def number(value: float | None, digits: int = 4) -> str:
    """Format a number with that many significant digits, without an exponent where it can be.

    None and NaN are a dash.
    """
    if value is None or math.isnan(value):
        return NO_VALUE
    if value and not 1e-4 <= abs(value) < 1e6:
        return f"{value:.{digits - 1}e}".replace("-", "−")
    spelled = f"{value:.{digits}g}"
    return (f"{value:.0f}" if "e" in spelled else spelled).replace("-", "−")


def fixed(value: float | None, decimals: int) -> str:
    """Format a number with that many decimals; None and NaN are a dash."""
    if value is None or math.isnan(value):
        return NO_VALUE
    return f"{round(value, decimals) + 0.0:.{decimals}f}".replace("-", "−")  # 0 is never negative


def count(value: int) -> str:
    """Format a whole number with blanks between its thousands, as the field's papers do."""
    return f"{value:,}".replace(",", " ")


def counted(value: int, noun: str) -> str:
    """Format a number of things: "1 row", "20 rows"."""
    return f"{count(value)} {noun}{'' if value == 1 else 's'}"


@dataclass(frozen=True, kw_only=True)
class Column:
    """How a column of a frame is shown.

    Parameters
    ----------
    name : str
        In the frame, and in CSV and JSON.
    label : str
        Heading, which may have several lines; the name above its unit by default.
    digits : int, optional
        Significant digits of numbers; 4 where the catalogue of quantities has no decimals.
    decimals : int, optional
        Decimals of numbers, in place of significant digits.
    scale : float
        Numbers are shown times this: 100 for a share in percent.
    error_of : str
        Column of the frame that says which quantity each row's value is an error of, such as
        ``p_norm``; the value is then shown in the unit of that quantity's errors.
    wraps : bool
        Whether long text may be broken into several lines.
    """

    name: str
    label: str = ""
    digits: int | None = None
    decimals: int | None = None
    scale: float = 1.0
    error_of: str = ""
    wraps: bool = False

    @property
    def heading(self) -> str:
        """Label, or the name without its unit and the unit below."""
        unit = quantity(self.name).suffix
        words = self.name if self.name in QUANTITIES else self.name.replace("_", " ")
        if not self.label and self.name.endswith(("_ms", "_mm", "_deg")):
            return f"{words[: -1 - len(self.name.rpartition('_')[2])]}\n{unit}"
        return self.label or words

    def cell(self, row: Mapping[str, Any]) -> str:
        """Return the value that a row has in this column, as people read it."""
        if not self.error_of:
            return self._text(row[self.name], self.scale)
        judged = quantity(row[self.error_of])
        text = self._text(row[self.name], judged.error_factor)
        return f"{text} {judged.error_unit}".rstrip() if text != NO_VALUE else text

    def _text(self, value: Any, scale: float) -> str:
        match value:
            case None:
                return NO_VALUE
            case bool():
                return "yes" if value else "no"
            case int() if scale == 1.0 and self.decimals is None:
                return count(value)
            case int() | float():
                decimals = self.decimals
                if decimals is None and self.digits is None and self.name in QUANTITIES:
                    decimals = QUANTITIES[self.name].digits
                if decimals is not None:
                    return fixed(scale * value, decimals)
                return number(scale * value, self.digits or 4)
            case list() | tuple():
                return ", ".join(
                    str(item) if isinstance(item, int) else self._text(item, scale)
                    for item in value
                )
        return str(value)


@dataclass(frozen=True, kw_only=True, eq=False)
class Table:
    """A frame and how it is shown.

    Parameters
    ----------
    name : str
        Its key in JSON.
    frame : polars.DataFrame
        One row for each line. May have more columns than are shown.
    columns : tuple of Column
        What is shown, in this order; the first column names the row.
    title : str
        Stands above the table.
    shown_rows : int, optional
        A terminal shows so many rows at most; none and nothing of the table at 0.
    """

    name: str
    frame: pl.DataFrame
    columns: tuple[Column, ...]
    title: str = ""
    shown_rows: int | None = None

    @classmethod
    def of(
        cls,
        name: str,
        rows: Iterable[Mapping[str, Any]],
        columns: tuple[Column, ...],
        *,
        title: str = "",
    ) -> Table:
        """Make a table of rows that map columns to values."""
        frame = pl.DataFrame(list(rows), infer_schema_length=None)
        return cls(name=name, frame=frame, columns=columns, title=title)

    def is_text(self, column: Column) -> bool:
        """Return whether a column holds words, which are aligned left."""
        return not self.frame[column.name].dtype.is_numeric()

    def cells(self) -> list[tuple[str, ...]]:
        """Return every row's cells as people read them."""
        return [
            tuple(column.cell(row) for column in self.columns)
            for row in self.frame.iter_rows(named=True)
        ]

    def __str__(self) -> str:
        headings = tuple(column.heading.replace("\n", " ") for column in self.columns)
        rows = [headings, *self.cells()]
        widths = [max(map(len, cells)) for cells in zip(*rows, strict=True)]
        left = [self.is_text(column) for column in self.columns]
        return "\n".join(
            "  ".join(
                cell.ljust(width) if is_left else cell.rjust(width)
                for cell, width, is_left in zip(cells, widths, left, strict=True)
            ).rstrip()
            for cells in rows
        )

    def _repr_html_(self) -> str:
        head = "".join(f"<th>{html.escape(each.heading)}</th>" for each in self.columns)
        body = "".join(
            f"<tr>{''.join(f'<td>{html.escape(cell)}</td>' for cell in cells)}</tr>"
            for cells in self.cells()
        )
        return f"<table><tr>{head}</tr>{body}</table>"
