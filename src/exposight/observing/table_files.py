"""Files of observation tables: CSV in any dialect, or Parquet, as a frame with the known columns.

A CSV file as exposight writes it is parsed at once. Any other goes through the reader of dialects:
columns are found by their names and converted to the known ones, and what was recognised is said.
"""

from __future__ import annotations

import contextlib
import io
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import polars as pl
from numpy.typing import NDArray

from exposight.errors import FormatError
from exposight.files import (
    UNITS_MS,
    Matched,
    TextTable,
    Wanted,
    ambiguous,
    current_reading,
    match_columns,
    parse_apart,
    parse_table,
    parsing,
    recognised,
    remarks_on,
    unguarded,
    without_guards,
)
from exposight.files.text_tables.column_units import Quantity
from exposight.files.text_tables.written_numbers import stand_ins
from exposight.observing.schema import REQUIRED, SCHEMA

TEXT_SUFFIXES = (".csv", ".txt", ".tsv")
"""File suffixes of tables as text."""

_PARQUET_PARSER = Path(__file__).with_name("parquet_parser.py")

WRONG_SUFFIX = "{}: an observation table ends in .csv or .parquet, got '{}'"

_ALIASES: Mapping[str, tuple[str, ...]] = {
    "feature": ("feature name", "feature id"),
    "view": ("viewpoint", "view name", "view id"),
    "exposure_ms": ("t_exp", "exposure time", "integration time"),
    "p_norm": ("quality", "point share", "points normalised"),
    "i_avg": ("intensity", "brightness", "mean grey", "mean gray", "grey value", "gray value"),
    "x_mm": ("pos x", "x pos", "position x"),
    "y_mm": ("pos y", "y pos", "position y"),
    "z_mm": ("pos z", "z pos", "position z"),
    "radius_mm": ("feature radius", "hole radius"),
}
"""Other names that mean one thing only in this field."""

_QUANTITIES: Mapping[str, Quantity] = {"mm": "length", "ms": "time", "deg": "angle"}

_TURNS = ("w_deg", "p_deg", "r_deg")
_PLACES = ("x_mm", "y_mm", "z_mm")

_MEASURED = ("exposure_ms", *_PLACES, *_TURNS, "radius_mm")
"""Columns of numbers without bounds that tell a mark such as 9999 from a value."""

_EXPOSURES_MS = (0.2, 2500.0)
"""Exposure times that structured light takes, by which a unit is plausible."""
_NEAR_MM = 5.0
"""A cell's positions reach farther from the TCP than this."""

_TRUTHS = {"true": True, "1": True, "wahr": True, "yes": True}
_TRUTHS |= {"false": False, "0": False, "falsch": False, "no": False}

_EMPTY_AS_WORDS = tuple(
    name
    for name, dtype in SCHEMA.items()
    if dtype.is_float() and (name not in REQUIRED or name in {"p_norm", "i_avg"})
    if name != "incidence_deg"  # NaN where the table has none
)
"""Columns of numbers that may be without a value: NaN is one."""


def frame_in(data: bytes, path: Path, required: Sequence[str] = REQUIRED) -> pl.DataFrame:
    """Return the frame in a table's bytes, known columns under their names and in their units.

    Parameters
    ----------
    data : bytes
        The file's content. No function of polars takes the path: to it a name is a pattern.
    path : Path
        Its suffix tells the format, and messages name it.
    required : sequence of str
        Columns that it must have.

    Raises
    ------
    FormatError
        If it cannot be parsed, lacks a column, or has one in a strange unit or with other values.
    AmbiguousError
        If two readings of its numbers, or of a unit, fit equally well.
    """
    suffix = path.suffix.lower()
    if suffix == ".parquet":
        what = "observation table in Parquet"
        found = parse_apart(_PARQUET_PARSER, data, source=path, what=what)
        return pl.read_ipc_stream(io.BytesIO(found["arrow"].tobytes()))
    if suffix not in TEXT_SUFFIXES:
        raise FormatError(WRONG_SUFFIX.format(path, suffix))
    with parsing(path, "observation table"):
        return _frame_in_text(data, path, required)


def _frame_in_text(data: bytes, path: Path, required: Sequence[str]) -> pl.DataFrame:
    frame = _own_form(data, required)
    if frame is None:
        return _dialect(data, path, required)
    _refuse_stand_ins(
        path,
        {n: frame[n].to_numpy() for n in _MEASURED if n in frame and frame[n].dtype.is_float()},
    )
    return frame


