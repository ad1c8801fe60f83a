"""The simulated cell with one's own part and sensor, and what its defaults rest on.

Run with ``make bench NAME=cell``; about a minute on two cores. One plate is meshed coarsely, as a
CAD program does, with corners where edges are and nowhere else, and finely; sensors are described
as a user would describe them; the brightness at which points are lost stands beside the paper's.
"""

from __future__ import annotations

import math
import tempfile
from collections.abc import Iterable
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
from numpy.typing import NDArray
from scipy.spatial import Delaunay

from benchmarks.measuring import Figure, at_least, at_most, publish, say
from exposight.cell import (
    ActiveSensor,
    Capture,
    ExposureRange,
    Feature,
    Part,
    Projector,
    sensor_preset,
)
from exposight.geometry import PinholeCamera, RigidTransform
from exposight.imaging import AxisCoding, GrayCode, PatternSequence
from exposight.measuring import measure_observations
from exposight.observing import Observation, observe_capture, point_search, view_features
from exposight.plans import plan_preset
from exposight.twin import AlignmentErrors, SimulatedCell, SimulatedCellSettings, scene_at
from exposight.twin.light import SceneTracer, trace_view
from exposight.twin.part import FINISHES, Scene, export_scene
from exposight.twin.sensors import StripeSensor

_HOLES = ((-70.0, -30.0, 4.0), (-20.0, 25.0, 8.0), (35.0, -20.0, 12.0), (90.0, 20.0, 20.0))
"""x, y and radius in mm of the plate's holes."""
_HALF_MM = (130.0, 60.0)
_THICKNESS_MM = 3.0
_BEVEL_MM = 1.0
_EXPOSURES_MS = (8.0, 12.0, 18.0, 27.0, 40.0, 60.0, 90.0, 135.0, 200.0)
_PLATEAU = (30.0, 110.0)
_SEED = (1,)


def bevelled_plate(step_mm: float | None, finish: str) -> Scene:
    """Return a plate with holes and a bevel all round.

    Parameters
    ----------
    step_mm : float or None, mm
        Edge of its triangles; None for corners on its edges alone, as CAD programs mesh it.
    finish : str
        Of all of it.
    """
    half = np.array(_HALF_MM)
    loops: list[NDArray[np.float64]] = [_rectangle(half, step_mm)]
    for x, y, radius in _HOLES:
        count = 72 if step_mm is None else max(72, math.ceil(2 * math.pi * radius / step_mm))
        angle = 2 * math.pi * np.arange(count) / count
        loops.append(np.stack([x + radius * np.cos(angle), y + radius * np.sin(angle)], axis=-1))
    if step_mm is not None:
        grid = [np.arange(-h + step_mm, h - step_mm / 2, step_mm) for h in _HALF_MM]
        inner: NDArray[Any] = np.stack(np.meshgrid(*grid), axis=-1).reshape(-1, 2)
        for x, y, radius in _HOLES:
            inner = inner[np.hypot(inner[:, 0] - x, inner[:, 1] - y) > radius + step_mm / 2]
        loops.append(inner)
    points = np.concatenate(loops)
    front: NDArray[Any] = np.asarray(Delaunay(points).simplices)
    middle: NDArray[Any] = points[front].mean(axis=1)
    keep = np.ones(len(front), dtype=bool)
    for x, y, radius in _HOLES:  # chords stay inside the circle
        keep &= np.hypot(middle[:, 0] - x, middle[:, 1] - y) > radius * math.cos(math.pi / 72)
    front = front[keep]
    # Rings of points from the front's border over the bevel to the back.
    outer = loops[0]
    edge = outer * (half + _BEVEL_MM) / half
    layers = [
        np.column_stack([outer, np.zeros(len(outer))]),
        np.column_stack([edge, np.full(len(edge), _BEVEL_MM)]),
        np.column_stack([edge, np.full(len(edge), _THICKNESS_MM)]),
    ]
    vertices = np.concatenate([np.column_stack([points, np.zeros(len(points))]), *layers])
    faces = [front[:, ::-1]]
    n = len(outer)
    for i in range(2):
        low = len(points) + i * n + np.arange(n)
        high, around = low + n, np.roll(np.arange(n), -1)
        ahead, above = low[around], high[around]
        faces += [np.column_stack([low, ahead, high]), np.column_stack([high, ahead, above])]
    features = tuple(
        Feature(
            name=f"h{i}",
            kind="hole",
            part_from_feature=RigidTransform(translation_mm=np.array([x, y, 0.0])),
            radius_mm=radius,
        )
        for i, (x, y, radius) in enumerate(_HOLES)
    )
    joined = np.concatenate(faces).astype(np.int32)
    return Scene(
        vertices=vertices,
        faces=joined,
        face_finish=np.full(len(joined), FINISHES.index(finish), dtype=np.uint8),
        part=Part(name="plate", features=features),
    )


