"""``exposight measure``: a measuring plan to a campaign, by any driver."""

import time
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from shlex import quote
from typing import Annotated, Any, Literal

from cyclopts import Group, Parameter
from cyclopts.types import PositiveInt
from cyclopts.validators import Number

from exposight import measuring
from exposight.cell import ROUNDED_SHARE, CampaignFolder, Driver, closing_driver, preset_name
from exposight.cli.app import UsageError
from exposight.cli.cluster_options import ClusterOptions
from exposight.cli.loop_run import EXPOSURE_PLAN_SUFFIX, NO_LOOP, LoopOptions, carry_out_loop
from exposight.cli.observe import visibility_table
from exposight.cli.result import Fact, Result, Written, fact
from exposight.cli.terminal import progress_bars
from exposight.contradictions import Contradiction
from exposight.drivers import DEVICES, ReplayDriver
from exposight.errors import InputError, did_you_mean
from exposight.plans import (
    PLAN_SUFFIXES,
    PLANS,
    TURN_AXES,
    DepthPlane,
    MeasuringPlan,
    RandomPositions,
    read_plan,
)
from exposight.tables import count, counted, number
from exposight.twin import SimulatedCell
from exposight.workers import usual_workers


@Parameter("*", group=Group("What is kept, and who works", sort_key=2))
@dataclass(frozen=True, kw_only=True)
class RunOptions(ClusterOptions):
    """How a plan is carried out; none of it changes what is measured.

    Parameters
    ----------
    output
        Folder of the campaign (campaign by default); with --observe the observation table, .csv or
        .parquet (observations.csv).
    observe
        Observe captures at once, and write the table instead of a campaign.
    no_clouds
        Do not keep point clouds: captures are observed as they are taken, and the campaign holds
        images, poses and observations.csv, which cannot be repeated from it.
    workers
        Run tasks in parallel, in this many processes; one for each core by default, at most 8.
    """

    output: Annotated[Path | None, Parameter(alias="-o", metavar="FOLDER|FILE")] = None
    observe: bool = False
    no_clouds: bool = False
    workers: PositiveInt | None = None


DEFAULTS = RunOptions()


def measure_command(
    plan: str,
    /,
    *,
    driver: Literal["simulated", "replay", "genicam", "rc_visard"],
    recording: Path | None = None,
    within: Annotated[
        float | None, Parameter(metavar="PERCENT", validator=Number(gte=0, lte=100))
    ] = None,
    options: RunOptions = DEFAULTS,
    loop: LoopOptions = NO_LOOP,
) -> Result:
    """Carry out a measuring plan or an exposure plan with a driver.

    A driver takes the captures: the simulated cell, a recorded campaign that gives back its own,
    the GigE Vision and USB3 Vision cameras of a cell, or its rc_visard (docs/drivers.md).
    A measuring plan is taken as it is. An exposure plan is carried out in a closed loop: features
    that succeeded leave, what was measured corrects the forecast of the others, and what is left
    is planned again, until nothing is left that can be had. Run the same command again after an
    interruption and it goes on. Drivers of your own are used from Python:
    exposight.measuring.measure.

    For example:

        exposight measure small --driver simulated -o door

        exposight measure door/plan.toml --driver replay --recording door -o again

        exposight measure plan.json --models models --driver simulated --lamp 0.6 -o new

        exposight measure plan.toml --driver genicam --cell cell.toml -o door

    Parameters
    ----------
    plan
        Measuring plan: a TOML or YAML file (docs/formats.md), or a name from simulate --list. Or
        an exposure plan, which exposight plan wrote: a JSON file.
    driver
        Who takes the captures.
    recording
        With --driver replay: the campaign whose captures are given back.
    within
        With --driver replay: how far the recorded exposure time nearest to the planned one may be
        from it; 2 by default.
    """
    if (driver == "replay") != (recording is not None):
        msg = "--driver replay needs --recording, the campaign to give back; others do not take it"
        raise UsageError(msg)
    if within is not None and recording is None:
        msg = "--within goes with --driver replay"
        raise UsageError(msg)
    device, loop = _device_driver(driver, recording, within, loop)
    if Path(plan).suffix.lower() == EXPOSURE_PLAN_SUFFIX:
        if replace(options, output=None, no_clouds=False) != DEFAULTS:
            msg = (
                "a closed loop takes one capture after the other and keeps its campaign: leave out "
                "--observe, --workers and --cluster"
            )
            raise UsageError(msg)
        return carry_out_loop(
            Path(plan),
            options.output or Path("campaign"),
            loop,
            driver=device,
            clouds=not options.no_clouds,
        )
    if loop != NO_LOOP:
        msg = "a measuring plan is taken as it is; --models and the like go with an exposure plan"
        raise UsageError(msg)
    chosen = plan_from(plan)
    if device is not None:
        alone = replace(options, workers=options.workers or 1)
        return carry_out(chosen, lambda: device, options if options.cluster else alone)
    folder = None if plan in PLANS else Path(plan).parent
    return carry_out(chosen, lambda: SimulatedCell.for_plan(chosen, folder=folder), options)


