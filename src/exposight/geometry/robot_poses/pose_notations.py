"""Poses whose numbers have no names: notations, matrices, quaternions, and plain lines of them."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from types import MappingProxyType
from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from exposight.errors import AmbiguousError, PoseError, did_you_mean
from exposight.files import ambiguous, current_reading
from exposight.geometry.poses import ROTATION_TOLERANCE, RigidTransform
from exposight.geometry.robot_poses.pose_numbers import (
    UNIT_MM,
    angle_remark,
    degrees_of,
    metres_of,
    number_rows,
    radians_of,
    vector_radians,
)
from exposight.geometry.robot_poses.printed_poses import (
    WrittenPose,
    abb_pairs,
    halcon_pose,
    printed_poses,
    ur_pose,
)

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
    if current_reading().unit is None:
        _ask_unit(pose.translation_mm, source, f"{what}'s translation")


def _ask_unit(position: ArrayLike, source: str | Path, what: str) -> None:
    longest = float(np.abs(position).max())
    if 0.0 < longest < _NEARER_MM:
        raise ambiguous(
            source,
            f"is {what}, {longest:g} at most, in mm or in m?",
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
        return [replace(matrix_pose(np.reshape(n, (-1, 4)), source), name=name) for name, n in rows]
    if counts == {8}:
        times = [numbers[0] for _, numbers in rows]
        stamps = any(time > _STAMP or not float(time).is_integer() for time in times)
        return [_of_trajectory(numbers, source, stamps=stamps) for _, numbers in rows]
    if counts == {7}:
        return [replace(_of_seven(numbers, source), name=name) for name, numbers in rows]
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
    if unit is None:
        _ask_unit(position, source, "the position")
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
    return replace(pose, name=name, form=form)


def halcon_tuple(numbers: Sequence[float]) -> RigidTransform:
    """Return the pose of seven numbers of a HALCON tuple."""
    return halcon_pose(numbers[:3], numbers[3:6], numbers[6]).pose


PoseNotation = Literal[
    "fanuc",
    "kuka",
    "abb",
    "ur",
    "quaternion_wxyz",
    "quaternion_xyzw",
    "rotation_vector",
    "halcon",
    "matrix",
]
"""Ways to write a pose; ``docs/conventions.md`` says what each one means."""


@dataclass(frozen=True)
class _Reader:
    columns: tuple[str, ...]
    read: Callable[[list[float]], RigidTransform]


def _reader(columns: str, read: Callable[[list[float]], RigidTransform]) -> _Reader:
    return _Reader(tuple(columns.split()), read)


_READERS: Mapping[PoseNotation, _Reader] = MappingProxyType(
    {
        "fanuc": _reader(
            "x_mm y_mm z_mm w_deg p_deg r_deg",
            lambda n: RigidTransform.from_fanuc_wpr(n[:3], n[3], n[4], n[5]),
        ),
        "kuka": _reader(
            "x_mm y_mm z_mm a_deg b_deg c_deg",
            lambda n: RigidTransform.from_kuka_abc(n[:3], n[3], n[4], n[5]),
        ),
        "abb": _reader(
            "x_mm y_mm z_mm q1 q2 q3 q4",
            lambda n: RigidTransform.from_abb_quaternion(n[:3], n[3:]),
        ),
        "ur": _reader(
            "x_m y_m z_m rx_rad ry_rad rz_rad",
            ur_pose,
        ),
        "quaternion_wxyz": _reader(
            "x_mm y_mm z_mm qw qx qy qz",
            lambda n: RigidTransform.from_abb_quaternion(n[:3], n[3:]),
        ),
        "quaternion_xyzw": _reader(
            "x_mm y_mm z_mm qx qy qz qw",
            lambda n: RigidTransform.from_abb_quaternion(n[:3], [n[6], *n[3:6]]),
        ),
        "rotation_vector": _reader(
            "x_mm y_mm z_mm rx_rad ry_rad rz_rad",
            lambda n: RigidTransform.from_rotation_vector(n[:3], vector_radians(n[3:])),
        ),
        "halcon": _reader("x_m y_m z_m r1 r2 r3 type", halcon_tuple),
        "matrix": _reader(
            "r11 r12 r13 x_mm r21 r22 r23 y_mm r31 r32 r33 z_mm",
            lambda n: RigidTransform.from_matrix(np.reshape(n, (-1, 4))),
        ),
    }
)


def pose_columns(notation: str) -> tuple[str, ...]:
    """Return the names of a notation's numbers, with their units, in its order.

    Raises
    ------
    PoseError
        If there is no such `PoseNotation`.
    """
    return _reader_of(notation).columns


def pose_from_numbers(notation: str, numbers: Sequence[float]) -> RigidTransform:
    """Return the pose that numbers in some notation mean.

    Parameters
    ----------
    notation : str
        One of `PoseNotation`.
    numbers : sequence of float
        As many as `pose_columns` names, in that order and those units; a matrix may have its last
        row too, 16 numbers.

    Raises
    ------
    PoseError
        If the notation is unknown, the count of numbers is wrong, or they are no pose.
    """
    reader = _reader_of(notation)
    if len(numbers) != len(reader.columns) and (notation, len(numbers)) != ("matrix", 16):
        msg = f"{_needed(notation, reader)}, got {len(numbers)} numbers"
        raise PoseError(msg)
    return reader.read(list(numbers))


def poses_of_notation(notation: str, text: str, source: str | Path) -> list[WrittenPose]:
    """Return the poses in a text whose notation is known.

    Raises
    ------
    PoseError
        As for `pose_from_numbers`, and if the text is of another notation.
    AmbiguousError
        If two readings fit equally well.
    """
    reader = _reader_of(notation)
    printed = printed_poses(text, source) or (abb_pairs(text) if notation == "abb" else [])
    if printed:
        others = {pose.notation for pose in printed} - {_SAME.get(notation, notation)}
        if others:
            msg = f"{source}: expected a {notation} pose, got a {printed[0].form} ({text.strip()})"
            raise PoseError(msg)
        return printed
    needed = {12, 16} if notation == "matrix" else {len(reader.columns)}
    ways = number_rows(text)
    for rows in ways:
        every = [number for _, numbers in rows for number in numbers]
        if all(len(numbers) in needed for _, numbers in rows):
            return [_written(notation, numbers, name, source) for name, numbers in rows]
        if len(every) in needed:
            return [_written(notation, every, "", source)]
    if not ways:
        msg = f"{_needed(notation, reader)}, got '{text}'"
        raise PoseError(msg)
    count = sum(len(numbers) for _, numbers in ways[0])
    msg = f"{_needed(notation, reader)}, got {count} numbers"
    raise PoseError(msg)


_SAME = {"quaternion_wxyz": "abb"}
"""Notations whose printed forms are another's."""