def _rectangle(half: NDArray[np.float64], step_mm: float | None) -> NDArray[np.float64]:
    corners: NDArray[np.float64] = half * np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)])
    if step_mm is None:
        return corners
    sides = []
    for start, end in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        count = math.ceil(float(np.linalg.norm(end - start)) / step_mm)
        sides.append(start + (end - start) * np.arange(count)[:, None] / count)
    return np.concatenate(sides)


def coarse_and_fine() -> list[Figure]:
    """Measure the same plate, meshed coarsely and finely, with the same noise."""
    say("a plate of bare sheet, meshed coarsely and finely")
    pose = RigidTransform.from_fanuc_wpr((0.0, 0.0, 600.0), 6.0, -1.0, 0.0)
    stripes = StripeSensor(sensor=sensor_preset("comet-pro-ae"))
    p_norm, radiance = [], []
    for step_mm in (None, 2.0):
        scene = bevelled_plate(step_mm, "bare")
        tracer = SceneTracer(scene)
        say(f"  {len(scene.faces)} triangles")
        light = stripes.look(tracer, pose)
        rows = []
        for exposure_ms in _EXPOSURES_MS:
            capture = stripes.capture(light, exposure_ms, view="plate", seed=_SEED)
            rows.append([row.p_norm for row in observed(capture, scene.part, stripes.sensor)])
        p_norm.append(rows)
        views = view_features(scene.part, stripes.sensor, pose)
        radiance.append([light.tiles[0].even[v.rows, v.columns].mean() for v in views])
    difference = np.abs(np.subtract(*np.array(p_norm, dtype=np.float64))).max()
    coarse, fine = np.array(radiance, dtype=np.float64)
    percent = 100 * np.abs(coarse / fine - 1).max()
    return [
        at_most("coarse_fine_p_norm_difference", float(difference), 0.02),
        at_most("coarse_fine_radiance_percent", float(percent), 1.0, "%"),
    ]


def observed(capture: Capture, part: Part, sensor: ActiveSensor) -> list[Observation]:
    """Return a capture's observations."""
    views = view_features(part, sensor, capture.camera_from_part)
    return observe_capture(capture, views, point_search(capture.require_cloud(), sensor.camera))


def brightness() -> list[Figure]:
    """Say between which brightnesses the paper's X plan lies here, as in its Table 9."""
    say("the paper's X plan")
    plan = plan_preset("x")
    cell = SimulatedCell.for_plan(plan, rings_only=True)
    frame = measure_observations(plan, cell, workers=2).measured().frame
    good = float(frame.filter(pl.col("p_norm") >= 0.75)["i_avg"].to_numpy().max())
    least = float(frame["i_avg"].to_numpy().min())
    return [
        Figure(name="max_i_avg_good", value=good, mark="115 … 140", met=115 <= good <= 140),
        Figure(name="min_i_avg", value=least, mark="10 … 16", met=10 <= least <= 16),
    ]


def camera(width: int, height: int, focal_px: float, *distortion: float) -> PinholeCamera:
    """Return a camera that nobody would call ideal."""
    return PinholeCamera(
        width=width,
        height=height,
        fx=focal_px,
        fy=focal_px * 1.001,
        cx=width / 2 - 11.3,
        cy=height / 2 + 7.9,
        distortion=distortion,
    )


def stereo_head() -> ActiveSensor:
    """Return a stereo head of 120 mm and 5 megapixels; both cameras distort and are turned."""
    return ActiveSensor(
        name="stereo head of 120 mm",
        cameras=(
            camera(2448, 2048, 3380.0, -0.11, 0.09, 4e-4, -2e-4),
            camera(2448, 2048, 3362.0, -0.10, 0.07, -3e-4, 3e-4),
        ),
        first_from_camera=(
            RigidTransform(),
            RigidTransform.from_fanuc_wpr((120.0, 0.8, -2.1), 0.4, -10.5, 0.6),
        ),
        projector=Projector(
            camera=camera(1920, 1080, 2320.0, 0.02, -0.01, 3e-4, 0.0),
            camera_from_projector=RigidTransform.from_fanuc_wpr((62.0, -48.0, 6.0), 4.0, -5.0, 0.3),
        ),
        camera_from_tcp=RigidTransform(translation_mm=np.array([55.0, 0.0, 600.0])),
        exposure=ExposureRange(min_ms=0.1, max_ms=500.0, increment_ms=0.1),
        working_distance_mm=(450.0, 750.0),
        simulated={"matt_white": {"grey_levels": 110, "exposure_ms": 8}},
    )


