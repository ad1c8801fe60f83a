"""Figures that no table holds, on hand-made predictions."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import polars as pl
import pytest

from exposight.models import Evaluation, Prediction
from exposight.observing import ObservationTable
from exposight.paper import Dataset, EvaluationRole, EvaluationSet, Score, TrainedVariant
from exposight.paper.special_findings import SPECIAL_FIGURES, Evidence
from exposight.paper.variants import VARIANTS
from exposight.statistics import score

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
                variant=variant,
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
                score=score(observed, mean),
                relative_error_percent=None,
            )
        )
    return TrainedVariant(variant=own, model=None, path=Path("model"), scores=tuple(scores))


def figure(
    name: str, *variants: TrainedVariant, datasets: dict[str, Dataset] | None = None
) -> float:
    evidence = Evidence(
        datasets=datasets or {},
        variants={own.variant.name: own for own in variants},
        dependence={},
        learning={},
    )
    return SPECIAL_FIGURES[name](evidence, "structured-light")


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
def test_nothing_is_said_without_evidence(name: str) -> None:
    assert figure(name) is None


def test_slopes_err_three_times_as_much(observe: Observe) -> None:
    table = observe(["f1_test"])
    i_avg = table.array(["i_avg"])[:, 0]
    error = np.where((i_avg >= 30) & (i_avg <= 110), 0.1, -0.3)
    variant = predicted("q_k4", {"X_test": (table, error)}, "test")
    assert figure("slopes_over_plateau", variant) == pytest.approx(3.0)


def test_the_far_plane_errs_twice_as_much(observe: Observe) -> None:
    table = observe(["f1_test"])
    error = np.where(table.array(["z_mm"])[:, 0] > 75, 8.0, 4.0)
    variant = predicted("e_k6", {"eX_test": (table, error)}, "test_inside")
    assert figure("far_over_nearer", variant) == pytest.approx(2.0)


def test_small_features_err_twice_as_much(observe: Observe) -> None:
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


def test_drift_is_the_mean_error_beyond_that_in_known_light(lit: TrainedVariant) -> None:
    assert figure("lighting_drift_least", lit) == pytest.approx(2.0)
    assert figure("lighting_drift_most", lit) == pytest.approx(3.0)


def test_drift_is_judged_on_rows_that_both_have(observe: Observe) -> None:
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


def test_a_line_through_one_place_explains_everything(observe: Observe) -> None:
    # In the cell on paper brightness is proportional to exposure time until it clips at 255.
    table = observe(["f1"])
    unclipped = ObservationTable(frame=table.frame.filter(pl.col("i_avg") < 255))
    found = figure("linear_at_one_place", datasets={"eX": dataset("eX", unclipped)})
    assert found == pytest.approx(100.0)


def test_bright_stereo_is_compared_with_bright_structured_light(observe: Observe) -> None:
    bright = observe(["f1"]).frame.with_columns(i_avg=pl.lit(220.0))
    both = {
        name: dataset(name, ObservationTable(frame=bright.with_columns(p_norm=pl.lit(p_norm))))
        for name, p_norm in (("s2_X", 0.4), ("X", 0.1))
    }
    assert figure("bright_stereo_lead", datasets=both) == pytest.approx(0.3)
