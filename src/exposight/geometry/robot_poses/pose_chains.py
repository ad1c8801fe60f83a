"""The chain of base, flange, camera and part, and what else its numbers may mean."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from exposight.geometry.poses import RigidTransform

_UNITS = {"m": 1000.0, "cm": 10.0, "inches": 25.4, "µm": 0.001}
_SAME = 1e-9


def other_poses(pose: RigidTransform) -> Iterator[tuple[str, RigidTransform]]:
    """Yield other readings of a pose, each with its words, the usual ones first.

    The inverse, a translation in another unit, a quaternion in the other order, angles of KUKA read
    as Fanuc's or the reverse, radians read as degrees, and a transposed rotation.

    Parameters
    ----------
    pose : RigidTransform
        As it was read.

    Yields
    ------
    (str, RigidTransform)
        What the pose would be, to be followed by a question mark, and the pose it would be.
    """
    yield "the inverse of the pose", pose.inverse()
    for unit, scale in _UNITS.items():
        words = f"the pose with its translation in {unit}"
        yield words, replace(pose, translation_mm=scale * pose.translation_mm)
    for words, rotation in _other_rotations(pose.rotation):
        if np.abs(rotation - pose.rotation).max() > _SAME:
            yield words, replace(pose, rotation=rotation)


def _other_rotations(
    rotation: np.ndarray[tuple[int, ...], np.dtype[np.float64]],
) -> Iterator[tuple[str, np.ndarray[tuple[int, ...], np.dtype[np.float64]]]]:
    w, x, y, z = Rotation.from_matrix(rotation).as_quat(scalar_first=True)
    for order in ((z, w, x, y), (x, y, z, w)):
        turned = Rotation.from_quat(order, scalar_first=True).as_matrix()
        yield "the quaternion in the other order", turned
    angles = RigidTransform(rotation=rotation).to_fanuc_wpr()
    swapped = Rotation.from_euler("xyz", angles[::-1], degrees=True).as_matrix()
    yield "the angles in the other order (A B C of a KUKA, w p r of a Fanuc)", swapped
    if max(map(abs, angles)) <= 2 * np.pi:
        yield "the angles in rad", Rotation.from_euler("xyz", angles).as_matrix()
    yield "the rotation transposed", rotation.T


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
