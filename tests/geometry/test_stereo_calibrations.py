"""Two cameras from OpenCV's stereo files and from two ROS camera_infos; raw or rectified."""

import cv2
import numpy as np
import pytest

from exposight.errors import FormatError, PoseError
from exposight.geometry import (
    PinholeCamera,
    RigidTransform,
    read_camera_info,
    read_ros_camera_info,
    read_stereo_cameras,
)

K = ((800.0, 0, 320), (0, 801, 240), (0, 0, 1))
D = (-0.2, 0.05, 0, 0, 0)
POSE = RigidTransform.from_fanuc_wpr((60.0, 2.0, -1.0), 1.0, -3.0, 0.5)
"""The second camera in the first one's frame."""


def camera_info(path, *, k=K, d=D, p=None, r=None):
    """A message; P as given, row by row."""
    lines = ["width: 640", "height: 480", "distortion_model: plumb_bob"]
    lines += [f"{key}: {list(map(float, np.ravel(value)))}" for key, value in (("K", k), ("D", d))]
    if r is not None:
        lines.append(f"R: {np.ravel(r).tolist()}")
    if p is not None:
        lines.append(f"P: {list(map(float, p))}")
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


def projection(f=900.0, offset=0.0):
    return (f, 0, 330, offset, 0, f, 230, 0, 0, 0, 1, 0)


def ros_pair(tmp_path, baseline_m=0.06, **both):
    return (
        camera_info(tmp_path / "left.yaml", p=projection(), **both),
        camera_info(tmp_path / "right.yaml", p=projection(offset=-900.0 * baseline_m), **both),
    )


def opencv_nodes(images="raw"):
    inverse = POSE.inverse()
    nodes = {"M1": np.array(K), "D1": np.array([D]), "M2": np.array(K), "D2": np.array([D])}
    nodes |= {"R": inverse.rotation, "T": inverse.translation_mm[:, None]}
    if images == "both":
        baseline = float(np.linalg.norm(POSE.translation_mm))
        nodes["P1"] = np.array(projection()).reshape(3, 4)
        nodes["P2"] = np.array(projection(offset=-900.0 * baseline)).reshape(3, 4)
    return nodes


def opencv_file(path, nodes):
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    for name, matrix in nodes.items():
        storage.write(name, matrix)
    storage.release()
    return path


def test_rectified_pair_has_its_baseline_in_mm(tmp_path):
    pair = read_stereo_cameras(*ros_pair(tmp_path), images="rectified")
    assert pair.first == PinholeCamera(width=640, height=480, fx=900, fy=900, cx=330, cy=230)
    np.testing.assert_allclose(pair.first_from_second.translation_mm, (60.0, 0, 0))
    assert pair.images == "rectified"


def test_raw_pair_is_turned_as_its_rectification_says(tmp_path):
    turns = [RigidTransform.from_fanuc_wpr((0, 0, 0), 1, p, 0).rotation for p in (2, -3)]
    left = camera_info(tmp_path / "left.yaml", p=projection(), r=turns[0])
    right = camera_info(tmp_path / "right.yaml", p=projection(offset=-54.0), r=turns[1])
    pair = read_stereo_cameras(left, right, images="raw")
    assert pair.first.distortion == D
    # A point in both rectified frames has the same Y and Z, and X less by the baseline.
    point = np.array([10.0, -20.0, 500.0])
    seen = turns[1] @ pair.first_from_second.inverse().apply(turns[0].T @ point)
    np.testing.assert_allclose(seen, point - (60.0, 0, 0))


@pytest.mark.parametrize("reader", ["one", "two"])
def test_raw_or_rectified_is_asked_where_it_matters(tmp_path, reader):
    left, right = ros_pair(tmp_path)
    with pytest.raises(FormatError, match=r"800 px, with .* 900 px.*--raw or --rectified"):
        read_ros_camera_info(left) if reader == "one" else read_stereo_cameras(left, right)


