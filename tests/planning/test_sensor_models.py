"""A sensor's two models of the paper: trained, judged, kept and asked together."""

import hashlib

import numpy as np
import pytest

from exposight.cell import Feature, Part, sensor_preset
from exposight.errors import InputError, MissingFileError
from exposight.geometry import RigidTransform
from exposight.models import evaluate, model_named, save_model
from exposight.observing import Observation, ObservationTable, View
from exposight.planning import ChainedQuality, SensorModels, train

SENSOR = sensor_preset("comet-pro-ae")


def observations(n, seed):
    """Brightness is 2 grey levels a ms, less far away; quality rises with it."""
    rng = np.random.default_rng(seed)
    rows = []
    for i in range(n):
        x_mm, y_mm, z_mm = rng.uniform(-100.0, 100.0, 3).tolist()
        i_avg = float(rng.uniform(5.0, 200.0))
        rows.append(
            Observation(
                feature=f"f{i % 7}",
                view=f"v{i % 5}",
                exposure_ms=i_avg / 2 * (1 + z_mm / 1000),
                p_norm=float(1 - np.exp(-i_avg / 30)),
                i_avg=i_avg,
                x_mm=x_mm,
                y_mm=y_mm,
                z_mm=z_mm,
                w_deg=float(rng.uniform(-9, 9)),
                p_deg=float(rng.uniform(-9, 9)),
                r_deg=0.0,
                radius_mm=5.0,
            )
        )
    return ObservationTable.from_observations(rows)


@pytest.fixture(scope="module")
def models():
    table = observations(60, seed=1)
    return train(table, sensor=SENSOR, models=("q_k1", "e_k2"), restarts=1)


@pytest.fixture
def hole():
    one = Feature(name="f1", kind="hole", part_from_feature=RigidTransform(), radius_mm=5.0)
    return View.of(Part(name="p", features=(one,)), SENSOR, SENSOR.camera_from_tcp)


def test_scores_are_those_of_each_model_and_print_as_a_table(models):
    unseen = observations(40, seed=2)
    scores = models.evaluate(unseen)
    names = ["q_k1", "e_k2", "q_k1+e_k2"]
    assert [each.model.name for each in scores.evaluations] == names
    assert scores.evaluations[0].score == evaluate(models.quality, unseen).score
    frame = scores.table.frame
    assert frame.filter(rows="all")["model"].to_list() == names
    for each in scores.evaluations:
        inside = frame.filter(rows="inside", model=each.model.name)["n"].to_list()
        expected = int(each.prediction.inside.sum())
        assert inside == ([] if expected == len(each.observed) else [expected])
    assert str(scores).split()[:3] == ["model", "rows", "n"]
    assert "<table>" in scores._repr_html_()


def test_exposure_times_in_another_unit_are_noticed(models):
    table = observations(40, seed=2)
    seconds = ObservationTable(frame=table.frame.with_columns(table.frame["exposure_ms"] / 1000))
    assert "they seem to be in s" in str(models.evaluate(seconds))


def test_a_forecast_looks_at_settings_of_the_sensor(models, hole):
    forecast = models.forecast(hole)
    low, high = models.exposure.target_range
    assert len(set(forecast.exposures_ms)) == len(forecast.exposures_ms) > 10
    assert forecast.exposures_ms[0] == pytest.approx(max(low, SENSOR.exposure.min_ms), abs=1.0)
    assert forecast.exposures_ms[-1] == pytest.approx(high, abs=1.0)
    assert all(SENSOR.nearest_exposure(each) == each for each in forecast.exposures_ms)
    assert forecast.p_norm[0, -1] > forecast.p_norm[0, 0]
    assert models.forecast(hole, [10.0]).exposures_ms == (10.0,)


def test_more_observations_are_learnt_without_a_new_fit(models, hole):
    more = models.with_observations(observations(30, seed=3))
    assert more.quality.n_observations == models.quality.n_observations + 30
    assert more.exposure.n_observations > models.exposure.n_observations
    assert more.quality.hyperparameters() == models.quality.hyperparameters()
    assert (more.forecast(hole).p_norm != models.forecast(hole).p_norm).any()


def test_models_are_kept_and_come_back(models, hole, tmp_path):
    paths = models.save(tmp_path / "models")
    assert [path.name for path in paths] == ["q_k1.exposight-model", "e_k2.exposight-model"]
    again = SensorModels.load(tmp_path / "models")
    np.testing.assert_array_equal(again.forecast(hole).p_norm, models.forecast(hole).p_norm)
    assert str(again) == str(models)
    sums = [hashlib.sha256(path.read_bytes()).hexdigest() for path in paths]
    assert list(again.checksums.items()) == list(zip(("q_k1", "e_k2"), sums, strict=True))
    assert str(models).splitlines()[1].split() == ["q_k1", "point-cloud", "quality", "i_avg", "60"]


def test_a_folder_without_a_model_or_with_too_many(models, tmp_path):
    with pytest.raises(MissingFileError, match="no model file at"):
        SensorModels.load(tmp_path / "nowhere")
    with pytest.raises(InputError, match="got none"):
        SensorModels.load(tmp_path)
    models.save(tmp_path)
    save_model(tmp_path / "other.exposight-model", models.quality)
    with pytest.raises(InputError, match=r"q_k1 .p_norm., q_k1 .p_norm."):
        SensorModels.load(tmp_path)


def test_models_of_the_wrong_targets_are_refused(models):
    with pytest.raises(InputError, match="expected a model that predicts p_norm, got e_k2"):
        SensorModels(quality=models.exposure, exposure=models.quality)
    with pytest.raises(InputError, match="one model that predicts p_norm and one"):
        train(observations(20, seed=1), models=("q_k1", model_named("q_k2")))


def test_the_black_level_of_the_chain_is_that_of_its_training_data(world):
    # in this world every image has 10 grey levels more than light gives
    lifted = world.frame.with_columns(i_avg=(world.frame["i_avg"] + 10.0).clip(upper_bound=255.0))
    pair = train(ObservationTable(frame=lifted), models=("q_k1", "e_k4"), restarts=1)
    chain = ChainedQuality.of(pair.quality, pair.exposure)
    assert chain.black_level == pytest.approx(10.0, abs=0.5)
    without_place = train(ObservationTable(frame=lifted), models=("q_k1", "e_k1"), restarts=1)
    assert ChainedQuality.of(without_place.quality, without_place.exposure).black_level == 0.0
