"""Plans and settings as people write them, in TOML, YAML and lists of poses."""

from __future__ import annotations

import math
import re
import tempfile
import tomllib
from collections.abc import Callable
from dataclasses import asdict, replace
from pathlib import Path
from random import Random
from typing import Any

import numpy as np
import tomli_w
import yaml
from tests.fuzz.formats import Format, Sample
from tests.fuzz.text_files import is_plain

from exposight.imaging import SEQUENCE_PRESETS, PatternSequence, read_sequence
from exposight.imaging.sequence_files import sequence_to_toml
from exposight.planning.exposure_limits import ExposureLimits, limits_named
from exposight.plans import MeasuringPlan, PoseList, plan_preset, read_plan, write_plan
from exposight.plans.files import plan_to_toml
from exposight.plans.pose_lists import read_pose_table
from exposight.twin.cell_settings import SimulatedCellSettings
from exposight.twin.part.scene_files import SCENE_FORMAT, SceneDocument, find_scene
from exposight.twin.sensors.settings import sensor_settings

_LINE = re.compile(r'^(?P<key>\w+)(?P<mark> = |: )(?P<value>[^\[{"\n].*)$', re.MULTILINE)


def _every_number(value: object) -> list[float]:
    """Return all numbers within a value made of containers."""
    if isinstance(value, dict):
        return [n for each in value.values() for n in _every_number(each)]
    if isinstance(value, list | tuple):
        return [n for each in value for n in _every_number(each)]
    if isinstance(value, float | int) and not isinstance(value, bool):
        return [float(value)]
    return []


# -- faults ---------------------------------------------------------------------------------------


def _some_line(data: bytes, random: Random, change: Callable[[re.Match[str]], str]) -> bytes | None:
    text = data.decode()
    lines = [each for each in _LINE.finditer(text) if re.match(r"[-\d]", each["value"])]
    if not lines:
        return None
    line = random.choice(lines)
    return (text[: line.start()] + change(line) + text[line.end() :]).encode()


def _twice(data: bytes, random: Random) -> bytes | None:
    return _some_line(data, random, lambda line: f"{line[0]}\n{line['key']}{line['mark']}7")


def _unknown(data: bytes, random: Random) -> bytes | None:
    return _some_line(data, random, lambda line: f"{line[0]}\nwhatever{line['mark']}7")


def _quoted(data: bytes, random: Random) -> bytes | None:
    return _some_line(
        data, random, lambda line: f'{line["key"]}{line["mark"]}"{line["value"].split(" #")[0]}"'
    )


def _no_number(data: bytes, random: Random) -> bytes | None:
    number = random.choice(("nan", "inf", "-inf"))
    return _some_line(
        data,
        random,
        lambda line: f"{line['key']}{line['mark']}{number if '=' in line['mark'] else '.nan'}",
    )


def _key(name: str, *values: str) -> Callable[[bytes, Random], bytes | None]:
    """Return a fault that gives some key a value; of a text where it is not there, none."""

    def change(data: bytes, random: Random) -> bytes | None:
        text, value = data.decode(), random.choice(values)
        lines = list(re.finditer(rf"^( *{name}(?: = |: )).*$", text, re.MULTILINE))
        if not lines:
            return None
        line = random.choice(lines)
        return (text[: line.start()] + line[1] + value + text[line.end() :]).encode()

    return change


_FAULTS = {
    "a key twice": _twice,
    "an unknown key": _unknown,
    "a number in quotes": _quoted,
    "NaN or infinity": _no_number,
    "escape in a name": _key("name", r'"a\u001b[31mb"', r'"a\u202eb"', r'"\u009b1m"'),
}
_PLAN_FAULTS = {
    **_FAULTS,
    "exposure of 0 or less": _key("exposures_ms", "[-5]", "[0]", "[10, -1]"),
    "exposure that no sensor takes": _key("exposures_ms", "[1e9]", "[1e-9]"),
    "no exposure": _key("exposures_ms", "[]"),
    "negative seed": _key("seed", "-1"),
    "escape in a feature's name": _key("features", r'["f\u001b[31m1"]', r'["f\u202e1"]'),
}

# -- plans ----------------------------------------------------------------------------------------


def _plan() -> MeasuringPlan:
    small = plan_preset("small")
    pose = (
        (1.0, 0.0, 0.0, 0.0),
        (0.0, 1.0, 0.0, 0.0),
        (0.0, 0.0, 1.0, 600.0),
        (0.0, 0.0, 0.0, 1.0),
    )
    poses = PoseList(
        name="robot",
        notation="fanuc",
        frame="part_from_tcp",
        rows=((20.0, -35.0, -640.0, 0.0, 0.0, 0.0), (20.0, 15.0, -640.0, 5.0, -10.0, 90.0)),
        exposures_ms=(40.0,),
    )
    matrix = PoseList(
        name="one",
        notation="matrix",
        frame="camera_from_part",
        rows=(tuple(number for row in pose for number in row),),
        exposures_ms=(10.0, 20.0),
    )
    return replace(small, seed=4, poses=(poses, matrix), simulated={"lighting": "II"})


