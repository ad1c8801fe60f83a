"""How the study's scores depend on the image in which a ring's brightness is measured.

Run with ``make bench NAME=stripes``; some five minutes on two cores. The paper averages i_avg in
"the initial stripe pattern" and does not say how fine that is; the twin takes the first image of
its 64 periods (`StripeSensor.sequence`). Here the structured-light captures of the quick study are
taken once, and brightness is read from other stripe images of the same captures, or as another
statistic of the same image (Sect. 3.3.8). p_norm, poses, exposure times, splits, kernels and starts
are the same for all readings. Nothing is chosen by what comes out: the study keeps its reading.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import closing
from dataclasses import replace
from functools import cache, partial
from typing import TypeAlias

from benchmarks.measuring import Figure, publish, say
from exposight.models import Training
from exposight.observing import (
    Observation,
    ObservationTable,
    observe_capture,
    point_search,
    ring_brightness,
    view_features,
)
from exposight.paper import (
    CAMPAIGNS,
    DATASETS,
    VARIANTS,
    StudySettings,
    build_dataset,
    campaign_plan,
    score_variant,
)
from exposight.plans import MeasuringPlan, PlannedView, view_seed
from exposight.twin import SimulatedCell
from exposight.twin.light import SceneTracer
from exposight.twin.part import door
from exposight.twin.sensors import StripeSensor, ring_boxes
from exposight.workers import LocalProcesses

_WORKERS = 2
_SETTINGS = StudySettings(sensors=("structured-light",), quick=True)
_CAMPAIGNS = ("inside", "finer")
"""Campaigns that the judged variants learn from and are judged by."""

_JUDGED = (
    ("q1", "q_k1", "test", "percent"),
    ("q4", "q_k4", "test", "percent"),
    ("e1", "e_k1", "test", "ms"),
    ("e6", "e_k6", "test_inside", "ms"),
)
"""Short name, variant, which unseen features judge it, and the unit of its RMSE."""

Rings: TypeAlias = Mapping[int, Mapping[str, float]]
"""One ring in one capture: its grey values in several frames, by their numbers."""

_COARSE, _MIDDLE, _FINE = (0, 1, 2, 3), (4, 5, 6, 7), (8, 9, 10, 11)
"""Frames of 1, 8 and 64 periods in the twin's sequence, a quarter of a period apart."""

READINGS: dict[str, Callable[[Rings], float]] = {
    "first_of_64": lambda ring: ring[_FINE[0]]["i_avg"],
    "first_of_8": lambda ring: ring[_MIDDLE[0]]["i_avg"],
    "first_of_1": lambda ring: ring[_COARSE[0]]["i_avg"],
    "mean_of_64": lambda ring: sum(ring[i]["i_avg"] for i in _FINE) / len(_FINE),
    "p95_of_64": lambda ring: ring[_FINE[0]]["i_p95"],
    "median_of_64": lambda ring: ring[_FINE[0]]["i_median"],
}
"""A ring's brightness, grey level 0–255, by what it is called here; the study's comes first."""


def observe_view(plan: MeasuringPlan, view: PlannedView) -> dict[str, list[Observation]]:
    """Take a view's captures and observe each by every reading.

    The captures are those of `exposight.measuring.measure_observations`, but that their frames
    are kept until they are read.
    """
    scanner = StripeSensor(sensor=plan.sensor)
    pose = SimulatedCell.for_plan(plan).reported_pose(view.camera_from_part, view.name)
    part = plan.observed_part(door().part)
    seen = view_features(part, scanner.sensor, pose)
    boxes = ring_boxes(part, scanner.sensor, pose)
    light = scanner.look(_tracer(), view.camera_from_part, boxes)
    observed: dict[str, list[Observation]] = {name: [] for name in READINGS}
    for exposure_ms in view.exposures_ms:
        seed = (*view_seed(plan.seed, view.name), round(1000 * exposure_ms))
        stacks = scanner.frames(light, exposure_ms, seed)
        capture = scanner.capture(light, exposure_ms, view=view.name, seed=seed)
        capture = replace(capture, camera_from_part=pose)
        shots = {
            i: replace(capture, image=scanner.whole_frame(light, stacks, i))
            for i in (_COARSE[0], _MIDDLE[0], *_FINE)
        }
        search = point_search(capture.require_cloud(), scanner.sensor.camera)
        rows = observe_capture(capture, seen, search)
        for row, place in zip(rows, seen, strict=True):
            if row.p_norm is None:
                continue
            ring = {i: ring_brightness(s, place.rows, place.columns) for i, s in shots.items()}
            for name, read in READINGS.items():
                observed[name].append(replace(row, i_avg=read(ring)))
    return observed


@cache
def _tracer() -> SceneTracer:
    return SceneTracer(door())


def observe(name: str) -> dict[str, ObservationTable]:
    """Carry out one of the study's campaigns, as far as the quick study does, by every reading."""
    (campaign,) = (own for own in CAMPAIGNS if own.name == name)
    plan = campaign_plan(campaign, quick=_SETTINGS.quick)
    planned = plan.views(door().part)
    say(f"measuring {name}: {len(planned)} views")
    found = {}
    work = partial(observe_view, plan)
    with closing(LocalProcesses(_WORKERS).run(work, planned)) as results:
        for view, observed in results:
            found[view.name] = observed
    return {
        reading: ObservationTable.from_observations(
            [row for view in planned for row in found[view.name][reading]]
        )
        for reading in READINGS
    }


def judge(task: tuple[str, Mapping[str, ObservationTable]]) -> list[Figure]:
    """Train the judged variants on what a reading observed, and judge them on unseen features.

    Parameters
    ----------
    task : (str, mapping of str to ObservationTable)
        The reading's name, and its observations by campaign.
    """
    reading, tables = task
    datasets = {
        own.name: build_dataset(own, tables, _SETTINGS)
        for own in DATASETS
        if own.sensor in _SETTINGS.sensors
    }
    variants = {variant.name: variant for variant in VARIANTS}
    figures = []
    for short, name, role, unit in _JUDGED:
        variant = variants[name]
        rows = datasets[variant.dataset].train
        if rows is None:
            msg = f"dataset {variant.dataset} has no training side"
            raise RuntimeError(msg)
        specification, seed = variant.specification, _SETTINGS.seed
        model = Training(specification=specification, table=rows, seed=seed, restarts=1).run()
        (score,) = (
            own.score
            for own in score_variant(variant, model, datasets)
            if own.evaluation.role == role
        )
        if score is None:
            msg = f"no unseen observation judges {name}"
            raise RuntimeError(msg)
        rmse = 100.0 * score.rmse if unit == "percent" else score.rmse
        figures += [
            Figure(name=f"{reading}_{short}_r2_percent", value=score.r2_percent, unit="%"),
            Figure(name=f"{reading}_{short}_rmse_{unit}", value=rmse, unit=variant.unit),
        ]
    return figures


def main() -> None:
    """Measure once, read brightness in every way, and train on each."""
    observed = {name: observe(name) for name in _CAMPAIGNS}
    tasks = [
        (reading, {name: tables[reading] for name, tables in observed.items()})
        for reading in READINGS
    ]
    say("training and judging")
    with closing(LocalProcesses(_WORKERS).run(judge, tasks)) as results:
        judged = {reading: figures for (reading, _), figures in results}
    figures = [figure for reading in READINGS for figure in judged[reading]]
    publish("brightness read in other stripe images", figures)


if __name__ == "__main__":
    main()
