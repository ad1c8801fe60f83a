"""``exposight simulate``: a measuring plan to a campaign, in a cell made of physics."""

from __future__ import annotations

import os
import time
from collections import Counter
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from exposight.cell import CampaignFolder, sensor_preset
from exposight.cli.measuring_plans import plan_from, print_plans
from exposight.cli.output import (
    JsonOption,
    count,
    note,
    number,
    percent,
    print_facts,
    print_json,
    print_line,
    print_table,
    progress_bars,
)
from exposight.errors import FormatError, MissingFileError
from exposight.twin.planned_views import views
from exposight.twin.scene_files import FEATURES_FILE, MESH_FILE, SENSOR_FILE, export_scene
from exposight.twin.simulated_cell import (
    CellSettings,
    scene_at,
    simulate,
    simulate_observations,
)

if TYPE_CHECKING:
    from collections.abc import Callable

    from exposight.observing import ObservationTable
    from exposight.twin.plan import MeasuringPlan
    from exposight.twin.planned_views import PlannedView

_MOST_WORKERS = 8
"""More have to be asked for: each may take a gigabyte of memory."""


def _cores() -> int:
    """Return how many processes work at the same time unless told otherwise."""
    usable = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    return min(usable or 1, _MOST_WORKERS)


_CORES = _cores()

_Plan = Annotated[
    str | None,
    typer.Argument(
        metavar="PLAN", help="Measuring plan: a TOML file (docs/formats.md), or a name from --list."
    ),
]
_Output = Annotated[
    Path | None,
    typer.Option(
        "--output",
        "-o",
        metavar="FOLDER|FILE",
        help="Folder of the campaign (campaign, if none is given); with --observe the observation "
        "table, .csv or .parquet (observations.csv).",
    ),
]
_RingsOnly = Annotated[
    bool,
    typer.Option(
        "--rings-only",
        help="Take only the neighbourhoods of the features' rings: p_norm and i_avg are the same "
        "as from whole frames, in a fraction of the time.",
    ),
]
_Workers = Annotated[int, typer.Option(min=1, help="Processes that work at the same time.")]
_Observe = Annotated[
    bool,
    typer.Option("--observe", help="Observe captures at once, and write the table instead."),
]
_Scene = Annotated[
    Path | None,
    typer.Option(
        metavar="FOLDER",
        help=f"Another part than the built-in door: {MESH_FILE} and {FEATURES_FILE}, as "
        "--export-scene writes them.",
    ),
]
_ExportScene = Annotated[
    Path | None,
    typer.Option(
        "--export-scene",
        metavar="FOLDER",
        help="Write the scene's mesh, features and sensor for other programs, and leave.",
    ),
]
_List = Annotated[bool, typer.Option("--list", help="List the plans that have a name, and leave.")]


@dataclass(frozen=True, kw_only=True, eq=False)
class _Run:
    """A plan that was carried out."""

    plan: MeasuringPlan
    part: str
    planned: tuple[PlannedView, ...]
    settings: CellSettings
    before: int
    captures: int
    seconds: float
    output: Path

    def seen(self) -> dict[str, int]:
        """Return in how many views each feature can be seen."""
        counted = Counter(name for view in self.planned for name in view.visible)
        return {name: counted[name] for name in self.plan.features}

    def exposures_ms(self) -> tuple[float, float]:
        exposures = [t for view in self.planned for t in view.exposures_ms]
        return min(exposures), max(exposures)


class _Tally:
    """Hands progress on and remembers it."""

    def __init__(self, tell: Callable[[int, int], None]) -> None:
        self._tell = tell
        self.before: int | None = None
        self.total = 0

    def __call__(self, done: int, total: int) -> None:
        if self.before is None:
            self.before = done
        self.total = total
        self._tell(done, total)


