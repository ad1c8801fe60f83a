"""The observation table: one row for each feature and capture, checked when read.

Columns, their units and order are in ``docs/formats.md``; units stand in the names. A row whose
feature could not be measured says why in ``visibility`` and has no p_norm.
"""

from __future__ import annotations

import io
import math
from dataclasses import dataclass, fields
from difflib import get_close_matches
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import polars as pl

from exposight.durable import write_durably
from exposight.errors import FormatError, MissingFileError, ObservationError
from exposight.observing.masks import Visibility

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray


@dataclass(frozen=True, kw_only=True, slots=True)
class Observation:
    """One feature in one capture: a row of the table.

    Parameters
    ----------
    feature, view : str
        Names.
    exposure_ms : float, ms
        Exposure time (the paper's t_exp).
    p_norm : float or None
        Share of the ring's pixels that gave a 3D point (Eq. 5); None where not measured.
    i_avg : float or None
        Mean grey value of the ring, 0–255.
    x_mm, y_mm, z_mm : float, mm
        Position in the TCP frame.
    w_deg, p_deg, r_deg : float, degrees
        Orientation in the TCP frame.
    radius_mm : float, mm
        The feature's radius.
    n_points, n_pixels : int or None
        Points in the hollow cylinder (Eq. 4) and pixels of its ring (Eq. 6).
    i_std, i_median, i_p05, i_p95 : float or None
        Spread of the ring's grey values, 0–255.
    clipped_share : float or None
        Share of the ring's pixels at full scale, 0–1.
    incidence_deg : float, degrees
        Angle between the camera's ray and the feature's normal.
    visibility : str
        "visible", or the reason why the feature was not measured (`Visibility`).
    emulated : bool
        True where the exposure was emulated from another one.
    """

    feature: str
    view: str
    exposure_ms: float
    p_norm: float | None
    i_avg: float | None
    x_mm: float
    y_mm: float
    z_mm: float
    w_deg: float
    p_deg: float
    r_deg: float
    radius_mm: float
    n_points: int | None = None
    n_pixels: int | None = None
    i_std: float | None = None
    i_median: float | None = None
    i_p05: float | None = None
    i_p95: float | None = None
    clipped_share: float | None = None
    incidence_deg: float = math.nan
    visibility: str = Visibility.VISIBLE.value
    emulated: bool = False


_TYPES: dict[str, type[pl.DataType]] = {
    "str": pl.String,
    "float": pl.Float64,
    "float | None": pl.Float64,
    "int | None": pl.Int64,
    "bool": pl.Boolean,
}
SCHEMA = pl.Schema({field.name: _TYPES[str(field.type)] for field in fields(Observation)})
"""Column names and types of an observation table."""

_REQUIRED = tuple(SCHEMA)[: tuple(SCHEMA).index("radius_mm") + 1]
_UNIT_SUFFIXES = ("_ms", "_mm", "_deg")
_TEXT = {name: dtype for name, dtype in SCHEMA.items() if dtype == pl.String}

_P_NORM_MAX = 10.0
"""A cloud denser than the image gives more than 1, but ten points a pixel are percent mistaken."""


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
    if not path.is_file():
        msg = f"{path}: no such observation table"
        raise MissingFileError(msg)
    frame = _read_frame(path)
    _check_header(path, frame.columns, required=_REQUIRED, closed=True)
    frame = frame.with_columns(
        _missing_column(name) for name in SCHEMA if name not in frame.columns
    )
    _check_whole(path, frame)
    try:
        frame = frame.select(pl.col(name).cast(dtype) for name, dtype in SCHEMA.items())
    except pl.exceptions.PolarsError as error:
        reason = str(error).splitlines()[0]
        msg = f"{path}: a column has values of the wrong type: {reason}"
        raise FormatError(msg) from error
    _check_values(path, frame)
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
    if not path.is_file():
        msg = f"{path}: no such table"
        raise MissingFileError(msg)
    frame = _read_frame(path)
    _check_header(path, frame.columns, required=columns, closed=False)
    wanted = dict.fromkeys(("feature", "view", "exposure_ms", *columns, "p_norm"))
    there = [name for name in wanted if name in frame.columns]
    try:
        known = frame.select(pl.col(name).cast(SCHEMA[name]) for name in there)
    except pl.exceptions.PolarsError as error:
        msg = f"{path}: a column has values of the wrong type: {str(error).splitlines()[0]}"
        raise FormatError(msg) from error
    missing = (pl.lit(None, SCHEMA[name]).alias(name) for name in wanted if name not in there)
    return known.with_columns(missing).select(*wanted)


