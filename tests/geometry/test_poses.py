"""Rigid transforms and the robots' rotation conventions."""

import cv2
import numpy as np
import pytest
import trimesh.transformations
from hypothesis import example, given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from exposight.errors import CloudError, PoseError
from exposight.geometry import RigidTransform, check_points, check_rotation, rotation_facing

LAW = settings(max_examples=60, deadline=None)

ROUNDING = 1e-12
"""A rotation goes through a dozen operations on numbers up to 1."""

ROUNDING_MM = 1e-9
"""Positions up to 5 m, a few products deep."""

ROUNDING_DEG = 1e-9
"""Angles up to 180°, away from the gimbal lock, at which they lose digits."""


def numbers(limit):
    return st.floats(-limit, limit, allow_nan=False)


positions_mm = st.tuples(*[numbers(2000.0)] * 3)
angles_deg = numbers(180.0)


@st.composite
def transforms(draw):
    angles = draw(st.tuples(angles_deg, angles_deg, angles_deg))
    rotation = Rotation.from_euler("ZXZ", angles, degrees=True).as_matrix()
    return RigidTransform(rotation=rotation, translation_mm=draw(positions_mm))


def about_x(angle_deg):
    c, s = np.cos(np.radians(angle_deg)), np.sin(np.radians(angle_deg))
    return np.array([[1, 0, 0], [0, c, -s], [0, s, c]])


def about_y(angle_deg):
    c, s = np.cos(np.radians(angle_deg)), np.sin(np.radians(angle_deg))
    return np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]])


def about_z(angle_deg):
    c, s = np.cos(np.radians(angle_deg)), np.sin(np.radians(angle_deg))
    return np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])


def assert_same(first, second):
    np.testing.assert_allclose(first.rotation, second.rotation, atol=ROUNDING)
    np.testing.assert_allclose(first.translation_mm, second.translation_mm, atol=ROUNDING_MM)


# -- composing ----------------------------------------------------------------------------------


@LAW
@given(transforms(), transforms(), positions_mm)
def test_composes_by_cancelling(c_from_b, b_from_a, point):
    c_from_a = c_from_b @ b_from_a
    expected = c_from_b.apply(b_from_a.apply(point))
    np.testing.assert_allclose(c_from_a.apply(point), expected, atol=ROUNDING_MM)


@LAW
@given(transforms(), transforms())
def test_composes_as_matrices_do(c_from_b, b_from_a):
    product = c_from_b.to_matrix() @ b_from_a.to_matrix()
    np.testing.assert_allclose((c_from_b @ b_from_a).to_matrix(), product, atol=ROUNDING_MM)


@LAW
@given(transforms())
def test_inverse_cancels_on_both_sides(b_from_a):
    assert_same(b_from_a @ b_from_a.inverse(), RigidTransform())
    assert_same(b_from_a.inverse() @ b_from_a, RigidTransform())


@LAW
@given(transforms(), transforms())
def test_inverse_of_a_product_is_the_product_of_inverses_in_reverse(c_from_b, b_from_a):
    assert_same((c_from_b @ b_from_a).inverse(), b_from_a.inverse() @ c_from_b.inverse())


@LAW
@given(transforms(), positions_mm, positions_mm)
def test_lengths_are_kept(b_from_a, first, second):
    before = np.linalg.norm(np.subtract(first, second))
    after = np.linalg.norm(b_from_a.apply(first) - b_from_a.apply(second))
    assert after == pytest.approx(before, abs=ROUNDING_MM)


@LAW
@given(transforms())
def test_matrix_round_trip(b_from_a):
    assert_same(RigidTransform.from_matrix(b_from_a.to_matrix()), b_from_a)


def test_three_rows_of_a_matrix_suffice():
    matrix = RigidTransform.from_fanuc_wpr([1, 2, 3], 10, 20, 30).to_matrix()
    assert RigidTransform.from_matrix(matrix[:3]) == RigidTransform.from_matrix(matrix)


def test_apply_keeps_the_shape_of_an_organised_cloud():
    cloud = np.arange(24.0).reshape(2, 4, 3)
    moved = RigidTransform(translation_mm=[1, 2, 3]).apply(cloud)
    np.testing.assert_array_equal(moved, cloud + np.array([1, 2, 3]))


def test_missing_points_stay_missing():
    points = [[np.nan] * 3, [1.0, 0.0, 0.0]]
    moved = RigidTransform.from_fanuc_wpr([0, 0, 5], 0, 0, 90).apply(points)
    assert np.isnan(moved[0]).all()
    np.testing.assert_allclose(moved[1], [0, 1, 5], atol=ROUNDING)


