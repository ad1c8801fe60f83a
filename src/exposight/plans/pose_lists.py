"""Lists of poses, one view each, as people, robots and programs write them down."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, get_args

import numpy as np

from exposight.errors import FormatError, InputError
from exposight.files import TextTable, read_table, unit_hint
from exposight.geometry import (
    PoseNotation,
    RigidTransform,
    camera_from_part_of,
    is_pose_header,
    pose_columns,
    pose_from_numbers,
    poses_of_table,
    read_named_poses,
    read_pose,
)
from exposight.plans.positions import check_exposures, check_name, first_twice, numbered_names

PoseFrame = Literal["camera_from_part", "part_from_camera", "tcp_from_part", "part_from_tcp"]
"""Which pose is written: the part's in the frame of the first camera or the TCP, or the reverse."""


@dataclass(frozen=True, kw_only=True)
class PoseList:
    """Poses written out, one view each.

    Parameters
    ----------
    name : str
        Views are called after it and numbered: ``robot-01``, ``robot-02``, …; a single one is
        called ``robot``.
    notation : {'fanuc', 'kuka', 'abb', 'ur', 'quaternion_wxyz', …}
        What the numbers mean (`exposight.geometry.PoseNotation`, ``docs/conventions.md``).
    frame : {'camera_from_part', 'part_from_camera', 'tcp_from_part', 'part_from_tcp'}
        Which pose they are. A robot that carries the sensor, set to the sensor's TCP as its tool
        and to the part as its user frame, shows the last.
    rows : sequence of sequence of float
        One pose a row, its numbers in the notation's order and units.
    names : sequence of str
        The views' names, in place of numbers.
    exposures_ms : sequence of float, ms
        Exposure times at every pose.
    exposures_each_ms : sequence of sequence of float, ms
        Exposure times pose by pose, in place of `exposures_ms`, which is then all of them.

    Raises
    ------
    InputError
        If there is no pose, a row is none, names or exposure times are not one for each row, a name
        appears twice, or as for `DepthPlane`. The message names the list and the row, from 1.
    """

    name: str
    notation: PoseNotation
    frame: PoseFrame
    rows: tuple[tuple[float, ...], ...]
    names: tuple[str, ...] = ()
    exposures_ms: tuple[float, ...] = ()
    exposures_each_ms: tuple[tuple[float, ...], ...] = ()

    def __post_init__(self) -> None:
        check_name(self.name)
        place = f"poses {self.name!r}"
        if self.frame not in get_args(PoseFrame):
            msg = f"{place}: frame must be one of {', '.join(get_args(PoseFrame))}, "
            raise InputError(msg + f"got {self.frame!r}")
        rows = tuple(tuple(map(float, row)) for row in self.rows)
        if not rows:
            msg = f"{place}: rows is empty; give at least one pose"
            raise InputError(msg)
        for number, row in enumerate(rows, start=1):
            _check_pose(self.notation, row, f"{place}, row {number}")
        object.__setattr__(self, "rows", rows)
        for key in ("names", "exposures_each_ms"):
            values = tuple(getattr(self, key))
            object.__setattr__(self, key, values)
            if values and len(values) != len(rows):
                msg = f"{place}: {key} needs one entry for each of {len(rows)} rows, "
                raise InputError(msg + f"got {len(values)}")
        for name in self.names:
            check_name(name)
        twice = first_twice(self.names)
        if twice is not None:
            msg = f"{place}: two poses are called {twice!r}; give each a name of its own"
            raise InputError(msg)
        each = tuple(
            check_exposures(times_ms, f"{place}, row {number}")
            for number, times_ms in enumerate(self.exposures_each_ms, start=1)
        )
        object.__setattr__(self, "exposures_each_ms", each)
        every = tuple(sorted({time_ms for times_ms in each for time_ms in times_ms}))
        object.__setattr__(self, "exposures_ms", every or check_exposures(self.exposures_ms, place))

    @classmethod
    def from_transforms(
        cls,
        name: str,
        camera_from_part: Sequence[RigidTransform],
        *,
        exposures_ms: Sequence[float],
        names: Sequence[str] = (),
    ) -> "PoseList":
        """Return the list of poses that a program computed.

        Parameters
        ----------
        name : str
            As for the class.
        camera_from_part : sequence of RigidTransform
            Where the part shall stand, seen from the sensor's first camera.
        exposures_ms : sequence of float, ms
            Exposure times at every pose.
        names : sequence of str
            The views' names, in place of numbers.

        Raises
        ------
        InputError
            As for the class.
        """
        return cls(
            name=name,
            notation="matrix",
            frame="camera_from_part",
            rows=tuple(tuple(pose.to_matrix().ravel().tolist()) for pose in camera_from_part),
            names=tuple(names),
            exposures_ms=tuple(exposures_ms),
        )

    @property
    def n_views(self) -> int:
        """Number of poses."""
        return len(self.rows)

    def views(
        self, camera_from_tcp: RigidTransform
    ) -> Iterator[tuple[str, RigidTransform, RigidTransform, tuple[float, ...]]]:
        """Yield each view's name, camera_from_part, tcp_from_part and exposure times in ms.

        Parameters
        ----------
        camera_from_tcp : RigidTransform
            The sensor's.
        """
        numbered = (self.name,) if self.n_views == 1 else numbered_names(self.name, self.n_views)
        each_ms = self.exposures_each_ms or (self.exposures_ms,) * self.n_views
        for name, row, times_ms in zip(self.names or numbered, self.rows, each_ms, strict=True):
            pose = pose_from_numbers(self.notation, row)
            if self.frame.startswith("part"):
                pose = pose.inverse()
            if "camera" in self.frame:
                yield name, pose, camera_from_tcp.inverse() @ pose, times_ms
            else:
                yield name, camera_from_tcp @ pose, pose, times_ms

    @property
    def remark(self) -> str:
        """What to check where degrees look like radians; empty where they do not."""
        angular = [i for i, c in enumerate(pose_columns(self.notation)) if c.endswith("_deg")]
        angles = [row[i] for row in self.rows for i in angular]
        if all(map(float.is_integer, angles)) or max(map(abs, angles)) > 2 * math.pi:
            return ""
        return (
            f"poses {self.name!r}: no angle is beyond ±2π, yet {self.notation} angles are read as "
            "degrees; if they are radians, multiply them by 180/π"
        )


