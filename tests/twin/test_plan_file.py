"""Measuring plans in TOML: short forms, round trips, and files that are no plans."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from exposight.cell import sensor_preset
from exposight.errors import FormatError, MissingFileError, VersionError
from exposight.twin.alignment import AlignmentErrors
from exposight.twin.plan import DepthPlane, MeasuringPlan, RandomPositions
from exposight.twin.plan_file import (
    even_positions,
    logarithmic_exposures,
    plan_from_toml,
    plan_to_toml,
    read_plan,
    write_plan,
)
from exposight.twin.plan_presets import PLANS

TEXT = """
format = "exposight measuring plan"
version = 1
name = "two planes"
sensor = "comet-pro-ae"
features = ["f1", "f2"]
reference = "f1"
seed = 4

[alignment]
kinematic_max_mm = 3

[[planes]]
name = "near"
z_tcp_mm = -165
x_mm = { first = -135, last = 135, count = 4 }
y_mm = [-100, 0.5]
exposures_ms = { first = 5, last = 100, count = 10 }
kinematic_share = 0.25

[[random]]
name = "random"
count = 5
x_mm = [-30, 30]
y_mm = [-20, 20]
z_tcp_mm = [-10, 10]
exposures_ms = [15, 40]
"""


def test_short_forms_are_written_out():
    plan = plan_from_toml(TEXT)
    (plane,) = plan.planes
    assert plane.x_mm == (-135.0, -45.0, 45.0, 135.0)
    assert plane.y_mm == (-100.0, 0.5)
    assert plan.random[0].z_tcp_mm == (-10.0, 10.0)


def test_keys_left_out_take_the_documented_values():
    plan = plan_from_toml(TEXT)
    assert (plan.side, plan.lighting, plan.blind_views) == ("inside", "I", "refuse")
    assert plan.alignment == AlignmentErrors(kinematic_max_mm=3.0)


@pytest.mark.parametrize("plane", PLANS["x"].planes[:2], ids=lambda plane: plane.name)
def test_logarithmic_exposures_are_those_of_table_9(plane):
    sensor = sensor_preset("comet-pro-ae")
    first, last = plane.exposures_ms[0], plane.exposures_ms[-1]
    assert logarithmic_exposures(first, last, 10, sensor) == plane.exposures_ms


def test_even_positions_reach_both_ends():
    assert even_positions(-1, 2, 4) == (-1.0, 0.0, 1.0, 2.0)


@pytest.mark.parametrize("name", PLANS)
def test_every_preset_survives_writing_and_reading(name):
    assert plan_from_toml(plan_to_toml(PLANS[name])) == PLANS[name]


_text = st.text(st.characters(exclude_categories=("C", "Z")), min_size=1, max_size=8)
_number = st.floats(-1e4, 1e4)
_several = st.lists(_number, min_size=1, max_size=4, unique=True)
_times = st.lists(st.floats(1e-3, 1e4), min_size=1, max_size=4, unique=True)
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
        kinematic_share=st.floats(0, 1),
    ),
    box=st.builds(
        RandomPositions,
        name=_text.map("r{}".format),
        count=st.integers(1, 9999),
        x_mm=_range,
        y_mm=_range,
        z_tcp_mm=_range,
        exposures_ms=_times,
    ),
    seed=st.integers(0, 2**62),
)
def test_any_plan_survives_writing_and_reading(name, features, plane, box, seed):
    plan = MeasuringPlan(
        name=name,
        sensor="rc-visard-65",
        features=features,
        reference=features[0],
        side="outside",
        planes=[plane],
        random=[box],
        lighting="III",
        seed=seed,
    )
    assert plan_from_toml(plan_to_toml(plan)) == plan


def test_a_written_file_is_read(tmp_path):
    path = tmp_path / "plan.toml"
    write_plan(path, PLANS["x-out"])
    assert read_plan(path) == PLANS["x-out"]


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(MissingFileError, match=r"plan\.toml: no such measuring plan"):
        read_plan(tmp_path / "plan.toml")


def test_a_file_of_other_bytes_is_refused(tmp_path):
    path = tmp_path / "plan.toml"
    path.write_bytes(np.random.default_rng(0).bytes(64) + b"\xff")
    with pytest.raises(FormatError, match="not UTF-8 text"):
        read_plan(path)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("seed = 4", "seed =", "the measuring plan is not TOML"),
        ("seed = 4", "sead = 4", "key 'sead' is unknown"),
        ("z_tcp_mm = -165", "z_mm = -165", "'planes.0.z_tcp_mm' is missing; .*z_mm' is unknown"),
        ("kinematic_max_mm", "kinematic_mm", r"key 'alignment\.kinematic_mm' is unknown"),
        ("count = 4", "cuont = 4", "x_mm.steps.count' is missing; .*x_mm.steps.cuont' is unknown"),
        ("count = 4", "count = 1", "x_mm.steps.count': .*greater than or equal to 2"),
        ("count = 4", "count = 4.5", "x_mm.steps.count': .*valid integer"),
        ("last = 135", "last = -135", "plane 'near': x_mm holds -135 twice"),
        ("[-100, 0.5]", "[]", "plane 'near': y_mm is empty"),
        ("[-100, 0.5]", "[nan]", "y_mm.list.0': Input should be a finite number"),
        ("[-100, 0.5]", "[true]", "y_mm.list.0': Input should be a valid number"),
        ("[15, 40]", "[]", "random positions 'random': exposures_ms is empty"),
        ("last = 100", "last = 1001", "exposures_ms of 'near': .*from 1 to 1000 ms, got 1001 ms"),
        ("last = 100", "last = 6", "plane 'near': exposures_ms holds 5 twice"),
        ("[-30, 30]", "[30, -30]", "x_mm needs two numbers, the lower one first"),
        ('"comet-pro-ae"', '"webcam"', "no sensor preset is called 'webcam'"),
        ('"two planes"', "2024-01-01", "key 'name': Input should be a valid string"),
        ('"exposight measuring plan"', '"shopping list"', "got 'shopping list'"),
        ("kinematic_share = 0.25", "kinematic_share = 2", "kinematic_share must be from 0 to 1"),
        ("kinematic_max_mm = 3", "kinematic_max_mm = -3", "kinematic_max_mm must be a number from"),
    ],
)
def test_a_wrong_file_says_what_is_wrong(old, new, message):
    assert old in TEXT
    with pytest.raises(FormatError, match=message):
        plan_from_toml(TEXT.replace(old, new))


def test_a_newer_file_asks_for_an_update():
    with pytest.raises(VersionError, match="update exposight"):
        plan_from_toml(TEXT.replace("version = 1", "version = 2"))
