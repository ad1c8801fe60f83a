"""Poses written as matrices or as plain numbers, whose count and form tell what they are."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from exposight.errors import AmbiguousError, PoseError
from exposight.files import ambiguous, current_reading
from exposight.geometry.poses import ROTATION_TOLERANCE, RigidTransform
from exposight.geometry.robot_poses.pose_units import UNIT_MM
from exposight.geometry.robot_poses.printed_poses import WrittenPose, halcon_pose

_FEWEST_DECIMALS = 3
_NEARER_MM = 10.0


def matrix_pose(matrix: ArrayLike, source: str | Path) -> WrittenPose:
    """Return the pose of a 4×4 or 3×4 matrix, also of a transposed 4×4.

    A rotation printed with few decimals is made exact. The translation is in mm, unless
    `Reading.unit` says otherwise.

    Raises
    ------
    PoseError
        If it is neither; the message names the file.
    """
    array = np.asarray(matrix, dtype=np.float64)
    form = f"{array.shape[0]}×{array.shape[-1]} matrix" if array.ndim == 2 else "matrix"
    remark = ""
    last = np.array([0.0, 0.0, 0.0, 1.0])
    if array.shape == (4, 4) and np.allclose(array[:, 3], last) and not np.allclose(array[3], last):
        array, remark = array.T, "written column by column (transposed)"
    unit = current_reading().unit or "mm"
    try:
        if array.shape in {(4, 4), (3, 4)}:
            array = array.copy()
            array[:3, :3] = _unrounded(array[:3, :3])
            if unit == "m" and float(np.abs(array[:3, 3]).max()) > _NEARER_MM:
                unit = "mm"  # the answer is about another file: nothing is so many metres away
            array[:3, 3] *= UNIT_MM[unit]
        pose = RigidTransform.from_matrix(array)
    except PoseError as error:
        msg = f"{source}: {error}"
        raise PoseError(msg) from error
    return WrittenPose(pose=pose, notation="matrix", form=f"{form}, {unit}", remark=remark)


def _unrounded(rotation: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the rotation nearest to one that was printed with three decimals or more."""
    deviation = float(np.abs(rotation.T @ rotation - np.eye(3)).max())
    if not ROTATION_TOLERANCE < deviation < 5.0 * 10.0**-_FEWEST_DECIMALS:
        return rotation
    for decimals in range(_FEWEST_DECIMALS, 7):
        if np.abs(rotation - rotation.round(decimals)).max() < 1e-9:
            # Two columns of three entries each, every one off by half a unit at most.
            if deviation > 3.0 * 10.0**-decimals or np.linalg.det(rotation) < 0:
                return rotation
            u, _, vt = np.linalg.svd(rotation)
            return np.asarray(u @ vt)
    return rotation


def check_length_unit(pose: RigidTransform, source: str | Path, what: str) -> None:
    """Ask for the unit of a pose whose translation, read as mm, is hardly longer than nothing.

    Raises
    ------
    AmbiguousError
        If it is below 10 mm, and nobody said in which unit it is.
    """
    longest = float(np.abs(pose.translation_mm).max())
    if current_reading().unit is None and 0.0 < longest < _NEARER_MM:
        raise ambiguous(
            source,
            f"is {what}'s translation, {longest:g} at most, in mm or in m?",
            "unit",
            {"m": f"{longest * 1000:g} mm", "mm": f"{longest:g} mm"},
        )


def plain_poses(
    rows: Sequence[tuple[str, Sequence[float]]], source: str | Path
) -> list[WrittenPose]:
    """Return the poses of lines of numbers without letters.

    Matrices of 4 or 3 lines, one a line (12 or 16 numbers), lines of 8 numbers as trajectories
    have them (time, x, y, z in m, qx, qy, qz, qw), and 7 with a quaternion whose order is asked
    for.

    Raises
    ------
    PoseError
        If the counts are those of no pose.
    AmbiguousError
        If the numbers may be those of several robots or orders.
    """
    counts = {len(numbers) for _, numbers in rows}
    every = [number for _, numbers in rows for number in numbers]
    if counts == {4} and len(rows) % 4 == 0 and len(rows) >= 4:
        stacked = np.reshape(every, (-1, 4, 4))
        return [matrix_pose(matrix, source) for matrix in stacked]
    if counts == {4} and len(rows) == 3:
        return [matrix_pose(np.reshape(every, (3, 4)), source)]
    if len(counts) == 1 and counts <= {12, 16}:
        return [_named(matrix_pose(np.reshape(n, (-1, 4)), source), name) for name, n in rows]
    if counts == {8}:
        times = [numbers[0] for _, numbers in rows]
        stamps = any(time > _STAMP or not float(time).is_integer() for time in times)
        return [_of_trajectory(numbers, source, stamps=stamps) for _, numbers in rows]
    if counts == {7}:
        return [_named(_of_seven(numbers, source), name) for name, numbers in rows]
    if counts == {6}:
        raise _six(source)
    if len(every) in {12, 16}:
        return [matrix_pose(np.reshape(every, (-1, 4)), source)]
    if len(every) == 7:
        return [_of_seven(every, source)]
    if len(every) == 6:
        raise _six(source)
    spelled = ", ".join(map(str, sorted(counts))) if len(rows) > 1 else str(len(every))
    msg = (
        f"{source}: a pose needs 16 numbers, a 4×4 matrix row by row, in mm (or 12; or 6 or 7 in a "
        f"robot's notation); got {spelled} numbers" + (" a line" if len(rows) > 1 else "")
    )
    raise PoseError(msg)


