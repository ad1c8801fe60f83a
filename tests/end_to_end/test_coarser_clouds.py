"""``exposight observe`` of clouds and depth images at the image's resolution and at half of it."""

import cv2
import numpy as np
import polars as pl
import pytest

from exposight.cell import ActiveSensor, ExposureRange, write_sensor
from exposight.geometry import PinholeCamera, RigidTransform

CAMERA = PinholeCamera(width=320, height=240, fx=400.0, fy=400.0, cx=159.5, cy=119.5)
DEPTH_MM = 500.0


@pytest.fixture
def files(tmp_path, monkeypatch):
    """A plate that squarely faces the camera, with two holes drilled through."""
    monkeypatch.chdir(tmp_path)
    sensor = ActiveSensor(
        name="small",
        cameras=(CAMERA,),
        first_from_camera=(RigidTransform(),),
        projector=None,
        camera_from_tcp=RigidTransform(translation_mm=np.array([0.0, 0.0, DEPTH_MM])),
        exposure=ExposureRange(min_ms=1.0, max_ms=100.0, increment_ms=1.0),
        working_distance_mm=(300.0, 700.0),
    )
    write_sensor(tmp_path / "sensor.json", sensor)
    lines = ["name,kind,x_mm,y_mm,z_mm,nx,ny,nz,radius_mm"]
    lines += ["h1,hole,-60,-40,0,0,0,1,9", "h2,hole,50,45,0,0,0,1,12"]
    (tmp_path / "features.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")
    pose = np.diag([1.0, -1.0, -1.0, 1.0])
    pose[2, 3] = DEPTH_MM
    np.savetxt(tmp_path / "pose.txt", pose)
    cv2.imwrite("image.png", np.full((240, 320), 120, np.uint8))
    return tmp_path


@pytest.fixture
def observe(files, run, run_json):
    words = ("--image", "image.png", "--features", "features.csv", "--sensor", "sensor.json")
    words = ("observe", *words, "--exposure-ms", 10, "--pose", "pose.txt", "-o", "o.csv")

    def observed(*more, fails=None):
        if fails is None:
            run_json(*words, *more)
            return pl.read_csv("o.csv")
        ended = run(*words, *more)
        assert ended.exit_code == fails
        return ended.stderr

    return observed


def plate():
    return np.concatenate([CAMERA.rays() * DEPTH_MM, np.full((240, 320, 1), DEPTH_MM)], axis=-1)


@pytest.mark.parametrize("ratio", [1, 2, 4])
def test_a_whole_cloud_has_p_norm_1_at_any_resolution(observe, ratio):
    np.save("cloud.npy", plate()[::ratio, ::ratio])
    table = observe("--cloud", "cloud.npy")
    assert table["p_norm"].to_list() == pytest.approx([1.0, 1.0], abs=0.04)
    assert (table["p_norm"] == table["n_points"] / table["n_pixels"]).all()
    assert table["i_avg"].to_list() == [120, 120]


@pytest.mark.parametrize("ratio", [1, 2])
def test_a_depth_image_is_a_cloud(observe, ratio):
    depth = np.full((240 // ratio, 320 // ratio), 10 * DEPTH_MM, np.uint16)
    cv2.imwrite("depth.png", depth)
    table = observe("--cloud", "depth.png", "--depth-scale", 0.1)
    assert table["p_norm"].to_list() == pytest.approx([1.0, 1.0], abs=0.02)


def test_what_of_depth_cannot_be(observe):
    cv2.imwrite("depth.png", np.full((240, 320), 10 * DEPTH_MM, np.uint16))
    assert "give --depth-scale" in observe("--cloud", "depth.png", fails=1)
    told = observe("--cloud", "depth.png", "--depth-scale", 1, fails=1)
    assert "none of them within 300 to 700 mm" in told
    words = ("--depth-scale", 0.1, "--cloud-unit", "m")
    assert "is a depth image" in observe("--cloud", "depth.png", *words, fails=1)
    np.save("cloud.npy", plate())
    told = observe("--cloud", "cloud.npy", "--depth-scale", 0.1, fails=1)
    assert "is a point cloud" in told


def test_a_grid_that_is_no_fraction_of_the_image(observe):
    np.save("cloud.npy", plate()[:, ::2])
    assert "half, a third" in observe("--cloud", "cloud.npy", fails=1)
