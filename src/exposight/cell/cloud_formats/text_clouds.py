"""Points in text files: .xyz, .txt, .csv, .asc and .pts in any dialect.

Columns go by their names where there is a line of names, else the first three are x, y and z.
Columns of rows and columns of the image make the cloud organised. Large files are recognised by a
sample of their lines and then parsed as a whole; what does not fit is read again line by line, for
the lines that are wrong.
"""

import contextlib
import re
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from exposight.errors import CloudError, FormatError
from exposight.files import (
    UNITS_MM,
    Matched,
    Reading,
    TextTable,
    Wanted,
    current_reading,
    match_columns,
    parse_table,
    recognised,
    remarks_on,
)
from exposight.files.text_tables.text_samples import SampledTable, SampleError, sample_table

Floats = NDArray[np.float64]

TEXT_SUFFIXES = (".xyz", ".txt", ".csv", ".asc", ".pts")
"""File suffixes of clouds as text."""

_AXES = tuple(
    Wanted(
        name=f"{axis}_mm",
        aliases=(
            *(axis, f"pos {axis}", f"position {axis}", f"{axis} pos", f"coord {axis}"),
            *(f"{axis} coordinate", f"{axis} coord", f"point {axis}", f"points:{k}"),
        ),
        quantity="length",
    )
    for k, axis in enumerate("xyz")
)
_PIXELS = (
    Wanted(
        name="row", aliases=("rows", "v", "pixel row", "zeile"), quantity="count", required=False
    ),
    Wanted(
        name="column",
        aliases=("col", "cols", "u", "pixel column", "spalte"),
        quantity="count",
        required=False,
    ),
)
_HEAD = 4096
_UNIT_COMMENT = re.compile(
    r"^\W*(?:#|//|%)[ \t]*(?:length )?units?[ \t]*[:=][ \t]*[\[(\"]?(mm|cm|m|in|inch)\b",
    re.IGNORECASE | re.MULTILINE,
)

_MOST_PIXELS = 2**28
"""Pixels of an image beyond which rows and columns are taken for something else."""

_STARTED = 4096
"""Rows at the start that tell whether columns without names may count points or pixels."""

_COUNTED = 3
"""Points from which a first column that counts them cannot be chance."""


_Columns = TextTable | SampledTable


def points_from_text(
    data: bytes, path: Path, *, size: tuple[int, int] | None = None, unit: str = "mm"
) -> NDArray[np.float32]:
    """Return the points of a text file.

    Parameters
    ----------
    data : bytes
        Its content.
    path : Path
        For messages.
    size : (int, int), optional
        Rows and columns of the image, for files that name those of each point.
    unit : {'mm', 'cm', 'm'}
        Unit of coordinates whose names do not tell it.

    Returns
    -------
    (n, 3) or (rows, columns, 3) ndarray, mm
        NaN where a point is missing.

    Raises
    ------
    FormatError
        If it is no table of numbers, x, y or z is missing, or lines have other numbers of cells.
    AmbiguousError
        If two readings of its numbers fit equally well.
    CloudError
        If its header tells another unit than `unit`, or two points are at one pixel.
    """
    told = _told_unit(data)
    if told is not None and unit not in {"mm", told}:
        msg = f"a comment says that its unit is {told}, so it cannot be {unit}"
        raise CloudError(msg)
    reading = current_reading(Reading(unit=told if unit == "mm" else unit))
    sampled = sample_table(data, path, reading, least=3, what="point cloud")
    points = None
    if sampled is not None:
        with contextlib.suppress(SampleError):
            points, said = _points(sampled, path, reading, size, unit)
    if points is None:
        table = parse_table(data, path, what="point cloud", reading=reading, header=None, least=3)
        points, said = _points(table, path, reading, size, unit)
    recognised(path, *said, *([] if told in {None, "mm"} else [f"in {told}, as a comment says"]))
    with np.errstate(over="ignore"):  # beyond float32 becomes infinite, and so missing
        return points.astype(np.float32)


def _told_unit(data: bytes) -> str | None:
    """Return the unit that a comment at a file's start tells: ``# unit: mm``."""
    head = data[:_HEAD].replace(b"\0", b"").decode("latin-1")
    found = _UNIT_COMMENT.search(head)
    return None if found is None else {"in": "inch"}.get(found[1].lower(), found[1].lower())


