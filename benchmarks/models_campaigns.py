"""The campaigns by which models of brightness and quality are judged, simulated once and kept.

Tables are kept in exposight's cache, in ``models-bench``, under names that carry a checksum of
plan, cell and version. A change of the cell's code alone does not change the version: remove the
folder then.
"""

from __future__ import annotations

import json
import os
import runpy
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Final, Literal

import numpy as np

from benchmarks.measuring import say
from benchmarks.relit_cell import ScatterCell, TwoLobesCell
from exposight import __version__
from exposight.cell import ActiveSensor, Capture, MemoryCampaign, Part, sensor_preset
from exposight.files import KeptFiles, make_folder, sha256_of
from exposight.geometry import RigidTransform, read_projector_camera
from exposight.imaging import (
    decode,
    re_expose,
    read_recording,
    sequence_named_or_read,
    stack_images,
)
from exposight.measuring import measure_observations
from exposight.observing import ObservationTable, observe_campaign, read_observations
from exposight.paper import CAMPAIGNS, campaign_plan
from exposight.plans import MeasuringPlan, plan_preset, plan_to_toml
from exposight.plans.positions import RandomPositions, logarithmic_exposures
from exposight.statistics import split_by_group
from exposight.twin import SimulatedCell
from exposight.twin.part.car_door import cache_folder

COMET: Final = sensor_preset("comet-pro-ae")
VISARD: Final = sensor_preset("rc-visard-65")
KNOWN: Final = tuple(f"f{number}" for number in range(1, 10))
UNSEEN: Final = tuple(f"f{number}_test" for number in range(1, 5))
SEEDS: Final = (1, 2, 3)
WORKERS: Final = 2

Side = Literal["train", "test"]

_TEST_SEEDS = 100  # a test's seed is so much more than its training's
_LONGEST_MS = 500.0


@dataclass(frozen=True, kw_only=True)
class Condition:
    """What the part is made of, and how it is measured.

    Parameters
    ----------
    name : str
    views, exposures : int
        Random new views of the test, and exposure times in each.
    thinned : bool
        Train on every second row of the grid and every second exposure time.
    settings : mapping of str to object
        Of the simulated cell.
    cell : type
        The cell.
    sensor : ActiveSensor
        With two cameras: whole frames of the quick study's grid.
    """

    name: str
    views: int = 10
    exposures: int = 14
    thinned: bool = True
    settings: Mapping[str, Any] = field(default_factory=dict)
    cell: type[SimulatedCell] = SimulatedCell
    sensor: ActiveSensor = COMET

    @property
    def stereo(self) -> bool:
        """Whether two cameras match dots."""
        return len(self.sensor.cameras) > 1


_BY_KINEMATICS = {"near": 1.0, "middle": 1.0, "far": 1.0, "random": 1.0}
_MANY: Mapping[str, Any] = {"views": 24, "exposures": 22, "thinned": False}

CONDITIONS: Final = (
    Condition(name="bare", **_MANY),
    Condition(name="primer", settings={"finish": "primer"}),
    Condition(name="paint", settings={"finish": "paint"}),
    Condition(name="brushed", settings={"finish": "brushed"}),
    Condition(name="two_lobes", cell=TwoLobesCell),
    Condition(name="foreign_surface", cell=ScatterCell),
    Condition(name="one_image", settings={"sensor": {"image": "first"}}, **_MANY),
    Condition(name="kinematics", settings={"kinematic_share": _BY_KINEMATICS}, **_MANY),
    Condition(name="stereo", views=6, exposures=6, sensor=VISARD),
)
"""In the order in which they are measured. Surfaces hold for the whole part; but for
``kinematics``, views are aligned by photogrammetry."""


def training_plan(condition: Condition, seed: int) -> MeasuringPlan:
    """Return the grid of views from which a condition is learnt, of the features `KNOWN`."""
    if condition.stereo:
        (stereo,) = (each for each in CAMPAIGNS if each.name == "stereo-inside")
        plan = campaign_plan(stereo, quick=True)
    else:
        plan = plan_preset("inside")
    if condition.thinned and not condition.stereo:
        planes = (
            replace(each, y_mm=each.y_mm[::2], exposures_ms=each.exposures_ms[::2])
            for each in plan.planes
        )
        plan = replace(plan, planes=tuple(planes))
    return replace(plan, features=KNOWN, simulated={}, seed=seed)


def test_plan(condition: Condition, seed: int) -> MeasuringPlan:
    """Return random new views of a condition, of all features."""
    box: dict[str, Any] = {"x_mm": (-230, 230), "y_mm": (-200, 200), "z_tcp_mm": (-165, 155)}
    if condition.stereo:  # between its planes' own grids
        box = {"x_mm": (-180, 180), "y_mm": (-125, 50), "z_tcp_mm": (-165, 155)}
        times_ms = logarithmic_exposures(0.07, 18.0, condition.exposures, condition.sensor)
    else:
        times_ms = whole_milliseconds(3.0, _LONGEST_MS, condition.exposures)
    views = RandomPositions(name="random", count=condition.views, exposures_ms=times_ms, **box)
    return MeasuringPlan(
        name="new-views",
        sensor=condition.sensor,
        features=(*KNOWN, *UNSEEN),
        reference="f1",
        random=(views,),
        blind_views="skip",
        seed=_TEST_SEEDS + seed,
    )


