"""The default models by the command line: trained, carried to another finish, asked, refined."""

import numpy as np
import polars as pl
import pytest

from exposight.models import RadianceModel, WindowModel, load_model
from exposight.observing import read_observations

SUFFIX = ".exposight-model"


@pytest.fixture(scope="module")
def default_models(campaign, observations, tmp_path_factory, run_json):
    folder = tmp_path_factory.mktemp("default")
    run_json("train", observations, "--sensor", campaign / "sensor.json", "-o", folder)
    return folder


@pytest.fixture
def changed(observations, tmp_path):
    """Return what writes the observations with other columns."""

    def write(**columns):
        path = tmp_path / "changed.csv"
        read_observations(observations).frame.with_columns(**columns).write_csv(path)
        return path

    return write


def test_two_models_are_trained_and_what_they_found_is_told(campaign, observations, run, tmp_path):
    words = ("train", observations, "--sensor", campaign / "sensor.json", "-o", tmp_path)
    document = run(*words, "--json").stdout
    assert '"model": "quality"' in document
    assert isinstance(load_model(tmp_path / f"quality{SUFFIX}"), WindowModel)
    assert isinstance(load_model(tmp_path / f"exposure{SUFFIX}"), RadianceModel)
    shown = " ".join(run(*words).stdout.split())
    for words in ("grey levels of i_avg above black", "Student's t", "one stripe image"):
        assert words in shown


def test_a_campaign_is_observed_and_trains(campaign, observations, tmp_path, run_json):
    told = run_json("train", campaign, "-o", tmp_path)
    assert told["sensor"] == "small"
    kept = read_observations(tmp_path / "observations.csv").frame
    assert kept.equals(read_observations(observations).frame)
    assert [file["kind"] for file in told["files"]] == ["observations", "model", "model"]


def test_the_plates_limits_are_found(default_models):
    # The plate's clouds have points from 20 to 250 grey levels, of a camera without black level.
    model = load_model(default_models / f"quality{SUFFIX}")
    low, high = model.limits
    assert low == pytest.approx(20.0, rel=0.3)
    assert high == pytest.approx(250.0, rel=0.15)
    assert model.radiance.black_level == pytest.approx(0.0, abs=1.0)


def test_features_and_views_left_out_are_scored(campaign, observations, tmp_path, run_json):
    told = run_json("train", observations, "--sensor", campaign / "sensor.json", "-o", tmp_path)
    features, views = told["left_out"]
    assert (features["left_out"], views["left_out"]) == ("one of 12 features", "one of 3 views")
    for line in told["left_out"]:
        assert line["rings"] == 36
        assert line["median_error"] < 0.02
        assert line["coverage_2sigma"] > 0.9
    assert told["widening"]["unseen_view"] == views["widening"] > 1.0
    assert any("3 views only" in note for note in told["notes"])


def test_a_preset_is_found_by_the_tables_sensor(changed, tmp_path, run_json):
    path = changed(sensor=pl.lit("ZEISS COMET Pro AE"))
    told = run_json("train", path, "-o", tmp_path)
    assert told["sensor"] == "ZEISS COMET Pro AE"
    assert told["lobe"] is not None


def test_without_a_sensor_it_is_said_what_is_lost(observations, tmp_path, run):
    shown = " ".join(run("train", observations, "-o", tmp_path).stdout.split())
    assert "'small' is no preset; give its file by --sensor" in shown
    assert "without the sensor's geometry" in shown


def test_another_finish_keeps_the_limits(default_models, changed, tmp_path, run):
    quality = default_models / f"quality{SUFFIX}"
    path = changed(finish=pl.lit("paint"))
    ended = run("train", path, "--from", quality, "-o", tmp_path)
    shown = " ".join(ended.stdout.split())
    assert "small, that of the model to start from" in shown
    assert "the sensor's limits of" in shown
    new, old = (load_model(folder / f"quality{SUFFIX}") for folder in (tmp_path, default_models))
    np.testing.assert_allclose(new.limits, old.limits, rtol=0.1)
    assert (new.radiance.origin.finish, old.radiance.origin.finish) == ("paint", "")


@pytest.mark.parametrize(
    ("columns", "words", "status", "message"),
    [
        ({"finish": pl.when(pl.col("view") == "z600").then(pl.lit("a")).otherwise(pl.lit("b"))},
         (), 1, "the rows are of more than one finish"),
        ({"sensor": pl.when(pl.col("view") == "z600").then(pl.lit("a")).otherwise(pl.lit("b"))},
         (), 1, "the rows are of more than one sensor"),
        ({"p_norm": pl.lit(None, pl.Float64)}, (), 1, "it needs measured observations"),
        ({}, ("-m", "q_k1", "--mean", "camera"), 2, "are of the default models"),
        ({}, ("-m", "qualty"), 1, "did you mean 'quality'?"),
        ({}, ("--mean", "lamp"), 2, "lamp"),
    ],
)  # fmt: skip
def test_what_cannot_be_trained(columns, words, status, message, changed, tmp_path, run):
    ended = run("train", changed(**columns), *words, "-o", tmp_path / "out")
    assert ended.exit_code == status
    assert message in ended.stderr


