"""Poses as robots and text files write them."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Literal, get_args

import numpy as np

from exposight.errors import MissingFileError, PoseError, did_you_mean
from exposight.geometry.poses import RigidTransform

PoseNotation = Literal[
    "fanuc", "kuka", "abb", "ur", "quaternion_wxyz", "quaternion_xyzw", "rotation_vector", "matrix"
]
"""Ways to write a pose; ``docs/conventions.md`` says what each one means."""


@dataclass(frozen=True)
class _Reader:
    columns: tuple[str, ...]
    read: Callable[[list[float]], RigidTransform]


def _radians(vector: list[float]) -> list[float]:
    """Return a rotation vector that turns by one full turn at most."""
    turn = math.hypot(*vector)
    if turn > 2.0 * math.pi + 1e-6:
        msg = (
            f"a rotation vector of length {turn:g} turns by more than 2π; it is in radians: "
            "multiply degrees by π/180"
        )
        raise PoseError(msg)
    return vector


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
            lambda n: RigidTransform.from_ur_rotation_vector(n[:3], _radians(n[3:])),
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
            lambda n: RigidTransform.from_rotation_vector(n[:3], _radians(n[3:])),
        ),
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


def parse_pose(notation: str, text: str) -> RigidTransform:
    """Read a pose as a robot writes it.

    Parameters
    ----------
    notation : str
        One of `PoseNotation`.
    text : str
        The pose's numbers, separated by commas or blanks; see `pose_from_numbers`.

    Raises
    ------
    PoseError
        As for `pose_from_numbers`, and if one is not a number.
    """
    reader = _reader_of(notation)
    numbers = _numbers(text)
    if numbers is None:
        msg = f"{_needed(notation, reader)}, got '{text}'"
        raise PoseError(msg)
    return pose_from_numbers(notation, numbers)


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
