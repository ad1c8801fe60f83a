"""``exposight plan``: which exposures of which views, who fails, and wrong calls."""

import json

import numpy as np
import pytest
import trimesh

from exposight.cell import sensor_preset
from exposight.geometry import RigidTransform
from exposight.planning import read_exposure_plan
from exposight.plans import MeasuringPlan, PoseList, read_plan, write_plan


@pytest.fixture
def plan(models, campaign, run_json):
    def call(*words, views=campaign):
        return run_json("plan", models, "--views", views, "--confidence", 0.6, *words)

    return call


def test_the_first_line_is_the_answer(models, campaign, run):
    ended = run("plan", models, "--views", campaign, "--confidence", 0.6)
    assert ended.exit_code == 0, ended.stderr
    first = ended.stdout.splitlines()[0]
    assert first.startswith("take ")
    assert "features will reach 0.75 with a chance of 60 % or more" in first


def test_the_plan_s_file_holds_what_is_told(plan, tmp_path):
    path, capture_plan = tmp_path / "plan.json", tmp_path / "next.toml"
    told = plan("-o", path, "--measuring-plan", capture_plan, "--flicker", 50)
    written = read_exposure_plan(path)
    assert told["captures"] == written.n_captures == sum(v["captures"] for v in told["views"])
    assert told["certificate"]["proven"] is True
    assert all(t % 10 == 0 for view in told["views"] for t in view["exposures_ms"])
    assert len(written.models) == 2
    assert all(each.sha256 for each in written.models)
    assert {file["kind"] for file in told["files"]} == {"exposure plan", "measuring plan"}
    planned = read_plan(capture_plan)
    taken = {v.name: sorted(e.exposure_ms for e in v.exposures) for v in written.views}
    (poses,) = planned.poses
    assert {n: list(t) for n, t in zip(poses.names, poses.exposures_each_ms, strict=True)} == taken
    assert json.loads(path.read_text("utf-8"))["format"] == "exposight plan"


def test_least_time_takes_no_longer_than_fewest_captures(plan):
    costs = ("--frames", 12, "--overhead", 500, "--move", 3000)
    fewest, quickest = plan(*costs), plan(*costs, "--goal", "time")
    assert quickest["time_s"] <= fewest["time_s"] + 1e-6
    assert fewest["captures"] <= quickest["captures"]


def test_views_of_a_table_have_no_poses_and_the_plan_says_so(
    models, campaign, run, run_json, tmp_path
):
    table, path = tmp_path / "table.csv", tmp_path / "plan.json"
    assert run("observe", campaign, "-o", table).exit_code == 0
    told = run_json("plan", models, "--views", table, "--confidence", 0.6, "-o", path)
    assert any("does not tell where" in note for note in told["notes"])


def test_a_budget_and_the_trade_off(plan):
    told = plan("--budget", 1, "--trade-off")
    assert told["captures"] <= 1
    curve = told["trade_off"]
    assert [point["captures"] for point in curve] == sorted(p["captures"] for p in curve)
    assert all(point["features"] <= point["bound"] for point in curve)


@pytest.mark.parametrize(
    ("words", "status", "message"),
    [
        (("--confidence", 1), 1, "confidence is a chance above 0 and below 1"),
        (("--budget", 0), 1, "a whole number of captures, at least one, got 0"),
        (("--budget-s", 0), 2, "Must be > 0"),
        (("--budget", 2, "--budget-s", 2), 2, "not both"),
        (("--budget", 2, "--goal", "time"), 2, "--budget counts captures"),
        (("--expected-misses", 500), 1, "expected misses are a number above 0 and below"),
        (("--time-limit", 0), 2, "Must be > 0"),
        (("--limits", "zivid"), 1, "did you mean 'zivid-2'"),
        (("-o", "plan.toml"), 2, "the exposure plan is a .json file"),
        (("--sensor", "comet-pro-ae"), 2, "--sensor goes with --views auto"),
        (("--reach", "0:1,0:1,0:1"), 2, "go with --views auto"),
        (("--features", "f.csv"), 2, "--features goes with a measuring plan"),
    ],
)
def test_a_wrong_wish_is_named(words, status, message, models, campaign, run):
    ended = run("plan", models, "--views", campaign, *words)
    assert ended.exit_code == status
    assert message in " ".join(ended.stderr.split())


def test_views_found_by_themselves_need_features(models, run):
    ended = run("plan", models, "--views", "auto")
    assert ended.exit_code == 2
    assert "--views auto needs the part's features" in ended.stderr


def test_views_of_another_sensor_have_no_model(models, tmp_path, run):
    features = tmp_path / "f.csv"
    features.write_text("name,kind,x_mm,y_mm,z_mm,nx,ny,nz,radius_mm\nh1,hole,0,0,0,0,0,-1,5\n")
    poses = PoseList.from_transforms(
        "near",
        [RigidTransform(translation_mm=np.array([0.0, 0.0, 500.0]))],
        exposures_ms=[5.0],
    )
    write_plan(
        tmp_path / "other.toml",
        MeasuringPlan(
            name="other", sensor=sensor_preset("rc-visard-65"), features=("h1",), poses=(poses,)
        ),
    )
    ended = run("plan", models, "--views", tmp_path / "other.toml", "--features", features)
    assert ended.exit_code == 1
    assert "there is no model for this sensor" in " ".join(ended.stderr.split())


def test_views_are_found_from_features_sensor_and_mesh(models, campaign, tmp_path, run_json):
    mesh = tmp_path / "plate.stl"
    trimesh.creation.box(bounds=[(-250, -150, 0), (250, 150, 2)]).export(mesh)
    features = tmp_path / "features.csv"
    lines = (campaign / "features.csv").read_text("utf-8").splitlines()
    features.write_text("\n".join(line for line in lines if not line.startswith("far")), "utf-8")
    told = run_json(
        *("plan", models, "--views", "auto", "--features", features, "--mesh", mesh),
        *("--count", 5, "--reach", "-200:200,-200:200,-700:-450", "--confidence", 0.6),
    )
    assert 1 <= told["views_to_choose_from"] <= 5
    assert {row["feature"] for row in told["features"]} == {f"h{i:02d}" for i in range(1, 13)}
    assert all(view["view"].startswith("auto-") for view in told["views"])
