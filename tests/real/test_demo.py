"""The demonstration on the recorded skull, small: two models, few features, six exposures."""

import numpy as np
import pytest

from exposight.cell import CampaignFolder
from exposight.demo import SkullSettings, run_skull
from exposight.errors import InputError
from exposight.models import load_model, model_named
from exposight.observing import read_observations

SETTINGS = SkullSettings(
    features=24,
    steps_per_decade=4,
    steps_each_way=3,
    restarts=1,
    models=(model_named("q_k1"), model_named("e_k4")),
    workers=1,
)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("demo")


@pytest.fixture(scope="module")
def result(real_data, folder):
    return run_skull(folder, real_data / "skull", SETTINGS)


def test_both_sequences_agree_with_the_authors_cloud(result):
    gray, phase = (check.agreement for check in result.checks)
    assert gray.median_mm < 0.40
    assert phase.median_mm < 0.38
    assert max(gray.p90_mm, phase.p90_mm) < 1.0
    assert gray.common_points >= 85_000


def test_every_feature_is_observed_at_every_exposure(result):
    assert len(result.table.measured()) == 24 * 7
    assert result.settings.exposures_ms()[3] == 10.0


def test_only_the_recorded_exposure_is_not_emulated(result):
    emulated = result.table.frame.filter(result.table.frame["emulated"])
    assert 10.0 not in emulated["exposure_ms"]
    assert emulated.height == 24 * 6


def test_quality_rises_and_falls_with_exposure(result):
    by_exposure = result.table.array(["p_norm"]).reshape(7, 24).mean(axis=1)
    assert by_exposure[0] < 0.5
    assert by_exposure[3] > 0.9
    assert by_exposure[-1] < 0.7


def test_half_of_the_features_train_and_the_others_test(result):
    assert len(result.train_features) == 12
    for found in result.results:
        assert set(found.known.table.names("feature")) <= result.train_features
        assert not set(found.unseen.table.names("feature")) & result.train_features


def test_position_predicts_the_exposure_time_of_unseen_features(result):
    assert result.results[1].unseen.score.r2_percent > 60


def test_what_was_found_is_on_disk(result, folder):
    table = read_observations(folder / "observations.csv")
    assert table.frame.equals(result.table.frame)
    for found in result.results:
        name = found.model.name
        model = load_model(folder / "models" / f"{name}.exposight-model")
        again = model.predict(found.unseen.table)
        np.testing.assert_array_equal(again.mean, found.unseen.prediction.mean)


def test_a_second_run_keeps_what_was_captured(result, real_data, folder):
    before = {path: path.stat().st_mtime_ns for path in (folder / "campaign").rglob("*.npz")}
    run_skull(folder, real_data / "skull", SETTINGS)
    after = {path: path.stat().st_mtime_ns for path in (folder / "campaign").rglob("*.npz")}
    assert before == after
    assert len(CampaignFolder(folder / "campaign")) == 7


def test_another_seed_does_not_mix_into_the_same_campaign(result, real_data, folder):
    other = SkullSettings(features=24, seed=2, models=SETTINGS.models, workers=1)
    before = (folder / "features.csv").read_bytes()
    with pytest.raises(InputError, match=r"choose another folder.*of another seed"):
        run_skull(folder, real_data / "skull", other)
    assert (folder / "features.csv").read_bytes() == before


def test_settings_that_make_no_sense_are_refused():
    with pytest.raises(InputError, match="at least 4 features"):
        SkullSettings(features=2)
