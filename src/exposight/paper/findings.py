"""The paper's qualitative statements, each checked on this cell.

Statements, measures and thresholds stand in ``data/findings.toml`` and were written there before
any was evaluated. Most are a score of Tables 2 to 6, or a ratio or difference of two; what no table
holds is computed by `SPECIAL_FIGURES`: each takes the study and the sensor and returns a number, or
None where nothing can be computed; `InputError` means that the study lacks a dataset, a model or a
score.
"""

import operator
import tomllib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields
from functools import cache
from importlib.resources import files
from typing import Any, Final, Literal, TypeAlias

import numpy as np
import polars as pl
from numpy.typing import NDArray
from pydantic import TypeAdapter

from exposight.errors import InputError
from exposight.models import Evaluation
from exposight.paper.datasets import OUTSIDE, POSE, Dataset, inside_range
from exposight.paper.results import DependenceMatrix, Finding, Statement, StudyResult
from exposight.paper.study_settings import SensorKind
from exposight.paper.study_tables import published_scores
from exposight.paper.variants import EvaluationRole
from exposight.statistics import r2, rmse

_COMPARISONS: Final[Mapping[str, Callable[[float, float], bool]]] = {
    "≥": operator.ge,
    "≤": operator.le,
}
FIGURES: Final[Mapping[str, str]] = {
    "r2": "r2_percent",
    "rmse": "rmse",
    "coverage_2sigma": "coverage_2sigma_percent",
}
"""Columns of the score tables, by the names that ``data/findings.toml`` uses."""

_RULES: Final[Mapping[str, str]] = {
    "half": "at least half of the effect that the paper's figures show",
    "twice": "at most twice the deviation that the paper's figures show",
    "order": "the statement orders two things and gives no size, so the sign decides",
}
"""What the words for a threshold's reason stand for."""


@dataclass(frozen=True, kw_only=True)
class MeasuredStatement(Statement):
    """One entry of ``data/findings.toml``: a statement and how its figure is computed.

    Parameters
    ----------
    first, second : tuple of str
        Scores, as "variant dataset features figure".
    combine : {'value', 'ratio', 'difference'}
        Of each of `first` with its counterpart in `second`.
    pick : {'max', 'min'}
        Which of several counts.
    special : str
        Name in `SPECIAL_FIGURES`, instead of `first` and `second`.
    """

    first: tuple[str, ...] = ()
    second: tuple[str, ...] = ()
    combine: Literal["value", "ratio", "difference"] = "value"
    pick: Literal["max", "min"] = "max"
    special: str = ""

    def figure(self, lookup: Callable[[str], float | None]) -> float | None:
        """Return the figure from scores, or None where one is missing."""
        first, second = ([lookup(name) for name in names] for names in (self.first, self.second))
        pairs = list(zip(first, second or first, strict=True))
        values = [
            self._combined(one, other)
            for one, other in pairs
            if one is not None and other is not None
        ]
        if len(values) < len(pairs) or not values:
            return None
        return max(values) if self.pick == "max" else min(values)

    def _combined(self, one: float, other: float) -> float:
        match self.combine:
            case "ratio":
                return one / other
            case "difference":
                return one - other
        return one


@cache
def statements() -> tuple[MeasuredStatement, ...]:
    """Return all statements, in the paper's order."""
    text = files("exposight.paper").joinpath("data", "findings.toml").read_text(encoding="utf-8")
    entries = tomllib.loads(text)["findings"]
    return TypeAdapter(tuple[MeasuredStatement, ...]).validate_python(entries)


def judge(study: StudyResult) -> tuple[Finding, ...]:
    """Decide for each of the paper's statements whether it holds in a study.

    Parameters
    ----------
    study : StudyResult
        Everything but its findings. Statements about other sensors are left out; explanations are
        known for the simulated cell only.

    Returns
    -------
    tuple of Finding
        In the paper's order.
    """
    ours = {
        (row["variant"], row["dataset"], row["features"]): row
        for row in study.tables.scores.iter_rows(named=True)
    }
    return tuple(
        _finding(entry, study, lambda name: _figure(name, ours))
        for entry in statements()
        if entry.sensor in study.settings.sensors
    )


def _finding(
    entry: MeasuredStatement, study: StudyResult, lookup: Callable[[str], float | None]
) -> Finding:
    figure = _special(entry, study) if entry.special else entry.figure(lookup)
    holds = None if figure is None else _COMPARISONS[entry.comparison](figure, entry.threshold)
    explained = study.settings.campaigns is None and holds is False
    reason, mark, rest = entry.reason.partition(";")
    statement = {field.name: getattr(entry, field.name) for field in fields(Statement)}
    changed = {
        "reason": _RULES.get(reason, reason) + mark + rest,
        "explanation": entry.explanation if explained else "",
        "paper_figure": paper_figure(entry),
    }
    return Finding(**statement | changed, figure=figure, holds=holds)


