"""The default pair: a window model and its radiance model, in a world of two formulas."""

from dataclasses import replace

import numpy as np
import polars as pl
import pytest

from exposight.cell import sensor_preset
from exposight.errors import InputError, ObservationError
from exposight.models import RadianceModel, WindowModel, load_model
from exposight.observing import ObservationTable
from exposight.planning import DEFAULT_MODELS, SensorModels, train


def test_they_are_trained_by_default_with_the_sensor_that_the_table_names(default_models):
    quality, exposure = default_models.quality, default_models.exposure
    assert (quality.name, exposure.name) == DEFAULT_MODELS
    assert isinstance(quality, WindowModel)
    assert exposure is quality.radiance
    assert default_models.sensor == sensor_preset("comet-pro-ae")


def test_exposure_times_quality_and_chance_are_the_worlds(default_models, view, capture, light):
    new = view("new", 600.0, 4.0, -3.0)
    forecast = default_models.forecast(new, (5.0, 40.0, 400.0))
    expected = 80.0 / light(new.frame)
    np.testing.assert_allclose(forecast.wanted_ms[:, 1], expected, rtol=0.05)
    low, _, high = forecast.wanted_ms.T
    assert (low > 0.0).all()
    assert np.mean((low < expected) & (expected < high)) >= 8 / 9
    measured = capture([new], (5.0, 40.0, 400.0)).frame["p_norm"].to_numpy().reshape(3, 9).T
    np.testing.assert_allclose(forecast.p_norm, measured, atol=0.05)
    np.testing.assert_allclose(forecast.chance, measured >= 0.75, atol=0.02)
    assert forecast.knows.all()
    assert set(forecast.source) == {"pose"}


def test_exposure_times_reach_from_too_short_to_too_long(default_models, view):
    forecast = default_models.forecast(view("new"))
    assert forecast.chance[:, 0].max() < 0.01
    assert forecast.chance[:, -1].max() < 0.01
    assert forecast.chance.max(axis=1).min() > 0.99
    settings = sensor_preset("comet-pro-ae").nearest_exposure
    assert all(settings(each) == each for each in forecast.exposures_ms)


def test_what_is_far_from_anything_learnt_is_said(default_models, view, monkeypatch):
    # In a world this smooth nothing lies a length scale from what was learnt.
    monkeypatch.setattr("exposight.models.abstaining.FAR", 0.0)
    forecast = default_models.forecast(view("away", 700.0, 20.0), (40.0,))
    assert not forecast.knows.any()
    assert "length scales from anything learnt; a capture of this view" in forecast.notes[0]


def test_another_finish_is_not_known(default_models, view):
    forecast = default_models.forecast(view("new", finish="paint"), (40.0,))
    assert not forecast.knows.any()
    assert "another finish: 'paint'" in forecast.notes[0]


def test_a_trial_makes_it_surer_and_names_a_view_without_a_name(default_models, view, capture):
    trial = capture([view("new")], (10.0,), seed=3)
    before = default_models.forecast(view("new"), (40.0,))
    after = default_models.forecast(view(""), (40.0,), trial=trial)
    width_before, width_after = (np.diff(each.wanted_ms[:, [0, 2]]) for each in (before, after))
    assert (width_after < width_before).all()
    assert set(after.source) == {"pose and image"}


def test_a_trial_tells_that_the_surface_is_another(default_models, view, capture):
    painted = capture([view("new", finish="paint")], (10.0,), seed=3)
    unlabelled = ObservationTable.from_frame(painted.frame.with_columns(finish=pl.lit("bare")))
    forecast = default_models.forecast(view("new"), (80.0,), trial=unlabelled)
    assert "not the surface that was learnt" in forecast.notes[0]
    np.testing.assert_allclose(forecast.wanted_ms[:, 1], 160.0, rtol=0.1)


def test_a_trial_of_two_views_needs_to_be_told_which(default_models, view, capture):
    trial = capture([view("one"), view("two", 650.0)], (10.0,))
    with pytest.raises(InputError, match=r"2 views \(one, two\), and the view to forecast has no"):
        default_models.forecast(view(""), (40.0,), trial=trial)
    default_models.forecast(view("one"), (40.0,), trial=trial)