def whole_milliseconds(low_ms: float, high_ms: float, count: int) -> tuple[float, ...]:
    """Return different whole numbers between two at about equal ratios."""
    times_ms = np.geomspace(low_ms, high_ms, count).round()
    for i in range(1, count):  # the shortest ones would be alike
        times_ms[i] = max(times_ms[i], times_ms[i - 1] + 1.0)
    return tuple(times_ms.tolist())


@dataclass(frozen=True, kw_only=True, eq=False)
class TrainAndTest:
    """What a condition gave for one seed.

    Parameters
    ----------
    train, test : ObservationTable
        All rows, those not measured included.
    """

    train: ObservationTable
    test: ObservationTable


def tables(condition: Condition, seed: int) -> TrainAndTest:
    """Return a condition's observations, simulated where they are not kept."""
    return TrainAndTest(
        train=_observed(condition, training_plan(condition, seed), "train"),
        test=_observed(condition, test_plan(condition, seed), "test"),
    )


def kept_folder() -> Path:
    """Return the folder in which tables, and models of the paper, are kept."""
    return make_folder(cache_folder() / "models-bench")


def _observed(condition: Condition, plan: MeasuringPlan, side: Side) -> ObservationTable:
    settings = dict(condition.settings)
    shares = settings.get("kinematic_share")
    if shares:
        groups = [group.name for group in plan.groups]
        settings["kinematic_share"] = {name: shares[name] for name in groups}
    cell = condition.cell.for_plan(plan, rings_only=not condition.stereo, **settings)
    return observed(f"{condition.name}-{side}-{plan.seed}", plan, cell)


def observed(name: str, plan: MeasuringPlan, cell: SimulatedCell) -> ObservationTable:
    """Return what a plan gives, simulated where it is not kept."""
    description = json.dumps(cell.description(), sort_keys=True, default=str)
    kept = KeptFiles(kept_folder(), plan_to_toml(plan), description, __version__)
    name = f"{name}.parquet"
    if kept.find(name) is None:
        say(f"measuring {name.removesuffix('.parquet')}: {plan.n_captures} captures")
        measure_observations(plan, cell, table_path=kept.path(name), workers=WORKERS)
        kept.seal(name)
    return read_observations(kept.path(name))


def skull() -> tuple[TrainAndTest, ActiveSensor] | None:
    """Return the measured rows of the recorded skull, half of its features to train on.

    Its exposure sweep is emulated (``examples/05_skull.py``); captures keep what their frame stack
    tells. None where the recording is not there (`benchmarks.real`).
    """
    folder = Path(os.environ.get("EXPOSIGHT_REAL_DATA", "../shared/data/real")) / "skull"
    if not folder.is_dir():
        return None
    example = runpy.run_path(str(_SKULL_EXAMPLE))
    sequence = sequence_named_or_read(_SKULL)
    rig = read_projector_camera(folder / "calibration.xml")
    recorded = read_recording(folder / _SKULL, sequence, exposure_ms=example["NOMINAL_MS"])
    sensor: ActiveSensor = example["sensor_of"](rig, example["cloud_of"](recorded, _SKULL, rig))
    kept = KeptFiles(kept_folder(), sha256_of(_SKULL_EXAMPLE.read_bytes()), __version__)
    name = "skull.parquet"
    if kept.find(name) is None:
        say("emulating the skull's exposure sweep")
        cloud = example["cloud_of"](recorded, _SKULL, rig)
        placed = example["place_features"](cloud, sensor, 220, np.random.default_rng(1))
        captures = []
        for exposure_ms in example["EXPOSURES_MS"]:
            factor = exposure_ms / example["NOMINAL_MS"]
            stack = recorded if factor == 1 else re_expose(recorded, factor)
            capture = Capture(
                view="skull",
                exposure_ms=exposure_ms,
                image=stack.frames[0],  # its finest fringes
                brightness_source="stripe",
                stack=stack_images(stack, sequence, decode(stack, sequence)),
                cloud=example["cloud_of"](stack, _SKULL, rig),
                camera_from_part=RigidTransform(),
                emulated=stack.emulated,
            )
            captures.append(capture)
        part = Part(name="skull", features=placed)
        campaign = MemoryCampaign(name="skull", sensor=sensor, part=part, captures=captures)
        observe_campaign(campaign).write(kept.path(name))
        kept.seal(name)
    table = read_observations(kept.path(name)).measured()
    split = split_by_group(table.names("feature"), 0.5, np.random.default_rng(1))
    trains = np.isin(np.arange(len(table)), split.train)
    return TrainAndTest(train=table.where(trains), test=table.where(~trains)), sensor


_SKULL = "skull_2x3"
_SKULL_EXAMPLE = Path(__file__).parents[1] / "examples" / "05_skull.py"


def everything() -> Iterator[tuple[Condition, int, TrainAndTest]]:
    """Yield every condition's tables, seed after seed."""
    for seed in SEEDS:
        for condition in CONDITIONS:
            yield condition, seed, tables(condition, seed)


if __name__ == "__main__":
    for measured, number, both in everything():
        say(f"{measured.name}, seed {number}: {len(both.train)} and {len(both.test)} rows")
