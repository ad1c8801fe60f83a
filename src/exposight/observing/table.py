"""The observation table: one row for each feature and capture, checked when read.

Columns, their units and order are in ``docs/formats.md``; units stand in the names. A row whose
feature could not be measured says why in ``visibility`` and has no p_norm.
"""

from __future__ import annotations

import io
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import polars as pl

from exposight.errors import FormatError, MissingFileError, ObservationError
from exposight.files.durable import write_durably
from exposight.observing.columns import (
    cast,
    check_header,
    check_values,
    check_whole,
    missing_column,
)
from exposight.observing.masks import Visibility
from exposight.observing.observation import REQUIRED, SCHEMA, Observation

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

_TEXT = {name: dtype for name, dtype in SCHEMA.items() if dtype == pl.String}


@dataclass(frozen=True, kw_only=True, eq=False)
class ObservationTable:
    """Observations as a polars frame with the columns of `Observation`.

    Parameters
    ----------
    frame : polars.DataFrame
        Has `SCHEMA`.
    """

    frame: pl.DataFrame

    def __post_init__(self) -> None:
        if self.frame.schema != SCHEMA:
            msg = (
                f"an observation table must have the columns {', '.join(SCHEMA)}, "
                f"got {', '.join(self.frame.columns)}"
            )
            raise ObservationError(msg)

    @classmethod
    def from_observations(cls, observations: Sequence[Observation]) -> ObservationTable:
        """Build a table from single observations."""
        columns = {name: [getattr(row, name) for row in observations] for name in SCHEMA}
        return cls(frame=pl.DataFrame(columns, schema=SCHEMA))

    def __len__(self) -> int:
        return self.frame.height

    def measured(self) -> ObservationTable:
        """Return the rows whose feature was visible and measured."""
        visible = pl.col("visibility") == Visibility.VISIBLE.value
        return ObservationTable(frame=self.frame.filter(visible & pl.col("p_norm").is_not_null()))

    def with_quality(self, p_norm_min: float) -> ObservationTable:
        """Return the rows with p_norm ≥ `p_norm_min` (Sect. 3.4.1 keeps those ≥ 0.75)."""
        return ObservationTable(frame=self.frame.filter(pl.col("p_norm") >= p_norm_min))

    def where(self, mask: NDArray[np.bool_]) -> ObservationTable:
        """Return the rows where `mask`, (n,) bool, is true."""
        return ObservationTable(frame=self.frame.filter(pl.Series(mask)))

    def array(self, columns: Sequence[str]) -> NDArray[np.float64]:
        """Return numeric columns as an array.

        Parameters
        ----------
        columns : sequence of str
            Names, for instance ``("i_avg", "x_mm")``.

        Returns
        -------
        (n, len(columns)) ndarray
            In the columns' units; NaN where a row has no value.

        Raises
        ------
        ObservationError
            If a column is unknown or not a number.
        """
        numeric = [name for name, dtype in SCHEMA.items() if dtype.is_numeric()]
        for name in columns:
            if name not in numeric:
                msg = f"no numeric column '{name}' in an observation table; it has {numeric}"
                raise ObservationError(msg)
        selected = self.frame.select(pl.col(list(columns)).cast(pl.Float64).fill_null(np.nan))
        return np.asarray(selected.to_numpy(), dtype=np.float64).reshape(-1, len(columns))

    def names(self, column: str) -> NDArray[np.object_]:
        """Return a text column, ``feature`` or ``view``, as an (n,) array."""
        return np.asarray(self.frame[column].to_numpy(), dtype=object)

    def counts(self) -> dict[str, int]:
        """Return how many rows there are of each visibility, the commonest first."""
        counted = self.frame["visibility"].value_counts(sort=True)
        return dict(counted.iter_rows())

    def write(self, path: str | Path) -> None:
        """Write the table durably as CSV or, by the suffix ``.parquet``, as Parquet.

        Raises
        ------
        FormatError
            If the suffix is another one.
        """
        path = Path(path)
        buffer = io.BytesIO()
        match path.suffix.lower():
            case ".csv":
                self.frame.write_csv(buffer)
            case ".parquet":
                self.frame.write_parquet(buffer)
            case suffix:
                raise FormatError(_wrong_suffix(path, suffix))
        write_durably(path, buffer.getvalue())


def read_observations(path: str | Path) -> ObservationTable:
    """Read and check an observation table.

    Columns up to ``radius_mm`` must be there; missing later ones are filled with nothing, so that
    a table made elsewhere, like the paper's supplementary one, can be brought.

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
    frame = _read_frame(path)
    check_header(path, frame.columns, required=REQUIRED, closed=True)
    frame = frame.with_columns(missing_column(name) for name in SCHEMA if name not in frame.columns)
    check_whole(path, frame)
    frame = cast(path, frame, tuple(SCHEMA))
    check_values(path, frame)
    return ObservationTable(frame=frame)


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
    check_header(path, frame.columns, required=columns, closed=False)
    wanted = dict.fromkeys(("feature", "view", "exposure_ms", *columns, "p_norm"))
    there = [name for name in wanted if name in frame.columns]
    known = cast(path, frame, there)
    missing = (pl.lit(None, SCHEMA[name]).alias(name) for name in wanted if name not in there)
    return known.with_columns(missing).select(*wanted)


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
                # Without the types a feature called 007 would become 7.
                return pl.read_csv(path, infer_schema_length=None, schema_overrides=_TEXT)
            case ".parquet":
                return pl.read_parquet(path)
            case suffix:
                raise FormatError(_wrong_suffix(path, suffix))
    except (pl.exceptions.PolarsError, OSError) as error:
        msg = f"{path}: not a readable observation table ({str(error).splitlines()[0]})"
        raise FormatError(msg) from error


def _check_separator(path: Path) -> None:
    with path.open(encoding="utf-8", errors="replace") as file:
        header = file.readline()
    separator = next((own for own in (";", "\t") if own in header), None)
    if separator is not None and "," not in header:
        found = "tabs" if separator == "\t" else f"'{separator}'"
        msg = (
            f"{path}: its columns are separated by {found}, commas are expected (and a point as "
            "decimal separator); export the table so again"
        )
        raise FormatError(msg)


def _wrong_suffix(path: Path, suffix: str) -> str:
    return f"{path}: an observation table ends in .csv or .parquet, got '{suffix}'"