def parse_csv(csv: bytes) -> pl.DataFrame:
    """Return the frame in the bytes of a CSV file as exposight writes it."""
    # Without the types a feature called 007 would become 7. Only columns that are there are named:
    # releases of polars give types of absent ones to others by position.
    present = pl.read_csv(csv, n_rows=0, infer_schema=False).columns
    text = {name: pl.String for name in present if SCHEMA.get(name) == pl.String}
    frame = pl.read_csv(csv, infer_schema_length=None, schema_overrides=text)
    # In names, unlike in cells, polars leaves the quotation marks doubled.
    frame = frame.rename({name: name.replace('""', '"') for name in present if '""' in name})
    return without_guards(frame) if b"'" in csv else frame


def _own_form(data: bytes, required: Sequence[str]) -> pl.DataFrame | None:
    """Return the frame of a file in exposight's own form, or None."""
    first = data.removeprefix(b"\xef\xbb\xbf").split(b"\n", 1)[0].strip()
    names = first.decode(errors="replace").replace('"', "").split(",")
    reading = current_reading()
    settled = reading.separator or reading.decimal or reading.encoding
    if settled or not set(required) <= set(names) or names[0] not in {*SCHEMA, *required}:
        return None
    lines = data.rstrip(b"\r\n").count(b"\n") + 1
    if b'"' not in data and data.count(b",") != lines * (len(names) - 1):
        return None
    try:
        frame = parse_csv(data)
    except pl.exceptions.PolarsError:
        return None
    for name, dtype in frame.schema.items():
        number = name in required or (name in SCHEMA and SCHEMA[name].is_numeric())
        written = number and SCHEMA.get(name) != pl.String and dtype == pl.String
        if written and frame[name].null_count() < frame.height:
            return None
    empty = [n for n in _EMPTY_AS_WORDS if n in frame.columns and frame.schema[n].is_float()]
    return frame.with_columns(pl.col(empty).fill_nan(None)) if empty else frame


def _dialect(data: bytes, path: Path, required: Sequence[str]) -> pl.DataFrame:
    """Return the frame of a file in any dialect."""
    reading = current_reading()
    table = parse_table(data, path, what="observation table", reading=reading)
    listed = {"name", "kind", "radius_mm"} <= set(table.header)  # which another message tells
    wanted = _wanted(table.header, () if listed else required)
    matched = match_columns(table.header, wanted, path, reading)
    numbers = _numbers(table, matched)
    _refuse_stand_ins(path, {n: numbers[n] for n in _MEASURED if n in numbers}, table.lines)
    for names in (("exposure_ms",), _PLACES, _TURNS):
        _ask_units(path, matched, numbers, names)
    columns: dict[str, pl.Series] = {}
    by_place = {each.index: name for name, each in matched.items()}
    for place, header in enumerate(table.header):
        name = by_place.get(place, unguarded(header))
        if name in columns:
            msg = f"{path}: two columns are called {name!r}: name one of them differently"
            raise FormatError(msg)
        if name in numbers:
            column = pl.Series(name, numbers[name] * matched[name].factor)
            columns[name] = column if name == "incidence_deg" else column.fill_nan(None)
        else:
            columns[name] = _column(table, place, name)
    recognised(path, *table.remarks, *remarks_on(matched))
    return pl.DataFrame(list(columns.values()))


def _refuse_stand_ins(
    path: Path, numbers: Mapping[str, NDArray[np.float64]], lines: Sequence[int] | None = None
) -> None:
    """Refuse numbers such as -999 that stand for a value that is not there."""
    found = [
        (int(row) + 2 if lines is None else lines[row], name, float(values[row]))
        for name, values in numbers.items()
        for row in np.flatnonzero(stand_ins(values))
    ]
    if found:
        found.sort()
        shown = ", ".join(f"line {line}, {name}: {value:g}" for line, name, value in found[:10])
        more = f" and {len(found) - 10} more" if len(found) > 10 else ""
        msg = (
            f"{path}: numbers that seem to stand for missing values, {shown}{more}: leave these "
            "rows out"
        )
        raise FormatError(msg)


