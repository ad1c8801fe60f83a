"""``exposight simulate``: a measuring plan to a campaign, in a cell made of physics."""

from __future__ import annotations

import time
from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from shlex import quote
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter
from cyclopts.types import PositiveInt

from exposight.cell import preset_name
from exposight.cli.app import UsageError
from exposight.cli.observe import visibility_table
from exposight.cli.progress import progress_bars
from exposight.cli.result import Result, Written, fact
from exposight.errors import InputError, MissingFileError, did_you_mean
from exposight.measuring import (
    OBSERVATIONS_FILE,
    check_table_path,
    measure,
    measure_observations,
    views_folder,
)
from exposight.plans import PLAN_SUFFIXES, PLANS, read_plan
from exposight.tables import Column, Table, count, counted, number
from exposight.twin import SimulatedCell, scene_at
from exposight.twin.part import FEATURES_FILE, MESH_FILE, SENSOR_FILE, export_scene
from exposight.workers import usual_workers

if TYPE_CHECKING:
    from exposight.cli.result import Fact
    from exposight.plans import MeasuringPlan, PlannedView
    from exposight.workers import Progress


def simulate_command(
    plan: str | None = None,
    /,
    *,
    output: Annotated[Path | None, Parameter(alias="-o", metavar="FOLDER|FILE")] = None,
    rings_only: bool = False,
    no_clouds: bool = False,
    raw_frames: bool = False,
    observe: bool = False,
    workers: PositiveInt | None = None,
    cluster: Annotated[str | None, Parameter(metavar="ADDRESS")] = None,
    scene: Path | None = None,
    export_scene_to: Annotated[Path | None, Parameter("--export-scene")] = None,
    list_plans: Annotated[bool, Parameter("--list")] = False,
) -> Result:
    """Carry out a measuring plan in a simulated cell.

    A sensor looks at a car door of bare sheet metal from every view and at every exposure time of
    the plan; clouds lack points where images clip, stay dark, or lie in shadow, as real ones do.
    The campaign is a folder like a recorded one. Run the same command again after an interruption
    and it goes on; the result is the same for any number of workers, here or on a cluster, to the
    last byte.

    For example:

        exposight simulate small --rings-only -o door

        exposight simulate x --rings-only --observe -o observations.csv

    Parameters
    ----------
    plan
        Measuring plan: a TOML or YAML file (docs/formats.md), or a name from --list.
    output
        Folder of the campaign (campaign by default); with --observe the observation table, .csv or
        .parquet (observations.csv).
    rings_only
        Take only the neighbourhoods of the features' rings: p_norm and i_avg are the same as from
        whole frames, in a fraction of the time.
    no_clouds
        Do not keep point clouds: captures are observed as they are taken, and the campaign holds
        images, poses and observations.csv, which cannot be repeated from it.
    raw_frames
        Keep every frame that a cloud was computed from beside it, for decode to read.
    observe
        Observe captures at once, and write the table instead of a campaign.
    workers
        Run tasks in parallel, in this many processes; one for each core by default, at most 8.
    cluster
        Run tasks on a Dask scheduler's workers, tcp://host:8786. All need this version of exposight
        and, unless with --observe, must reach the campaign's folder at the same path.
    scene
        Another part than the built-in door: a folder as --export-scene writes it.
    export_scene_to
        Write the scene's mesh, features and sensor for other programs, and leave.
    list_plans
        List the plans that have a name, and leave.
    """
    if list_plans:
        if plan is not None:
            msg = f"--list lists all plans; exposight info {plan} describes one"
            raise UsageError(msg)
        return _plans()
    if plan is None:
        msg = "give a measuring plan: a TOML or YAML file, or a name from --list"
        raise UsageError(msg)
    if observe and (no_clouds or raw_frames):
        msg = "--observe keeps neither clouds nor frames: leave out --no-clouds and --raw-frames"
        raise UsageError(msg)
    if scene is not None and not (scene / MESH_FILE).is_file():
        msg = (
            f"no mesh at {scene / MESH_FILE}; expected a folder as this command makes it: "
            "exposight simulate PLAN --export-scene FOLDER"
        )
        raise MissingFileError(msg)
    chosen = plan_from(plan)
    if export_scene_to is not None:
        if observe or rings_only or no_clouds or raw_frames or output is not None:
            msg = (
                "--export-scene simulates nothing: leave out --output, --observe, --rings-only, "
                "--no-clouds and --raw-frames"
            )
            raise UsageError(msg)
        return _export(chosen, scene, export_scene_to)
    output = output or Path("observations.csv" if observe else "campaign")
    if observe:
        check_table_path(output)  # before anything that takes time
    changes = {"rings_only": rings_only, "raw_frames": raw_frames, "scene": scene}
    start = time.perf_counter()
    with progress_bars(kept_in=views_folder(output) if observe else output) as progress:
        progress("preparing the scene", 0, 0)
        run = _Run(
            plan=chosen,
            cell=SimulatedCell.for_plan(
                chosen,
                folder=None if plan in PLANS else Path(plan).parent,
                **{name: value for name, value in changes.items() if value},
            ),
            clouds=not no_clouds,
            workers=workers or (1 if cluster else usual_workers()),
            cluster=cluster,
            start=start,
        )
        return _observed(run, output, progress) if observe else _simulated(run, output, progress)


