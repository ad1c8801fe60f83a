from typing import get_args

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from exposight.errors import MissingFileError, PoseError
from exposight.geometry import (
    PoseNotation,
    RigidTransform,
    parse_pose,
    pose_from_numbers,
    read_pose,
)

POSE = RigidTransform.from_fanuc_wpr((12.5, -3.0, 600.0), 10.0, -20.0, 30.0)


def test_every_convention_writes_the_same_pose():
    x, y, z = POSE.translation_mm.tolist()
    position_m, vector = POSE.to_ur_rotation_vector()
    texts = {
        "fanuc": "12.5, -3, 600, 10, -20, 30",
        "kuka": f"[12.5 -3 600 {' '.join(map(str, POSE.to_kuka_abc()))}]",
        "abb": f"{x};{y};{z};{';'.join(map(str, POSE.to_abb_quaternion()))}",
        "ur": ",".join(map(str, [*position_m, *vector])),
        "rotation_vector": ",".join(map(str, [x, y, z, *vector])),
        "quaternion_wxyz": ",".join(map(str, [x, y, z, *POSE.to_abb_quaternion()])),
        "quaternion_xyzw": ",".join(map(str, [x, y, z, *np.roll(POSE.to_abb_quaternion(), -1)])),
        "matrix": " ".join(map(str, POSE.to_matrix().ravel())),
        "halcon": ",".join(map(str, [*position_m, 10, -20, 30, 2])),
    }
    assert texts.keys() == set(get_args(PoseNotation))
    for convention, text in texts.items():
        matrix = parse_pose(convention, text).to_matrix()
        np.testing.assert_allclose(matrix, POSE.to_matrix(), atol=1e-9)


@pytest.mark.parametrize(
    ("notation", "angles", "expected"),
    [
        ("fanuc", (10, -20, 130), Rotation.from_euler("xyz", (10, -20, 130), degrees=True)),
        ("kuka", (130, -20, 10), Rotation.from_euler("ZYX", (130, -20, 10), degrees=True)),
        ("quaternion_wxyz", (0.5, 0.1, -0.7, 0.5), Rotation.from_quat((0.1, -0.7, 0.5, 0.5))),
        ("quaternion_xyzw", (0.1, -0.7, 0.5, 0.5), Rotation.from_quat((0.1, -0.7, 0.5, 0.5))),
        ("rotation_vector", (0.3, -2.0, 1.0), Rotation.from_rotvec((0.3, -2.0, 1.0))),
    ],
)
def test_a_notation_means_what_scipy_means_by_it(notation, angles, expected):
    pose = pose_from_numbers(notation, (1.0, 2.0, 3.0, *angles))
    assert pose.rotation == pytest.approx(expected.as_matrix(), abs=1e-12)
    assert pose.translation_mm.tolist() == [1.0, 2.0, 3.0]


@pytest.mark.parametrize(
    ("convention", "text", "message"),
    [
        ("fanux", "0,0,0,0,0,0", "got 'fanux'; did you mean 'fanuc'"),
        ("abb", "0,0,0,0,0,0", "needs 7 numbers x_mm,y_mm,z_mm,q1.* got 6 numbers"),
        ("ur", "0,0,0,0,0,zero", "needs 6 numbers x_m,y_m"),
        ("quaternion_xyzw", "0,0,0,0,0,0,2", "must have norm 1, got 2"),
        ("matrix", "1,0,0,0,1,0,0,0,1", "needs 12 or 16 numbers r11,r12,r13,x_mm.* got 9"),
    ],
)
def test_what_is_no_pose_of_a_robot(convention, text, message):
    with pytest.raises(PoseError, match=message):
        parse_pose(convention, text)


def test_a_matrix_is_read_from_a_file(tmp_path):
    path = tmp_path / "pose.txt"
    np.savetxt(path, POSE.to_matrix())
    np.testing.assert_allclose(read_pose(path).to_matrix(), POSE.to_matrix(), atol=1e-9)
    path.write_text("1 2 3")
    with pytest.raises(PoseError, match=r"pose\.txt: a pose needs 16 numbers.*got 3 numbers"):
        read_pose(path)
    np.savetxt(path, 2 * POSE.to_matrix())
    with pytest.raises(PoseError, match=r"pose\.txt: "):
        read_pose(path)
    with pytest.raises(MissingFileError):
        read_pose(tmp_path / "none.txt")


@pytest.mark.parametrize("notation", ["ur", "rotation_vector"])
def test_a_rotation_vector_in_degrees_is_refused(notation):
    with pytest.raises(PoseError, match="length 36 turns by more than 2π; it is in radians"):
        pose_from_numbers(notation, [0.0, 0.0, 0.5, 0.0, 36.0, 0.0])
