"""What sensors can be set to: always inside the window, and why not where there is nothing."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import settings as hypothesis_settings
from hypothesis import strategies as st

from exposight.cell import PRESETS
from exposight.errors import FormatError, MissingFileError, SensorError
from exposight.planning import PROFILES, CaptureCosts, ExposureLimits, limits_named

WHOLE_MS = ExposureLimits(name="whole ms", min_ms=1.0, max_ms=1000.0, increment_ms=1.0)


@st.composite
def limits(draw):
    low = draw(st.floats(0.01, 20.0))
    high = low * draw(st.floats(2.0, 500.0))
    step = draw(st.floats(1e-3, 1.0)) * low
    listed = draw(st.lists(st.floats(low, high), max_size=12))
    mains = draw(st.sampled_from([None, 50.0, 60.0]))
    unit = draw(st.sampled_from(["us", "ms", "s"]))
    kind = {"name": "any", "min_ms": low, "max_ms": high, "increment_ms": step, "unit": unit}
    try:
        return ExposureLimits(**kind, allowed_ms=tuple(listed), flicker_hz=mains)
    except SensorError:  # neither of the lists has a multiple of the mains' half period
        return ExposureLimits(**kind)


@hypothesis_settings(deadline=None)
@given(limits(), st.floats(0.01, 1e4), st.floats(1.0, 50.0), st.integers(1, 80))
def test_settings_lie_in_the_window_and_can_be_set(sensor, low, ratio, count):
    high = low * ratio
    settings = sensor.settings(low, high, count)
    slack = 1e-5 * sensor.increment_ms + 1e-6
    assert len(settings) <= count
    assert (np.diff(settings) > 0.0).all()
    assert ((settings >= low - slack) & (settings <= high + slack)).all()
    assert all(map(sensor.allows, settings))
    assert (len(settings) == 0) == bool(sensor.why_none(low, high))
    if sensor.allowed_ms:
        assert set(settings) <= set(sensor.allowed_ms)
    for each in settings:
        assert sensor.exposure_ms(sensor.set_value(each)) == pytest.approx(each, rel=1e-9)
    if sensor.flicker_hz:
        half = 500.0 / sensor.flicker_hz
        assert np.allclose(settings, half * np.rint(settings / half), atol=0.0101 * half)


def test_a_window_between_two_settings_is_left_empty_and_not_rounded():
    assert WHOLE_MS.settings(3.1, 3.9).size == 0
    assert WHOLE_MS.settings(3.1, 4.9).tolist() == [4.0]
    assert "increment 1 ms" in WHOLE_MS.why_none(3.1, 3.9)
    assert "range 1–1000 ms" in WHOLE_MS.why_none(0.1, 0.4)
    assert "flicker 50 Hz" in WHOLE_MS.under_mains(50.0).why_none(3.1, 7.8)
    assert "list" in PROFILES["photoneo-phoxi"].why_none(50.0, 75.0)


def test_settings_reach_from_the_first_to_the_last_at_about_equal_ratios():
    settings = WHOLE_MS.settings(10.0, 1000.0, 40)
    assert (settings[0], settings[-1], len(settings)) == (10.0, 1000.0, 40)
    ratios = np.diff(np.log(settings))
    assert ratios[10:].max() < 1.6 * ratios[10:].min()


def test_multiples_of_a_half_period_are_those_that_can_be_set():
    assert WHOLE_MS.under_mains(50.0).settings(1.0, 55.0).tolist() == [10.0, 20.0, 30.0, 40.0, 50.0]
    # 8.333 and 16.667 ms are no whole milliseconds
    assert WHOLE_MS.under_mains(60.0).settings(1.0, 55.0).tolist() == [25.0, 50.0]


def test_profiles_say_where_they_are_from_and_agree_with_presets():
    assert all(profile.source for profile in PROFILES.values())
    for name, sensor in PRESETS.items():
        profile, range_ = ExposureLimits.of(sensor), sensor.exposure
        assert profile is PROFILES[name]
        assert profile.name == sensor.name
        assert (profile.min_ms, profile.max_ms) == (range_.min_ms, range_.max_ms)
        assert profile.increment_ms == range_.increment_ms
        assert not profile.allowed_ms


@pytest.mark.parametrize(
    ("fault", "fact"),
    [
        ({"min_ms": 5.0, "max_ms": 1.0}, "got 5, 1 and 1"),
        ({"increment_ms": 0.0}, "increment_ms above 0"),
        ({"allowed_ms": (5.0, 5000.0)}, "5000"),
        ({"least_per_view": 3, "most_per_view": 2}, "3 and 2"),
        ({"flicker_hz": 5.0}, "50 or 60 Hz"),
        ({"allowed_ms": (11.0, 13.0), "flicker_hz": 50.0}, "allow no exposure time: flicker 50"),
        ({"unit": "min"}, "'min'"),
        ({"min_ms": 1e-9, "max_ms": 1e12, "increment_ms": 1e-9, "flicker_hz": 50.0}, "the unit"),
    ],
)
def test_limits_that_allow_nothing_or_contradict_themselves(fault, fact):
    fields = {"name": "x", "min_ms": 1.0, "max_ms": 100.0, "increment_ms": 1.0}
    with pytest.raises(SensorError, match=fact):
        ExposureLimits(**(fields | fault))


def test_limits_of_a_file(tmp_path):
    path = tmp_path / "mine.toml"
    path.write_text("[mine]\nmin_ms = 1.0\nmax_ms = 50.0\nincrement_ms = 0.5\nunit = 's'\n")
    assert limits_named(str(path)).set_value(2.5) == 0.0025
    path.write_text("[mine]\nmin_ms = 1.0\nmax_ms = 50.0\nincrement_ms = 0.5\nmost = 2\n")
    with pytest.raises(FormatError, match=r"mine\.toml, \[mine\]: key 'most' is unknown"):
        limits_named(str(path))
    path.write_text("min_ms = 1.0\n")
    with pytest.raises(FormatError, match=r"expected a table \[min_ms\] of limits, got the value"):
        limits_named(str(path))
    with pytest.raises(MissingFileError):
        limits_named(str(tmp_path / "none.toml"))
    with pytest.raises(SensorError, match="did you mean 'zivid-2'"):
        limits_named("zivid2")


def test_limits_of_another_sensor_are_refused_where_it_cannot_take_them():
    comet = PRESETS["comet-pro-ae"]
    WHOLE_MS.check_within(comet)
    ExposureLimits(name="part", min_ms=2.0, max_ms=90.0, increment_ms=4.0).check_within(comet)
    with pytest.raises(SensorError, match=r"'Roboception.*cannot take: 1–1000 ms in steps of 1 ms"):
        PROFILES["rc-visard-65"].check_within(comet)
    finer = ExposureLimits(name="finer", min_ms=1.0, max_ms=1000.0, increment_ms=0.5)
    with pytest.raises(SensorError, match=r"'finer' allow .*, which 'ZEISS COMET"):
        finer.check_within(comet)
    listed = ExposureLimits(
        name="listed", min_ms=1.0, max_ms=2000.0, increment_ms=1.0, allowed_ms=(5.0, 1500.0)
    )
    with pytest.raises(SensorError, match="1500 ms, which"):
        listed.check_within(comet)


def test_costs():
    costs = CaptureCosts(frames=12, overhead_ms=500.0)
    assert costs.capture_ms(20.0) == 740.0
    with pytest.raises(SensorError, match="at least 1 frame"):
        CaptureCosts(frames=0)
