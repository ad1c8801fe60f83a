"""Pinhole cameras with lens distortion, against OpenCV and against closed forms."""

import cv2
import numpy as np
import pytest
from hypothesis import assume, example, given, settings
from hypothesis import strategies as st

from exposight.errors import CloudError, ImageError, SensorError
from exposight.geometry import PinholeCamera

LAW = settings(max_examples=60, deadline=None)

ROUNDING_PX = 1e-8
"""Pixel positions up to some thousands, through a polynomial of degree seven."""

ROUNDING_RAY = 1e-10
"""X/Z found by Newton's method, which stops at 1e-13 and is then scaled by the lens."""

DISTORTIONS = {
    0: (),
    4: (-0.21, 0.09, 0.0012, -0.0008),
    5: (-0.31, 0.14, -0.0007, 0.0011, -0.03),
    8: (0.11, -0.06, 0.0005, 0.0009, 0.01, 0.32, -0.02, 0.004),
    12: (-0.2, 0.05, 0.001, 0.001, 0.0, 0.05, 0.0, 0.0, 0.004, -0.002, -0.003, 0.001),
    14: (-0.2, 0.05, 0.001, 0.001, 0.0, 0.0, 0.0, 0.0, 0.004, 0.0, -0.003, 0.0, 0.05, -0.08),
}
"""By OpenCV's six lengths: none, radial and tangential, k3, rational, thin prism, tilt."""


def camera_with(distortion, **changes):
    sizes = {"width": 64, "height": 48, "fx": 60.0, "fy": 61.0, "cx": 31.2, "cy": 24.7}
    return PinholeCamera(**(sizes | changes), distortion=distortion)


every_length = pytest.mark.parametrize("distortion", DISTORTIONS.values(), ids=DISTORTIONS.keys())
any_length = st.sampled_from(list(DISTORTIONS.values()))
small = st.floats(-0.5, 0.5)
depths_mm = st.floats(1.0, 5000.0)


# -- against OpenCV -----------------------------------------------------------------------------


@every_length
def test_project_agrees_with_opencv(distortion):
    camera = camera_with(distortion, width=1280, height=1024, fx=1200.0, fy=1210.0)
    points = np.random.default_rng(0).uniform([-250, -250, 400], [250, 250, 900], (200, 3))
    expected, _ = cv2.projectPoints(
        points, np.zeros(3), np.zeros(3), camera.matrix, np.array(distortion)
    )
    np.testing.assert_allclose(camera.project(points), expected[:, 0], atol=ROUNDING_PX)


@every_length
def test_undistort_agrees_with_opencv(distortion):
    camera = camera_with(distortion)
    pixels = np.random.default_rng(1).uniform([-0.5, -0.5], [63.5, 47.5], (200, 2))
    until_exact = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 500, 1e-14)
    expected = cv2.undistortPoints(
        pixels[:, None], camera.matrix, np.array(distortion), criteria=until_exact
    )
    np.testing.assert_allclose(camera.undistort(pixels), expected[:, 0], atol=ROUNDING_RAY)


# -- closed forms -------------------------------------------------------------------------------


def test_without_distortion_projection_is_the_pinholes():
    camera = camera_with((), fx=100.0, fy=200.0, cx=10.0, cy=20.0, skew=5.0)
    u, v = camera.project([3.0, -4.0, 2.0])
    assert u == pytest.approx(100 * 1.5 + 5 * -2 + 10)
    assert v == pytest.approx(200 * -2 + 20)


def test_radial_distortion_is_one_plus_k1_r2():
    camera = camera_with((-0.1, 0, 0, 0), fx=100.0, fy=100.0, cx=0.0, cy=0.0)
    np.testing.assert_allclose(camera.project([0.5, 0, 1]), [50 * (1 - 0.1 * 0.25), 0])


def test_coefficients_of_zero_are_no_distortion():
    points = np.random.default_rng(2).uniform([-1, -1, 1], [1, 1, 2], (20, 3))
    plain, zeros = camera_with(()), camera_with((0.0,) * 5)
    np.testing.assert_array_equal(plain.project(points), zeros.project(points))


def test_the_principal_point_is_seen_straight_ahead():
    camera = camera_with(DISTORTIONS[5])
    np.testing.assert_allclose(camera.undistort([camera.cx, camera.cy]), [0, 0], atol=ROUNDING_RAY)


# -- laws ---------------------------------------------------------------------------------------


