"""Rigs of GenICam cameras whose frames are the simulated cell's, without a network."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest

from exposight.cell import sensor_preset
from exposight.drivers import Cell, CellFile, GenicamDriver
from exposight.drivers.genicam_camera import CameraSettings, Frame
from exposight.errors import SensorError
from exposight.geometry import RigidTransform
from exposight.imaging import StereoLimits
from exposight.twin import SimulatedCell, SimulatedCellSettings

CAMERAS = {"left": CameraSettings(id="left"), "right": CameraSettings(id="right")}


class OneFrame:
    """A camera that always sees the same."""

    def __init__(self, settings, image, takes_ms=lambda ms: ms):
        self.settings, self.image, self.takes_ms, self.closed = settings, image, takes_ms, 0

    def set_exposure(self, exposure_ms):
        return self.takes_ms(exposure_ms)

    def frame(self):
        return Frame(image=self.image, bit_depth=8)

    def description(self):
        return {"model": "still"}

    def close(self):
        self.closed += 1


def small_stereo_sensor():
    full = sensor_preset("rc-visard-65")
    camera = replace(
        full.camera,
        width=320, height=240, fx=full.camera.fx / 4, fy=full.camera.fy / 4, cx=159.5, cy=119.5,
    )  # fmt: skip
    return replace(full, name="head", cameras=(camera, camera))


def head(sensor):
    file = CellFile(
        sensor="head",
        camera=CAMERAS["left"],
        second_camera=CAMERAS["right"],
        stereo=StereoLimits(min_texture=3.0),
    )
    return Cell(file=file, sensor=sensor, part=None, sequence=None)


@pytest.mark.slow
def test_a_stereo_head_matches_the_images_of_its_two_cameras(scene):
    sensor = small_stereo_sensor()
    settings = SimulatedCellSettings(scene=scene, raw_frames=True)
    pose = RigidTransform(translation_mm=np.array([0.0, 0.0, 400.0]))
    simulated = SimulatedCell(sensor, settings).capture(4.0, pose, view="v")
    pictures = [
        cv2.imdecode(np.frombuffer(simulated.attachments[name], np.uint8), cv2.IMREAD_UNCHANGED)
        for name in sorted(simulated.attachments)
        if name.endswith(".png")
    ]
    images = dict(zip(CAMERAS, pictures, strict=True))
    driver = GenicamDriver(head(sensor), lambda each: OneFrame(each, images[each.id]))
    capture = driver.capture(4.0, pose, view="v")
    assert capture.brightness_source == "dots"
    assert np.array_equal(capture.image, simulated.image)
    assert "as asked for" in capture.notes
    both = capture.cloud.valid & simulated.cloud.valid
    assert both.sum() > 0.7 * simulated.cloud.n_valid
    apart = capture.cloud.points[both][:, 2] - simulated.cloud.points[both][:, 2]
    assert np.abs(apart).max() < 1.0


def test_two_cameras_that_take_different_times_stop_the_run():
    blank = np.zeros((240, 320), dtype=np.uint8)
    longer = {"left": lambda ms: ms, "right": lambda ms: ms + 0.05}
    driver = GenicamDriver(
        head(small_stereo_sensor()), lambda each: OneFrame(each, blank, longer[each.id])
    )
    with pytest.raises(SensorError, match=r"set to 4 ms and took 4 and 4.05 ms"):
        driver.capture(4.0, RigidTransform(), view="v")


def test_a_second_camera_that_does_not_open_lets_go_of_the_first():
    opened = []

    def open_camera(settings):
        if settings.id == "right":
            msg = "no camera"
            raise SensorError(msg)
        opened.append(OneFrame(settings, None))
        return opened[-1]

    driver = GenicamDriver(head(small_stereo_sensor()), open_camera)
    with pytest.raises(SensorError, match="no camera"):
        driver.capture(4.0, RigidTransform(), view="v")
    assert opened[0].closed == 1
