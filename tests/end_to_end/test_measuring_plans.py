"""Measuring plans on the command line: what info tells of them."""

import pytest

from exposight.plans import PLANS, write_plan

YAML = """
format: exposight measuring plan
version: 1
name: two groups
sensor: comet-pro-ae
features: [f1, f2]
reference: f1
planes:
  - name: near
    z_tcp_mm: -165
    x_mm: { first: -135, last: 135, count: 4 }
    y_mm: [-100, 0, 100]
    exposures_ms: [5, 20.5, 80]
random:
  - { name: anywhere, count: 5, x_mm: [-9, 9], y_mm: [-9, 9], z_tcp_mm: [-9, 9], exposures_ms: [7] }
"""


@pytest.fixture
def yaml_plan(tmp_path):
    path = tmp_path / "plan.yaml"
    path.write_text(YAML, encoding="utf-8")
    return path


def test_a_plan_in_yaml_is_recognised(yaml_plan, run_json):
    told = run_json("info", yaml_plan)
    assert told["kind"] == "measuring plan"
    assert told["sensor"] == "comet-pro-ae"
    assert told["features"] == ["f1", "f2"]
    assert told["views"] == {"near": 12, "anywhere": 5}
    assert told["exposures_ms"] == {"near": [5.0, 20.5, 80.0], "anywhere": [7.0]}
    assert told["captures"] == 12 * 3 + 5


def test_a_plan_is_the_same_by_name_and_as_toml(tmp_path, run_json):
    path = tmp_path / "copy.toml"
    write_plan(path, PLANS["small"])
    by_name, by_file = run_json("info", "small"), run_json("info", path)
    assert by_name["kind"] == "measuring plan"
    assert {**by_name, "path": ""} == {**by_file, "path": ""}


def test_turns_are_told_with_their_unit(yaml_plan, run, run_json):
    turned = YAML.replace("version: 1", "version: 3").replace(
        "    y_mm: [-100, 0, 100]",
        "    y_mm: [0]\n    turns_deg: { w_deg: [-10, 10], r_deg: [0, 45, 90] }",
    )
    yaml_plan.write_text(turned, "utf-8")
    assert run_json("info", yaml_plan)["views"]["near"] == 4 * 2 * 3
    assert "near w −10 to 10°, p 0°, r 0 to 90°" in run("info", yaml_plan).stdout


def test_lists_of_poses_are_told_and_radians_suspected(yaml_plan, run, run_json):
    poses = """poses:
  - name: robot
    notation: kuka
    frame: part_from_tcp
    rows: [[0, 0, -600, 0, 0, 0], [20, 15, -640, 1.5708, 0, 0]]
    exposures_ms: [5, 20]
"""
    yaml_plan.write_text(YAML + poses, "utf-8")
    facts = run_json("info", yaml_plan)
    assert facts["views"]["robot"] == 2
    assert facts["poses"] == {"robot": {"notation": "kuka", "frame": "part_from_tcp"}}
    shown = run("info", yaml_plan)
    assert "robot kuka, part_from_tcp" in shown.stdout


def test_views_that_may_be_left_out_are_told(run):
    shown = run("info", "x-test").stdout
    assert "at most 48: near 16, middle 16, far 16" in shown
    assert "at most 480" in shown


def test_what_is_there_goes_before_a_plan_of_the_same_name(tmp_path, monkeypatch, run):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "small").mkdir()
    assert "small: not something that exposight knows" in run("info", "small").stderr


def test_a_plan_that_is_wrong_is_told_as_one(yaml_plan, run):
    yaml_plan.write_text(YAML.replace("reference", "refrence"), "utf-8")
    result = run("info", yaml_plan)
    assert result.exit_code == 1
    assert f"{yaml_plan}: key 'refrence' is unknown" in result.stderr


def test_a_yaml_file_of_something_else_is_no_plan(tmp_path, run):
    path = tmp_path / "other.yaml"
    path.write_text("gain: 3\n", encoding="utf-8")
    assert run("info", path).exit_code == 1


def test_a_plan_without_its_first_line_is_told_so(yaml_plan, run):
    yaml_plan.write_text(YAML.replace("format: exposight measuring plan\n", ""), "utf-8")
    told = run("info", yaml_plan).stderr
    assert "exposight measuring plan" in told
    assert "OpenCV" not in told


def test_a_broken_plan_without_its_first_line_is_told_where(yaml_plan, run):
    broken = YAML.replace("format: exposight measuring plan\n", "").replace("[f1, f2]", "[f1, f2")
    yaml_plan.write_text(broken, "utf-8")
    told = run("info", yaml_plan).stderr
    assert "line 6" in told
    assert "OpenCV" not in told
