"""The simulated cell: speed, memory, depth against the mesh, cameras, and how p_norm behaves.

Run with ``make bench NAME=twin``; three to four minutes on two cores. Building the door, where it
is not cached yet, and compiling come first and are not timed. Views and exposures are those of the
paper's X plan; the measured numbers are the twin's.
"""

from __future__ import annotations

import os
import tempfile
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import polars as pl
from numpy.typing import NDArray

from benchmarks.measuring import Figure, PeakMemory, at_least, at_most, publish, say
from exposight.cell import Capture, Part, sensor_preset
from exposight.measuring import measure, measure_observations
from exposight.observing import ObservationTable
from exposight.plans import DepthPlane, MeasuringPlan, PlannedView, plan_preset, view_seed
from exposight.twin import SimulatedCell
from exposight.twin.light import SceneTracer, trace_view
from exposight.twin.part import FINISHES, Scene, door, export_scene
from exposight.twin.sensors import CameraElectronics, DotSensor, StripeSensor, take_flat_fields

_WORKERS = 2
_PLATEAU = (30.0, 110.0)  # grey levels between which p_norm neither rises nor falls
_STEREO_AT_MM, _STEREO_REACH_MM = 500.0, 25.0
_SEED = 1


def primed(scene: Scene) -> Scene:
    """Return a scene whose bare sheet, the door's inside, wears primer."""
    bare, primer = (np.uint8(FINISHES.index(finish)) for finish in ("bare", "primer"))
    finish = np.where(scene.face_finish == bare, primer, scene.face_finish)
    return replace(scene, face_finish=finish)


def fewer_views(plan: MeasuringPlan, columns: slice, rows: slice) -> MeasuringPlan:
    """Return a plan with a part of the grid in every plane, at the same exposure times."""
    planes = (replace(p, x_mm=p.x_mm[columns], y_mm=p.y_mm[rows]) for p in plan.planes)
    return replace(plan, planes=tuple(planes))


def with_longer_exposures(plan: MeasuringPlan) -> MeasuringPlan:
    """Return a plan with 2 and 2.8 times the longest exposure time of each plane added.

    Primer sends less light to the sensor than bare sheet: the plan's own times leave it below 160
    grey levels everywhere.
    """
    planes = (
        replace(p, exposures_ms=(*p.exposures_ms, *(n * max(p.exposures_ms) for n in (2.0, 2.8))))
        for p in plan.planes
    )
    return replace(plan, planes=tuple(planes))


def warm_up(plan: MeasuringPlan) -> None:
    """Let workers compile what is not compiled yet, on two views at one exposure time."""
    say("building the door and compiling, where this was not done yet")
    door()
    planes = (replace(p, exposures_ms=p.exposures_ms[:1]) for p in plan.planes[:2])
    small = fewer_views(replace(plan, planes=tuple(planes)), slice(1, 2), slice(1, 2))
    measure_observations(small, SimulatedCell.for_plan(small, rings_only=True), workers=_WORKERS)


def rings(plan: MeasuringPlan) -> tuple[ObservationTable, list[Figure]]:
    """Carry the plan out on the bare door, observing the rings' neighbourhoods only."""
    say("48 views × 10 exposures of the bare door, rings only")
    start = time.perf_counter()
    cell = SimulatedCell.for_plan(plan, rings_only=True)
    table = measure_observations(plan, cell, workers=_WORKERS)
    took_s = time.perf_counter() - start
    return table, [at_most("campaign_rings_s", took_s, 30, "s")]


def whole_frames(plan: MeasuringPlan, folder: Path) -> list[Figure]:
    """Write two of the views of every plane as whole captures, start of the workers included."""
    some = fewer_views(plan, slice(0, 3, 2), slice(1, 2))
    count = sum(len(p.x_mm) * len(p.y_mm) * len(p.exposures_ms) for p in some.planes)
    say(f"{count} whole frames of the bare door, written")
    start, cpu = time.perf_counter(), os.times()
    measure(some, SimulatedCell.for_plan(some), folder / "campaign", workers=_WORKERS)
    took_s = (time.perf_counter() - start) / count
    worked = np.subtract(os.times(), cpu)[:4].sum() / count  # user and system, workers included
    say(f"  {worked:.2f} s of CPU time each")
    return [at_most("campaign_full_s_per_capture", took_s, 1.5, "s")]


