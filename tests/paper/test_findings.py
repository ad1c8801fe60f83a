"""Statements: their data, and their judgement on hand-made rows."""

from collections.abc import Iterable

import numpy as np
import pytest

from exposight.paper import DependenceMatrix, Finding, LearningCurve, LearningStep, ScoreRow
from exposight.paper.findings import judge, statements
from exposight.paper.results import SENSOR_KINDS
from exposight.paper.special_findings import Evidence

NOTHING = Evidence(datasets={}, variants={}, dependence={}, learning={})


def row(variant: str, dataset: str, rmse: float, r2: float = 90.0) -> ScoreRow:
    return ScoreRow(
        table=2,
        variant=variant,
        variant_title="",
        trained_on="X",
        n_train=1,
        dataset=dataset,
        role="test",
        features="f1-4_test" if "test" in dataset else "f1-4",
        n=10,
        unit="%",
        r2_percent=r2,
        mse=None,
        rmse=rmse,
        mae=None,
        relative_error_percent=None,
        coverage_1sigma_percent=None,
        coverage_2sigma_percent=95.0,
        paper_r2_percent=None,
        paper_mse=None,
        paper_rmse=None,
        r2_difference=None,
        rmse_difference=None,
    )


def judged(
    name: str, rows: Iterable[ScoreRow], evidence: Evidence = NOTHING, *, simulated: bool = False
) -> Finding:
    findings = judge(rows, evidence, SENSOR_KINDS, simulated=simulated)
    return next(own for own in findings if own.name == name)


@pytest.mark.parametrize(("q1", "holds"), [(14.0, True), (13.0, False)])
def test_a_ratio_decides(q1: float, holds: bool) -> None:
    rows = [row("q_k1", "X1_test", q1), row("q_k4", "X4_test", 10.0)]
    finding = judged("brightness-alone-insufficient-for-quality", rows)
    assert (finding.figure, finding.holds) == (pytest.approx(q1 / 10), holds)


def test_a_value_decides() -> None:
    finding = judged("light-alone-not-exposure", [row("e_k1", "eX1_test", 1.0, r2=60.0)])
    assert (finding.figure, finding.holds) == (60.0, False)


def test_the_smaller_of_two_differences_decides() -> None:
    rows = [
        row("q_k2", "X2_test", 30.0),
        row("q_k2", "X2_val", 10.0),
        row("q_k3", "X3_test", 21.0),
        row("q_k3", "X3_val", 10.0),
    ]
    finding = judged("depth-and-x-overfit", rows)
    assert (finding.figure, finding.holds) == (11.0, False)


def test_without_its_rows_nothing_is_said() -> None:
    finding = judged("position-generalises-quality", [])
    assert (finding.figure, finding.holds) == (None, None)


def test_statements_of_other_sensors_are_left_out() -> None:
    findings = judge([], NOTHING, ["stereo"], simulated=False)
    assert findings
    assert {own.sensor for own in findings} == {"stereo"}


def test_the_papers_own_figures_stand_beside() -> None:
    finding = judged("brightness-alone-insufficient-for-quality", [])
    assert finding.paper_figure == pytest.approx(18.44 / 10.49)


WITH_FIGURE = [
    entry
    for entry in judge([], NOTHING, SENSOR_KINDS, simulated=False)
    if entry.paper_figure is not None  # the paper prints none for the others
]


@pytest.mark.parametrize("entry", WITH_FIGURE)
def test_every_statement_is_true_of_the_papers_own_figures(entry: Finding) -> None:
    higher = entry.paper_figure >= entry.threshold
    lower = entry.paper_figure <= entry.threshold
    assert higher if entry.comparison == "≥" else lower


def test_half_means_half_of_the_papers_effect() -> None:
    for entry in statements():
        if entry.reason != "half":
            continue
        paper = judged(entry.name, []).paper_figure
        none = 1.0 if entry.combine == "ratio" or entry.special else 0.0
        # Written with two digits after the point.
        assert entry.threshold - none == pytest.approx((paper - none) / 2, abs=0.08), entry.name


def test_explanations_are_for_the_simulated_cell_alone() -> None:
    rows = [row("q_k1", "X1_test", 10.0), row("q_k4", "X4_test", 10.0)]
    name = "brightness-alone-insufficient-for-quality"
    assert judged(name, rows, simulated=False).explanation == ""
    assert judged(name, rows, simulated=True).explanation != ""


def test_no_explanation_where_a_statement_holds() -> None:
    rows = [row("q_k1", "X1_test", 20.0), row("q_k4", "X4_test", 10.0)]
    name = "brightness-alone-insufficient-for-quality"
    assert judged(name, rows, simulated=True).explanation == ""


def test_names_are_unique() -> None:
    names = [entry.name for entry in statements()]
    assert len(names) == len(set(names))


def test_dependence_of_brightness_leads() -> None:
    columns = ("p_norm", "exposure_ms", "i_avg", "x_mm", "y_mm", "z_mm", "w_deg", "p_deg")
    values = np.eye(len(columns))
    values[0, 2] = values[2, 0] = 0.9
    values[0, 5] = values[5, 0] = 0.3
    matrix = DependenceMatrix(dataset="X", columns=columns, values=values)
    evidence = Evidence(
        datasets={}, variants={}, dependence={"structured-light": matrix}, learning={}
    )
    finding = judged("brightness-matters-most", [], evidence)
    assert finding.figure == pytest.approx(0.6)


def curve(variant: str, errors: dict[int, float]) -> LearningCurve:
    from exposight.statistics import RegressionScore

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


def test_learning_with_half_of_the_rows_is_compared_with_all() -> None:
    evidence = Evidence(
        datasets={},
        variants={},
        dependence={},
        learning={"q_k4": curve("q_k4", {25: 0.3, 100: 0.22, 201: 0.2})},
    )
    finding = judged("quality-learning-converges", [], evidence)
    assert (finding.figure, finding.holds) == (pytest.approx(1.1), True)
