"""``exposight simulate``: a measuring plan to a campaign, in a cell made of physics."""

from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

from cyclopts import Parameter

from exposight.cell import ActiveSensor, sensor_named_or_read, sensor_preset
from exposight.cli.app import UsageError
from exposight.cli.measure import DEFAULTS, RunOptions, carry_out, plan_from, plan_summary
from exposight.cli.result import Result, Written, fact
from exposight.cli.serve_cell import ServedAs, serve_cell
from exposight.plans import PLANS, MeasuringPlan
from exposight.tables import Column, Table
from exposight.twin import SimulatedCell, SimulatedCellSettings, scene_at
from exposight.twin.part import export_scene, exported_files, scene_sensor
from exposight.twin.sensors import with_table


def simulate_command(
    plan: str | None = None,
    /,
    *,
    rings_only: bool = False,
    raw_frames: bool = False,
    sensor: Annotated[str | None, Parameter(metavar="NAME|FILE")] = None,
    check: bool = False,
    scene: Path | None = None,
    export_scene_to: Annotated[Path | None, Parameter("--export-scene")] = None,
    list_plans: Annotated[bool, Parameter("--list")] = False,
    serve_as: ServedAs | None = None,
    options: RunOptions = DEFAULTS,
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

        exposight simulate --check --sensor sensor.json -o check.html

        exposight simulate small --serve-as gige-vision -o served

    Parameters
    ----------
    plan
        Measuring plan: a TOML or YAML file (docs/formats.md), or a name from --list.
    rings_only
        Take only the neighbourhoods of the features' rings: p_norm and i_avg are the same as from
        whole frames, in a fraction of the time.
    raw_frames
        Keep every frame that a cloud was computed from beside it, for decode to read.
    sensor
        Another sensor than the plan's: a preset (comet-pro-ae, rc-visard-65) or a JSON file, whose
        table "simulated" says electronics, lenses and patterns (docs/formats.md); by default the
        scene's, if it has one.
    check
        Carry out nothing: measure the plan's sensor, or that of --sensor, as EMVA 1288 measures a
        camera, and on plates; write a page (check.html) on which each figure stands beside the
        sensor's table.
    scene
        Another part than the built-in door: a mesh (PLY, STL, OBJ, GLB) with its features in
        features.csv beside it, their folder, or a scene.toml (docs/formats.md).
    export_scene_to
        Write the scene's mesh, features and sensor for other programs, and leave.
    list_plans
        List the plans that have a name, and leave.
    serve_as
        Take no captures: serve sensor, projector and robot of the plan's cell on loopback until
        Ctrl-C, and write the cell's file for measure --driver genicam or rc_visard
        (docs/drivers.md) to the output folder (served).
    """
    if list_plans:
        if plan is not None:
            msg = f"--list lists all plans; exposight info {plan} describes one"
            raise UsageError(msg)
        return _plans()
    if check:
        if rings_only or raw_frames or export_scene_to or replace(options, output=None) != DEFAULTS:
            msg = (
                "--check takes no captures: leave out all but plan, --sensor, --scene and --output"
            )
            raise UsageError(msg)
        return _check(plan, _given_sensor(sensor, scene), options.output or Path("check.html"))
    if plan is None:
        msg = "give a measuring plan: a TOML or YAML file, or a name from --list"
        raise UsageError(msg)
    if options.observe and raw_frames:
        msg = "--observe keeps neither clouds nor frames: leave out --raw-frames"
        raise UsageError(msg)
    chosen = plan_from(plan)
    changes: dict[str, Any]
    given_sensor = _given_sensor(sensor, scene)
    notes: tuple[str, ...] = ()
    if given_sensor is not None and given_sensor != chosen.sensor:
        whose = "the scene's" if sensor is None else "that of --sensor"
        notes = (f"the sensor is {whose}, {given_sensor.name}, not the plan's",)
        chosen = replace(chosen, sensor=given_sensor)
    folder = None if plan in PLANS else Path(plan).parent
    if export_scene_to is not None:
        if rings_only or raw_frames or options != DEFAULTS:
            msg = "--export-scene simulates nothing: leave out everything but --scene"
            raise UsageError(msg)
        settings = SimulatedCellSettings.of_plan(chosen, folder)
        settings = replace(settings, scene=scene or settings.scene)
        return _export(chosen, settings, export_scene_to)
    if serve_as is not None:
        if raw_frames or replace(options, output=None) != DEFAULTS:
            msg = (
                "--serve-as takes no captures: leave out all but plan, --sensor, --scene, --output"
            )
            raise UsageError(msg)
        changes = {"rings_only": rings_only, "scene": scene}
        changes = {name: value for name, value in changes.items() if value}
        served = SimulatedCell.for_plan(chosen, folder=folder, **changes)
        return serve_cell(served, options.output or Path("served"), serve_as)
    given = {"rings_only": rings_only, "raw_frames": raw_frames, "scene": scene}
    changes = {name: value for name, value in given.items() if value}
    result = carry_out(
        chosen, lambda: SimulatedCell.for_plan(chosen, folder=folder, **changes), options
    )
    return replace(result, notes=(*notes, *result.notes))


def _given_sensor(sensor: str | None, scene: Path | None) -> ActiveSensor | None:
    """Return the sensor of --sensor, or the scene's; None where the plan's is meant."""
    if sensor is not None:
        return sensor_named_or_read(sensor)
    return None if scene is None else scene_sensor(scene)


def _check(plan: str | None, sensor: ActiveSensor | None, output: Path) -> Result:
    from exposight.cli.sensor_check import check_and_write  # plotting takes a second to import

    if plan is None:
        return check_and_write(sensor or sensor_preset("comet-pro-ae"), None, output)
    chosen = plan_from(plan)
    cell = SimulatedCellSettings.of_plan(chosen, None if plan in PLANS else Path(plan).parent)
    return check_and_write(sensor or chosen.sensor, cell, output)


def _export(plan: MeasuringPlan, settings: SimulatedCellSettings, folder: Path) -> Result:
    exported = scene_at(settings.scene, settings.finishes)
    sensor = with_table(plan.sensor, settings.sensor)
    names = exported_files(exported)
    files = tuple(Written.at(folder / name, kind) for kind, name in names.items())
    export_scene(folder, exported, sensor)
    facts = (
        fact("triangles", len(exported.faces)),
        fact("features", len(exported.part.features)),
        fact("sensor", plan.sensor.name),
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
                "views": sum(group.n_views for group in plan.groups),
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