def _special(entry: MeasuredStatement, study: StudyResult) -> float | None:
    try:
        return SPECIAL_FIGURES[entry.special](study, entry.sensor)
    except InputError:  # the study lacks a dataset, a model or a score that it needs
        return None


def paper_figure(entry: MeasuredStatement) -> float | None:
    """Return a statement's figure from the paper's numbers; None where it does not print them."""
    if entry.paper_figure is not None:
        return entry.paper_figure
    return entry.figure(lambda name: _figure(name, published_scores()))


def _figure(
    name: str, scores: Mapping[tuple[str, str, str], Mapping[str, float | None]]
) -> float | None:
    variant, dataset, features, figure = name.split()
    return scores.get((variant, dataset, features), {}).get(FIGURES[figure])


SpecialFigure: TypeAlias = Callable[[StudyResult, SensorKind], float | None]

_PLATEAU = (30.0, 110.0)
"""Grey levels between which p_norm neither rises nor falls (Figs. 10, 11)."""
_FAR_MM = 75.0
"""z that divides the far depth plane from the others, midway between Table 9's ranges."""
_SMALL_MM = 10.0
"""Radius below which a feature counts as small; Fig. 4's lie between 3 and 30 mm."""
_BRIGHT = 200.0
_LEAST_OBSERVATIONS = 4
"""Fewer do not show whether they follow a line."""


def _brightness_lead(study: StudyResult, sensor: SensorKind) -> float:
    matrix = _dependence(study, sensor)
    return matrix.between("i_avg", "p_norm") - max(matrix.between(c, "p_norm") for c in POSE)


def _depth_lead(study: StudyResult, sensor: SensorKind) -> float:
    matrix = _dependence(study, sensor)
    sideways = max(matrix.between(column, "exposure_ms") for column in ("x_mm", "y_mm"))
    return matrix.between("z_mm", "exposure_ms") - sideways


def _dependence(study: StudyResult, sensor: SensorKind) -> DependenceMatrix:
    return study.dependence_in("s2_X" if sensor == "stereo" else "X")


def _slopes_over_plateau(study: StudyResult, _: SensorKind) -> float | None:
    result = _result(study, "q_k4", "X_test")
    i_avg = result.table.array(["i_avg"])[:, 0]
    plateau = (i_avg >= _PLATEAU[0]) & (i_avg <= _PLATEAU[1])
    return _rmse_ratio(result, ~plateau, plateau)


def _cost_of_fewer(variant: str, divisor: int) -> SpecialFigure:
    """RMSE of a variant trained on a fraction of the rows over that of all."""

    def figure(study: StudyResult, _: SensorKind) -> float | None:
        steps = study.learning_curve(variant).steps
        for step in steps:
            if step.n_train == steps[-1].n_train // divisor:
                return step.score.rmse / steps[-1].score.rmse
        return None

    return figure


def _exposure_needs_more(study: StudyResult, sensor: SensorKind) -> float | None:
    exposure, quality = (_cost_of_fewer(name, 2)(study, sensor) for name in ("e_k6", "q_k4"))
    return None if exposure is None or quality is None else exposure / quality


def _linear_at_one_place(study: StudyResult, sensor: SensorKind) -> float | None:
    dataset = study.dataset("s2_eX" if sensor == "stereo" else "eX")
    shares = []
    for _, place in dataset.table.frame.group_by("feature", "view", maintain_order=True):
        i_avg, exposure_ms = (place[name].to_numpy() for name in ("i_avg", "exposure_ms"))
        if len(place) >= _LEAST_OBSERVATIONS and np.ptp(i_avg) > 0:
            line = np.polynomial.Polynomial.fit(i_avg, exposure_ms, 1)
            shares.append(100.0 * r2(exposure_ms, line(i_avg)))
    return float(np.median(shares)) if shares else None


def _more_features_gain(study: StudyResult, _: SensorKind) -> float | None:
    """Both models on the same rows: those inside the range of the nine features."""
    four, nine = (study.variant(name) for name in ("e_k4", "e_k4_plus"))
    train, test = study.dataset("eX_plus").train, study.dataset("eX_test").table
    if train is None:
        return None
    inside = test.where(inside_range(train, test, POSE))
    if len(inside) == 0:
        return None
    errors = (
        rmse(item.variant.specification.data(inside)[1], item.model.predict(inside).mean)
        for item in (four, nine)
    )
    return next(errors) / next(errors)


