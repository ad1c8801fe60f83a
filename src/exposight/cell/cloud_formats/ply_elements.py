"""Elements in the body of a PLY file, text or binary, lists among their properties or not."""

import warnings
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.lib.recfunctions import structured_to_unstructured
from numpy.typing import NDArray

from exposight.cell.cloud_formats.number_lines import (
    lines_of,
    numbers_of_lines,
    rows_before_cut,
    with_plain_nan,
)
from exposight.compiled import njit
from exposight.errors import DamagedFileError, FormatError

Numbers = NDArray[np.floating]
_ODD_BYTES = 4
"""That may follow all elements: the end of a line, or zeros up to a whole word."""


@dataclass(frozen=True, kw_only=True)
class Property:
    """A property of an element.

    Parameters
    ----------
    name : str
    code : str
        NumPy's type of its number, or of each in its list: ``f4``.
    count_code : str
        NumPy's type of the length that stands before its list; empty of a plain number.
    """

    name: str
    code: str
    count_code: str = ""


@dataclass(kw_only=True)
class Element:
    """An element: how many there are, and the properties that each has."""

    name: str
    count: int
    properties: list[Property] = field(default_factory=list)

    @property
    def has_lists(self) -> bool:
        """Whether its rows may differ in length."""
        return any(each.count_code for each in self.properties)

    def index(self, name: str) -> int:
        """Return where a property stands."""
        return [each.name for each in self.properties].index(name)


class Body(Protocol):
    """What follows the header: the elements' numbers, one element after the other."""

    def require_all(self) -> None:
        """Raise `DamagedFileError` where there is less than the header announces."""
        ...

    def numbers(self, element: Element, names: Sequence[str]) -> Numbers:
        """Return properties of an element, (n, len(names)); `DamagedFileError` if it is cut off."""
        ...

    def entries(self, element: Element, name: str) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Return of each list of a property its length and its first entry, -1 of none."""
        ...


def cut_off(path: Path, element: Element, found: int) -> DamagedFileError:
    """Return the error of a file that ends before an element does."""
    what = "vertices" if element.name == "vertex" else f"elements {element.name!r}"
    return DamagedFileError(
        f"{path} is cut off: its header announces {element.count} {what}, it holds {found}; copy "
        "or export it again"
    )


class BinaryBody:
    """The body of a binary file.

    Parameters
    ----------
    data : bytes
        The whole file.
    start : int
        Where its body begins.
    byte_order : {'<', '>'}
    elements : sequence of Element
        All, in the file's order.
    path : Path
        For messages.
    """

    def __init__(
        self, data: bytes, start: int, byte_order: str, elements: Sequence[Element], path: Path
    ) -> None:
        self._data, self._order = np.frombuffer(data, np.uint8), byte_order
        self._elements, self._path = elements, path
        self._starts = {id(elements[0]): start}

    def require_all(self) -> None:
        """Raise `DamagedFileError` where there are fewer bytes than announced, or more."""
        end = 0
        for element in self._elements:
            start = self._start(element)
            if element.has_lists:
                _, end = self._walk(element, start, keep=False)
            else:
                row_bytes = sum(int(p.code[1]) for p in element.properties)
                self._require(element, start, row_bytes)
                end = start + element.count * row_bytes
        if self._data.size - end > _ODD_BYTES:
            msg = (
                f"{self._path}: {self._data.size - end} bytes follow all that its header "
                "announces; its counts are wrong: export it again"
            )
            raise DamagedFileError(msg)

    def numbers(self, element: Element, names: Sequence[str]) -> Numbers:
        """Return properties of an element, one row each."""
        start = self._start(element)
        if element.has_lists:
            offsets, _ = self._walk(element, start, keep=True)
            return np.stack([self._at(offsets, element, name) for name in names], axis=-1)
        dtype = np.dtype([(each.name, self._order + each.code) for each in element.properties])
        rows = np.frombuffer(self._data[start:].data, dtype, count=element.count)
        # Without a copy where x, y and z lie side by side, as they nearly always do.
        return structured_to_unstructured(rows[list(names)])

    def entries(self, element: Element, name: str) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Return of each list its length and its first entry, -1 of none."""
        offsets, _ = self._walk(element, self._start(element), keep=True)
        column = element.index(name)
        each = element.properties[column]
        counts = self._read(offsets[:, column], each.count_code).astype(np.int64)
        first = np.full(len(counts), -1, dtype=np.int64)
        some = counts > 0
        beyond = offsets[some, column] + int(each.count_code[1])
        first[some] = self._read(beyond, each.code).astype(np.int64)
        return counts, first

    def _at(self, offsets: NDArray[np.int64], element: Element, name: str) -> Numbers:
        column = element.index(name)
        values = self._read(offsets[:, column], element.properties[column].code)
        return values.astype(np.float64)

    def _read(self, offsets: NDArray[np.int64], code: str) -> NDArray[np.generic]:
        """Return the number at each offset."""
        gathered = self._data[offsets[:, None] + np.arange(int(code[1]))]
        return gathered.view(self._order + code)[:, 0]

    def _start(self, element: Element) -> int:
        """Return where an element begins, which is where the one before ends."""
        if id(element) not in self._starts:
            place = [each is element for each in self._elements].index(True)
            before = self._elements[place - 1]
            start = self._start(before)
            if before.has_lists:
                _, end = self._walk(before, start, keep=False)
            else:
                end = start + before.count * sum(int(p.code[1]) for p in before.properties)
            self._starts[id(element)] = end
        return self._starts[id(element)]

    def _require(self, element: Element, start: int, row_bytes: int) -> None:
        """Raise where an element's rows, of so many bytes or more, are not there."""
        there = max(self._data.size - start, 0) // row_bytes
        if there < element.count:
            raise cut_off(self._path, element, there)

    def _walk(self, element: Element, start: int, *, keep: bool) -> tuple[NDArray[np.int64], int]:
        """Return where each property of each row begins, if they are kept, and where all end."""
        counts = [int(p.count_code[1]) if p.count_code else 0 for p in element.properties]
        sizes = [int(p.code[1]) for p in element.properties]
        least = sum(count or size for count, size in zip(counts, sizes, strict=True))
        self._require(element, start, least)
        offsets = np.zeros((max(element.count if keep else 1, 1), len(sizes)), dtype=np.int64)
        found, end = _walk_bytes(
            self._data,
            start,
            element.count,
            np.array(counts),
            np.array(sizes),
            self._order == ">",
            offsets,
        )
        if found < element.count:
            raise cut_off(self._path, element, found)
        return offsets[: element.count], end


