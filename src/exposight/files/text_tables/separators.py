"""What stands between the cells of a text table, and which mark its decimals have.

Every reading, a separator with a decimal mark, splits the lines. Of those that give each line the
same number of cells the one stays whose numbers hold the most digits: a wrong one tears numbers
apart or leaves several in a cell. Where two read different values out of all that, it is asked.
"""

import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from exposight.errors import FormatError, first_ten
from exposight.files.reading import Reading, ambiguous
from exposight.files.text_tables.cell_splits import MARKS, Candidate, Split
from exposight.files.text_tables.written_numbers import is_missing, is_plain, thousands_mark

_TORN_OFF = re.compile(r"^[,;|]|[,;|]$")

_TYPED_BY_OFFICE = frozenset({"semicolon", "tab"})
"""Separators of spreadsheets, which write thousands with marks; programs do not."""


def recognise_split(
    lines: Sequence[str],
    names: str | None,
    source: str | Path,
    reading: Reading,
    *,
    numbers: Sequence[int],
    least: int = 1,
    sampled: bool = False,
) -> Candidate | None:
    """Return how lines become cells.

    Parameters
    ----------
    lines : sequence of str
        Without blank ones and comments.
    names : str or None
        The line of names above them.
    source : str or Path
        For messages.
    reading : Reading
        What somebody says.
    numbers : sequence of int
        Where the lines are in the file, for messages.
    least : int
        Columns that the table must have.
    sampled : bool
        There are further lines: None is returned instead of asking.

    Raises
    ------
    AmbiguousError
        If two readings fit equally well and give other numbers.
    FormatError
        If none fits, or not the one that somebody says.
    """
    tried = [_tried(split, lines, names) for split in _splits(lines, reading, names)]
    fitting = [each for each in tried if each.fits and each.columns >= least]
    if not fitting:
        raise _no_split(tried, lines, numbers, names, source, reading, least)
    fitting = [each for each in fitting if not each.unnamed] or fitting
    digits = max(each.digits for each in fitting)
    best = [each for each in fitting if each.digits == digits]
    kept = _without_weaker(best, lines, reading)
    if len(kept) == 1:
        return kept[0]
    if sampled:
        return None
    raise _mixed(kept, lines, numbers, source) or _question(kept, lines, source)


def _splits(lines: Sequence[str], reading: Reading, names: str | None) -> list[Split]:
    """Return the splits to try, the likeliest first."""
    separators = [reading.separator] if reading.separator else [*MARKS, "blank"]
    decimals = [reading.decimal] if reading.decimal else ["point", "comma"]
    start = [*lines[:20], *([names] if names else [])]
    splits = []
    for separator in separators:
        there = separator == "blank" or any(MARKS[separator] in line for line in start)
        if not there and reading.separator is None:
            continue
        for decimal in decimals:
            splits.append(Split(separator=separator, decimal=decimal))
            if separator == "blank":
                splits.append(Split(separator=separator, decimal=decimal, wide=True))
            if (separator, decimal) == ("comma", "comma") and (
                reading.separator is None or reading.decimal is not None
            ):
                splits.append(Split(separator=separator, decimal=decimal, joined=True))
    return splits


def _tried(split: Split, lines: Sequence[str], names: str | None) -> Candidate:
    rows = [split.cells(line) for line in lines]
    heads = None if names is None else split.names(names)
    columns, ragged = _columns(rows, heads)
    digits, unmarked, thousands, grouped = 0, 0, set[str](), ""
    strict = split.separator in {"blank", "comma"}
    for row in rows:
        for cell in row:
            if is_plain(cell, split.decimal) and not (strict and cell.lstrip("+-").startswith(",")):
                count = sum(map(str.isdigit, cell))
                digits += count
                whole = re.match(r"[+-]?(\d*)", cell)
                unmarked += bool(whole and len(whole[1]) > 3) and count
                continue
            mark = thousands_mark(cell, split.decimal)
            if mark and not (strict and mark == " "):
                digits += sum(map(str.isdigit, cell))
                thousands.add(mark)
                grouped = grouped or cell
    if split.joined and not all("," in cell for row in rows for cell in row):
        ragged = len(rows)
    if columns == 1 and (split.wide or not _is_one_column(rows, names, split)):
        ragged = max(len(rows), 1)
    if split.separator == "blank" and any(_TORN_OFF.search(cell) for row in rows for cell in row):
        ragged = max(ragged, 1)
    return Candidate(
        split=split,
        columns=columns,
        ragged=ragged,
        fits_names=heads is None or _fits(heads, columns, split),
        digits=digits - (unmarked if thousands else 0),
        unnamed=heads is not None and len(heads) < columns,
        thousands=frozenset(thousands),
        grouped=grouped,
    )