def test_z_axis_is_the_sources_seen_from_the_target():
    b_from_a = RigidTransform.from_fanuc_wpr([7, 8, 9], 25, -40, 60)
    expected = b_from_a.apply([0, 0, 1]) - b_from_a.apply([0, 0, 0])
    np.testing.assert_allclose(b_from_a.z_axis, expected, atol=ROUNDING_MM)


def test_equal_transforms_have_equal_hashes_also_across_the_sign_of_zero():
    first, second = (RigidTransform(translation_mm=[zero, 0, 0]) for zero in (0.0, -0.0))
    assert first == second
    assert hash(first) == hash(second)


def test_different_transforms_are_unequal():
    assert RigidTransform() != RigidTransform(translation_mm=[0, 0, 1e-9])
    assert RigidTransform() != "identity"


def test_a_transform_does_not_change_with_the_arrays_it_was_made_from():
    rotation, translation = np.eye(3), np.zeros(3)
    transform = RigidTransform(rotation=rotation, translation_mm=translation)
    rotation[0, 0] = translation[0] = 5.0
    assert transform == RigidTransform()


def test_a_transform_is_read_only():
    with pytest.raises(ValueError, match="read-only"):
        RigidTransform().rotation[0, 0] = 2.0


# -- Fanuc --------------------------------------------------------------------------------------


@LAW
@given(angles_deg, angles_deg, angles_deg)
def test_fanuc_is_rz_ry_rx(w, p, r):
    expected = about_z(r) @ about_y(p) @ about_x(w)
    pose = RigidTransform.from_fanuc_wpr([0, 0, 0], w, p, r)
    np.testing.assert_allclose(pose.rotation, expected, atol=ROUNDING)


@LAW
@given(angles_deg, numbers(89.0), angles_deg)
def test_fanuc_angles_round_trip(w, p, r):
    back = RigidTransform.from_fanuc_wpr([0, 0, 0], w, p, r).to_fanuc_wpr()
    turns = np.subtract(back, (w, p, r)) / 360.0
    np.testing.assert_allclose(360.0 * (turns - np.round(turns)), 0.0, atol=ROUNDING_DEG)


near_the_lock = st.builds(
    lambda sign, exponent: sign * (90.0 - 10.0**exponent),
    st.sampled_from([-1, 1]),
    st.floats(-16, 0),
)


@LAW
@given(angles_deg, st.one_of(angles_deg, near_the_lock), angles_deg)
@example(30.0, 90.0, 20.0)
@example(30.0, -90.0, 20.0)
@example(-170.0, 90.0, 170.0)
@example(180.0, -90.0, -180.0)
@example(-170.0, 90.0 - 1e-7, -78.0)
def test_fanuc_pose_round_trips_also_at_and_near_the_gimbal_lock(w, p, r):
    pose = RigidTransform.from_fanuc_wpr([1, 2, 3], w, p, r)
    back = RigidTransform.from_fanuc_wpr(pose.translation_mm, *pose.to_fanuc_wpr())
    # p is taken for exactly 90° where its cosine is below 1e-9.
    np.testing.assert_allclose(back.rotation, pose.rotation, atol=2e-9)


@pytest.mark.parametrize(("p", "expected_w"), [(90.0, 10.0), (-90.0, 50.0)])
def test_at_the_gimbal_lock_r_is_zero_and_w_takes_the_rest(p, expected_w):
    angles = RigidTransform.from_fanuc_wpr([0, 0, 0], 30, p, 20).to_fanuc_wpr()
    assert angles == pytest.approx((expected_w, p, 0.0), abs=1e-6)


def test_fanuc_agrees_with_an_independent_library():
    expected = trimesh.transformations.euler_matrix(*np.radians([31, -47, 102]), "sxyz")
    pose = RigidTransform.from_fanuc_wpr([0, 0, 0], 31, -47, 102)
    np.testing.assert_allclose(pose.to_matrix(), expected, atol=ROUNDING)


# -- KUKA ---------------------------------------------------------------------------------------


@LAW
@given(angles_deg, angles_deg, angles_deg)
def test_kuka_turns_about_z_then_the_new_y_then_the_new_x(a, b, c):
    expected = about_z(a) @ about_y(b) @ about_x(c)
    pose = RigidTransform.from_kuka_abc([0, 0, 0], a, b, c)
    np.testing.assert_allclose(pose.rotation, expected, atol=ROUNDING)


def test_kuka_a_is_about_z():
    pose = RigidTransform.from_kuka_abc([0, 0, 0], 90, 0, 0)
    np.testing.assert_allclose(pose.apply([1, 0, 0]), [0, 1, 0], atol=ROUNDING)


