"""``exposight forecast``: what to expect of a pose before anything is captured there."""

import polars as pl
import pytest

POSE = ("--robot-pose", "fanuc", "0,0,600,0,0,0")


def test_a_view_of_the_campaign_is_forecast_feature_by_feature(models, campaign, run_json):
    told = run_json("forecast", models, "--campaign", campaign, "--view", "z600")
    assert told["visible_features"] == 12
    assert "not visible: far" in told["notes"]
    lines = told["forecast"]
    assert len(lines) == 12 * len(told["exposures_ms"])
    assert all(line["p_norm_low"] <= line["p_norm_high"] <= 1.0 for line in lines)
    # Between too dark and clipped, the plate's clouds are whole.
    assert 3.0 < told["best_exposure_ms"] < 20.0
    assert all(line["p_norm"] > 0.9 for line in told["at_best_exposure"])


def test_sensor_features_and_pose_mean_the_same_as_the_campaign(models, campaign, run_json):
    words = ("--exposures", 2, 10, *POSE)
    files = ("--sensor", campaign / "sensor.json", "--features", campaign / "features.csv")
    by_campaign = run_json("forecast", models, "--campaign", campaign, *words)
    by_files = run_json("forecast", *sorted(models.iterdir()), *files, *words)
    assert by_campaign["forecast"] == by_files["forecast"]
    assert by_files["exposures_ms"] == [2.0, 10.0]


def test_it_is_shown_written_and_drawn(models, campaign, tmp_path, run):
    path, picture = tmp_path / "forecast.csv", tmp_path / "forecast.svg"
    words = ("--campaign", campaign, *POSE, "--exposures", 2, 10, "-o", path)
    ended = run("forecast", models, *words, "--picture", picture)
    assert ended.exit_code == 0, ended.stderr
    assert "h12" in ended.stdout
    assert pl.read_csv(path).height == 24
    assert picture.read_text("utf-8").startswith("<?xml")


@pytest.mark.parametrize(
    ("words", "status", "message"),
    [
        (("--view", "z601"), 1, "no view 'z601'; did you mean 'z6"),
        ((), 2, "give the pose once"),
        (("--view", "z600", *POSE), 2, "or a pose, not both"),
        (("--view", "z600", "--picture", "a.pdf"), 2, "writes PNG or SVG"),
        (("--sensor", "comet-pro-ae", *POSE), 2, "either --campaign, or both"),
        (("--robot-pose", "fanuc", "0,0,-600,0,0,0"), 1, "no feature is visible from this pose"),
    ],
)
def test_what_cannot_be_forecast(words, status, message, models, campaign, run):
    ended = run("forecast", models, "--campaign", campaign, *words)
    assert ended.exit_code == status
    assert message in ended.stderr


def test_one_model_is_not_enough(models, campaign, run):
    model = models / "q_k4.exposight-model"
    ended = run("forecast", model, "--campaign", campaign, "--view", "z600")
    assert ended.exit_code == 1
    assert "got q_k4 (p_norm)" in ended.stderr