def _columns(rows: Sequence[Sequence[str]], heads: Sequence[str] | None) -> tuple[int, int]:
    """Return how many columns rows have without empty ones at their end, and how many do not."""
    counts = Counter(len(row) for row in rows)
    if not counts:
        return (len(heads) if heads else 0), 0
    columns = max(counts, key=lambda count: (counts[count], count))
    if heads is not None and len(heads) in counts and len(heads) < columns:
        columns = len(heads)
    while columns > 1 and heads is not None and columns > len(heads):
        if any(len(row) >= columns and row[columns - 1] for row in rows):
            break
        columns -= 1
    ragged = _ragged(rows, columns)
    if ragged:
        # Separators at the ends of some lines only.
        most = max((k + 1 for row in rows for k, cell in enumerate(row) if cell), default=1)
        named = most if heads is None else sum(map(bool, heads))
        if most == named and not _ragged(rows, most):
            return most, 0
    return columns, ragged


def _ragged(rows: Sequence[Sequence[str]], columns: int) -> int:
    return sum(len(row) < columns or any(row[columns:]) for row in rows)


def _is_one_column(rows: Sequence[Sequence[str]], names: str | None, split: Split) -> bool:
    """Return whether nothing in the lines can separate cells, but for marks within numbers."""
    if names is not None and re.search(r"[,;|\t]", names.strip()):
        return False
    cells = (row[0] for row in rows if row)
    return all(
        not re.search(r"[,;|\t]", cell)
        or is_plain(cell, split.decimal)
        or bool(thousands_mark(cell, split.decimal))
        for cell in cells
    )


def _fits(heads: Sequence[str], columns: int, split: Split) -> bool:
    filled = len(heads)
    while filled > columns and not heads[filled - 1]:
        filled -= 1
    if split.separator == "blank" and any(re.search(r"[,;|]", head) for head in heads):
        return False
    # R names the columns but not that of the rows' names.
    return filled == columns or (
        split.separator in {"blank", "tab"} and not split.wide and filled == columns - 1 > 0
    )


def _without_weaker(
    best: Sequence[Candidate], lines: Sequence[str], reading: Reading
) -> list[Candidate]:
    """Return the candidates that read different values, the first of each, without weaker ones."""
    marked = [each for each in best if each.split.separator != "blank"]
    several = [each for each in marked if each.columns > 1]
    if several:
        # Blanks separate where nothing else does, but not where numbers have decimal commas.
        best = [
            each
            for each in best
            if each.split.separator != "blank"
            or (each.split.decimal == "comma" and _has_commas(each, lines))
        ]
    if any(each.columns > 1 for each in best):
        best = [each for each in best if each.columns > 1 or _has_commas(each, lines)]
    pointed = {each.split.separator for each in best if each.split.decimal == "point"}
    kept: dict[object, Candidate] = {}
    for each in best:
        # 1.234 with a thousands mark is written by spreadsheets only; 1,234 by everybody.
        office = each.split.separator in _TYPED_BY_OFFICE
        if each.thousands == {"."} and each.split.separator in pointed and not office:
            continue
        kept.setdefault(_values(each, lines), each)
    found = list(kept.values())
    if reading.decimal == "comma":
        joined = [each for each in found if each.split.joined]
        found = joined or found
    return found


def _has_commas(candidate: Candidate, lines: Sequence[str]) -> bool:
    cells = (cell for line in lines for cell in candidate.split.cells(line))
    return any(
        "," in cell and (is_plain(cell, "comma") or thousands_mark(cell, "comma") != "")
        for cell in cells
    )


def _values(candidate: Candidate, lines: Sequence[str]) -> object:
    """Return the values that a candidate reads out of lines, for comparing."""
    split = candidate.split
    return tuple(
        tuple(_value(cell, split.decimal) for cell in split.cells(line)[: candidate.columns])
        for line in lines
    )


def _value(cell: str, decimal: str) -> object:
    if is_missing(cell):
        return None
    mark = thousands_mark(cell, decimal)
    if mark or is_plain(cell, decimal):
        return (cell.replace(mark, "") if mark else cell).replace(",", ".")
    return cell