def _points(
    lines: _Columns, path: Path, reading: Reading, size: tuple[int, int] | None, unit: str
) -> tuple[Floats, list[str]]:
    """Return points, mm, and what was recognised of their columns."""
    said = [remark for remark in lines.remarks if not remark.startswith("blanks between")]
    if not lines.header:
        places, more = _unnamed(lines, path)
        points = lines.numbers(*places).reshape(-1, 3) * UNITS_MM[reading.unit or "mm"]
        return points, [*said, *more]
    points, columns = _named(lines, path, reading, unit)
    said += remarks_on({axis.name: columns[axis.name] for axis in _AXES})
    pixels, more = _pixels(lines, columns, points, path)
    if pixels is not None:
        points = _organised(points, pixels, size)
    return points, [*said, *more]


def _named(
    lines: _Columns, path: Path, reading: Reading, unit: str
) -> tuple[Floats, Mapping[str, Matched]]:
    """Return the points, mm, in the columns that are named x, y and z, and these columns."""
    columns = match_columns(lines.header, (*_AXES, *_PIXELS), path, reading)
    axes = [columns[axis.name] for axis in _AXES]
    told = {axis.unit for axis in axes if not axis.assumed and axis.unit is not None}
    if unit != "mm" and told != {unit}:
        names = ", ".join(repr(axis.header) for axis in axes)
        msg = f"its columns {names} are in {', '.join(sorted(told))}, so the unit cannot be {unit}"
        raise CloudError(msg)
    points = lines.numbers(*(axis.index for axis in axes))
    return points * [axis.factor for axis in axes], columns


def _unnamed(lines: _Columns, path: Path) -> tuple[tuple[int, int, int], list[str]]:
    """Return which of columns without names are x, y and z, and what to say of it."""
    if lines.columns == 3:
        return (0, 1, 2), []
    start = lines.numbers(0, rows=_STARTED).ravel()
    counting = [base for base in (0, 1) if _counts(start, base) and _counts(lines.numbers(0), base)]
    if counting and len(start) >= _COUNTED:
        return (1, 2, 3), ["the first column counts the points, the next three are x y z"]
    if lines.columns >= 5 and _is_raster(lines.numbers(0, 1, rows=_STARTED)):
        msg = (
            f"{path}: the first two of its {lines.columns} columns seem to be rows and columns of "
            "the image; name the columns in a first line, such as 'row col x y z', or 'x y z …' if "
            "they are coordinates"
        )
        raise FormatError(msg)
    if _follow(lines.numbers(*range(min(lines.columns, 6)), rows=_STARTED)):
        msg = (
            f"{path}: the first of its {lines.columns} columns without names seem to be grey "
            "levels, colours or normals, with x y z after them; name the columns in a first line, "
            "such as 'intensity x y z', or 'x y z …' if they are coordinates"
        )
        raise FormatError(msg)
    return (0, 1, 2), [f"the first three of {lines.columns} columns without names are x y z"]


def _counts(numbers: Floats, base: int) -> bool:
    return np.array_equal(numbers.ravel(), np.arange(numbers.size) + base)


def _follow(start: Floats) -> bool:
    """Return whether columns without names seem to be grey levels, colours or normals, then x y z.

    Those are whole numbers, within 0 to 1, or of length 1, which coordinates after them are not.
    """
    start = start[np.isfinite(start).all(axis=1)]
    if len(start) < _COUNTED:
        return False

    def is_grey(values: Floats) -> bool:
        whole = (values == np.floor(values)).all() and values.max() < 2**16
        return bool(values.min() >= 0.0 and (whole or values.max() <= 1.0) and np.ptp(values) > 0.0)

    def is_normal(vectors: Floats) -> bool:
        return bool((np.abs(np.linalg.norm(vectors, axis=1) - 1.0) < 0.01).all())

    if start.shape[1] >= 6:
        before, after = start[:, :3], start[:, 3:6]
        return (is_grey(before) or is_normal(before)) and not (is_grey(after) or is_normal(after))
    return start.shape[1] == 4 and is_grey(start[:, :1]) and not is_grey(start[:, 3:])