@dataclass(frozen=True, kw_only=True)
class _Run:
    """A plan, the cell that carries it out, and how."""

    plan: MeasuringPlan
    cell: SimulatedCell
    clouds: bool
    workers: int
    cluster: str | None
    start: float

    @property
    def views(self) -> tuple[PlannedView, ...]:
        return self.plan.views(self.cell.part)


class _Captures:
    """Hands progress on, and remembers how many captures there were before."""

    def __init__(self, progress: Progress, title: str) -> None:
        self._progress, self._title = progress, title
        self.before: int | None = None
        self.total = 0

    def __call__(self, stage: str, done: int, total: int) -> None:
        if stage != "measuring":
            self._progress(stage, 0, 0)
            return
        if self.before is None:
            self.before = done
        self.total = total
        self._progress(self._title, done, total)


def _simulated(run: _Run, output: Path, progress: Progress) -> Result:
    file = Written.at(output, "campaign")
    captures = _Captures(progress, f"simulating {run.plan.name}")
    measure(
        run.plan,
        run.cell,
        output,
        clouds=run.clouds,
        workers=run.workers,
        cluster=run.cluster,
        progress=captures,
    )
    size = sum(path.stat().st_size for path in output.rglob("*") if path.is_file())
    observed = output / OBSERVATIONS_FILE
    next_step = f"observe {quote(str(output))}"
    if not run.clouds:
        next_step = f"train {quote(str(observed))}"
    return Result(
        title=f"{run.plan.name}: {_sensor(run.plan)}",
        facts=(
            *_facts(run, captures),
            fact("clouds", run.clouds, ""),
            fact("raw_frames", run.cell.settings.raw_frames, ""),
            fact("bytes", size, f"{number(size / 1e6, 3)} MB"),
        ),
        files=(file,)
        if run.clouds
        else (file, Written(kind="observations", path=observed, replaced=False)),
        notes=_blind(run),
        next_step=next_step,
    )


def _observed(run: _Run, output: Path, progress: Progress) -> Result:
    file = Written.at(output, "observations")
    captures = _Captures(progress, f"simulating and observing {run.plan.name}")
    table = measure_observations(
        run.plan,
        run.cell,
        table_path=output,
        workers=run.workers,
        cluster=run.cluster,
        progress=captures,
    )
    return Result(
        title=f"{run.plan.name}: {_sensor(run.plan)}",
        facts=(
            *_facts(run, captures),
            fact("rows", len(table)),
        ),
        tables=(visibility_table(table),),
        files=(file,),
        notes=_blind(run),
        next_step=f"train {quote(str(output))}",
    )


def _views_of_feature(run: _Run) -> dict[str, int]:
    """Return in how many views each feature can be seen."""
    visible = Counter(name for view in run.views for name in view.visible)
    return {name: visible[name] for name in run.plan.features}


def _blind(run: _Run) -> tuple[str, ...]:
    blind = [name for name, n in _views_of_feature(run).items() if not n]
    return (f"no view sees {', '.join(blind)}",) if blind else ()


