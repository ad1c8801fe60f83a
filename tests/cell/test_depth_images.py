"""Depth images: their files, their scale, and the clouds that they are with a camera."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from exposight.cell import (
    cloud_from_depth,
    is_depth_image,
    read_depth,
    read_depth_cloud,
    sensor_preset,
)
from exposight.errors import CloudError, ContradictionError, FormatError, MissingFileError
from exposight.geometry import PinholeCamera

CAMERA = PinholeCamera(width=32, height=24, fx=40.0, fy=41.0, cx=15.0, cy=12.5)
SENSOR = replace(sensor_preset("comet-pro-ae"), cameras=(CAMERA,))


def depth_mm():
    z = 500.0 + np.arange(24 * 32).reshape(24, 32) / 10
    z[3, 4:8] = 0.0
    return z


def write(path, depth):
    if path.suffix == ".npy":
        np.save(path, depth)
    else:
        assert cv2.imwrite(str(path), depth)
    return path


@pytest.mark.parametrize(
    ("name", "dtype", "scale_mm"),
    [
        ("d.png", np.uint16, 0.1),
        ("d.tif", np.uint16, 0.1),
        ("d.tiff", np.float32, 1.0),
        ("d.npy", np.float64, 1000.0),
    ],
)
def test_every_file_becomes_the_same_cloud(tmp_path, name, dtype, scale_mm):
    steps = depth_mm() / scale_mm
    path = write(tmp_path / name, (np.rint(steps) if dtype == np.uint16 else steps).astype(dtype))
    assert is_depth_image(path)
    cloud = read_depth_cloud(path, SENSOR, scale_mm=scale_mm)
    expected = cloud_from_depth(depth_mm(), CAMERA, scale_mm=1.0)
    np.testing.assert_allclose(cloud.points, expected.points, atol=1e-3)


def test_points_lie_where_their_pixels_look():
    cloud = cloud_from_depth(depth_mm(), CAMERA, scale_mm=1.0)
    pixels = CAMERA.project(cloud.points)
    rows, columns = np.nonzero(cloud.valid)
    np.testing.assert_allclose(pixels[cloud.valid], np.stack([columns, rows], -1), atol=1e-4)
    assert (~cloud.valid).sum() == 4


def test_half_the_resolution():
    cloud = cloud_from_depth(depth_mm()[::2, ::2], CAMERA, scale_mm=1.0)
    pixels = CAMERA.project(cloud.points)
    assert pixels[5, 6] == pytest.approx([12.5, 10.5])


def test_missing_depth_of_floating_point_files(tmp_path):
    depth = depth_mm()
    depth[0, :3] = np.inf, np.nan, 0.0
    assert np.isnan(read_depth(write(tmp_path / "d.npy", depth))[0, :3]).all()


def test_the_scale_is_asked_for_with_what_would_fit(tmp_path):
    path = write(tmp_path / "d.png", np.rint(depth_mm() * 10).astype(np.uint16))
    with pytest.raises(CloudError, match=r"--depth-scale .*: 0\.1 .*would put it within .* 400 to"):
        read_depth_cloud(path, SENSOR)


def test_a_scale_that_puts_everything_out_of_reach_is_a_contradiction(tmp_path):
    path = write(tmp_path / "d.png", np.rint(depth_mm() * 10).astype(np.uint16))
    with pytest.raises(ContradictionError, match=r"5038 to 5729 mm, none .* 0\.1 .*would fit"):
        read_depth_cloud(path, SENSOR, scale_mm=1.0)


def test_depth_partly_out_of_reach_is_none(tmp_path):
    depth = depth_mm()
    depth[:20] = 3000.0
    path = write(tmp_path / "d.npy", depth)
    assert read_depth_cloud(path, SENSOR, scale_mm=1.0).n_valid == depth.size


@pytest.mark.parametrize(
    ("depth", "words"),
    [
        (np.zeros((20, 30)), "half, a third"),
        (np.zeros((24, 32, 3)), "half, a third"),
        (np.full((24, 32), -5.0), "behind the camera"),
    ],
)
def test_depth_that_is_no_image_of_the_camera(depth, words):
    with pytest.raises(CloudError, match=words):
        cloud_from_depth(depth, CAMERA, scale_mm=1.0)


@pytest.mark.parametrize("scale_mm", [0.0, -1.0, np.nan, np.inf])
def test_a_scale_that_is_none(scale_mm):
    with pytest.raises(CloudError, match="must be above 0 mm"):
        cloud_from_depth(depth_mm(), CAMERA, scale_mm=scale_mm)


@pytest.mark.parametrize(
    "picture", [np.zeros((24, 32), np.uint8), np.zeros((24, 32, 3), np.uint16)]
)
def test_a_picture_of_depth_is_none(tmp_path, picture):
    with pytest.raises(FormatError, match="16 bits or floating-point"):
        read_depth(write(tmp_path / "d.png", picture))


def test_other_files(tmp_path):
    with pytest.raises(MissingFileError):
        read_depth(tmp_path / "none.png")
    (tmp_path / "d.exr").write_bytes(b"x")
    with pytest.raises(FormatError, match=r"\.png, \.tif"):
        read_depth(tmp_path / "d.exr")
    (tmp_path / "d.npy").write_bytes(b"x")
    with pytest.raises(FormatError, match="NPY"):
        read_depth(tmp_path / "d.npy")
    np.save(tmp_path / "cloud.npy", np.zeros((9, 3)))
    assert not any(map(is_depth_image, (tmp_path / "cloud.npy", tmp_path / "d.npy")))