def depth(plan: MeasuringPlan, part: Part, tracer: SceneTracer) -> list[Figure]:
    """Hold whole frames of primer against the mesh: one view in every plane, best exposure."""
    say("depth on primer, one view in every plane at all its exposures")
    stripes = StripeSensor(sensor=plan.sensor)
    some = fewer_views(plan, slice(1, 2), slice(1, 2))
    planned = some.views(part)
    error = np.concatenate([_depth_errors(stripes, tracer, view) for view in planned])
    bias_mm = float(np.median(error))
    return [
        at_most("depth_median_mm", float(np.median(np.abs(error))), 0.1, "mm"),
        Figure(
            name="depth_bias_mm",
            value=bias_mm,
            unit="mm",
            mark="−0.02 … 0.02",
            met=abs(bias_mm) <= 0.02,
        ),
    ]


def _depth_errors(
    stripes: StripeSensor, tracer: SceneTracer, view: PlannedView
) -> NDArray[np.float32]:
    """Return measured less true depth in mm of all points at a view's best exposure."""
    light = stripes.look(tracer, view.camera_from_part)
    best = _fullest(
        lambda t: stripes.capture(light, t, view=view.name, seed=_seed(view, t)),
        view.exposures_ms,
    )
    (true,) = trace_view(tracer, stripes.sensor, view.camera_from_part).tiles
    error: NDArray[np.float32] = best.require_cloud().points[..., 2] - true.depth_mm
    error = error[np.isfinite(error)]
    say(
        f"  {view.name}, {best.exposure_ms:g} ms: {error.size} points, median "
        f"{np.median(np.abs(error)):.4f} mm, bias {np.median(error):+.4f} mm"
    )
    return error


def camera() -> list[Figure]:
    """Measure the simulated camera on flat fields."""
    say("flat fields")
    electronics = CameraElectronics()
    flats = take_flat_fields(electronics, sensor_preset("comet-pro-ae").exposure)
    gain_error_percent = 100 * abs(flats.gain_dn_per_e / electronics.gain - 1)
    return [
        at_most("linearity_percent", flats.linearity_error_percent, 0.5, "%"),
        at_most("photon_transfer_gain_error_percent", gain_error_percent, 2, "%"),
    ]


def behaviour(bare: ObservationTable, primer: ObservationTable) -> list[Figure]:
    """Say how p_norm behaves with brightness on both finishes, and how it differs by pose."""
    say("p_norm over brightness")
    bright = _median_p_norm(bare, "bare", 130, 150)
    figures = [
        at_least("primer_plateau", _median_p_norm(primer, "primer", *_PLATEAU), 0.95),
        at_most("primer_dark", _median_p_norm(primer, "primer", 0, 12), 0.2),
        at_most("primer_bright", _median_p_norm(primer, "primer", 160, 255), 0.1),
        Figure(name="bare_bright", value=bright, mark="0.15 … 0.7", met=0.15 <= bright <= 0.7),
    ]
    plateaus = plateaus_of_poses(bare)
    low, high = np.percentile(plateaus, [5, 95])
    say(f"  plateaus of {plateaus.size} poses on bare sheet: 5 % {low:.3f}, 95 % {high:.3f}")
    return [*figures, at_least("plateau_spread", float(high - low), 0.05)]


def _median_p_norm(table: ObservationTable, finish: str, low: float, high: float) -> float:
    """Return the median p_norm of all observations between two brightnesses."""
    frame = table.measured().frame
    p_norm = frame.filter(frame["i_avg"].is_between(low, high))["p_norm"].to_numpy()
    if not p_norm.size:
        msg = f"no observation of {finish} has from {low:g} to {high:g} grey levels"
        raise RuntimeError(msg)
    p5, p50, p95 = np.percentile(p_norm, [5, 50, 95])
    say(
        f"  {finish}, {low:g} to {high:g} grey levels: {p_norm.size} observations, "
        f"5 % {p5:.3f}, median {p50:.3f}, 95 % {p95:.3f}"
    )
    return float(p50)