def _facts(run: _Run, captures: _Captures) -> tuple[Fact, ...]:
    planned, seconds = run.views, time.perf_counter() - run.start
    exposures = [exposure_ms for view in planned for exposure_ms in view.exposures_ms]
    before = captures.before or 0
    there = f", {count(before)} of them were there before" if before else ""
    aligned = [run.cell.alignment(view.name).aligned_by for view in planned]
    processes = min(run.workers, max(1, len(planned)))  # a view is done by one of them
    where = run.cluster or counted(processes, "worker")
    visible = _views_of_feature(run)
    return (
        fact("plan", run.plan.name, ""),
        fact("sensor", _sensor(run.plan), ""),
        fact("part", run.cell.part.name),
        fact("rings_only", run.cell.settings.rings_only),
        fact("views", len(planned)),
        fact("views_aligned_by_kinematics", aligned.count("kinematics")),
        fact(
            "views_of_feature",
            visible,
            f"{sum(1 for n in visible.values() if n)} of {len(visible)} features are visible",
        ),
        fact("captures", captures.total, count(captures.total) + there),
        fact("captures_before", before, ""),
        fact(
            "exposures_ms",
            {"min": min(exposures), "max": max(exposures)},
            f"{number(min(exposures))} to {number(max(exposures))}",
        ),
        fact("workers", None if run.cluster else processes, ""),
        fact("cluster", run.cluster, ""),
        fact("seconds", seconds, f"{number(seconds, 3)}, {where}"),
    )


def _export(plan: MeasuringPlan, scene: Path | None, folder: Path) -> Result:
    shown = scene_at(scene)
    files = tuple(
        Written.at(folder / name, kind)
        for name, kind in (
            (MESH_FILE, "mesh"),
            (FEATURES_FILE, "features"),
            (SENSOR_FILE, "sensor"),
        )
    )
    export_scene(folder, shown, plan.sensor)
    facts = (
        fact("triangles", len(shown.faces)),
        fact("features", len(shown.part.features)),
        fact("sensor", _sensor(plan)),
    )
    return Result(facts=facts, files=files)


def _plans() -> Result:
    rows = []
    for plan in PLANS.values():
        facts = {fact.name: fact.value for fact in plan_summary(plan)}
        exposures = [exposure_ms for group in plan.groups for exposure_ms in group.exposures_ms]
        rows.append(
            {
                **{name: facts[name] for name in ("plan", "sensor", "captures")},
                "features": len(plan.features),
                "views": sum(facts["views"].values()),  # type: ignore[attr-defined]
                "exposure_min_ms": min(exposures),
                "exposure_max_ms": max(exposures),
            }
        )
    columns = (
        *(Column(name=name) for name in ("plan", "sensor", "features", "views", "captures")),
        Column(name="exposure_min_ms", label="min\nms"),
        Column(name="exposure_max_ms", label="max\nms"),
    )
    title = "Measuring plans (views that see none of their features are left out)"
    return Result(tables=(Table.of("plans", rows, columns, title=title),))


def plan_from(name_or_path: str) -> MeasuringPlan:
    """Return the measuring plan that a preset's name or a file describes.

    Raises
    ------
    InputError
        If it is neither.
    FileError
        If the file is not a plan.
    """
    if name_or_path in PLANS:
        return PLANS[name_or_path]
    path = Path(name_or_path)
    if path.is_file() or path.suffix.lower() in PLAN_SUFFIXES:
        return read_plan(path)
    msg = (
        f"no measuring plan '{name_or_path}': expected a TOML or YAML file, or one of "
        f"{', '.join(PLANS)}{did_you_mean(name_or_path, PLANS)}"
    )
    raise InputError(msg)


def _sensor(plan: MeasuringPlan) -> str:
    """Return the name of a plan's sensor: that of its preset, where it is one."""
    return preset_name(plan.sensor) or plan.sensor.name


def plan_summary(plan: MeasuringPlan) -> tuple[Fact, ...]:
    """Return what a measuring plan holds."""
    positions = {group.name: group.n_views for group in plan.groups}
    exposures = {group.name: list(group.exposures_ms) for group in plan.groups}
    captures = sum(n * len(exposures[name]) for name, n in positions.items())
    per_group = ", ".join(f"{name} {count(n)}" for name, n in positions.items())
    # Which views see no feature depends on the part, which is not known here.
    at_most = "at most " if plan.blind_views == "skip" else ""
    each = (f"{name} {', '.join(f'{t:g}' for t in times)}" for name, times in exposures.items())
    return (
        fact("plan", plan.name),
        fact("sensor", _sensor(plan)),
        fact("side", plan.side),
        fact("lighting", plan.simulated.get("lighting", "I")),
        fact("features", plan.features),
        fact("views", positions, f"{at_most}{count(sum(positions.values()))}: {per_group}"),
        fact("exposures_ms", exposures, "\n".join(each)),
        fact("captures", captures, at_most + count(captures)),
        fact("seed", plan.seed),
    )
