"""Tables and clouds in other units than ours: they are noticed, and what to do is said."""

import polars as pl
import pytest
from polars.testing import assert_frame_equal

from exposight.cell import Cloud, read_cloud, write_cloud
from exposight.observing import ObservationTable, read_observations


@pytest.fixture
def scaled(observations, tmp_path):
    """Write the plate's table with its exposure times in another unit."""

    def write(factor):
        frame = read_observations(observations).frame
        path = tmp_path / "scaled.csv"
        ObservationTable(frame=frame.with_columns(pl.col("exposure_ms") * factor)).write(path)
        return path

    return write


@pytest.mark.parametrize(
    ("factor", "unit", "remedy"),
    [
        (1e-3, "s", "multiply by 1000 in column exposure_ms"),
        (1e3, "µs", "divide by 1000 in column exposure_ms"),
        (1e6, "ns", "divide by 1000000 in column exposure_ms"),
    ],
)
@pytest.mark.parametrize("name", ["q_k4", "e_k4"])
def test_exposure_times_in_another_unit(name, factor, unit, remedy, scaled, models, run_json):
    model = models / f"{name}.exposight-model"
    table = scaled(factor)
    for command in ("evaluate", "predict"):
        notes = " ".join(run_json(command, model, table)["notes"])
        assert f"they seem to be in {unit}; {remedy}, which is in ms" in notes


@pytest.mark.parametrize("factor", [1.0, 0.5, 3.0])
def test_exposure_times_in_ms_are_not_remarked_on(factor, scaled, models, run_json):
    told = run_json("predict", models / "e_k4.exposight-model", scaled(factor))
    assert not any("seem to be in" in note for note in told["notes"])


def test_a_table_without_exposure_times_is_not_remarked_on(models, tmp_path, run_json):
    path = tmp_path / "planned.csv"
    path.write_text("i_avg,z_mm,x_mm,y_mm\n80,0,50,-40\n", encoding="utf-8")
    assert run_json("predict", models / "e_k4.exposight-model", path)["notes"] == []


@pytest.fixture
def positions_in_metres(observations, tmp_path):
    frame = read_observations(observations).frame
    path = tmp_path / "metres.csv"
    frame = frame.with_columns(pl.col("x_mm", "y_mm", "z_mm") / 1000)
    ObservationTable(frame=frame).write(path)
    return path


def test_positions_in_metres_are_remarked_on(positions_in_metres, models, tmp_path, run_json):
    model = models / "q_k4.exposight-model"
    for command in ("evaluate", "predict"):
        notes = run_json(command, model, positions_in_metres)["notes"]
        assert any("mm where q_k4 was trained: are they in metres?" in note for note in notes)
    words = ("-m", "q_k1", "-o", tmp_path, "--restarts", 1)
    notes = run_json("train", positions_in_metres, *words)["notes"]
    assert "mm from 0: are they in metres?" in notes[0]


def test_one_position_is_not_remarked_on(models, tmp_path, run_json):
    path = tmp_path / "planned.csv"
    path.write_text("i_avg,z_mm,x_mm,y_mm\n80,0,0,0\n90,0,0,0\n", encoding="utf-8")
    assert run_json("predict", models / "q_k4.exposight-model", path)["notes"] == []


@pytest.fixture
def in_metres(single, tmp_path):
    """Return the words that observe the single capture, its cloud in m."""
    path = tmp_path / "metres.ply"
    write_cloud(path, Cloud(points=1e-3 * read_cloud(single / "cloud.ply").points))
    return (
        *("observe", "--image", single / "stripes.png", "--cloud", path),
        *("--features", single / "features.csv", "--sensor", single / "sensor.json"),
        *("--exposure-ms", 10, "--pose", single / "pose.txt", "-o", tmp_path / "o.csv"),
    )


def test_a_cloud_in_metres_is_refused(in_metres, tmp_path, run):
    result = run(*in_metres)
    assert result.exit_code == 1
    assert "the cloud is in m: --cloud-unit m (then p_norm is about 1.00)" in result.stderr
    assert not (tmp_path / "o.csv").exists()


def test_a_cloud_whose_unit_is_said(in_metres, single, tmp_path, run_json):
    run_json(*in_metres, "--cloud-unit", "m")
    told = read_observations(tmp_path / "o.csv")
    pose = ("--pose", single / "pose.txt", "-o", tmp_path / "mm.csv")
    words = [word for word in in_metres[:-4] if word != tmp_path / "metres.ply"]
    words.insert(words.index("--cloud") + 1, single / "cloud.ply")
    run_json(*words, *pose)
    # Coordinates are kept in single precision: in m their last digits are others.
    assert_frame_equal(
        told.frame, read_observations(tmp_path / "mm.csv").frame, atol=1e-3, rtol=1e-4
    )


def test_a_campaign_s_unit_cannot_be_said(campaign, run):
    result = run("observe", campaign, "--cloud-unit", "m")
    assert result.exit_code == 2
    assert "not both (got --cloud-unit)" in result.stderr