def _read_frame(path: Path) -> pl.DataFrame:
    try:
        match path.suffix.lower():
            case ".csv":
                # Without the types a feature called 007 would become 7.
                return pl.read_csv(path, infer_schema_length=None, schema_overrides=_TEXT)
            case ".parquet":
                return pl.read_parquet(path)
            case suffix:
                raise FormatError(_wrong_suffix(path, suffix))
    except (pl.exceptions.PolarsError, OSError) as error:
        msg = f"{path}: not a readable observation table ({str(error).splitlines()[0]})"
        raise FormatError(msg) from error


def _wrong_suffix(path: Path, suffix: str) -> str:
    return f"{path}: an observation table ends in .csv or .parquet, got '{suffix}'"


def _check_header(
    path: Path, columns: Sequence[str], *, required: Sequence[str], closed: bool
) -> None:
    """Check that all required columns are there and, if closed, no unknown one."""
    missing = [name for name in required if name not in columns]
    unknown = [name for name in columns if name not in SCHEMA]
    for name in missing:
        stem = next((name.removesuffix(s) for s in _UNIT_SUFFIXES if name.endswith(s)), None)
        other = [u for u in unknown if stem and (u == stem or u.startswith(f"{stem}_"))]
        if other:
            msg = (
                f"{path}: column '{other[0]}' has another unit or none: expected '{name}'; "
                "convert the values and rename the column"
            )
            raise FormatError(msg)
    if missing and not closed:
        msg = f"{path}: missing columns {', '.join(missing)}; found {', '.join(columns)}"
        raise FormatError(msg)
    if closed and (missing or unknown):
        meant = [
            f"; did you mean {close[0]!r} by {name!r}?"
            for name in unknown
            if (close := get_close_matches(name, SCHEMA, n=1))
        ]
        msg = (
            f"{path}: wrong header: missing {missing or 'none'}, unknown {unknown or 'none'}; "
            f"expected {', '.join(SCHEMA)}, of which those after radius_mm may be left out"
            + "".join(meant)
        )
        raise FormatError(msg)


def _missing_column(name: str) -> pl.Expr:
    if name == "visibility":
        return pl.lit(Visibility.VISIBLE.value).alias(name)
    if name == "emulated":
        return pl.lit(False).alias(name)
    if name == "incidence_deg":
        return pl.lit(np.nan).alias(name)
    return pl.lit(None, dtype=SCHEMA[name]).alias(name)


def _check_whole(path: Path, frame: pl.DataFrame) -> None:
    """Refuse fractions in columns of whole numbers: casting would cut them off unseen."""
    for name, dtype in SCHEMA.items():
        if dtype.is_integer() and frame.schema[name].is_float():
            column = frame[name]
            _refuse(path, column, column != column.floor(), "whole numbers")


def _check_values(path: Path, frame: pl.DataFrame) -> None:
    for name in (*_REQUIRED, "visibility", "emulated"):
        if name not in {"p_norm", "i_avg"}:  # empty where a feature was not measured
            _refuse(path, frame[name], frame[name].is_null(), "a value in every row")
    for name, dtype in SCHEMA.items():
        if dtype.is_float() and name != "incidence_deg":  # NaN where the table has none
            _refuse(path, frame[name], ~frame[name].is_finite(), "finite numbers")
    _refuse(path, frame["exposure_ms"], frame["exposure_ms"] <= 0, "values above 0")
    _refuse(path, frame["radius_mm"], frame["radius_mm"] < 0, "values of at least 0")
    for name in ("i_avg", "i_median", "i_p05", "i_p95"):
        _refuse(path, frame[name], ~frame[name].is_between(0, 255), "grey levels 0–255")
    _refuse(
        path,
        frame["p_norm"],
        ~frame["p_norm"].is_between(0, _P_NORM_MAX),
        "a share, 0–1, of the ring's pixels (divide percent by 100)",
    )
    unlit = frame["p_norm"].is_not_null() & frame["i_avg"].is_null()
    _refuse(path, frame["i_avg"], unlit, "a value in every row that has a p_norm")
    reasons = [reason.value for reason in Visibility]
    unknown = ~frame["visibility"].is_in(reasons)
    _refuse(path, frame["visibility"], unknown, f"one of {', '.join(map(repr, reasons))}")


def _refuse(path: Path, column: pl.Series, bad: pl.Series, expected: str) -> None:
    """Refuse a column where `bad` is true; where it is null, there is no value to judge."""
    rows = np.flatnonzero(bad.fill_null(value=False).to_numpy())
    if rows.size == 0:
        return
    value = column[int(rows[0])]
    msg = (
        f"{path}: column '{column.name}' needs {expected}; row {rows[0] + 1} after the header "
        f"{'is empty' if value is None else f'has {value}'} ({rows.size} of {len(column)} rows "
        "are wrong)"
    )
    raise ObservationError(msg)
