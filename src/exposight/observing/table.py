"""The observation table: one row for each feature and capture, checked wherever it comes from.

Columns, their units and order are in ``docs/formats.md``; units stand in the names. A row whose
feature could not be measured says why in ``visibility`` and has no p_norm. Columns that are not
listed are kept, and models may read them.
"""

from __future__ import annotations

import dataclasses
import html
import io
from collections.abc import Sequence
from dataclasses import InitVar, dataclass
from pathlib import Path

import numpy as np
import polars as pl
from numpy.typing import NDArray

from exposight import errors
from exposight.contradictions import Contradiction, settle
from exposight.contradictions.observed_rows import row_contradictions
from exposight.files import csv_of, read_bytes, sha256_of, write_durably
from exposight.observing import schema
from exposight.observing.masks import Visibility
from exposight.observing.table_files import WRONG_SUFFIX, frame_in, parse_csv
from exposight.statistics import random_split, split_by_group
from exposight.tables import Column, Table, counted, number

_NEAR_MM = 5.0
"""A cell's positions reach farther from the TCP than this."""

_SHOWN = ("exposure_ms", "p_norm", "i_avg", "x_mm", "y_mm", "z_mm", "w_deg", "p_deg", "radius_mm")
"""Columns whose ranges a notebook shows."""


