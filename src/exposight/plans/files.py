"""Measuring plans as people write them, in TOML or YAML (``docs/formats.md``).

In TOML; YAML has the same keys::

    format = "exposight measuring plan"
    version = 2
    name = "near and far"
    sensor = "comet-pro-ae"    # or the path of a sensor's document, from this file
    features = ["f1", "f2"]
    reference = "f1"

    [[planes]]
    name = "near"
    z_tcp_mm = -165
    x_mm = { first = -135, last = 135, count = 4 }    # or a list
    y_mm = [-100, 0, 100]
    exposures_ms = { first = 5, last = 100, count = 10 }    # logarithmic; or a list

    [[poses]]
    name = "robot"
    notation = "fanuc"
    frame = "part_from_tcp"
    rows = [[20, -35, -640, 0, 0, 0], [20, 15, -640, 5, -10, 90]]    # or file = "poses.csv"
    exposures_ms = [40]

    [simulated]    # for the simulated cell alone
    lighting = "II"
"""

import json
import logging
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, fields, replace
from itertools import chain, product
from pathlib import Path
from typing import Annotated, Any, Literal

import tomli_w
from pydantic import Field

from exposight.cell import (
    PRESETS,
    ActiveSensor,
    StoredPose,
    preset_name,
    sensor_named_or_read,
    write_sensor,
)
from exposight.errors import FormatError, InputError
from exposight.files import check_header, parse_toml, parsing, read_text, validate, write_durably
from exposight.plans import positions
from exposight.plans.plain_yaml import load_yaml
from exposight.plans.plan import MeasuringPlan
from exposight.plans.pose_lists import PoseList, read_pose_table, through_hand_eye

logger = logging.getLogger(__name__)

PLAN_FORMAT = "exposight measuring plan"
PLAN_VERSION = 3
"""2: any sensor, fixed views, and the simulated cell's settings in a table of their own. 3: turns
and lists of poses; what has neither is written as version 2, which older exposights read."""

_SINCE_3 = {"turns_deg", *positions.TURN_AXES, "rows"}

_GROUPS = ("planes", "random", "poses")
PLAN_SUFFIXES = (".toml", ".yaml", ".yml")

_LONGEST = 1000
"""Numbers in one list: more is a slip of the pen."""


_MOST_TURNS = 10_000
"""All combinations of the angles about three axes."""

_Count = Annotated[int, Field(ge=2, le=_LONGEST)]


@dataclass(frozen=True, kw_only=True)
class _Even:
    first: float
    last: float
    count: _Count


_Angles = Annotated[tuple[float, ...], Field(min_length=1, max_length=_LONGEST)]


@dataclass(frozen=True, kw_only=True)
class _Turns:
    w_deg: _Angles = (0.0,)
    p_deg: _Angles = (0.0,)
    r_deg: _Angles = (0.0,)


@dataclass(frozen=True, kw_only=True)
class _Fixed:
    name: str
    camera_from_part: StoredPose
    exposures_ms: tuple[float, ...]


@dataclass(frozen=True, kw_only=True)
class _FixedViews:
    fixed: tuple[_Fixed, ...]


@dataclass(frozen=True, kw_only=True)
class _Logarithmic:
    first: Annotated[float, Field(gt=0)]
    last: Annotated[float, Field(gt=0)]
    count: _Count


def read_plan(path: str | Path) -> MeasuringPlan:
    """Read a measuring plan from a TOML or YAML file, told by its suffix.

    Raises
    ------
    MissingFileError
        If there is no such file.
    FormatError
        If it is neither TOML nor YAML or not a plan, a key is unknown, missing or there twice, or
        a value is impossible.
    VersionError
        If it was written for a newer version of exposight.
    """
    path = Path(path)
    suffix = path.suffix.lower()
    if path.is_file() and suffix not in PLAN_SUFFIXES:
        msg = f"{path}: a measuring plan ends in {', '.join(PLAN_SUFFIXES)}, got {path.suffix!r}"
        raise FormatError(msg)
    text = read_text(path, "measuring plan in TOML or YAML")
    language: Literal["toml", "yaml"] = "toml" if suffix == ".toml" else "yaml"
    return plan_from_text(text, language, source=str(path), folder=path.parent)


def plan_from_text(
    text: str,
    language: Literal["toml", "yaml"] = "toml",
    *,
    source: str = "the measuring plan",
    folder: Path | None = None,
) -> MeasuringPlan:
    """Read a measuring plan from text.

    Parameters
    ----------
    text : str
        The plan.
    language : {'toml', 'yaml'}
        What it is written in; the keys are the same.
    source : str
        Where it comes from, for messages.
    folder : Path, optional
        Where the paths of a sensor's document and of lists of poses begin; the working directory by
        default.

    Raises
    ------
    FormatError, VersionError
        As for `read_plan`.
    """
    what = "measuring plan in TOML" if language == "toml" else "measuring plan in plain YAML"
    with parsing(source, what):
        try:
            raw = parse_toml(text, source, what) if language == "toml" else load_yaml(text)
        except ValueError as error:  # broken, or a number of thousands of digits
            msg = f"{source} is not a readable {what}: {error}"
            raise FormatError(msg) from error
    return _plan(raw, source, folder or Path())


