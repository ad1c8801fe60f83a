"""Planned views: where the sensor is sent, and views that cannot be taken."""

from dataclasses import replace

import numba
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from exposight.cell import Part, sensor_preset
from exposight.errors import FeatureError, InputError, SensorError
from exposight.geometry import RigidTransform
from exposight.observing import Visibility, view_features
from exposight.plans import DepthPlane, MeasuringPlan, PoseList, RandomPositions

SENSOR = sensor_preset("comet-pro-ae")
ROUNDING_MM = 1e-9
"""A few additions of numbers below 1000 mm."""

PLANE = DepthPlane(name="near", z_tcp_mm=-150, x_mm=[-60, 60], y_mm=[-40, 40], exposures_ms=[5, 20])
PLAN = MeasuringPlan(
    name="p", sensor=SENSOR, features=["h0", "h1"], reference="h1", planes=[PLANE], seed=2
)


@pytest.fixture(scope="module", autouse=True)
def _one_thread():
    """Search masks on one thread: many small searches lose more by waiting for busy cores."""
    threads = numba.get_num_threads()
    numba.set_num_threads(1)
    yield
    numba.set_num_threads(threads)


@pytest.fixture
def part(hole_part) -> Part:
    return hole_part(((0, 0, 5), (20, 10, 4)))


def _turned(part: Part) -> Part:
    """Return the same holes seen from behind."""
    behind = RigidTransform(rotation=np.diag([-1.0, 1.0, -1.0]))
    features = tuple(
        replace(each, part_from_feature=each.part_from_feature @ behind) for each in part.features
    )
    return replace(part, features=features)


def _tcp_from_reference(view, part: Part):
    feature = part.feature("h1")
    return SENSOR.camera_from_tcp.inverse() @ view.camera_from_part @ feature.part_from_feature


def test_the_reference_feature_truly_lies_on_the_grid(part):
    planned = {view.name: view for view in PLAN.views(part)}
    for name, placement in PLANE.placements():
        at = _tcp_from_reference(planned[name], part).translation_mm
        assert at == pytest.approx(placement.translation_mm, abs=ROUNDING_MM)


def test_before_the_inside_the_sensors_axes_are_the_parts(part):
    for view in PLAN.views(part):
        assert np.array_equal(view.camera_from_part.rotation, np.eye(3))


def test_before_the_outside_the_sensor_is_turned_about_y(part):
    outside = replace(PLAN, side="outside").views(_turned(part))
    for view in outside:
        assert np.array_equal(view.camera_from_part.rotation, np.diag([-1.0, 1.0, -1.0]))
        assert view.visible == ("h0", "h1")


@pytest.mark.parametrize("side", ["inside", "outside"])
def test_a_turn_leaves_the_reference_feature_where_it_is(part, side):
    plane = replace(PLANE, turns_deg=[[0, 0, 0], [10, -15, 120]])
    plan = replace(PLAN, side=side, planes=[plane])
    before = part if side == "inside" else _turned(part)
    views = {view.name: view for view in plan.views(before)}
    for name, still in views.items():
        if name.endswith("-t2"):
            continue
        turned = views[name.removesuffix("1") + "2"]
        # Independently of our own angles: the part turns about the TCP's fixed x, then y, then z.
        turn = Rotation.from_rotvec([0, 0, np.radians(120)])
        turn *= Rotation.from_rotvec([0, np.radians(-15), 0])
        turn *= Rotation.from_rotvec([np.radians(10), 0, 0])
        expected = turn.as_matrix() @ still.tcp_from_part.rotation
        assert turned.tcp_from_part.rotation == pytest.approx(expected, abs=1e-12)
        places = [_tcp_from_reference(each, before).translation_mm for each in (still, turned)]
        assert places[1] == pytest.approx(places[0], abs=ROUNDING_MM)
        assert turned.group == still.group == "near"


