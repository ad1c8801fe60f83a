"""Training, predictions and their flags, and what cannot be learnt from."""

from dataclasses import replace

import numpy as np
import polars as pl
import pytest

from exposight.cell import sensor_preset
from exposight.errors import ObservationError, SensorError
from exposight.gp import GaussianProcess
from exposight.models import MODELS, QUALITY_MODELS, evaluate, model_named
from exposight.observing import ObservationTable
from exposight.statistics import r2

LEAST_R2_PERCENT = 50.0
"""The 1D exposure-time model sees no distance, and so misses a third of the variance."""

all_models = pytest.mark.parametrize("specification", MODELS, ids=lambda model: model.name)


def changed(table, **columns):
    values = {name: pl.lit(value).cast(table.frame.schema[name]) for name, value in columns.items()}
    return ObservationTable(frame=table.frame.with_columns(**values))


# -- training -----------------------------------------------------------------------------------


@all_models
def test_every_model_learns_what_there_is_to_learn(trained, make_table, specification):
    model = trained(specification, make_table(80))
    held_out = evaluate(model, make_table(80, seed=1))
    assert held_out.score.r2_percent > LEAST_R2_PERCENT


@all_models
def test_the_same_seed_gives_the_same_model(trained, specification):
    one, other = (trained(specification, restarts=2) for _ in range(2))
    assert one.process.kernel == other.process.kernel
    assert one.process.noise_variance == other.process.noise_variance
    assert one.summary == other.summary


def test_another_seed_starts_elsewhere(trained):
    specification = model_named("e_k6_star")
    ends = {trained(specification, seed=seed, restarts=2).summary.evaluations for seed in range(4)}
    assert len(ends) > 1


def test_a_model_keeps_where_it_comes_from(trained, wide_sensor):
    model = trained(model_named("q_k1"), sensor=wide_sensor)
    assert model.sensor == wide_sensor
    assert model.provenance.observations == "synthetic.csv"
    assert model.provenance.observations_sha256 == "ab" * 32
    assert not model.provenance.emulated
    assert model.summary.starts == 1


def test_progress_is_told_after_each_start(trained):
    steps = []
    trained(model_named("e_k1"), restarts=2, progress=lambda *step: steps.append(step))
    starts = [step for step in steps if step[0] == "training e_k1"]
    assert starts == [("training e_k1", done, 2) for done in range(3)]
    assert len(steps) > len(starts), "evaluations within a start are told, too"


def test_rows_that_were_not_measured_are_left_out(trained, table):
    hidden = changed(table.where(np.arange(len(table)) < 10), visibility="facing away", p_norm=None)
    both = ObservationTable(frame=pl.concat([hidden.frame, table.frame]))
    assert len(trained(model_named("q_k1"), both).process.y) == len(table)


def test_exposure_time_models_are_trained_on_good_observations_alone(trained, table):
    n_good = int((table.array(["p_norm"]) >= 0.75).sum())
    assert len(trained(model_named("e_k1"), table).process.y) == n_good < len(table)


# -- learning more ------------------------------------------------------------------------------

# A few dozen observations whose noise is a thousandth of their variance.
ROUNDING = 1e-6


@all_models
def test_more_observations_count_as_if_they_had_been_there(trained, make_table, specification):
    model, more = trained(specification, make_table(60)), make_table(30, seed=3)
    learnt = model.with_observations(more).process
    x, y = specification.data(specification.rows(more))
    x, y = np.vstack([model.process.x, x]), np.append(model.process.y, y)
    afresh = GaussianProcess.condition(learnt.kernel, learnt.noise_variance, x, y)
    assert learnt.kernel == model.process.kernel
    np.testing.assert_allclose(learnt.predict(x).mean, afresh.predict(x).mean, rtol=ROUNDING)


def test_a_model_that_learnt_more_says_so(trained, make_table):
    model = trained(model_named("q_k4"))
    learnt = model.with_observations(changed(make_table(5), emulated=True))
    assert learnt.provenance.observations == "synthetic.csv; 5 more rows"
    assert learnt.provenance.observations_sha256 is None
    assert learnt.provenance.emulated
    assert learnt.summary.log_marginal_likelihood == learnt.process.log_marginal_likelihood
    assert not model.provenance.emulated


def test_observations_that_a_model_does_not_learn_from_change_nothing(trained, table):
    model = trained(model_named("e_k1"))
    assert model.with_observations(changed(table, p_norm=0.2)) is model


# -- predicting ---------------------------------------------------------------------------------


@pytest.mark.parametrize("specification", QUALITY_MODELS, ids=lambda model: model.name)
def test_below_ten_grey_levels_the_quality_is_exactly_zero(trained, specification):
    elsewhere = dict.fromkeys(specification.inputs[1:], 0.0)
    mean = trained(specification).predict(i_avg=[9.999, 10.0], **elsewhere).mean
    assert mean[0] == 0.0
    assert mean[1] != 0.0


def test_below_ten_grey_levels_only_the_noise_is_uncertain(trained):
    model = trained(model_named("q_k1"))
    noise_std = np.sqrt(model.process.noise_variance)
    assert model.predict(i_avg=5.0).std[0] == pytest.approx(noise_std, rel=1e-12)


def test_predictions_say_whether_they_lie_inside_the_training_range(trained):
    model = trained(model_named("q_k2"))
    ranges = model.training_range
    (i_low, i_high), (z_low, z_high) = ranges["i_avg"], ranges["z_mm"]
    i_avg = [i_low, (i_low + i_high) / 2, i_low - 0.01, i_high]
    z_mm = [z_high, (z_low + z_high) / 2, z_low, z_low - 0.01]
    assert model.predict(i_avg=i_avg, z_mm=z_mm).inside.tolist() == [True, True, False, False]