def test_nothing_is_asked_of_an_ideal_camera(tmp_path):
    path = camera_info(tmp_path / "c.yaml", d=(), k=np.reshape(projection(), (3, 4))[:, :3],
                       p=projection())  # fmt: skip
    assert read_ros_camera_info(path) == read_ros_camera_info(path, "raw")


def test_rectified_images_need_p(tmp_path):
    with pytest.raises(FormatError, match="no P"):
        read_ros_camera_info(camera_info(tmp_path / "c.yaml"), "rectified")


def test_an_uncalibrated_p_counts_as_none(tmp_path):
    assert read_camera_info(camera_info(tmp_path / "c.yaml", p=(0.0,) * 12)).rectified is None


def test_left_and_right_swapped(tmp_path):
    left, right = ros_pair(tmp_path)
    with pytest.raises(FormatError, match=r"-60 mm to the right .*left camera's file first"):
        read_stereo_cameras(right, left, images="rectified")


def test_one_camera_info_is_no_pair(tmp_path):
    with pytest.raises(FormatError, match="needs the right one's camera_info"):
        read_stereo_cameras(ros_pair(tmp_path)[0])


def test_a_right_camera_without_baseline(tmp_path):
    left, _ = ros_pair(tmp_path)
    with pytest.raises(FormatError, match="below 0"):
        read_stereo_cameras(left, left, images="rectified")
    with pytest.raises(FormatError, match=r"no P.*holds the baseline"):
        read_stereo_cameras(left, camera_info(tmp_path / "r.yaml"), images="rectified")


def test_cameras_above_one_another(tmp_path):
    p = (*projection()[:7], -54.0, *projection()[8:])
    with pytest.raises(FormatError, match="along y"):
        read_camera_info(camera_info(tmp_path / "c.yaml", p=p))


@pytest.mark.parametrize("files", [1, 2])
def test_opencv_pair_in_one_file_or_two(tmp_path, files):
    nodes = opencv_nodes()
    if files == 1:
        paths = [opencv_file(tmp_path / "stereo.yml", nodes)]
    else:
        extrinsics = {name: nodes.pop(name) for name in ("R", "T")}
        paths = [
            opencv_file(tmp_path / "intrinsics.yml", nodes),
            opencv_file(tmp_path / "extrinsics.yml", extrinsics),
        ]
    pair = read_stereo_cameras(*paths, size=(640, 480))
    assert pair.images == "raw"
    assert pair.first.distortion == D
    np.testing.assert_allclose(pair.first_from_second.to_matrix(), POSE.to_matrix(), atol=1e-9)


def test_opencv_with_both_kinds_asks(tmp_path):
    path = opencv_file(tmp_path / "stereo.yml", opencv_nodes("both"))
    with pytest.raises(FormatError, match=r"M1 and D1.*P1.*--raw or --rectified"):
        read_stereo_cameras(path, size=(640, 480))
    raw = read_stereo_cameras(path, size=(640, 480), images="raw")
    rectified = read_stereo_cameras(path, size=(640, 480), images="rectified")
    assert raw.baseline_mm == pytest.approx(rectified.baseline_mm)
    assert rectified.first.fx == 900.0


def test_baselines_of_p2_and_t_must_agree(tmp_path):
    nodes = opencv_nodes("both") | {"T": np.array([[-30.0], [0], [0]])}
    path = opencv_file(tmp_path / "stereo.yml", nodes)
    with pytest.raises(FormatError, match=r"60.* mm to the right of the first, T 30 mm"):
        read_stereo_cameras(path, size=(640, 480), images="rectified")


@pytest.mark.parametrize(
    ("change", "error", "message"),
    [
        ({"T": None}, FormatError, "no translation .*--keys translation="),
        ({"R": np.full((3, 3), 2.0)}, PoseError, "not a rotation"),
        ({}, FormatError, "--image-size"),
    ],
)
def test_what_is_missing_is_named(tmp_path, change, error, message):
    nodes = {k: v for k, v in (opencv_nodes() | change).items() if v is not None}
    path = opencv_file(tmp_path / "stereo.yml", nodes)
    with pytest.raises(error, match=message):
        read_stereo_cameras(path, size=None if not change else (640, 480))
