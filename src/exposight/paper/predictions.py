"""Predictions beside observations: best and worst curves, one capture (Figs. 11, 14, 15)."""

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from exposight.errors import ObservationError
from exposight.models import P_NORM_MIN, GaussianProcessModel
from exposight.observing import ObservationTable
from exposight.paper.observed_curves import ObservedCurve, observed_curves

_SHOWN = 3
"""Best and worst predictions that the figures show."""
_FEWEST = 4
"""Fewest observations of a curve that is evaluated; p_norm ≥ 0.75 leaves about half of the ten."""
_SAMPLES = 161


@dataclass(frozen=True, kw_only=True, eq=False)
class PredictedCurve:
    """A model's prediction for one feature in one view, over the brightness.

    Parameters
    ----------
    observed : ObservedCurve
        Observations.
    i_avg : (m,) ndarray
        Grey levels at which the model predicts.
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
    variant : str
        The model's name.
    target : {"p_norm", "exposure_ms"}
        Predicted column.
    dataset : str
        Dataset that the observations come from.
    judged : int
        Curves among which these were chosen.
    best, worst : tuple of PredictedCurve
        By growing, and by falling RMSE.
    """

    variant: str
    target: str
    dataset: str
    judged: int
    best: tuple[PredictedCurve, ...]
    worst: tuple[PredictedCurve, ...]


def best_and_worst(
    variant: str,
    model: GaussianProcessModel,
    dataset: str,
    table: ObservationTable,
    *,
    least_range: float = 0.0,
    inside_only: bool = False,
) -> BestAndWorst:
    """Choose the curves that a model predicts best and worst.

    Parameters
    ----------
    variant, dataset : str
        Names, kept.
    model : GaussianProcessModel
        Predicts from i_avg, its first input, and the pose.
    table : ObservationTable
        Observations of unseen features; rows that the model is not evaluated on are left out.
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
    ordered = sorted(
        judged, key=lambda curve: (curve.rmse, curve.observed.feature, curve.observed.view)
    )
    count = min(_SHOWN, (len(ordered) + 1) // 2)
    return BestAndWorst(
        variant=variant,
        target=specification.target,
        dataset=dataset,
        judged=len(ordered),
        best=tuple(ordered[:count]),
        worst=tuple(ordered[::-1][: min(count, len(ordered) - count)]),
    )


def _predicted(model: GaussianProcessModel, curve: ObservedCurve) -> PredictedCurve:
    low, high = (0.0, 255.0)
    if model.target == "exposure_ms":
        low, high = model.training_range["i_avg"]
    grey = np.linspace(low, high, _SAMPLES, dtype=np.float64)
    drawn = model.predict(**_inputs(model, curve, grey))
    inputs = _inputs(model, curve, curve.i_avg)
    judged = model.predict(**inputs)
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


def _target(model: GaussianProcessModel, curve: ObservedCurve) -> NDArray[np.float64]:
    return curve.p_norm if model.target == "p_norm" else curve.exposure_ms


def _inputs(
    model: GaussianProcessModel, curve: ObservedCurve, grey: NDArray[np.float64]
) -> dict[str, Any]:
    """Return a model's inputs by name for one pose and several grey levels, as arrays."""
    constant = {
        "x_mm": curve.x_mm,
        "y_mm": curve.y_mm,
        "z_mm": curve.z_mm,
        "w_deg": curve.w_deg,
        "p_deg": curve.p_deg,
    }
    return {
        name: grey if name == "i_avg" else np.full_like(grey, constant[name])
        for name in model.inputs
    }


def inside_training_poses(
    model: GaussianProcessModel, inputs: Mapping[str, NDArray[np.float64]]
) -> NDArray[np.bool_]:
    """Return which inputs' poses lie inside the box of the training poses, whatever their i_avg.

    Parameters
    ----------
    model : GaussianProcessModel
        Its training rows span the box.
    inputs : mapping of str to (n,) ndarray
        The model's inputs by name, in their units.

    Returns
    -------
    (n,) ndarray of bool
        True everywhere for a model that reads no pose.
    """
    inside = np.ones(len(inputs["i_avg"]), dtype=np.bool_)
    for name, (low, high) in model.training_range.items():
        if name != "i_avg":
            inside &= (low <= inputs[name]) & (inputs[name] <= high)
    return inside