@LAW
@given(angles_deg, numbers(89.0), angles_deg)
def test_kuka_angles_round_trip(a, b, c):
    back = RigidTransform.from_kuka_abc([0, 0, 0], a, b, c).to_kuka_abc()
    turns = np.subtract(back, (a, b, c)) / 360.0
    np.testing.assert_allclose(360.0 * (turns - np.round(turns)), 0.0, atol=ROUNDING_DEG)


def test_the_same_three_numbers_mean_other_rotations_to_other_robots():
    fanuc = RigidTransform.from_fanuc_wpr([0, 0, 0], 10, 20, 30)
    kuka = RigidTransform.from_kuka_abc([0, 0, 0], 10, 20, 30)
    assert not np.allclose(fanuc.rotation, kuka.rotation, atol=0.1)
    assert_same(fanuc, RigidTransform.from_kuka_abc([0, 0, 0], 30, 20, 10))


# -- ABB ----------------------------------------------------------------------------------------


def test_abb_quaternion_has_its_scalar_first():
    half = np.sqrt(0.5)
    pose = RigidTransform.from_abb_quaternion([1, 2, 3], [half, 0, 0, half])
    assert_same(pose, RigidTransform.from_fanuc_wpr([1, 2, 3], 0, 0, 90))


@LAW
@given(transforms())
def test_abb_quaternion_round_trips(pose):
    quaternion = pose.to_abb_quaternion()
    assert quaternion[0] >= 0
    assert_same(RigidTransform.from_abb_quaternion(pose.translation_mm, quaternion), pose)


def test_a_quaternion_and_its_negative_are_one_rotation():
    quaternion = np.array([0.5, -0.5, 0.5, 0.5])
    first = RigidTransform.from_abb_quaternion([0, 0, 0], quaternion)
    assert_same(first, RigidTransform.from_abb_quaternion([0, 0, 0], -quaternion))


def test_a_quaternion_printed_with_few_decimals_gives_an_exact_rotation():
    rotation = RigidTransform.from_abb_quaternion([0, 0, 0], [0.9239, 0, 0.3827, 0]).rotation
    np.testing.assert_allclose(rotation.T @ rotation, np.eye(3), atol=ROUNDING)


def test_abb_agrees_with_an_independent_library():
    quaternion = np.array([0.1, 0.7, -0.1, 0.7])
    expected = trimesh.transformations.quaternion_matrix(quaternion)
    pose = RigidTransform.from_abb_quaternion([0, 0, 0], quaternion)
    np.testing.assert_allclose(pose.to_matrix(), expected, atol=ROUNDING)


# -- UR -----------------------------------------------------------------------------------------


def test_ur_metres_become_millimetres():
    pose = RigidTransform.from_ur_rotation_vector([0.25, -1.5, 0.001], [0, 0, 0])
    np.testing.assert_allclose(pose.translation_mm, [250, -1500, 1], atol=ROUNDING_MM)


def test_ur_rotation_vector_is_axis_times_angle_in_radians():
    pose = RigidTransform.from_ur_rotation_vector([0, 0, 0], [np.pi / 2, 0, 0])
    assert_same(pose, RigidTransform.from_fanuc_wpr([0, 0, 0], 90, 0, 0))


@LAW
@given(transforms())
def test_ur_round_trips_also_at_half_a_turn(pose):
    position_m, vector = pose.to_ur_rotation_vector()
    assert np.linalg.norm(vector) <= np.pi + ROUNDING
    assert_same(RigidTransform.from_ur_rotation_vector(position_m, vector), pose)


@LAW
@given(st.tuples(numbers(7.0), numbers(7.0), numbers(7.0)))
def test_ur_agrees_with_an_independent_library(vector):
    expected, _ = cv2.Rodrigues(np.array(vector))
    pose = RigidTransform.from_ur_rotation_vector([0, 0, 0], vector)
    np.testing.assert_allclose(pose.rotation, expected, atol=ROUNDING)


# -- rotations, axes and bad input --------------------------------------------------------------


def test_rounding_in_a_file_is_removed():
    printed = np.round(about_z(33.0) @ about_x(71.0), 6)
    rotation = check_rotation(printed)
    np.testing.assert_allclose(rotation.T @ rotation, np.eye(3), atol=ROUNDING)
    np.testing.assert_allclose(rotation, printed, atol=1e-6)


directions = st.tuples(*[numbers(10.0)] * 3).filter(lambda d: np.linalg.norm(d) > 1e-3)


