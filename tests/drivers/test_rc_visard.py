"""The rc_visard's driver against the simulated cell that is served as one, on loopback."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from dataclasses import replace

import numpy as np
import pytest

from exposight import planning, plans
from exposight.cell import CampaignFolder, closing_driver, read_sensor, write_sensor
from exposight.drivers import RcVisardDriver, read_cell
from exposight.drivers.rc_visard_device import RcVisard
from exposight.drivers.rc_visard_images import read_image_set
from exposight.drivers.rc_visard_rest import RcVisardSettings, RestApi
from exposight.errors import ContradictionError, FormatError, InputError, SensorError
from exposight.geometry import RigidTransform
from exposight.measuring import measure, measure_adaptively, measure_observations
from exposight.observing import Observer
from exposight.plans import DepthPlane, MeasuringPlan
from exposight.rc_visard_messages import grpc_library
from exposight.twin import ServedRcVisard
from exposight.twin.served_rc_visard import Misbehaviour

try:
    grpc_library()
except SensorError as error:
    pytest.skip(f"the rc_visard is not tested: {error}", allow_module_level=True)

POSE = RigidTransform.from_fanuc_wpr((0.0, 0.0, 500.0), 6.0, -1.0, 0.0)
QUICK = {"images_timeout_s": 1.0, "timeout_s": 0.5, "tries": 3}


@pytest.fixture
def served(stereo_cell, tmp_path):
    with ServedRcVisard(stereo_cell, tmp_path / "served") as server:
        yield server


@pytest.fixture
def wrong(served) -> Misbehaviour:
    return served.device.misbehaviour


@pytest.fixture
def driver(served):
    with closing_driver(driver_of(served)) as made:
        yield made


def driver_of(served, **settings):
    """The driver, with other waits than those of the cell's file."""
    cell = read_cell(served.cell_file)
    device = replace(cell.file.rc_visard, **{**QUICK, **settings})
    return RcVisardDriver(replace(cell, file=replace(cell.file, rc_visard=device)))


def values(served):
    return {name: served.device.value("rc_camera", name) for name in ("exp_control", "exp_value")}


def test_captures_are_the_simulated_cell_s_at_full_resolution(served, driver, stereo_cell):
    served.device.set("rc_stereomatching", "quality", "Full")
    for exposure_ms in (3.0, 8.0, 18.0):
        taken = driver.capture(exposure_ms, POSE, view="a")
        wanted = stereo_cell.capture(exposure_ms, POSE, view="a")
        assert taken.exposure_ms == exposure_ms
        assert taken.camera_from_part == wanted.camera_from_part
        assert np.array_equal(taken.image, wanted.image)
        assert np.array_equal(taken.stack.maximum, wanted.stack.maximum)
        assert np.array_equal(taken.cloud.valid, wanted.cloud.valid)
        off = np.abs(taken.cloud.points - wanted.cloud.points)
        # half a step of disparity, 1/32 px, at 0.5 m
        assert np.nanmax(off) < 0.15 if wanted.cloud.n_valid else True


def test_a_disparity_of_half_the_resolution_is_counted_by_its_own_grid(driver, stereo_cell):
    taken = driver.capture(8.0, POSE, view="a")
    assert taken.cloud.points.shape == (104, 240, 3)
    assert taken.image.shape == (208, 480)
    observer = Observer(stereo_cell.part, stereo_cell.sensor)
    half = observer.observe(taken)
    whole = observer.observe(stereo_cell.capture(8.0, POSE, view="a"))
    for coarse, fine in zip(half, whole, strict=True):
        assert coarse.p_norm == pytest.approx(fine.p_norm, abs=0.05)
        assert coarse.n_pixels == pytest.approx(fine.n_pixels / 4, rel=0.1)
        assert coarse.i_avg == fine.i_avg


