"""``exposight simulate``: a box with a hole's ring on it, measured from two views."""

import os
import shutil
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh

from exposight.cell import (
    CampaignFolder,
    Feature,
    Part,
    read_sensor,
    sensor_preset,
    write_features,
    write_sensor,
)
from exposight.geometry import PinholeCamera, RigidTransform
from exposight.observing import read_observations
from exposight.plans import PLANS
from exposight.twin.part import Scene, door, export_scene, read_scene

PLAN = """
format = "exposight measuring plan"
version = 1
name = "box"
sensor = "comet-pro-ae"
features = ["spot", "aside"]
reference = "spot"
blind_views = "skip"

[[planes]]
name = "middle"
z_tcp_mm = 0
x_mm = [-40, 40]
y_mm = [0]
exposures_ms = [50, 150]
"""


def spot(name, x_mm):
    pose = RigidTransform(translation_mm=np.array([x_mm, 0.0, 0.0]))
    return Feature(name=name, kind="surface_point", part_from_feature=pose, radius_mm=6.0)


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    """A primed plate in the plane z = 0; one of its features is never in the frame."""
    mesh = trimesh.creation.box(extents=(900.0, 60.0, 4.0)).subdivide_to_size(60.0)
    features = (spot("spot", 0.0), spot("aside", -420.0))
    folder = tmp_path_factory.mktemp("box")
    export_scene(
        folder,
        Scene(
            vertices=np.add(mesh.vertices, [0, 0, 2]),
            faces=mesh.faces,
            face_finish=np.ones(len(mesh.faces), dtype=np.uint8),
            part=Part(name="box", features=features),
        ),
        sensor_preset("comet-pro-ae"),
    )
    return folder


@pytest.fixture(scope="module")
def plan(tmp_path_factory):
    path = tmp_path_factory.mktemp("plan") / "box.toml"
    path.write_text(PLAN, encoding="utf-8")
    return path


@pytest.fixture(scope="module")
def options(scene):
    return ("--scene", scene, "--rings-only", "--workers", 1)


@pytest.fixture(scope="module")
def simulated(plan, options, run_json, tmp_path_factory):
    folder = tmp_path_factory.mktemp("simulated") / "box"
    return folder, run_json("simulate", plan, "-o", folder, *options)


def test_no_more_workers_are_told_than_there_are_views(simulated, plan, options, run_json):
    folder, _ = simulated
    words = (*options[:-1], 5)  # the campaign is there, so nothing is left to do
    assert run_json("simulate", plan, "-o", folder, *words)["workers"] == 2


def test_a_plan_becomes_a_campaign(simulated):
    folder, told = simulated
    assert len(CampaignFolder(folder)) == 4
    size = sum(path.stat().st_size for path in folder.rglob("*") if path.is_file())
    expected = {
        "plan": "box",
        "sensor": "comet-pro-ae",
        "part": "box",
        "workers": 1,
        "views": 2,
        "views_of_feature": {"spot": 2, "aside": 0},
        "captures": 4,
        "captures_before": 0,
        "exposures_ms": {"min": 50, "max": 150},
        "bytes": size,
    }
    assert {key: told[key] for key in expected} == expected
    assert told["files"][0]["path"] == str(folder)


def test_the_scenes_sensor_measures_unless_another_is_given(plan, scene, run, run_json, tmp_path):
    folder = tmp_path / "scene"
    shutil.copytree(scene, folder)
    dim = {"camera": {"full_well_e": 20_000.0}, "fringes": [1, 8, 60], "steps": 5}
    sensor = replace(sensor_preset("comet-pro-ae"), name="dim", simulated=dim)
    write_sensor(folder / "sensor.json", sensor)
    out = tmp_path / "campaign"
    told = run_json("simulate", plan, "--scene", folder, "--rings-only", "-o", out)
    assert told["sensor"] == "dim"
    assert "the sensor is the scene's, dim, not the plan's" in told["notes"]
    assert read_sensor(out / "sensor.json") == sensor
    write_sensor(tmp_path / "mine.json", replace(sensor, name="mine"))
    told = run_json(
        *("simulate", plan, "--scene", folder, "--rings-only", "-o", tmp_path / "other"),
        *("--sensor", tmp_path / "mine.json"),
    )
    assert told["sensor"] == "mine"
    write_sensor(tmp_path / "bad.json", replace(sensor, simulated={"camera": {"iso": 100}}))
    ended = run("simulate", plan, "--sensor", tmp_path / "bad.json", "-o", tmp_path / "none")
    assert ended.exit_code == 1
    assert "simulated: key 'camera.iso' is unknown" in ended.stderr


