"""Evaluate a model on held-out observations, and notice values in other units than it knows."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import polars as pl
from numpy.typing import NDArray

from exposight.cell import ActiveSensor
from exposight.errors import ObservationError
from exposight.models.prediction import Prediction
from exposight.models.predictor import Predictor
from exposight.models.specification import P_NORM_MIN
from exposight.observing import ObservationTable
from exposight.quantities import quantity
from exposight.statistics import (
    LEVELS,
    ChanceBin,
    RegressionScore,
    brier,
    crps,
    log_score,
    reliability,
    score,
)
from exposight.tables import counted, number


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
        What is odd about the observations: values that seem to be in another unit, or another
        finish.
    """

    model: Predictor
    table: ObservationTable
    observed: NDArray[np.float64]
    prediction: Prediction
    score: RegressionScore
    score_inside: RegressionScore | None
    remarks: tuple[str, ...] = ()

    @cached_property
    def quantiles(self) -> NDArray[np.float64]:
        """Predicted quantiles at `exposight.statistics.LEVELS`, (k, n)."""
        return self.prediction.quantiles(LEVELS)

    @cached_property
    def chance(self) -> NDArray[np.float64] | None:
        """Predicted chance of a p_norm of at least `P_NORM_MIN`, (n,); None of other targets."""
        return self.prediction.chance(P_NORM_MIN) if self.model.target == "p_norm" else None

    @cached_property
    def good(self) -> NDArray[np.bool_]:
        """Which observations have a p_norm of at least `P_NORM_MIN`, (n,)."""
        return self.observed >= P_NORM_MIN

    @property
    def unseen(self) -> NDArray[np.bool_] | None:
        """Which rows are of features that the model did not learn from, (n,); None if not known."""
        known = self.model.features
        return None if known is None else ~np.isin(self.table.names("feature"), list(known))

    @property
    def selections(self) -> dict[str, NDArray[np.bool_]]:
        """Rows that are scored apart, by name.

        All; those inside the range of what was learnt, where some are not; of known and of unseen
        features, where there are both.
        """
        rows: dict[str, NDArray[np.bool_]] = {"all": np.ones(len(self.observed), dtype=np.bool_)}
        if self.prediction.inside.any() and not self.prediction.inside.all():
            rows["inside"] = self.prediction.inside
        unseen = self.unseen
        if unseen is not None and unseen.any() and not unseen.all():
            rows |= {"known": ~unseen, "unseen": unseen}
        return rows

    def score_of(self, rows: NDArray[np.bool_]) -> RegressionScore:
        """Return the score of some of the rows."""
        return _scored(self.observed, self.prediction, self.inner_band, rows)

    @cached_property
    def inner_band(self) -> NDArray[np.float64]:
        """Predicted 1σ band, (2, n)."""
        return self.prediction.quantiles(_ONE_SIGMA)

    def probability_score(self, rows: NDArray[np.bool_]) -> ProbabilityScore:
        """Return the scores of the predicted distributions of some of the rows."""
        observed, quantiles = self.observed[rows], self.quantiles[:, rows]
        bounded = quantity(self.model.target).high is not None
        relative = brier_score = edge_coverage = None
        edge: NDArray[np.bool_] = np.zeros(len(observed), dtype=np.bool_)
        if self.chance is not None:
            brier_score = brier(self.good[rows], self.chance[rows])
            edge = (observed > _EDGE[0]) & (observed < _EDGE[1])
            low, high = self.prediction.low[rows][edge], self.prediction.high[rows][edge]
            inside = (low <= observed[edge]) & (observed[edge] <= high)
            edge_coverage = float(inside.mean()) if edge.any() else None
        elif (observed > 0.0).all():
            relative = float(np.median(np.abs(self.prediction.mean[rows] / observed - 1.0)))
        return ProbabilityScore(
            median_relative_error=relative,
            crps=crps(observed, quantiles),
            log_score=log_score(observed, quantiles, width=_WIDTH if bounded else 0.0),
            brier=brier_score,
            n_edge=int(edge.sum()),
            coverage_edge=edge_coverage,
        )

    @property
    def reliability(self) -> tuple[ChanceBin, ...]:
        """What came of the predicted chances; empty of targets other than p_norm."""
        return () if self.chance is None else reliability(self.good, self.chance)


@dataclass(frozen=True, kw_only=True)
class ProbabilityScore:
    """Scores of predicted distributions and chances.

    Parameters
    ----------
    median_relative_error : float or None
        Median of |predicted/observed − 1|; None of targets with a full scale, such as p_norm.
    crps : float
        Continuous ranked probability score, in the target's unit (`exposight.statistics.crps`).
    log_score : float, nats
        Minus the mean logarithm of the density (`exposight.statistics.log_score`), in 1 over the
        target's unit; of targets with a full scale widened by an error of 0.01 of it.
    brier : float or None
        Brier score of the chance of a p_norm of at least `P_NORM_MIN`; None of other targets.
    n_edge : int
        Observations at an edge of the window: 0.03 < p_norm < 0.97.
    coverage_edge : float or None
        Share of these within their 2σ band; None where there is none.
    """

    median_relative_error: float | None
    crps: float
    log_score: float
    brier: float | None
    n_edge: int
    coverage_edge: float | None


_ONE_SIGMA = (0.15865525393145707, 0.8413447460685429)
"""Levels of a normal distribution's quantiles at one standard deviation below and above."""

_EDGE = (0.03, 0.97)
"""Observations between are neither quite lost nor quite there."""

_WIDTH = 0.01
"""Share of full scale by which distributions are widened before they have a density."""


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
    inside, inner_band = prediction.inside, prediction.quantiles(_ONE_SIGMA)
    return Evaluation(
        model=model,
        table=rows,
        observed=observed,
        prediction=prediction,
        score=_scored(observed, prediction, inner_band, np.ones_like(inside)),
        score_inside=_scored(observed, prediction, inner_band, inside) if inside.any() else None,
        remarks=(*unit_remarks(model, rows.frame), *model.remarks(rows.frame)),
    )


def _scored(
    observed: NDArray[np.float64],
    prediction: Prediction,
    inner_band: NDArray[np.float64],
    rows: NDArray[np.bool_],
) -> RegressionScore:
    return score(
        observed[rows],
        prediction.mean[rows],
        prediction.std[rows],
        band=(prediction.low[rows], prediction.high[rows]),
        inner_band=(inner_band[0, rows], inner_band[1, rows]),
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
    """Check that a sensor can have taken the recorded rows, each with one exposure time.

    Raises
    ------
    ObservationError
        If rows are of merged captures, whose brightness belongs to no exposure time.
    SensorError
        If it cannot: the unit of time is another one, or the sensor is.
    """
    merged = int((rows.frame["brightness_source"] == "merged").sum())
    if merged:
        msg = (
            f"{counted(merged, 'row')} of {len(rows)} are of merged captures, whose pixels were "
            "taken at several exposure times; give the observations of the single captures"
        )
        raise ObservationError(msg)
    if sensor is None:
        return
    recorded = rows.frame.filter(~rows.frame["emulated"])["exposure_ms"]
    for exposure_ms in recorded.unique(maintain_order=True):
        sensor.check_taken_exposure(exposure_ms)


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
