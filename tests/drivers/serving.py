"""A small simulated cell, and a process that serves it as a GigE Vision camera on loopback."""

from __future__ import annotations

import hashlib
import os
import signal
import subprocess
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
from filelock import FileLock

from exposight.cell import CampaignFolder, ExposureRange, closing_driver, sensor_preset
from exposight.drivers import GenicamDriver
from exposight.measuring import measure_observations
from exposight.observing import observe_campaign
from exposight.plans import PLANS, DepthPlane, MeasuringPlan, write_plan
from exposight.twin import SimulatedCell

_START_S = 60.0
_RUN_S = 120.0
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


def frames_exact(served: ServedProcess) -> bool:
    """Take a view at every exposure time over the network, and compare with the cell itself."""
    cell, driver = served.cell, GenicamDriver.of_file(served.cell_file)
    view = served.plan.views(cell.part)[0]
    with closing_driver(driver):
        for exposure_ms in view.exposures_ms:
            taken = driver.capture(exposure_ms, view.camera_from_part, view=view.name)
            wanted = cell.capture(exposure_ms, view.camera_from_part, view=view.name)
            same = (
                taken.exposure_ms == exposure_ms
                and taken.camera_from_part == wanted.camera_from_part
                and np.array_equal(taken.image, wanted.image)
                and np.array_equal(taken.stack.maximum, wanted.stack.maximum)
                and np.array_equal(taken.stack.modulation, wanted.stack.modulation)
                and np.array_equal(taken.cloud.points, wanted.cloud.points, equal_nan=True)
            )
            if not same:
                return False
    return True


def measuring(served: ServedProcess, output: Path) -> list[str]:
    """Return the command that measures the plan through the served devices."""
    return [
        *(sys.executable, "-m", "exposight", "measure", str(served.plan_file)),
        *("--driver", "genicam", "--cell", str(served.cell_file), "-o", str(output)),
    ]


def checksums(folder: Path) -> dict[Path, str]:
    """Return the checksum of every file of the captures."""
    return {
        path.relative_to(folder): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in sorted((folder / "captures").rglob("*"))
        if path.is_file()
    }


def unplug_and_resume(served: ServedProcess, output: Path) -> str:
    """Kill the served devices in mid-run and measure on; return what the broken run said.

    Raises
    ------
    AssertionError
        If the run ends otherwise than with a message, or anything is lost or other than simulated.
    """
    run = subprocess.Popen(measuring(served, output), stderr=subprocess.PIPE, text=True)
    deadline = time.monotonic() + _RUN_S
    while not list(output.glob("captures/*/capture.json")):
        assert run.poll() is None
        assert time.monotonic() < deadline
        time.sleep(0.02)
    served.kill()
    _, message = run.communicate(timeout=_RUN_S)
    assert run.returncode == 1, message
    kept = checksums(output)
    served.start()
    again = subprocess.run(
        measuring(served, output), capture_output=True, text=True, timeout=_RUN_S, check=False
    )
    assert again.returncode == 0, again.stderr
    assert kept.items() <= checksums(output).items()
    there = observe_campaign(CampaignFolder(output)).frame
    simulated = measure_observations(served.plan, served.cell).frame
    columns = ["feature", "view", "exposure_ms", "p_norm", "i_avg"]
    assert there[columns].equals(simulated[columns])
    return message