def test_an_exported_scene_has_what_the_plan_says_of_part_and_sensor(
    plan, scene, run_json, tmp_path
):
    own = tmp_path / "own.toml"
    own.write_text(
        plan.read_text(encoding="utf-8").replace("version = 1", "version = 2")
        + '[simulated]\nfinish = "paint"\nsensor = { fringes = [1, 5] }\n',
        encoding="utf-8",
    )
    folder = tmp_path / "exported"
    run_json("simulate", own, "--scene", scene, "--export-scene", folder)
    exported = read_scene(folder)
    assert {list(exported.surfaces)[i] for i in exported.face_finish} == {"paint"}
    assert read_sensor(folder / "sensor.json").simulated == {"fringes": [1, 5]}


def test_info_says_what_is_simulated(simulated, scene, run_json):
    folder, _ = simulated
    campaign = run_json("info", folder)
    assert (campaign["simulated"], campaign["clouds"]) == (True, 4)
    exported = run_json("info", scene)
    assert exported["kind"] == "scene"
    assert exported["features"] == ["spot", "aside"]


def test_the_campaign_is_observed_like_a_recorded_one(simulated, run_json, tmp_path):
    folder, _ = simulated
    told = run_json("observe", folder, "-o", tmp_path / "o.csv")
    counts = {line["visibility"]: line["rows"] for line in told["visibility"]}
    assert counts == {"visible": 4, "out of frame": 4}
    (p_norm,) = (line for line in told["ranges"] if line["column"] == "p_norm")
    assert p_norm["max"] > 0.95


def test_observing_at_once_gives_the_same_table(simulated, plan, options, run, run_json, tmp_path):
    folder, _ = simulated
    run("observe", folder, "-o", tmp_path / "after.csv")
    at_once = tmp_path / "at-once.csv"
    told = run_json("simulate", plan, "--observe", "-o", at_once, *options)
    assert read_observations(at_once).frame.equals(read_observations(tmp_path / "after.csv").frame)
    assert sum(line["rows"] for line in told["visibility"]) == 8
    assert told["files"][0]["path"] == str(at_once)


def test_people_are_told_what_was_taken_and_what_comes_next(plan, options, run, tmp_path):
    folder = tmp_path / "box"
    result = run("simulate", plan, "-o", folder, *options)
    assert result.exit_code == 0, result.stderr
    lines = [" ".join(line.split()) for line in result.stdout.splitlines()]
    assert "captures 4" in lines
    assert "note: no view sees aside" in lines
    assert lines[-1] == f"next: exposight observe {folder}"
    assert "measuring …" in result.stderr.splitlines()


def test_the_same_command_goes_on(simulated, plan, options, run_json, tmp_path):
    folder = tmp_path / "box"
    shutil.copytree(simulated[0], folder)
    shutil.rmtree(folder / "captures" / "000002")
    assert run_json("simulate", plan, "-o", folder, *options)["captures_before"] == 3
    assert len(CampaignFolder(folder)) == 4


def test_without_clouds_the_campaign_is_observed(simulated, plan, options, run, run_json, tmp_path):
    told = run_json("simulate", plan, "--no-clouds", "-o", tmp_path / "box", *options)
    run("observe", simulated[0], "-o", tmp_path / "after.csv")
    at_once = read_observations(told["files"][1]["path"])
    assert at_once.frame.equals(read_observations(tmp_path / "after.csv").frame)
    message = error_of(run("observe", tmp_path / "box", "-o", tmp_path / "again.csv"))
    assert "view 'middle-x1-y1' at 50 ms was kept without its cloud" in message


@pytest.mark.slow
def test_raw_frames_are_decoded_like_a_recording(plan, options, run_json, tmp_path):
    folder = tmp_path / "box"
    run_json("simulate", plan, "--raw-frames", "-o", folder, *options)
    decoded = run_json(
        *("decode", folder / "captures" / "000001", "-s", folder / "sequence.toml"),
        *("-c", folder / "calibration.yml", "--min-modulation", 18),
    )
    (_, capture, *_) = CampaignFolder(folder).captures()
    # decode tolerates more residual between the phases than the twin does
    assert decoded["points"] == pytest.approx(capture.cloud.n_valid, rel=0.01)
    assert decoded["depth_mm"]["median"] == pytest.approx(
        np.median(capture.cloud.valid_points[:, 2]), abs=0.05
    )


def test_a_cluster_that_is_not_there(run, plan, scene, tmp_path):
    pytest.importorskip("distributed", reason="Dask is not installed")
    words = ("--scene", scene, "--cluster", "tcp://host", "-o", tmp_path / "box")
    message = error_of(run("simulate", plan, *words))
    assert "no Dask scheduler answers at 'tcp://host' (not an address)" in message
    assert not (tmp_path / "box").exists()