@LAW
@given(any_length, st.floats(-0.55, 0.55), st.floats(-0.42, 0.42), depths_mm)
def test_undistort_undoes_project(distortion, x, y, z):
    camera = camera_with(distortion)
    pixel = camera.project([x * z, y * z, z])
    np.testing.assert_allclose(camera.undistort(pixel), [x, y], atol=ROUNDING_RAY)


# Not random: one lens in thousands all but folds within, and has no inverse there in 1e-10.
@settings(LAW, max_examples=300, derandomize=True)
@given(small, small, small, st.floats(-0.005, 0.005), st.floats(-1, 1), st.floats(-1, 1))
@example(0.5, -0.2, 0.0, 0.0, 1.33, 0.0)  # grows, then folds: plain Newton's method fails here
def test_undistort_undoes_project_for_any_lens_up_to_its_fold(k1, k2, k3, p1, x, y):
    camera = camera_with((k1, k2, p1, -p1, k3))
    beyond = camera.project([1.05 * x, 1.05 * y, 1.0])
    assume(np.isfinite(beyond).all())  # at the fold itself the inverse has no digits left
    back = camera.undistort(camera.project([x, y, 1.0]))
    np.testing.assert_allclose(back, [x, y], atol=ROUNDING_RAY)


@LAW
@given(any_length, st.floats(-0.5, 63.5), st.floats(-0.5, 47.5), depths_mm)
def test_project_undoes_back_project(distortion, u, v, depth_mm):
    camera = camera_with(distortion)
    point = camera.back_project([u, v], depth_mm)
    assert point[2] == depth_mm
    np.testing.assert_allclose(camera.project(point), [u, v], atol=ROUNDING_PX)


@LAW
@given(any_length, st.floats(0.1, 10.0))
def test_projection_does_not_see_scale(distortion, scale):
    camera, point = camera_with(distortion), np.array([30.0, -20.0, 100.0])
    np.testing.assert_allclose(
        camera.project(scale * point), camera.project(point), atol=ROUNDING_PX
    )


@every_length
def test_rays_are_the_undistorted_pixel_centres(distortion):
    camera = camera_with(distortion)
    v, u = np.mgrid[: camera.height, : camera.width]
    expected = camera.undistort(np.stack([u, v], axis=-1))
    assert np.isfinite(expected).all()
    np.testing.assert_allclose(camera.rays(), expected, atol=ROUNDING_RAY)


def test_rays_are_computed_once_and_read_only():
    camera = camera_with(DISTORTIONS[5])
    assert camera.rays() is camera_with(DISTORTIONS[5]).rays()
    with pytest.raises(ValueError, match="read-only"):
        camera.rays()[0, 0, 0] = 0.0


def test_back_project_of_a_depth_image():
    camera = camera_with(DISTORTIONS[4])
    v, u = np.mgrid[: camera.height, : camera.width]
    cloud = camera.back_project(np.stack([u, v], axis=-1), 600.0)
    assert cloud.shape == (48, 64, 3)
    np.testing.assert_allclose(cloud[..., :2] / 600.0, camera.rays(), atol=ROUNDING_RAY)


@every_length
def test_matrix_and_coefficients_round_trip(distortion):
    camera = camera_with(distortion, skew=0.3)
    again = PinholeCamera.from_matrix(
        camera.matrix, width=64, height=48, distortion=np.array([distortion])
    )
    assert again == camera


# -- where nothing is seen ----------------------------------------------------------------------


@pytest.mark.parametrize("distortion", [DISTORTIONS[0], DISTORTIONS[5]], ids=["none", "five"])
@pytest.mark.parametrize("point", [[1, 2, -100], [1, 2, 0], [0, 0, 0], [np.nan] * 3])
def test_points_not_in_front_of_the_camera_are_nan(distortion, point):
    assert np.isnan(camera_with(distortion).project(point)).all()


BARREL = (-0.3, 0.0, 0.0, 0.0)
BARREL_FOLD = 1 / np.sqrt(3 * 0.3)
"""Where r (1 − 0.3 r²) stops growing."""


def test_a_point_that_the_polynomial_folds_into_the_frame_is_nan():
    camera = camera_with(BARREL)
    point = np.array([1 / np.sqrt(0.3), 0.0, 1.0])  # 61° off the axis, where the factor is 0
    folded, _ = cv2.projectPoints(
        point, np.zeros(3), np.zeros(3), camera.matrix, np.array(camera.distortion)
    )
    assert camera.in_frame(folded).all()
    assert np.isnan(camera.project(point)).all()


def test_points_are_projected_exactly_up_to_the_fold():
    camera = camera_with(BARREL)
    assert np.isfinite(camera.project([BARREL_FOLD - 1e-6, 0, 1])).all()
    assert np.isnan(camera.project([BARREL_FOLD + 1e-6, 0, 1])).all()


