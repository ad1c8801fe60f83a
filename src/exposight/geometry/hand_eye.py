"""The chain that robot cells have: base, flange, camera, part."""

from exposight.geometry.poses import RigidTransform


def camera_from_part_of(
    *,
    base_from_flange: RigidTransform,
    flange_from_camera: RigidTransform,
    base_from_part: RigidTransform,
) -> RigidTransform:
    """Return where a part stands for a camera that a robot carries (eye in hand).

    Parameters
    ----------
    base_from_flange : RigidTransform
        The robot's pose: its flange in its base, as the controller shows it with neither tool nor
        user frame.
    flange_from_camera : RigidTransform
        The hand–eye calibration: the camera on the flange.
    base_from_part : RigidTransform
        The part in the robot's base.
    """
    return (base_from_flange @ flange_from_camera).inverse() @ base_from_part


def camera_from_held_part(
    *,
    base_from_flange: RigidTransform,
    base_from_camera: RigidTransform,
    flange_from_part: RigidTransform,
) -> RigidTransform:
    """Return where a part that a robot carries stands for a fixed camera (eye to hand).

    Parameters
    ----------
    base_from_flange : RigidTransform
        The robot's pose.
    base_from_camera : RigidTransform
        The calibration: the camera in the robot's base.
    flange_from_part : RigidTransform
        The part on the flange.
    """
    return base_from_camera.inverse() @ base_from_flange @ flange_from_part
