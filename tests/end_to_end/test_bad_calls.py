"""What the command line says where a call cannot work: one line, and the right exit status."""

import polars as pl
import pytest

from exposight.observing import read_observations

POSE = ("--x-mm", 50, "--y-mm", 0, "--z-mm", 0)


@pytest.fixture
def failing(run):
    """Run a call that must fail with status 1, and return the line that says why."""

    def invoke(*arguments):
        result = run(*arguments)
        assert result.exit_code == 1
        assert result.stdout == ""
        *stages, line = result.stderr.splitlines()
        assert all(stage.endswith(" …") for stage in stages)
        assert line.startswith("error: ")
        return line

    return invoke


@pytest.fixture
def single_options(single):
    return {
        "--image": single / "stripes.png",
        "--cloud": single / "cloud.ply",
        "--features": single / "features.csv",
        "--sensor": single / "sensor.json",
        "--exposure-ms": 10,
        "--pose": single / "pose.txt",
    }


def observe_single(options, folder):
    return [
        "observe",
        *(word for option in options.items() for word in option),
        "-o",
        folder / "o.csv",
    ]


# -- tables -------------------------------------------------------------------------------------


def test_a_table_with_another_unit(observations, tmp_path, failing):
    path = tmp_path / "seconds.csv"
    path.write_text(observations.read_text(encoding="utf-8").replace("x_mm", "x_s", 1), "utf-8")
    message = failing("train", path, "-o", tmp_path)
    assert "'x_s' has the unit 's', expected x_mm" in message


def test_a_table_with_another_header(tmp_path, failing):
    path = tmp_path / "other.csv"
    path.write_text("a,b\n1,2\n", encoding="utf-8")
    assert "missing columns feature, view" in failing("evaluate", tmp_path / "no-model", path)


def test_a_missing_table(models, tmp_path, failing):
    message = failing("evaluate", models / "q_k4.exposight-model", tmp_path / "none.csv")
    assert "none.csv: no such observation table" in message


def test_too_few_observations(observations, tmp_path, failing):
    path = tmp_path / "few.csv"
    lines = observations.read_text(encoding="utf-8").splitlines()
    path.write_text("\n".join(lines[:4]), encoding="utf-8")
    assert "observations" in failing("train", path, "-m", "q_k6", "-o", tmp_path)


def test_a_table_without_rows(observations, models, tmp_path, failing):
    path = tmp_path / "empty.csv"
    path.write_text(observations.read_text(encoding="utf-8").splitlines()[0] + "\n", "utf-8")
    model = models / "q_k4.exposight-model"
    assert "has no rows, so there is nothing to predict" in failing("predict", model, path)
    assert "has no rows, so there is nothing to split" in failing("split", path, "-o", tmp_path)


def test_a_campaign_where_its_table_is_expected(campaign, tmp_path, failing):
    message = failing("split", campaign, "-o", tmp_path)
    assert "a campaign's folder, no observation table; `exposight observe` makes" in message


def test_a_feature_list_where_a_table_is_expected(campaign, tmp_path, failing):
    message = failing("train", campaign / "features.csv", "-o", tmp_path)
    assert "a list of a part's features, not observations of them" in message


def test_a_table_where_a_campaign_is_expected(observations, failing):
    assert "a table; expected a campaign's folder" in failing("observe", observations)


# -- outputs that are inputs --------------------------------------------------------------------


def test_predictions_do_not_replace_their_own_table(observations, models, tmp_path, failing):
    path = tmp_path / "planned.csv"
    path.write_bytes(observations.read_bytes())
    message = failing("predict", models / "q_k4.exposight-model", path, "-o", path)
    assert "is read by this command and would be replaced; give another --output" in message
    assert path.read_bytes() == observations.read_bytes()


def test_a_split_does_not_replace_its_own_table(observations, tmp_path, failing):
    path = tmp_path / "train.csv"
    path.write_bytes(observations.read_bytes())
    assert "would be replaced" in failing("split", path, "-o", tmp_path)
    assert path.read_bytes() == observations.read_bytes()


def test_observations_do_not_replace_the_features(single_options, failing):
    call = observe_single(single_options, single_options["--image"].parent)[:-1]
    features = single_options["--features"]
    before = features.read_bytes()
    assert "would be replaced" in failing(*call, features)
    assert features.read_bytes() == before


def test_a_file_where_a_folder_is_needed(observations, tmp_path, failing):
    path = tmp_path / "models"
    path.write_text("", encoding="utf-8")
    message = failing("train", observations, "-o", path)
    assert "cannot be used for the models: it is a file, and a folder is needed" in message


# -- models -------------------------------------------------------------------------------------


def test_an_unknown_model_name(observations, tmp_path, failing):
    message = failing("train", observations, "-m", "q_k5", "-o", tmp_path)
    assert "no model 'q_k5'; expected one of quality, exposure, q_k1, q_k2" in message


