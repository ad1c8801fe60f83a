"""Ways to split the lines of a text table into cells."""

import csv
import re
from dataclasses import dataclass

MARKS = {"comma": ",", "semicolon": ";", "tab": "\t", "pipe": "|"}
"""Separators of one character; blanks are one or more of them, or two where cells hold one."""

_BLANK_CELLS = re.compile(r'"((?:[^"]|"")*)"|([^ \t"]\S*)')
_WIDE_BLANKS = re.compile(r" {2,}|\t+| *\t *")
_UNIT_WORD = re.compile(r"[\[(][^\])]*[\])]")


@dataclass(frozen=True, kw_only=True)
class Split:
    """How a line becomes cells.

    Parameters
    ----------
    separator : {'comma', 'semicolon', 'tab', 'blank', 'pipe'}
    decimal : {'point', 'comma'}
    wide : bool
        Two blanks or more separate, and one does not.
    joined : bool
        Each two cells between commas are one number with a decimal comma.
    """

    separator: str
    decimal: str
    wide: bool = False
    joined: bool = False

    def cells(self, line: str) -> list[str]:
        """Return the cells of a line, stripped, quotes removed; empty ones at its end included."""
        if self.separator == "blank":
            return _blank_cells(line.strip(" \t"), wide=self.wide)
        mark = MARKS[self.separator]
        if '"' not in line:
            cells = list(map(_stripped, line.split(mark)))
        else:
            rows = csv.reader([line], delimiter=mark, skipinitialspace=True)
            try:
                cells = list(map(_stripped, next(iter(rows), [])))
            except csv.Error:  # a cell of more than 131072 characters is none
                cells = [line]
        if not self.joined or '"' in line:  # quotes tell the cells
            return cells
        while cells and not cells[-1]:
            cells.pop()
        if len(cells) % 2 or not all(cell.isdigit() for cell in cells[1::2]):
            return cells
        return [f"{whole},{part}" for whole, part in zip(cells[::2], cells[1::2], strict=True)]

    def names(self, line: str) -> list[str]:
        """Return the cells of a line of names, whose units may stand apart: ``X [mm] Y [mm]``."""
        if self.joined:
            return Split(separator=self.separator, decimal=self.decimal).cells(line)
        cells = self.cells(line)
        if self.separator != "blank":
            return cells
        names: list[str] = []
        for cell in cells:
            if names and _UNIT_WORD.fullmatch(cell):
                names[-1] = f"{names[-1]} {cell}"
            else:
                names.append(cell)
        return names


def _stripped(cell: str) -> str:
    return cell.strip(" \t\u00a0")


def _blank_cells(line: str, *, wide: bool) -> list[str]:
    if wide:
        return [cell.strip('" ') for cell in _WIDE_BLANKS.split(line)]
    if '"' not in line:
        return re.split(r"[ \t]+", line) if line else []
    return [
        (match[1] or "").replace('""', '"') if match[2] is None else match[2]
        for match in _BLANK_CELLS.finditer(line)
    ]


@dataclass(frozen=True, kw_only=True)
class Candidate:
    """A split that was tried on lines.

    Parameters
    ----------
    split : Split
    columns : int
        Cells that most lines have.
    ragged : int
        Lines with another number of cells.
    fits_names : bool
        Whether the line of names has as many.
    digits : int
        Digits within cells that are numbers, less those of numbers that would have marks between
        their thousands and do not.
    thousands : frozenset of str
        Marks between thousands.
    grouped : str
        A number with such a mark.
    unnamed : bool
        Whether there is a column more than names, as R writes row names.
    """

    split: Split
    columns: int
    ragged: int
    fits_names: bool
    digits: int
    thousands: frozenset[str]
    grouped: str
    unnamed: bool = False

    @property
    def fits(self) -> bool:
        """Whether each line, and that of names, has as many cells."""
        return not self.ragged and self.fits_names
