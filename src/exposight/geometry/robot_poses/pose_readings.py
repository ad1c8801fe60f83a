"""What else the numbers of a pose may mean: the mistakes that people make with poses."""

from collections.abc import Iterator
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