def _check_pose(notation: str, numbers: Sequence[float], place: str) -> None:
    try:
        pose_from_numbers(notation, numbers)
    except InputError as error:
        msg = f"{place}: {error}"
        raise type(error)(msg) from error


def read_pose_table(path: Path, notation: str, exposures_ms: Sequence[float]) -> dict[str, Any]:
    """Read poses from a file, as keys and values of a `PoseList`.

    Parameters
    ----------
    path : Path
        A table in any dialect, whose header names the columns of one notation, in any order, and
        optionally ``name`` and ``exposures_ms`` (exposure times with blanks between); or poses in
        another form of `exposight.geometry.read_named_poses`, such as a robot's program, which
        become matrices.
    notation : str
        Which one it shall be; empty for that of the file.
    exposures_ms : sequence of float, ms
        Exposure times of rows that give none.

    Raises
    ------
    MissingFileError
        If it is not there.
    FormatError
        If the header is that of no notation, or a row is no pose. The message names the line.
    AmbiguousError
        If two readings of the file fit.
    """
    if path.suffix.lower() != ".csv":
        return _named_poses(path, notation)
    table = read_table(path, "list of poses in CSV")
    header = list(table.header)
    columns = pose_columns(notation or _notation(header))
    if len(set(header)) < len(header) or {*header} - {"name", "exposures_ms"} != {*columns}:
        return _other_table(table, notation, columns, exposures_ms)
    numbers = np.reshape(table.numbers(*columns), (len(table), len(columns)))
    for line, row in zip(table.lines, numbers.tolist(), strict=True):
        place = f"{path}, line {line}"
        if not np.isfinite(row).all():
            column = columns[int(np.argmin(np.isfinite(row)))]
            msg = f"{place}, column {column}: expected a finite number"
            raise FormatError(msg)
        _check_pose(notation or _notation(header), row, place)
    table.say()
    return {
        "notation": notation or _notation(header),
        "rows": numbers.tolist(),
        "names": table.texts("name") if "name" in header else [],
        "exposures_each_ms": _exposures(table, exposures_ms),
    }


def _named_poses(path: Path, notation: str) -> dict[str, Any]:
    poses = read_named_poses(path, notation or None)
    return {**_matrices(list(poses.values())), "names": list(poses)}