@pytest.mark.parametrize("kind", ["hole", "slot"])
@pytest.mark.parametrize("turn", [(10.0, -15.0, 120.0), (-25.0, 8.0, -60.0)])
def test_the_observed_orientation_is_that_of_the_turned_feature(hole_part, kind, turn):
    """Of a hole the spin about its own normal is taken out, of a slot it is kept."""
    holes = hole_part(((0, 0, 5), (20, 10, 4)))
    size = {"length_mm": 12.0, "width_mm": 8.0, "radius_mm": 4.0} if kind == "slot" else {}
    part = replace(holes, features=tuple(replace(h, kind=kind, **size) for h in holes.features))
    (view,) = replace(PLAN, planes=[replace(PLANE, x_mm=[0], y_mm=[0], turns_deg=[turn])]).views(
        part
    )
    observed = view_features(part, SENSOR, view.camera_from_part)[1].pose
    at = [observed[axis] for axis in ("x_mm", "y_mm", "z_mm")]
    assert at == pytest.approx((0, 0, -150), abs=ROUNDING_MM)
    angles = np.array([observed[axis] for axis in ("w_deg", "p_deg", "r_deg")])
    turned = Rotation.from_euler("xyz", turn, degrees=True)
    if kind == "slot":
        assert angles == pytest.approx(turn, abs=1e-9)
    else:
        x, y, z = turned.apply([0.0, 0.0, 1.0])
        assert angles == pytest.approx(
            [np.degrees(np.arctan2(-y, np.hypot(x, z))), np.degrees(np.arctan2(x, z)), 0.0],
            abs=1e-9,
        )
        again = Rotation.from_euler("xyz", angles, degrees=True).apply([0.0, 0.0, 1.0])
        assert again == pytest.approx([x, y, z], abs=1e-12)


def test_a_turn_that_shows_the_back_of_every_feature_is_blind(part):
    plane = replace(PLANE, turns_deg=[[0, 0, 0], [0, 180, 0]])
    with pytest.raises(InputError, match=r"'near-x1-y1-t2' sees none .*h0 facing away"):
        replace(PLAN, planes=[plane]).views(part)
    kept = replace(PLAN, planes=[plane], blind_views="skip").views(part)
    assert [view.name for view in kept] == [f"near-x{i}-y{j}-t1" for j in (1, 2) for i in (1, 2)]


def test_a_pose_is_taken_as_it_is_written(part):
    pose = RigidTransform.from_fanuc_wpr((5.0, -3.0, 520.0), 6.0, -2.0, 40.0)
    poses = PoseList.from_transforms("here", [pose], exposures_ms=[7])
    (view,) = MeasuringPlan(name="p", sensor=SENSOR, features=["h0"], poses=[poses]).views(part)
    assert (view.name, view.camera_from_part, view.exposures_ms) == ("here", pose, (7.0,))
    back = SENSOR.camera_from_tcp @ view.tcp_from_part
    assert back.to_matrix() == pytest.approx(pose.to_matrix(), abs=ROUNDING_MM)


def test_two_views_of_one_name_are_refused(part):
    pose = next(view.camera_from_part for view in PLAN.views(part))
    poses = PoseList.from_transforms("near-x1-y1", [pose], exposures_ms=[5])
    with pytest.raises(InputError, match="two views are called 'near-x1-y1'"):
        replace(PLAN, poses=[poses]).views(part)


def test_visible_features_are_those_that_will_be_observed(part):
    far_apart = replace(
        part,
        features=(
            part.features[0],
            replace(
                part.features[1],
                part_from_feature=RigidTransform(translation_mm=np.array([280.0, 0.0, 0.0])),
            ),
        ),
    )
    plan = replace(PLAN, planes=[replace(PLANE, x_mm=[0, 180])])
    for view in plan.views(far_apart):
        seen = view_features(far_apart, SENSOR, view.camera_from_part)
        names = [each.feature.name for each in seen if each.visibility is Visibility.VISIBLE]
        assert list(view.visible) == names
    assert {view.visible for view in plan.views(far_apart)} == {("h1",), ("h0", "h1")}


def test_the_same_plan_gives_the_same_views(part):
    assert PLAN.views(part) == PLAN.views(part)


