"""The simulated cell served as an rc_visard: its interfaces as their documentation has them."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
import time
import urllib.error
import urllib.request
from dataclasses import replace

import pytest

from exposight.cell import sensor_preset
from exposight.drivers import read_cell
from exposight.errors import SensorError
from exposight.plans import PLANS, DepthPlane, write_plan
from exposight.rc_visard_messages import STREAM_METHOD, grpc_library, message_class
from exposight.twin import ServedRcVisard, SimulatedCell

try:
    grpc = grpc_library()
except SensorError as error:
    pytest.skip(f"the served rc_visard is not tested: {error}", allow_module_level=True)

CAMERA = "pipelines/0/nodes/rc_camera"


@pytest.fixture(scope="module")
def served(stereo_cell, tmp_path_factory):
    with ServedRcVisard(stereo_cell, tmp_path_factory.mktemp("served")) as server:
        yield server


@pytest.fixture(scope="module")
def api(served):
    """Make a request, and return status and answer."""
    port = read_cell(served.cell_file).file.rc_visard.port
    opener = urllib.request.build_opener(urllib.request.ProxyHandler({}))

    def request(path, body=None):
        data = None if body is None else json.dumps(body).encode()
        made = urllib.request.Request(
            f"http://127.0.0.1:{port}/api/v2/{path}", data, method="GET" if data is None else "PUT"
        )
        try:
            with opener.open(made, timeout=5) as response:
                return response.status, json.load(response)
        except urllib.error.HTTPError as error:
            with error:
                return error.code, json.load(error)

    return request


def test_system_pipelines_and_nodes_are_listed(api):
    status, system = api("system")
    assert (status, system["ready"]) == (200, True)
    assert api("system")[1]["time"] > system["time"]
    assert api("pipelines")[1][0]["type"] == "rc_visard"
    assert [node["name"] for node in api("pipelines/0/nodes")[1]] == [
        "rc_camera", "rc_stereomatching", "rc_iocontrol",
    ]  # fmt: skip


def test_parameters_have_values_and_limits_in_seconds(api):
    _, listed = api(f"{CAMERA}/parameters?name=exp_value&name=exp_control")
    assert [each["name"] for each in listed] == ["exp_value", "exp_control"]
    assert (listed[0]["min"], listed[0]["max"], listed[0]["value"]) == (7e-5, 0.018, 0.005)
    assert listed[1]["value"] == "Auto"


def test_parameters_are_set_and_reset(api):
    body = [{"name": "exp_control", "value": "Manual"}, {"name": "exp_value", "value": 0.002}]
    assert api(f"{CAMERA}/parameters", body)[0] == 200
    assert api(f"{CAMERA}/parameters/exp_value")[1]["value"] == 0.002
    assert api(f"{CAMERA}/parameters/exp_value", {"value": 0.003})[1]["value"] == 0.003
    _, done = api(f"{CAMERA}/services/reset_defaults", {})
    assert done["response"]["return_code"]["value"] == 0
    assert api(f"{CAMERA}/parameters/exp_value")[1]["value"] == 0.005


@pytest.mark.parametrize(
    ("path", "body", "status"),
    [
        (f"{CAMERA}/parameters/exp_value", {"value": 3.0}, 400),
        (f"{CAMERA}/parameters/exp_value", {"value": "long"}, 400),
        (f"{CAMERA}/parameters/exp_control", {"value": "Maybe"}, 400),
        (f"{CAMERA}/parameters", [{"name": "other", "value": 1}], 404),
        (f"{CAMERA}/parameters", [3], 400),
        ("pipelines/1/nodes", None, 404),
        ("pipelines/0/nodes/rc_pick", None, 404),
    ],
)
def test_wrong_requests_are_refused(api, path, body, status):
    assert api(path, body)[0] == status


def test_images_stream_with_optics_of_their_own_grids(served):
    port = read_cell(served.cell_file).file.rc_visard.images_at
    with grpc.insecure_channel(
        f"127.0.0.1:{port}", options=[("grpc.enable_http_proxy", 0)]
    ) as channel:
        call = channel.unary_stream(
            STREAM_METHOD,
            request_serializer=lambda message: message.SerializeToString(),
            response_deserializer=message_class("ImageSet").FromString,
        )(message_class("ImageSetRequest")(left_enabled=True), timeout=20)
        first, second = next(call), next(call)
        call.cancel()
    assert second.timestamp.sec + 1e-9 * second.timestamp.nsec > first.timestamp.sec
    left, coarse = first.left, first.disparity.image
    assert (left.width, left.height, left.encoding) == (480, 208, "mono8")
    assert (coarse.width, coarse.height, coarse.encoding) == (240, 104, "mono16")
    assert coarse.focal_length == left.focal_length / 2
    assert coarse.principal_point_u == left.principal_point_u / 2
    assert first.disparity.baseline == pytest.approx(0.065)
    assert left.exposure_time == pytest.approx(0.005)


def test_other_sensors_are_not_served(scene, tmp_path, stereo_cell):
    with pytest.raises(SensorError, match="cannot be served as an rc_visard"):
        ServedRcVisard(SimulatedCell(sensor_preset("comet-pro-ae")), tmp_path)
    lens = replace(stereo_cell.sensor.camera, distortion=(0.1, 0.0, 0.0, 0.0))
    sensor = replace(stereo_cell.sensor, cameras=(lens, lens))
    with pytest.raises(SensorError, match="two rectified cameras"):
        ServedRcVisard(SimulatedCell(sensor, stereo_cell.settings), tmp_path)


@pytest.mark.slow
def test_the_command_serves_until_it_is_interrupted(tmp_path):
    plane = DepthPlane(name="a", z_tcp_mm=0.0, x_mm=(0.0,), y_mm=(0.0,), exposures_ms=(8.0,))
    sensor = sensor_preset("rc-visard-65")
    plan = replace(PLANS["small"], sensor=sensor, planes=(plane,), random=(), simulated={})
    write_plan(tmp_path / "plan.toml", plan)
    command = [
        *(sys.executable, "-m", "exposight", "simulate", str(tmp_path / "plan.toml")),
        *("--serve-as", "rc-visard", "-o", str(tmp_path)),
    ]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT) as process:
        until = time.monotonic() + 60.0
        while process.poll() is None and time.monotonic() < until:
            if (tmp_path / "cell.toml").exists():
                break
            time.sleep(0.05)
        time.sleep(0.5)  # until it waits
        process.send_signal(signal.SIGINT)
        output, _ = process.communicate(timeout=20)
    assert process.returncode == 0, output.decode()
    cell = read_cell(tmp_path / "cell.toml")
    assert cell.sensor == sensor
    assert len(cell.part.features) > 2
