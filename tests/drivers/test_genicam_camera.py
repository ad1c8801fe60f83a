"""One camera through Aravis's interface, which is imitated: rounding, ignoring, losing, lagging."""

from __future__ import annotations

from types import SimpleNamespace

import pytest
from tests.drivers.fake_aravis import LIBRARY, BufferStatus, FakeCamera, FakeError

from exposight.drivers import genicam_camera
from exposight.drivers.genicam_camera import CameraSettings, GenicamCamera
from exposight.errors import InputError, SensorError


@pytest.fixture
def opened(monkeypatch):
    monkeypatch.setattr(genicam_camera, "aravis", lambda: LIBRARY)
    monkeypatch.setattr(genicam_camera, "aravis_error", lambda: FakeError)

    def build(fake=None, **settings):
        fake = fake or FakeCamera()
        return GenicamCamera(CameraSettings(id="7", **settings), lambda _: fake), fake

    return build


def test_limits_are_the_device_s_though_optional_nodes_raise(opened):
    camera, fake = opened()
    limits = camera.limits
    assert (limits.min_ms, limits.max_ms, limits.increment_ms) == (0.1, 1000.0, 0.001)
    assert fake.policies == ["disable", "enable"]
    assert camera.description() == {"model": "fake", "serial": "7"}


@pytest.mark.parametrize("feature", ["ExposureTime", "ExposureTimeAbs"])
def test_either_name_of_the_exposure_is_set_in_microseconds(opened, feature):
    camera, fake = opened(FakeCamera(feature=feature))
    assert camera.set_exposure(20.0) == 20.0
    assert fake.values[feature] == 20_000.0


def test_a_camera_without_exposure_is_refused(opened):
    with pytest.raises(SensorError, match="neither ExposureTime nor ExposureTimeAbs"):
        opened(FakeCamera(feature="Gain"))


def test_what_the_device_rounded_is_read_back(opened):
    camera, fake = opened()
    fake.rounds = lambda us: 1015.0 if us == 1000.0 else us
    assert camera.set_exposure(1.0) == 1.015


def test_an_end_that_the_device_moved_is_clamped_to(opened):
    camera, fake = opened(FakeCamera(bounds=(100.0, 999_990.0)))
    assert camera.set_exposure(1000.0) == 999.99
    fake.bounds = (100.0, 500_000.0)
    with pytest.raises(SensorError, match=r"from 0.1 to 500 ms now, 1000 ms was asked for"):
        camera.set_exposure(1000.0)


def test_an_ignored_setting_is_an_error_with_both_values(opened):
    camera, fake = opened()
    fake.rounds = lambda _: 5000.0
    with pytest.raises(SensorError, match="ignored its setting: 20 ms was asked for, 5 ms read"):
        camera.set_exposure(20.0)


def test_one_frame_is_discarded_after_a_change_and_none_otherwise(opened):
    camera, fake = opened()
    camera.set_exposure(20.0)
    assert camera.frame().image.max() == 20
    assert fake.taken == 2
    camera.set_exposure(20.0)
    assert camera.frame().image.max() == 20
    assert fake.taken == 3


def test_chunk_data_tell_from_when_on_an_exposure_holds(opened):
    fake = FakeCamera(chunks=True)
    fake.lag = 3
    camera, _ = opened(fake)
    camera.set_exposure(20.0)
    assert camera.frame().image.max() == 20
    assert fake.taken == 4
    fake.lag = 100
    camera.set_exposure(40.0)
    with pytest.raises(SensorError, match="set to 40 ms, but its frames say 20 ms"):
        camera.frame()


def test_chunk_data_without_the_exposure_time_leave_the_first_frame_in_doubt(opened):
    fake = FakeCamera(chunks=True)

    def parser():
        def refuse(_buffer, name):
            raise FakeError(f"no chunk {name}")

        return SimpleNamespace(get_float_value=refuse)

    fake.create_chunk_parser = parser
    camera, _ = opened(fake)
    camera.set_exposure(20.0)
    assert camera.frame().image.max() == 20
    assert fake.taken == 2


def test_incomplete_frames_are_taken_again_a_few_times(opened):
    camera, fake = opened()
    fake.status = [BufferStatus.MISSING_PACKETS] * 2
    assert camera.frame().image.max() == 5
    assert fake.taken == 3
    fake.status = [BufferStatus.MISSING_PACKETS] * 3
    with pytest.raises(SensorError, match=r"no frame in 3 tries: .* \(missing_packets\)"):
        camera.frame()


def test_a_frame_that_does_not_come_is_not_waited_for_for_ever(opened):
    camera, fake = opened(timeout_s=0.5, tries=2)
    fake.silent = 2
    with pytest.raises(SensorError, match=r"in 2 tries: none came within 0.51 s"):
        camera.frame()


def test_an_unplugged_camera_says_how_to_go_on_and_closes(opened):
    camera, fake = opened()
    fake.unplugged = True
    with pytest.raises(SensorError, match=r"read_register timeout.*run the same command again"):
        camera.frame()
    camera.close()


def test_settings_are_switched_off_and_restored(opened):
    camera, fake = opened()
    before = {"ExposureTime": 5000.0, "ExposureAuto": "Continuous", "TriggerMode": "On"}
    assert fake.values["ExposureAuto"] == fake.values["TriggerMode"] == "Off"
    camera.set_exposure(20.0)
    camera.close()
    assert before.items() <= fake.values.items()
    fake.values["ExposureTime"] = 1.0
    camera.close()  # a second time does nothing
    assert fake.values["ExposureTime"] == 1.0


def test_a_colour_format_is_refused_with_a_remedy(opened):
    camera, fake = opened()
    fake.timeout_pop_buffer = lambda _: _colour()
    with pytest.raises(SensorError, match='pixel_format = "Mono8"'):
        camera.frame()


def _colour():
    from tests.drivers.fake_aravis import FakeBuffer, np

    return FakeBuffer(np.zeros((3, 4), dtype=np.uint8), kind=99)


@pytest.mark.parametrize("settings", [{"timeout_s": 0.0}, {"tries": 0}, {"id": " "}])
def test_settings_that_make_no_sense(settings):
    with pytest.raises(InputError, match="a camera needs its id"):
        CameraSettings(**{"id": "7", **settings})
