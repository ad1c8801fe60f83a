"""The pose of a feature: (x, y, z, w, p, r) in the TCP frame, and the incidence angle."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from exposight.cell import Feature, Part
from exposight.geometry import RigidTransform
from exposight.observing import incidence_deg, orientation_deg, view_features

ANGLE_TOLERANCE_DEG = 1e-9
"""A few roundings of angles up to 180°."""

tilts = st.floats(-80, 80)
turns = st.floats(-180, 180)


def feature_of(kind, pose=None):
    sizes = {"slot": (4.0, 20.0, 8.0), "pocket": (2.0, 20.0, 10.0)}
    radius, length, width = sizes.get(kind, (4.0, None, None))
    return Feature(
        name="f",
        kind=kind,
        part_from_feature=pose or RigidTransform(),
        radius_mm=radius,
        length_mm=length,
        width_mm=width,
    )


@pytest.mark.parametrize("kind", ["hole", "slot", "pocket", "sphere", "surface_point"])
def test_a_sensor_squarely_facing_a_feature_sees_no_angles(sensor, facing, kind):
    part = Part(name="part", features=(feature_of(kind),))
    (view,) = view_features(part, sensor, facing)
    assert [view.pose[name] for name in ("w_deg", "p_deg", "r_deg", "incidence_deg")] == [0.0] * 4


@given(w=tilts, p=tilts)
def test_fanuc_angles_of_a_hole_without_turn_are_recovered(w, p):
    pose = RigidTransform.from_fanuc_wpr((0, 0, 0), w, p, 0)
    assert orientation_deg(feature_of("hole"), pose) == pytest.approx(
        (w, p, 0.0), abs=ANGLE_TOLERANCE_DEG
    )


@given(w=tilts, p=tilts, r=turns)
@pytest.mark.parametrize("kind", ["slot", "pocket"])
def test_fanuc_angles_of_a_feature_with_a_length_are_recovered(kind, w, p, r):
    pose = RigidTransform.from_fanuc_wpr((0, 0, 0), w, p, r)
    recovered = RigidTransform.from_fanuc_wpr((0, 0, 0), *orientation_deg(feature_of(kind), pose))
    np.testing.assert_allclose(recovered.rotation, pose.rotation, atol=1e-12)


@given(w=tilts, p=tilts, spin=turns)
@pytest.mark.parametrize("kind", ["hole", "sphere", "surface_point"])
def test_a_turn_about_its_own_axis_does_not_change_a_round_features_angles(kind, w, p, spin):
    pose = RigidTransform.from_fanuc_wpr((0, 0, 0), w, p, 0)
    spun = pose @ RigidTransform.from_fanuc_wpr((0, 0, 0), 0, 0, spin)
    assert orientation_deg(feature_of(kind), spun) == pytest.approx(
        (w, p, 0.0), abs=ANGLE_TOLERANCE_DEG
    )


@given(w=turns, p=tilts, r=turns)
def test_a_holes_angles_give_its_normal_whatever_its_orientation(w, p, r):
    pose = RigidTransform.from_fanuc_wpr((0, 0, 0), w, p, r)
    angles = orientation_deg(feature_of("hole"), pose)
    normal = RigidTransform.from_fanuc_wpr((0, 0, 0), *angles).z_axis
    # arcsin loses half of the digits where w is near ±90°
    np.testing.assert_allclose(normal, pose.z_axis, atol=1e-7)


@given(spin=turns)
@settings(max_examples=20, deadline=None)
def test_a_turn_about_its_own_axis_does_not_change_a_holes_row(
    sensor_and_capture, observe, hole, spin
):
    sensor, capture = sensor_and_capture
    spun = RigidTransform.from_fanuc_wpr((0, 0, 0), 0, 0, spin)
    (before,) = observe(sensor, hole(11.3), capture)
    (after,) = observe(sensor, hole(11.3, spun), capture)
    assert (after.p_norm, after.n_pixels) == (before.p_norm, before.n_pixels)
    assert (after.w_deg, after.p_deg, after.r_deg) == pytest.approx(
        (before.w_deg, before.p_deg, before.r_deg), abs=ANGLE_TOLERANCE_DEG
    )


@given(x=st.floats(-500, 500), y=st.floats(-500, 500), z=st.floats(-500, 500), w=turns, r=turns)
@settings(max_examples=20, deadline=None)
def test_the_origin_of_the_parts_frame_does_not_matter(
    sensor_and_capture, observe, make_capture, hole, x, y, z, w, r
):
    sensor, capture = sensor_and_capture
    moved_from_part = RigidTransform.from_fanuc_wpr((x, y, z), w, 20, r)
    (before,) = observe(sensor, hole(11.3), capture)
    moved = make_capture(
        sensor, capture.camera_from_part @ moved_from_part.inverse(), cloud=capture.cloud
    )
    (after,) = observe(sensor, hole(11.3, moved_from_part), moved)
    assert (after.p_norm, after.i_avg) == (before.p_norm, before.i_avg)
    pose = ("x_mm", "y_mm", "z_mm", "w_deg", "p_deg", "r_deg", "incidence_deg")
    assert [getattr(after, name) for name in pose] == pytest.approx(
        [getattr(before, name) for name in pose], abs=1e-6
    )


def test_sensor_and_part_moved_together_see_the_same(sensor, make_capture, observe, hole):
    world_from_camera = RigidTransform.from_fanuc_wpr((100, 200, 300), 10, 20, 30)
    world_from_part = world_from_camera @ RigidTransform.from_fanuc_wpr((5, 3, 590), 7, -9, 0)
    moved_from_world = RigidTransform.from_fanuc_wpr((-1000, 500, 20), -120, 40, 77)
    rows = []
    for motion in (RigidTransform(), moved_from_world):
        camera_from_part = (motion @ world_from_camera).inverse() @ (motion @ world_from_part)
        rows += observe(sensor, hole(11.3), make_capture(sensor, camera_from_part))
    assert (rows[0].p_norm, rows[0].n_pixels) == (rows[1].p_norm, rows[1].n_pixels)
    assert (rows[0].x_mm, rows[0].w_deg) == pytest.approx((rows[1].x_mm, rows[1].w_deg))


def test_nearer_than_the_tcp_is_negative_z(sensor, make_capture, observe, hole):
    near = RigidTransform(translation_mm=[12, -7, 570])
    (row,) = observe(sensor, hole(), make_capture(sensor, near))
    assert (row.x_mm, row.y_mm, row.z_mm) == pytest.approx((12, -7, -30))


def test_the_pose_is_told_in_the_sensors_own_tcp_frame(make_sensor, make_capture, observe, hole):
    camera_from_tcp = RigidTransform.from_fanuc_wpr((50, 20, 550), 10, 0, 0)
    sensor = make_sensor(camera_from_tcp=camera_from_tcp)
    tcp_from_part = RigidTransform.from_fanuc_wpr((-30, 4, 25), 3, -5, 0)
    (row,) = observe(sensor, hole(), make_capture(sensor, camera_from_tcp @ tcp_from_part))
    pose = (row.x_mm, row.y_mm, row.z_mm, row.w_deg, row.p_deg, row.r_deg)
    assert pose == pytest.approx((-30, 4, 25, 3, -5, 0), abs=1e-9)


# -- incidence ----------------------------------------------------------------------------------


@given(w=tilts, p=tilts)
def test_on_the_axis_the_incidence_is_the_tilt(w, p):
    pose = RigidTransform.from_fanuc_wpr((0, 0, 600), w, p, 0)
    cosine = np.cos(np.radians(w)) * np.cos(np.radians(p))
    # arccos loses half of the digits near 0
    assert incidence_deg(pose) == pytest.approx(np.degrees(np.arccos(cosine)), abs=1e-5)


@pytest.mark.parametrize("x_mm", [0.0, 150.0, -150.0, 600.0])
def test_off_the_axis_the_incidence_is_that_of_the_ray(x_mm):
    pose = RigidTransform(translation_mm=[x_mm, 0, 600])
    assert incidence_deg(pose) == pytest.approx(np.degrees(np.arctan2(abs(x_mm), 600)))


def test_at_the_cameras_centre_there_is_no_ray_and_the_incidence_is_grazing():
    assert incidence_deg(RigidTransform()) == 90.0


@pytest.fixture(scope="module")
def sensor_and_capture(make_sensor, make_capture):
    sensor = make_sensor()
    camera_from_part = RigidTransform.from_fanuc_wpr((13, -9, 600), 14, -11, 0)
    return sensor, make_capture(sensor, camera_from_part)