def plateaus_of_poses(table: ObservationTable) -> NDArray[np.float64]:
    """Return each pose's plateau: the median p_norm of one feature in one view on `_PLATEAU`.

    Poses without an observation there have none. Views that were aligned by the robot's
    kinematics alone count like all others.
    """
    frame = table.measured().frame
    on_plateau = frame.filter(frame["i_avg"].is_between(*_PLATEAU))
    poses = on_plateau.group_by("view", "feature").agg(pl.col("p_norm").median())
    return poses["p_norm"].to_numpy()


def stereo(part: Part, tracer: SceneTracer) -> list[Figure]:
    """Take primer at 0.5 m with the active stereo sensor, at all exposures of its plan."""
    say("active stereo on primer at 0.5 m")
    plan = plan_preset("stereo-x")
    sensor = plan.sensor
    plane = DepthPlane(
        name="half-a-metre",
        z_tcp_mm=_STEREO_AT_MM - float(sensor.camera_from_tcp.translation_mm[2]),
        x_mm=(0.0,),
        y_mm=(0.0,),
        exposures_ms=plan.planes[0].exposures_ms,
    )
    (view,) = replace(plan, planes=(plane,)).views(part)
    dots = DotSensor(sensor=sensor)
    light = dots.look(tracer, view.camera_from_part)

    def take(exposure_ms: float) -> Capture:
        return dots.capture(light, exposure_ms, view=view.name, seed=_seed(view, exposure_ms))

    take(view.exposures_ms[0])  # all is compiled
    start = time.perf_counter()
    light = dots.look(tracer, view.camera_from_part)
    best = _fullest(take, view.exposures_ms)
    took_s = (time.perf_counter() - start) / len(view.exposures_ms)
    (true,) = trace_view(tracer, sensor, view.camera_from_part).tiles
    there = np.abs(true.depth_mm - _STEREO_AT_MM) <= _STEREO_REACH_MM
    error = (best.require_cloud().points[..., 2] - true.depth_mm)[there]
    measured = error[np.isfinite(error)]
    say(
        f"  {best.exposure_ms:g} ms: {measured.size} points in {error.size} px, "
        f"bias {np.median(measured):+.3f} mm"
    )
    return [
        at_most("stereo_capture_s", took_s, 2, "s"),
        at_most("stereo_depth_median_mm_at_0.5m", float(np.median(np.abs(measured))), 0.7, "mm"),
    ]


def _fullest(take: Callable[[float], Capture], exposures_ms: tuple[float, ...]) -> Capture:
    """Take captures at all exposure times and return the one with the most points."""
    return max(map(take, exposures_ms), key=lambda capture: capture.require_cloud().n_valid)


def _seed(view: PlannedView, exposure_ms: float) -> tuple[int, ...]:
    return (*view_seed(_SEED, view.name), round(1000 * exposure_ms))


def main() -> None:
    """Run everything; memory is that of this process and its workers together."""
    plan = plan_preset("x")
    warm_up(plan)
    with tempfile.TemporaryDirectory() as name, PeakMemory() as memory:
        folder = Path(name)
        bare, timed = rings(plan)
        timed += whole_frames(plan, folder)
        say("the same 48 views of the door with its inside in primer, rings only")
        scene = primed(door())
        export_scene(folder / "primed", scene, plan.sensor)
        longer = with_longer_exposures(plan)
        cell = SimulatedCell.for_plan(longer, rings_only=True, scene=folder / "primed")
        primer = measure_observations(longer, cell, workers=_WORKERS)
        tracer = SceneTracer(scene)
        measured = [
            *depth(plan, scene.part, tracer),
            *camera(),
            *behaviour(bare, primer),
            *stereo(scene.part, tracer),
        ]
    held = memory.peak_gb
    if held is None:
        say("memory could not be watched: there is no /proc on this system")
        peak = Figure(name="peak_rss_gb", value=None, unit="GB", mark="≤ 4")
    else:
        peak = at_most("peak_rss_gb", held, 4, "GB")
    publish("the simulated cell", [*timed, peak, *measured])


if __name__ == "__main__":
    main()