def test_from_takes_a_quality_model_alone(default_models, observations, tmp_path, run):
    ended = run(
        "train", observations, "--from", default_models / f"exposure{SUFFIX}", "-o", tmp_path
    )
    assert ended.exit_code == 1
    assert "--from takes the default quality model" in ended.stderr


# -- forecast -------------------------------------------------------------------------------------

POSE = ("--robot-pose", "fanuc", "0,0,620,0,0,0")


def test_the_quality_model_alone_forecasts(default_models, campaign, run_json):
    words = ("--campaign", campaign, *POSE)
    alone = run_json("forecast", default_models / f"quality{SUFFIX}", *words)
    assert alone["forecast"] == run_json("forecast", default_models, *words)["forecast"]
    assert 3.0 < alone["best_exposure_ms"] < 16.0
    assert len(alone["at_best_exposure"]) == 12
    for line in alone["at_best_exposure"]:
        assert line["chance"] > 0.99
        assert line["known"]
        assert 0.0 < line["wanted_ms_low"] < line["wanted_ms"] < line["wanted_ms_high"]
        assert line["wanted_ms"] == pytest.approx(80 / 12, rel=0.35)


def test_a_trial_refines_it(default_models, campaign, observations, tmp_path, run_json):
    one = tmp_path / "one.csv"
    frame = read_observations(observations).frame
    frame.filter((pl.col("view") == "z600") & (pl.col("exposure_ms") == 3.0)).write_csv(one)
    words = ("forecast", default_models, "--campaign", campaign, "--view", "z600")
    plain, by_table, by_campaign = (
        run_json(*words, *trial) for trial in ((), ("--trial", one), ("--trial", campaign))
    )
    assert set(plain["rests_on"]) == {"pose"}
    for refined in (by_table, by_campaign):
        assert all(source.startswith("pose and") for source in refined["rests_on"])


def test_more_may_be_needed(default_models, campaign, run_json):
    words = ("forecast", default_models, "--campaign", campaign, *POSE, "--exposures", 10, 20)
    some, more = (run_json(*words, "--need", need) for need in (0.5, 0.99))
    assert more["need"] == 0.99
    chances = [[line["chance"] for line in each["forecast"]] for each in (some, more)]
    assert sum(chances[1]) < sum(chances[0])


def test_forecasts_for_another_sensor_are_refused(default_models, campaign, run):
    words = ("--sensor", "comet-pro-ae", "--features", campaign / "features.csv", *POSE)
    ended = run("forecast", default_models, *words)
    assert ended.exit_code == 1
    assert "another sensor: 'ZEISS COMET Pro AE', learnt on 'small'" in ended.stderr


def test_the_paper_models_take_no_trial(models, campaign, observations, run):
    words = ("--campaign", campaign, "--view", "z600", "--trial", observations)
    ended = run("forecast", models, *words)
    assert ended.exit_code == 1
    assert "cannot learn from a trial capture" in ended.stderr


# -- evaluate -------------------------------------------------------------------------------------


def test_quality_and_exposure_times_are_scored(default_models, models, observations, run_json):
    told = run_json("evaluate", *sorted(default_models.iterdir()), *models.iterdir(), observations)
    scores = {line["model"]: line for line in told["scores"] if line["rows"] == "all"}
    assert set(scores) == {"quality", "exposure", "q_k4", "e_k4", "q_k4+e_k4"}
    exposure, quality = scores["exposure"], scores["quality"]
    assert exposure["median_relative_error"] < 0.02
    assert quality["median_relative_error"] is None
    assert quality["rmse"] < 0.05
    assert quality["crps"] < quality["rmse"]
    assert quality["log_score"] < -2.0
    (chance,) = (line for line in told["chances"] if line["model"] == "quality")
    assert chance["said"] == pytest.approx(chance["good"], abs=0.05)
    assert chance["brier"] < 0.02
    assert chance["n_edge"] > 0
    groups = [line for line in told["calibration"] if line["model"] == "quality"]
    assert sum(group["n"] for group in groups) == quality["n"]
    assert any("q_k4 read the brightness that was measured" in note for note in told["notes"])


def test_known_and_unseen_features_are_scored_apart(campaign, observations, tmp_path, run_json):
    frame = read_observations(observations).frame
    frame.filter(pl.col("feature") < "h09").write_csv(tmp_path / "train.csv")
    sensor = ("--sensor", campaign / "sensor.json")
    run_json("train", tmp_path / "train.csv", *sensor, "-o", tmp_path / "m")
    told = run_json("evaluate", *sorted((tmp_path / "m").iterdir()), observations)
    rows = {(line["model"], line["rows"]): line["n"] for line in told["scores"]}
    assert rows["quality", "known"] == 8 * 18
    assert rows["quality", "unseen"] == 4 * 18
    assert rows["quality", "all"] == 12 * 18
    frame.filter(pl.col("feature") >= "h09").write_csv(tmp_path / "test.csv")
    told = run_json("evaluate", *sorted((tmp_path / "m").iterdir()), tmp_path / "test.csv")
    assert "exposure, quality know no feature of these" in told["notes"]


