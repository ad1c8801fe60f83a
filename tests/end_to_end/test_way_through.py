"""A campaign through observe, train, evaluate, predict and info, by the command line."""

import csv
import shutil

import cv2
import numpy as np
import pytest

from exposight.models import load_model
from exposight.observing import read_observations


def test_observe_counts_what_was_seen(campaign, tmp_path, run_json):
    document = run_json("observe", campaign, "-o", tmp_path / "o.csv")
    assert document["captures"] == 18
    assert document["features"] == 13
    counts = {line["visibility"]: line["rows"] for line in document["visibility"]}
    assert counts == {"visible": 216, "out of frame": 18}
    exposures = next(line for line in document["ranges"] if line["column"] == "exposure_ms")
    assert (exposures["min"], exposures["median"], exposures["max"]) == (1.0, 8.0, 40.0)
    assert document["emulated_rows"] == 0


def test_observe_writes_the_table(observations):
    assert len(read_observations(observations)) == 234


def test_observe_takes_the_ring_s_tolerances(campaign, tmp_path, run_json):
    wide, narrow = tmp_path / "wide.csv", tmp_path / "narrow.csv"
    run_json("observe", campaign, "-o", wide, "--outer-mm", 9)
    run_json("observe", campaign, "-o", narrow)
    pixels = [read_observations(path).array(["n_pixels"]) for path in (wide, narrow)]
    assert np.nansum(pixels[0]) > 2 * np.nansum(pixels[1])


def test_observe_keeps_what_the_user_knows(campaign, single, tmp_path, run, run_json):
    run_json("observe", campaign, "-o", tmp_path / "o.csv", "--finish", "primer")
    frame = read_observations(tmp_path / "o.csv").frame
    assert set(frame.select("finish", "sensor", "part").rows()) == {("primer", "small", "plate")}
    assert run("observe", campaign, "--finish", " ").exit_code == 2
    run_json(
        *("observe", "--image", single / "stripes.png", "--cloud", single / "cloud.ply"),
        *("--features", single / "features.csv", "--sensor", single / "sensor.json"),
        *("--exposure-ms", 10, "--pose", single / "pose.txt", "-o", tmp_path / "o.csv"),
        *("--brightness-source", "texture"),
    )
    frame = read_observations(tmp_path / "o.csv").measured().frame
    assert frame["brightness_source"].unique().to_list() == ["texture"]
    assert frame["i_mean"].to_list() == pytest.approx(frame["i_avg"].to_list())


def test_a_single_capture_gives_the_campaign_s_numbers(single, observations, tmp_path, run_json):
    alone = tmp_path / "alone.csv"
    run_json(
        *("observe", "--image", single / "stripes.png", "--cloud", single / "cloud.ply"),
        *("--features", single / "features.csv", "--sensor", single / "sensor.json"),
        *("--exposure-ms", 10, "--pose", single / "pose.txt", "-o", alone),
    )
    every = read_observations(observations)
    of_campaign = every.where(
        (every.names("view") == "z600") & (every.array(["exposure_ms"])[:, 0] == 10)
    )
    columns = ["i_avg", "p_norm", "x_mm", "z_mm"]
    np.testing.assert_array_equal(
        read_observations(alone).array(columns), of_campaign.array(columns)
    )


def test_a_single_image_in_high_bits_that_saturates(single, tmp_path, run_json):
    eight = cv2.imread(str(single / "stripes.png"), cv2.IMREAD_UNCHANGED)
    twelve = np.minimum(eight.astype(np.uint16) * 16, 3000)
    cv2.imwrite(str(tmp_path / "deep.png"), twelve << 4)
    run_json(
        *("observe", "--image", tmp_path / "deep.png", "--cloud", single / "cloud.ply"),
        *("--features", single / "features.csv", "--sensor", single / "sensor.json"),
        *("--exposure-ms", 10, "--pose", single / "pose.txt", "-o", tmp_path / "o.csv"),
        *("--bit-depth", 12, "--alignment", "high", "--saturation-level", 1920),
    )
    frame = read_observations(tmp_path / "o.csv").measured().frame
    clipped = frame["clipped_share"].to_numpy()
    assert ((clipped > 0) & (clipped < 1)).any()  # the plate is brighter in its middle


@pytest.mark.parametrize(
    "pose",
    [
        ("fanuc", "0,0,600,0,0,0"),
        ("kuka", "0 0 600 0 0 0"),
        ("abb", "0,0,600,1,0,0,0"),
        ("ur", "0,0,0.6,0,0,0"),
    ],
)
def test_robots_poses_mean_the_same(pose, single, tmp_path, run_json):
    document = run_json(
        *("observe", "--image", single / "stripes.png", "--cloud", single / "cloud.ply"),
        *("--features", single / "features.csv", "--sensor", single / "sensor.json"),
        *("--exposure-ms", 10, "--robot-pose", *pose, "-o", tmp_path / "o.csv"),
    )
    (z_mm,) = (line for line in document["ranges"] if line["column"] == "z_mm")
    assert z_mm["median"] == pytest.approx(0.0, abs=1e-9)


