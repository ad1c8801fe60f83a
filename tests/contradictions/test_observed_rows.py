"""Rows of tables made anywhere are held against what can be observed."""

import numpy as np
import pytest

from exposight.contradictions.observed_rows import angle_unit, exposure_unit, row_contradictions

NAN = np.full(8, np.nan)


def rows(p_norm, exposure_ms=10.0):
    names = [f"h{i}" for i in range(8)]
    return row_contradictions(np.full(8, p_norm), NAN, np.full(8, exposure_ms), names)


def test_rows_as_they_are():
    assert rows(0.9) == ()
    assert rows(1.05) == ()
    assert rows(np.nan) == ()


@pytest.mark.parametrize("p_norm", [1.3, 9.0])
def test_more_points_than_pixels(p_norm):
    (found,) = rows(p_norm)
    assert found.is_error
    assert f"{p_norm:.2f} in 8 of 8 rings" in found.found


@pytest.mark.parametrize(("exposure_ms", "unit"), [(0.01, "in s"), (50_000, "in µs")])
def test_exposure_times_that_hardly_any_sensor_takes(exposure_ms, unit):
    (found,) = rows(0.9, exposure_ms)
    assert not found.is_error
    assert unit in found.explanation


@pytest.mark.parametrize(("factor", "unit"), [(1e-3, "in s"), (1e3, "in µs")])
def test_exposure_times_of_another_unit_than_the_sensor(factor, unit):
    times = np.array([5.0, 10, 20, 80])
    found = exposure_unit(factor * times, (1.0, 100.0))
    assert found.is_error
    assert unit in found.explanation
    assert exposure_unit(times, (1.0, 100.0)) is None


def test_some_exposure_times_beyond_the_sensor_are_a_warning():
    found = exposure_unit(np.array([5.0, 10, 200]), (1.0, 100.0))
    assert not found.is_error
    assert "1 of 3 rows" in found.found


def test_exposure_times_in_seconds_and_microseconds_are_noticed():
    for times, unit in (([0.005, 0.04], "in s"), ([5000, 40_000], "in µs")):
        found = exposure_unit(np.array(times, dtype=float))
        assert not found.is_error
        assert unit in found.explanation


def test_percent_contradicts_the_points():
    points = np.linspace(40, 90, 8)
    (found,) = row_contradictions(
        points, np.full(8, 100.0), np.full(8, 10.0), list("abcdefgh"), n_points=points
    )
    assert found.is_error
    assert "in percent: divide it by 100" in found.explanation


def test_percent_without_points_is_named():
    (found,) = rows(7.5)
    assert "percent" in found.explanation


def test_grey_values_of_0_to_1_are_noticed():
    names = list("abcdefgh")
    quality, grey = np.full(8, 0.9), np.linspace(0.1, 0.8, 8)
    (found,) = row_contradictions(quality, NAN, np.full(8, 10.0), names, i_avg=grey)
    assert not found.is_error
    assert "multiply them by 255" in found.explanation
    assert row_contradictions(quality, NAN, np.full(8, 10.0), names, i_avg=100 * grey) == ()


TURNED = np.array([[12.0, -3, 0], [-11, 4, 0], [8, 9, 90], [15, -14, 0], [0, 6, 0], [9, 1, 0]])


def test_angles_in_radians_are_noticed():
    assert angle_unit(TURNED) is None
    found = angle_unit(np.radians(TURNED))
    assert not found.is_error
    assert "in radians?" in found.explanation
    assert angle_unit(np.zeros((8, 3))) is None  # squarely faced


def test_angles_in_radians_contradict_the_incidence():
    incidence = np.hypot(TURNED[:, 0], TURNED[:, 1]) + np.array([1, -1, 2, 0.5, 1, -2])
    assert angle_unit(TURNED, incidence) is None
    assert angle_unit(np.radians(TURNED), incidence).is_error
    found = angle_unit(TURNED, np.radians(incidence))
    assert found.is_error
    assert "incidence_deg" in found.compared