def _far_over_nearer(study: StudyResult, _: SensorKind) -> float | None:
    result = _result(study, "e_k6", "eX_test", role="test_inside")
    far = result.table.array(["z_mm"])[:, 0] > _FAR_MM
    return _rmse_ratio(result, far, ~far)


def _left_over_right(study: StudyResult, _: SensorKind) -> float:
    model = study.variant("e_k6").model
    values: dict[str, Any] = {"i_avg": 75.0, "z_mm": 0.0, "w_deg": 0.0, "p_deg": 0.0}

    def mean_ms(x_mm: float) -> float:
        prediction = model.predict(**values, x_mm=x_mm, y_mm=np.array([-100.0, 0.0, 100.0]))
        return float(prediction.mean.mean())

    return mean_ms(-150.0) / mean_ms(150.0)


def _lighting_quality_spread(study: StudyResult, _: SensorKind) -> float:
    errors = [_lighting(study, "q_k4", scenario).score.rmse for scenario in ("I", "II", "III")]
    return 100.0 * (max(errors) - min(errors))


def _lighting_drift(pick: Callable[[float, float], float]) -> SpecialFigure:
    def figure(study: StudyResult, _: SensorKind) -> float | None:
        known, second, third = (_lighting(study, "e_k6", name) for name in ("I", "II", "III"))
        drifts = _drift_ms(known, second), _drift_ms(known, third)
        return None if drifts[0] is None or drifts[1] is None else pick(drifts[0], drifts[1])

    return figure


def _drift_ms(known: Evaluation, other: Evaluation) -> float | None:
    """Mean signed error in another light minus that in the known, on rows that both have."""
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


def _quality_bias_third_finish(study: StudyResult, _: SensorKind) -> float:
    result = _result(study, "q_k4", "X_out", role="extended", features=OUTSIDE[3:])
    return float(100.0 * np.mean(result.prediction.mean - result.observed))


def _finish_sensitivity(study: StudyResult, _: SensorKind) -> float:
    results = (
        _result(study, "e_k6", "X_out", role="extended"),
        _result(study, "e_k6", "eX_test", role="test_inside"),
        _result(study, "q_k4", "X_out", role="extended"),
        _result(study, "q_k4", "X_test"),
    )
    errors = [result.score.rmse for result in results]
    return (errors[0] / errors[1]) / (errors[2] / errors[3])


def _small_over_large(study: StudyResult, _: SensorKind) -> float | None:
    result = _result(study, "q_k4_s2", "s2_X_test")
    small = result.table.array(["radius_mm"])[:, 0] < _SMALL_MM
    return _rmse_ratio(result, small, ~small)


def _bright_stereo_lead(study: StudyResult, _: SensorKind) -> float | None:
    stereo, stripes = (_bright_p_norm(study.dataset(name)) for name in ("s2_X", "X"))
    return None if stereo is None or stripes is None else stereo - stripes


def _bright_p_norm(dataset: Dataset) -> float | None:
    bright = dataset.table.frame.filter(pl.col("i_avg") >= _BRIGHT)["p_norm"].to_numpy()
    return float(np.median(bright)) if len(bright) else None


def _lighting(study: StudyResult, variant: str, scenario: str) -> Evaluation:
    return _result(study, variant, f"X_lighting_{scenario}", role="extended")


def _result(
    study: StudyResult,
    variant: str,
    dataset: str,
    *,
    role: EvaluationRole = "test",
    features: tuple[str, ...] = (),
) -> Evaluation:
    score = study.variant(variant).score(role, dataset=dataset, features=features)
    if score.result is None:
        msg = f"there is no row of {dataset} to evaluate {variant} on"
        raise InputError(msg)
    return score.result


def _rmse_ratio(
    result: Evaluation, first: NDArray[np.bool_], second: NDArray[np.bool_]
) -> float | None:
    if not first.any() or not second.any():
        return None
    errors = (rmse(result.observed[m], result.prediction.mean[m]) for m in (first, second))
    return next(errors) / next(errors)


SPECIAL_FIGURES: Final[Mapping[str, SpecialFigure]] = {
    "brightness_lead": _brightness_lead,
    "depth_lead": _depth_lead,
    "slopes_over_plateau": _slopes_over_plateau,
    "quality_half_over_all": _cost_of_fewer("q_k4", 2),
    "quality_eighth_over_all": _cost_of_fewer("q_k4", 8),
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