def _written(notation: str, numbers: Sequence[float], name: str, source: str | Path) -> WrittenPose:
    if notation == "matrix":
        return matrix_pose(np.reshape(numbers, (-1, 4)), source)
    position, turn = list(numbers[:3]), list(numbers[3:])
    remark, unit = "", current_reading().unit
    if notation in {"ur", "halcon"}:
        position = metres_of(position)
    elif notation not in _IN_MM and unit is not None:
        position = [UNIT_MM[unit] * number for number in position]
    if notation in {"fanuc", "kuka"}:
        remark, turn = angle_remark(turn), degrees_of(turn)
    elif notation in {"ur", "rotation_vector"}:
        turn = radians_of(turn)
    pose = pose_from_numbers(notation, [*position, *turn])
    return WrittenPose(
        pose=pose, notation=notation, name=name, form=f"{notation} pose", remark=remark
    )


_IN_MM = {"fanuc", "kuka", "abb"}


def _reader_of(notation: str) -> _Reader:
    for known, reader in _READERS.items():
        if notation == known:
            return reader
    *others, last = names = get_args(PoseNotation)
    msg = f"the notation of a pose must be {', '.join(others)} or {last}, got '{notation}'"
    raise PoseError(msg + did_you_mean(notation, names))


def _needed(notation: str, reader: _Reader) -> str:
    count = "12 or 16" if notation == "matrix" else f"{len(reader.columns)}"
    return f"a {notation} pose needs {count} numbers {','.join(reader.columns)}"
