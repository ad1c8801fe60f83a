"""Poses in JSON and YAML: Zivid's matrices, ROS messages, OpenCV's, and named numbers."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from exposight.errors import PoseError
from exposight.files import current_reading
from exposight.geometry.poses import RigidTransform
from exposight.geometry.robot_poses.pose_notations import (
    check_length_unit,
    matrix_pose,
    quaternion_pose,
)
from exposight.geometry.robot_poses.pose_numbers import UNIT_MM
from exposight.geometry.robot_poses.pose_tables import named_numbers_pose
from exposight.geometry.robot_poses.printed_poses import WrittenPose, printed_poses

_POSITIONS = ("position", "translation", "trans", "t", "tvec", "xyz", "location", "origin")
_ORIENTATIONS = ("orientation", "rotation", "quaternion", "quat", "q", "rot", "r")
_ROTATION_MATRICES = ("rotation_matrix", "rotationmatrix", "rmat", "rotation", "r", "rot")
_VECTORS = ("rotation_vector", "rotvec", "rvec", "axis_angle", "rotationvector")
_TURNS = ("orientation", "rotation", "quaternion", "rotation_matrix", "rotation_vector", "rotvec")
"""Names of a rotation that nothing else has."""
_NAMES = ("name", "view", "id", "label", "child_frame_id", "pose_name", "image")
_ORDERED = {"wxyz": ("w", "x", "y", "z"), "xyzw": ("x", "y", "z", "w")}
_DEEPEST = 12


def document_poses(data: object, source: str | Path, unit: str | None = None) -> list[WrittenPose]:
    """Return the poses in the data of a JSON or YAML document; none where there are none.

    Lengths are in `unit`, if the document says it.

    Raises
    ------
    PoseError, AmbiguousError
        If something is a pose by its form, and none by its numbers, or two readings fit.
    """
    found: list[WrittenPose] = []
    _collect(data, "", source, unit, found, 0)
    return found


def _collect(
    data: object,
    name: str,
    source: str | Path,
    unit: str | None,
    found: list[WrittenPose],
    depth: int,
) -> None:
    if depth > _DEEPEST:
        return
    if isinstance(data, str):
        found.extend(_renamed(each, name) for each in printed_poses(data, source))
        return
    place = f"{source}: {name}" if name else str(source)
    matrix = _matrix(data)
    if matrix is None and _is_broken_matrix(data):
        msg = f"{place}: a matrix of 4×4 or 3×4 numbers is expected, and some are none or missing"
        raise PoseError(msg)
    if matrix is not None:
        pose = _scaled(matrix_pose(matrix, place), unit)
        form = f"{pose.form}, from a document" if depth else pose.form
        found.append(_renamed(replace(pose, form=form), name))
        return
    if isinstance(data, Mapping):
        table = {str(key).lower(): value for key, value in data.items()}
        unit = _unit_of(table) or unit
        own = next((str(table[key]) for key in _NAMES if isinstance(table.get(key), str | int)), "")
        itself = _of_mapping(table, place, unit)
        if itself is not None:
            found.append(_renamed(itself, own or name))
            return
        before = len(found)
        inner = [(str(key), value) for key, value in data.items()]
        for key, value in inner:
            wraps = key.lower() in _WRAPPERS
            _collect(value, (own or name) if wraps else key, source, unit, found, depth + 1)
        if own and len(found) == before + 1:
            found[before] = _renamed(found[before], own)
    elif isinstance(data, list | tuple):
        for value in data:
            _collect(value, name if len(data) == 1 else "", source, unit, found, depth + 1)


_WRAPPERS = frozenset(
    {
        *("pose", "poses", "transform", "transforms", "matrix", "data", "floatmatrix", "views"),
        *("transformation", "t", "camera_from_part", "flange", "robot_pose", "value"),
    }
)


def _renamed(pose: WrittenPose, name: str) -> WrittenPose:
    return pose if pose.name else replace(pose, name=name)


def _scaled(pose: WrittenPose, unit: str | None) -> WrittenPose:
    if unit in {None, "mm"} or current_reading().unit is not None:
        return pose
    scaled = RigidTransform(
        rotation=pose.pose.rotation, translation_mm=UNIT_MM[str(unit)] * pose.pose.translation_mm
    )
    form = pose.form.replace(", mm", f", {unit}")
    return replace(pose, pose=scaled, form=form)


def _unit_of(table: Mapping[str, object]) -> str | None:
    for key in ("unit", "units", "length_unit", "translation_unit"):
        said = table.get(key)
        if isinstance(said, str):
            word = {"metre": "m", "meter": "m", "meters": "m", "millimeter": "mm"}.get(said, said)
            return word if word in UNIT_MM else None
    return None


def _matrix(data: object) -> np.ndarray[tuple[int, ...], np.dtype[np.float64]] | None:
    """Return a 4×4 or 3×4 matrix, nested, as 16 numbers, or as OpenCV writes it."""
    if isinstance(data, Mapping) and {"rows", "cols", "data"} <= {str(key) for key in data}:
        numbers = _numbers(data["data"])
        if numbers is not None and data["cols"] == 4 and data["rows"] in {3, 4}:
            return np.reshape(numbers, (-1, 4)) if len(numbers) == 4 * data["rows"] else None
        return None
    if not isinstance(data, list | tuple):
        return None
    rows = [_numbers(row) for row in data]
    if len(rows) in {3, 4} and all(row is not None and len(row) == 4 for row in rows):
        return np.array(rows, dtype=np.float64)
    flat = _numbers(data)
    return np.reshape(flat, (4, 4)) if flat is not None and len(flat) == 16 else None


def _is_broken_matrix(data: object) -> bool:
    """Return whether some data would be a pose's matrix, were it not for a few of its numbers."""
    if isinstance(data, Mapping):
        return {"rows", "cols", "data"} <= {str(key) for key in data} and data["cols"] == 4
    if not isinstance(data, list | tuple) or len(data) not in {3, 4, 5, 15, 16, 17}:
        return False
    if len(data) < 6:
        fours = sum(isinstance(row, list | tuple) and len(row) == 4 for row in data)
        return fours >= len(data) - 1  # ABB's [[x, y, z], [q1 …], [cf1 …], [e1 …]] has two
    return sum(_numbers([each]) is not None for each in data) >= 12


