"""Planned views: where the sensor stands and says it stands, and views that cannot be taken."""

from dataclasses import replace

import numba
import numpy as np
import pytest

from exposight.cell import Part, sensor_preset
from exposight.errors import FeatureError, InputError, SensorError
from exposight.geometry import RigidTransform
from exposight.observing import Visibility, view_features
from exposight.plans import AlignmentErrors, DepthPlane, MeasuringPlan, RandomPositions, views

SENSOR = sensor_preset("comet-pro-ae")
ROUNDING_MM = 1e-9
"""A few additions of numbers below 1000 mm."""

PLANE = DepthPlane(name="near", z_tcp_mm=-150, x_mm=[-60, 60], y_mm=[-40, 40], exposures_ms=[5, 20])
PLAN = MeasuringPlan(
    name="p", sensor="comet-pro-ae", features=["h0", "h1"], reference="h1", planes=[PLANE], seed=2
)
EXACT = AlignmentErrors(photogrammetric_mm=0, photogrammetric_deg=0)


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


def _tcp_from_reference(view, part: Part, pose: str = "true_camera_from_part"):
    feature = part.feature("h1")
    return SENSOR.camera_from_tcp.inverse() @ getattr(view, pose) @ feature.part_from_feature


def test_the_reference_feature_truly_lies_on_the_grid(part):
    planned = {view.name: view for view in views(PLAN, part, SENSOR)}
    for name, position in PLANE.positions():
        at = _tcp_from_reference(planned[name], part).translation_mm
        assert at == pytest.approx(position, abs=ROUNDING_MM)


def test_before_the_inside_the_sensors_axes_are_the_parts(part):
    for view in views(PLAN, part, SENSOR):
        assert np.array_equal(view.true_camera_from_part.rotation, np.eye(3))


def test_before_the_outside_the_sensor_is_turned_about_y(part):
    outside = views(replace(PLAN, side="outside"), _turned(part), SENSOR)
    for view in outside:
        assert np.array_equal(view.true_camera_from_part.rotation, np.diag([-1.0, 1.0, -1.0]))
        assert view.visible == ("h0", "h1")


def test_the_reported_pose_is_the_true_one_with_the_recorded_error(part):
    view = views(PLAN, part, SENSOR)[0]
    tcp_from_camera = SENSOR.camera_from_tcp.inverse()
    true = tcp_from_camera @ view.true_camera_from_part
    reported = tcp_from_camera @ view.reported_camera_from_part
    error = reported @ true.inverse()
    recorded = view.alignment.reported_from_true
    assert error.to_matrix() == pytest.approx(recorded.to_matrix(), abs=ROUNDING_MM)
    assert view.alignment.error_mm > 0


def test_without_error_both_poses_are_one(part):
    for view in views(replace(PLAN, alignment=EXACT), part, SENSOR):
        assert view.reported_camera_from_part == view.true_camera_from_part


def test_kinematics_displace_features_by_up_to_five_millimetres(part):
    plan = replace(PLAN, planes=[replace(PLANE, kinematic_share=1.0)])
    for view in views(plan, part, SENSOR):
        true = _tcp_from_reference(view, part).translation_mm
        said = _tcp_from_reference(view, part, "reported_camera_from_part").translation_mm
        lever_mm = np.linalg.norm(true) * np.radians(plan.alignment.kinematic_max_deg)
        assert 0.05 < np.linalg.norm(said - true) <= 5.0 + lever_mm
        assert view.aligned_by == "kinematics"


def test_notes_tell_the_alignment(part):
    view = views(replace(PLAN, alignment=EXACT), part, SENSOR)[0]
    assert view.notes == "aligned by photogrammetry, wrong by 0.000 mm and 0.0000°"


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
    for view in views(plan, far_apart, SENSOR):
        seen = view_features(far_apart, SENSOR, view.reported_camera_from_part)
        names = [each.feature.name for each in seen if each.visibility is Visibility.VISIBLE]
        assert list(view.visible) == names
    assert {view.visible for view in views(plan, far_apart, SENSOR)} == {("h1",), ("h0", "h1")}


