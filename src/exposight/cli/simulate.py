"""``exposight simulate``: a measuring plan to a campaign, in a cell made of physics."""

from __future__ import annotations

import time
from collections import Counter
from pathlib import Path
from shlex import quote
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter
from cyclopts.types import PositiveInt

from exposight import twin  # noqa: F401  (before plans, which it imports)
from exposight.cell import sensor_preset
from exposight.cli.app import UsageError
from exposight.cli.observe import visibility_table
from exposight.cli.progress import progress_bars
from exposight.cli.result import Result, Written, fact
from exposight.errors import InputError, MissingFileError, did_you_mean
from exposight.plans import PLAN_SUFFIXES, PLANS, DepthPlane, read_plan, views
from exposight.tables import Column, Table, count, counted, number
from exposight.twin.campaign import (
    OBSERVATIONS_FILE,
    CellSettings,
    scene_at,
    simulate,
    simulate_observations,
    views_folder,
)
from exposight.twin.part import FEATURES_FILE, MESH_FILE, SENSOR_FILE, export_scene
from exposight.workers import usual_workers

if TYPE_CHECKING:
    from exposight.cli.result import Fact
    from exposight.observing import ObservationTable
    from exposight.plans import MeasuringPlan
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
    settings = CellSettings(
        rings_only=rings_only,
        clouds=not no_clouds,
        raw_frames=raw_frames,
        workers=workers or (1 if cluster else usual_workers()),
        cluster=cluster,
        scene=scene,
    )
    if observe:
        return _observed(chosen, output or Path("observations.csv"), settings)
    return _simulated(chosen, output or Path("campaign"), settings)


class _Captures:
    """Hands progress on, and remembers how many captures there were before."""

    def __init__(self, progress: Progress, title: str) -> None:
        self._progress, self._title = progress, title
        self.before: int | None = None
        self.total = 0

    def __call__(self, done: int, total: int) -> None:
        if self.before is None:
            self.before = done
        self.total = total
        self._progress(self._title, done, total)

    def stage(self, stage: str) -> None:
        self._progress(stage, 0, 0)


def _simulated(plan: MeasuringPlan, output: Path, settings: CellSettings) -> Result:
    start = time.perf_counter()
    file = Written.at(output, "campaign")
    with progress_bars(kept_in=output) as progress:
        captures = _Captures(progress, f"simulating {plan.name}")
        simulate(plan, output, settings, captures, stage=captures.stage)
    size = sum(path.stat().st_size for path in output.rglob("*") if path.is_file())
    observed = output / OBSERVATIONS_FILE
    next_step = f"observe {quote(str(output))}"
    if not settings.clouds:
        next_step = f"train {quote(str(observed))}"
    return Result(
        title=f"{plan.name}: {plan.sensor}",
        facts=(
            *_facts(plan, settings, captures, time.perf_counter() - start),
            fact("clouds", settings.clouds, ""),
            fact("raw_frames", settings.raw_frames, ""),
            fact("bytes", size, f"{number(size / 1e6, 3)} MB"),
        ),
        files=(file,)
        if settings.clouds
        else (file, Written(kind="observations", path=observed, replaced=False)),
        notes=_blind(plan, settings),
        next_step=next_step,
    )


def _observed(plan: MeasuringPlan, output: Path, settings: CellSettings) -> Result:
    start = time.perf_counter()
    file = Written.at(output, "observations")
    with progress_bars(kept_in=views_folder(output)) as progress:
        captures = _Captures(progress, f"simulating and observing {plan.name}")
        table: ObservationTable = simulate_observations(
            plan, settings, captures, table_path=output, stage=captures.stage
        )
    return Result(
        title=f"{plan.name}: {plan.sensor}",
        facts=(
            *_facts(plan, settings, captures, time.perf_counter() - start),
            fact("rows", len(table)),
        ),
        tables=(visibility_table(table),),
        files=(file,),
        notes=_blind(plan, settings),
        next_step=f"train {quote(str(output))}",
    )


def _views_of_feature(plan: MeasuringPlan, settings: CellSettings) -> dict[str, int]:
    """Return in how many views each feature can be seen."""
    planned = views(plan, scene_at(settings.scene).part, sensor_preset(plan.sensor))
    visible = Counter(name for view in planned for name in view.visible)
    return {name: visible[name] for name in plan.features}


def _blind(plan: MeasuringPlan, settings: CellSettings) -> tuple[str, ...]:
    blind = [name for name, n in _views_of_feature(plan, settings).items() if not n]
    return (f"no view sees {', '.join(blind)}",) if blind else ()


def _facts(
    plan: MeasuringPlan, settings: CellSettings, captures: _Captures, seconds: float
) -> tuple[Fact, ...]:
    part = scene_at(settings.scene).part
    planned = views(plan, part, sensor_preset(plan.sensor))
    exposures = [exposure_ms for view in planned for exposure_ms in view.exposures_ms]
    before = captures.before or 0
    there = f", {count(before)} of them were there before" if before else ""
    kinematic = sum(view.aligned_by == "kinematics" for view in planned)
    processes = min(settings.workers, max(1, len(planned)))  # a view is done by one of them
    where = settings.cluster or counted(processes, "worker")
    visible = _views_of_feature(plan, settings)
    return (
        fact("plan", plan.name, ""),
        fact("sensor", plan.sensor, ""),
        fact("part", part.name),
        fact("rings_only", settings.rings_only),
        fact("views", len(planned)),
        fact("views_aligned_by_kinematics", kinematic),
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
        fact("workers", None if settings.cluster else processes, ""),
        fact("cluster", settings.cluster, ""),
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
    export_scene(folder, shown, sensor_preset(plan.sensor))
    facts = (
        fact("triangles", len(shown.faces)),
        fact("features", len(shown.part.features)),
        fact("sensor", plan.sensor),
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


def plan_summary(plan: MeasuringPlan) -> tuple[Fact, ...]:
    """Return what a measuring plan holds."""
    positions = {
        group.name: len(group.x_mm) * len(group.y_mm)
        if isinstance(group, DepthPlane)
        else group.count
        for group in plan.groups
    }
    exposures = {group.name: list(group.exposures_ms) for group in plan.groups}
    captures = sum(n * len(exposures[name]) for name, n in positions.items())
    per_group = ", ".join(f"{name} {count(n)}" for name, n in positions.items())
    # Which views see no feature depends on the part, which is not known here.
    at_most = "at most " if plan.blind_views == "skip" else ""
    each = (f"{name} {', '.join(f'{t:g}' for t in times)}" for name, times in exposures.items())
    return (
        fact("plan", plan.name),
        fact("sensor", plan.sensor),
        fact("side", plan.side),
        fact("lighting", plan.lighting),
        fact("features", plan.features),
        fact("views", positions, f"{at_most}{count(sum(positions.values()))}: {per_group}"),
        fact("exposures_ms", exposures, "\n".join(each)),
        fact("captures", captures, at_most + count(captures)),
        fact("seed", plan.seed),
    )