def test_chances_and_bands_are_drawn(default_models, observations, tmp_path, run):
    picture = tmp_path / "reliability.svg"
    words = ("evaluate", *sorted(default_models.iterdir()), observations, "--picture", picture)
    assert run(*words).exit_code == 0
    assert picture.read_text("utf-8").startswith("<?xml")
    assert run(*words[:-1], tmp_path / "a.pdf").exit_code == 2


def test_a_table_of_another_sensor_is_not_evaluated(default_models, changed, run):
    path = changed(sensor=pl.lit("another"))
    ended = run("evaluate", default_models / f"quality{SUFFIX}", path)
    assert ended.exit_code == 1
    assert "another sensor: 'another', learnt on 'small'" in ended.stderr


def test_a_table_of_another_finish_is_evaluated_with_a_word(
    default_models, changed, run_json, tmp_path
):
    path = changed(finish=pl.lit("bare"))
    run_json("train", path, "-o", tmp_path)
    told = run_json("evaluate", tmp_path / f"quality{SUFFIX}", changed(finish=pl.lit("paint")))
    assert any("another finish: 'paint', learnt on 'bare'" in note for note in told["notes"])


# -- predict and info -----------------------------------------------------------------------------

PLACE = ("--x-mm", 50, "--y-mm", 0, "--z-mm", 20, "--w-deg", 0, "--p-deg", 0, "--radius-mm", 5)


def test_one_exposure_time_is_predicted_with_its_band(default_models, run_json):
    told = run_json("predict", default_models / f"exposure{SUFFIX}", "--i-avg", 90, *PLACE)
    (line,) = told["predictions"]
    low, middle, high = (line[f"predicted_exposure_ms{end}"] for end in ("_low", "", "_high"))
    assert 0.0 < low < middle < high
    assert middle == pytest.approx(90 / 12, rel=0.15)
    assert line["known"]
    assert line["nearest_setting_ms"] == pytest.approx(middle, abs=0.25)


def test_names_and_finish_may_be_given_or_not(default_models, run_json):
    model = default_models / f"quality{SUFFIX}"
    words = ("predict", model, "--exposure-ms", 8, *PLACE)
    nameless, named = (
        run_json(*words, *more)["predictions"][0] for more in ((), ("--feature", "h05"))
    )
    assert named["feature"] == "h05"
    assert nameless["predicted_p_norm"] == pytest.approx(1.0, abs=0.05)
    for line in (nameless, named):
        low, high = line["predicted_p_norm_low"], line["predicted_p_norm_high"]
        assert 0.0 <= low <= line["predicted_p_norm"] <= high


@pytest.mark.parametrize(
    ("words", "status", "message"),
    [
        (("--x-mm", "left"), 2, "--x-mm takes a number, got 'left'"),
        (("--sensor", "another"), 1, "another sensor: 'another', learnt on 'small'"),
        (("--tcp", "0 0 500 0 0 0"), 1, "another tool centre point"),
        (("--finsh", "bare"), 2, "did you mean 'finish'?"),
    ],
)
def test_what_cannot_be_predicted(words, status, message, default_models, run):
    given = [*PLACE, "--exposure-ms", 8]
    if words[0] in given:
        del given[:2]
    ended = run("predict", default_models / f"quality{SUFFIX}", *given, *words)
    assert ended.exit_code == status
    assert message in ended.stderr


def test_a_table_may_lack_names_and_all_that_is_optional(default_models, tmp_path, run_json):
    path = tmp_path / "planned.csv"
    path.write_text(
        "x_mm,y_mm,z_mm,w_deg,p_deg,radius_mm,exposure_ms\n0,0,0,0,0,5,0.5\n0,0,0,0,0,5,8\n"
    )
    told = run_json("predict", default_models / f"quality{SUFFIX}", path, "-o", tmp_path / "o.csv")
    assert [round(line["predicted_p_norm"]) for line in told["predictions"]] == [0, 1]
    assert "unknown" in pl.read_csv(tmp_path / "o.csv").columns


def test_info_tells_limits_and_origin(default_models, run_json, run):
    told = run_json("info", default_models / f"quality{SUFFIX}")
    assert told["limits"]["modulation"] < told["limits"]["above_black"]
    assert told["part"] == "plate"
    assert told["tcp"] == "0 0 600 0 0 0"
    assert len(told["features"]) == 12
    assert told["widening"]["unseen_view"] > 1.0
    assert [line["rings"] for line in told["left_out"]] == [36, 36]
    shown = " ".join(run("info", default_models / f"exposure{SUFFIX}").stdout.split())
    assert "light comes from the camera" in shown
    assert "3 views only" in shown
