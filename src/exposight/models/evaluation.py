"""Evaluate a model on held-out observations, and notice values in other units than it knows."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import polars as pl
from numpy.typing import NDArray

from exposight.cell import ActiveSensor
from exposight.errors import ObservationError
from exposight.models.prediction import Prediction
from exposight.models.predictor import Predictor
from exposight.observing import ObservationTable
from exposight.statistics import RegressionScore, score
from exposight.tables import number


@dataclass(frozen=True, kw_only=True, eq=False)
class Evaluation:
    """A model's predictions for observations, and their scores.

    Parameters
    ----------
    model : Predictor
    table : ObservationTable
        The rows it was evaluated on.
    observed : (n,) ndarray
        Targets, in their unit.
    prediction : Prediction
        What was predicted for them.
    score : RegressionScore
        R², MSE, RMSE, MAE and the bands' coverage (`Prediction.low`, `.high`).
    score_inside : RegressionScore or None
        The same for the rows inside the training data's range (the paper's X_test,i); None where
        there are none.
    remarks : tuple of str
        What is odd about the observations: values that seem to be in another unit.
    """

    model: Predictor
    table: ObservationTable
    observed: NDArray[np.float64]
    prediction: Prediction
    score: RegressionScore
    score_inside: RegressionScore | None
    remarks: tuple[str, ...] = ()


def evaluate(model: Predictor, table: ObservationTable) -> Evaluation:
    """Evaluate a model on those rows of a table that are of the kind it learns from.

    Raises
    ------
    ObservationError
        If no row is left, or a column is missing.
    """
    rows = model.rows(table)
    check_rows(model.name, "evaluate", rows, table)
    prediction = model.predict(rows)
    observed = rows.array([model.target])[:, 0]
    inside = prediction.inside
    return Evaluation(
        model=model,
        table=rows,
        observed=observed,
        prediction=prediction,
        score=_scored(observed, prediction, np.ones_like(inside)),
        score_inside=_scored(observed, prediction, inside) if inside.any() else None,
        remarks=unit_remarks(model, rows.frame),
    )


def _scored(
    observed: NDArray[np.float64], prediction: Prediction, rows: NDArray[np.bool_]
) -> RegressionScore:
    return score(
        observed[rows],
        prediction.mean[rows],
        prediction.std[rows],
        band=(prediction.low[rows], prediction.high[rows]),
    )


def check_rows(
    name: str,
    purpose: str,
    rows: ObservationTable,
    table: ObservationTable,
    p_norm_min: float | None = None,
) -> None:
    """Check that a table has rows that a model learns from or is evaluated on.

    Raises
    ------
    ObservationError
        If there is none; the message says what the table's rows are instead.
    """
    if len(rows):
        return
    wanted = "measured observations"
    if p_norm_min is not None:
        wanted += f" with p_norm ≥ {p_norm_min:g}"
    counts = ", ".join(f"{count} {reason}" for reason, count in table.counts().items())
    msg = f"cannot {purpose} {name}: it needs {wanted}, and " + (
        f"none of the table's {len(table)} rows is one ({counts or 'no rows'})"
        if len(table) != 1
        else f"the table's only row is none ({counts})"
    )
    raise ObservationError(msg)


def check_exposures(rows: ObservationTable, sensor: ActiveSensor | None) -> None:
    """Check that a sensor can have taken the recorded rows.

    Raises
    ------
    SensorError
        If it cannot: the unit of time is another one, or the sensor is.
    """
    if sensor is None:
        return
    recorded = rows.frame.filter(~rows.frame["emulated"])["exposure_ms"]
    for exposure_ms in recorded.unique(maintain_order=True):
        sensor.check_exposure(exposure_ms)


_POSITIONS = ("x_mm", "y_mm", "z_mm")

_FAR_LESS = 0.01
"""A table in m reaches a thousandth as far as one in mm; a part's few features may, at times."""

_UNITS = {1e3: "s", 1e-3: "µs", 1e-6: "ns", 1e6: "another unit"}
"""Factors to ms, and the unit that each one speaks for."""

_MOST = 0.9
"""So many must fit with the factor, and fail to without it: a wide range may hold a few of both."""

_MARGIN = 3.0
"""Fitting is meant widely: a model may know the best of a sweep's exposure times only."""


def unit_remarks(model: Predictor, frame: pl.DataFrame) -> tuple[str, ...]:
    """Say which columns seem to be in another unit than the model's.

    Judged by the ranges that it was trained on and its sensor's exposure times; empty where nothing
    is odd. `frame` is what it is asked about, or evaluated on.
    """
    remarks = (_positions_in_metres(model, frame), _other_exposure_unit(model, frame))
    return tuple(remark for remark in remarks if remark)


def _positions_in_metres(model: Predictor, frame: pl.DataFrame) -> str:
    ranges: Mapping[str, tuple[float, float]] = model.training_range
    known = [name for name in _POSITIONS if name in ranges and name in frame.columns]
    if not known:
        return ""
    values = frame.select(pl.col(known).cast(pl.Float64).fill_null(np.nan)).to_numpy()
    values = values[np.isfinite(values).all(axis=1)]
    if not len(values):
        return ""
    trained = np.array([ranges[name] for name in known])
    span, trained_span = float(np.ptp(values, axis=0).max()), float(np.ptp(trained, axis=1).max())
    reach, trained_reach = float(np.abs(values).max()), float(np.abs(trained).max())
    # One position alone has no span, and may be any.
    if not (0.0 < span < _FAR_LESS * trained_span and reach < _FAR_LESS * trained_reach):
        return ""
    return (
        f"{', '.join(known)} span {number(span, 3)} mm at most here, and {number(trained_span, 3)} "
        f"mm where {model.name} was trained: are they in metres? positions are in mm, multiply by "
        "1000 if so"
    )


def _other_exposure_unit(model: Predictor, frame: pl.DataFrame) -> str:
    known, sensor = None, model.sensor
    if model.target == "exposure_ms":
        known = model.target_range
    elif sensor is not None:
        known = sensor.exposure.min_ms, sensor.exposure.max_ms
    if known is None or "exposure_ms" not in frame.columns:
        return ""
    values = frame["exposure_ms"].cast(pl.Float64).fill_null(np.nan).to_numpy()
    values = values[np.isfinite(values)]
    if not values.size:
        return ""
    low, high = known

    def fitting(factor: float) -> float:
        scaled = factor * values
        return float(np.mean((low / _MARGIN <= scaled) & (scaled <= high * _MARGIN)))

    factor = max(_UNITS, key=fitting)
    if fitting(1.0) > 1.0 - _MOST or fitting(factor) < _MOST:
        return ""
    remedy = f"multiply by {factor:.0f}" if factor > 1 else f"divide by {1 / factor:.0f}"
    return (
        f"the exposure times here, {number(values.min())} to {number(values.max())}, do not fit "
        f"those of {model.name}, {number(low)} to {number(high)} ms: they seem to be in "
        f"{_UNITS[factor]}; {remedy} in column exposure_ms, which is in ms"
    )