@dataclass(frozen=True, kw_only=True, eq=False)
class ObservationTable:
    """Observations as a polars frame.

    Parameters
    ----------
    frame : polars.DataFrame
        Has the columns of `SCHEMA`, then any further ones of numbers, texts or truth values.
        `from_frame` makes such a frame of one that leaves columns out.
    contradictions : tuple of Contradiction
        What did not agree in the captures that were observed; files do not keep it.
    sha256 : str, optional
        SHA-256 of the file's bytes that it was read from.
    checked : bool
        True for rows of a table that was checked before.

    Raises
    ------
    ObservationError
        If a column is missing or has another type, or a value is not possible.
    """

    frame: pl.DataFrame
    contradictions: tuple[Contradiction, ...] = ()
    sha256: str | None = None
    checked: InitVar[bool] = False

    def __post_init__(self, checked: bool) -> None:
        if not checked:
            schema.check_frame(self.frame)

    @classmethod
    def from_observations(cls, observations: Sequence[schema.Observation]) -> ObservationTable:
        """Build a table from single observations."""
        columns = {name: [getattr(row, name) for row in observations] for name in schema.SCHEMA}
        frame = pl.DataFrame(columns, schema=schema.SCHEMA)
        names = dict.fromkeys(name for row in observations for name in row.extra)
        extra = {name: [row.extra.get(name) for row in observations] for name in names}
        if extra:
            schema.check_names((*schema.SCHEMA, *extra))
            frame = frame.with_columns(pl.Series(name, extra[name]) for name in extra)
        return cls(frame=frame)

    @classmethod
    def from_frame(cls, frame: pl.DataFrame) -> ObservationTable:
        """Build a table from a frame that has at least the columns `REQUIRED`, in any order.

        Other known columns are filled with nothing where they are missing, so that a table made
        elsewhere, like the paper's supplementary one, can be brought. Unknown ones are kept.

        Raises
        ------
        FormatError
            If a column is missing, has another unit or the wrong type, or its name is nearly a
            known one's.
        ObservationError
            If a value is out of its range.
        """
        table = cls(frame=schema.complete(frame))
        schema.check_unrepeated(table.frame)
        return table

    @classmethod
    def concat(cls, tables: Sequence[ObservationTable]) -> ObservationTable:
        """Put tables one below the other; further columns are empty where a table has none.

        Raises
        ------
        ObservationError
            If a further column holds numbers in one table and text in another.
        """
        if not tables:
            return cls.from_observations([])
        frames = [table.frame for table in tables]
        for name in dict.fromkeys(name for table in tables for name in table.further_columns):
            types = {frame.schema[name] for frame in frames if name in frame.columns} - {pl.Null()}
            if len(types) > 1 and not all(dtype.is_numeric() for dtype in types):
                listed = ", ".join(map(str, types))
                msg = f"the tables' columns {name!r} do not fit together: {listed}"
                raise errors.ObservationError(msg)
        return cls(frame=pl.concat(frames, how="diagonal_relaxed"), checked=True)

    def __len__(self) -> int:
        return self.frame.height

    @property
    def further_columns(self) -> tuple[str, ...]:
        """Names of the columns beyond the known ones."""
        return tuple(self.frame.columns[len(schema.SCHEMA) :])

    def measured(self) -> ObservationTable:
        """Return the rows whose feature was visible and measured."""
        visible = self.frame["visibility"] == Visibility.VISIBLE.value
        return self.where(visible & self.frame["p_norm"].is_not_null())

    def with_quality(self, p_norm_min: float) -> ObservationTable:
        """Return the rows with p_norm ≥ `p_norm_min` (Sect. 3.4.1 keeps those ≥ 0.75)."""
        return self.where(self.frame["p_norm"] >= p_norm_min)

    def where(self, mask: NDArray[np.bool_] | pl.Series) -> ObservationTable:
        """Return the rows where `mask`, (n,) bool, is true."""
        return ObservationTable(frame=self.frame.filter(pl.Series(mask)), checked=True)

    def split(
        self, *, by: str = "feature", share: float = 0.8, seed: int = 1
    ) -> tuple[ObservationTable, ObservationTable]:
        """Split the table into one to train on and one to test on.

        By features, the test shows how good a model is for features it never saw; by views, for
        positions that it never saw. By rows, as in the paper, other exposure times of the same
        feature at the same view train, which flatters.

        Parameters
        ----------
        by : str
            What stays together: "feature", "view" or another column of names; "row" for nothing.
        share : float
            Of features, views or rows that train, between 0 and 1.
        seed : int
            Random seed of the draw.

        Raises
        ------
        InputError
            If the share is not between 0 and 1, or there is no such column.
        ObservationError
            If a side would be empty, or hold no measured observation.
        """
        if by != "row" and by not in self.frame.columns:
            known = ("row", *self.frame.columns)
            msg = f"no column {by!r} to split by{errors.did_you_mean(by, known)}"
            raise errors.InputError(msg)
        if len(self) == 0:
            msg = "the table has no rows, so there is nothing to split"
            raise errors.ObservationError(msg)
        rng = np.random.default_rng(seed)
        try:
            if by == "row":
                sides = random_split(len(self), share, rng)
            else:
                sides = split_by_group(self.names(by).astype(str), share, rng)
        except errors.ObservationError as error:
            groups = counted(len(self) if by == "row" else self.frame[by].n_unique(), by)
            msg = (
                f"a share of {share:g} of {groups} leaves no {by} to train or none to test; choose "
                "another share, or split by something else"
            )
            raise errors.ObservationError(msg) from error
        train, test = (
            ObservationTable(frame=self.frame[rows], checked=True)
            for rows in (sides.train, sides.test)
        )
        for side, table in (("train", train), ("test", test)):
            if len(table.measured()) == 0:
                msg = (
                    f"the rows to {side} hold no measured observation; choose another seed or share"
                )
                raise errors.ObservationError(msg)
        return train, test

    def array(self, columns: Sequence[str]) -> NDArray[np.float64]:
        """Return numeric columns as an array, (n, len(columns)); NaN where a row has no value.

        Raises
        ------
        ObservationError
            If a column is unknown or not a number.
        """
        numeric = [name for name, dtype in self.frame.schema.items() if dtype.is_numeric()]
        for name in columns:
            if name not in numeric:
                msg = (
                    f"no numeric column '{name}' in the observation table; it has {numeric}"
                    f"{errors.did_you_mean(name, numeric)}"
                )
                raise errors.ObservationError(msg)
        selected = self.frame.select(pl.col(list(columns)).cast(pl.Float64).fill_null(np.nan))
        return np.asarray(selected.to_numpy(), dtype=np.float64).reshape(-1, len(columns))

    def names(self, column: str) -> NDArray[np.object_]:
        """Return a text column, ``feature`` or ``view``, as an (n,) array."""
        return np.asarray(self.frame[column].to_numpy(), dtype=object)

    def counts(self) -> dict[str, int]:
        """Return how many rows there are of each visibility, the commonest first."""
        counted_rows = self.frame["visibility"].value_counts(sort=True)
        return dict(counted_rows.iter_rows())

    def remarks(self) -> tuple[str, ...]:
        """Say what of the table may not have been meant: positions in metres, repeated rows."""
        remarks = []
        measured = self.measured()
        if len(measured):
            farthest = float(np.abs(measured.array(("x_mm", "y_mm", "z_mm"))).max())
            if 0.0 < farthest < _NEAR_MM:
                remarks.append(
                    f"no x_mm, y_mm or z_mm is farther than {number(farthest, 3)} mm from 0: are "
                    "they in metres? positions are in mm, multiply by 1000 if so"
                )
        repeated = len(self) - self.frame.n_unique()
        if repeated:
            verb = "repeats" if repeated == 1 else "repeat"
            remarks.append(f"{counted(repeated, 'row')} of the table {verb} another one exactly")
        return tuple(remarks)

    def write(self, path: str | Path) -> str:
        """Write the table durably as CSV or, by the suffix ``.parquet``, as Parquet.

        Returns
        -------
        str
            SHA-256 of the file.

        Raises
        ------
        FormatError
            If the suffix is another one.
        """
        path = Path(path)
        match path.suffix.lower():
            case ".csv":
                data = csv_of(self.frame)
            case ".parquet":
                buffer = io.BytesIO()
                self.frame.write_parquet(buffer)
                data = buffer.getvalue()
            case suffix:
                raise errors.FormatError(WRONG_SUFFIX.format(path, suffix))
        write_durably(path, data)
        return sha256_of(data)

    def _repr_html_(self) -> str:
        measured = self.measured()
        counts = ", ".join(f"{count} {reason}" for reason, count in self.counts().items())
        further = ", ".join(self.further_columns) or "none"
        title = (
            f"{counted(len(self), 'observation')} of "
            f"{counted(self.frame['feature'].n_unique(), 'feature')} in "
            f"{counted(self.frame['view'].n_unique(), 'view')} ({counts or 'no rows'}); further "
            f"columns: {further}"
        )
        values = measured.array(_SHOWN)
        rows = [
            {"column": name, "least": min(column), "median": np.median(column), "most": max(column)}
            for name, column in zip(_SHOWN, values.T.tolist(), strict=True)
            if column
        ]
        columns = tuple(Column(name=name) for name in ("column", "least", "median", "most"))
        body = Table.of("observations", rows, columns)._repr_html_() if rows else ""
        return f"<p>{html.escape(title)}</p>{body}"


