"""One camera through Aravis, against a real server on loopback."""

from __future__ import annotations

from functools import partial

import numpy as np
import pytest
from tests.drivers.serving import served_alone

from exposight.aravis_library import aravis
from exposight.cell import ExposureRange
from exposight.drivers.camera_control import open_camera
from exposight.drivers.genicam_camera import CameraSettings, GenicamCamera
from exposight.errors import SensorError
from exposight.twin.gige_camera import GigeCamera

try:
    aravis()
except SensorError as error:
    pytest.skip(f"GigE Vision is not tested: {error}", allow_module_level=True)

pytestmark = pytest.mark.slow

SERIAL = "BENCH"
RANGE = ExposureRange(min_ms=0.1, max_ms=1000.0, increment_ms=0.001)


@pytest.fixture
def camera(tmp_path):
    """A camera in this process; frames have the exposure time as their grey level."""

    def serve(**changes):
        def frame(exposure_ms):
            return np.full((6, 8), round(exposure_ms), dtype=np.uint8)

        return GigeCamera(tmp_path, SERIAL, (6, 8), RANGE, frame, **changes)

    with served_alone():
        yield serve


def test_limits_frames_and_rounding_of_a_real_client(camera):
    device = camera(rounding_us=35)
    client = GenicamCamera(CameraSettings(id="127.0.0.1"))
    try:
        assert (client.limits.min_ms, client.limits.max_ms) == (0.1, 1000.0)
        assert client.set_exposure(1.0) == 1.015
        assert client.set_exposure(200.0) == pytest.approx(199.99)
        frame = client.frame()
        assert frame.bit_depth == 8
        assert frame.image.shape == (6, 8)
        assert (frame.image == 200).all()
        with pytest.raises(SensorError, match=r"takes exposure times from 0.1 to 1000 ms now"):
            client.set_exposure(1200.0)
    finally:
        client.close()
        device.close()


def test_settings_persist_and_are_restored(camera):
    device = camera()
    first = open_camera(SERIAL)
    first.set_string("TriggerMode", "On")
    first.set_float("ExposureTime", 7000.0)
    del first
    client = GenicamCamera(CameraSettings(id=SERIAL))
    client.set_exposure(50.0)
    assert client.frame().image.max() == 50
    client.close()
    del client
    last = open_camera(SERIAL)
    assert last.get_string("TriggerMode") == "On"
    assert last.get_float("ExposureTime") == 7000.0
    del last
    device.close()


def test_no_camera_lists_those_that_answer(camera):
    device = camera()
    with pytest.raises(SensorError, match=r"no camera is called 'X1'.*serial BENCH, 127\.0\.0\.1"):
        open_camera("X1")
    device.close()


def test_a_camera_that_somebody_else_holds(camera):
    device = camera()
    holder = open_camera(SERIAL)
    with pytest.raises(SensorError, match="held by another program"):
        GenicamCamera(CameraSettings(id=SERIAL), partial(open_camera, wait_s=0.5))
    del holder
    GenicamCamera(CameraSettings(id=SERIAL)).close()  # control is free again
    device.close()


def test_two_cameras_cannot_be_served_at_once(camera):
    device = camera()
    with pytest.raises(SensorError, match="another one is"):
        camera()
    device.close()
