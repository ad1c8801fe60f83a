import numpy as np
import pytest

from exposight.contradictions.part_views import out_of_reach, out_of_view
from exposight.geometry import RigidTransform, camera_from_part_of, other_chains, other_poses

POSE = RigidTransform.from_fanuc_wpr((4, -3, 500), 172, 8, 31)


def _close(one, other):
    return np.abs(one.to_matrix() - other.to_matrix()).max() < 1e-6


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        (POSE.inverse(), "the inverse of the pose"),
        (
            RigidTransform(rotation=POSE.rotation, translation_mm=POSE.translation_mm / 1000),
            "the pose with its translation in m",
        ),
        (
            RigidTransform.from_abb_quaternion(
                POSE.translation_mm, np.roll(POSE.to_abb_quaternion(), -1)
            ),
            "the quaternion in the other order",
        ),
        (
            RigidTransform.from_abb_quaternion(
                POSE.translation_mm, np.roll(POSE.to_abb_quaternion(), 1)
            ),
            "the quaternion in the other order",
        ),
        (RigidTransform.from_kuka_abc((4, -3, 500), 172, 8, 31), "the angles in the other order"),
        (
            RigidTransform.from_fanuc_wpr((4, -3, 500), *np.radians((172, 8, 31))),
            "the angles in rad",
        ),
        (
            RigidTransform(rotation=POSE.rotation.T, translation_mm=POSE.translation_mm),
            "the rotation transposed",
        ),
    ],
)
def test_the_reading_that_was_meant_is_among_the_others(wrong, words):
    found = [said for said, other in other_poses(wrong) if _close(other, POSE)]
    assert any(said.startswith(words) for said in found)


def test_links_of_a_chain_are_tried_one_by_one():
    links = {
        "base_from_flange": RigidTransform.from_kuka_abc((900, -250, 1100), 30, 12, 171),
        "flange_from_camera": RigidTransform.from_fanuc_wpr((40, -75, 120), 3, -5, 88),
    }
    links["base_from_part"] = links["base_from_flange"] @ links["flange_from_camera"] @ POSE
    wrong = {**links, "flange_from_camera": links["flange_from_camera"].inverse()}
    found = [said for said, pose in other_chains(camera_from_part_of, wrong) if _close(pose, POSE)]
    assert found == ["the inverse of flange_from_camera"]


def test_what_is_out_of_view_or_reach_is_named_with_the_reading():
    assert out_of_view({"visible": 1, "out of frame": 3}, ["the inverse"]) is None
    assert out_of_view({"facing away": 4}, []) is None
    found = out_of_view({"facing away": 4}, ["the inverse of the pose"], view="P1")
    assert "in view 'P1' no feature is visible (4 facing away)" in str(found)
    far = np.array([5000.0, 5100.0])
    assert out_of_reach(np.array([500.0]), (400.0, 800.0), []) is None
    assert out_of_reach(far, (400.0, 800.0), ["x"]).is_error
    assert not out_of_reach(far, (400.0, 800.0), []).is_error