def test_a_single_capture_is_shown_feature_by_feature(single, tmp_path, run):
    result = run(
        *("observe", "--image", single / "stripes.png", "--cloud", single / "cloud.ply"),
        *("--features", single / "features.csv", "--sensor", single / "sensor.json"),
        *("--exposure-ms", 10, "--pose", single / "pose.txt", "-o", tmp_path / "o.csv"),
    )
    assert "h12" in result.stdout
    assert "out of frame" in result.stdout


def test_train_keeps_provenance_and_sensor(models, observations):
    model = load_model(models / "q_k4.exposight-model")
    assert model.provenance.observations == observations.name
    assert model.provenance.observations_sha256 is not None
    assert not model.provenance.emulated
    assert model.sensor is not None
    assert model.sensor.name == "small"


def test_train_tells_hyperparameters_with_units(observations, tmp_path, run_json):
    document = run_json("train", observations, "-m", "e_k1", "-o", tmp_path, "--restarts", 1)
    (model,) = document["models"]
    units = {line["name"]: line["unit"] for line in document["hyperparameters_of_e_k1"]}
    assert units == {
        "exponential.variance": "ms²",
        "exponential.length_scale": "grey levels",
        "noise_variance": "ms²",
    }
    assert model["converged"]
    assert (tmp_path / "e_k1.exposight-model").is_file()


def test_evaluate_scores_every_model(models, observations, run_json):
    files = sorted(models.iterdir())
    document = run_json("evaluate", *files, observations)
    assert document["trained_on_this_table"] == ["e_k4", "q_k4"]
    lines = document["scores"]
    names = [(line["model"], line["rows"]) for line in lines]
    assert names == [(name, "all") for name in ("e_k4", "q_k4", "q_k4+e_k4")]
    assert all(line["r2_percent"] > 80 for line in lines[:2])


def test_evaluate_says_when_the_table_is_the_training_table(models, observations, run):
    result = run("evaluate", models / "q_k4.exposight-model", observations)
    assert "trained on this very table" in " ".join(result.stdout.split())


def test_predict_quality_of_one_feature(models, run_json):
    document = run_json(
        *("predict", models / "q_k4.exposight-model", "--i-avg", 100),
        *("--x-mm", 50, "--y-mm", -60, "--z-mm", 0),
    )
    (line,) = document["predictions"]
    assert line["predicted_p_norm"] == pytest.approx(1.0, abs=0.1)
    assert line["known"]
    assert line["unknown"] == ""


def test_predict_names_the_input_outside_the_training_range(models, run):
    result = run(
        *("predict", models / "q_k4.exposight-model", "--i-avg", 100),
        *("--x-mm", 50, "--y-mm", -60, "--z-mm", 300, "--w-deg", 4),
    )
    shown = " ".join(result.stdout.split())
    assert "z_mm −40 to 40 mm" in shown
    assert "note: do not trust this prediction: z_mm outside the training data" in shown
    assert "q_k4 does not read w_deg" in shown


def test_predict_exposure_knows_the_sensor(models, run_json):
    model = models / "e_k4.exposight-model"
    pose = ("--x-mm", 50, "--y-mm", 0, "--z-mm", 0)
    (line,) = run_json("predict", model, "--i-avg", 100, *pose)["predictions"]
    assert line["predicted_exposure_ms"] == pytest.approx(100 / 12, rel=0.1)
    assert line["in_sensor_range"]
    assert line["nearest_setting_ms"] == pytest.approx(line["predicted_exposure_ms"], abs=0.25)


def test_predict_says_that_the_sensor_cannot_take_an_exposure(models, run_json):
    far_away = ("--i-avg", 100, "--x-mm", 50, "--y-mm", 0, "--z-mm", 1e6)  # the prior's mean, 0 ms
    model = models / "e_k4.exposight-model"
    document = run_json("predict", model, *far_away)
    (line,) = document["predictions"]
    assert document["sensor_range_ms"] == [0.5, 50.0]
    assert not line["in_sensor_range"]
    assert line["nearest_setting_ms"] is None
    assert "1 exposure time is outside the sensor's range" in document["notes"]


def test_predict_a_table(models, observations, tmp_path, run_json):
    path = tmp_path / "predictions.csv"
    document = run_json("predict", models / "q_k4.exposight-model", observations, "-o", path)
    assert document["rows"] == 234
    assert "18 rows lack an input" in document["notes"][0]  # the hole that is out of the frame
    with path.open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == len(document["predictions"]) == 216
    assert float(rows[0]["predicted_p_norm"]) == document["predictions"][0]["predicted_p_norm"]


def test_predict_a_table_shows_its_first_rows(models, observations, run):
    result = run("predict", models / "e_k4.exposight-model", observations)
    assert "196 more" in result.stdout