def test_a_damaged_model(models, tmp_path, failing):
    path = tmp_path / "bad.exposight-model"
    data = bytearray((models / "q_k4.exposight-model").read_bytes())
    data[len(data) // 2] ^= 1
    path.write_bytes(data)
    for command in ("info", "predict"):
        words = () if command == "info" else ("--i-avg", 100, *POSE)
        assert "damaged or cut short" in failing(command, path, *words)


def test_something_else_than_a_model(observations, failing):
    assert "expected a model file" in failing("predict", observations, "--i-avg", 100, *POSE)


def test_a_missing_input(models, run):
    result = run("predict", models / "q_k4.exposight-model", "--i-avg", 100, "--x-mm", 1)
    assert result.exit_code == 2
    assert "give the missing --z-mm, --y-mm too" in result.stderr


def test_an_impossible_grey_value(models, failing):
    message = failing("predict", models / "q_k4.exposight-model", "--i-avg", 300, *POSE)
    assert "grey levels from 0 to 255, got 300" in message


def test_a_table_without_the_model_s_inputs(models, tmp_path, failing):
    path = tmp_path / "poses.csv"
    header = "feature,view,exposure_ms,p_norm,i_avg,x_mm,y_mm,z_mm,w_deg,p_deg,r_deg,radius_mm"
    path.write_text(f"{header}\nf,v,1,,,1,2,3,0,0,0,5\n", encoding="utf-8")
    message = failing("predict", models / "q_k4.exposight-model", path)
    assert "no row has all inputs of q_k4" in message


# -- sensors, exposures, poses ------------------------------------------------------------------


def test_an_exposure_outside_the_sensor_s_range(single_options, tmp_path, failing):
    message = failing(*observe_single({**single_options, "--exposure-ms": 51}, tmp_path))
    assert "takes exposure times from 0.5 to 50 ms, got 51 ms" in message


@pytest.mark.slow
def test_observations_that_the_sensor_cannot_have_taken(observations, tmp_path, failing):
    sensor = ("--sensor", "rc-visard-65", "-o", tmp_path)
    assert "are of sensor 'small', the one given is" in failing("train", observations, *sensor)
    nameless = tmp_path / "nameless.csv"
    frame = read_observations(observations).frame.with_columns(sensor=pl.lit(None, pl.String))
    frame.write_csv(nameless)
    for models in ((), ("-m", "q_k1")):
        message = failing("train", nameless, *sensor, *models)
        assert "from 0.07 to 18 ms, got 40 ms" in message


def test_an_unknown_sensor(observations, tmp_path, failing):
    message = failing("train", observations, "-o", tmp_path, "--sensor", "kinect")
    assert "no sensor 'kinect': expected one of the presets comet-pro-ae, rc-visard-65" in message


def test_a_pose_of_too_few_numbers(single_options, tmp_path, failing):
    path = tmp_path / "pose.txt"
    path.write_text("1 0 0 0", encoding="utf-8")
    message = failing(*observe_single({**single_options, "--pose": path}, tmp_path))
    assert "needs 16 numbers" in message
    assert "got 4 numbers" in message


def test_a_pose_that_is_no_rotation(single_options, tmp_path, failing):
    path = tmp_path / "pose.txt"
    path.write_text("2 0 0 0  0 1 0 0  0 0 1 600  0 0 0 1", encoding="utf-8")
    message = failing(*observe_single({**single_options, "--pose": path}, tmp_path))
    assert f"{path}: not a rotation" in message


def test_a_robot_that_nobody_knows(single_options, tmp_path, failing):
    del single_options["--pose"]
    call = observe_single(single_options, tmp_path)
    message = failing(*call, "--robot-pose", "staubli", "0,0,0,0,0,0")
    assert "halcon or matrix, got 'staubli'" in message


def test_a_robot_s_pose_with_a_number_missing(single_options, tmp_path, failing):
    del single_options["--pose"]
    message = failing(*observe_single(single_options, tmp_path), "--robot-pose", "fanuc", "0,0,6")
    assert "a fanuc pose needs 6 numbers x_mm,y_mm,z_mm,w_deg,p_deg,r_deg, got 3 numbers" in message


# -- files --------------------------------------------------------------------------------------


def test_a_missing_campaign(tmp_path, failing):
    assert "no campaign at" in failing("observe", tmp_path / "none")


def test_a_folder_that_is_no_campaign(tmp_path, failing):
    assert "campaign.json" in failing("observe", tmp_path)


def test_an_unknown_sequence(tmp_path, failing):
    message = failing("decode", tmp_path, "-c", tmp_path / "c.xml", "-s", "gray")
    assert "no pattern sequence 'gray': expected one of the presets skull_gray" in message


def test_a_missing_calibration(tmp_path, failing):
    message = failing("decode", tmp_path, "-c", tmp_path / "c.xml", "-s", "board")
    assert "c.xml: no such calibration file" in message


def test_a_file_that_nobody_knows(tmp_path, failing):
    path = tmp_path / "notes.doc"
    path.write_text("…", encoding="utf-8")
    message = failing("info", path)
    assert "it knows campaign (folder with campaign.json)" in message


def test_a_missing_file(tmp_path, failing):
    assert "no such file or folder, nor a plan or sensor" in failing("info", tmp_path / "none.ply")


def test_a_table_of_something_else(tmp_path, failing):
    path = tmp_path / "prices.csv"
    path.write_text("item,price\n", encoding="utf-8")
    assert "not something that exposight knows" in failing("info", path)


def test_a_pose_given_twice(single_options, tmp_path, run):
    call = observe_single(single_options, tmp_path)
    result = run(*call, "--robot-pose", "fanuc", "-1,0,600,0,0,0")
    assert result.exit_code == 2
    assert "give the pose once" in result.stderr
