"""``exposight simulate``: a measuring plan to a campaign, in a cell made of physics."""

from __future__ import annotations

import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from exposight.cell import CampaignFolder, sensor_preset
from exposight.cli.measuring_plans import plan_from, print_plans
from exposight.cli.output import (
    JsonOption,
    count,
    print_json,
    print_line,
    progress_bars,
)
from exposight.cli.simulation_summary import SimulationRun, print_run, run_document
from exposight.errors import MissingFileError
from exposight.plans import views
from exposight.twin.campaign import (
    OBSERVATIONS_FILE,
    CellSettings,
    count_views,
    scene_at,
    simulate,
    simulate_observations,
    views_folder,
)
from exposight.twin.part import FEATURES_FILE, MESH_FILE, SENSOR_FILE, export_scene
from exposight.workers import usual_workers

if TYPE_CHECKING:
    from collections.abc import Callable

    from exposight.observing import ObservationTable
    from exposight.plans import MeasuringPlan

_CORES = usual_workers()

_Plan = Annotated[
    str | None,
    typer.Argument(
        metavar="PLAN",
        help="Measuring plan: a TOML or YAML file (docs/formats.md), or a name from --list.",
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
_Workers = Annotated[
    int | None,
    typer.Option(
        min=1,
        show_default="one for each core, at most 8",
        help="Processes on this machine that work at the same time.",
    ),
]
_Cluster = Annotated[
    str | None,
    typer.Option(
        metavar="ADDRESS",
        help="Let the workers of a Dask scheduler do it, tcp://host:8786. All must have this "
        "version of exposight and, unless with --observe, reach the campaign's folder at the same "
        "path: put it on a shared disk.",
    ),
]
_Observe = Annotated[
    bool,
    typer.Option("--observe", help="Observe captures at once, and write the table instead."),
]
_NoClouds = Annotated[
    bool,
    typer.Option(
        "--no-clouds",
        help="Keep no point clouds: captures are observed when they are taken, and the campaign "
        f"holds images, poses and {OBSERVATIONS_FILE}, which cannot be repeated from it.",
    ),
]
_RawFrames = Annotated[
    bool,
    typer.Option(
        "--raw-frames",
        help="Keep every frame that a cloud was computed from beside it, for decode to read.",
    ),
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


class _Tally:
    """Hands progress on and remembers it."""

    def __init__(self, tell: Callable[[str, int, int], None], title: str) -> None:
        self._tell = tell
        self._title = title
        self._stage = ""
        self.before: int | None = None
        self.total = 0

    def __call__(self, done: int, total: int) -> None:
        if self.before is None:
            self.before = done
        else:
            self._end_stage()
        self.total = total
        self._tell(self._title, done, total)

    def stage(self, words: str) -> None:
        """Tell what begins before there is progress to count."""
        self._end_stage()
        self._stage = words
        self._tell(words, 0, 1)

    def _end_stage(self) -> None:
        if self._stage:
            self._tell(self._stage, 1, 1)
        self._stage = ""


def simulate_command(
    plan: _Plan = None,
    output: _Output = None,
    rings_only: _RingsOnly = False,
    no_clouds: _NoClouds = False,
    raw_frames: _RawFrames = False,
    observe: _Observe = False,
    workers: _Workers = None,
    cluster: _Cluster = None,
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
    on; the result is the same, for any number of workers, here or on a cluster,
    to the last byte.

    For example:

      exposight simulate small --rings-only -o door

      exposight simulate x --rings-only --observe -o observations.csv
    """
    if list_plans:
        if plan is not None:
            msg = f"--list lists all plans; `exposight info {plan}` tells of one"
            raise typer.BadParameter(msg)
        print_plans(as_json=as_json)
        return
    if plan is None:
        msg = "give a measuring plan: a TOML or YAML file, or a name from --list"
        raise typer.BadParameter(msg)
    if export_folder is not None and (
        observe or rings_only or no_clouds or raw_frames or output is not None
    ):
        msg = (
            "--export-scene simulates nothing: leave out --output, --observe, --rings-only, "
            "--no-clouds and --raw-frames"
        )
        raise typer.BadParameter(msg)
    if observe and (no_clouds or raw_frames):
        msg = "--observe keeps neither clouds nor frames: leave out --no-clouds and --raw-frames"
        raise typer.BadParameter(msg)
    _check_cluster(cluster, workers)
    _check_scene(scene)
    chosen = plan_from(plan)
    if export_folder is not None:
        _export(chosen, scene, export_folder, as_json=as_json)
        return
    settings = CellSettings(
        rings_only=rings_only,
        clouds=not no_clouds,
        raw_frames=raw_frames,
        workers=1 if cluster is not None else workers or _CORES,
        cluster=cluster,
        scene=scene,
    )
    if observe:
        run, table = _observed(chosen, output or Path("observations.csv"), settings)
    else:
        run, table = _simulated(chosen, output or Path("campaign"), settings), None
    if as_json:
        print_json(run_document(run, table))
    else:
        print_run(run, table)


def _check_cluster(address: str | None, workers: int | None) -> None:
    if address is None:
        return
    if workers is not None:
        msg = "--workers are processes here, --cluster are others: give one of them"
        raise typer.BadParameter(msg)
    if "://" not in address:
        msg = (
            f"{address!r} lacks the protocol; expected the address that the scheduler prints, such "
            "as tcp://host:8786"
        )
        raise typer.BadParameter(msg, param_hint="--cluster")


def _check_scene(folder: Path | None) -> None:
    if folder is not None and not (folder / MESH_FILE).is_file():
        msg = (
            f"no mesh at {folder / MESH_FILE}; expected a folder as this command makes it: "
            "exposight simulate PLAN --export-scene FOLDER"
        )
        raise MissingFileError(msg)


def _simulated(plan: MeasuringPlan, output: Path, settings: CellSettings) -> SimulationRun:
    start = time.perf_counter()
    with progress_bars(keep=True, time_left=True) as progress:
        tally = _Tally(progress, f"simulating {plan.name}")
        try:
            simulate(plan, output, settings, tally, stage=tally.stage)
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
) -> tuple[SimulationRun, ObservationTable]:
    start = time.perf_counter()
    with progress_bars(keep=True, time_left=True) as progress:
        tally = _Tally(progress, f"simulating and observing {plan.name}")
        try:
            table = simulate_observations(
                plan, settings, tally, table_path=output, stage=tally.stage
            )
        except KeyboardInterrupt as error:
            msg = "stopped by Ctrl-C before the first view was finished"
            if finished := count_views(output):
                msg = (
                    f"stopped by Ctrl-C; the observations of {finished} finished views are kept in "
                    f"{views_folder(output)}, and the same command goes on"
                )
            raise KeyboardInterrupt(msg) from error
    return _run_of(plan, output, settings, tally, time.perf_counter() - start), table


def _run_of(
    plan: MeasuringPlan, output: Path, settings: CellSettings, tally: _Tally, seconds: float
) -> SimulationRun:
    part = scene_at(settings.scene).part
    return SimulationRun(
        plan=plan,
        part=part.name,
        planned=views(plan, part, sensor_preset(plan.sensor)),
        settings=settings,
        before=tally.before or 0,
        captures=tally.total,
        seconds=seconds,
        output=output,
    )


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
