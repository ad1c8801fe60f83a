"""Rows of tables made anywhere are held against what can be observed."""

import numpy as np
import pytest

from exposight.contradictions.observed_rows import exposure_unit, row_contradictions

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