def test_a_view_does_not_depend_on_the_others(part):
    one = replace(PLAN, planes=[replace(PLANE, y_mm=PLANE.y_mm[:1], x_mm=PLANE.x_mm[:1])])
    assert one.views(part)[0] == PLAN.views(part)[0]


RANDOM = RandomPositions(
    name="random",
    count=12,
    x_mm=(-300, 300),
    y_mm=(-200, 200),
    z_tcp_mm=(-100, 100),
    exposures_ms=[15],
)


def test_random_positions_stay_in_their_box_and_see_something(part):
    planned = replace(PLAN, planes=(), random=[RANDOM]).views(part)
    at = np.array([_tcp_from_reference(view, part).translation_mm for view in planned])
    assert len(planned) == 12
    assert (np.abs(at) <= [300, 200, 100]).all()
    assert all(view.visible for view in planned)
    assert np.ptp(at, axis=0) == pytest.approx([600, 400, 200], rel=0.6)  # spread, not one spot


def test_random_turns_fill_their_ranges_and_blind_ones_are_drawn_again(part):
    box = replace(RANDOM, x_mm=(-60, 60), y_mm=(-40, 40), w_deg=(-120, 120), r_deg=(-180, 180))
    planned = replace(PLAN, planes=(), random=[box]).views(part)
    turns = np.array([_tcp_from_reference(view, part).to_fanuc_wpr() for view in planned])
    assert all(view.visible for view in planned)
    assert (np.abs(turns[:, 0]) < 90).all()  # beyond that the part shows its back
    assert np.ptp(turns[:, 0]) > 60
    assert np.abs(turns[:, 1]) == pytest.approx(0, abs=1e-9)
    assert np.ptp(turns[:, 2]) > 180


def test_more_random_views_leave_the_first_as_they_were(part):
    plan = replace(PLAN, planes=(), random=[RANDOM])
    more = replace(plan, random=[replace(RANDOM, count=20)])
    assert more.views(part)[:12] == plan.views(part)


def test_a_view_that_sees_no_feature_is_named(part):
    plan = replace(PLAN, planes=[replace(PLANE, x_mm=[0, 900])])
    message = r"view 'near-x2-y1' sees none of its features \(h0 out of frame, h1 out of frame\)"
    with pytest.raises(InputError, match=message):
        plan.views(part)


def test_the_wrong_side_is_recognised(part):
    with pytest.raises(InputError, match=r"'near-x1-y1' sees none .*h0 facing away"):
        replace(PLAN, side="outside").views(part)


def test_views_that_see_nothing_are_left_out_on_request(part):
    plan = replace(PLAN, planes=[replace(PLANE, x_mm=[0, 900])], blind_views="skip")
    names = [view.name for view in plan.views(part)]
    assert names == ["near-x1-y1", "near-x1-y2"]


def test_a_plan_of_which_nothing_is_left_is_refused(part):
    plan = replace(PLAN, planes=[replace(PLANE, x_mm=[900])], blind_views="skip")
    with pytest.raises(InputError, match="none of its views sees any of h0, h1"):
        plan.views(part)


def test_random_positions_that_never_see_anything_are_named(part):
    plan = replace(PLAN, planes=(), random=[replace(RANDOM, x_mm=(800, 900), count=1)])
    with pytest.raises(InputError, match="view 'random-01' sees none of its features from"):
        plan.views(part)


def test_an_exposure_the_sensor_cannot_take_is_named(part):
    plan = replace(PLAN, planes=[replace(PLANE, exposures_ms=[5, 2000])])
    with pytest.raises(SensorError, match=r"plan 'p', views 'near': .*1 to 1000 ms, got 2000 ms"):
        plan.views(part)


def test_a_plane_outside_the_working_distance_is_named(part):
    plan = replace(PLAN, planes=[replace(PLANE, z_tcp_mm=-250)])
    message = "'near-x1-y1' feature 'h1' lies 350 mm before the camera .* from 400 to 800 mm"
    with pytest.raises(InputError, match=message):
        plan.views(part)


def test_a_feature_the_part_lacks_is_named(part):
    with pytest.raises(FeatureError, match="no feature 'h7'"):
        replace(PLAN, features=["h7"]).views(part)
