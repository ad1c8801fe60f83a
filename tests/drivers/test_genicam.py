"""The GenICam driver against the simulated cell, served over GigE Vision on loopback."""

from __future__ import annotations

import hashlib
import subprocess
import sys
import time

import numpy as np
import pytest
from tests.drivers.serving import EXPOSURES_MS, ServedProcess, small_plan

from exposight.aravis_library import aravis
from exposight.cell import CampaignFolder
from exposight.drivers import GenicamDriver
from exposight.errors import SensorError
from exposight.measuring import measure_observations
from exposight.observing import observe_campaign

try:
    aravis()
except SensorError as error:
    pytest.skip(f"GigE Vision is not tested: {error}", allow_module_level=True)

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def served(tmp_path_factory):
    with ServedProcess(tmp_path_factory.mktemp("served"), small_plan()) as process:
        yield process


def test_frames_are_the_simulated_cell_s_at_five_exposure_times(served):
    cell, driver = served.cell, GenicamDriver.of_file(served.cell_file)
    view = small_plan().views(cell.part)[0]
    try:
        for exposure_ms in EXPOSURES_MS:
            taken = driver.capture(exposure_ms, view.camera_from_part, view=view.name)
            wanted = cell.capture(exposure_ms, view.camera_from_part, view=view.name)
            assert taken.exposure_ms == exposure_ms
            assert np.array_equal(taken.image, wanted.image)
            assert np.array_equal(taken.stack.maximum, wanted.stack.maximum)
            assert np.array_equal(taken.stack.modulation, wanted.stack.modulation)
            points, expected = taken.cloud.points, wanted.cloud.points
            assert np.array_equal(points, expected, equal_nan=True)
            assert taken.camera_from_part == wanted.camera_from_part
    finally:
        driver.close()


def measuring(served, output):
    return [
        *(sys.executable, "-m", "exposight", "measure", str(served.plan_file)),
        *("--driver", "genicam", "--cell", str(served.cell_file), "-o", str(output)),
    ]


def checksums(folder):
    return {
        path.relative_to(folder): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in sorted((folder / "captures").rglob("*"))
        if path.is_file()
    }


def test_a_run_that_was_unplugged_goes_on_with_nothing_lost(served, tmp_path):
    output = tmp_path / "campaign"
    run = subprocess.Popen(measuring(served, output), stderr=subprocess.PIPE, text=True)
    deadline = time.monotonic() + 60
    while len(list(output.glob("captures/*/capture.json"))) < 2:
        assert run.poll() is None
        assert time.monotonic() < deadline
        time.sleep(0.02)
    served.kill()
    _, message = run.communicate(timeout=60)
    assert run.returncode == 1
    assert "Traceback" not in message
    kept = checksums(output)
    served.start()
    again = subprocess.run(measuring(served, output), capture_output=True, text=True, timeout=90)
    assert again.returncode == 0, again.stderr
    assert kept.items() <= checksums(output).items()
    campaign = CampaignFolder(output)
    assert len(campaign) == 2 * len(EXPOSURES_MS)
    simulated = measure_observations(small_plan(), served.cell).frame
    assert observe_campaign(campaign).frame.equals(simulated)
