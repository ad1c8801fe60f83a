"""Large tables and campaigns: time and peak memory of training, predicting and observing.

Each is measured in a process of its own, together with its children. A part of it:
``python -m benchmarks.hostile_sizes train``, of `SECTIONS`.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import polars as pl

from benchmarks.measuring import Figure, at_most, publish, say
from exposight.cell import (
    ActiveSensor,
    CampaignWriter,
    Capture,
    Cloud,
    ExposureRange,
    Feature,
    Part,
    sensor_preset,
)
from exposight.geometry import PinholeCamera, RigidTransform
from exposight.models import Training, model_named, save_model
from exposight.models.ring_light import POSE_COLUMNS, RingLight, Rings
from exposight.observing import ObservationTable

TRAINED, LEARNT, PREDICTED, CAPTURES = 50_000, 2000, 1_000_000, 5000
_MODELS = ("quality", "exposure", "q_k4", "e_k6")
_VIEWS = 500
_PERIOD_S = 0.1

_LOAD = """
import sys
from exposight.models import load_model
print(load_model(sys.argv[1]).experts)
"""
_PREDICT = """
import json, sys, time
import numpy as np, polars as pl
from exposight.models import load_model

model, rng, n = load_model(sys.argv[1]), np.random.default_rng(1), int(sys.argv[2])
ranges = model.training_range.items()
frame = pl.DataFrame({name: rng.uniform(low, high, n) for name, (low, high) in ranges})
seen = []
began = time.perf_counter()
many = model.predict(frame, progress=lambda *step: seen.append(step))
wall_s = time.perf_counter() - began
some = rng.choice(n, 2000, replace=False)
few = model.predict(frame[some])
error = float(np.abs(many.std[some] / few.std - 1.0).max())
print(json.dumps({"wall_s": wall_s, "steps": len(seen), "error": error}))
"""


@dataclass(frozen=True, kw_only=True)
class Ran:
    """What a process and its children took: seconds, and 10⁹ bytes at the same time."""

    wall_s: float
    cpu_s: float
    peak_gb: float
    printed: str


def run_apart(*arguments: str | Path) -> Ran:
    """Run Python with arguments, with as many threads as it takes by itself.

    Memory is the sum of the largest resident memory of each process that lives at the same time,
    so that no peak between two looks is missed.

    Raises
    ------
    RuntimeError
        If it fails.
    """
    free = {name: value for name, value in os.environ.items() if not name.endswith("_NUM_THREADS")}
    began = time.perf_counter()
    with subprocess.Popen(
        [sys.executable, *map(str, arguments)],
        env=free,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        encoding="utf-8",
    ) as process:
        peak, over = [0], threading.Event()

        def watch() -> None:
            while not over.wait(_PERIOD_S):
                peak.append(sum(map(_peak_bytes, _family(process.pid))))

        watching = threading.Thread(target=watch)
        watching.start()
        assert process.stdout is not None
        printed = process.stdout.read()
        _, status, usage = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
        over.set()
        watching.join()
    if process.returncode:
        msg = f"exit status {process.returncode} of {arguments}: {printed[-1000:]}"
        raise RuntimeError(msg)
    return Ran(
        wall_s=time.perf_counter() - began,
        cpu_s=usage.ru_utime + usage.ru_stime,
        peak_gb=max(peak) / 1e9,
        printed=printed,
    )


def _family(process: int) -> list[int]:
    found = [process]
    for task in Path(f"/proc/{process}/task").glob("*/children"):
        for child in _read(task).split():
            found += _family(int(child))
    return found


def _peak_bytes(process: int) -> int:
    lines = _read(Path(f"/proc/{process}/status")).splitlines()
    return sum(1024 * int(line.split()[1]) for line in lines if line.startswith("VmHWM:"))


def _read(path: Path) -> str:
    try:
        return path.read_text(encoding="utf-8")
    except OSError:  # it is over
        return ""


def large_table(rows: int, *, exposures: int = 2, seed: int = 1) -> ObservationTable:
    """Return a table as large as no campaign yet: rings of many features in many views.

    Light is that of the formula, with effects of features, views and rings; p_norm falls at both
    ends of a window, as a stripe projector's does.
    """
    rng, sensor = np.random.default_rng(seed), sensor_preset("comet-pro-ae")
    n = rows // exposures
    views = 100 if n >= 2000 else 20
    poses = np.column_stack(
        [
            rng.uniform(-150.0, 150.0, (n, 2)),
            rng.uniform(-60.0, 60.0, n),
            rng.uniform(-15.0, 15.0, (n, 2)),
            np.full(n, 5.0),
        ]
    )
    feature, view = np.arange(n) // views, np.arange(n) % views
    rings = Rings(
        features=tuple(f"f{i}" for i in feature),
        views=tuple(f"v{i}" for i in view),
        poses=poses,
        turns=np.zeros((n, 3)),
    )
    values, _ = RingLight.of(rings, sensor, projector=True).log_radiance(1.0, 0.3)
    log_radiance = np.log(np.mean(np.exp(values), axis=1))
    log_radiance += 1.5 - np.median(log_radiance)
    log_radiance += 0.05 * rng.standard_normal(feature.max() + 1)[feature]
    log_radiance += 0.02 * rng.standard_normal(views)[view] + 0.02 * rng.standard_normal(n)
    # One exposure in each part of the range, so that none comes twice.
    parts = (np.arange(exposures) + rng.random((n, exposures))) / exposures
    exposure_ms = (5.0 * 18.0**parts).ravel().round(3)
    ring = np.repeat(np.arange(n), exposures)
    light = np.exp(log_radiance[ring]) * exposure_ms
    grey = np.minimum(255.0, 3.0 + light)
    edges = (np.log(light / 12.0) / 0.1, np.log(light / 240.0) / 0.05)
    low, high = (0.5 * (1.0 + np.tanh(0.8 * edge)) for edge in edges)
    p_norm = np.clip(low * (1.0 - high) + 0.01 * rng.standard_normal(len(ring)), 0.0, 1.0)
    frame = pl.DataFrame(
        {
            "feature": np.array(rings.features)[ring],
            "view": np.array(rings.views)[ring],
            "exposure_ms": exposure_ms,
            "p_norm": p_norm,
            "i_avg": grey,
            **dict(zip(POSE_COLUMNS, poses[ring].T, strict=True)),
            "r_deg": 0.0,
            "i_mean": grey,
            "clipped_share": np.where(grey >= 250.0, 0.5, 0.0),
            "visibility": "visible",
            "emulated": False,
            "sensor": sensor.name,
        }
    )
    return ObservationTable.from_frame(frame)


def train_figures() -> list[Figure]:
    """Train the default models and two of the paper's on a large table, and load what is large."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        table = folder / "observations.csv"
        large_table(TRAINED).write(table)
        chosen = [word for each in _MODELS for word in ("-m", each)]
        command: list[str | Path] = [
            "-m",
            "exposight",
            "train",
            table,
            *chosen,
            "-o",
            folder / "models",
        ]
        trained = run_apart(*command, "--workers", "2")
        say(f"{', '.join(_MODELS)} of {TRAINED} rows: {trained.wall_s:.0f} s")
        loaded = run_apart("-c", _LOAD, folder / "models" / "q_k4.exposight-model")
        say(f"q_k4 loaded: {loaded.wall_s:.1f} s, {loaded.peak_gb:.2f} GB")
    return [
        at_most("train_50000_rows_peak_gb", trained.peak_gb, 8.0, "GB"),
        Figure(name="train_50000_rows_cpu_s", value=trained.cpu_s, unit="s"),
    ]


