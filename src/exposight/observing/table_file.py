"""Reading tables: observations to learn from, and what a model is asked about."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import polars as pl

from exposight.errors import FormatError, MissingFileError, ObservationError
from exposight.observing.schema import SCHEMA, cast_known, check_columns_present
from exposight.observing.table import ObservationTable, wrong_suffix

if TYPE_CHECKING:
    from collections.abc import Sequence


def read_observations(path: str | Path) -> ObservationTable:
    """Read and check an observation table.

    Columns up to ``radius_mm`` must be there; the other known ones may be missing, and further
    ones are kept (`ObservationTable.from_frame`).

    Parameters
    ----------
    path : path
        CSV or Parquet.

    Raises
    ------
    MissingFileError
        If there is no such file.
    FormatError
        If it cannot be parsed, has another header or unit, or a column has the wrong type.
    ObservationError
        If a value is out of its range.
    """
    path = Path(path)
    _check_file(path, "observation table")
    try:
        return ObservationTable.from_frame(_read_frame(path))
    except (FormatError, ObservationError) as error:
        text = str(error)
        raise type(error)(text if text.startswith(str(path)) else f"{path}: {text}") from error


def read_inputs(path: str | Path, columns: Sequence[str]) -> pl.DataFrame:
    """Read a table of what a model is asked about, which need hold nothing else.

    Parameters
    ----------
    path : path
        CSV or Parquet: an observation table, or any table with these columns.
    columns : sequence of str
        The model's inputs, with their units in their names.

    Returns
    -------
    polars.DataFrame
        The columns, and of ``feature``, ``view``, ``exposure_ms`` and ``p_norm`` what there is;
        what there is not is null.

    Raises
    ------
    MissingFileError
        If there is no such file.
    FormatError
        If it cannot be parsed, lacks a column or has it in another unit, or it is not a number.
    """
    path = Path(path)
    _check_file(path, "table")
    frame = _read_frame(path)
    wanted = tuple(dict.fromkeys(("feature", "view", "exposure_ms", *columns, "p_norm")))
    present = [name for name in wanted if name in frame.columns]
    try:
        check_columns_present(frame.columns, columns)
        known = cast_known(frame, [name for name in present if name in SCHEMA])
    except FormatError as error:
        msg = f"{path}: {error}"
        raise FormatError(msg) from error
    further = frame.select(name for name in present if name not in SCHEMA)
    missing = (pl.lit(None, SCHEMA[name]).alias(name) for name in wanted if name not in present)
    return known.with_columns(further).with_columns(missing).select(*wanted)


def _check_file(path: Path, what: str) -> None:
    """Check that there is a file, and say what a folder of that name may be."""
    if path.is_file():
        return
    if (path / "campaign.json").is_file():
        msg = f"{path}: a campaign's folder, no {what}; `exposight observe` makes a table of it"
        raise FormatError(msg)
    if path.is_dir():
        msg = f"{path}: a folder; expected the file of the {what}, .csv or .parquet"
        raise FormatError(msg)
    msg = f"{path}: no such {what}"
    raise MissingFileError(msg)


def _read_frame(path: Path) -> pl.DataFrame:
    try:
        match path.suffix.lower():
            case ".csv":
                _check_separator(path)
                text = {name: dtype for name, dtype in SCHEMA.items() if dtype == pl.String}
                # Without the types a feature called 007 would become 7.
                return pl.read_csv(path, infer_schema_length=None, schema_overrides=text)
            case ".parquet":
                return pl.read_parquet(path)
            case suffix:
                raise FormatError(wrong_suffix(path, suffix))
    except (pl.exceptions.PolarsError, OSError) as error:
        msg = f"{path}: not a readable observation table ({str(error).splitlines()[0]})"
        raise FormatError(msg) from error


def _check_separator(path: Path) -> None:
    with path.open(encoding="utf-8", errors="replace") as file:
        header = file.readline()
    separator = next((mark for mark in (";", "\t") if mark in header), None)
    if separator is not None and "," not in header:
        name = "tabs" if separator == "\t" else f"'{separator}'"
        msg = (
            f"{path}: its columns are separated by {name}, commas are expected (and a point as "
            "decimal separator); export the table so again"
        )
        raise FormatError(msg)
