"""A small simulated cell, and a process that serves it as a GigE Vision camera on loopback."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path

from filelock import FileLock

from exposight.cell import ExposureRange, sensor_preset
from exposight.plans import PLANS, DepthPlane, MeasuringPlan, write_plan
from exposight.twin import SimulatedCell

_START_S = 60.0
EXPOSURES_MS = (5.0, 17.0, 60.0, 150.0, 400.0)
"""From dark to clipped."""


def small_plan(exposures_ms=EXPOSURES_MS) -> MeasuringPlan:
    """Return a plan of two views of the door with a camera of few pixels."""
    full = sensor_preset("comet-pro-ae")
    camera = replace(
        full.camera,
        width=308, height=204, fx=full.camera.fx / 8, fy=full.camera.fy / 8, cx=153.5, cy=101.5,
    )  # fmt: skip
    sensor = replace(
        full,
        name="served",
        cameras=(camera,),
        exposure=ExposureRange(min_ms=1.0, max_ms=1000.0, increment_ms=0.001),
    )
    plane = DepthPlane(
        name="near", z_tcp_mm=0.0, x_mm=(-60.0, 60.0), y_mm=(0.0,), exposures_ms=exposures_ms
    )
    small = PLANS["small"]
    return replace(small, name="served", sensor=sensor, planes=(plane,), random=(), simulated={})


def served_alone() -> FileLock:
    """Return the lock of the one port that the protocol has on this machine."""
    name = f"exposight-gige-{os.getuid()}.lock"
    return FileLock(Path(tempfile.gettempdir()) / name, timeout=300)


class ServedProcess:
    """`exposight simulate --serve-as gige-vision`, which may be killed and begun again."""

    def __init__(self, folder: Path, plan: MeasuringPlan) -> None:
        self.folder, self.plan = folder, plan
        self.plan_file = folder / "plan.toml"
        write_plan(self.plan_file, plan)
        self.cell_file = folder / "served" / "cell.toml"
        self._lock = served_alone()
        self._process: subprocess.Popen[bytes] | None = None

    def __enter__(self) -> ServedProcess:
        self._lock.acquire()
        try:
            self.start()
        except BaseException:
            self._lock.release()
            raise
        return self

    def __exit__(self, *_: object) -> None:
        self.kill()
        self._lock.release()

    @property
    def cell(self) -> SimulatedCell:
        """The same cell in this process."""
        return SimulatedCell.for_plan(self.plan)

    def start(self) -> None:
        """Begin, and wait until the cell answers."""
        self.cell_file.unlink(missing_ok=True)
        self._process = subprocess.Popen(
            [
                *(sys.executable, "-m", "exposight", "simulate", str(self.plan_file)),
                *("--serve-as", "gige-vision", "-o", str(self.cell_file.parent)),
            ],
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
        )
        deadline = time.monotonic() + _START_S
        while not self.cell_file.exists():
            if self._process.poll() is not None:
                assert self._process.stderr is not None
                raise RuntimeError(self._process.stderr.read().decode())
            if time.monotonic() > deadline:
                self.kill()
                msg = f"the cell did not answer within {_START_S:g} s"
                raise RuntimeError(msg)
            time.sleep(0.05)

    def kill(self) -> None:
        """Unplug camera, projector and robot at once."""
        if self._process is not None:
            self._process.send_signal(signal.SIGKILL)
            self._process.wait()
            assert self._process.stderr is not None
            self._process.stderr.close()
            self._process = None
