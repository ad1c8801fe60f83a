"""The tables' lines against values computed by hand, on three observations."""

import csv
import io
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import polars as pl
import pytest

from exposight.gp import ChangePoint, Exponential, GaussianProcess, RationalQuadratic
from exposight.models import Evaluation, FitSummary, GaussianProcessModel, Prediction, Provenance
from exposight.observing import ObservationTable
from exposight.paper import Dataset, Score, StudyResult, TrainedVariant, Variant, table_files
from exposight.paper.study_tables import (
    dataset_table,
    hyperparameter_table,
    published_hyperparameters,
    published_scores,
    score_table,
    study_tables,
)
from exposight.paper.variants import VARIANTS
from exposight.statistics import score

THREE = 3


def variant(name: str) -> Variant:
    return next(variant for variant in VARIANTS if variant.name == name)


def model_of(own: Variant, at_bound: tuple[str, ...]) -> GaussianProcessModel:
    """A model of a variant, with hyperparameters chosen by hand."""
    inputs = len(own.specification.inputs)
    kernel = (
        RationalQuadratic(
            variance=0.5, length_scales=(2.0,) * inputs, alpha=0.25, dims=range(inputs)
        )
        * ChangePoint(dim=0, minimum=10.0)
        if own.unit == "%"
        else Exponential(variance=9.0, length_scales=(7.0,), dims=range(inputs))
    )
    return GaussianProcessModel(
        name=own.specification.name,
        title=own.specification.title,
        target=own.specification.target,
        inputs=own.specification.inputs,
        process=GaussianProcess.condition(
            kernel, 0.04, np.full((THREE, inputs), 50.0) + np.arange(THREE)[:, None], np.ones(THREE)
        ),
        summary=FitSummary(
            log_marginal_likelihood=0.0,
            converged=True,
            evaluations=1,
            starts=1,
            parameters_at_bound=at_bound,
        ),
        provenance=Provenance(
            observations="by hand",
            observations_sha256=None,
            emulated=False,
            seed=1,
            exposight_version="0",
        ),
        sensor=None,
    )


def trained(
    name: str,
    observed: list[float] | None = None,
    predicted: list[float] | None = None,
    *,
    std: float = 0.15,
    at_bound: tuple[str, ...] = (),
) -> TrainedVariant:
    """A variant whose one line under ``test`` has these predictions; without any, no rows."""
    own = variant(name)
    line = next(line for line in own.evaluations if line.role == "test")
    result = None
    if observed is not None and predicted is not None:
        mean, spread = np.array(predicted), np.full(len(predicted), std)
        result = Evaluation(
            model=own.specification,
            table=ObservationTable.from_observations([]),
            observed=np.array(observed),
            prediction=Prediction(mean=mean, std=spread, inside=np.ones(len(mean), dtype=np.bool_)),
            score=score(observed, mean, spread),
            score_inside=None,
        )
    scores = (Score(evaluation=line, result=result),)
    return TrainedVariant(variant=own, model=model_of(own, at_bound), scores=scores)


class Row:
    """A row's cells as attributes."""

    def __init__(self, cells: dict[str, object]) -> None:
        self.__dict__.update(cells)


def rows(frame: pl.DataFrame) -> list[Row]:
    return [Row(cells) for cells in frame.iter_rows(named=True)]


def the_row(trained: TrainedVariant) -> Row:
    (row,) = rows(score_table([trained]))
    return row


@pytest.fixture
def quality() -> Row:
    """Errors 0.1, 0, −0.2: their squares add up to 0.05, the observations' to 0.5."""
    return the_row(trained("q_k4", [0.0, 0.5, 1.0], [0.1, 0.5, 0.8]))


def test_r2_is_90_percent(quality: Row) -> None:
    assert quality.r2_percent == pytest.approx(90.0)


def test_mse_is_in_the_targets_unit(quality: Row) -> None:
    assert quality.mse == pytest.approx(0.05 / 3)


def test_rmse_of_p_norm_is_in_percent_of_full_scale(quality: Row) -> None:
    assert (quality.unit, quality.rmse) == ("%", pytest.approx(12.9099, abs=1e-4))


def test_mae_of_p_norm_is_in_percent_of_full_scale(quality: Row) -> None:
    assert quality.mae == pytest.approx(10.0)


def test_two_of_three_are_within_one_sigma_and_all_within_two(quality: Row) -> None:
    assert quality.coverage_1sigma_percent == pytest.approx(200 / 3)
    assert quality.coverage_2sigma_percent == 100.0


def test_differences_are_ours_less_the_papers(quality: Row) -> None:
    assert quality.r2_difference == pytest.approx(90.0 - 92.74)
    assert quality.rmse_difference == pytest.approx(12.9099 - 10.49, abs=1e-4)


def test_rmse_of_exposure_times_is_in_ms() -> None:
    row = the_row(trained("e_k1", [10.0, 20.0], [13.0, 16.0]))
    assert (row.unit, row.rmse) == ("ms", pytest.approx(12.5**0.5))


