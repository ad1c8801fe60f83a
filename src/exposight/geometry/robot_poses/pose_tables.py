"""Poses by the names of their numbers: of keys and values, and of text tables, a row each."""

import re
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from exposight.errors import ExposightError, FormatError, InputError, PoseError
from exposight.files import TextTable, ambiguous, current_reading, parse_table
from exposight.geometry.poses import RigidTransform
from exposight.geometry.robot_poses.pose_notations import matrix_pose, quaternion_pose
from exposight.geometry.robot_poses.pose_numbers import UNIT_MM
from exposight.geometry.robot_poses.printed_poses import WrittenPose

NAME_COLUMNS = (
    *("name", "view", "pose", "view_name", "pose_name", "punkt", "ansicht", "point", "label"),
    *("id", "position", "station", "nr", "image", "file", "bild", "datei"),
)
_MATRICES = ("r{}{}", "m{}{}", "t{}{}", "r{}_{}", "m{}_{}", "t{}_{}")
_MOST_FAULTS = 10

_KINDS = {
    "fanuc": ("w", "p", "r"),
    "kuka": ("a", "b", "c"),
    "wxyz": ("qw", "qx", "qy", "qz"),
    "abb": ("q1", "q2", "q3", "q4"),
    "rotation": ("rx", "ry", "rz"),
}


def named_numbers_pose(
    numbers: Mapping[str, float], source: str | Path, *, unit: str | None = None
) -> WrittenPose | None:
    """Return the pose of numbers with names such as x_mm, y_mm, z_mm, qw, qx, qy, qz.

    Parameters
    ----------
    numbers : mapping of str to float
        By name in lower case; units behind an underscore, in brackets or parentheses.
    source : str or Path
        For messages.
    unit : str, optional
        Unit of lengths whose name does not tell it.

    Returns
    -------
    WrittenPose or None
        None where the names are those of no pose.

    Raises
    ------
    AmbiguousError
        If the names tell no notation or unit.
    PoseError
        If the numbers are no pose.
    """
    named = {stem_of(key): (value, _suffix(key)) for key, value in numbers.items()}
    if not {"x", "y", "z"} <= named.keys():
        return None
    position = [named[axis][0] for axis in "xyz"]
    units = {named[axis][1] for axis in "xyz"} - {""}
    if len(units) > 1:
        msg = f"{source}: x, y and z are in different units: {', '.join(sorted(units))}"
        raise PoseError(msg)
    unit = next(iter(units)) if units and units <= UNIT_MM.keys() else unit
    for kind, keys in _KINDS.items():
        if set(keys) <= named.keys():
            values = [named[key][0] for key in keys]
            angle_units = {named[key][1] for key in keys} - {""}
            if len(angle_units) > 1:
                msg = f"{source}: {', '.join(keys)} are in different units"
                raise PoseError(msg)
            return _named_pose(kind, position, values, source, unit, angle_units)
    return None


def _named_pose(
    kind: str,
    position: list[float],
    values: list[float],
    source: str | Path,
    unit: str | None,
    angle_units: set[str],
) -> WrittenPose:
    if kind in {"wxyz", "abb"}:
        said = unit or ("mm" if kind == "abb" else None)
        return quaternion_pose(position, values, source, order="wxyz", unit=said)
    scale = UNIT_MM[current_reading().unit or unit or "mm"]
    mm = [scale * number for number in position]
    angle = current_reading().angle
    is_rad = angle == "rad" if angle else angle_units == {"rad"}
    if kind == "rotation":
        if not is_rad and angle_units != {"rad"}:
            raise ambiguous(
                source,
                "are rx ry rz a rotation vector, as Universal Robots have it, or angles about the "
                "fixed axes? Angles go by the columns w p r;",
                "angle",
                {"rad": "a rotation vector"},
            )
        pose = RigidTransform.from_rotation_vector(mm, values)
        return WrittenPose(pose=pose, notation="rotation_vector", form="rotation vector in rad")
    degrees = [float(np.degrees(v)) if is_rad else v for v in values]
    make = RigidTransform.from_fanuc_wpr if kind == "fanuc" else RigidTransform.from_kuka_abc
    letters = "w p r" if kind == "fanuc" else "a b c"
    return WrittenPose(
        pose=make(mm, *degrees),
        notation=kind,
        form=f"x y z {letters}, {unit or 'mm'} and {'rad' if is_rad else 'degrees'}",
    )


def stem_of(key: str) -> str:
    """Return the number that a key or column means: x of ``pos_x [mm]``, qw of ``quat_w``."""
    word = key.strip().lower()
    for bracket in "[(":
        word = word.split(bracket)[0].strip()
    for prefix in ("t", "pos_", "position_", "position.", "trans_", "translation."):
        if word.startswith(prefix) and word[len(prefix) :].split("_")[0] in {"x", "y", "z"}:
            word = word[len(prefix) :]
    for prefix in ("orientation.", "orientation_", "quat_", "quaternion_", "rotation."):
        if word.startswith(prefix) and word[len(prefix) :] in {"x", "y", "z", "w"}:
            word = "q" + word[len(prefix) :]
    stem, _, unit = word.rpartition("_")
    return stem if stem and unit in {*UNIT_MM, "deg", "rad", "grad", "degrees"} else word