@njit()
def _walk_bytes(
    data: NDArray[np.uint8],
    start: int,
    n_rows: int,
    counts: NDArray[np.int64],
    sizes: NDArray[np.int64],
    is_big: bool,
    offsets: NDArray[np.int64],
) -> tuple[int, int]:
    at = start
    for row in range(n_rows):
        for column in range(len(sizes)):
            offsets[row % len(offsets), column] = at
            width = counts[column]
            n = 1
            if width > 0:
                if at + width > len(data):
                    return row, at
                n = 0
                for k in range(width):
                    n = 256 * n + data[at + (k if is_big else width - 1 - k)]
            at += width + n * sizes[column]
            if at > len(data):
                return row, at
    return n_rows, at


class TextBody:
    """The body of an ASCII file: a line for each row.

    Parameters
    ----------
    text : bytes
        What follows the header.
    elements, path
        As of `BinaryBody`.
    """

    def __init__(self, text: bytes, elements: Sequence[Element], path: Path) -> None:
        self._text, self._elements, self._path = text, elements, path

    def require_all(self) -> None:
        """Raise `DamagedFileError` where there are fewer lines than rows."""
        left = lines_of(self._text)
        for element in self._elements:
            if element.count > left:
                raise cut_off(self._path, element, left)
            left -= element.count

    def numbers(self, element: Element, names: Sequence[str]) -> Numbers:
        """Return properties of an element, one row each."""
        if element.count == 0:
            return np.zeros((0, len(names)))
        wanted = [element.index(name) for name in names]
        if any(each.count_code for each in element.properties[: max(wanted)]):
            tokens, offsets = self._walk(element)
            return tokens[offsets[:, wanted]]
        lines = self._lines(element)
        try:
            read = numbers_of_lines(lines, wanted, self._path, most=element.count)
        except ValueError as error:
            found = rows_before_cut(lines, wanted, self._path, element.count)
            if found is not None:
                raise cut_off(self._path, element, found) from error
            listed = " ".join(each.name for each in element.properties)
            msg = (
                f"{self._path}: a {element.name} cannot be read ({error}); expected {listed} on a "
                "line"
            )
            raise FormatError(msg) from error
        if len(read) < element.count:
            raise cut_off(self._path, element, len(read))
        return read

    def entries(self, element: Element, name: str) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Return of each list its length and its first entry, -1 of none."""
        tokens, offsets = self._walk(element)
        at = offsets[:, element.index(name)]
        counts = tokens[at].astype(np.int64)
        first = np.full(len(counts), -1, dtype=np.int64)
        some = counts > 0
        first[some] = tokens[at[some] + 1].astype(np.int64)
        return counts, first

    def _lines(self, element: Element) -> bytes:
        """Return the text from an element's first line on, to its last if another follows."""
        place = [each is element for each in self._elements].index(True)
        before = sum(each.count for each in self._elements[:place])
        if before == 0 and not element.has_lists:
            return self._text  # whoever reads it takes no more rows than there are
        ends = np.flatnonzero(np.frombuffer(self._text, np.uint8) == ord("\n"))
        if before > len(ends):
            return b""
        start = int(ends[before - 1]) + 1 if before else 0
        last = before + element.count
        return self._text[start : int(ends[last - 1]) + 1 if last <= len(ends) else None]

    def _walk(self, element: Element) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
        """Return all numbers of an element, and where each property of each row begins."""
        lines = with_plain_nan(self._lines(element))
        with warnings.catch_warnings():
            warnings.simplefilter("error", DeprecationWarning)
            try:
                tokens = np.fromstring(lines, sep=" ") if lines.strip() else np.zeros(0)
            except (DeprecationWarning, ValueError) as error:
                msg = f"{self._path}: element {element.name!r} holds something that is no number"
                raise FormatError(msg) from error
        n_properties = len(element.properties)
        if element.count * n_properties > tokens.size:
            raise cut_off(self._path, element, tokens.size // n_properties)
        is_list = np.array([bool(each.count_code) for each in element.properties])
        offsets = np.zeros((element.count, n_properties), dtype=np.int64)
        found = _walk_tokens(tokens, element.count, is_list, offsets)
        if found < element.count:
            raise cut_off(self._path, element, found)
        return tokens, offsets


@njit()
def _walk_tokens(
    tokens: NDArray[np.float64],
    n_rows: int,
    is_list: NDArray[np.bool_],
    offsets: NDArray[np.int64],
) -> int:
    at = 0
    for row in range(n_rows):
        for column in range(len(is_list)):
            if at >= len(tokens):
                return row
            offsets[row, column] = at
            if is_list[column]:
                n = tokens[at]
                if not 0 <= n <= len(tokens) or n != np.floor(n):
                    return row
                at += int(n)
            at += 1
            if at > len(tokens):
                return row
    return n_rows
