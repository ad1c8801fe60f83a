import pytest

from exposight.geometry import RigidTransform, camera_from_held_part, camera_from_part_of

BASE_FROM_FLANGE = RigidTransform.from_kuka_abc((900, -250, 1100), 30, 12, 171)
FLANGE_FROM_CAMERA = RigidTransform.from_fanuc_wpr((40, -75, 120), 3, -5, 88)
CAMERA_FROM_PART = RigidTransform.from_fanuc_wpr((4, -3, 500), 180, 8, 0)


def test_the_chain_gives_the_part_seen_from_the_camera():
    base_from_part = BASE_FROM_FLANGE @ FLANGE_FROM_CAMERA @ CAMERA_FROM_PART
    pose = camera_from_part_of(
        base_from_flange=BASE_FROM_FLANGE,
        flange_from_camera=FLANGE_FROM_CAMERA,
        base_from_part=base_from_part,
    )
    assert pose.to_matrix() == pytest.approx(CAMERA_FROM_PART.to_matrix(), abs=1e-9)


def test_and_of_a_fixed_camera_that_looks_at_what_the_robot_holds():
    flange_from_part = RigidTransform.from_fanuc_wpr((0, 10, 90), 1, 2, 3)
    base_from_camera = BASE_FROM_FLANGE @ flange_from_part @ CAMERA_FROM_PART.inverse()
    pose = camera_from_held_part(
        base_from_flange=BASE_FROM_FLANGE,
        base_from_camera=base_from_camera,
        flange_from_part=flange_from_part,
    )
    assert pose.to_matrix() == pytest.approx(CAMERA_FROM_PART.to_matrix(), abs=1e-9)
