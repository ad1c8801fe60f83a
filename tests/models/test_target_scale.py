"""Models of a target's logarithm: above 0, with bands of constant ratio, in the target's unit."""

from dataclasses import replace

import numpy as np
import polars as pl
import pytest

from exposight.errors import InputError, ObservationError
from exposight.models import evaluate, load_model, model_named, save_model

E_K1 = model_named("e_k1")
LOGARITHMIC = replace(E_K1, name="e_log", target_scale="log")
FAR = {"i_avg": [1.0, 120.0, 250.0]}


@pytest.fixture
def model(trained, table):
    return trained(LOGARITHMIC, table)


def test_moments_and_band_are_those_of_draws(model):
    prediction = model.predict(**FAR)
    x = np.array(FAR["i_avg"])[:, None]
    log = model.process.predict(x, include_noise=True)
    draws = np.exp(np.random.default_rng(1).normal(log.mean, log.std, size=(200_000, 3)))
    np.testing.assert_allclose(prediction.mean, draws.mean(axis=0), rtol=0.02)
    np.testing.assert_allclose(prediction.std, draws.std(axis=0), rtol=0.1)
    low, high = np.quantile(draws, [0.02275, 0.97725], axis=0)
    np.testing.assert_allclose([prediction.low, prediction.high], [low, high], rtol=0.03)


def test_predictions_are_above_0_and_bands_are_wider_above(model):
    prediction = model.predict(**FAR)
    assert np.all(prediction.low > 0.0)
    assert np.all(prediction.high - prediction.mean > prediction.mean - prediction.low)


def test_what_it_learnt_is_told_in_the_targets_unit(model, table):
    exposures = model.specification.rows(table).frame["exposure_ms"].to_numpy()
    np.testing.assert_allclose(model.training_data["exposure_ms"], exposures)
    assert model.target_range == pytest.approx((exposures.min(), exposures.max()))
    units = {each.name: each.unit for each in model.hyperparameters()}
    assert units["exponential.variance"] == units["noise_variance"] == ""


def test_more_observations_are_learnt_on_the_same_scale(model, make_table):
    more = make_table(30, seed=4)
    learnt = model.with_observations(more).training_data["exposure_ms"]
    added = LOGARITHMIC.rows(more).frame["exposure_ms"].to_numpy()
    np.testing.assert_allclose(learnt[-len(added) :], added)


def test_it_comes_back_from_its_file(model, tmp_path):
    save_model(path := tmp_path / "m.exposight-model", model)
    again = load_model(path)
    assert again.specification == model.specification
    for name in ("mean", "std", "low", "high"):
        np.testing.assert_array_equal(
            getattr(again.predict(**FAR), name), getattr(model.predict(**FAR), name)
        )


def test_an_evaluation_counts_what_lies_within_the_band(model, make_table):
    evaluation = evaluate(model, make_table(200, seed=9))
    prediction, observed = evaluation.prediction, evaluation.observed
    share = np.mean((prediction.low <= observed) & (observed <= prediction.high))
    assert evaluation.score.coverage_2sigma == share


def test_a_target_without_a_logarithm_is_refused(trained, table):
    quality = replace(model_named("q_k1"), target_scale="log")
    without_points = replace(table, frame=table.frame.with_columns(p_norm=pl.lit(0.0)))
    with pytest.raises(ObservationError, match="p_norm, which must be above 0, got 0"):
        trained(quality, without_points)


def test_another_scale_is_refused():
    with pytest.raises(InputError, match="one of linear, log, got 'cubic'"):
        replace(E_K1, target_scale="cubic")
