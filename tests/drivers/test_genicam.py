"""The GenICam driver against the simulated cell, served over GigE Vision on loopback."""

from __future__ import annotations

import subprocess
from dataclasses import replace

import pytest
from tests.drivers.serving import (
    ServedProcess,
    frames_exact,
    measuring,
    small_plan,
    unplug_and_resume,
)
from tests.measuring.conftest import plate_exposure_plan

from exposight.aravis_library import aravis
from exposight.cell import CampaignFolder, closing_driver
from exposight.drivers import GenicamDriver
from exposight.errors import SensorError
from exposight.measuring import measure_adaptively
from exposight.planning import ExposureLimits, FeatureOutlook, PlannedExposure
from exposight.planning.exposure_plan import PlanView

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


def test_an_exposure_plan_is_carried_out_with_the_served_devices(tmp_path):
    plan = small_plan((17.0, 60.0))
    with ServedProcess(tmp_path, plan) as served:
        view = plan.views(served.cell.part)[0]
        driver = GenicamDriver.of_file(served.cell_file)
        loop = replace(
            plate_exposure_plan(),
            sensor="served",
            part="door",
            limits=ExposureLimits.of(plan.sensor),
            views=(
                PlanView(
                    name=view.name,
                    camera_from_part=view.camera_from_part,
                    exposures=tuple(
                        PlannedExposure(
                            exposure_ms=ms, set_value=ms, set_unit="ms", order=i, covers=()
                        )
                        for i, ms in enumerate(view.exposures_ms, start=1)
                    ),
                ),
            ),
            features=tuple(
                FeatureOutlook(
                    feature=name, status="planned", chance=0.9, view=view.name, exposure_ms=60.0
                )
                for name in view.visible[:4]
            ),
        )
        with closing_driver(driver):
            result = measure_adaptively(loop, driver, tmp_path / "loop", models=None)
    taken = [each.exposure_ms for each in CampaignFolder(tmp_path / "loop").captures()]
    assert taken == [17.0, 60.0]
    assert len(result.decisions) == 2


def test_no_devices_at_all_end_in_a_line(tmp_path):
    with ServedProcess(tmp_path, small_plan((17.0,))) as served:
        served.kill()
        ended = subprocess.run(
            measuring(served, tmp_path / "campaign"), capture_output=True, text=True, timeout=60
        )
    assert ended.returncode == 1
    assert "no camera is called 'EXPOSIGHT'" in ended.stderr
    assert "Traceback" not in ended.stderr
