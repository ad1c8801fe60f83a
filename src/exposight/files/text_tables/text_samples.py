"""Text tables of millions of lines: recognised by a sample of them, then parsed as a whole."""

import io
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import polars as pl
from numpy.typing import NDArray

from exposight.errors import FormatError
from exposight.files.reading import Reading
from exposight.files.text_tables.cell_splits import MARKS
from exposight.files.text_tables.encodings import encoding_remark, recognise_encoding
from exposight.files.text_tables.table_layout import (
    COMMENTS,
    Expected,
    find_layout,
    has_number,
    is_word,
)

_SMALL = 2**19
"""Bytes below which a table is read line by line, which takes less than half a second."""

_HEAD = 2**16
_WINDOW = 2**13
_WINDOWS = 6
"""Bytes of the start, and of as many places after it, from which the dialect is recognised."""

_MISSING_WORDS = (
    "nan NaN NAN -nan +nan -NaN nan(ind) -nan(ind) -nan(snan) nan(snan) -NaN(ind) 1.#QNAN -1.#QNAN "
    "1.#IND -1.#IND 1.#IND00 -1.#IND00 1.#QNAN0 -1.#QNAN0 1.#SNAN NA N/A n/a #N/A #NV #DIV/0! NULL "
    "null Null None none - --"
)


class SampleError(FormatError):
    """A large table has lines that are not like the sample of them."""


@dataclass(frozen=True, kw_only=True)
class SampledTable:
    """A large text table whose dialect is known.

    Parameters
    ----------
    header : tuple of str
        Empty where it has none.
    columns : int
        Number of columns.
    remarks : tuple of str
        What was recognised.
    body : bytes
        Its rows: single separators, decimal points.
    mark : str
        Separator.
    height : int
        Number of rows.
    """

    header: tuple[str, ...]
    columns: int
    remarks: tuple[str, ...]
    body: bytes = field(repr=False)
    mark: str
    height: int

    def numbers(self, *places: int, rows: int | None = None) -> NDArray[np.float64]:
        """Return columns by their places, (height, k), or their first `rows` rows.

        Raises
        ------
        SampleError
            If one holds something else, or rows have other numbers of cells: reading line by line
            tells which.
        """
        names = [f"column_{place + 1}" for place in range(self.columns)]
        wanted = [names[place] for place in dict.fromkeys(places)]
        try:
            frame = pl.read_csv(
                io.BytesIO(self.body),
                has_header=False,
                separator=self.mark,
                quote_char=None,
                columns=wanted,
                schema={name: pl.Float64 if name in wanted else pl.String for name in names},
                null_values=_MISSING_WORDS.split(),
                n_rows=rows,
            )
        except pl.exceptions.PolarsError as error:
            raise SampleError(str(error).splitlines()[0]) from error
        if rows is None and frame.height != self.height:
            msg = f"expected {self.height} rows, got {frame.height}"
            raise SampleError(msg)
        columns = [frame[names[place]].fill_null(np.nan).to_numpy() for place in places]
        return np.stack(columns, axis=-1)


def sample_table(
    data: bytes, source: str | Path, reading: Reading, *, least: int, what: str
) -> SampledTable | None:
    """Return a large table of numbers whose dialect a sample of its lines tells.

    None where it is small or has something that needs reading line by line, as
    `exposight.files.parse_table` does.

    Raises
    ------
    AmbiguousError
        If two readings fit the sample equally well.
    """
    if len(data) < _SMALL or b'"' in data:
        return None
    encoding = reading.encoding or recognise_encoding(data)
    body, remark = _as_utf8(data, encoding), encoding_remark(encoding)
    if body is None:
        return None
    start, head, told = _start(body)
    body = _without_gaps(body[start:].strip(b"\n"))
    try:
        expected = Expected(source=source, what=what, reading=reading, header=None, least=least)
        sample = _sample(body)
        layout = find_layout([*head, *sample], expected) if sample else None
    except FormatError:
        return None
    if layout is None:
        return None
    candidate = layout.candidate
    split = candidate.split
    if candidate.thousands or split.joined or split.wide:
        return None
    mark = " " if split.separator == "blank" else MARKS[split.separator]
    height = body.count(b"\n") + 1
    comma = split.decimal == "comma"
    plain = _plain(body, mark, width=candidate.columns, decimal_comma=comma)
    if plain is None or (told is not None and told != height):
        return None
    remarks = [remark, *layout.remarks, *(["a line that counts the rows"] if told else [])]
    return SampledTable(
        header=tuple(layout.names),
        columns=candidate.columns,
        remarks=tuple(filter(None, remarks)),
        body=plain,
        mark=mark,
        height=height,
    )