@dataclass(frozen=True, kw_only=True)
class FeatureForecast:
    """One feature of a capture: measured, and predicted by both models.

    Parameters
    ----------
    feature : str
        Its name.
    x_mm, y_mm, z_mm, radius_mm : float
        Position in the TCP frame, and radius.
    i_avg : float
        Its brightness, grey level 0–255.
    p_norm, p_norm_mean, p_norm_std : float
        Quality: measured, predicted, standard deviation.
    exposure_mean_ms, exposure_std_ms : float
        Predicted exposure time for this brightness, and its standard deviation.
    inside : bool
        Whether its pose lies inside the box of both models' training poses.
    """

    feature: str
    x_mm: float
    y_mm: float
    z_mm: float
    radius_mm: float
    i_avg: float
    p_norm: float
    p_norm_mean: float
    p_norm_std: float
    exposure_mean_ms: float
    exposure_std_ms: float
    inside: bool


@dataclass(frozen=True, kw_only=True)
class CaptureForecast:
    """Unseen features of one capture (Fig. 15).

    Parameters
    ----------
    view : str
        The capture's view.
    exposure_ms : float
        Its true exposure time.
    quality_variant, exposure_variant : str
        The models' names.
    features : tuple of FeatureForecast
        By name.
    """

    view: str
    exposure_ms: float
    quality_variant: str
    exposure_variant: str
    features: tuple[FeatureForecast, ...]


def capture_forecast(
    quality: tuple[str, GaussianProcessModel],
    exposure: tuple[str, GaussianProcessModel],
    table: ObservationTable,
    *,
    exposure_near_ms: float = 27.0,
) -> CaptureForecast:
    """Predict for all features of the capture that shows most of them well enough.

    Parameters
    ----------
    quality, exposure : (str, GaussianProcessModel)
        Names and models.
    table : ObservationTable
        Unseen features.
    exposure_near_ms : float
        Among captures that show equally many (with p_norm ≥ 0.75, then at all), the one nearest to
        this exposure time is taken; the paper shows 27 ms.

    Raises
    ------
    ObservationError
        If no feature is measured in the table.
    """
    measured = table.measured()
    if len(measured) == 0:
        msg = f"no measured row among {len(table)}: no capture to predict for"
        raise ObservationError(msg)
    view, exposure_ms = _fullest_capture(measured, exposure_near_ms)
    captured = measured.array(["exposure_ms"])[:, 0] == exposure_ms
    rows = measured.where((measured.names("view") == view) & captured)
    return CaptureForecast(
        view=view,
        exposure_ms=exposure_ms,
        quality_variant=quality[0],
        exposure_variant=exposure[0],
        features=tuple(_forecasts(quality[1], exposure[1], rows)),
    )


def _forecasts(
    quality: GaussianProcessModel, exposure: GaussianProcessModel, rows: ObservationTable
) -> list[FeatureForecast]:
    """Predict for each row, by the features' names."""
    q, e = quality.predict(rows), exposure.predict(rows)
    inside = _pose_inside(quality, rows) & _pose_inside(exposure, rows)
    values = rows.array(["x_mm", "y_mm", "z_mm", "radius_mm", "i_avg", "p_norm"])
    features = [
        FeatureForecast(
            feature=str(name),
            x_mm=float(x),
            y_mm=float(y),
            z_mm=float(z),
            radius_mm=float(radius),
            i_avg=float(i_avg),
            p_norm=float(p_norm),
            p_norm_mean=float(q.mean[i]),
            p_norm_std=float(q.std[i]),
            exposure_mean_ms=float(e.mean[i]),
            exposure_std_ms=float(e.std[i]),
            inside=bool(inside[i]),
        )
        for i, (name, (x, y, z, radius, i_avg, p_norm)) in enumerate(
            zip(rows.names("feature"), values, strict=True)
        )
    ]
    return sorted(features, key=lambda item: item.feature)


def _fullest_capture(measured: ObservationTable, exposure_near_ms: float) -> tuple[str, float]:
    counted, good = (_captures(rows) for rows in (measured, measured.with_quality(P_NORM_MIN)))
    return min(
        counted,
        key=lambda key: (
            -good[key],
            -counted[key],
            abs(np.log(key[1] / exposure_near_ms)),
            key[0],
        ),
    )


def _captures(table: ObservationTable) -> Counter[tuple[str, float]]:
    """Count the rows of each view and exposure time."""
    exposures = table.array(["exposure_ms"])[:, 0].tolist()
    return Counter(zip(table.names("view").tolist(), exposures, strict=True))


def _pose_inside(model: GaussianProcessModel, rows: ObservationTable) -> NDArray[np.bool_]:
    inputs = dict(zip(model.inputs, rows.array(model.inputs).T, strict=True))
    return inside_training_poses(model, inputs)