def predict_figures() -> list[Figure]:
    """Predict a million rows by a model of 2000, in Python and by the command."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        path, asked = folder / "q_k4.exposight-model", folder / "asked.csv"
        specification = model_named("q_k4")
        model = Training(
            specification=specification, table=large_table(LEARNT), seed=1, restarts=1
        ).run()
        save_model(path, model)
        ran = run_apart("-c", _PREDICT, path, str(PREDICTED))
        told = json.loads(ran.printed)
        say(
            f"predicted in {told['wall_s']:.1f} s, {told['steps']} steps told; standard deviations "
            f"within {told['error']:.1e} of the exact ones"
        )
        rng = np.random.default_rng(1)
        ranges = model.training_range.items()
        columns = {name: rng.uniform(low, high, PREDICTED) for name, (low, high) in ranges}
        pl.DataFrame(columns).write_csv(asked)
        command: list[str | Path] = [
            "-m",
            "exposight",
            "predict",
            path,
            asked,
            "-o",
            folder / "predicted.csv",
        ]
        by_command = run_apart(*command)
        say(f"by the command: {by_command.wall_s:.1f} s, {by_command.peak_gb:.2f} GB")
    return [
        at_most("predict_1e6_rows_s", told["wall_s"], 60.0, "s"),
        at_most("predict_peak_gb", max(ran.peak_gb, by_command.peak_gb), 1.0, "GB"),
    ]


def observe_figures() -> list[Figure]:
    """Observe a campaign of many captures."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        write_campaign(folder / "campaign", CAPTURES)
        command: list[str | Path] = ["-m", "exposight", "observe", folder / "campaign"]
        ran = run_apart(*command, "-o", folder / "observations.csv")
        say(f"{CAPTURES} captures observed: {ran.wall_s:.0f} s, CPU {ran.cpu_s:.0f} s")
    return [at_most("observe_5000_captures_peak_gb", ran.peak_gb, 0.5, "GB")]


