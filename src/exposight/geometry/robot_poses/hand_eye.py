"""The chain that robot cells have: base, flange, camera, part."""

from collections.abc import Callable, Iterator, Mapping

from exposight.geometry.poses import RigidTransform
from exposight.geometry.robot_poses.pose_readings import other_poses


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


def other_chains(
    chain: Callable[..., RigidTransform], links: Mapping[str, RigidTransform]
) -> Iterator[tuple[str, RigidTransform]]:
    """Yield what comes of a chain if one of its links is another reading of its numbers.

    Parameters
    ----------
    chain : callable
        `camera_from_part_of` or `camera_from_held_part`.
    links : mapping of str to RigidTransform
        Its arguments.

    Yields
    ------
    (str, RigidTransform)
        Words such as "the inverse of flange_from_camera", and camera_from_part.
    """
    for name, link in links.items():
        for words, other in other_poses(link):
            said = words.replace("the pose", name) if "the pose" in words else f"{words} in {name}"
            yield said, chain(**{**links, name: other})
    first, *_, last = links
    for one, two in ((list(links)[1], last), (first, list(links)[1])):
        both = {one: links[one].inverse(), two: links[two].inverse()}
        yield f"the inverses of {one} and {two}", chain(**{**links, **both})