def test_pixels_that_the_lens_does_not_reach_are_nan():
    camera = camera_with(BARREL, fx=100.0, fy=100.0, cx=0.0, cy=0.0)
    farthest = 100.0 * BARREL_FOLD * (1 - 0.3 * BARREL_FOLD**2)
    radius = np.concatenate(
        [np.linspace(0, farthest - 0.01, 50), farthest + np.logspace(-2, 3, 50)]
    )
    rays = camera.undistort(np.column_stack([radius, np.zeros(100)]))
    np.testing.assert_array_equal(np.isnan(rays[:, 0]), radius > farthest)


def test_rays_are_nan_where_the_lens_does_not_reach():
    camera = camera_with(BARREL, fx=40.0, fy=40.0)
    v, u = np.mgrid[: camera.height, : camera.width]
    expected = camera.undistort(np.stack([u, v], axis=-1))
    assert 0 < np.isnan(expected).sum() < expected.size
    np.testing.assert_allclose(camera.rays(), expected, atol=ROUNDING_RAY)


def test_a_rational_model_stops_at_its_pole():
    camera = camera_with((0, 0, 0, 0, 0, -0.5, 0, 0))  # denominator 1 − r²/2
    finite = np.isfinite(camera.project([[1.4, 0, 1], [1.42, 0, 1], [3.0, 0, 1]])[:, 0])
    assert finite.tolist() == [True, False, False]


def test_a_guess_at_the_pole_of_a_rational_model_is_no_obstacle():
    camera = camera_with((0, 0, 0, 0, 0, -1, 0, 0))  # x / (1 − x²) = 1 has x = (√5 − 1) / 2
    pixel = [camera.cx + camera.fx, camera.cy]
    assert camera.undistort(pixel)[0] == pytest.approx((np.sqrt(5) - 1) / 2, abs=ROUNDING_RAY)


# -- the frame ----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("pixel", "inside"),
    [
        ((0, 0), True),
        ((-0.5, -0.5), True),
        ((-0.51, 0), False),
        ((63.49, 47.49), True),
        ((63.5, 0), False),
        ((0, 47.5), False),
        ((np.nan, np.nan), False),
    ],
)
def test_the_frame_reaches_half_a_pixel_beyond_the_outer_centres(pixel, inside):
    assert camera_with(()).in_frame(pixel) == inside


# -- bad input ----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"width": 0}, "image size must be whole and positive, got 0 × 48 px"),
        ({"height": 47.5}, "image size must be whole and positive, got 64 × 47.5 px"),
        ({"width": np.nan}, "image size must be whole and positive, got nan"),
        ({"fx": -1.0}, "focal lengths must be positive, got fx = -1.0 px"),
        ({"cy": np.nan}, "intrinsic parameters must be finite"),
    ],
)
def test_a_camera_that_cannot_be_is_refused(changes, message):
    with pytest.raises(SensorError, match=message):
        camera_with((), **changes)


@pytest.mark.parametrize("count", [1, 3, 6, 13, 15])
def test_distortion_has_one_of_opencvs_lengths(count):
    with pytest.raises(SensorError, match=f"0, 4, 5, 8, 12, 14 coefficients.* got {count}"):
        camera_with((0.1,) * count)


def test_distortion_is_finite():
    with pytest.raises(SensorError, match="intrinsic parameters must be finite"):
        camera_with((0.1, np.inf, 0, 0))


@pytest.mark.parametrize(
    ("matrix", "message"),
    [
        (np.eye(4), r"must be 3×3, got shape \(4, 4\)"),
        (camera_with(()).matrix.T, r"must read \[\[fx, s, cx\].*is it transposed"),
        (np.zeros((3, 3)), "or of an uncalibrated camera"),
        (np.full((3, 3), np.nan), "a camera matrix must read"),
    ],
)
def test_a_matrix_that_is_no_camera_matrix_is_refused(matrix, message):
    with pytest.raises(SensorError, match=message):
        PinholeCamera.from_matrix(matrix, width=64, height=48)


def test_points_of_another_shape_are_refused():
    with pytest.raises(CloudError, match=r"points must be .*got shape \(3, 5\); is it transposed"):
        camera_with(()).project(np.zeros((3, 5)))


@pytest.mark.parametrize("call", ["undistort", "in_frame"])
def test_pixels_of_another_shape_are_refused(call):
    with pytest.raises(ImageError, match=r"pixels must be .* u and v, got shape \(2, 5\)"):
        getattr(camera_with(()), call)(np.zeros((2, 5)))