def _is_raster(pairs: Floats) -> bool:
    """Return whether pairs are whole numbers that run through the pixels of an image."""
    if len(pairs) < _COUNTED or not np.isfinite(pairs).all():
        return False
    if (pairs < 0).any() or (pairs != np.floor(pairs)).any():
        return False
    for slow, fast in (pairs.T, pairs.T[::-1]):
        onwards = (np.diff(slow) > 0) | ((np.diff(slow) == 0) & (np.diff(fast) > 0))
        if onwards.all() and (np.diff(slow) == 0).any():
            return True
    return False


def _pixels(
    lines: _Columns, columns: Mapping[str, Matched], points: Floats, path: Path
) -> tuple[NDArray[np.int64] | None, list[str]]:
    """Return the row and the column of each point, (n, 2), where the file names them."""
    names = [name.lower() for name in lines.header]
    found = [columns[name] for name in ("row", "column") if name in columns]
    if len(found) == 2:
        places = [each.index for each in found]
    elif not found and "i" in names and "j" in names and "k" not in names:
        places = [names.index("i"), names.index("j")]
    else:
        return None, []
    shown = " and ".join(repr(lines.header[place]) for place in places)
    values = lines.numbers(*places)
    if (values != np.floor(values)).any() or (values < 0).any():
        if found and lines.header[places[0]].lower() not in {"u", "v"}:
            msg = f"{path}: {shown} must be rows and columns of the image, whole numbers from 0"
            raise FormatError(msg)
        return None, [f"{shown} are no pixels and are left out"]
    said = f"{shown} are rows and columns of the image"
    if not found:
        values, said = _by_direction(values, points, shown, path)
    if len(values) and (values.min(axis=0) == 1).all():
        values, said = values - 1, f"{said}, counted from 1"
    return values.astype(np.int64), [said]


def _by_direction(values: Floats, points: Floats, shown: str, path: Path) -> tuple[Floats, str]:
    """Return (row, column) of two numbers of which x tells which is the column.

    In the camera's frame x grows with the column and y with the row.
    """
    valid = np.isfinite(points).all(axis=1) & (points != 0).any(axis=1)
    likeness = np.zeros((2, 2))
    if valid.sum() > _COUNTED and (np.ptp(values[valid], axis=0) > 0).all():
        both = np.hstack([values, points[:, :2]])[valid]
        with np.errstate(invalid="ignore", divide="ignore"):
            likeness = np.abs(np.nan_to_num(np.corrcoef(both.T)[:2, 2:]))
    as_rows = min(likeness[0, 1], likeness[1, 0])
    as_columns = min(likeness[0, 0], likeness[1, 1])
    if max(as_rows, as_columns) < 0.8 or abs(as_rows - as_columns) < 0.4:
        msg = (
            f"{path}: {shown} may be row and column of the image or the reverse, x and y do not "
            "tell; name them row and col"
        )
        raise FormatError(msg)
    if as_rows > as_columns:
        return values, f"{shown} are rows and columns of the image, as y and x tell"
    return values[:, ::-1], f"{shown} are columns and rows of the image, as x and y tell"


def _organised(points: Floats, pixels: NDArray[np.int64], size: tuple[int, int] | None) -> Floats:
    """Return points at their rows and columns, NaN where there is none."""
    rows, columns = size or tuple(int(n) + 1 for n in pixels.max(axis=0, initial=-1))
    if rows * columns > _MOST_PIXELS or rows < 1 or columns < 1:
        msg = f"its rows and columns reach to {rows} and {columns}: expected those of an image"
        raise CloudError(msg)
    if (pixels >= (rows, columns)).any():
        row, column = pixels[(pixels >= (rows, columns)).any(axis=1)][0]
        msg = f"a point is at row {row}, column {column}, outside {rows} × {columns} pixels"
        raise CloudError(msg)
    there = np.isfinite(points).all(axis=1) & (points != 0.0).any(axis=1)
    points, pixels = points[there], pixels[there]
    places = pixels[:, 0] * columns + pixels[:, 1]
    taken, counts = np.unique(places, return_counts=True)
    if (counts > 1).any():
        row, column = divmod(int(taken[counts > 1][0]), columns)
        msg = (
            f"{int((counts > 1).sum())} pixels have several points, the first at row {row}, column "
            f"{column}; expected one point a pixel"
        )
        raise CloudError(msg)
    grid = np.full((rows * columns, 3), np.nan)
    grid[places] = points
    return grid.reshape(rows, columns, 3)
