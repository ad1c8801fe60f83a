"""The curves that a model predicted best and worst (Figs. 11 and 14)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np

from exposight.errors import ObservationError
from exposight.paper.figure_data.curves import ObservedCurve, observed_curves
from exposight.paper.figure_data.training_poses import inside_training_poses

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from exposight.models import TrainedModel
    from exposight.observing import ObservationTable


_SHOWN = 3
"""Best and worst predictions that the figures show."""
_FEWEST = 4
"""Observations of a curve that can be judged; p_norm ≥ 0.75 leaves about half of the ten."""
_SAMPLES = 161


@dataclass(frozen=True, kw_only=True, eq=False)
class PredictedCurve:
    """A model's prediction for one feature in one view, over the brightness.

    Parameters
    ----------
    observed : ObservedCurve
        What was measured there.
    i_avg : (m,) ndarray
        Grey levels at which the model was asked.
    mean, std : (m,) ndarray
        Prediction and standard deviation of a new observation, in the target's unit.
    rmse : float
        Of the observations, in the target's unit.
    covered : int
        Observations within two standard deviations.
    inside : bool
        Whether the pose lies inside the box of the training poses.
    """

    observed: ObservedCurve
    i_avg: NDArray[np.float64]
    mean: NDArray[np.float64]
    std: NDArray[np.float64]
    rmse: float
    covered: int
    inside: bool


@dataclass(frozen=True, kw_only=True, eq=False)
class BestAndWorst:
    """The curves that a model predicted best and worst (Figs. 11 and 14).

    Parameters
    ----------
    rung : str
        The model's name.
    target : {"p_norm", "exposure_ms"}
        What it predicts.
    dataset : str
        Where the observations come from.
    judged : int
        Curves among which these were chosen.
    best, worst : tuple of PredictedCurve
        By growing, and by falling RMSE.
    """

    rung: str
    target: Literal["p_norm", "exposure_ms"]
    dataset: str
    judged: int
    best: tuple[PredictedCurve, ...]
    worst: tuple[PredictedCurve, ...]


def best_and_worst(
    rung: str,
    model: TrainedModel,
    dataset: str,
    table: ObservationTable,
    *,
    least_range: float = 0.0,
    inside_only: bool = False,
) -> BestAndWorst:
    """Choose the curves that a model predicts best and worst.

    Parameters
    ----------
    rung, dataset : str
        Names, kept.
    model : TrainedModel
        Predicts from i_avg, its first input, and the pose.
    table : ObservationTable
        Observations of unseen features; rows that the model is not judged by are left out.
    least_range : float
        Curves whose target varies less say little and are left out; in the target's unit.
    inside_only : bool
        Leave out poses outside the box of the training poses (the paper's "test,i").

    Raises
    ------
    ObservationError
        If no curve is left.
    """
    specification = model.specification
    curves = [
        _predicted(model, curve)
        for curve in observed_curves(specification.rows(table))
        if len(curve.i_avg) >= _FEWEST and np.ptp(_target(model, curve)) >= least_range
    ]
    judged = [curve for curve in curves if curve.inside or not inside_only]
    if not judged:
        msg = (
            f"{specification.name} can be shown on curves of at least {_FEWEST} exposure times of "
            f"one feature in one view, got none in {len(table)} rows of {dataset}"
        )
        raise ObservationError(msg)
    ordered = sorted(judged, key=lambda own: (own.rmse, own.observed.feature, own.observed.view))
    count = min(_SHOWN, (len(ordered) + 1) // 2)
    return BestAndWorst(
        rung=rung,
        target=specification.target,
        dataset=dataset,
        judged=len(ordered),
        best=tuple(ordered[:count]),
        worst=tuple(ordered[::-1][: min(count, len(ordered) - count)]),
    )


def _predicted(model: TrainedModel, curve: ObservedCurve) -> PredictedCurve:
    low, high = (0.0, 255.0)
    if model.specification.target == "exposure_ms":
        low, high = model.training_range()["i_avg"]
    grey = np.linspace(low, high, _SAMPLES)
    drawn = model.predict(_inputs(model, curve, grey))
    inputs = _inputs(model, curve, curve.i_avg)
    judged = model.predict(inputs)
    error = np.abs(_target(model, curve) - judged.mean)
    return PredictedCurve(
        observed=curve,
        i_avg=grey,
        mean=drawn.mean,
        std=drawn.std,
        rmse=float(np.sqrt(np.mean(error**2))),
        covered=int(np.sum(error <= 2 * judged.std)),
        inside=bool(inside_training_poses(model, inputs).all()),
    )


def _target(model: TrainedModel, curve: ObservedCurve) -> NDArray[np.float64]:
    return curve.p_norm if model.specification.target == "p_norm" else curve.exposure_ms


def _inputs(
    model: TrainedModel, curve: ObservedCurve, grey: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return a model's inputs for one pose and several grey levels."""
    constant = {
        "x_mm": curve.x_mm,
        "y_mm": curve.y_mm,
        "z_mm": curve.z_mm,
        "w_deg": curve.w_deg,
        "p_deg": curve.p_deg,
    }
    columns = [
        grey if name == "i_avg" else np.full_like(grey, constant[name])
        for name in model.specification.inputs
    ]
    return np.stack(columns, axis=1)