def _named(pose: WrittenPose, name: str) -> WrittenPose:
    return WrittenPose(**{**vars(pose), "name": name})


def _six(source: str | Path) -> Exception:
    msg = (
        f"{source}: six numbers without letters: x y z and angles of which robot? Fanuc (w p r), "
        "KUKA (A B C), UR (m, rotation vector in rad) and others mean different poses by them: say "
        "so by --robot-pose fanuc NUMBERS|FILE (kuka, ur, rotation_vector)"
    )
    return AmbiguousError(msg, ("fanuc", "kuka", "ur", "rotation_vector"))


def quaternion_pose(
    position: Sequence[float],
    quaternion: Sequence[float],
    source: str | Path,
    *,
    order: str | None = None,
    unit: str | None = None,
) -> WrittenPose:
    """Return the pose of a position and a quaternion.

    Parameters
    ----------
    position : (3,) sequence of float
    quaternion : (4,) sequence of float
    source : str or Path
        For messages.
    order : {'wxyz', 'xyzw'}, optional
        What the source says of it; asked for where it is None.
    unit : {'mm', 'm', …}, optional
        The same of the position's unit; mm where it is None and that is a length at all.

    Raises
    ------
    AmbiguousError
        If order or unit is not known.
    PoseError
        If the quaternion is none.
    """
    reading = current_reading()
    norm = float(np.linalg.norm(quaternion))
    if abs(norm - 1.0) > 1e-3:
        msg = f"{source}: a quaternion must have norm 1, got {norm:.6g}"
        raise PoseError(msg)
    order = order or reading.quaternion
    if order is None:
        spelled = " ".join(f"{number:g}" for number in quaternion)
        raise ambiguous(
            source,
            f"in which order is the quaternion {spelled}?",
            "quaternion",
            {"wxyz": "scalar part first", "xyzw": "scalar part last"},
        )
    unit = unit or reading.unit
    longest = float(np.abs(position).max())
    if unit is None and 0.0 < longest < _NEARER_MM:
        raise ambiguous(
            source,
            f"is the position, {longest:g} at most, in mm or in m?",
            "unit",
            {"m": f"{longest * 1000:g} mm", "mm": f"{longest:g} mm"},
        )
    unit = unit or "mm"
    if unit == "m" and longest > _NEARER_MM and reading.unit is None:
        msg = (
            f"{source}: such poses have their position in m, and {longest:g} m is out of any "
            "sensor's reach: if it is in mm, say so: --read-as unit=mm"
        )
        raise AmbiguousError(msg, ("unit=mm",))
    if unit == "m" and reading.unit == "mm":
        unit = "mm"
    position_mm = UNIT_MM[unit] * np.asarray(position, dtype=np.float64)
    wxyz = quaternion if order == "wxyz" else [quaternion[3], *quaternion[:3]]
    return WrittenPose(
        pose=RigidTransform.from_abb_quaternion(position_mm, wxyz),
        notation=f"quaternion_{order}",
        form=f"position in {unit}, quaternion {order}",
    )


def _of_seven(numbers: Sequence[float], source: str | Path) -> WrittenPose:
    norm = float(np.linalg.norm(numbers[3:]))
    is_code = float(numbers[6]).is_integer() and 0 <= numbers[6] <= 13
    if abs(norm - 1.0) > 1e-3 and is_code:
        msg = (
            f"{source}: seven numbers whose last four are no quaternion: if they are a HALCON pose "
            '(x y z in m, three angles, type), say so: --robot-pose halcon "…"'
        )
        raise AmbiguousError(msg, ("halcon",))
    return quaternion_pose(numbers[:3], numbers[3:], source)


_STAMP = 1e6
"""Seconds since 1970 are far above, numbers of lines below."""


def _of_trajectory(numbers: Sequence[float], source: str | Path, *, stamps: bool) -> WrittenPose:
    pose = quaternion_pose(
        numbers[1:4],
        numbers[4:],
        source,
        order="xyzw" if stamps and current_reading().quaternion is None else None,
        unit="m" if stamps else None,
    )
    name = f"{numbers[0]:.9f}".rstrip("0").rstrip(".")
    form = "trajectory: time, x y z in m, qx qy qz qw" if stamps else f"number, {pose.form}"
    return WrittenPose(**{**vars(pose), "name": name, "form": form})


def halcon_tuple(numbers: Sequence[float]) -> RigidTransform:
    """Return the pose of seven numbers of a HALCON tuple."""
    return halcon_pose(numbers[:3], numbers[3:6], numbers[6]).pose