def test_the_training_range_is_that_of_the_rows_it_learnt_from(trained, table):
    model = trained(model_named("e_k2"), table)
    good = table.with_quality(0.75)
    for name, limits in model.training_range.items():
        column = good.array([name])[:, 0]
        assert limits == (column.min(), column.max())


def test_far_from_the_data_a_prediction_is_less_certain(trained):
    near, far = trained(model_named("q_k2")).predict(i_avg=120.0, z_mm=[0.0, 2000.0]).std
    assert far > near


# -- evaluating ---------------------------------------------------------------------------------


def test_an_evaluation_scores_the_rows_of_the_models_own_kind(trained, make_table):
    model, unseen = trained(model_named("e_k1")), make_table(40, seed=9)
    evaluation = evaluate(model, unseen)
    good = unseen.with_quality(0.75)
    predicted = model.predict(good).mean
    observed = good.array(["exposure_ms"])[:, 0]
    assert evaluation.score.n == len(good) < len(unseen)
    assert evaluation.score.r2_percent == pytest.approx(100 * r2(observed, predicted))


def test_rows_outside_the_training_range_are_scored_apart(trained, table):
    model = trained(model_named("e_k2"), table)
    outside = changed(table, z_mm=500.0)
    both = ObservationTable(frame=pl.concat([table.frame, outside.frame]))
    evaluation = evaluate(model, both)
    assert evaluation.score_inside is not None
    assert evaluation.score_inside.n == evaluation.score.n // 2
    assert evaluate(model, outside).score_inside is None


# -- what cannot be learnt from -----------------------------------------------------------------


def test_a_table_without_a_measured_row(trained, table):
    hidden = changed(table, visibility="out of frame", p_norm=None)
    with pytest.raises(
        ObservationError,
        match=r"cannot train q_k1: it needs measured observations, and none of the table's 60 rows "
        r"is one \(60 out of frame\)",
    ):
        trained(model_named("q_k1"), hidden)


def test_a_table_without_a_row_of_quality(trained, table):
    with pytest.raises(ObservationError, match=r"cannot train e_k1: .* p_norm ≥ 0\.75.*60 visible"):
        trained(model_named("e_k1"), changed(table, p_norm=0.5))


def test_an_empty_table(trained, table):
    with pytest.raises(ObservationError, match=r"none of the table's 0 rows is one \(no rows\)"):
        trained(model_named("q_k1"), table.where(np.zeros(len(table), dtype=bool)))


def test_nothing_to_evaluate(trained, table):
    model = trained(model_named("e_k1"))
    with pytest.raises(ObservationError, match="cannot evaluate e_k1"):
        evaluate(model, changed(table, p_norm=0.1))


@all_models
def test_fewer_observations_than_dimensions(trained, table, specification):
    few = len(specification.inputs) - 1 or 1
    good = table.with_quality(0.75).where(np.arange(len(table.with_quality(0.75))) < few)
    with pytest.raises(
        ObservationError, match=r"fewer observations than dimensions|at least two observations"
    ):
        trained(specification, good)


@pytest.mark.parametrize("name", ["q_k1", "e_k1"])
def test_observations_that_are_all_alike(trained, table, name):
    alike = changed(table, i_avg=100.0, p_norm=0.9, exposure_ms=10.0)
    with pytest.raises(ObservationError, match=r"all observations are alike: the .* rows hold"):
        trained(model_named(name), alike)


def test_exposure_times_that_the_sensor_cannot_take(trained, table):
    narrow = sensor_preset("rc-visard-65")
    with pytest.raises(SensorError, match="takes exposure times from"):
        trained(model_named("q_k1"), table, sensor=narrow)
    assert trained(model_named("q_k1"), changed(table, emulated=True), sensor=narrow)


@pytest.mark.parametrize("name", ["q_k1", "e_k1"])
def test_targets_that_are_all_alike(trained, table, name):
    alike = changed(table, p_norm=0.9, exposure_ms=10.0)
    with pytest.raises(
        ObservationError, match=r"all observations are alike: each of the .* targets"
    ):
        trained(model_named(name), alike)


def test_observations_that_are_all_dark(trained, table):
    with pytest.raises(ObservationError, match="i_avg is below grey level 10 in every row"):
        trained(model_named("q_k1"), changed(table, i_avg=5.0))


def test_a_specification_is_not_changed_by_training(trained):
    specification = model_named("e_k6_star")
    before = replace(specification)
    trained(specification)
    assert specification == before


def test_a_model_says_if_it_learnt_from_emulated_exposures(trained, make_table):
    table = make_table()
    emulated = ObservationTable(frame=table.frame.with_columns(emulated=True))
    assert trained(model_named("q_k1"), emulated).provenance.emulated


def test_a_notebook_shows_hyperparameters_and_no_tags_from_names(trained):
    model = replace(trained(model_named("q_k1")), title="<b>quality</b>")
    shown = model._repr_html_()
    assert "<b>" not in shown
    for each in model.hyperparameters():
        assert each.name in shown


def test_rows_beyond_the_training_data_say_which_inputs_are(trained):
    model = trained(model_named("e_k2"))
    ranges = model.training_range
    middle = {name: 0.5 * (low + high) for name, (low, high) in ranges.items()}
    first, second = model.inputs
    rows = pl.DataFrame(
        [
            middle,
            {**middle, second: ranges[second][1] + 1.0},
            {first: ranges[first][0] - 1.0, second: ranges[second][1] + 1.0},
        ]
    )
    assert model.unknown(rows) == (
        "",
        f"{second} outside the training data",
        f"{first}, {second} outside the training data",
    )