def test_the_same_plan_gives_the_same_views(part):
    assert views(PLAN, part, SENSOR) == views(PLAN, part, SENSOR)


def test_a_view_does_not_depend_on_the_others(part):
    one = replace(PLAN, planes=[replace(PLANE, y_mm=PLANE.y_mm[:1], x_mm=PLANE.x_mm[:1])])
    assert views(one, part, SENSOR)[0] == views(PLAN, part, SENSOR)[0]


RANDOM = RandomPositions(
    name="random",
    count=12,
    x_mm=(-300, 300),
    y_mm=(-200, 200),
    z_tcp_mm=(-100, 100),
    exposures_ms=[15],
)


def test_random_positions_stay_in_their_box_and_see_something(part):
    planned = views(replace(PLAN, planes=(), random=[RANDOM]), part, SENSOR)
    at = np.array([_tcp_from_reference(view, part).translation_mm for view in planned])
    assert len(planned) == 12
    assert (np.abs(at) <= [300, 200, 100]).all()
    assert all(view.visible for view in planned)
    assert np.ptp(at, axis=0) == pytest.approx([600, 400, 200], rel=0.6)  # spread, not one spot


def test_more_random_views_leave_the_first_as_they_were(part):
    plan = replace(PLAN, planes=(), random=[RANDOM])
    more = replace(plan, random=[replace(RANDOM, count=20)])
    assert views(more, part, SENSOR)[:12] == views(plan, part, SENSOR)


def test_a_view_that_sees_no_feature_is_named(part):
    plan = replace(PLAN, planes=[replace(PLANE, x_mm=[0, 900])])
    message = r"view 'near-x2-y1' sees none of its features \(h0 out of frame, h1 out of frame\)"
    with pytest.raises(InputError, match=message):
        views(plan, part, SENSOR)


def test_the_wrong_side_is_recognised(part):
    with pytest.raises(InputError, match=r"'near-x1-y1' sees none .*h0 facing away"):
        views(replace(PLAN, side="outside"), part, SENSOR)


def test_views_that_see_nothing_are_left_out_on_request(part):
    plan = replace(PLAN, planes=[replace(PLANE, x_mm=[0, 900])], blind_views="skip")
    names = [view.name for view in views(plan, part, SENSOR)]
    assert names == ["near-x1-y1", "near-x1-y2"]


def test_a_plan_of_which_nothing_is_left_is_refused(part):
    plan = replace(PLAN, planes=[replace(PLANE, x_mm=[900])], blind_views="skip")
    with pytest.raises(InputError, match="none of its views sees any of h0, h1"):
        views(plan, part, SENSOR)


def test_random_positions_that_never_see_anything_are_named(part):
    plan = replace(PLAN, planes=(), random=[replace(RANDOM, x_mm=(800, 900), count=1)])
    with pytest.raises(InputError, match="view 'random-01' sees none of its features from"):
        views(plan, part, SENSOR)


def test_an_exposure_the_sensor_cannot_take_is_named(part):
    plan = replace(PLAN, planes=[replace(PLANE, exposures_ms=[5, 2000])])
    with pytest.raises(SensorError, match=r"plan 'p', views 'near': .*1 to 1000 ms, got 2000 ms"):
        views(plan, part, SENSOR)


def test_a_plane_outside_the_working_distance_is_named(part):
    plan = replace(PLAN, planes=[replace(PLANE, z_tcp_mm=-250)])
    message = "'near-x1-y1' feature 'h1' lies 350 mm before the camera .* from 400 to 800 mm"
    with pytest.raises(InputError, match=message):
        views(plan, part, SENSOR)


def test_a_feature_the_part_lacks_is_named(part):
    with pytest.raises(FeatureError, match="no feature 'h7'"):
        views(replace(PLAN, features=["h7"]), part, SENSOR)