def read_observations(path: str | Path) -> ObservationTable:
    """Read and check an observation table, CSV or Parquet.

    Columns up to ``radius_mm`` must be there; the other known ones may be missing, and further
    ones are kept (`ObservationTable.from_frame`).

    Raises
    ------
    MissingFileError
        If there is no such file.
    FormatError
        If it cannot be parsed, has another header or unit, or a column has the wrong type.
    ObservationError
        If a value is out of its range.
    ContradictionError
        If rings have more points than pixels; what may be right is in ``contradictions``.
    """
    path = Path(path)
    data = _content(path, "observation table")
    try:
        table = ObservationTable.from_frame(frame_in(data, path))
        return dataclasses.replace(
            table,
            contradictions=settle(_row_contradictions(table.frame)),
            sha256=sha256_of(data),
            checked=True,
        )
    except errors.ContradictionError as error:
        msg = f"{path}: {error}"
        raise error.named(msg) from error
    except (errors.FormatError, errors.ObservationError) as error:
        text = str(error)
        raise type(error)(text if text.startswith(str(path)) else f"{path}: {text}") from error


def parse_observations(csv: bytes, source: str) -> ObservationTable:
    """Read the observations in the bytes of a CSV file, as `ObservationTable.write` makes it.

    Raises
    ------
    FormatError, ObservationError
        As `read_observations`; the message names `source`.
    """
    try:
        return ObservationTable.from_frame(parse_csv(csv))
    except (errors.FormatError, errors.ObservationError, pl.exceptions.PolarsError) as error:
        kind = type(error) if isinstance(error, errors.ExposightError) else errors.FormatError
        msg = f"{source}: {str(error).splitlines()[0]}"
        raise kind(msg) from error


def read_inputs(
    path: str | Path, columns: Sequence[str], optional: Sequence[str] = ()
) -> pl.DataFrame:
    """Read a table of what a model is asked about, which need hold nothing else.

    Parameters
    ----------
    path : path
        CSV or Parquet: an observation table, or any table with these columns.
    columns : sequence of str
        The model's inputs, with their units in their names.
    optional : sequence of str
        Columns that it reads where they are there.

    Returns
    -------
    polars.DataFrame
        The columns, and of ``feature``, ``view``, ``exposure_ms``, ``p_norm`` and `optional` what
        there is; what there is not is null.

    Raises
    ------
    MissingFileError
        If there is no such file.
    FormatError
        If it cannot be parsed, lacks a column or has it in another unit, or it is not a number.
    """
    path = Path(path)
    frame = frame_in(_content(path, "table"), path, columns)
    wanted = tuple(dict.fromkeys(("feature", "view", "exposure_ms", *columns, "p_norm", *optional)))
    present = [name for name in wanted if name in frame.columns]
    try:
        schema.check_columns_present(frame.columns, columns)
        known = schema.cast_known(frame, [name for name in present if name in schema.SCHEMA])
    except errors.FormatError as error:
        msg = f"{path}: {error}"
        raise errors.FormatError(msg) from error
    further = frame.select(name for name in present if name not in schema.SCHEMA)
    missing = (
        pl.lit(None, schema.SCHEMA[name]).alias(name) for name in wanted if name not in present
    )
    return known.with_columns(further).with_columns(missing).select(*wanted)


def _row_contradictions(frame: pl.DataFrame) -> tuple[Contradiction, ...]:
    def values(name: str) -> NDArray[np.float64]:
        column = frame[name].cast(pl.Float64).fill_null(np.nan).to_numpy()
        return np.asarray(column, dtype=np.float64)

    return row_contradictions(
        values("p_norm"),
        values("n_pixels"),
        values("exposure_ms"),
        frame["feature"].to_list(),
        n_points=values("n_points"),
        i_avg=values("i_avg"),
        turned_deg=np.stack([values(name) for name in ("w_deg", "p_deg", "r_deg")], axis=-1),
        incidence_deg=values("incidence_deg"),
    )


def _content(path: Path, what: str) -> bytes:
    """Return a file's bytes; say what a folder of that name may be."""
    if (path / "campaign.json").is_file():
        msg = f"{path}: a campaign's folder, no {what}; `exposight observe` makes a table of it"
        raise errors.FormatError(msg)
    if path.is_dir():
        msg = f"{path}: a folder; expected the file of the {what}, .csv or .parquet"
        raise errors.FormatError(msg)
    if not path.exists():
        msg = f"{path}: no such {what}"
        raise errors.MissingFileError(msg)
    return read_bytes(path, what)