@LAW
@given(directions, directions)
@example((0.0, 0.0, 2.0), (0.0, 0.0, -3.0))
def test_a_facing_rotation_has_the_z_axis_and_leans_x_to_the_hint(z_axis, x_hint):
    rotation = rotation_facing(z_axis, x_hint)
    z = np.asarray(z_axis) / np.linalg.norm(z_axis)
    np.testing.assert_allclose(rotation[:, 2], z, atol=ROUNDING)
    np.testing.assert_allclose(rotation, check_rotation(rotation), atol=1e-9)
    hint = np.asarray(x_hint) / np.linalg.norm(x_hint)
    if np.linalg.norm(np.cross(z, hint)) > 1e-5:
        assert abs(rotation[:, 1] @ hint) < 1e-9  # x, z and the hint lie in one plane
        assert rotation[:, 0] @ hint > 0


SHEARED = np.eye(3) + np.array([[0, 0.01, 0], [0, 0, 0], [0, 0, 0]])


@pytest.mark.parametrize(
    ("rotation", "message"),
    [
        (1.001 * np.eye(3), r"not a rotation: RᵀR differs from the identity by 0\.002 .*scale"),
        (SHEARED, r"not a rotation: RᵀR .*remove scale or shear"),
        (np.diag([1.0, 1.0, -1.0]), "mirrors space; check for a swapped or negated axis"),
        (np.zeros((3, 3)), "not a rotation"),
        (np.full((3, 3), np.nan), "must be finite, got NaN"),
        (np.eye(4), r"must be a 3×3 matrix, got shape \(4, 4\)"),
    ],
)
def test_what_is_not_a_rotation_is_refused(rotation, message):
    with pytest.raises(PoseError, match=message):
        RigidTransform(rotation=rotation)


@pytest.mark.parametrize("translation", [[1, 2], [1, 2, np.nan], [1, 2, 3, 4]])
def test_a_translation_is_three_finite_numbers(translation):
    with pytest.raises(PoseError, match="a translation in mm needs 3 finite numbers, got"):
        RigidTransform(translation_mm=translation)


def test_a_transposed_matrix_is_recognised():
    matrix = RigidTransform(translation_mm=[1, 2, 3]).to_matrix().T
    with pytest.raises(PoseError, match=r"last row of a pose must be 0 0 0 1, .* transposed\?"):
        RigidTransform.from_matrix(matrix)


def test_a_pose_matrix_of_another_shape_is_refused():
    with pytest.raises(PoseError, match=r"4×4 \(or 3×4\) matrix, got shape \(3, 3\)"):
        RigidTransform.from_matrix(np.eye(3))


@pytest.mark.parametrize("quaternion", [[1, 1, 0, 0], [0, 0, 0, 0], [0.9, 0, 0, 0]])
def test_a_quaternion_has_norm_one(quaternion):
    with pytest.raises(PoseError, match=r"must have norm 1, got .* check that four numbers"):
        RigidTransform.from_abb_quaternion([0, 0, 0], quaternion)


@pytest.mark.parametrize(
    ("read", "message"),
    [
        (lambda: RigidTransform.from_fanuc_wpr([0, 0, 0], np.nan, 0, 0), "a Fanuc .* rotation"),
        (lambda: RigidTransform.from_kuka_abc([0, 0, 0], 0, np.inf, 0), "a KUKA .* rotation"),
        (lambda: RigidTransform.from_abb_quaternion([0, 0, 0], [1, 0, 0]), "a quaternion"),
        (lambda: RigidTransform.from_ur_rotation_vector([0, 0], [0, 0, 0]), "a UR position in m"),
        (lambda: RigidTransform.from_ur_rotation_vector([0, 0, 0], [0]), "a rotation vector"),
        (lambda: rotation_facing([0, np.nan, 0]), "a z axis"),
        (lambda: rotation_facing([0, 0, 1], [1, 0]), "a hint for the x axis"),
    ],
)
def test_a_wrong_count_or_a_nan_names_what_was_read(read, message):
    with pytest.raises(PoseError, match=f"{message}.* needs . finite numbers, got"):
        read()


def test_an_axis_of_no_length_is_refused():
    with pytest.raises(PoseError, match="an axis needs a length above 0, got the zero vector"):
        rotation_facing([0, 0, 0])


@pytest.mark.parametrize("points", [np.zeros((3, 5)), 4.0, []])
def test_points_have_three_coordinates(points):
    with pytest.raises(CloudError, match=r"must be an array \(..., 3\) of x, y and z, got shape"):
        RigidTransform().apply(points)


def test_checked_points_are_float64_and_may_be_missing():
    points = check_points(np.array([[1, 2, np.nan]], dtype=np.float32))
    assert points.dtype == np.float64
    assert np.isnan(points[0, 2])


@given(transform=transforms())
@LAW
def test_a_checked_pose_is_left_alone(transform):
    again = RigidTransform.from_matrix(transform.to_matrix())
    assert again == transform