def _plan(raw: object, source: str, folder: Path) -> MeasuringPlan:
    if not isinstance(raw, dict):
        msg = f"{source} must hold keys and values, got {type(raw).__name__}"
        raise FormatError(msg)
    check_header(raw, format_name=PLAN_FORMAT, newest=PLAN_VERSION, source=source)
    table = {key: value for key, value in raw.items() if key not in {"format", "version"}}
    for key in _GROUPS:
        if isinstance(table.get(key), list):  # copies, whose short forms can be written out
            table[key] = [dict(g) if isinstance(g, dict) else g for g in table[key]]
    if raw["version"] == 1:
        _move_settings(table)
    try:
        _move_fixed(table, source)
        sensor = _sensor(table.get("sensor"), folder)
        if sensor is None:
            return validate(MeasuringPlan, table, source)
        for place, group in _groups(table):
            _write_out(group, sensor, f"{source}: {place}")
            _write_out_poses(group, folder)
    except InputError as error:
        msg = f"{source}: {error}"
        raise FormatError(msg) from error
    table["sensor"] = _content(sensor)
    plan = replace(validate(MeasuringPlan, table, source), sensor=sensor)
    try:
        plan.check_exposures()
    except InputError as error:
        msg = f"{source}: {error}"
        raise FormatError(msg) from error
    for remark in filter(None, (poses.remark for poses in plan.poses)):
        logger.warning("%s: %s", source, remark)
    return plan


def _content(sensor: ActiveSensor) -> dict[str, Any]:
    document = json.loads(sensor.to_json())
    return {key: value for key, value in document.items() if key not in {"format", "version"}}


def _groups(raw: dict[str, Any]) -> Iterator[tuple[str, dict[str, Any]]]:
    """Yield the place and the content of every group of views that is one."""
    for key in _GROUPS:
        groups = raw.get(key)
        for i, group in enumerate(groups if isinstance(groups, list) else ()):
            if isinstance(group, dict):
                yield f"{key}[{i}]", group


def _move_settings(raw: dict[str, Any]) -> None:
    """Move what version 1 says of the simulated cell to where version 2 has it."""
    simulated: dict[str, Any] = {
        key: raw.pop(key) for key in ("lighting", "alignment") if key in raw
    }
    shares = {
        group.get("name"): group.pop("kinematic_share")
        for _, group in _groups(raw)
        if "kinematic_share" in group
    }
    if shares:
        simulated["kinematic_share"] = shares
    if simulated:
        raw["simulated"] = simulated


def _sensor(name: object, folder: Path) -> ActiveSensor | None:
    if not isinstance(name, str):  # `validate` says so
        return None
    return sensor_named_or_read(name if name in PRESETS else folder / name)


def _write_out(group: dict[str, Any], sensor: ActiveSensor, place: str) -> None:
    """Replace the short forms of lists by the lists."""
    _write_out_even(group, ("x_mm", "y_mm"), place)
    if isinstance(group.get("turns_deg"), dict):
        angles, place_of_turns = dict(group["turns_deg"]), f"{place}.turns_deg"
        _write_out_even(angles, positions.TURN_AXES, place_of_turns)
        turns = validate(_Turns, angles, place_of_turns)
        count = len(turns.w_deg) * len(turns.p_deg) * len(turns.r_deg)
        if count > _MOST_TURNS:
            msg = (
                f"{place_of_turns}: {count} turns at each position, and there may be {_MOST_TURNS}"
            )
            raise FormatError(msg)
        group["turns_deg"] = list(product(turns.w_deg, turns.p_deg, turns.r_deg))
    if isinstance(group.get("exposures_ms"), dict):
        steps = validate(_Logarithmic, group["exposures_ms"], f"{place}.exposures_ms")
        try:
            group["exposures_ms"] = positions.logarithmic_exposures(
                steps.first, steps.last, steps.count, sensor
            )
        except InputError as error:
            msg = f"exposures_ms of {group.get('name')!r}: {error}"
            raise InputError(msg) from error


def _write_out_poses(group: dict[str, Any], folder: Path) -> None:
    """Replace a file of poses by its content, and matrices by their numbers row by row."""
    file, rows, notation = group.get("file"), group.get("rows"), group.get("notation", "")
    if isinstance(file, str) and isinstance(notation, str):
        if rows is not None:
            msg = f"poses {group.get('name')!r}: give rows or file, not both"
            raise InputError(msg)
        del group["file"]
        times_ms = group.get("exposures_ms")
        times_ms = times_ms if isinstance(times_ms, list | tuple) else ()
        group.update(read_pose_table(folder / file, notation, times_ms))
    elif isinstance(rows, list) and notation == "matrix":
        group["rows"] = [_flat(row) for row in rows]
    through_hand_eye(group, folder)