def test_another_sensor_or_tcp_is_refused(default_models, view):
    sensor = sensor_preset("comet-pro-ae")
    tcp = replace(sensor, camera_from_tcp=view("").features[0].camera_from_feature)
    with pytest.raises(ObservationError, match="another sensor: 'mine'"):
        default_models.forecast(view("new", sensor=replace(sensor, name="mine")), (40.0,))
    with pytest.raises(ObservationError, match="another tool centre point"):
        default_models.forecast(view("new", sensor=tcp), (40.0,))


def test_a_new_finish_keeps_the_limits_of_the_sensor(default_models, view, capture):
    painted = capture([view("p1", finish="paint"), view("p2", 550.0, finish="paint")], (20.0,))
    models = train(painted, start_from=default_models.quality)
    assert models.quality.limits == default_models.quality.limits
    new = view("new", 600.0, 2.0, 2.0, finish="paint")
    forecast = models.forecast(new, (160.0,))
    assert forecast.knows.all()
    np.testing.assert_allclose(forecast.wanted_ms[:, 1], 160.0, rtol=0.1)


def test_more_observations_are_learnt(default_models, view, capture):
    away = view("away", 750.0, 30.0, 0.0)
    more = default_models.with_observations(capture([away], (20.0, 60.0)))
    before, after = (
        np.diff(each.forecast(away, (40.0,)).wanted_ms[:, [0, 2]])
        for each in (default_models, more)
    )
    assert (after < before).all()
    assert more.exposure is more.quality.radiance


def test_both_are_kept_and_the_quality_models_file_suffices(default_models, view, tmp_path):
    paths = default_models.save(tmp_path)
    assert [path.stem for path in paths] == list(DEFAULT_MODELS)
    expected = default_models.forecast(view("new"), (40.0,)).p_norm
    for given in ((tmp_path,), (paths[0],), paths, paths[::-1]):
        found = SensorModels.load(*given).forecast(view("new"), (40.0,))
        np.testing.assert_allclose(found.p_norm, expected, atol=1e-9)
    assert isinstance(load_model(paths[1]), RadianceModel)


def test_the_paper_models_stay_beside_them(world, default_models, tmp_path):
    paper = train(world, models=("q_k1", "e_k1"), restarts=1)
    for models in (paper, default_models):
        models.save(tmp_path)
    assert SensorModels.load(tmp_path).quality.name == "quality"
    named = SensorModels.load(*(tmp_path / f"{name}.exposight-model" for name in ("q_k1", "e_k1")))
    assert named.quality.name == "q_k1"
    with pytest.raises(InputError, match="trained together with its exposure-time model"):
        SensorModels(quality=default_models.quality, exposure=paper.exposure)
    with pytest.raises(InputError, match="predicts exposure_ms, got none"):
        SensorModels(quality=paper.quality)
    with pytest.raises(InputError, match="mean and start_from are of the default models"):
        train(world, models=("q_k1", "e_k1"), mean="camera")


def test_the_chain_of_the_paper_takes_no_trial(world, view, capture):
    paper = train(world, models=("q_k1", "e_k1"), restarts=1)
    with pytest.raises(InputError, match="cannot learn from a trial capture; the default models"):
        paper.forecast(view("v0"), (40.0,), trial=capture([view("v0")], (10.0,)))


def test_both_are_evaluated(default_models, view, capture):
    scores = default_models.evaluate(capture([view("new", 610.0, 3.0, 5.0)]))
    quality, exposure = scores.evaluations
    assert quality.score.rmse < 0.02
    assert exposure.score.r2_percent > 99.0


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"finish": pl.when(pl.col("view") == "v0").then(pl.lit("paint")).otherwise("finish")},
         "more than one finish"),
        ({"sensor": pl.when(pl.col("view") == "v0").then(pl.lit("x")).otherwise("sensor")},
         "more than one sensor"),
        ({"p_norm": pl.lit(None, pl.Float64)}, "it needs measured observations"),
    ],
)  # fmt: skip
def test_what_cannot_be_trained_on(world, changes, message):
    table = ObservationTable.from_frame(world.frame.with_columns(**changes))
    with pytest.raises(ObservationError, match=message):
        train(table)
