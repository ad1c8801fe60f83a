"""What real devices do to exposure times and settings: they round, ignore, and are let go of."""

from __future__ import annotations

import pytest
from tests.measuring.conftest import PlateDriver, plate_sensor, pose_at

from exposight.cell import closing_driver, same_exposure
from exposight.errors import SensorError
from exposight.measuring.view_work import take_capture


@pytest.mark.parametrize(
    ("asked_ms", "taken_ms", "increment_ms", "same"),
    [
        (1.0, 1.015, 0.001, True),  # 1000 µs became 1015
        (1600.0, 1599.99, 0.001, True),  # the maximum
        (1.0, 1.021, 0.001, False),
        (1.0, 0.5, 0.5, True),
        (1.0, 1.5 + 1e-6, 0.5, False),
        (100.0, 102.0, 0.001, True),
        (100.0, 97.9, 0.001, False),
    ],
)
def test_the_same_exposure_is_one_to_the_increment_or_two_percent(
    asked_ms, taken_ms, increment_ms, same
):
    assert same_exposure(asked_ms, taken_ms, increment_ms) is same


@pytest.mark.parametrize(("asked_ms", "taken_ms"), [(50.0, 50.49), (0.5, 0.001), (50.0, 49.1)])
def test_less_than_an_increment_outside_the_range_was_rounded(asked_ms, taken_ms):
    driver = PlateDriver(read_back=lambda _: taken_ms)
    taken = take_capture(driver, driver.sensor, asked_ms, pose_at(600), view="v")
    assert taken.exposure_ms == taken_ms


def test_the_range_does_not_grow_by_two_percent():
    driver = PlateDriver(read_back=lambda _: 50.9)
    with pytest.raises(SensorError, match=r"from 0.5 to 50 ms, got 50.9 ms"):
        take_capture(driver, driver.sensor, 50.0, pose_at(600), view="v")


def test_a_planned_exposure_stays_inside_the_range():
    with pytest.raises(SensorError, match=r"got 50.25 ms"):
        plate_sensor().check_exposure(50.25)


def test_an_ignored_setting_stops_with_both_values():
    driver = PlateDriver(read_back=lambda _: 10.0)
    with pytest.raises(SensorError, match=r"set to 40 ms and took 10 ms.*ignores the setting"):
        take_capture(driver, driver.sensor, 40.0, pose_at(600), view="v")


class ClosingDriver(PlateDriver):
    closed = 0

    def close(self):
        self.closed += 1


def test_a_driver_is_closed_whatever_happens():
    driver = ClosingDriver(fail_at=0)
    with pytest.raises(RuntimeError, match="lost trigger"), closing_driver(driver) as same:
        same.capture(1.0, pose_at(600), view="v")
    assert driver.closed == 1
    with closing_driver(PlateDriver()) as plain:  # without close
        assert plain.sensor.name == "small"
