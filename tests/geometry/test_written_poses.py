import numpy as np
import pytest

from exposight.errors import MissingFileError, PoseError
from exposight.geometry import RigidTransform, parse_pose, read_pose

POSE = RigidTransform.from_fanuc_wpr((12.5, -3.0, 600.0), 10.0, -20.0, 30.0)


def test_every_convention_writes_the_same_pose():
    x, y, z = POSE.translation_mm.tolist()
    position_m, vector = POSE.to_ur_rotation_vector()
    texts = {
        "fanuc": "12.5, -3, 600, 10, -20, 30",
        "kuka": f"[12.5 -3 600 {' '.join(map(str, POSE.to_kuka_abc()))}]",
        "abb": f"{x};{y};{z};{';'.join(map(str, POSE.to_abb_quaternion()))}",
        "ur": ",".join(map(str, [*position_m, *vector])),
    }
    for convention, text in texts.items():
        matrix = parse_pose(convention, text).to_matrix()
        np.testing.assert_allclose(matrix, POSE.to_matrix(), atol=1e-9)


@pytest.mark.parametrize(
    ("convention", "text", "message"),
    [
        ("fanux", "0,0,0,0,0,0", "got 'fanux'; did you mean 'fanuc'"),
        ("abb", "0,0,0,0,0,0", "needs 7 numbers x,y,z,q1"),
        ("ur", "0,0,0,0,0,zero", "needs 6 numbers"),
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
