"""The notations of poses, each a fixed row of numbers, and poses of a known notation in a text."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Literal, get_args

import numpy as np

from exposight.errors import PoseError, did_you_mean
from exposight.files import current_reading
from exposight.geometry.poses import RigidTransform
from exposight.geometry.robot_poses.pose_matrices import halcon_tuple, matrix_pose
from exposight.geometry.robot_poses.pose_numbers import number_rows
from exposight.geometry.robot_poses.pose_units import (
    UNIT_MM,
    angle_remark,
    degrees_of,
    metres_of,
    radians_of,
    vector_radians,
)
from exposight.geometry.robot_poses.printed_poses import (
    WrittenPose,
    abb_pairs,
    printed_poses,
    ur_pose,
)

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
