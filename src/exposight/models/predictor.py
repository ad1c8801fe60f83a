"""The contract of a predictor: which columns it reads, what it predicts, how it is kept.

The paper's Gaussian processes are one kind. Another kind is a frozen dataclass that inherits from
`Predictor`, names its `kind`, is registered by `register_predictor`, and implements
`predict_frame`; `examples/04_own_predictor.py` is one. It is then saved, loaded, evaluated and used
in forecasts like any other. A Gaussian process with another kernel, or of the target's logarithm,
needs no new kind: `exposight.gp.Leaf`, `ModelSpecification.target_scale`.
"""

from __future__ import annotations

import html
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Any, ClassVar, TypeVar

import numpy as np
import polars as pl
from numpy.typing import ArrayLike, NDArray

from exposight import __version__
from exposight.cell import GREY_MAX, ActiveSensor
from exposight.errors import InputError, ObservationError, did_you_mean
from exposight.models.prediction import Prediction
from exposight.observing import SCHEMA, ObservationTable
from exposight.quantities import quantity
from exposight.tables import Column, Table
from exposight.workers import Progress, ignore_progress


@dataclass(frozen=True, kw_only=True)
class Hyperparameter:
    """One hyperparameter of a predictor.

    Parameters
    ----------
    name : str
        Its own, ``rational_quadratic.length_scale[0]``.
    quantity : str
        What it measures: "variance", "length_scale", "alpha", "slope_variance", …
    inputs : tuple of str
        The inputs that it acts on; empty for the noise.
    value : float
        In `unit`.
    unit : str
        Empty for plain numbers; "mixed" where one length scale serves several units, as in the
        paper's kernels without ARD.
    remark : str
        "fixed", "at limit", or nothing.
    """

    name: str
    quantity: str
    inputs: tuple[str, ...]
    value: float
    unit: str
    remark: str = ""