def test_a_line_without_rows_has_no_figures() -> None:
    row = the_row(trained("q_k4"))
    assert (row.n, row.r2_percent, row.rmse, row.r2_difference) == (0, None, None, None)
    assert row.paper_r2_percent == 92.74


def test_observations_all_alike_have_no_r2() -> None:
    row = the_row(trained("q_k4", [0.5, 0.5], [0.5, 0.6]))
    assert (row.r2_percent, row.r2_difference) == (None, None)


def test_lines_are_ordered_by_the_papers_tables() -> None:
    table = score_table([trained("e_k1"), trained("q_k1_s2"), trained("q_k4")])
    assert table["table"].to_list() == [2, 3, 5]


def test_length_scales_are_gpys() -> None:
    # ℓ √α = 2 · √0.25
    lines = rows(hyperparameter_table([trained("q_k4")]))
    scales = {row.input: row.value for row in lines if row.parameter == "length_scale"}
    assert scales == {"i_avg": 1.0, "z_mm": 1.0, "x_mm": 1.0, "y_mm": 1.0}


def test_length_scales_of_other_kernels_stay() -> None:
    lines = rows(hyperparameter_table([trained("e_k2")]))
    (row,) = (row for row in lines if row.parameter == "length_scale")
    assert (row.value, row.input, row.unit, row.paper_value) == (7.0, "all", "mixed", 1070.0)


def test_hyperparameters_stand_beside_the_papers() -> None:
    lines = rows(hyperparameter_table([trained("q_k4")]))
    assert [(row.symbol, row.input, row.paper_value) for row in lines] == [
        ("σ²", "", 1.45),
        ("ℓ", "i_avg", 1.06),
        ("ℓ", "z_mm", 52.0),
        ("ℓ", "x_mm", 18.0),
        ("ℓ", "y_mm", 33.0),
        ("α", "", 0.01),
        ("ε", "", 0.0),
    ]


def test_hyperparameters_at_a_limit_are_marked() -> None:
    lines = rows(hyperparameter_table([trained("q_k4", at_bound=("noise_variance",))]))
    assert [row.parameter for row in lines if row.at_bound] == ["noise_variance"]


@pytest.fixture
def x(observe: Callable[..., ObservationTable]) -> Dataset:
    return Dataset(
        name="X",
        title="four features",
        sensor="structured-light",
        features=("f1", "f2"),
        p_norm_min=None,
        table=observe(["f1", "f2"]),
    )


def test_x_is_counted_by_plane_and_as_a_whole(x: Dataset) -> None:
    lines = rows(dataset_table([x]))
    assert [(row.dataset, row.n, row.n_views) for row in lines] == [
        ("X near", 20, 2),
        ("X middle", 20, 2),
        ("X far", 20, 2),
        ("X", 60, 6),
    ]


def test_ranges_stand_beside_the_papers(x: Dataset) -> None:
    near = rows(dataset_table([x]))[0]
    assert (near.exposure_ms_low, near.exposure_ms_high) == (5.0, 80.0)
    assert (near.z_mm_low, near.z_mm_high) == (-165.0, -165.0)
    assert (near.paper_z_mm_low, near.paper_z_mm_high) == (-188.0, -149.0)


def test_an_empty_dataset_has_no_ranges(x: Dataset) -> None:
    empty = replace(x, name="X_out", table=ObservationTable.from_observations([]))
    (row,) = rows(dataset_table([empty]))
    assert (row.n, row.x_mm_low, row.paper_n) == (0, None, 240)


def test_csv_gives_the_same_numbers_back(study: Callable[..., StudyResult]) -> None:
    variants = trained("q_k4", [0.0, 0.5, 1.0], [0.1, 0.5, 0.8]), trained("q_k1")
    tables = study_tables([], variants)
    text = table_files(study(tables=tables))["table-2.csv"].decode()
    scored, without_rows = csv.DictReader(io.StringIO(text))
    assert float(scored["rmse"]) == tables.scores["rmse"][0]
    assert scored["variant"] == "q_k4"
    assert without_rows["r2_percent"] == ""


def test_table_2_gives_the_four_inputs_on_unseen_features() -> None:
    score = published_scores()["q_k4", "X4_test", "f1-4_test"]
    assert score == {"table": 2, "r2_percent": 92.74, "mse": 0.011, "rmse": 10.49}


def test_table_8_gives_the_product_of_both_variances() -> None:
    assert published_hyperparameters()["e_k6", "variance", ""] == 66 * 331


def test_every_line_of_the_papers_tables_has_its_variant() -> None:
    ours = {
        (variant.name, line.paper_dataset, line.paper_features)
        for variant in VARIANTS
        for line in variant.evaluations
    }
    assert set(published_scores()) <= ours


def test_every_line_stands_in_the_papers_table() -> None:
    published = published_scores()
    for variant in VARIANTS:
        for line in variant.evaluations:
            score = published.get((variant.name, line.paper_dataset, line.paper_features))
            assert score is None or score["table"] == line.table


def test_every_variant_has_hyperparameters_in_table_8() -> None:
    assert {variant.name for variant in VARIANTS} == {
        variant for variant, _, _ in published_hyperparameters()
    }
