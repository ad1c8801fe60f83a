"""``exposight train --target`` and ``recommend --target``: exposures for the best diameter."""

import numpy as np
import polars as pl
import pytest
from tests.models.rings import BLACK, SENSOR, observed

from exposight.cell import write_sensor
from exposight.geometry import RigidTransform
from exposight.planning import SensorModels

TARGET = ("--target", "diameter_error_mm")


@pytest.fixture(scope="module")
def trained(tmp_path_factory, run_json):
    folder = tmp_path_factory.mktemp("targets")
    frame = observed().frame
    grey = frame["i_mean"].to_numpy() - BLACK
    error = np.where(grey < 180.0, 0.02 + 0.05 * np.log(grey / 40.0) ** 2, np.nan)
    column = pl.Series("diameter_error_mm", error).fill_nan(None)
    frame.with_columns(column).write_csv(folder / "observations.csv")
    models = folder / "models"
    words = (
        "train",
        folder / "observations.csv",
        *TARGET,
        "-o",
        models,
        "--sensor",
        "comet-pro-ae",
    )
    return models, run_json(*words)


@pytest.fixture(scope="module")
def view(trained, tmp_path_factory):
    folder = tmp_path_factory.mktemp("view")
    write_sensor(folder / "sensor.json", SENSOR)
    lines = ["name,kind,x_mm,y_mm,z_mm,nx,ny,nz,radius_mm", "a,hole,0,0,0,0,0,-1,5"]
    (folder / "features.csv").write_text("\n".join(lines) + "\n", "utf-8")
    pose = SENSOR.camera_from_tcp @ RigidTransform.from_fanuc_wpr((0, 0, 0), 0, -10, 8)
    np.savetxt(folder / "pose.txt", pose.to_matrix())
    files = ("--sensor", folder / "sensor.json", "--features", folder / "features.csv")
    return (*files, "--pose", folder / "pose.txt")


def test_the_model_says_where_it_is_measured(trained):
    models, told = trained
    assert {row["target"] for row in told["models"]} >= {"p_norm", "diameter_error_mm"}
    assert (
        "at least 50 % of the captures measure it"
        in SensorModels.load(models, target="diameter_error_mm").quality.title
    )


def test_the_answer_names_target_and_unit(trained, view, run, tmp_path):
    picture = tmp_path / "r.svg"
    ended = run("recommend", trained[0], *view, *TARGET, "--at-most", 0.05, "--picture", picture)
    assert ended.exit_code == 0, ended.stderr
    assert "have diameter_error_mm of at most 0.05 mm" in " ".join(ended.stdout.split())
    assert "p_norm" not in ended.stdout + ended.stderr


def test_without_a_limit_the_best_is_asked_for(trained, view, run_json):
    told = run_json("recommend", trained[0], *view, *TARGET)
    assert 0.0 < told["need"] < 0.05
    assert told["target"] == "diameter_error_mm"


def test_a_limit_of_the_wrong_side_is_refused(trained, view, run):
    ended = run("recommend", trained[0], *view, *TARGET, "--need", 0.9)
    assert ended.exit_code == 2
    assert "diameter_error_mm is asked for by --at-most" in ended.stderr