def _device_driver(
    kind: str, recording: Path | None, within: float | None, loop: LoopOptions
) -> tuple[Driver | None, LoopOptions]:
    """Return the driver, None for the simulated cell, and the options that are left for a loop."""
    if recording is not None:
        share = ROUNDED_SHARE if within is None else within / 100
        return ReplayDriver(recording, within=share), loop
    if kind not in DEVICES:
        return None, loop
    if loop.cell is None:
        msg = f"--driver {kind} needs --cell, the file that names devices and commands"
        raise UsageError(msg)
    device = DEVICES[kind].of_file(loop.cell)
    if device.part is None:
        msg = f'{loop.cell}: name the part\'s list of features: features = "features.csv"'
        raise InputError(msg)
    return device, replace(loop, cell=None)


def carry_out(
    plan: MeasuringPlan,
    make_driver: Callable[[], Any],
    options: RunOptions,
) -> Result:
    """Carry out a plan, and return what was measured.

    Parameters
    ----------
    plan : MeasuringPlan
        Views and exposure times.
    make_driver : callable
        Returns the driver, which must know its part; may take seconds.
    options : RunOptions
        What is kept, and who works.
    """
    if options.observe and options.no_clouds:
        msg = "--observe keeps no clouds: leave out --no-clouds"
        raise UsageError(msg)
    workers = options.workers or (1 if options.cluster else usual_workers())
    start = time.perf_counter()
    output = options.output or Path("observations.csv" if options.observe else "campaign")
    kept_in = measuring.views_folder(output) if options.observe else output
    before = len(CampaignFolder(output)) if (output / "campaign.json").is_file() else 0
    if options.observe:
        measuring.check_table_path(output)  # before anything that takes time
    files = [Written.at(output, "observations" if options.observe else "campaign")]
    contradictions: tuple[Contradiction, ...] = ()
    run: dict[str, Any] = {"workers": workers, "cluster": options.chosen_cluster}
    with progress_bars(kept_in=kept_in) as progress, closing_driver(make_driver()) as driver:
        part = driver.part
        if options.observe:
            table = measuring.measure_observations(
                plan, driver, table_path=output, progress=progress, **run
            )
            contradictions = table.contradictions
        else:
            clouds = not options.no_clouds
            found: list[Contradiction] = []
            measuring.measure(
                plan, driver, output, clouds=clouds, progress=progress, tell=found.append, **run
            )
            contradictions = tuple(dict.fromkeys(found))
    seconds = time.perf_counter() - start
    next_step = f"{'train' if options.observe else 'observe'} {quote(str(output))}"
    if options.no_clouds:
        files.append(
            Written(kind="observations", path=output / measuring.OBSERVATIONS_FILE, replaced=False)
        )
        next_step = f"train {quote(str(files[-1].path))}"
    planned = plan.views(part)
    exposures = [exposure_ms for view in planned for exposure_ms in view.exposures_ms]
    counted_views = Counter(name for view in planned for name in view.visible)
    visible = {name: counted_views[name] for name in plan.features}
    blind = [name for name, n in visible.items() if not n]
    processes = min(workers, max(1, len(planned)))  # a view is done by one of them
    there = f", {count(before)} of them were there before" if before else ""
    shortest, longest = min(exposures), max(exposures)
    size = sum(path.stat().st_size for path in output.rglob("*") if path.is_file())
    return Result(
        title=f"{plan.name}: part {part.name}, {plan.sensor.name}",
        facts=(
            fact("plan", plan.name, ""),
            fact("sensor", preset_name(plan.sensor) or plan.sensor.name, ""),
            fact("part", part.name, ""),
            fact("views", len(planned)),
            fact("views_of_feature", visible, ""),
            fact("captures", len(exposures), count(len(exposures)) + there),
            fact("captures_before", before, ""),
            fact(
                "exposures_ms",
                {"min": shortest, "max": longest},
                f"{number(shortest)} to {number(longest)}",
            ),
            fact("workers", None if options.cluster else processes, ""),
            fact("cluster", options.cluster, ""),
            fact(
                "seconds",
                seconds,
                f"{number(seconds, 3)}, {options.cluster or counted(processes, 'worker')}",
            ),
            fact("bytes", size, f"{number(size / 1e6, 3)} MB" if size else ""),
        ),
        tables=(visibility_table(table),) if options.observe else (),
        contradictions=contradictions,
        notes=(f"no view sees {', '.join(blind)}",) if blind else (),
        files=tuple(files),
        next_step=next_step,
    )


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
    views = {group.name: group.n_views for group in plan.groups}
    exposures = {group.name: list(group.exposures_ms) for group in plan.groups}
    captures = plan.n_captures
    per_group = ", ".join(f"{name} {count(n)}" for name, n in views.items())
    # Which views see no feature depends on the part, which is not known here.
    at_most = "at most " if plan.blind_views == "skip" else ""
    each = (f"{name} {', '.join(f'{t:g}' for t in times)}" for name, times in exposures.items())
    turning: tuple[DepthPlane | RandomPositions, ...] = (*plan.planes, *plan.random)
    turns = {
        group.name: dict(zip(TURN_AXES, group.turn_ranges_deg, strict=True))
        for group in turning
        if any(map(any, group.turn_ranges_deg))
    }
    written = {
        poses.name: {"notation": poses.notation, "frame": poses.frame} for poses in plan.poses
    }
    as_written = (f"{poses.name} {poses.notation}, {poses.frame}" for poses in plan.poses)
    turned = (f"{name} {_turn_text(ranges)}" for name, ranges in turns.items())
    return (
        fact("plan", plan.name),
        fact("sensor", preset_name(plan.sensor) or plan.sensor.name),
        fact("side", plan.side),
        fact("features", plan.features),
        fact("views", views, f"{at_most}{count(sum(views.values()))}: {per_group}"),
        fact("exposures_ms", exposures, "\n".join(each)),
        *([fact("poses", written, "\n".join(as_written))] if written else []),
        *([fact("turns_deg", turns, "\n".join(turned))] if turns else []),
        fact("captures", captures, at_most + count(captures)),
        fact("seed", plan.seed),
        *(fact(name, value) for name, value in plan.simulated.items()),
    )


def _turn_text(ranges_deg: Mapping[str, tuple[float, float]]) -> str:
    return ", ".join(
        f"{axis.removesuffix('_deg')} {' to '.join(number(limit) for limit in sorted({*limits}))}°"
        for axis, limits in ranges_deg.items()
    )
