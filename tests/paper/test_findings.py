"""Statements: their data, and their decision on hand-made scores."""

from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest

from exposight.errors import InputError
from exposight.models import Evaluation, Prediction
from exposight.observing import ObservationTable
from exposight.paper import (
    Dataset,
    DependenceMatrix,
    EvaluationRole,
    EvaluationSet,
    Finding,
    LearningCurve,
    LearningStep,
    Score,
    StudyResult,
    StudySettings,
    TrainedVariant,
)
from exposight.paper.findings import (
    FIGURES,
    SPECIAL_FIGURES,
    MeasuredStatement,
    judge,
    paper_figure,
    statements,
)
from exposight.paper.study_tables import published_scores
from exposight.paper.variants import VARIANTS
from exposight.statistics import RegressionScore, score

Study = Callable[..., StudyResult]


def row(variant: str, dataset: str, rmse: float, r2: float = 90.0) -> dict[str, Any]:
    return {
        "variant": variant,
        "dataset": dataset,
        "features": "f1-4_test" if "test" in dataset else "f1-4",
        "r2_percent": r2,
        "rmse": rmse,
        "coverage_2sigma_percent": 95.0,
    }


@pytest.fixture
def judged(study: Study, tmp_path: Path) -> Callable[..., Finding]:
    """Return a statement's finding from scores and other parts of a study."""

    def find(
        name: str, scores: Iterable[dict[str, Any]] = (), *, simulated: bool = False, **parts: Any
    ) -> Finding:
        settings = StudySettings(campaigns=None if simulated else tmp_path)
        findings = judge(study(scores=list(scores), settings=settings, **parts))
        return next(finding for finding in findings if finding.name == name)

    return find


Judged = Callable[..., Finding]


@pytest.mark.parametrize(("q1", "holds"), [(14.0, True), (13.0, False)])
def test_a_ratio_decides(q1: float, holds: bool, judged: Judged) -> None:
    rows = [row("q_k1", "X1_test", q1), row("q_k4", "X4_test", 10.0)]
    finding = judged("brightness-alone-insufficient-for-quality", rows)
    assert (finding.figure, finding.holds) == (pytest.approx(q1 / 10), holds)


def test_a_value_decides(judged: Judged) -> None:
    finding = judged("light-alone-not-exposure", [row("e_k1", "eX1_test", 1.0, r2=60.0)])
    assert (finding.figure, finding.holds) == (60.0, False)


def test_the_smaller_of_two_differences_decides(judged: Judged) -> None:
    rows = [
        row("q_k2", "X2_test", 30.0),
        row("q_k2", "X2_val", 10.0),
        row("q_k3", "X3_test", 21.0),
        row("q_k3", "X3_val", 10.0),
    ]
    finding = judged("depth-and-x-overfit", rows)
    assert (finding.figure, finding.holds) == (11.0, False)


def test_without_its_rows_nothing_is_said(judged: Judged) -> None:
    finding = judged("position-generalises-quality", [])
    assert (finding.figure, finding.holds) == (None, None)


def test_statements_of_other_sensors_are_left_out(study: Study) -> None:
    findings = judge(study(settings=StudySettings(sensors=("stereo",))))
    assert findings
    assert {finding.sensor for finding in findings} == {"stereo"}


def test_the_papers_own_figures_stand_beside(judged: Judged) -> None:
    finding = judged("brightness-alone-insufficient-for-quality")
    assert finding.paper_figure == pytest.approx(18.44 / 10.49)


WITH_FIGURE = [entry for entry in statements() if paper_figure(entry) is not None]


@pytest.mark.parametrize("entry", WITH_FIGURE, ids=lambda entry: entry.name)
def test_every_statement_is_true_of_the_papers_own_figures(entry: MeasuredStatement) -> None:
    figure = paper_figure(entry)
    assert figure >= entry.threshold if entry.comparison == "≥" else figure <= entry.threshold


def test_half_means_half_of_the_papers_effect() -> None:
    for entry in statements():
        if entry.reason == "half":
            none = 1.0 if entry.combine == "ratio" or entry.special else 0.0
            half = (paper_figure(entry) - none) / 2
            # Written with two digits after the point.
            assert entry.threshold - none == pytest.approx(half, abs=0.08), entry.name