def _numbers(data: object) -> list[float] | None:
    if not isinstance(data, list | tuple) or not data:
        return None
    if all(isinstance(each, int | float) and not isinstance(each, bool) for each in data):
        return [float(each) for each in data]
    return None


def _of_mapping(table: Mapping[str, object], place: str, unit: str | None) -> WrittenPose | None:
    """Return the pose that a mapping is; None where it is none itself."""
    flat = named_numbers_pose(_plain_numbers(table), place, unit=unit)
    if flat is not None:
        return flat
    table = {_OPENCV_NAMES.sub(r"\1", key): value for key, value in table.items()}
    position_key = next((key for key in _with_units(_POSITIONS) if key in table), None)
    if position_key is None:
        return None
    position, is_named = _vector(table[position_key], ("x", "y", "z"))
    turned = [key for key in _TURNS if isinstance(table.get(key), list | tuple | Mapping)]
    fault = f"{place}: {position_key} and {' and '.join(turned)} are no pose, numbers are missing"
    if position is None:
        if turned:
            raise PoseError(fault)
        return None
    said = position_key.rpartition("_")[2]
    unit = said if said in UNIT_MM and position_key != said else unit
    for key, value in table.items():
        if key == position_key:
            continue
        stem, _, suffix = key.rpartition("_")
        order = suffix if suffix in _ORDERED else None
        if (stem if order else key) in _ORIENTATIONS:
            turn, named_turn = _vector(value, _ORDERED["xyzw"])
            if turn is not None and len(turn) == 4:
                metres = "m" if is_named and named_turn and unit is None else unit
                order = "xyzw" if named_turn else order
                pose = quaternion_pose(position, turn, place, order=order, unit=metres)
                form = "ROS pose, m" if metres == "m" and named_turn else pose.form
                return replace(pose, form=form)
        if key in _ROTATION_MATRICES and isinstance(value, list | tuple | Mapping):
            rotation = _rotation(value)
            if rotation is not None:
                pose = matrix_pose(np.column_stack([rotation, position]), place)
                if unit is None:
                    check_length_unit(pose.pose, place, "the pose")
                return _scaled(pose, unit)
        if key in _VECTORS:
            numbers = _numbers(value)
            if numbers is not None and len(numbers) == 3:
                return _of_vector(position, numbers, place, unit)
    if turned:
        raise PoseError(fault)
    return None


