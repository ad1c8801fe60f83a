"""Poses as robots and text files write them."""

from collections.abc import Callable, Mapping
from pathlib import Path
from types import MappingProxyType

import numpy as np

from exposight.errors import MissingFileError, PoseError, did_you_mean
from exposight.geometry.poses import RigidTransform

POSE_CONVENTIONS: Mapping[str, tuple[str, Callable[[list[float]], RigidTransform]]] = (
    MappingProxyType(
        {
            "fanuc": (
                "x,y,z,w,p,r in mm and degrees",
                lambda n: RigidTransform.from_fanuc_wpr(n[:3], n[3], n[4], n[5]),
            ),
            "kuka": (
                "x,y,z,A,B,C in mm and degrees",
                lambda n: RigidTransform.from_kuka_abc(n[:3], n[3], n[4], n[5]),
            ),
            "abb": (
                "x,y,z,q1,q2,q3,q4 in mm, scalar part first",
                lambda n: RigidTransform.from_abb_quaternion(n[:3], n[3:]),
            ),
            "ur": (
                "x,y,z,rx,ry,rz in m and rad",
                lambda n: RigidTransform.from_ur_rotation_vector(n[:3], n[3:]),
            ),
        }
    )
)
"""Robots' ways to write a pose: which numbers, in which units, and how they are read."""


def parse_pose(convention: str, text: str) -> RigidTransform:
    """Read a pose as a robot writes it.

    Parameters
    ----------
    convention : str
        A key of `POSE_CONVENTIONS`.
    text : str
        The pose's numbers, separated by commas or blanks.

    Raises
    ------
    PoseError
        If the convention is unknown, the count of numbers is wrong, or one is not a number.
    """
    if convention not in POSE_CONVENTIONS:
        *others, last = POSE_CONVENTIONS
        msg = f"poses are written as by {', '.join(others)} or {last}, got '{convention}'"
        msg += did_you_mean(convention, POSE_CONVENTIONS)
        raise PoseError(msg)
    expected, read = POSE_CONVENTIONS[convention]
    count = expected.split(" ", 1)[0].count(",") + 1
    numbers = _numbers(text)
    if numbers is None or len(numbers) != count:
        msg = f"a {convention} pose needs {count} numbers {expected}, got '{text}'"
        raise PoseError(msg)
    return read(numbers)


def read_pose(path: Path) -> RigidTransform:
    """Read a pose from a text file: 16 numbers, a 4×4 matrix row by row, translation in mm.

    Raises
    ------
    MissingFileError
        If there is no such file.
    PoseError
        If it does not hold 16 numbers, or they are no pose.
    """
    path = Path(path)
    if not path.is_file():
        msg = f"{path}: no such pose file; expected 16 numbers, a 4×4 matrix row by row, in mm"
        raise MissingFileError(msg)
    numbers = _numbers(path.read_text(encoding="utf-8", errors="replace"))
    if numbers is None or len(numbers) != 16:
        got = "something else" if numbers is None else f"{len(numbers)} numbers"
        msg = f"{path}: a pose needs 16 numbers, a 4×4 matrix row by row, in mm; got {got}"
        raise PoseError(msg)
    try:
        return RigidTransform.from_matrix(np.reshape(numbers, (4, 4)))
    except PoseError as error:
        msg = f"{path}: {error}"
        raise PoseError(msg) from error


def _numbers(text: str) -> list[float] | None:
    """Return numbers between commas, semicolons, brackets or blanks; None if one is none."""
    try:
        return [float(word) for word in text.translate(str.maketrans("[],;", "    ")).split()]
    except ValueError:
        return None