@pytest.mark.parametrize("entry", statements(), ids=lambda entry: entry.name)
def test_every_statement_has_a_figure_that_can_be_computed(entry: MeasuredStatement) -> None:
    assert bool(entry.special) != bool(entry.first)
    assert not entry.special or entry.special in SPECIAL_FIGURES
    assert len(entry.second) in {0, len(entry.first)}
    assert bool(entry.second) == (entry.combine != "value")
    for name in (*entry.first, *entry.second):
        *line, figure = name.split()
        assert tuple(line) in published_scores()
        assert figure in FIGURES


def test_explanations_are_for_the_simulated_cell_alone(judged: Judged) -> None:
    rows = [row("e_k6_plus", "eX6_test_i", 9.0), row("e_k6_plusplus", "eX6_test_i", 10.0)]
    assert judged("finer-grid-helps", rows, simulated=False).explanation == ""
    assert judged("finer-grid-helps", rows, simulated=True).explanation != ""


def test_no_explanation_where_a_statement_holds(judged: Judged) -> None:
    rows = [row("e_k6_plus", "eX6_test_i", 20.0), row("e_k6_plusplus", "eX6_test_i", 10.0)]
    finding = judged("finer-grid-helps", rows, simulated=True)
    assert finding.holds
    assert finding.explanation == ""


def test_names_are_unique() -> None:
    names = [entry.name for entry in statements()]
    assert len(names) == len(set(names))


def test_dependence_of_brightness_leads(judged: Judged) -> None:
    columns = ("p_norm", "exposure_ms", "i_avg", "x_mm", "y_mm", "z_mm", "w_deg", "p_deg")
    values = np.eye(len(columns))
    values[0, 2] = values[2, 0] = 0.9
    values[0, 5] = values[5, 0] = 0.3
    matrix = DependenceMatrix(dataset="X", columns=columns, values=values)
    finding = judged("brightness-matters-most", dependence=(matrix,))
    assert finding.figure == pytest.approx(0.6)


def curve(variant: str, errors: dict[int, float]) -> LearningCurve:
    return LearningCurve(
        variant=variant,
        dataset="X_test",
        role="test",
        steps=tuple(
            LearningStep(
                n_train=n,
                score=RegressionScore(
                    n=9,
                    r2_percent=0.0,
                    mse=error**2,
                    rmse=error,
                    mae=error,
                    coverage_1sigma=None,
                    coverage_2sigma=None,
                ),
            )
            for n, error in errors.items()
        ),
    )


def test_learning_with_half_of_the_rows_is_compared_with_all(judged: Judged) -> None:
    learning = curve("q_k4", {25: 0.3, 100: 0.22, 201: 0.2})
    finding = judged("quality-learning-converges", learning_curves=(learning,))
    assert (finding.figure, finding.holds) == (pytest.approx(1.1), True)


Observe = Callable[..., ObservationTable]


def predicted(
    variant: str, lines: dict[str, tuple[ObservationTable, np.ndarray]], role: EvaluationRole
) -> TrainedVariant:
    """Return a variant that errs by these errors on these rows, by dataset; it has no model."""
    own = next(own for own in VARIANTS if own.name == variant)
    scores = []
    for dataset, (table, error) in lines.items():
        observed = own.specification.data(table)[1]
        mean = observed + error
        scores.append(
            Score(
                evaluation=EvaluationSet(
                    table=2, dataset=dataset, role=role, paper_dataset="", paper_features=""
                ),
                result=Evaluation(
                    model=own.specification,
                    table=table,
                    observed=observed,
                    prediction=Prediction(
                        mean=mean, std=np.ones(len(mean)), inside=np.ones(len(mean), dtype=np.bool_)
                    ),
                    score=score(observed, mean),
                    score_inside=None,
                ),
            )
        )
    return TrainedVariant(variant=own, model=None, scores=tuple(scores))


Figure = Callable[..., float | None]


@pytest.fixture
def figure(study: Callable[..., StudyResult]) -> Figure:
    """Return a special figure of a study that has these variants and datasets."""

    def compute(
        name: str, *variants: TrainedVariant, datasets: tuple[Dataset, ...] = ()
    ) -> float | None:
        parts = study(variants=variants, datasets=datasets)
        return SPECIAL_FIGURES[name](parts, "structured-light")

    return compute


