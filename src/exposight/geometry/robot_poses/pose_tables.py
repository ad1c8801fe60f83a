"""Poses in text tables, a row each, by the names of the columns."""

import re
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from exposight.errors import ExposightError, FormatError, InputError
from exposight.files import TextTable, parse_table
from exposight.geometry.robot_poses.pose_documents import named_numbers_pose, stem_of
from exposight.geometry.robot_poses.pose_matrices import matrix_pose
from exposight.geometry.robot_poses.printed_poses import WrittenPose

NAME_COLUMNS = (
    *("name", "view", "pose", "view_name", "pose_name", "punkt", "ansicht", "point", "label"),
    *("id", "position", "station", "nr", "image", "file", "bild", "datei"),
)
_TURNS = ({"w", "p", "r"}, {"a", "b", "c"}, {"qw", "qx", "qy", "qz"}, {"q1", "q2", "q3", "q4"})
_MATRICES = ("r{}{}", "m{}{}", "t{}{}", "r{}_{}", "m{}_{}", "t{}_{}")
_MOST_FAULTS = 10


def is_pose_header(names: Mapping[int, str] | list[str]) -> bool:
    """Tell whether columns of these names hold poses."""
    texts = list(names.values()) if isinstance(names, Mapping) else names
    stems = {stem_of(name) for name in texts}
    turns = any(turn <= stems for turn in (*_TURNS, {"rx", "ry", "rz"}))
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
    wanted = {"x", "y", "z", "rx", "ry", "rz"}.union(*_TURNS)
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
            found.append(WrittenPose(**{**vars(pose), "name": name}))
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