def test_a_scene_that_is_not_there(run, plan, tmp_path):
    message = error_of(run("simulate", plan, "--scene", tmp_path, "-o", tmp_path / "box"))
    assert f"no scene at {tmp_path / 'scene.toml'}" in message
    assert "exposight simulate PLAN --export-scene FOLDER" in message


def test_a_mesh_with_its_features_is_a_scene(run_json, plan, tmp_path):
    mesh = trimesh.creation.box(extents=(200.0, 60.0, 4.0))
    mesh.apply_translation((0, 0, 2)).export(tmp_path / "plate.stl")
    write_features(tmp_path / "plate.csv", (spot("spot", 0.0), spot("aside", 20.0)))
    options = ("--scene", tmp_path / "plate.stl", "--rings-only", "--workers", 1)
    campaign = run_json("simulate", plan, *options, "-o", tmp_path / "campaign")
    assert (campaign["part"], campaign["captures"]) == ("plate", 4)
    assert run_json("info", tmp_path / "plate.stl")["kind"] == "scene"
    options = ("--scene", tmp_path / "plate.stl", "--export-scene", tmp_path / "exported")
    exported = run_json("simulate", plan, *options)
    assert exported["triangles"] == 12
    assert {path.name for path in (tmp_path / "exported").iterdir()} == {
        Path(file["path"]).name for file in exported["files"]
    }
    assert run_json("info", tmp_path / "exported")["part"] == "plate"


@pytest.mark.slow
def test_a_preset_is_known_by_name_and_exported_for_other_programs(run_json, tmp_path):
    told = run_json("simulate", "stereo-x", "--export-scene", tmp_path / "scene")
    scene = read_scene(tmp_path / "scene")
    assert told["triangles"] == len(scene.faces) == len(door().faces)
    assert told["features"] == len(scene.part.features)
    assert (
        read_sensor(tmp_path / "scene" / "sensor.json").name == sensor_preset("rc-visard-65").name
    )


def test_plans_are_listed(run, run_json):
    listed = run("simulate", "--list").stdout
    assert all(name in listed for name in PLANS)
    plans = {plan["plan"]: plan for plan in run_json("simulate", "--list")["plans"]}
    assert plans["x"]["captures"] == 480  # as in the paper's Table 9
    assert plans["x-out"]["views"] == 14


@pytest.mark.slow
def test_a_sensor_is_checked(run, run_json, plan, tmp_path):
    camera = PinholeCamera(width=160, height=120, fx=280.0, fy=280.0, cx=79.5, cy=59.5)
    preset = sensor_preset("comet-pro-ae")
    sensor = replace(
        preset, name="mine", cameras=(camera,), simulated={"camera": {"bit_depth": 12}}
    )
    write_sensor(tmp_path / "mine.json", sensor)
    page = tmp_path / "page.html"
    words = ("simulate", plan, "--check", "--sensor", tmp_path / "mine.json", "-o", page)
    told = run_json(*words)
    assert told["agrees"] is True
    assert told["verdict"] in page.read_text(encoding="utf-8")
    gain = next(each for each in told["figures"] if each["figure"] == "system_gain_dn_per_e")
    assert gain["measured"] == pytest.approx(gain["expected"], rel=0.002)
    assert set(gain) == {
        *("figure", "label", "unit", "measured", "expected", "deviation", "tolerance", "agrees")
    }
    assert [plate["distance_mm"] for plate in told["plates"]] == [400, 600, 800]
    assert {"exposure_ms", "i_avg", "p_norm"} == set(told["ring"][0])
    assert told["files"][0] == {"kind": "page", "path": str(page), "replaced": False}
    shown = run(*words).stdout
    assert "system gain K" in shown
    assert f"replaced the page: {page}" in shown


# -- what cannot be -----------------------------------------------------------------------------


def error_of(result):
    assert result.exit_code == 1
    assert result.stdout == ""
    return result.stderr.splitlines()[-1]


def test_an_unknown_plan(run):
    message = error_of(run("simulate", "y"))
    assert (
        "no measuring plan 'y': expected a TOML or YAML file, or one of x-near, x-middle" in message
    )


def test_a_missing_plan_file(run, tmp_path):
    assert "no measuring plan" in error_of(run("simulate", tmp_path / "y.toml"))


def test_a_plan_with_an_unknown_key(run, tmp_path):
    path = tmp_path / "plan.toml"
    path.write_text(PLAN.replace("blind_views", "blind_view"), encoding="utf-8")
    assert "key 'blind_view' is unknown" in error_of(run("simulate", path))


def test_a_plan_that_sees_nothing(run, tmp_path, options):
    path = tmp_path / "plan.toml"
    path.write_text(PLAN.replace("[-40, 40]", "[900]"), encoding="utf-8")
    message = error_of(run("simulate", path, "-o", tmp_path / "c", *options))
    assert "plan 'box': none of its views sees any of spot, aside" in message


