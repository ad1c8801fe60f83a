import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from exposight.contradictions.clouds import (
    Lens,
    axis_turns,
    behind_camera,
    own_pixels,
    thinner_than_image,
)
from exposight.geometry import PinholeCamera

WIDTH, HEIGHT = 640, 480
CAMERA = PinholeCamera(width=WIDTH, height=HEIGHT, fx=800, fy=805, cx=322, cy=236)
BARREL = PinholeCamera(
    width=WIDTH,
    height=HEIGHT,
    fx=800,
    fy=805,
    cx=322,
    cy=236,
    distortion=(-0.28, 0.11, 5e-4, -3e-4),
)


def lens_of(camera):
    return Lens(
        fx=camera.fx,
        fy=camera.fy,
        cx=camera.cx,
        cy=camera.cy,
        width=camera.width,
        height=camera.height,
        is_distorted=any(camera.distortion),
    )


def points_of(camera):
    """Return points (n, 3) on a bent surface, at every 16th pixel, and these pixels (n, 2)."""
    rows, columns = np.mgrid[8 : camera.height : 16, 8 : camera.width : 16]
    rays = camera.rays()[rows, columns].reshape(-1, 2)
    z = 500.0 + 80.0 * rays[:, 0] - 40.0 * rays[:, 1] ** 2
    points = np.column_stack([rays, np.ones(len(rays))]) * z[:, None]
    return points, np.column_stack([columns.ravel(), rows.ravel()]).astype(float)


def check(points, pixels, camera):
    columns, rows = pixels.astype(int).T
    return own_pixels(points, pixels, camera.rays()[rows, columns], lens_of(camera))


@pytest.mark.parametrize("camera", [CAMERA, BARREL])
def test_a_cloud_of_this_camera(camera):
    points, pixels = points_of(camera)
    noise = np.random.default_rng(1).normal(0, 0.3, len(points))
    assert check(points, pixels, camera) is None
    assert check(points + points * (noise / points[:, 2])[:, None], pixels, camera) is None


def test_few_points_say_nothing():
    points, pixels = points_of(CAMERA)
    assert check(points[:20] * [1, -1, -1], pixels[:20], CAMERA) is None


@pytest.mark.parametrize(
    ("turn", "named"),
    [
        ([1, -1, -1], "x -y -z"),
        ([-1, -1, 1], "-x -y z"),
        ([1, 1, -1], "x y -z"),
    ],
)
def test_turned_axes(turn, named):
    points, pixels = points_of(BARREL)
    found = check(points * turn, pixels, BARREL)
    assert found.is_error
    assert f"read them as {named}" in found.explanation


@settings(deadline=None, max_examples=20)
@given(st.sampled_from(range(47)))
def test_any_turn_of_axes_is_found(which):
    points, pixels = points_of(CAMERA)
    turn = axis_turns()[which]
    found = check(points @ turn, pixels, CAMERA)  # the inverse of a signed permutation: transposed
    assert found is not None
    assert found.is_error
    assert "axes are turned" in found.explanation or "run the other way" in found.explanation


def test_a_cloud_upside_down():
    points, pixels = points_of(CAMERA)
    found = check(points, pixels * [1, -1] + [0, HEIGHT - 1], CAMERA)
    assert found.is_error
    assert "-y" in found.explanation or "rows run the other way" in found.explanation


def test_a_rectified_cloud_with_the_raw_camera():
    rectified = PinholeCamera(width=WIDTH, height=HEIGHT, fx=905, fy=905, cx=344, cy=226)
    found = check(*points_of(rectified), BARREL)
    assert found.is_error
    assert "the image is rectified" in found.explanation
    assert "fx 905.0, fy 905.0, cx 344.0, cy 226.0 px" in found.explanation


def test_an_undistorted_cloud_with_the_raw_camera():
    found = check(*points_of(CAMERA), BARREL)
    assert "without its distortion fits" in found.explanation


def test_a_region_of_the_image():
    cropped = PinholeCamera(width=WIDTH, height=HEIGHT, fx=800, fy=805, cx=222, cy=186)
    found = check(*points_of(cropped), CAMERA)
    assert "begins at column 100 and row 50" in found.explanation


def test_a_binned_image():
    # the same view with half the pixels a side, against a calibration at full resolution
    binned = PinholeCamera(width=WIDTH, height=HEIGHT, fx=400, fy=402.5, cx=160.75, cy=117.75)
    found = check(*points_of(binned), CAMERA)
    assert "binned or sub-sampled 2 times" in found.explanation


def test_a_cloud_in_another_frame():
    points, pixels = points_of(CAMERA)
    angle = np.radians(12.0)
    turn = np.array(
        [[np.cos(angle), 0, np.sin(angle)], [0, 1, 0], [-np.sin(angle), 0, np.cos(angle)]]
    )
    found = check((points - [65.0, 3.0, 1.0]) @ turn, pixels, CAMERA)
    assert found.is_error
    assert "origin lies at (65.0, 3.0, 1.0) mm" in found.explanation
    assert "turned by 12.0°" in found.explanation


def test_what_no_reading_explains():
    points, pixels = points_of(CAMERA)
    shuffled = np.random.default_rng(2).permutation(points)
    found = check(shuffled, pixels, CAMERA)
    assert found.is_error
    assert found.explanation.startswith("is it the calibration")


def test_a_cloud_behind_the_camera():
    points, _ = points_of(CAMERA)
    assert behind_camera(points) is None
    assert behind_camera(np.full((5, 3), np.nan)) is None
    assert behind_camera(-points).is_error


def dense_pixels(step):
    rows, columns = np.mgrid[100:300:step, 150:400:step]
    return np.column_stack([columns.ravel(), rows.ravel()]).astype(float)


def thinner(pixels, grey=80.0):
    return thinner_than_image(pixels, np.full(len(pixels), grey))


def test_as_many_points_as_pixels():
    assert thinner(dense_pixels(1)) is None


@pytest.mark.parametrize("step", [2, 3, 4])
@pytest.mark.parametrize("offset", [0.0, 0.5])
def test_a_sub_sampled_cloud(step, offset):
    rng = np.random.default_rng(1)
    pixels = dense_pixels(step)
    kept = rng.random(len(pixels)) < 0.9
    found = thinner(pixels[kept] + offset + rng.normal(0, 0.05, (kept.sum(), 2)))
    assert found.is_error
    assert {2: "second", 3: "third", 4: "4th"}[step] in found.found


def test_a_thinned_cloud_may_be_thinned():
    chosen = np.random.default_rng(3).random(200 * 250) < 0.25
    found = thinner(dense_pixels(1)[chosen])
    assert not found.is_error
    assert "4.0 times fewer points" in found.found


@pytest.mark.parametrize("grey", [12.0, 230.0])
def test_dark_and_bright_images_give_few_points(grey):
    chosen = np.random.default_rng(3).random(200 * 250) < 0.25
    assert thinner(dense_pixels(1)[chosen], grey) is None


def test_two_clouds_in_one_file():
    pixels = dense_pixels(1)
    found = thinner(np.concatenate([pixels, pixels + 0.3]))
    assert "2.0 times more points than pixels" in found.found


def test_a_dark_side_makes_a_cloud_uneven_not_thin():
    pixels = dense_pixels(1)
    rng = np.random.default_rng(4)
    share = 0.6 * (pixels[:, 0] - 150) / 250  # from none at the left to 60 % at the right
    assert thinner(pixels[rng.random(len(pixels)) < share]) is None