def dataset(name: str, table: ObservationTable) -> Dataset:
    return Dataset(
        name=name,
        title="",
        sensor="structured-light",
        features=(),
        p_norm_min=None,
        table=table,
    )


@pytest.mark.parametrize("name", SPECIAL_FIGURES)
def test_nothing_is_said_without_evidence(name: str, figure: Figure) -> None:
    with pytest.raises(InputError, match="the study has no"):
        figure(name)


def test_slopes_err_three_times_as_much(observe: Observe, figure: Figure) -> None:
    table = observe(["f1_test"])
    i_avg = table.array(["i_avg"])[:, 0]
    error = np.where((i_avg >= 30) & (i_avg <= 110), 0.1, -0.3)
    variant = predicted("q_k4", {"X_test": (table, error)}, "test")
    assert figure("slopes_over_plateau", variant) == pytest.approx(3.0)


def test_the_far_plane_errs_twice_as_much(observe: Observe, figure: Figure) -> None:
    table = observe(["f1_test"])
    error = np.where(table.array(["z_mm"])[:, 0] > 75, 8.0, 4.0)
    variant = predicted("e_k6", {"eX_test": (table, error)}, "test_inside")
    assert figure("far_over_nearer", variant) == pytest.approx(2.0)


def test_small_features_err_twice_as_much(observe: Observe, figure: Figure) -> None:
    table = observe([f"f{i}" for i in range(1, 10)])  # radii 3 to 11 mm
    error = np.where(table.array(["radius_mm"])[:, 0] < 10, 0.2, 0.1)
    variant = predicted("q_k4_s2", {"s2_X_test": (table, error)}, "test")
    assert figure("small_over_large", variant) == pytest.approx(2.0)


@pytest.fixture
def lit(observe: Observe) -> TrainedVariant:
    """Errs by 5 ms in lighting I, 7 in II, 8 in III; II lacks a row."""
    table = observe(["f1_test", "f2_test"], views=1)
    fewer = ObservationTable(frame=table.frame[1:])
    return predicted(
        "e_k6",
        {
            "X_lighting_I": (table, np.full(len(table), 5.0)),
            "X_lighting_II": (fewer, np.full(len(fewer), 7.0)),
            "X_lighting_III": (table, np.full(len(table), 8.0)),
        },
        "extended",
    )


def test_drift_is_the_mean_error_beyond_that_in_known_light(
    lit: TrainedVariant, figure: Figure
) -> None:
    assert figure("lighting_drift_least", lit) == pytest.approx(2.0)
    assert figure("lighting_drift_most", lit) == pytest.approx(3.0)


def test_drift_is_judged_on_rows_that_both_have(observe: Observe, figure: Figure) -> None:
    table = observe(["f1_test"], views=1)
    fewer = ObservationTable(frame=table.frame[1:])
    error = np.zeros(len(table))
    error[0] = 1000.0
    lines = {
        "X_lighting_I": (table, error),
        "X_lighting_II": (fewer, np.ones(len(fewer))),
        "X_lighting_III": (fewer, np.ones(len(fewer))),
    }
    assert figure("lighting_drift_most", predicted("e_k6", lines, "extended")) == pytest.approx(1.0)


def test_a_line_through_one_place_explains_everything(observe: Observe, figure: Figure) -> None:
    # In the cell on paper brightness is proportional to exposure time until it clips at 255.
    table = observe(["f1"])
    unclipped = ObservationTable(frame=table.frame.filter(pl.col("i_avg") < 255))
    found = figure("linear_at_one_place", datasets=(dataset("eX", unclipped),))
    assert found == pytest.approx(100.0)


def test_bright_stereo_is_compared_with_bright_structured_light(
    observe: Observe, figure: Figure
) -> None:
    bright = observe(["f1"]).frame.with_columns(i_avg=pl.lit(220.0))
    both = tuple(
        dataset(name, ObservationTable(frame=bright.with_columns(p_norm=pl.lit(p_norm))))
        for name, p_norm in (("s2_X", 0.4), ("X", 0.1))
    )
    assert figure("bright_stereo_lead", datasets=both) == pytest.approx(0.3)
