"""Measuring plans in TOML and YAML: short forms, round trips, and files that are no plans."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from exposight.cell import sensor_preset
from exposight.errors import FormatError, MissingFileError, SensorError, VersionError
from exposight.geometry import RigidTransform
from exposight.plans import (
    PLANS,
    DepthPlane,
    MeasuringPlan,
    PoseList,
    RandomPositions,
    even_positions,
    logarithmic_exposures,
    plan_from_text,
    plan_to_toml,
    read_plan,
    write_plan,
)

TEXT = """
format = "exposight measuring plan"
version = 2
name = "two planes"
sensor = "comet-pro-ae"
features = ["f1", "f2"]
reference = "f1"
seed = 4

[[planes]]
name = "near"
z_tcp_mm = -165
x_mm = { first = -135, last = 135, count = 4 }
y_mm = [-100, 0.5]
exposures_ms = { first = 5, last = 100, count = 10 }

[[random]]
name = "random"
count = 5
x_mm = [-30, 30]
y_mm = [-20, 20]
z_tcp_mm = [-10, 10]
exposures_ms = [15, 40]

[simulated]
lighting = "II"
alignment = { kinematic_max_mm = 3 }
"""


def test_short_forms_are_written_out():
    plan = plan_from_text(TEXT)
    (plane,) = plan.planes
    assert plane.x_mm == (-135.0, -45.0, 45.0, 135.0)
    assert plane.y_mm == (-100.0, 0.5)
    assert plan.random[0].z_tcp_mm == (-10.0, 10.0)


def test_turns_are_every_combination_of_their_angles():
    angles = "{ w_deg = [-5, 10], r_deg = { first = 0, last = 90, count = 3 } }"
    plan = plan_from_text(TEXT.replace("[-100, 0.5]", f"[0]\nturns_deg = {angles}"))
    assert plan.planes[0].turns_deg == tuple((w, 0, r) for w in (-5, 10) for r in (0, 45, 90))
    listed = TEXT.replace("[-100, 0.5]", "[0]\nturns_deg = [[0, 0, 0], [5, -10.5, 90]]")
    assert plan_from_text(listed).planes[0].turns_deg == ((0, 0, 0), (5, -10.5, 90))


def test_the_documented_plan_opens():
    page = (Path(__file__).parents[2] / "docs" / "formats.md").read_text("utf-8")
    text = page.split("## Measuring plan")[1].split("```toml")[1].split("```")[0]
    plan = plan_from_text(text.replace("my-scanner.json", "comet-pro-ae"))
    assert [group.name for group in plan.groups] == ["near", "random", "robot"]


def test_what_older_versions_hold_is_written_for_them():
    plan = plan_from_text(TEXT)
    assert "version = 2\n" in plan_to_toml(plan)
    assert "_deg" not in plan_to_toml(plan)
    turned = replace(plan, random=[replace(plan.random[0], p_deg=(-5, 5))])
    assert "version = 3\n" in plan_to_toml(turned)


def test_keys_left_out_take_the_documented_values():
    plan = plan_from_text(TEXT)
    assert (plan.side, plan.blind_views, plan.poses) == ("inside", "refuse", ())


def test_the_simulated_cells_table_is_kept_unread():
    settings = {"lighting": "II", "alignment": {"kinematic_max_mm": 3}}
    assert plan_from_text(TEXT).simulated == settings
    assert plan_from_text(TEXT.replace("lighting", "weather")).simulated["weather"] == "II"


VERSION_1 = """
format = "exposight measuring plan"
version = 1
name = "of version 1"
sensor = "comet-pro-ae"
features = ["f1"]
reference = "f1"
lighting = "III"

[alignment]
kinematic_max_mm = 3