def simulate_command(
    plan: _Plan = None,
    output: _Output = None,
    rings_only: _RingsOnly = False,
    workers: _Workers = _CORES,
    observe: _Observe = False,
    scene: _Scene = None,
    export_folder: _ExportScene = None,
    list_plans: _List = False,
    as_json: JsonOption = False,
) -> None:
    """Carry out a measuring plan in a simulated cell.

    A sensor looks at a car door of bare sheet metal from every view and at
    every exposure time of the plan; clouds lack points where images clip, stay
    dark, or lie in shadow, as real ones do. The campaign is a folder like a
    recorded one. Run the same command again after an interruption and it goes
    on; the result is the same, for any number of workers, to the last byte.

    For example:

      exposight simulate small --rings-only -o door

      exposight simulate x --rings-only --observe -o observations.csv
    """
    if list_plans:
        print_plans(as_json=as_json)
        return
    if plan is None:
        msg = "give a measuring plan: a TOML file, or a name from --list"
        raise typer.BadParameter(msg)
    chosen = plan_from(plan)
    if export_folder is not None:
        _export(chosen, scene, export_folder, as_json=as_json)
        return
    settings = CellSettings(rings_only=rings_only, workers=workers, scene=scene)
    table: ObservationTable | None = None
    if observe:
        output = output or Path("observations.csv")
        _check_table_name(output)
        run, table = _observed(chosen, output, settings)
        table.write(output)
    else:
        run = _simulated(chosen, output or Path("campaign"), settings)
    if as_json:
        print_json(_document(run, table))
    else:
        _print(run, table)


def _check_table_name(output: Path) -> None:
    """Find out now, not after hours of work, that a table cannot be written."""
    if output.suffix.lower() not in {".csv", ".parquet"}:
        msg = f"{output}: an observation table ends in .csv or .parquet, got '{output.suffix}'"
        raise FormatError(msg)
    if not output.parent.is_dir():
        msg = f"{output}: the folder {output.parent} does not exist; make it first"
        raise MissingFileError(msg)


def _simulated(plan: MeasuringPlan, output: Path, settings: CellSettings) -> _Run:
    start = time.perf_counter()
    with progress_bars(keep=True, time_left=True) as progress:
        tally = _Tally(partial(progress, f"simulating {plan.name}"))
        try:
            simulate(plan, output, settings, tally)
        except KeyboardInterrupt as error:
            raise KeyboardInterrupt(_stopped(output, tally)) from error
    return _run_of(plan, output, settings, tally, time.perf_counter() - start)


def _stopped(output: Path, tally: _Tally) -> str:
    if tally.before is None:
        return "stopped by Ctrl-C before the first capture"
    kept = len(CampaignFolder(output))
    return (
        f"stopped by Ctrl-C; {kept} of {tally.total} captures are kept in {output}, and the same "
        "command goes on"
    )


def _observed(
    plan: MeasuringPlan, output: Path, settings: CellSettings
) -> tuple[_Run, ObservationTable]:
    start = time.perf_counter()
    with progress_bars(keep=True, time_left=True) as progress:
        tally = _Tally(partial(progress, f"simulating and observing {plan.name}"))
        try:
            table = simulate_observations(plan, settings, tally)
        except KeyboardInterrupt as error:
            msg = (
                "stopped by Ctrl-C; --observe keeps nothing of an unfinished plan: without it, "
                "captures are kept and the same command goes on"
            )
            raise KeyboardInterrupt(msg) from error
    return _run_of(plan, output, settings, tally, time.perf_counter() - start), table


def _run_of(
    plan: MeasuringPlan, output: Path, settings: CellSettings, tally: _Tally, seconds: float
) -> _Run:
    part = scene_at(settings.scene).part
    return _Run(
        plan=plan,
        part=part.name,
        planned=views(plan, part, sensor_preset(plan.sensor)),
        settings=settings,
        before=tally.before or 0,
        captures=tally.total,
        seconds=seconds,
        output=output,
    )