_SHORT = """\
format = "exposight measuring plan"
version = 3
name = "near"
sensor = "comet-pro-ae"
features = ["f1", "f2"]
reference = "f1"
seed = 4

[[planes]]
name = "near"
z_tcp_mm = -165
x_mm = { first = -135, last = 135, count = 4 }
y_mm = [-100, 0, 100]
exposures_ms = { first = 5, last = 100, count = 4 }
turns_deg = { w_deg = { first = -10, last = 10, count = 3 } }

[[random]]
name = "any"
count = 5
x_mm = [-10, 10]
y_mm = [-10, 10]
z_tcp_mm = [-100, 50]
exposures_ms = [20]
"""


def _toml_plans(folder: Path) -> list[Sample]:
    whole, short = folder / "whole.toml", folder / "short.toml"
    write_plan(whole, _plan())
    short.write_text(_SHORT)
    return [Sample(whole), Sample(short)]


def _yaml_plans(folder: Path) -> list[Sample]:
    path = folder / "plan.yaml"
    path.write_text(yaml.safe_dump(tomllib.loads(plan_to_toml(_plan())), sort_keys=False))
    short = folder / "short.yml"
    short.write_text(yaml.safe_dump(tomllib.loads(_SHORT), sort_keys=False))
    return [Sample(path), Sample(short)]


def _wrong_plan(plan: MeasuringPlan) -> str:
    names = [plan.name, *(group.name for group in plan.groups), *plan.features, plan.reference]
    names += [name for poses in plan.poses for name in poses.names]
    if not all(map(is_plain, names)):
        return "a name has control characters"
    low, high = plan.sensor.exposure.min_ms, plan.sensor.exposure.max_ms
    for group in plan.groups:
        if not all(low <= time_ms <= high for time_ms in group.exposures_ms):
            return f"exposure times beyond the sensor's of {group.name!r}"
        if group.n_views < 1 or not np.isfinite(_every_number(asdict(group))).all():
            return f"{group.name!r} has numbers that are none"
    if plan.n_captures > 1_000_000 or plan.seed < 0:
        return "counts beyond all measure"
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "again.toml"
        write_plan(path, plan)
        again = read_plan(path)
    return "" if again == plan else "written and read again it is another"


# -- lists of poses -------------------------------------------------------------------------------

_POSES = """\
name,x_mm,y_mm,z_mm,w_deg,p_deg,r_deg,exposures_ms
left,20,-35,-640,0,0,0,10 20
right,20,15,-640,5,-10,90,40
"""


def _pose_lists(folder: Path) -> list[Sample]:
    path = folder / "poses.csv"
    path.write_text(_POSES)
    return [Sample(path)]


def _read_poses(path: Path) -> PoseList:
    given = read_pose_table(path, "", (10.0,))
    return PoseList(name="robot", frame="part_from_tcp", exposures_ms=(10.0,), **given)


def _wrong_poses(poses: PoseList) -> str:
    plan = replace(_plan(), poses=(poses,))
    low, high = 1e-9, 3.6e6
    if not all(low <= time_ms <= high for time_ms in poses.exposures_ms):
        return "an exposure time beyond an hour"
    if not all(map(is_plain, poses.names)):
        return "a name has control characters"
    if not np.isfinite(_every_number(poses.rows)).all():
        return "numbers that are none"
    return "" if plan.n_captures < 1e6 else "too many"


# -- limits, sequences, scenes, the simulated cell ------------------------------------------------


def _limits(folder: Path) -> list[Sample]:
    path = folder / "limits.toml"
    path.write_text(
        "[scanner]\nmin_ms = 0.5\nmax_ms = 200\nincrement_ms = 0.125\nallowed_ms = [5, 10, 20]\n"
        'least_per_view = 1\nmost_per_view = 4\nflicker_hz = 50\nunit = "ms"\nlowest_wins = true\n'
        'source = "its manual"\n'
    )
    plain = folder / "plain.toml"
    plain.write_text("[eye]\nmin_ms = 0.5\nmax_ms = 200\nincrement_ms = 0.5\n")
    return [Sample(path), Sample(plain)]


def _wrong_limits(limits: ExposureLimits) -> str:
    if not 0 < limits.min_ms <= limits.max_ms <= 3.6e6 or limits.increment_ms < 1e-6:
        return "limits that are none"
    if not is_plain(limits.name + limits.source):
        return "a name has control characters"
    settings = limits.settings(limits.min_ms, limits.max_ms)
    if not len(settings) or not all(limits.allows(each) for each in settings.tolist()):
        return "settings that it does not allow"
    return "" if limits.least_per_view >= 1 else "counts below 1"


def _sequences(folder: Path) -> list[Sample]:
    samples = []
    for name, sequence in SEQUENCE_PRESETS.items():
        path = folder / f"{name}.toml"
        path.write_text(sequence_to_toml(sequence), encoding="utf-8")
        samples.append(Sample(path))
    return samples