def test_rings_of_a_stereo_sensor(run, tmp_path):
    message = error_of(run("simulate", "stereo-x", "--rings-only", "-o", tmp_path))
    assert "it cannot take rings only; take whole frames" in message


def test_the_folder_of_another_plan(simulated, plan, options, run, tmp_path):
    path = tmp_path / "other.toml"
    path.write_text(PLAN.replace("version = 1", "version = 1\nseed = 5"), encoding="utf-8")
    message = error_of(run("simulate", path, "-o", simulated[0], *options))
    assert "another plan, differing in seed" in message


@pytest.mark.parametrize(
    ("name", "message"),
    [("table.xlsx", "ends in .csv or .parquet"), ("none/table.csv", "does not exist; make it")],
)
def test_a_table_that_cannot_be_written_is_told_at_once(name, message, plan, run, tmp_path):
    result = run("simulate", plan, "--observe", "-o", tmp_path / name)
    assert message in error_of(result)
    assert "measuring" not in result.stderr


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        ([], "give a measuring plan: a TOML or YAML file"),
        (["x", "--workers", "0"], "workers"),
        (["x", "--observe", "--no-clouds"], "keeps no clouds"),
        (["x", "--observe", "--raw-frames"], "keeps neither clouds nor frames"),
        (["x", "--check", "--observe"], "--check takes no captures"),
    ],
)
def test_a_wrong_call_ends_with_status_two(arguments, told, run):
    result = run("simulate", *arguments)
    assert result.exit_code == 2
    assert told in result.stderr


@pytest.mark.skipif(sys.platform == "win32", reason="Ctrl-C is another signal there")
@pytest.mark.slow
def test_ctrl_c_before_the_first_capture_is_no_hindrance(simulated, plan, options, tmp_path):
    words = ["simulate", plan, "-o", tmp_path / "box", *options]
    command = [sys.executable, "-m", "exposight", *map(str, words)]
    process = subprocess.Popen(
        command,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        encoding="utf-8",
        env={**os.environ, "PYTHONIOENCODING": "utf-8"},
    )
    try:
        assert process.stderr is not None
        assert process.stderr.readline() == "preparing the cell …\n"
        process.send_signal(signal.SIGINT)
        stdout, stderr = process.communicate(timeout=60)
    finally:
        process.kill()
    assert process.returncode == 130
    assert stdout == ""
    assert stderr.splitlines()[-1].startswith("error: stopped by Ctrl-C")
    assert "Traceback" not in stderr
    subprocess.run(command, capture_output=True, timeout=100, check=True)
    assert CampaignFolder(tmp_path / "box").keys() == CampaignFolder(simulated[0]).keys()


@pytest.mark.skipif(sys.platform == "win32", reason="Ctrl-C is another signal there")
@pytest.mark.parametrize(
    ("observe", "moment"),
    [
        (False, "workers start"),
        (False, "captures are taken"),
        (True, "workers start"),
        (True, "captures are taken"),
    ],
)
@pytest.mark.slow
def test_ctrl_c_says_what_is_kept(observe, moment, scene, tmp_path):
    """As a terminal does it: the signal reaches the workers, too."""
    many = tmp_path / "many.toml"
    exposures = ", ".join(map(str, range(10, 48 if observe else 200)))
    views = ", ".join(map(str, range(-40, 60, 10) if observe else (-40, 40)))
    text = PLAN.replace("50, 150", exposures).replace("-40, 40", views)
    many.write_text(text, encoding="utf-8")
    output = tmp_path / ("o.csv" if observe else "campaign")
    words = ["simulate", many, "-o", output, "--scene", scene, "--rings-only", "--workers", 2]
    process = subprocess.Popen(
        [sys.executable, "-m", "exposight", *map(str, words), *(["--observe"] * observe)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        encoding="utf-8",
        env={**os.environ, "PYTHONIOENCODING": "utf-8"},
        start_new_session=True,
    )
    try:
        assert process.stderr is not None
        assert any(line.startswith("measuring") for line in process.stderr)
        if moment == "workers start":
            time.sleep(0.5)
        else:
            deadline = time.monotonic() + 60
            while not any(tmp_path.glob("o.csv.views/0*" if observe else "campaign/captures/0*")):
                assert time.monotonic() < deadline
                time.sleep(0.01)
        os.killpg(process.pid, signal.SIGINT)
        stdout, stderr = process.communicate(timeout=60)
    finally:
        process.kill()
    assert process.returncode == 130
    assert stdout == ""
    line = stderr.splitlines()[-1]
    assert line.startswith("error: stopped by Ctrl-C")
    kept = Path(f"{output}.views") if observe else output
    assert (f"kept in {kept}, and the same command goes on" in line) == kept.exists()
    assert not observe or not output.exists()