def write_campaign(folder: Path, captures: int) -> None:
    """Write captures of a plate with six marked points, in 160 by 120 pixels."""
    camera = PinholeCamera(width=160, height=120, fx=400.0, fy=400.0, cx=79.5, cy=59.5)
    sensor = ActiveSensor(
        name="small",
        cameras=(camera,),
        first_from_camera=(RigidTransform(),),
        projector=None,
        camera_from_tcp=RigidTransform(translation_mm=np.array([0.0, 0.0, 600.0])),
        exposure=ExposureRange(min_ms=1.0, max_ms=1000.0, increment_ms=1.0),
        working_distance_mm=(400.0, 800.0),
    )
    places = [(40.0 * (i % 3) - 40.0, 40.0 * (i // 3) - 20.0, 0.0) for i in range(6)]
    features = tuple(
        Feature(
            name=f"f{i}",
            kind="surface_point",
            part_from_feature=RigidTransform(translation_mm=np.array(place)),
            radius_mm=10.0,
        )
        for i, place in enumerate(places)
    )
    part = Part(name="plate", features=features)
    rng = np.random.default_rng(1)
    rays = np.concatenate([camera.rays(), np.ones((120, 160, 1))], axis=-1)
    with CampaignWriter.open_or_create(folder, name="many", sensor=sensor, part=part) as writer:
        for number in range(captures):
            view, step = divmod(number, CAPTURES // _VIEWS)
            w, p = np.random.default_rng(view).uniform(-6.0, 6.0, 2).tolist()
            pose = RigidTransform.from_fanuc_wpr((0.0, 0.0, 600.0), w, p, 0.0)
            normal = pose.z_axis
            depth = (normal @ pose.translation_mm) / (rays @ normal)
            noise = 1.0 + 1e-5 * rng.standard_normal(depth.shape)
            points = (rays * (depth * noise)[..., None]).astype(np.float32)
            writer.add(
                Capture(
                    view=f"v{view}",
                    exposure_ms=10.0 + step,
                    image=np.full((120, 160), 60 + 10 * step, dtype=np.uint8),
                    cloud=Cloud(points=points),
                    camera_from_part=pose,
                )
            )


SECTIONS: Mapping[str, Callable[[], list[Figure]]] = {
    "train": train_figures,
    "predict": predict_figures,
    "observe": observe_figures,
}


def size_figures() -> list[Figure]:
    """Return the figures of all sections."""
    return [figure for section in SECTIONS.values() for figure in section()]


if __name__ == "__main__":
    chosen = sys.argv[1:] or list(SECTIONS)
    publish("Large tables and campaigns", [f for name in chosen for f in SECTIONS[name]()])