def test_settings_are_restored(served, driver):
    before = values(served)
    driver.capture(8.0, POSE, view="a")
    assert values(served) == {"exp_control": "Manual", "exp_value": 0.008}
    assert served.device.value("rc_iocontrol", "out1_mode") == "ExposureActive"
    driver.close()
    driver.close()
    assert values(served) == before == {"exp_control": "Auto", "exp_value": 0.005}
    assert served.device.value("rc_iocontrol", "out1_mode") == "Low"


def test_older_firmware_is_set_by_its_own_names(served):
    nodes = served.device.nodes
    older = {name: entry for name, entry in nodes["rc_camera"].items() if name != "exp_control"}
    del nodes["rc_camera"]
    nodes["rc_stereocamera"] = older
    settings = read_cell(served.cell_file).file.rc_visard
    device = RcVisard(settings)
    assert device.set_exposure(8.0, 0.001) == 8.0
    assert (older["exp_auto"]["value"], older["exp_value"]["value"]) == (False, 0.008)
    device.close()
    assert (older["exp_auto"]["value"], older["exp_value"]["value"]) == (True, 0.005)


def test_settings_are_restored_after_an_error(served, driver, wrong):
    wrong.silent = True
    with pytest.raises(SensorError, match="none with a left"), closing_driver(driver):
        driver.capture(8.0, POSE, view="a")
    assert values(served)["exp_control"] == "Auto"


def test_what_cannot_be_restored_is_said(driver, wrong, caplog):
    driver.capture(8.0, POSE, view="a")
    wrong.faults = 99
    driver.close()
    assert "set {'exp_value': 0.005, 'exp_control': 'Auto'} by hand" in caplog.text
    wrong.faults = 0


def test_too_many_requests_are_made_again(driver, wrong):
    wrong.too_many = 2
    assert driver.capture(8.0, POSE, view="a").exposure_ms == 8.0
    assert wrong.too_many == 0


def test_too_many_requests_are_not_made_for_ever(driver, wrong):
    wrong.too_many = 99
    with pytest.raises(SensorError, match=r"GET system: it refuses .*429.*, 3 times"):
        driver.capture(8.0, POSE, view="a")
    assert wrong.too_many == 96


def test_a_broken_connection_is_made_again(driver, wrong):
    wrong.dropped = 2
    assert driver.capture(8.0, POSE, view="a").exposure_ms == 8.0


@pytest.mark.parametrize(
    ("fault", "message"),
    [
        ({"dropped": 99}, "the connection broke"),
        ({"faults": 1}, "it answered 500 Internal Server Error: internal fault"),
        ({"delay_s": 0.7}, r"no answer within 0\.5 s"),
        ({"return_code": -11}, "PUT .*rc_iocontrol/parameters: return code -11: simulated fault"),
        ({"return_code": 5}, "ignored its setting: out1_mode was set to 'ExposureActive', 'Low'"),
    ],
)
def test_what_the_device_answers_is_reported(driver, wrong, fault, message):
    for name, value in fault.items():
        setattr(wrong, name, value)
    with pytest.raises(SensorError, match=message):
        driver.capture(8.0, POSE, view="a")
    vars(wrong).update(vars(Misbehaviour()))


def test_an_ignored_exposure_time_is_noticed_though_the_answer_tells_otherwise(driver, wrong):
    wrong.ignores_exposure = True
    with pytest.raises(SensorError, match=r"8 ms was asked for, 5 ms read back"):
        driver.capture(8.0, POSE, view="a")


def test_images_with_another_exposure_time_are_not_taken(driver, wrong):
    wrong.images_ignore_exposure = True
    with pytest.raises(SensorError, match=r"no image set of 8 ms .* images say 5 ms: it ignores"):
        driver.capture(8.0, POSE, view="a")


def test_a_rounded_exposure_time_is_the_capture_s(driver, wrong):
    wrong.rounding_s = 0.000145
    assert driver.capture(1.0, POSE, view="a").exposure_ms == 1.015