def _wanted(header: Sequence[str], required: Sequence[str]) -> list[Wanted]:
    """Return the known columns, and others that are required, with the names they may have."""
    plain = {name.strip().lower() for name in header}
    turns = {"w", "p"} <= {name.split("[")[0].split("(")[0].strip() for name in plain}
    wanted = []
    for name in dict.fromkeys((*SCHEMA, *required)):
        dtype = SCHEMA.get(name, pl.Float64())
        quantity: Quantity = _QUANTITIES.get(name.rpartition("_")[2], "none")
        if name.endswith("_share") or name == "p_norm":
            quantity = "share"
        if dtype == pl.String:
            quantity = "text"
        aliases = _ALIASES.get(name, ())
        wanted.append(
            Wanted(
                name=name,
                aliases=aliases,
                quantity=quantity,
                required=name in required,
                # p may be p_norm and r a radius, unless they stand beside w.
                bare=turns or name not in _TURNS,
            )
        )
    return wanted


def _numbers(table: TextTable, matched: Mapping[str, Matched]) -> dict[str, NDArray[np.float64]]:
    """Return the known columns of numbers as they stand there; refuse other cells all at once."""
    names = [name for name in matched if SCHEMA.get(name, pl.Float64()).is_numeric()]
    values = table.numbers(*(matched[name].index for name in names)).reshape(len(table), -1)
    return dict(zip(names, values.T, strict=True))


def _column(table: TextTable, place: int, name: str) -> pl.Series:
    """Return a column of texts or truth values, or a further one as its cells seem to be."""
    cells = list(map(unguarded, table.texts(place)))
    dtype = SCHEMA.get(name)
    if dtype == pl.Boolean or (dtype is None and _are_truths(cells)):
        truths = [_TRUTHS.get(cell.lower()) if cell else None for cell in cells]
        wrong = [cell for cell, truth in zip(cells, truths, strict=True) if cell and truth is None]
        if wrong:
            msg = f"{table.source}: column {name!r} needs true or false, got {wrong[0]!r}"
            raise FormatError(msg)
        return pl.Series(name, truths, dtype=pl.Boolean)
    if dtype is None:
        with contextlib.suppress(FormatError):
            numbers = table.numbers(place)
            whole = all(cell.lstrip("+-").isdigit() for cell in cells if cell)
            column = pl.Series(name, numbers).fill_nan(None)
            return column.cast(pl.Int64) if whole and _fits_integers(numbers) else column
    return pl.Series(name, [cell or None for cell in cells], dtype=pl.String)


def _are_truths(cells: Sequence[str]) -> bool:
    return any(cells) and all(cell.lower() in {"true", "false"} for cell in cells if cell)


def _fits_integers(numbers: NDArray[np.float64]) -> bool:
    return bool((np.abs(numbers[np.isfinite(numbers)]) < 2**53).all())


def _ask_units(
    path: Path,
    matched: Mapping[str, Matched],
    numbers: Mapping[str, NDArray[np.float64]],
    names: Sequence[str],
) -> None:
    """Ask for the unit of columns that do not tell it, where their values fit another as well."""
    assumed = [name for name in names if name in matched and matched[name].assumed]
    values = np.abs(np.concatenate([numbers[name] for name in assumed] or [np.zeros(0)]))
    values = values[np.isfinite(values) & (values > 0.0)]
    if not values.size:
        return
    low, high = float(values.min()), float(values.max())
    headers = ", ".join(repr(matched[name].header) for name in assumed)
    if names == _PLACES and high < _NEAR_MM:
        question = f"are {headers}, of {high:.3g} at most, in mm or in m?"
        answers = {"mm": "all are near the TCP", "m": f"up to {1000 * high:.0f} mm"}
        raise ambiguous(path, question, "unit", answers)
    if names == _TURNS and high <= np.pi:
        question = f"are {headers}, of {high:.3g} at most, in degrees or radians?"
        answers = {"deg": "nearly square", "rad": f"up to {np.degrees(high):.0f}°"}
        raise ambiguous(path, question, "angle", answers)
    if names == ("exposure_ms",):
        shortest, longest = _EXPOSURES_MS
        fitting = [u for u, f in UNITS_MS.items() if shortest <= low * f and high * f <= longest]
        if fitting != ["ms"]:
            units = dict.fromkeys(("ms", *(fitting or UNITS_MS)))
            answers = {unit: f"{low:g} to {high:g} {unit}" for unit in units}
            question = f"which unit has {headers}, from {low:g} to {high:g}?"
            raise ambiguous(path, question, "exposure", answers)