def _size_bytes(folder: Path) -> int:
    return sum(path.stat().st_size for path in folder.rglob("*") if path.is_file())


def _spell_size(size: int) -> str:
    """Spell a size on disk with three digits."""
    for unit, scale in (("GB", 1e9), ("MB", 1e6)):
        if size >= scale:
            return f"{number(size / scale, 3)} {unit}"
    return f"{number(size / 1e3, 3)} kB"


def _document(run: _Run, table: ObservationTable | None) -> dict[str, object]:
    kinematic = sum(view.aligned_by == "kinematics" for view in run.planned)
    shortest, longest = run.exposures_ms()
    document: dict[str, object] = {
        "plan": run.plan.name,
        "sensor": run.plan.sensor,
        "part": run.part,
        "rings_only": run.settings.rings_only,
        "workers": run.settings.workers,
        "views": len(run.planned),
        "views_aligned_by_kinematics": kinematic,
        "views_of_feature": run.seen(),
        "captures": run.captures,
        "captures_before": run.before,
        "exposures_ms": {"min": shortest, "max": longest},
        "seconds": run.seconds,
    }
    if table is None:
        return {**document, "bytes": _size_bytes(run.output), "campaign": run.output}
    return {
        **document,
        "rows": len(table),
        "visibility": table.counts(),
        "observations": run.output,
    }


def _print(run: _Run, table: ObservationTable | None) -> None:
    seen = run.seen()
    taken = run.captures - run.before
    shortest, longest = run.exposures_ms()
    kinematic = sum(view.aligned_by == "kinematics" for view in run.planned)
    each = f", {number(run.seconds / taken, 3)} s each" if taken else ""
    found = sum(1 for n in seen.values() if n)
    facts = [
        (
            "captures",
            f"{count(run.captures)} {'of the rings' if run.settings.rings_only else 'whole frames'}"
            + (f", of which {count(run.before)} were there before" if run.before else ""),
        ),
        ("views", f"{count(len(run.planned))}, of which {count(kinematic)} aligned by kinematics"),
        (
            "features",
            f"{found} of {len(seen)} seen, {number(sum(seen.values()) / len(run.planned), 2)} a "
            "view on average",
        ),
        ("exposure times", f"{number(shortest)} to {number(longest)} ms"),
        ("time", f"{number(run.seconds, 3)} s{each}, by {_workers(run.settings.workers)}"),
    ]
    if table is None:
        facts.append(("on disk", _spell_size(_size_bytes(run.output))))
    print_facts(f"{run.plan.name}: part {run.part}, {run.plan.sensor}", facts)
    blind = [name for name, n in seen.items() if not n]
    if blind:
        note(f"no view sees {', '.join(blind)}")
    if table is None:
        print_line(f"wrote the campaign: {run.output}")
        print_line(f"next:               exposight observe {run.output}")
        return
    print_line("")
    print_table(
        ("features are", "rows", "share %"),
        (
            (reason, count(rows), percent(rows / len(table)))
            for reason, rows in table.counts().items()
        ),
    )
    print_line(f"wrote the observations: {run.output}")
    print_line(f"next:                   exposight train {run.output}")


def _workers(workers: int) -> str:
    return "1 worker" if workers == 1 else f"{workers} workers"


def _export(plan: MeasuringPlan, scene: Path | None, folder: Path, *, as_json: bool) -> None:
    shown = scene_at(scene)
    export_scene(folder, shown, sensor_preset(plan.sensor))
    files = [folder / name for name in (MESH_FILE, FEATURES_FILE, SENSOR_FILE)]
    triangles, features = len(shown.faces), len(shown.part.features)
    if as_json:
        print_json({"triangles": triangles, "features": features, "files": files})
        return
    meanings = (
        f"{count(triangles)} triangles, mm, with their finish",
        f"{features} features",
        plan.sensor,
    )
    for path, meaning in zip(files, meanings, strict=True):
        print_line(f"wrote {path}: {meaning}")