_OPENCV_NAMES = re.compile(r"^(r|t|rvec|tvec)_[a-z]+2[a-z]+$")
"""R_cam2gripper and t_cam2gripper of ``calibrateHandEye``."""


def _with_units(keys: Sequence[str]) -> list[str]:
    return [*keys, *(f"{key}_{unit}" for key in keys for unit in ("mm", "m"))]


def _vector(value: object, letters: Sequence[str]) -> tuple[list[float] | None, bool]:
    """Return numbers of a list or by their letters, and whether they have letters."""
    if isinstance(value, Mapping):
        table = {str(key).lower(): each for key, each in value.items()}
        if {"rows", "cols", "data"} <= table.keys():
            value = table["data"]
            numbers = _numbers(value)
            return (numbers if numbers is not None and len(numbers) == 3 else None), False
        numbers = _numbers([table.get(letter) for letter in letters])
        return numbers, True
    if isinstance(value, list | tuple) and all(
        isinstance(each, list | tuple) and len(each) == 1 for each in value
    ):
        value = [each[0] for each in value]  # a column
    numbers = _numbers(value)
    return (numbers if numbers is not None and len(numbers) in {3, 4} else None), False


def _rotation(value: object) -> np.ndarray[tuple[int, ...], np.dtype[np.float64]] | None:
    if isinstance(value, Mapping):
        value = value.get("data")
    if not isinstance(value, list | tuple):
        return None
    rows = [_numbers(row) for row in value]
    if len(rows) == 3 and all(row is not None and len(row) == 3 for row in rows):
        return np.array(rows, dtype=np.float64)
    flat = _numbers(value)
    return np.reshape(flat, (3, 3)) if flat is not None and len(flat) == 9 else None


def _of_vector(
    position: Sequence[float], vector: Sequence[float], place: str, unit: str | None
) -> WrittenPose:
    pose = RigidTransform.from_rotation_vector(position, vector)
    written = WrittenPose(
        pose=pose, notation="rotation_vector", form=f"rotation vector in rad, {unit or 'mm'}"
    )
    if unit is None:
        check_length_unit(pose, place, "the pose")
    reading = current_reading().unit
    return _scaled(written, unit) if reading is None else _scaled_by_reading(written, reading)


def _scaled_by_reading(pose: WrittenPose, unit: str) -> WrittenPose:
    scaled = RigidTransform(
        rotation=pose.pose.rotation, translation_mm=UNIT_MM[unit] * pose.pose.translation_mm
    )
    return replace(pose, pose=scaled)


def _plain_numbers(table: Mapping[str, object]) -> dict[str, float]:
    return {
        key: float(value)
        for key, value in table.items()
        if isinstance(value, int | float) and not isinstance(value, bool)
    }


def loose_numbers(data: object) -> list[tuple[str, list[float]]]:
    """Return the lists of six or seven numbers in a document, with their names."""
    found: list[tuple[str, list[float]]] = []
    inner = data.items() if isinstance(data, Mapping) else ()
    for key, value in inner:
        numbers = _numbers(value)
        if numbers is not None and len(numbers) in {6, 7}:
            found.append((str(key), numbers))
    return found