def test_image_sets_from_before_are_discarded(driver, wrong, stereo_cell):
    driver.capture(8.0, POSE, view="a")
    wrong.stale_sets = 3
    aside = RigidTransform(translation_mm=np.array([10.0, 0.0, 0.0])) @ POSE
    moved = driver.capture(8.0, aside, view="b")
    assert np.array_equal(moved.image, stereo_cell.capture(8.0, aside, view="b").image)
    longer = driver.capture(8.1, aside, view="b")
    assert longer.exposure_ms == 8.1


def test_an_exposure_time_outside_the_device_s_range_is_refused(driver):
    with pytest.raises(SensorError, match=r"from 0\.07 to 18 ms, 25 ms was asked for"):
        driver.capture(25.0, POSE, view="a")


def test_a_sensor_file_with_another_calibration_contradicts(served):
    path = served.cell_file.parent / "sensor.json"
    sensor = read_sensor(path)
    camera = replace(sensor.camera, fx=1100.0, fy=1100.0)
    write_sensor(path, replace(sensor, cameras=(camera, camera)))
    with (
        closing_driver(driver_of(served)) as driver,
        pytest.raises(ContradictionError, match=r"focal lengths 1100\.00 .* not 1086\.\d+ px"),
    ):
        driver.capture(8.0, POSE, view="a")


def test_a_device_that_is_not_there_is_named(served):
    with pytest.raises(SensorError, match=r"rc_visard at 127\.0\.0\.1:9: .*cannot be reached"):
        driver_of(served, port=9).capture(8.0, POSE, view="a")
    with (
        closing_driver(driver_of(served, image_port=9)) as driver,
        pytest.raises(SensorError, match=r"127\.0\.0\.1:9: its images do not come \(unavailable"),
    ):
        driver.capture(8.0, POSE, view="a")
    with pytest.raises(SensorError, match="GET pipelines/3/nodes: it answered 404"):
        driver_of(served, pipeline=3).capture(8.0, POSE, view="a")


def test_a_cell_without_an_rc_visard_is_refused(served):
    cell = read_cell(served.cell_file)
    with pytest.raises(SensorError, match=r"names no rc_visard: give \[rc_visard\]"):
        RcVisardDriver(replace(cell, file=replace(cell.file, rc_visard=None)))
    served.cell_file.write_text(served.cell_file.read_text().replace("images_timeout_s", "wait"))
    with pytest.raises(FormatError, match=r"rc_visard\.wait"):
        read_cell(served.cell_file)


@pytest.mark.parametrize("change", [{"host": "http://a"}, {"port": 0}, {"timeout_s": 0.0}])
def test_settings_that_make_no_sense_are_refused(change):
    with pytest.raises(InputError):
        RcVisardSettings(**{"host": "10.0.2.90", **change})


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("left.data", b"123"),
        ("left.encoding", "rgb8"),
        ("left.exposure_time", 0.0),
        ("disparity.baseline", -0.065),
        ("disparity.image.focal_length", float("nan")),
        ("disparity.image.step", 3),
    ],
)
def test_image_sets_that_are_none_are_refused(served, field, value):
    message = served.device.image_set()
    *path, name = field.split(".")
    part = message
    for step in path:
        part = getattr(part, step)
    setattr(part, name, value)
    with pytest.raises(SensorError, match="rc_visard"):
        read_image_set(message)


def test_padded_rows_of_big_end_order_are_read(served):
    message = served.device.image_set()
    plain = read_image_set(message)
    image = message.disparity.image
    pixels = np.frombuffer(image.data, "<u2").reshape(image.height, image.width) + np.uint16(300)
    padded = np.zeros((image.height, image.width + 2), ">u2")
    padded[:, : image.width] = pixels
    image.data, image.step, image.is_bigendian = padded.tobytes(), 2 * (image.width + 2), True
    read = read_image_set(message)
    assert read.disparity.shape == plain.disparity.shape
    assert np.array_equal(read.disparity, pixels * np.float32(0.0625))