def _as_utf8(data: bytes, encoding: str) -> bytes | None:
    """Return a text in UTF-8 with Unix newlines."""
    if encoding == "utf-8":
        body = data.removeprefix(b"\xef\xbb\xbf")
    else:
        try:
            body = data.decode(encoding).lstrip("\ufeff").encode()
        except UnicodeError:
            return None
    if b"\r" in body:
        body = body.replace(b"\r\n", b"\n").replace(b"\r", b"\n")
    return body


def _start(body: bytes) -> tuple[int, list[str], int | None]:
    """Return where the rows begin, the lines above, and the number of rows that one tells."""
    start, head, told = 0, list[str](), None
    lines = body[:_HEAD].split(b"\n")
    for k, raw in enumerate(lines[:-1]):
        line = raw.decode(errors="replace")
        bare = line.strip()
        following = lines[k + 1].strip()
        comment = bare.startswith(COMMENTS) and not is_word(bare)
        count = bare.strip(" ;,|\t")
        counts = count.isdigit() and told is None and not following.isdigit()
        if not comment and not counts and has_number(line):
            break
        if counts:
            told = int(count)
        else:
            head.append(line)
        start += len(raw) + 1
    return start, head, told


def _without_gaps(body: bytes) -> bytes:
    """Leave out blank lines and comments."""
    marks = (b"#", b"//", b"%")
    there = [mark for mark in marks if mark[:1] in body]  # quick to see, unlike two characters
    if b"\n\n" not in body and not any(b"\n" + mark in body for mark in there):
        return body
    kept = [
        line
        for line in body.split(b"\n")
        if line.strip() and (not line.startswith(marks) or is_word(line.decode(errors="replace")))
    ]
    return b"\n".join(kept)


def _sample(body: bytes) -> list[str]:
    """Return whole lines from the start of the rows and from places after it."""
    pieces = [body[:_WINDOW]]
    for k in range(1, _WINDOWS):
        at = k * len(body) // _WINDOWS
        pieces.append(body[at : at + _WINDOW].split(b"\n", 1)[-1])
    lines: list[str] = []
    for piece in pieces:
        lines += piece.decode(errors="replace").split("\n")[:-1]
    return lines


def _plain(body: bytes, mark: str, *, width: int, decimal_comma: bool) -> bytes | None:
    """Return rows with single separators, no blanks around cells, and decimal points.

    None where blanks are within cells, or the separators are not as many as `width` columns need.
    """
    separator = mark.encode()
    needed = (body.count(b"\n") + 1) * (width - 1)
    others = [blank for blank in (b" ", b"\t") if blank != separator and blank in body]
    if others or body.count(separator) != needed:
        body = _single(body, separator, others)
        if body.count(separator) != needed or any(blank in body for blank in others):
            return None
    return body.replace(b",", b".") if decimal_comma else body


def _single(body: bytes, separator: bytes, blanks: Sequence[bytes]) -> bytes:
    """Return rows without blanks around their cells, and without separators at their ends."""
    if separator == b" ":
        body = body.replace(b"\t", b" ")
        while b"  " in body:
            body = body.replace(b"  ", b" ")
    for blank in blanks:
        for before, after in (
            (blank, separator),
            (separator, blank),
            (blank, b"\n"),
            (b"\n", blank),
        ):
            pair, single = before + after, after if before == blank else before
            while separator != b" " and pair in body:
                body = body.replace(pair, single)
    if separator == b" ":
        body = body.replace(b" \n", b"\n").replace(b"\n ", b"\n")
    body = body.strip(b" \n")
    if body.split(b"\n", 1)[0].endswith(separator):
        body = body.replace(separator + b"\n", b"\n").removesuffix(separator)
    return body