def stripe_scanner(**table: object) -> ActiveSensor:
    """Return a structured-light sensor of 1280 × 800 px with a projector of 1280 × 720."""
    return ActiveSensor(
        name="scanner of 1280 × 800",
        cameras=(camera(1280, 800, 1750.0, -0.09, 0.05, 3e-4, 1e-4),),
        first_from_camera=(RigidTransform(),),
        projector=Projector(
            camera=camera(1280, 720, 1500.0, 0.03, -0.02, 0.0, 5e-4),
            camera_from_projector=RigidTransform.from_fanuc_wpr((-160.0, 6.0, 4.0), 0.6, 17.0, 0.4),
        ),
        camera_from_tcp=RigidTransform(translation_mm=np.array([0.0, 0.0, 500.0])),
        exposure=ExposureRange(min_ms=0.5, max_ms=500.0, increment_ms=0.1),
        working_distance_mm=(380.0, 650.0),
        simulated={"matt_white": {"grey_levels": 100, "exposure_ms": 10}, **table},
    )


def own_sensors(folder: Path) -> list[Figure]:
    """Measure the fine plate in primer with sensors that nobody made a preset of."""
    figures = []
    for name, sensor in (
        ("stereo", stereo_head()),
        ("stripes", stripe_scanner(fringes=[1, 6, 40], camera={"read_noise_e": 8, "prnu": 0.01})),
    ):
        say(f"primer by a {sensor.name}")
        captures = take(sensor, folder, (4.0, 8.0, 16.0, 32.0))
        best = max(captures, key=lambda capture: capture.require_cloud().n_valid)
        (true,) = trace_view(SceneTracer(scene_at(folder)), sensor, before(sensor)).tiles
        error = best.require_cloud().points[..., 2] - true.depth_mm
        error = error[np.isfinite(error)]
        median, bias = float(np.median(np.abs(error))), float(np.median(error))
        say(f"  {best.exposure_ms:g} ms: {error.size} points, bias {bias:+.4f} mm")
        figures += [
            at_most(f"own_sensor_{name}_depth_median_mm", median, 0.15, "mm"),
            Figure(
                name=f"own_sensor_{name}_depth_bias_mm",
                value=bias,
                unit="mm",
                mark="−0.02 … 0.02",
                met=abs(bias) <= 0.02,
            ),
        ]
    return figures


def before(sensor: ActiveSensor) -> RigidTransform:
    """Return where the plate stands: at the TCP, tilted."""
    tilt = RigidTransform.from_fanuc_wpr((0.0, 0.0, 0.0), 5.0, -2.0, 1.0)
    return sensor.camera_from_tcp @ tilt


def take(sensor: ActiveSensor, folder: Path, exposures_ms: Iterable[float]) -> list[Capture]:
    """Capture a scene at the TCP at several exposure times."""
    exact = AlignmentErrors(photogrammetric_mm=0, photogrammetric_deg=0)
    cell = SimulatedCell(sensor, SimulatedCellSettings(scene=folder, alignment=exact))
    return [cell.capture(t, before(sensor), view="plate") for t in exposures_ms]


def gray_code(folder: Path) -> list[Figure]:
    """Observe the plate's rings in primer under a Gray code with white and black frames."""
    say("primer under Gray code")
    bits = GrayCode(frames=tuple(range(2, 12)), code_width=2)
    sequence = PatternSequence(
        name="Gray code",
        projector_width=1280,
        projector_height=720,
        columns=AxisCoding(gray_code=bits),
        white_frame=0,
        black_frame=1,
    )
    sensor = stripe_scanner(sequence=asdict(sequence))
    rows = [
        row
        for capture in take(sensor, folder, (4.0, 6.0, 9.0, 13.0, 20.0))
        for row in observed(capture, scene_at(folder).part, sensor)
    ]
    plateau = [row.p_norm for row in rows if _PLATEAU[0] <= (row.i_avg or 0.0) <= _PLATEAU[1]]
    say(f"  {len(plateau)} observations from {_PLATEAU[0]:g} to {_PLATEAU[1]:g} grey levels")
    return [at_least("gray_code_p_norm_plateau", float(np.median(np.array(plateau))), 0.95)]


def main() -> None:
    """Run everything."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name) / "plate"
        export_scene(folder, bevelled_plate(4.0, "primer"), stripe_scanner())
        publish(
            "the simulated cell: any part, any sensor",
            [*coarse_and_fine(), *brightness(), *own_sensors(folder), *gray_code(folder)],
        )


if __name__ == "__main__":
    main()