def _wrong_sequence(sequence: PatternSequence) -> str:
    if not 1 <= min(sequence.projector_width, sequence.projector_height) <= 100_000:
        return "a projector of no size"
    if max(sequence.projector_width, sequence.projector_height) > 100_000:
        return "a projector beyond all measure"
    if not np.isfinite(_every_number(asdict(sequence))).all():
        return "numbers that are none"
    if not is_plain(sequence.name + sequence.file_pattern):
        return "a name has control characters"
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "again.toml"
        path.write_text(sequence_to_toml(sequence), encoding="utf-8", newline="\n")
        again = read_sequence(path)
    return "" if again == sequence else "written and read again it is another"


_SCENE = """\
format = "exposight scene"
version = 1
name = "door"
mesh = ["door.ply"]
features = "features.csv"
sensor = "sensor.json"
unit = "mm"
crease_deg = 25.5
finish = "old"
colours = { "#1e90ff" = "paint" }

[surfaces.old]
diffuse_albedo = 0.25
mirror_reflectance = 0.5
alpha_along = 0.25
alpha_across = 0.375

[[zones]]
finish = "primer"
radius_mm = 12.5
centre_mm = [1.0, 2.0, 3.0]
"""


def _scenes(folder: Path) -> list[Sample]:
    path = folder / "scene.toml"
    path.write_text(_SCENE)
    return [Sample(path)]


def _read_scene(path: Path) -> SceneDocument:
    return find_scene(path)[0]


def _wrong_scene(document: SceneDocument) -> str:
    numbers = _every_number([asdict(zone) for zone in document.zones])
    numbers += _every_number([asdict(each) for each in document.surfaces.values()])
    if not np.isfinite([*numbers, document.crease_deg]).all() or not (
        0 <= document.crease_deg <= 90
    ):
        return "numbers that are none"
    names = [document.name or "", *document.surfaces]  # paths are as files are called
    if not all(map(is_plain, names)):
        return "a name has control characters"
    content = SCENE_FORMAT.to_json(document)
    again = SCENE_FORMAT.from_json(content, "again")
    return "" if again == document else "written and read again it is another"


_CELL = """\
lighting = 0.125
lamp = 0.75
rings_only = true
finish = "primer"
kinematic_share = { near = 0.5 }

[alignment]
photogrammetric_mm = 0.125
kinematic_mm = [1.0, 2.0, 3.0]

[sensor.camera]
electrons_per_ms = 1000.5

[[zones]]
finish = "paint"
box_mm = [[0.0, 0.0, 0.0], [1.0, 2.0, 3.0]]
"""


def _cells(folder: Path) -> list[Sample]:
    plan = folder / "plan.toml"
    plan.write_text(_SHORT + "\n" + tomli_w.dumps({"simulated": tomllib.loads(_CELL)}))
    return [Sample(plan)]


def _read_cell(path: Path) -> SimulatedCellSettings:
    plan = read_plan(path)
    settings = SimulatedCellSettings.of_plan(plan, path.parent)
    sensor_settings(plan.sensor, settings.sensor)  # as the cell does with what is the sensor's
    return settings


def _wrong_cell(settings: SimulatedCellSettings) -> str:
    table = settings.table()
    if not np.isfinite(_every_number(table)).all():
        return "numbers that are none"
    if settings.lamp is not None and not 0 < settings.lamp < math.inf:
        return "a lamp of no power"
    if not all(0 <= share <= 1 for share in settings.kinematic_share.values()):
        return "a share beyond 1"
    again = SimulatedCellSettings.of_table(
        tomllib.loads(tomli_w.dumps(_toml(table))), Path(), "again"
    )
    return "" if again.table() == table else "written and read again they are others"


def _toml(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _toml(each) for key, each in value.items()}
    return [_toml(each) for each in value] if isinstance(value, list | tuple) else value


FORMATS = (
    Format("measuring plan TOML", _toml_plans, read_plan, _wrong_plan, _PLAN_FAULTS),
    Format("measuring plan YAML", _yaml_plans, read_plan, _wrong_plan, _FAULTS),
    Format("pose list of a plan", _pose_lists, _read_poses, _wrong_poses),
    Format(
        "exposure limits TOML",
        _limits,
        lambda path: limits_named(str(path)),
        _wrong_limits,
        {
            "a key twice": _twice,
            "an unknown key": _unknown,
            "a number in quotes": _quoted,
            "NaN or infinity": _no_number,
            "limits below 0": _key("min_ms", "0", "-1"),
            "counts below 1": _key("least_per_view", "0", "-3", "1.5"),
        },
    ),
    Format("scene TOML", _scenes, _read_scene, _wrong_scene, _FAULTS),
    Format("pattern sequence TOML", _sequences, read_sequence, _wrong_sequence, _FAULTS),
    Format("settings of the simulated cell", _cells, _read_cell, _wrong_cell, _PLAN_FAULTS),
)
