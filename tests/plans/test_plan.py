"""Measuring plans: names and order of positions, and what is refused."""

import pytest

from exposight.cell import sensor_preset
from exposight.errors import FeatureError, InputError
from exposight.geometry import RigidTransform
from exposight.plans import DepthPlane, FixedView, MeasuringPlan, RandomPositions

NAN = float("nan")


def _plane(**changes) -> DepthPlane:
    settings = {
        "name": "near",
        "z_tcp_mm": -100,
        "x_mm": [-10, 10],
        "y_mm": [0, 5, 7],
        "exposures_ms": [5, 20],
    }
    return DepthPlane(**{**settings, **changes})


def _random(**changes) -> RandomPositions:
    settings = {
        "name": "random",
        "count": 3,
        "x_mm": (-10, 10),
        "y_mm": (-5, 5),
        "z_tcp_mm": (0, 1),
        "exposures_ms": [5],
    }
    return RandomPositions(**{**settings, **changes})


def _plan(**changes) -> MeasuringPlan:
    settings = {
        "name": "p",
        "sensor": sensor_preset("comet-pro-ae"),
        "features": ["h0"],
        "reference": "h0",
        "planes": [_plane()],
    }
    return MeasuringPlan(**{**settings, **changes})


def test_a_grid_combines_every_x_with_every_y():
    positions = dict(_plane().positions())
    assert list(positions) == [f"near-x{i}-y{j}" for j in (1, 2, 3) for i in (1, 2)]
    assert positions["near-x2-y3"] == (10.0, 7.0, -100.0)


def test_random_views_are_numbered_with_equal_width():
    assert _random(count=3).names() == ("random-01", "random-02", "random-03")
    assert _random(count=120).names()[0] == "random-001"


def test_groups_are_planes_then_random_positions_then_fixed_views():
    fixed = FixedView(name="here", camera_from_part=RigidTransform(), exposures_ms=[5])
    plan = _plan(random=[_random()], fixed=[fixed])
    groups = [(group.name, group.n_views) for group in plan.groups]
    assert groups == [("near", 6), ("random", 3), ("here", 1)]


def test_the_observed_part_has_the_plans_features_alone(hole_part):
    part = hole_part(((0, 0, 5), (20, 0, 4)))
    observed = _plan(features=["h1"]).observed_part(part)
    assert [feature.name for feature in observed.features] == ["h1"]


def test_an_observed_feature_the_part_lacks_is_named(hole_part):
    plan = _plan(features=["h9"])
    with pytest.raises(FeatureError, match="plan 'p': part 'sheet' has no feature 'h9'"):
        plan.observed_part(hole_part(((0, 0, 5),)))


def test_a_reference_feature_the_part_lacks_is_named(hole_part):
    plan = _plan(reference="h9")
    with pytest.raises(FeatureError, match="plan 'p': part 'sheet' has no feature 'h9'"):
        plan.views(hole_part(((0, 0, 5),)))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"name": " "}, "need printable names"),
        ({"z_tcp_mm": NAN}, "plane 'near': z_tcp_mm must hold finite numbers"),
        ({"x_mm": []}, "plane 'near': x_mm is empty"),
        ({"y_mm": [1, 2, 1]}, "plane 'near': y_mm holds 1 twice"),
        ({"y_mm": [0, 0]}, "plane 'near': y_mm holds 0 twice"),
        ({"exposures_ms": []}, "plane 'near': exposures_ms is empty"),
        ({"exposures_ms": [5, 5.0]}, "exposures_ms holds 5 twice"),
        ({"exposures_ms": [5, -1]}, "must all be above 0 ms, got -1"),
    ],
)
def test_an_impossible_plane_is_refused(changes, message):
    with pytest.raises(InputError, match=message):
        _plane(**changes)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"count": 0}, "random positions 'random': count must be from 1 to 9999, got 0"),
        ({"x_mm": (5, -5)}, r"x_mm needs two numbers, the lower one first, got \[5, -5\]"),
        ({"z_tcp_mm": (1,)}, "z_tcp_mm needs two numbers"),
        ({"exposures_ms": [0]}, "must all be above 0 ms, got 0"),
    ],
)
def test_impossible_random_positions_are_refused(changes, message):
    with pytest.raises(InputError, match=message):
        _random(**changes)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"side": "top"}, "plan 'p': side must be one of inside, outside, got 'top'"),
        ({"blind_views": "hide"}, "blind_views must be one of refuse, skip"),
        ({"features": []}, "features is empty"),
        ({"features": ["a", "a"]}, "feature 'a' is there twice"),
        ({"reference": ""}, "reference is empty"),
        ({"planes": []}, "neither planes nor random positions"),
        ({"planes": [_plane(), _plane()]}, "two planes are called 'near'"),
        ({"seed": -1}, "seed must be a whole number from 0 up, got -1"),
    ],
)
def test_an_impossible_plan_is_refused(changes, message):
    with pytest.raises(InputError, match=message):
        _plan(**changes)