def _flat(matrix: object) -> object:
    if isinstance(matrix, list) and all(isinstance(row, list) for row in matrix):
        return [*chain(*matrix)]
    return matrix


def _move_fixed(raw: dict[str, Any], source: str) -> None:
    """Make lists of one pose of the tables ``fixed``, as plans of version 2 have them."""
    poses, fixed = raw.get("poses", []), {"fixed": raw.pop("fixed", [])}
    lists = [
        PoseList.from_transforms(v.name, [v.camera_from_part], exposures_ms=v.exposures_ms)
        for v in validate(_FixedViews, fixed, source).fixed
    ]
    if lists and isinstance(poses, list):
        raw["poses"] = [*poses, *map(_given, lists)]


def _write_out_even(group: dict[str, Any], keys: Iterable[str], place: str) -> None:
    for key in keys:
        if isinstance(group.get(key), dict):
            even = validate(_Even, group[key], f"{place}.{key}")
            group[key] = positions.even_positions(even.first, even.last, even.count)


def write_plan(path: str | Path, plan: MeasuringPlan) -> None:
    """Write a measuring plan as a TOML file, and its sensor beside it unless that is a preset.

    The plan is whole or absent. The sensor's document is called after it: ``door-sensor.json``
    beside ``door.toml``.

    Raises
    ------
    FormatError
        If the file's name does not end in .toml.
    SensorError
        If the plan's sensor cannot take an exposure time.
    FileError
        If the disk refuses.
    """
    path = Path(path)
    if path.suffix.lower() != ".toml":
        msg = f"{path}: plans are written in TOML; give the file a name that ends in .toml"
        raise FormatError(msg)
    plan.check_exposures()
    document = f"{path.stem}-sensor.json"
    if preset_name(plan.sensor) is None:
        write_sensor(path.with_name(document), plan.sensor)
    write_durably(path, plan_to_toml(plan, document).encode())


def plan_to_toml(plan: MeasuringPlan, sensor_file: str = "plan-sensor.json") -> str:
    """Return a measuring plan in TOML, short forms written out, to be read or edited.

    Parameters
    ----------
    plan : MeasuringPlan
        The plan.
    sensor_file : str
        Path of the sensor's document from the plan's folder, named unless the sensor is a preset.
    """
    sensor = preset_name(plan.sensor) or sensor_file
    groups = [
        *(("planes", _given(plane)) for plane in plan.planes),
        *(("random", _given(box)) for box in plan.random),
    ]
    fixed = [_as_fixed(poses) for poses in plan.poses]
    if all(fixed):
        groups += [("fixed", given) for given in fixed]
    else:
        groups += [("poses", {**_given(poses), "rows": _rows(poses)}) for poses in plan.poses]
    version = PLAN_VERSION if any(_SINCE_3 & given.keys() for _, given in groups) else 2
    lines = [
        *_entries(format=PLAN_FORMAT, version=version, name=plan.name, sensor=sensor),
        *_entries(features=plan.features, reference=plan.reference, side=plan.side),
        *_entries(blind_views=plan.blind_views, seed=plan.seed),
    ]
    for table, given in groups:
        lines += ["", f"[[{table}]]", *_entries(**given)]
    if plan.simulated:
        lines += ["", tomli_w.dumps({"simulated": plan.simulated}).rstrip()]
    return "\n".join(lines) + "\n"


def _given(group: positions.DepthPlane | positions.RandomPositions | PoseList) -> dict[str, Any]:
    """Return the keys of a group of views that are not as by default."""
    values = {each.name: (getattr(group, each.name), each.default) for each in fields(group)}
    return {name: value for name, (value, default) in values.items() if value != default}


def _rows(poses: PoseList) -> tuple[tuple[Any, ...], ...]:
    return tuple(map(_matrix, poses.rows)) if poses.notation == "matrix" else poses.rows


def _matrix(row: tuple[float, ...]) -> tuple[tuple[float, ...], ...]:
    return tuple(row[i : i + 4] for i in range(0, len(row), 4))


def _as_fixed(poses: PoseList) -> dict[str, Any]:
    """Return the keys of a list of one pose as version 2 has it; empty where it cannot."""
    more = poses.n_views > 1 or poses.names or poses.exposures_each_ms
    if more or (poses.notation, poses.frame, len(poses.rows[0])) != (
        "matrix",
        "camera_from_part",
        16,
    ):
        return {}
    return {
        "name": poses.name,
        "camera_from_part": _matrix(poses.rows[0]),
        "exposures_ms": poses.exposures_ms,
    }


def _entries(**values: object) -> Iterator[str]:
    for key, value in values.items():
        if key == "rows" and isinstance(value, tuple):  # one a line
            yield from (f"{key} = [", *(f"    {_toml(row)}," for row in value), "]")
        else:
            yield f"{key} = {_toml(value)}"


def _toml(value: object) -> str:  # tomli_w gives every number of a list a line of its own
    if isinstance(value, tuple):
        return "[" + ", ".join(map(_toml, value)) + "]"
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False)  # TOML's basic strings are JSON's
    return repr(value).removesuffix(".0")