def _matrices(poses: Sequence[RigidTransform]) -> dict[str, Any]:
    return {"notation": "matrix", "rows": [pose.to_matrix().ravel().tolist() for pose in poses]}


def _other_table(
    table: TextTable, notation: str, columns: Sequence[str], exposures_ms: Sequence[float]
) -> dict[str, Any]:
    """Read a table whose columns have other names than a notation's."""
    header = list(table.header)
    if notation or not is_pose_header(header):
        msg = (
            f"{table.source}: expected the columns of a {notation or _notation(header)} pose, "
            f"{','.join(columns)}[,name][,exposures_ms], got {','.join(header)}"
        )
        hints = [unit_hint(column, columns) for column in header if column not in columns]
        raise FormatError("; ".join([msg, *filter(None, hints)]))
    if strange := [c for c in header if "exp" in c.lower() and c != "exposures_ms"]:
        msg = f"{table.source}: exposure times go into a column exposures_ms, got {strange[0]}"
        raise FormatError(msg)
    poses = poses_of_table(table)
    table.say()
    names = [pose.name for pose in poses]
    return {
        **_matrices([pose.pose for pose in poses]),
        "names": names if all(names) else [],
        "exposures_each_ms": _exposures(table, exposures_ms),
    }


def _exposures(table: TextTable, exposures_ms: Sequence[float]) -> list[list[float]]:
    """Return the exposure times of each row; empty where the table has no such column."""
    if "exposures_ms" not in table.header:
        return []
    each = []
    for line, cell in zip(table.lines, table.texts("exposures_ms"), strict=True):
        place = f"{table.source}, line {line}, column exposures_ms"
        decimal = str.maketrans(",", ".") if table.decimal == "comma" else {}
        given = [_number(word.translate(decimal), place) for word in cell.split()]
        each.append(given or list(exposures_ms))
    return each


def _notation(header: Sequence[str]) -> PoseNotation:
    """Return the notation that has most of a header's columns and fewest others."""
    return max(
        get_args(PoseNotation),
        key=lambda each: len({*pose_columns(each)} & {*header}) - len(pose_columns(each)),
    )


def _number(text: str, place: str) -> float:
    try:
        number = float(text)
    except ValueError as error:
        msg = f"{place}: expected a number, got {text!r}"
        raise FormatError(msg) from error
    if not math.isfinite(number):
        msg = f"{place}: expected a finite number, got {text!r}"
        raise FormatError(msg)
    return number


ROBOT_FRAME = "base_from_flange"
"""Frame of poses that a robot shows with neither tool nor user frame, in a plan's file."""


def through_hand_eye(group: dict[str, Any], folder: Path) -> None:
    """Turn a robot's poses in a plan's table into camera_from_part.

    Parameters
    ----------
    group : dict
        Keys and values of a `PoseList` whose frame is ``base_from_flange``; ``hand_eye`` and
        ``part_in_base`` name files with the camera's pose on the flange and the part's in the base.
    folder : Path
        Where those paths begin.

    Raises
    ------
    InputError
        If one of them is missing, or no pose.
    """
    place = f"poses {group.get('name')!r}"
    keys = ("hand_eye", "part_in_base")
    files = [group.pop(key, None) for key in keys]
    if group.get("frame") != ROBOT_FRAME:
        if any(files):
            msg = f'{place}: hand_eye and part_in_base go with frame = "{ROBOT_FRAME}"'
            raise InputError(msg)
        return
    missing = [key for key, file in zip(keys, files, strict=True) if not isinstance(file, str)]
    if missing:
        msg = f'{place}: frame = "{ROBOT_FRAME}" needs {" and ".join(missing)}, names of files'
        raise InputError(msg)
    flange_from_camera, base_from_part = (read_pose(folder / str(file)) for file in files)
    rows, notation = group.get("rows"), group.get("notation", "")
    if not isinstance(rows, list):
        return  # which is said when the list is made
    poses = []
    for number, row in enumerate(rows, start=1):
        _check_pose(notation, row, f"{place}, row {number}")
        poses.append(
            camera_from_part_of(
                base_from_flange=pose_from_numbers(notation, row),
                flange_from_camera=flange_from_camera,
                base_from_part=base_from_part,
            )
        )
    group.update(_matrices(poses), frame="camera_from_part")