@dataclass(frozen=True, kw_only=True)
class Provenance:
    """Where a trained model comes from.

    Parameters
    ----------
    observations : str
        What it was trained on, for instance the table's file name.
    observations_sha256 : str or None
        Checksum of that file, where it was one.
    emulated : bool
        True where any training observation was emulated rather than recorded.
    seed : int or None
        Seed of the training, where it is random.
    exposight_version : str
        The program that trained it.
    features : tuple of str
        Features that it was trained on; empty where that is not known.
    """

    observations: str
    observations_sha256: str | None
    emulated: bool
    seed: int | None
    exposight_version: str
    features: tuple[str, ...] = ()

    @classmethod
    def of(
        cls,
        table: ObservationTable,
        *,
        source: str = "a table in memory",
        sha256: str | None = None,
        seed: int | None = None,
    ) -> Provenance:
        """Return the provenance of a model that this program trains on a table."""
        return cls(
            observations=source,
            observations_sha256=sha256,
            emulated=bool(table.frame["emulated"].any()),
            seed=seed,
            exposight_version=__version__,
            features=tuple(dict.fromkeys(table.frame["feature"].to_list())),
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class Predictor(ABC):
    """Predicts one column of an observation table from others.

    Parameters
    ----------
    name : str
        Short, unique among models used together; names its file.
    title : str
        What it is, for people.
    target : str
        The column it predicts, with the unit in its name: ``p_norm``, ``exposure_ms``, …
    inputs : tuple of str
        The columns it reads; any columns, those that only some tables have included.
    provenance : Provenance
        What it was trained on.
    sensor : ActiveSensor or None
        The sensor that the observations are of; a model holds for this one alone.
    """

    kind: ClassVar[str] = ""
    """Name of the kind in model files, such as "gaussian-process"."""

    optional_inputs: ClassVar[tuple[str, ...]] = ()
    """Columns that it reads beside `inputs` where they are there."""

    name: str
    title: str
    target: str
    inputs: tuple[str, ...]
    provenance: Provenance
    sensor: ActiveSensor | None = None

    @property
    def unit(self) -> str:
        """Unit of the target; "1" for pure numbers."""
        return quantity(self.target).unit

    def predict(
        self,
        data: ObservationTable | pl.DataFrame | None = None,
        /,
        *,
        progress: Progress = ignore_progress,
        **columns: ArrayLike,
    ) -> Prediction:
        """Predict by column name.

        Parameters
        ----------
        data : ObservationTable or polars.DataFrame, optional
            Has a column for each of `inputs`, in any order; further ones are ignored.
        progress : Progress
            Receives the rows that are done, where a kind tells them (`predict_in_steps`).
        **columns : array_like
            Instead of `data`, values or (n,) arrays by name: ``predict(i_avg=80, z_mm=0)``. Single
            values hold for all rows. Columns of observation tables that the model does not read
            are ignored.

        Raises
        ------
        InputError
            If a name is unknown, or both `data` and `columns` are given.
        ObservationError
            If an input is missing, has no value in some row, or has one that cannot be.
        """
        return self.predict_in_steps(self._inputs(data, columns), progress)

    def unknown(self, data: ObservationTable | pl.DataFrame) -> tuple[str, ...]:
        """Say for each row why its prediction should not be relied on; empty where it may be."""
        frame = self._inputs(data, {})
        return self._beyond(frame, self.predict_frame(frame).inside)

    def _beyond(self, frame: pl.DataFrame, inside: NDArray[np.bool_]) -> tuple[str, ...]:
        """Say of each row that is not inside which inputs lie beyond the training range."""
        rows = np.flatnonzero(~inside)
        ranges = self.training_range
        beyond = np.zeros((len(rows), len(ranges)), dtype=np.bool_)
        for column, (name, (low, high)) in enumerate(ranges.items()):
            values = frame[name].to_numpy()[rows]
            beyond[:, column] = ~((low <= values) & (values <= high))
        reasons = [""] * frame.height
        kinds, kind = np.unique(beyond, axis=0, return_inverse=True)
        names = np.array(list(ranges), dtype=object)
        texts = [f"{', '.join(names[each])} outside the training data".lstrip() for each in kinds]
        for row, place in zip(rows.tolist(), kind.ravel().tolist(), strict=True):
            reasons[row] = texts[place]
        return tuple(reasons)

    def _inputs(
        self, data: ObservationTable | pl.DataFrame | None, columns: Mapping[str, ArrayLike]
    ) -> pl.DataFrame:
        """Return the columns that the model reads, `inputs` first."""
        if data is None:
            frame = _frame_of(self.name, (*self.inputs, *self.optional_inputs), columns)
        elif columns:
            msg = "predict either takes a table or columns by name, got both"
            raise InputError(msg)
        else:
            frame = data.frame if isinstance(data, ObservationTable) else data
        if not isinstance(frame, pl.DataFrame):
            msg = (
                f"{self.name} reads columns by name: pass a table, a polars frame or keywords such "
                f"as {self.inputs[0]}=…, got {type(frame).__name__}"
            )
            raise InputError(msg)
        missing = [name for name in self.inputs if name not in frame.columns]
        if missing:
            msg = (
                f"{self.name} reads {', '.join(self.inputs)}; missing {', '.join(missing)}, got "
                f"{', '.join(frame.columns) or 'nothing'}"
            )
            raise ObservationError(msg)
        further = [name for name in self.optional_inputs if name in frame.columns]
        return frame.select(*self.inputs, *further)

    @abstractmethod
    def predict_frame(self, frame: pl.DataFrame) -> Prediction:
        """Predict for a frame whose columns are `inputs`, in their order; `input_array` helps.

        After them come those of `optional_inputs` that there are.
        """

    def predict_in_steps(self, frame: pl.DataFrame, progress: Progress) -> Prediction:
        """As `predict_frame`; a kind that takes its time over many rows tells progress."""
        del progress
        return self.predict_frame(frame)

    def rows(self, table: ObservationTable) -> ObservationTable:
        """Return the rows of a table that the model learns from and is evaluated on."""
        return table.measured()

    def with_observations(self, table: ObservationTable) -> Predictor:
        """Return a model that has learnt from more observations, without a new fit.

        Raises
        ------
        InputError
            If this kind cannot.
        """
        msg = f"{self.name} cannot learn from {len(table)} more rows: train it again on all of them"
        raise InputError(msg)

    @property
    def n_observations(self) -> int | None:
        """Number of training observations, where that is known."""
        return None

    @property
    def features(self) -> tuple[str, ...] | None:
        """Names of the features that it has learnt from; None where that is not known."""
        return self.provenance.features or None

    @property
    def training_range(self) -> dict[str, tuple[float, float]]:
        """Smallest and largest training value of each input, as far as they are known."""
        return {}

    @property
    def target_range(self) -> tuple[float, float] | None:
        """Smallest and largest training value of the target, where they are known."""
        return None

    def hyperparameters(self) -> tuple[Hyperparameter, ...]:
        """Return the hyperparameters with their units; none by default."""
        return ()

    def remarks(self, frame: pl.DataFrame) -> tuple[str, ...]:
        """Say what of a frame is not what the model holds for; nothing by default."""
        return ()

    def _repr_html_(self) -> str:
        title = (
            f"{self.name} ({self.title}) predicts {self.target} in {quantity(self.target).unit} "
            f"from {', '.join(self.inputs)}"
        )
        columns = tuple(Column(name=name) for name in ("name", "value", "unit", "remark"))
        rows = [vars(each) for each in self.hyperparameters()]
        body = Table.of("hyperparameters", rows, columns)._repr_html_() if rows else ""
        return f"<p>{html.escape(title)}</p>{body}"

    def to_document(self) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
        """Return what the model file keeps beside the fields of `Predictor`.

        By default all further fields of the dataclass: arrays, and what JSON can hold.

        Returns
        -------
        content : dict
            Of what JSON can hold.
        arrays : dict of str to ndarray
            Numeric arrays by name.
        """
        common = {each.name for each in fields(Predictor)}
        kept = {f.name: getattr(self, f.name) for f in fields(self) if f.name not in common}
        arrays = {name: value for name, value in kept.items() if isinstance(value, np.ndarray)}
        return {name: value for name, value in kept.items() if name not in arrays}, arrays

    @classmethod
    def from_document(
        cls, common: Mapping[str, Any], content: dict[str, Any], arrays: Mapping[str, NDArray[Any]]
    ) -> Predictor:
        """Rebuild a predictor; the opposite of `to_document`.

        Parameters
        ----------
        common : mapping
            The fields of `Predictor` by name.
        content, arrays : dict, mapping
            What `to_document` returned.

        Raises
        ------
        InputError, KeyError, TypeError
            If something makes no sense or is missing; `load_model` then names the file.
        """
        values: dict[str, Any] = {**common, **content, **arrays}
        return cls(**values)


_Kind = TypeVar("_Kind", bound=type[Predictor])

_KINDS: dict[str, type[Predictor]] = {}


def register_predictor(kind: _Kind) -> _Kind:
    """Make model files of a kind of predictor readable; a class decorator.

    Raises
    ------
    InputError
        If the class has no `kind`, or another one has the same.
    """
    known = _KINDS.setdefault(kind.kind, kind)
    same = (known.__module__, known.__qualname__) == (kind.__module__, kind.__qualname__)
    if not kind.kind or not same:
        msg = f"{kind.__name__} needs a kind of its own, got {kind.kind!r}, taken: {list(_KINDS)}"
        raise InputError(msg)
    _KINDS[kind.kind] = kind
    return kind


def predictor_kind(name: str) -> type[Predictor]:
    """Return the registered kind of this name; `InputError` if there is none."""
    if name not in _KINDS:
        msg = (
            f"unknown kind of model {name!r}; expected one of {', '.join(_KINDS)}: import the "
            "package that defines it first"
        )
        raise InputError(msg)
    return _KINDS[name]


def input_array(name: str, frame: pl.DataFrame) -> NDArray[np.float64]:
    """Return numeric inputs as an array, each value there and possible.

    Parameters
    ----------
    name : str
        Of the model, for messages.
    frame : polars.DataFrame
        The inputs, n rows and d columns.

    Returns
    -------
    (n, d) ndarray

    Raises
    ------
    ObservationError
        If a column is not numeric, has no finite value in some row, or a brightness lies outside
        0 to 255.
    """
    for column in frame.iter_columns():
        if not column.dtype.is_numeric():
            msg = f"{name}: column '{column.name}' must hold numbers, got {column.dtype}"
            raise ObservationError(msg)
    values = frame.select(pl.all().cast(pl.Float64).fill_null(np.nan)).to_numpy()
    array = np.asarray(values, dtype=np.float64).reshape(-1, frame.width)
    for column_name, numbers in zip(frame.columns, array.T, strict=True):
        good, expected = np.isfinite(numbers), "finite numbers"
        if good.all() and quantity(column_name).unit.startswith("grey"):
            good, expected = (numbers >= 0.0) & (numbers <= GREY_MAX), "grey levels from 0 to 255"
        if not good.all():
            bad = np.flatnonzero(~good)
            msg = (
                f"{name}: column '{column_name}' must hold {expected}, got {numbers[bad[0]]:g} in "
                f"row {bad[0] + 1} ({bad.size} of {len(numbers)} rows)"
            )
            raise ObservationError(msg)
    return array


def _frame_of(name: str, inputs: Sequence[str], columns: Mapping[str, ArrayLike]) -> pl.DataFrame:
    known = dict.fromkeys((*inputs, *SCHEMA))
    unknown = next((column for column in columns if column not in known), None)
    if unknown is not None:
        msg = f"{name} does not read {unknown!r}, it reads {', '.join(inputs)}"
        raise InputError(msg + did_you_mean(unknown, inputs))
    given = {column: np.asarray(columns[column]) for column in inputs if column in columns}
    sizes = {values.size for values in given.values() if values.ndim}
    if len(sizes) > 1 or any(values.ndim > 1 for values in given.values()):
        shapes = ", ".join(f"{column} {values.shape}" for column, values in given.items())
        msg = f"columns must be single values or vectors of one length, got {shapes}"
        raise InputError(msg)
    rows = sizes.pop() if sizes else 1
    return pl.DataFrame({column: np.broadcast_to(v, rows).copy() for column, v in given.items()})