def test_no_setting_is_recommended_where_the_model_extrapolates(models, run_json):
    model = models / "e_k4.exposight-model"
    aside = ("--i-avg", 100, "--x-mm", 170, "--y-mm", 0, "--z-mm", 0)
    document = run_json("predict", model, *aside)
    (line,) = document["predictions"]
    assert line["in_sensor_range"]
    assert line["nearest_setting_ms"] is None
    assert "do not trust this prediction" in document["notes"][0]


def test_predict_a_planned_table_shows_its_inputs(models, tmp_path, run):
    path = tmp_path / "planned.csv"
    path.write_text("i_avg,z_mm,x_mm,y_mm\n80,0,50,-41\n90,,50,-42\n", encoding="utf-8")
    shown = run("predict", models / "q_k4.exposight-model", path).stdout
    assert "−41" in shown
    assert "view" not in shown
    assert "1 row lacks an input, empty or not a number, and is left out" in " ".join(shown.split())


def test_what_was_there_is_said_to_be_replaced(models, observations, tmp_path, run):
    predict = ("predict", models / "q_k4.exposight-model", observations, "-o", tmp_path / "p.csv")
    train = ("train", observations, "-m", "q_k1", "-o", tmp_path, "--restarts", 1)
    split = ("split", observations, "-o", tmp_path)
    for words in (predict, train, split):
        first, second = (run(*words).stdout for _ in range(2))
        assert "wrote" in first
        assert "replaced" not in first
        assert "replaced" in second
        assert "wrote" not in second


def test_train_says_that_rows_are_few_or_the_same(observations, tmp_path, run_json):
    header, *rows = observations.read_text(encoding="utf-8").splitlines()
    rows = [row for row in rows if "visible" in row][::60]
    path = tmp_path / "few.csv"
    path.write_text("\n".join([header, *rows, *rows]), encoding="utf-8")
    words = ("-m", "q_k1", "-o", tmp_path, "--restarts", 1)
    repeated, few = run_json("train", path, *words)["notes"]
    assert "4 rows of the table repeat another one" in repeated
    assert "q_k1 learnt from 8 rows only" in few
    assert run_json("train", observations, *words)["notes"] == []


@pytest.mark.parametrize(
    ("name", "kind"),
    [
        ("plate", "campaign"),
        ("plate/sensor.json", "sensor"),
        ("plate/campaign.json", "campaign"),
        ("plate/features.csv", "feature list"),
        ("plate/captures/000000/image.png", "image"),
        ("observations.csv", "observation table"),
        ("models/q_k4.exposight-model", "model"),
    ],
)
def test_info_recognises_the_method_s_own_files(name, kind, campaign, models, run_json):
    assert models.is_dir()
    assert run_json("info", campaign.parent / name)["kind"] == kind


@pytest.mark.parametrize(
    ("name", "text", "kind"),
    [
        ("a.xyz", "1 2 3\n4 5 6\n", "point cloud"),
        ("a.csv", "x_mm,y_mm,z_mm\n1,2,3\n", "point cloud"),
        (
            "a.toml",
            'name="s"\nprojector_width=8\nprojector_height=4\nwhite_frame=3\nblack_frame=4\n'
            "[columns.gray_code]\nframes=[0,1,2]\n",
            "pattern sequence",
        ),
        (
            "a.yaml",
            "image_width: 4\nimage_height: 3\ncamera_matrix:\n  rows: 3\n  cols: 3\n"
            "  data: [2., 0, 1, 0, 2, 1, 0, 0, 1]\ndistortion_coefficients:\n  rows: 1\n"
            "  cols: 5\n  data: [0., 0, 0, 0, 0]\ndistortion_model: plumb_bob\n",
            "calibration",
        ),
    ],
)
def test_info_recognises_what_comes_from_elsewhere(name, text, kind, tmp_path, run_json):
    path = tmp_path / name
    path.write_text(text, encoding="utf-8")
    assert run_json("info", path)["kind"] == kind


def test_info_tells_people_the_same(models, run):
    result = run("info", models / "e_k4.exposight-model")
    assert "exposure time, 4D" in result.stdout
    assert "−40 to 40 mm" in result.stdout


def test_tables_fit_eighty_columns(models, observations, monkeypatch, run):
    monkeypatch.setenv("COLUMNS", "80")
    lines = run("evaluate", *sorted(models.iterdir()), observations).stdout.splitlines()
    tables = [line for line in lines if line.startswith(("q_", "e_"))]
    assert len(tables) > 4
    assert max(map(len, tables)) <= 80


def test_a_campaign_copied_elsewhere_is_the_same(campaign, tmp_path, run_json):
    copy = tmp_path / "copy"
    shutil.copytree(campaign, copy)
    assert {**run_json("info", copy), "path": ""} == {**run_json("info", campaign), "path": ""}