[[planes]]
name = "near"
z_tcp_mm = -165
x_mm = [0]
y_mm = [0]
exposures_ms = [5]
kinematic_share = 0.25
"""


def test_a_plan_of_version_1_has_the_same_meaning():
    plan = plan_from_text(VERSION_1)
    assert plan.planes == (
        DepthPlane(name="near", z_tcp_mm=-165, x_mm=(0,), y_mm=(0,), exposures_ms=(5,)),
    )
    assert plan.simulated == {
        "lighting": "III",
        "alignment": {"kinematic_max_mm": 3},
        "kinematic_share": {"near": 0.25},
    }


def test_version_2_has_those_keys_in_its_table_alone():
    with pytest.raises(FormatError, match=r"'planes\[0\]\.kinematic_share' is unknown.*'lighting'"):
        plan_from_text(VERSION_1.replace("version = 1", "version = 2"))


def test_a_sensor_of_ones_own_lies_beside_the_plan(tmp_path, small_sensor):
    pose = RigidTransform.from_fanuc_wpr((1.0, 2.0, 600.0), 3.0, 4.0, 5.0)
    poses = PoseList.from_transforms("here", [pose], exposures_ms=[5])
    plan = MeasuringPlan(name="own", sensor=small_sensor, features=["f1"], poses=[poses])
    write_plan(tmp_path / "own.toml", plan)
    assert (tmp_path / "own-sensor.json").is_file()
    assert read_plan(tmp_path / "own.toml") == plan


def test_a_sensor_that_is_not_there_is_named(tmp_path):
    with pytest.raises(MissingFileError, match=r"nowhere/my\.json"):
        plan_from_text(TEXT.replace("comet-pro-ae", "my.json"), folder=tmp_path / "nowhere")


@pytest.mark.parametrize("plane", PLANS["x"].planes[:2], ids=lambda plane: plane.name)
def test_logarithmic_exposures_are_those_of_table_9(plane):
    sensor = sensor_preset("comet-pro-ae")
    first, last = plane.exposures_ms[0], plane.exposures_ms[-1]
    assert logarithmic_exposures(first, last, 10, sensor) == plane.exposures_ms


def test_even_positions_reach_both_ends():
    assert even_positions(-1, 2, 4) == (-1.0, 0.0, 1.0, 2.0)


@pytest.mark.parametrize("name", PLANS)
def test_every_preset_survives_writing_and_reading(name):
    assert plan_from_text(plan_to_toml(PLANS[name])) == PLANS[name]


_text = st.text(st.characters(exclude_categories=("C", "Z")), min_size=1, max_size=8)
_number = st.floats(-1e4, 1e4)
_several = st.lists(_number, min_size=1, max_size=4, unique=True)
_times = st.lists(st.floats(0.07, 18), min_size=1, max_size=4, unique=True)
_range = st.tuples(_number, _number).filter(lambda pair: pair[0] < pair[1])


@settings(max_examples=50, deadline=None)
@given(
    name=_text,
    features=st.lists(_text, min_size=1, max_size=3, unique=True),
    plane=st.builds(
        DepthPlane,
        name=_text.map("p{}".format),
        z_tcp_mm=_number,
        x_mm=_several,
        y_mm=_several,
        exposures_ms=_times,
        turns_deg=st.lists(st.tuples(_number, _number, _number), max_size=3, unique=True),
    ),
    box=st.builds(
        RandomPositions,
        name=_text.map("r{}".format),
        count=st.integers(1, 9999),
        x_mm=_range,
        y_mm=_range,
        z_tcp_mm=_range,
        exposures_ms=_times,
        w_deg=_range,
        r_deg=_number.map(lambda angle: (angle, angle)),
    ),
    seed=st.integers(0, 2**62),
)
def test_any_plan_survives_writing_and_reading(name, features, plane, box, seed):
    plan = MeasuringPlan(
        name=name,
        sensor=sensor_preset("rc-visard-65"),
        features=features,
        reference=features[0],
        side="outside",
        planes=[plane],
        random=[box],
        seed=seed,
        simulated={"lighting": "III", "kinematic_share": {"a b": 0.5}},
    )
    assert plan_from_text(plan_to_toml(plan)) == plan


def test_what_no_reader_takes_is_not_written(tmp_path):
    box = replace(PLANS["x-out"].random[0], exposures_ms=(5e5,))
    with pytest.raises(SensorError, match="takes exposure times from"):
        write_plan(tmp_path / "plan.toml", replace(PLANS["x-out"], random=[box]))
    assert not list(tmp_path.iterdir())


def test_a_written_file_is_read(tmp_path):
    path = tmp_path / "plan.toml"
    write_plan(path, PLANS["x-out"])
    assert read_plan(path) == PLANS["x-out"]


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(MissingFileError, match=r"no measuring plan .*plan\.toml"):
        read_plan(tmp_path / "plan.toml")


def test_a_file_of_other_bytes_is_refused(tmp_path):
    path = tmp_path / "plan.toml"
    path.write_bytes(np.random.default_rng(0).bytes(64) + b"\xff")
    with pytest.raises(FormatError, match="not UTF-8 text"):
        read_plan(path)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("seed = 4", "seed =", "the measuring plan is not a readable measuring plan in TOML"),
        ("seed = 4", "sead = 4", "key 'sead' is unknown"),
        (
            "z_tcp_mm = -165",
            "z_mm = -165",
            r"'planes\[0\]\.z_tcp_mm' is missing; .*z_mm' is unknown",
        ),
        ("count = 4", "cuont = 4", r"\[0\]\.x_mm: key 'count' is missing; key 'cuont' is unknown"),
        (
            "count = 4",
            "count = 1",
            r"planes\[0\]\.x_mm: key 'count': expected a number from 2 up, got 1",
        ),
        ("count = 4", "count = 4.5", r"x_mm: key 'count': expected a whole number, got 4\.5"),
        ("last = 135", "last = -135", "plane 'near': x_mm holds -135 twice"),
        ("[-100, 0.5]", "[]", "plane 'near': y_mm is empty"),
        ("[-100, 0.5]", "[nan]", r"y_mm\[0\]': expected a finite number, got NaN"),
        ("[-100, 0.5]", "[true]", r"y_mm\[0\]': expected a number, got true"),
        ("seed = 4", "seed = 4\nturns_deg = []", "key 'turns_deg' is unknown"),
        (
            "[-100, 0.5]",
            "[0]\nturns_deg = { w_deg = [] }",
            r"turns_deg: .*1 or more entries, got 0",
        ),
        (
            "[-100, 0.5]",
            "[0]\nturns_deg = { w = [1] }",
            r"planes\[0\]\.turns_deg: key 'w' is unknown",
        ),
        ("[-100, 0.5]", "[0]\nturns_deg = [[1, 2]]", r"turns_deg\[0\]\[2\]' is missing"),
        ("[15, 40]", "[]", "random positions 'random': exposures_ms is empty"),
        ("last = 100", "last = 1001", "exposures_ms of 'near': .*from 1 to 1000 ms, got 1001 ms"),
        ("last = 100", "last = 6", "plane 'near': exposures_ms holds 5 twice"),
        ("[-30, 30]", "[30, -30]", "x_mm needs two numbers, the lower one first"),
        ('"comet-pro-ae"', '"webcam"', "no sensor .*webcam"),
        ('"two planes"', "2024-01-01", "key 'name': expected a text, got .*2024-01-01"),
        ('"exposight measuring plan"', '"shopping list"', 'got "shopping list"'),
    ],
)
def test_a_wrong_file_says_what_is_wrong(old, new, message):
    assert old in TEXT
    with pytest.raises(FormatError, match=message):
        plan_from_text(TEXT.replace(old, new))


def test_a_newer_file_asks_for_an_update():
    with pytest.raises(VersionError, match="update exposight"):
        plan_from_text(TEXT.replace("version = 2", "version = 4"))


YAML = """
# the same plan
format: exposight measuring plan
version: 2
name: two planes
sensor: comet-pro-ae
features: [f1, f2]
reference: f1
seed: 4
simulated:
  lighting: II
  alignment: { kinematic_max_mm: 3 }
