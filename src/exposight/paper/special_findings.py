"""Figures of the paper's statements that no table holds.

Each function takes the evidence and the sensor and returns a number, or None where what it needs
was not measured.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np
import polars as pl

from exposight.paper.datasets import OUTSIDE, POSE, inside_range
from exposight.paper.results import Dataset, SensorKind, TrainedVariant
from exposight.statistics import r2, rmse

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from exposight.models import Evaluation
    from exposight.paper.results import DependenceMatrix, LearningCurve


_PLATEAU = (30.0, 110.0)
"""Grey levels between which p_norm neither rises nor falls (Figs. 10, 11)."""
_FAR_MM = 75.0
"""z that divides the far depth plane from the others, midway between Table 9's ranges."""
_SMALL_MM = 10.0
"""Radius below which a feature counts as small; Fig. 4's lie between 3 and 30 mm."""
_BRIGHT = 200.0
_LEAST_OBSERVATIONS = 4
"""Fewer do not show whether they follow a line."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Evidence:
    """What the figures are computed from.

    Parameters
    ----------
    datasets : mapping of str to Dataset
        By name; where a campaign is missing, empty.
    variants : mapping of str to TrainedVariant
        By name; absent where nothing could be learnt.
    dependence : mapping of str to DependenceMatrix
        By sensor.
    learning : mapping of str to LearningCurve
        By variant.
    """

    datasets: Mapping[str, Dataset]
    variants: Mapping[str, TrainedVariant]
    dependence: Mapping[str, DependenceMatrix]
    learning: Mapping[str, LearningCurve]


def _brightness_lead(evidence: Evidence, sensor: SensorKind) -> float | None:
    matrix = evidence.dependence.get(sensor)
    if matrix is None:
        return None
    return matrix.between("i_avg", "p_norm") - max(matrix.between(c, "p_norm") for c in POSE)


def _depth_lead(evidence: Evidence, sensor: SensorKind) -> float | None:
    matrix = evidence.dependence.get(sensor)
    if matrix is None:
        return None
    sideways = max(matrix.between(column, "exposure_ms") for column in ("x_mm", "y_mm"))
    return matrix.between("z_mm", "exposure_ms") - sideways


def _slopes_over_plateau(evidence: Evidence, _: SensorKind) -> float | None:
    result = _result(evidence, "q_k4", "X_test")
    if result is None:
        return None
    i_avg = result.table.array(["i_avg"])[:, 0]
    plateau = (i_avg >= _PLATEAU[0]) & (i_avg <= _PLATEAU[1])
    return _rmse_ratio(result, ~plateau, plateau)


def _quality_half(evidence: Evidence, _: SensorKind) -> float | None:
    return _cost_of_fewer(evidence, "q_k4", 2)


def _cost_of_fewer(evidence: Evidence, variant: str, divisor: int) -> float | None:
    """RMSE of a variant trained on a fraction of the rows over that of all."""
    curve = evidence.learning.get(variant)
    if curve is None or not curve.steps:
        return None
    last = curve.steps[-1]
    for step in curve.steps:
        if step.n_train == last.n_train // divisor:
            return step.score.rmse / last.score.rmse
    return None


def _quality_eighth(evidence: Evidence, _: SensorKind) -> float | None:
    return _cost_of_fewer(evidence, "q_k4", 8)


def _exposure_needs_more(evidence: Evidence, _: SensorKind) -> float | None:
    exposure, quality = (_cost_of_fewer(evidence, variant, 2) for variant in ("e_k6", "q_k4"))
    return None if exposure is None or quality is None else exposure / quality


def _linear_at_one_place(evidence: Evidence, sensor: SensorKind) -> float | None:
    dataset = evidence.datasets.get("s2_eX" if sensor == "stereo" else "eX")
    if dataset is None:
        return None
    shares = []
    for _, place in dataset.table.frame.group_by("feature", "view", maintain_order=True):
        i_avg, exposure_ms = (place[name].to_numpy() for name in ("i_avg", "exposure_ms"))
        if len(place) >= _LEAST_OBSERVATIONS and np.ptp(i_avg) > 0:
            line = np.polynomial.Polynomial.fit(i_avg, exposure_ms, 1)
            shares.append(100.0 * r2(exposure_ms, line(i_avg)))
    return float(np.median(shares)) if shares else None


def _more_features_gain(evidence: Evidence, _: SensorKind) -> float | None:
    """Both models on the same rows: those inside the range of the nine features."""
    four, nine = (evidence.variants.get(name) for name in ("e_k4", "e_k4_plus"))
    plus, test = evidence.datasets.get("eX_plus"), evidence.datasets.get("eX_test")
    if four is None or nine is None or plus is None or plus.train is None or test is None:
        return None
    inside = test.table.where(inside_range(plus.train, test.table, POSE))
    if len(inside) == 0:
        return None
    errors = (
        rmse(trained.variant.specification.data(inside)[1], trained.model.predict(inside).mean)
        for trained in (four, nine)
    )
    return next(errors) / next(errors)


def _far_over_nearer(evidence: Evidence, _: SensorKind) -> float | None:
    result = _result(evidence, "e_k6", "eX_test", role="test_inside")
    if result is None:
        return None
    far = result.table.array(["z_mm"])[:, 0] > _FAR_MM
    return _rmse_ratio(result, far, ~far)


def _left_over_right(evidence: Evidence, _: SensorKind) -> float | None:
    trained = evidence.variants.get("e_k6")
    if trained is None:
        return None
    values = {"i_avg": 75.0, "z_mm": 0.0, "w_deg": 0.0, "p_deg": 0.0}

    def mean_ms(x_mm: float) -> float:
        prediction = trained.model.predict(**values, x_mm=x_mm, y_mm=np.array([-100.0, 0.0, 100.0]))
        return float(prediction.mean.mean())

    return mean_ms(-150.0) / mean_ms(150.0)


def _lighting_quality_spread(evidence: Evidence, _: SensorKind) -> float | None:
    results = [_lighting(evidence, "q_k4", scenario) for scenario in ("I", "II", "III")]
    errors = [result.score.rmse for result in results if result is not None]
    return 100.0 * (max(errors) - min(errors)) if len(errors) == len(results) else None


def _lighting_drift(
    pick: Callable[[float, float], float],
) -> Callable[[Evidence, SensorKind], float | None]:
    def figure(evidence: Evidence, _: SensorKind) -> float | None:
        known = _lighting(evidence, "e_k6", "I")
        others = [_lighting(evidence, "e_k6", scenario) for scenario in ("II", "III")]
        if known is None or any(other is None for other in others):
            return None
        drifts = [_drift_ms(known, other) for other in others if other is not None]
        found = [drift for drift in drifts if drift is not None]
        return pick(*found) if len(found) == len(others) else None

    return figure


def _drift_ms(known: Evaluation, other: Evaluation) -> float | None:
    """Mean signed error in another light less that in the known, on rows that both have."""
    keys = ["feature", "exposure_ms"]
    first, second = (
        result.table.frame.select(keys).with_columns(
            error=pl.Series(result.prediction.mean - result.observed)
        )
        for result in (known, other)
    )
    both = first.join(second, on=keys, suffix="_other")
    if len(both) == 0:
        return None
    return float(np.mean(both["error_other"].to_numpy() - both["error"].to_numpy()))


def _quality_bias_third_finish(evidence: Evidence, _: SensorKind) -> float | None:
    result = _result(evidence, "q_k4", "X_out", role="extended", features=OUTSIDE[3:])
    if result is None:
        return None
    return float(100.0 * np.mean(result.prediction.mean - result.observed))


def _finish_sensitivity(evidence: Evidence, _: SensorKind) -> float | None:
    results = [
        _result(evidence, "e_k6", "X_out", role="extended"),
        _result(evidence, "e_k6", "eX_test", role="test_inside"),
        _result(evidence, "q_k4", "X_out", role="extended"),
        _result(evidence, "q_k4", "X_test"),
    ]
    errors = [result.score.rmse for result in results if result is not None]
    if len(errors) < len(results):
        return None
    return (errors[0] / errors[1]) / (errors[2] / errors[3])


def _small_over_large(evidence: Evidence, _: SensorKind) -> float | None:
    result = _result(evidence, "q_k4_s2", "s2_X_test")
    if result is None:
        return None
    small = result.table.array(["radius_mm"])[:, 0] < _SMALL_MM
    return _rmse_ratio(result, small, ~small)


def _bright_stereo_lead(evidence: Evidence, _: SensorKind) -> float | None:
    stereo, stripes = (_bright_p_norm(evidence.datasets.get(name)) for name in ("s2_X", "X"))
    return None if stereo is None or stripes is None else stereo - stripes


def _bright_p_norm(dataset: Dataset | None) -> float | None:
    if dataset is None:
        return None
    bright = dataset.table.frame.filter(pl.col("i_avg") >= _BRIGHT)["p_norm"].to_numpy()
    return float(np.median(bright)) if len(bright) else None


def _lighting(evidence: Evidence, variant: str, scenario: str) -> Evaluation | None:
    return _result(evidence, variant, f"X_lighting_{scenario}", role="extended")


def _result(
    evidence: Evidence,
    variant: str,
    dataset: str,
    *,
    role: str = "test",
    features: tuple[str, ...] = (),
) -> Evaluation | None:
    trained = evidence.variants.get(variant)
    if trained is None:
        return None
    for score in trained.scores:
        line = score.evaluation
        if (line.role, line.dataset, line.features) == (role, dataset, features):
            return score.result
    return None


def _rmse_ratio(
    result: Evaluation, first: NDArray[np.bool_], second: NDArray[np.bool_]
) -> float | None:
    if not first.any() or not second.any():
        return None
    errors = (rmse(result.observed[m], result.prediction.mean[m]) for m in (first, second))
    return next(errors) / next(errors)


SPECIAL_FIGURES: Final[Mapping[str, Callable[[Evidence, SensorKind], float | None]]] = {
    "brightness_lead": _brightness_lead,
    "depth_lead": _depth_lead,
    "slopes_over_plateau": _slopes_over_plateau,
    "quality_half_over_all": _quality_half,
    "quality_eighth_over_all": _quality_eighth,
    "exposure_needs_more": _exposure_needs_more,
    "linear_at_one_place": _linear_at_one_place,
    "more_features_gain": _more_features_gain,
    "far_over_nearer": _far_over_nearer,
    "left_over_right": _left_over_right,
    "lighting_quality_spread": _lighting_quality_spread,
    "lighting_drift_least": _lighting_drift(min),
    "lighting_drift_most": _lighting_drift(max),
    "quality_bias_third_finish": _quality_bias_third_finish,
    "finish_sensitivity": _finish_sensitivity,
    "small_over_large": _small_over_large,
    "bright_stereo_lead": _bright_stereo_lead,
}
"""By the names that ``data/findings.toml`` uses."""