def _mixed(
    kept: Sequence[Candidate], lines: Sequence[str], numbers: Sequence[int], source: str | Path
) -> Exception | None:
    """Return the error of a table in which some decimals have points and some commas."""
    if len({each.split.separator for each in kept}) > 1 or any(e.split.joined for e in kept):
        return None
    found: dict[str, list[str]] = {"point": [], "comma": []}
    for number, line in zip(numbers, lines, strict=True):
        for cell in kept[0].split.cells(line):
            fits = [name for name in found if is_plain(cell, name) or thousands_mark(cell, name)]
            if len(fits) == 1:
                found[fits[0]].append(f"line {number}: {cell}")
    if not all(found.values()):
        return None
    msg = (
        f"{source}: some of its numbers have decimal points ({found['point'][0]}) and some decimal "
        f"commas ({found['comma'][0]}); expected one of them throughout"
    )
    return FormatError(msg)


def _question(kept: Sequence[Candidate], lines: Sequence[str], source: str | Path) -> Exception:
    line = next(
        (line for line in lines if len({_values(each, [line]) for each in kept}) == len(kept)),
        lines[0],
    )
    shown = line.strip()[:60]
    by_decimal = {each.split.decimal: each for each in reversed(kept)}
    by_separator = {each.split.separator: each for each in reversed(kept)}
    grouped = next((each.grouped for each in kept if each.grouped), "")
    if len(by_decimal) == len(kept):
        what = (
            f"is {grouped} a number with decimals or one in thousands?"
            if grouped and len({each.split.separator for each in kept}) == 1
            else f"is the comma in {shown!r} a separator or a decimal comma?"
        )
        answers = {name: _described(by_decimal[name], line) for name in by_decimal}
        return ambiguous(source, what, "decimal", answers)
    answers = {name: _described(by_separator[name], line) for name in by_separator}
    return ambiguous(source, f"what separates the cells of {shown!r}?", "separator", answers)


def _described(candidate: Candidate, line: str) -> str:
    values = _values(candidate, [line])
    assert isinstance(values, tuple)
    shown = " | ".join("" if value is None else str(value) for value in values[0])
    return f"the cells are {shown}"[:90]


def _no_split(
    tried: Sequence[Candidate],
    lines: Sequence[str],
    numbers: Sequence[int],
    names: str | None,
    source: str | Path,
    reading: Reading,
    least: int,
) -> FormatError:
    """Return the error of lines that no split fits: which rows have other numbers of cells."""
    said = f" separated by a {reading.separator}" if reading.separator else ""
    usable = [each for each in tried if each.columns > 1]
    if not usable and names is not None and lines:
        named = [(each, len(each.split.names(names))) for each in tried]
        usable = [
            replace(each, columns=count, ragged=len(lines))
            for each, count in named
            if count > 1 and each.split.separator != "blank"
        ]
    if not usable:
        msg = (
            f"{source}: expected a table of {max(least, 2)} or more columns{said}, got the line "
            f"{(names or (lines[0] if lines else ''))[:60]!r}, in which nothing separates cells"
        )
        return FormatError(msg)
    best = min(usable, key=lambda each: (each.ragged, not each.fits_names, -each.digits))
    mark = best.split.separator
    if best.ragged == 0 and best.columns < least:
        msg = (
            f"{source}: expected {least} columns or more, got {best.columns} (separated by {mark})"
        )
    elif best.ragged == 0:
        heads = best.split.names(names or "")
        msg = (
            f"{source}: its first line names {len(heads)} columns and each of its rows has "
            f"{best.columns} cells (separated by {mark}); expected as many names as cells"
        )
        if mark == "comma":
            msg += "; decimal commas in a table separated by commas must be quoted"
    else:
        msg = f"{source}: {ragged_rows(best, lines, numbers)}"
    return FormatError(msg)


def ragged_rows(candidate: Candidate, lines: Sequence[str], numbers: Sequence[int]) -> str:
    """Return which lines have other numbers of cells than most."""
    split = candidate.split
    wrong = [
        f"line {number} has {len(cells)}"
        for number, line in zip(numbers, lines, strict=True)
        for cells in [split.cells(line)]
        if len(cells) < candidate.columns or any(cells[candidate.columns :])
    ]
    return (
        f"expected {candidate.columns} cells (separated by {split.separator}) on every line, "
        f"{first_ten(wrong, ', ')}"
    )