def small_plan(sensor, exposures_ms=(3.0, 8.0)):
    plane = DepthPlane(
        name="near", z_tcp_mm=0.0, x_mm=(-10.0, 10.0), y_mm=(0.0,), exposures_ms=exposures_ms
    )
    return MeasuringPlan(
        name="served",
        sensor=sensor,
        features=("h0", "h1"),
        reference="h0",
        planes=(plane,),
        seed=1,
    )


@pytest.mark.slow
def test_a_killed_measurement_goes_on(served, stereo_cell, tmp_path):
    plan = small_plan(stereo_cell.sensor)
    plans.write_plan(tmp_path / "plan.toml", plan)
    command = [
        *(sys.executable, "-m", "exposight", "measure", str(tmp_path / "plan.toml")),
        *("--driver", "rc_visard", "--cell", str(served.cell_file), "-o", str(tmp_path / "door")),
    ]
    first = tmp_path / "door" / "captures" / "000000"
    with subprocess.Popen(
        command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, start_new_session=True
    ) as process:
        until = time.monotonic() + 60.0
        while not first.exists() and process.poll() is None and time.monotonic() < until:
            time.sleep(0.005)
        os.kill(process.pid, signal.SIGKILL)
    assert first.exists(), process.returncode
    kept = {path: path.read_bytes() for path in first.iterdir()}
    with closing_driver(driver_of(served, images_timeout_s=60.0)) as driver:
        campaign = measure(plan, driver, tmp_path / "door")
    assert {path: path.read_bytes() for path in first.iterdir()} == kept
    times_ms = [capture.exposure_ms for capture in campaign.descriptions()]
    assert sorted(times_ms) == [3.0, 3.0, 8.0, 8.0]


@pytest.mark.slow
def test_a_closed_loop_has_the_simulated_cell_s_outcomes(served, stereo_cell, tmp_path):
    served.device.set("rc_stereomatching", "quality", "Full")
    plan = small_plan(stereo_cell.sensor, (1.0, 2.0, 3.0, 5.0, 9.0, 18.0))
    table = measure_observations(plan, stereo_cell)
    models = planning.train(table, sensor=stereo_cell.sensor)
    views = {view.name: view.camera_from_part for view in plan.views(stereo_cell.part)}
    exposure_plan = planning.plan(models, stereo_cell.part, views)
    wanted = measure_adaptively(exposure_plan, stereo_cell, tmp_path / "a", models=models)
    with closing_driver(driver_of(served, images_timeout_s=60.0)) as driver:
        taken = measure_adaptively(exposure_plan, driver, tmp_path / "b", models=models)
    assert taken.campaign.keys() == wanted.campaign.keys()
    assert taken.succeeded == wanted.succeeded == ("h0", "h1")
    for ours, theirs in zip(taken.outcomes, wanted.outcomes, strict=True):
        assert ours.feature == theirs.feature
        assert ours.status == theirs.status


def test_rest_answers_that_are_no_json_are_reported(served, monkeypatch):
    api = RestApi(RcVisardSettings(host="127.0.0.1", port=served._rest.port))
    monkeypatch.setattr(api, "_answer", lambda *_: (200, 0.0, b"<html>"))
    with pytest.raises(SensorError, match=r"its answer \(200\) is not JSON"):
        api.get("system")


def test_what_was_captured_is_all_there_after_an_error(served, wrong, stereo_cell, tmp_path):
    plan = small_plan(stereo_cell.sensor)
    with closing_driver(driver_of(served, images_timeout_s=60.0)) as driver:

        def fail(_stage, done, _total):
            if done == 2:
                wrong.faults = 99

        with pytest.raises(SensorError, match="500"):
            measure(plan, driver, tmp_path / "door", progress=fail)
        wrong.faults = 0
    assert len(CampaignFolder(tmp_path / "door")) == 2
    with closing_driver(driver_of(served, images_timeout_s=60.0)) as driver:
        assert len(measure(plan, driver, tmp_path / "door")) == 4