def _suffix(key: str) -> str:
    word = key.strip().lower().rstrip(")] ")
    for separator in ("[", "(", "_"):
        if separator in word:
            unit = word.rpartition(separator)[2].strip()
            if unit in {*UNIT_MM, "deg", "rad"}:
                return unit
            if unit in {"°", "grad", "degrees", "degree"}:
                return "deg"
    return ""


# -- tables --------------------------------------------------------------------------------------


def is_pose_header(names: Mapping[int, str] | list[str]) -> bool:
    """Tell whether columns of these names hold poses."""
    texts = list(names.values()) if isinstance(names, Mapping) else names
    stems = {stem_of(name) for name in texts}
    turns = any(stems.issuperset(turn) for turn in _KINDS.values())
    return ({"x", "y", "z"} <= stems and turns) or bool(_matrix_columns(texts))


def table_poses(data: bytes, source: str | Path) -> list[WrittenPose]:
    """Return the poses of a text table with a header, in any dialect.

    Returns
    -------
    list of WrittenPose
        Empty where its columns are no poses.

    Raises
    ------
    PoseError, FormatError
        If rows are no poses; the first ten are named, and how many there are.
    AmbiguousError
        If the names leave something open.
    """
    head = next((line for line in _lines(data) if line.strip(" \t;,") and line[0] not in "#%/"), "")
    if not is_pose_header([w.strip(" \"'") for w in re.split(r"[;,\t|]|\s+", head)]) and (
        not is_pose_header([w.strip(" \"'") for w in re.split(r"[;,\t|]", head)])
    ):
        return []
    table = parse_table(data, source, what="list of poses")
    poses = poses_of_table(table)
    table.say()
    return poses


def _lines(data: bytes) -> list[str]:
    encoding = "utf-16" if data[:2] in {b"\xff\xfe", b"\xfe\xff"} else "utf-8-sig"
    return data[:20_000].decode(encoding, errors="replace").splitlines()


def poses_of_table(table: TextTable) -> list[WrittenPose]:
    """Return the poses of a table's rows; raises as `table_poses`."""
    matrix = _matrix_columns(list(table.header))
    stems = [stem_of(name) for name in table.header]
    wanted = {"x", "y", "z"}.union(*_KINDS.values())
    numeric = matrix or [
        name for name, stem in zip(table.header, stems, strict=True) if stem in wanted
    ]
    numbers = np.atleast_2d(table.numbers(*numeric))
    names = _names(table)
    found, faults = [], []
    for row, line, name in zip(numbers, table.lines, names, strict=True):
        place = f"{table.source}, line {line}"
        try:
            if not np.isfinite(row).all():
                empty = numeric[int(np.argmin(np.isfinite(row)))]
                msg = f"{place}: {empty} is empty"
                raise FormatError(msg)
            pose = (
                matrix_pose(np.reshape(row, (-1, 4)), place)
                if matrix
                else named_numbers_pose(dict(zip(numeric, row.tolist(), strict=True)), place)
            )
        except ExposightError as error:
            if not isinstance(error, InputError | FormatError) or len(numbers) == 1:
                raise
            faults.append(error)
            continue
        if pose is not None:
            found.append(replace(pose, name=name))
    if faults and not found:
        raise faults[0]
    if faults:
        shown = "; ".join(str(fault) for fault in faults[:_MOST_FAULTS])
        msg = f"{table.source}: {len(faults)} of {len(numbers)} rows are no poses: {shown}"
        raise FormatError(msg)
    return found


def _names(table: TextTable) -> list[str]:
    by_name = {name.strip().lower().replace(" ", "_"): name for name in table.header}
    column = next((by_name[name] for name in NAME_COLUMNS if name in by_name), None)
    return table.texts(column) if column is not None else [""] * len(table)


def _matrix_columns(header: list[str]) -> list[str]:
    """Return the columns of a matrix, row by row; none where it is not one."""
    by_stem = {name.strip().lower(): name for name in header}
    by_stem |= {stem_of(name): name for name in header}
    for form in _MATRICES:
        for first in (0, 1):
            for rows in (4, 3):
                keys = [form.format(i + first, j + first) for i in range(rows) for j in range(4)]
                if set(keys) <= by_stem.keys():
                    return [by_stem[key] for key in keys]
    mixed = [f"r{i}{j}" if j < 4 else "xyz"[i - 1] for i in (1, 2, 3) for j in (1, 2, 3, 4)]
    return [by_stem[key] for key in mixed] if set(mixed) <= by_stem.keys() else []