planes:
  - name: near
    z_tcp_mm: -165
    x_mm: { first: -135, last: 135, count: 4 }
    y_mm:
      - -100
      - 0.5
    exposures_ms: { first: 5, last: 1e2, count: 10 }
random:
  - name: random
    count: 5
    x_mm: [-30, 30]
    y_mm: [-20, 20]
    z_tcp_mm: [-10, 10]
    exposures_ms: [15, 40]
"""


def test_yaml_and_toml_give_the_same_plan():
    assert plan_from_text(YAML, "yaml") == plan_from_text(TEXT)


@pytest.mark.parametrize("suffix", [".yaml", ".yml", ".YAML"])
def test_the_suffix_says_that_a_file_is_yaml(suffix, tmp_path):
    path = tmp_path / f"plan{suffix}"
    path.write_text(YAML, encoding="utf-8")
    assert read_plan(path) == plan_from_text(YAML, "yaml")


def test_another_suffix_is_refused(tmp_path):
    path = tmp_path / "plan.txt"
    path.write_text(YAML, encoding="utf-8")
    with pytest.raises(FormatError, match=r"ends in \.toml, \.yaml, \.yml, got '\.txt'"):
        read_plan(path)


def test_plans_are_not_written_as_yaml(tmp_path):
    with pytest.raises(FormatError, match="plans are written in TOML"):
        write_plan(tmp_path / "plan.yaml", PLANS["x"])


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("seed: 4", "sead: 4", "the measuring plan: key 'sead' is unknown"),
        ("seed: 4", "seed: 4\nseed: 5", r"key 'seed' is there twice \(at line 10, column 1\)"),
        ("[f1, f2]", "[f1, f2", r"plan in plain YAML.*expected ',' or ']'.*line 8"),
        ("seed: 4", "seed: 'four'", "key 'seed': expected a whole number, got \"four\""),
        ("seed: 4", "seed: 4: 5", "mapping values are not allowed here"),
        ("seed: 4", "seed:", "key 'seed': expected a whole number, got null"),
        ("z_tcp_mm: -165", "z_tcp_mm: .nan", "z_tcp_mm': expected a finite number, got NaN"),
        ("z_tcp_mm: -165", "z_tcp_mm: 1:30", 'z_tcp_mm\': expected a number, got "1:30"'),
        ("z_tcp_mm: -165", "z_tcp_mm: 2024-01-01", "z_tcp_mm': expected a number"),
        ("[15, 40]", "[yes]", r"exposures_ms\[0\]': expected a number, got \"yes\""),
        ("f1, f2", "f1, !!python/name:os.system x", "tag .*os.system is not allowed"),
        ("[f1, f2]", "&all [f1, f2]\nside: *all", r"alias \*all is not allowed"),
        ("features: [f1, f2]", "? [f1, f2]\n: 1", "a key must be a plain name"),
        ("# the same plan", "a: 1\n---", "expected a single document"),
        ("# the same plan", "%YAML:1.0\n---", "not a readable measuring plan in plain YAML"),
        ("# the same plan", "\0", "unacceptable character"),
    ],
)
def test_a_wrong_yaml_file_says_what_is_wrong(old, new, message):
    assert old in YAML
    with pytest.raises(FormatError, match=message):
        plan_from_text(YAML.replace(old, new), "yaml")


@pytest.mark.parametrize(
    ("text", "message"),
    [("", "must hold keys and values, got NoneType"), ("- f1\n- f2\n", "got list")],
)
def test_yaml_without_keys_is_no_plan(text, message):
    with pytest.raises(FormatError, match=message):
        plan_from_text(text, "yaml")


def test_leading_zeros_do_not_make_a_number_octal():
    assert plan_from_text(YAML.replace("seed: 4", "seed: 010"), "yaml").seed == 10


def test_a_file_that_would_unfold_to_billions_of_values_is_refused():
    levels = [f"a{n}: &a{n} [{', '.join([f'*a{n - 1}'] * 9)}]" for n in range(1, 12)]
    bomb = "\n".join(["a0: &a0 [1, 2, 3]", *levels])
    with pytest.raises(FormatError, match=r"alias \*a0 is not allowed"):
        plan_from_text(YAML + bomb, "yaml")


@pytest.mark.parametrize("language", ["toml", "yaml"])
@pytest.mark.parametrize(
    "nested", ["[" * 9000, "9" * 9000], ids=["nested a thousandfold", "of thousands of digits"]
)
def test_a_value_beyond_all_measure_is_refused(language, nested):
    key = "features = " if language == "toml" else "features: "
    with pytest.raises(FormatError, match=r"nested too deeply|digits"):
        plan_from_text(key + nested, language)


_PLANE = """
[[planes]]
name = "a"
z_tcp_mm = 0
x_mm = {x_mm}
y_mm = [0]
exposures_ms = {exposures_ms}
turns_deg = {turns_deg}
"""


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"exposures_ms": "[1e5]"}, "takes exposure times from"),
        ({"exposures_ms": "[1e9]"}, "up to an hour"),
        ({"turns_deg": "{ " + ", ".join(
            f"{axis} = {{ first = 0, last = 9, count = 1000 }}" for axis in ("w_deg", "p_deg")
        ) + " }"}, "1000000 turns at each position"),
        (
            {
                "x_mm": "{ first = 0, last = 99, count = 1000 }",
                "turns_deg": "{ w_deg = { first = 0, last = 9, count = 1000 }, p_deg = [0, 1] }",
            },
            "2000000 captures",
        ),
    ],
)  # fmt: skip
def test_a_plan_is_read_only_where_it_can_be_measured(change, message):
    values = {"x_mm": "[0]", "exposures_ms": "[10]", "turns_deg": "[[0, 0, 0]]", **change}
    head = 'format = "exposight measuring plan"\nversion = 3\nname = "p"\nreference = "f1"\n'
    head += 'sensor = "comet-pro-ae"\nfeatures = ["f1"]\n'
    with pytest.raises(FormatError, match=message):
        plan_from_text(head + _PLANE.format(**values))
