import numpy as np
import pytest

from exposight.cell import Feature, Part
from exposight.geometry import RigidTransform
from exposight.observing import Visibility, view_features

POSES = {
    Visibility.BEHIND_CAMERA: RigidTransform(translation_mm=[0, 0, -600]),
    Visibility.FACING_AWAY: RigidTransform.from_fanuc_wpr((0, 0, 600), 180, 0, 0),
    Visibility.OUT_OF_FRAME: RigidTransform(translation_mm=[1000, 0, 600]),
    Visibility.PARTLY_OUT_OF_FRAME: RigidTransform(translation_mm=[240, 0, 600]),
    # between four pixels, with an outer radius of a third of a pixel
    Visibility.BELOW_ONE_PIXEL: RigidTransform(translation_mm=[38.125, 38.125, 61000]),
}
"""Camera from hole, one for each reason not to measure it."""


@pytest.fixture
def look(sensor):
    """Return a function that views one feature from one pose."""

    def view(feature, camera_from_part):
        part = Part(name="part", features=(feature,))
        (only,) = view_features(part, sensor, camera_from_part)
        return only

    return view


def test_every_reason_is_tested():
    assert set(POSES) == set(Visibility) - {Visibility.VISIBLE}


@pytest.mark.parametrize("reason", POSES, ids=lambda reason: reason.value)
def test_what_cannot_be_measured_has_a_reason_a_pose_and_no_measurement(
    sensor, facing, make_capture, observe, hole, reason
):
    beside = hole(20.0, facing.inverse() @ POSES[reason])
    (row,) = observe(sensor, beside, make_capture(sensor, facing))
    assert row.visibility == reason.value
    measured = (row.p_norm, row.i_avg, row.n_points, row.n_pixels)
    statistics = (row.i_std, row.i_median, row.i_p05, row.i_p95, row.clipped_share)
    assert set(measured + statistics) == {None}
    expected = POSES[reason].translation_mm - [0, 0, 600]
    assert (row.x_mm, row.y_mm, row.z_mm) == pytest.approx(tuple(expected))
    assert np.isfinite([row.w_deg, row.p_deg, row.r_deg, row.incidence_deg]).all()


def test_what_cannot_be_measured_takes_no_place_of_what_can(
    sensor, facing, make_capture, observe, hole
):
    poses = [*POSES.values(), facing]
    features = tuple(hole(20.0, facing.inverse() @ pose, f"f{i}") for i, pose in enumerate(poses))
    rows = observe(sensor, features, make_capture(sensor, facing))
    assert [row.feature for row in rows] == [feature.name for feature in features]
    assert [row.visibility for row in rows] == [*(reason.value for reason in POSES), "visible"]
    assert rows[-1].p_norm == pytest.approx(1.0, abs=0.001)


def test_a_ring_of_which_a_part_is_behind_the_camera_is_behind_it(look, hole):
    across = RigidTransform.from_fanuc_wpr((5, 0, 10), 0, 80, 0)
    assert look(hole(20.0), across).visibility is Visibility.BEHIND_CAMERA


def test_a_camera_that_looks_into_a_hole_sees_nothing_of_its_ring(look, hole):
    near = RigidTransform(translation_mm=[0, 0, 5])
    assert look(hole(20.0), near).visibility is Visibility.OUT_OF_FRAME


def test_a_disc_that_fills_the_frame_is_partly_out_of_it(look):
    near = RigidTransform(translation_mm=[0, 0, 5])
    disc = Feature(
        name="p1", kind="surface_point", part_from_feature=RigidTransform(), radius_mm=20.0
    )
    assert look(disc, near).visibility is Visibility.PARTLY_OUT_OF_FRAME


def test_a_ring_that_touches_the_frame_from_inside_is_visible(look, hole):
    # the last pixel reaches to column 640.5, 320.5 px or 240.375 mm off the axis
    inside = RigidTransform(translation_mm=[240.375 - 25.0 - 0.1, 0, 600])
    assert look(hole(20.0), inside).visibility is Visibility.VISIBLE


def test_a_ring_that_crosses_the_frames_border_is_not(look, hole):
    crossing = RigidTransform(translation_mm=[240.375 - 25.0 + 0.1, 0, 600])
    assert look(hole(20.0), crossing).visibility is Visibility.PARTLY_OUT_OF_FRAME


@pytest.mark.parametrize(("tilt_deg", "visible"), [(89.0, True), (91.0, False)])
def test_a_feature_faces_away_from_90_degrees_of_incidence(look, hole, tilt_deg, visible):
    pose = RigidTransform.from_fanuc_wpr((0, 0, 600), tilt_deg, 0, 0)
    view = look(hole(20.0), pose)
    assert view.pose["incidence_deg"] == pytest.approx(tilt_deg)
    assert (view.visibility is not Visibility.FACING_AWAY) is visible
