"""Measuring plans: names and order of positions, and what is refused."""

import numpy as np
import pytest

from exposight.cell import sensor_preset
from exposight.errors import FeatureError, InputError
from exposight.geometry import RigidTransform
from exposight.plans import DepthPlane, MeasuringPlan, PoseList, RandomPositions

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
    placements = dict(_plane().placements())
    assert list(placements) == [f"near-x{i}-y{j}" for j in (1, 2, 3) for i in (1, 2)]
    assert placements["near-x2-y3"] == RigidTransform(translation_mm=np.array([10.0, 7.0, -100.0]))


def test_a_grid_combines_every_position_with_every_turn():
    turned = _plane(turns_deg=[[0, 0, 0], [5, -10, 90]])
    assert turned.n_views == 12
    placements = dict(turned.placements())
    assert list(placements)[:3] == ["near-x1-y1-t1", "near-x1-y1-t2", "near-x2-y1-t1"]
    assert placements["near-x2-y3-t1"].rotation.tolist() == np.eye(3).tolist()
    assert placements["near-x2-y3-t2"].to_fanuc_wpr() == pytest.approx((5, -10, 90))
    assert placements["near-x2-y3-t2"].translation_mm.tolist() == [10, 7, -100]


def test_a_single_turn_leaves_the_names_as_they_were():
    assert [name for name, _ in _plane(turns_deg=[[5, 0, 0]]).placements()] == [
        name for name, _ in _plane().placements()
    ]


def test_turns_of_random_positions_leave_the_positions_as_they_were():
    turned = _random(w_deg=(-30, 30), r_deg=(90, 90))
    for name in turned.names():
        plain, pose = next(_random().draws(name, 7)), next(turned.draws(name, 7))
        assert np.array_equal(plain.rotation, np.eye(3))
        assert np.array_equal(plain.translation_mm, pose.translation_mm)
        w, p, r = pose.to_fanuc_wpr()
        assert abs(w) <= 30
        assert (p, r) == pytest.approx((0.0, 90.0))


def test_random_views_are_numbered_with_equal_width():
    assert _random(count=3).names() == ("random-01", "random-02", "random-03")
    assert _random(count=120).names()[0] == "random-001"


def test_groups_are_planes_then_random_positions_then_lists_of_poses():
    poses = PoseList.from_transforms("here", [RigidTransform()], exposures_ms=[5])
    plan = _plan(random=[_random()], poses=[poses])
    groups = [(group.name, group.n_views) for group in plan.groups]
    assert groups == [("near", 6), ("random", 3), ("here", 1)]
    assert plan.n_captures == 6 * 2 + 3 + 1


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
        ({"name": " "}, "need names without blanks"),
        ({"z_tcp_mm": NAN}, "plane 'near': z_tcp_mm must hold finite numbers"),
        ({"x_mm": []}, "plane 'near': x_mm is empty"),
        ({"y_mm": [1, 2, 1]}, "plane 'near': y_mm holds 1 twice"),
        ({"y_mm": [0, 0]}, "plane 'near': y_mm holds 0 twice"),
        ({"exposures_ms": []}, "plane 'near': exposures_ms is empty"),
        ({"exposures_ms": [5, 5.0]}, "exposures_ms holds 5 twice"),
        ({"exposures_ms": [5, -1]}, "must all be above 0 ms, got -1"),
        (
            {"turns_deg": [[1, 2]]},
            r"plane 'near': a turn needs w, p and r in degrees, got \[1, 2\]",
        ),
        ({"turns_deg": [[1, 2, NAN]]}, "plane 'near': a turn needs w, p and r"),
        ({"turns_deg": [[1, 2, 3], [1, 2, 3.0]]}, r"turns_deg holds \[1, 2, 3\] twice"),
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
        ({"x_mm": (5, 5)}, "x_mm holds 5 twice"),
        ({"p_deg": (5, -5)}, r"p_deg needs two numbers, the lower one first, got \[5, -5\]"),
        ({"r_deg": (0, NAN)}, "r_deg must hold finite numbers"),
        ({"w_deg": (5,)}, "w_deg needs two numbers"),
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
