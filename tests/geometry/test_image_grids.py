"""Grids at a fraction of an image's resolution: which fraction, and where their pixels look."""

import numpy as np
import pytest

from exposight.errors import SensorError
from exposight.geometry import PinholeCamera, averaged_camera, grid_camera, grid_ratio

CAMERA = PinholeCamera(
    width=64, height=48, fx=80.0, fy=81.0, cx=31.0, cy=24.5, skew=0.2, distortion=(-0.1, 0.02, 0, 0)
)


@pytest.mark.parametrize(
    ("grid", "image", "ratio"),
    [
        ((48, 64), (48, 64), 1),
        ((24, 32), (48, 64), 2),
        ((12, 16), (48, 64), 4),
        ((321, 241), (641, 481), 2),  # every second pixel
        ((320, 240), (641, 481), 2),  # means
        ((47, 64), (48, 64), None),
        ((24, 64), (48, 64), None),
        ((96, 128), (48, 64), None),
        ((24,), (48, 64), None),
        ((0, 0), (48, 64), None),
    ],
)
def test_ratio_of_grids(grid, image, ratio):
    assert grid_ratio(grid, image) == ratio


@pytest.mark.parametrize("ratio", [2, 4])
def test_means_look_between_their_pixels(ratio):
    rays, coarse = CAMERA.rays(), averaged_camera(CAMERA, ratio).rays()
    means = rays.reshape(48 // ratio, ratio, 64 // ratio, ratio, 2).mean(axis=(1, 3))
    np.testing.assert_allclose(coarse, means, atol=1e-4)  # but for the lens's bend


@pytest.mark.parametrize("ratio", [2, 3, 4])
def test_points_tell_whether_pixels_are_single_or_means(ratio):
    points = np.concatenate([500.0 * CAMERA.rays(), np.full((48, 64, 1), 500.0)], axis=-1)
    single = points[::ratio, ::ratio]
    camera = grid_camera(CAMERA, single.shape[:2], single)
    np.testing.assert_allclose(camera.rays(), CAMERA.rays()[::ratio, ::ratio], atol=1e-9)
    rows, columns = 48 // ratio, 64 // ratio
    blocks = points[: rows * ratio, : columns * ratio].reshape(rows, ratio, columns, ratio, 3)
    camera = grid_camera(CAMERA, (rows, columns), blocks.mean(axis=(1, 3)))
    assert camera.cx == pytest.approx((CAMERA.cx - (ratio - 1) / 2) / ratio)


def test_the_images_own_grid_is_the_camera():
    assert grid_camera(CAMERA, (48, 64)) is CAMERA


def test_without_points_means_are_taken():
    nothing = np.full((24, 32, 3), np.nan)
    assert grid_camera(CAMERA, (24, 32), nothing) == averaged_camera(CAMERA, 2)


def test_other_grids_are_refused():
    with pytest.raises(SensorError, match="no whole fraction of the camera's 48 × 64"):
        grid_camera(CAMERA, (20, 30))
    with pytest.raises(SensorError, match="got 0"):
        averaged_camera(CAMERA, 0)
