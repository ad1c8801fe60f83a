"""The GenICam driver against the simulated cell, served over GigE Vision on loopback."""

from __future__ import annotations

import subprocess

import pytest
from tests.drivers.serving import (
    ServedProcess,
    frames_exact,
    measuring,
    small_plan,
    unplug_and_resume,
)

from exposight.aravis_library import aravis
from exposight.errors import SensorError

try:
    aravis()
except SensorError as error:
    pytest.skip(f"GigE Vision is not tested: {error}", allow_module_level=True)

pytestmark = pytest.mark.slow


def test_frames_are_the_simulated_cell_s_at_five_exposure_times(tmp_path):
    with ServedProcess(tmp_path, small_plan()) as served:
        assert frames_exact(served)


def test_a_run_that_was_unplugged_goes_on_with_nothing_lost(tmp_path):
    with ServedProcess(tmp_path, small_plan((17.0, 150.0))) as served:
        message = unplug_and_resume(served, tmp_path / "campaign")
        assert "Traceback" not in message
        assert "view 'near-" in message


def test_no_devices_at_all_end_in_a_line(tmp_path):
    with ServedProcess(tmp_path, small_plan((17.0,))) as served:
        served.kill()
        ended = subprocess.run(
            measuring(served, tmp_path / "campaign"), capture_output=True, text=True, timeout=60
        )
    assert ended.returncode == 1
    assert "no camera is called 'EXPOSIGHT'" in ended.stderr
    assert "Traceback" not in ended.stderr
