"""Phases of 64, 63 and 56 periods along lines of pixels, as they are and as they are mistaken."""

import numpy as np
import pytest

from exposight.contradictions.fringe_sets import FringeSet, check_fringe_set
from exposight.imaging.ladders import unwrapping_ladder

_PERIODS = (56.0, 63.0, 64.0)


def _set(sign=(1, 1, 1), offset=(0, 0, 0), said=_PERIODS, noise=0.005, seed=0):
    """Phases of an uneven surface before a step, with noise in periods."""
    along = np.linspace(60, 700, 400) + 12 * np.sin(np.linspace(0, 7, 400))
    column = np.where(np.arange(400) > 230, along + 150, along) + np.arange(10)[:, None]
    turns = np.array(_PERIODS)[:, None, None] * column / 1024
    phases = np.array(sign)[:, None, None] * turns - np.array(offset)[:, None, None] / 360
    phases += np.random.default_rng(seed).normal(0, noise, phases.shape)
    return FringeSet(
        phases=phases - np.rint(phases),
        usable=np.ones(column.shape, dtype=bool),
        periods=said,
        frames=[(8, 9, 10, 11), (4, 5, 6, 7), (0, 1, 2, 3)],
        combinations=np.array(unwrapping_ladder(said, (4, 4, 4), 1024).combinations),
        size=1024,
        axis="columns",
    )


@pytest.mark.parametrize("noise", [0.0, 0.005, 0.02, 0.1, 1.0])
def test_right_sets_are_quiet_however_noisy(noise):
    assert check_fringe_set(_set(noise=noise)) is None


@pytest.mark.parametrize(("turned", "named"), [(0, "56"), (1, "63"), (2, "64")])
def test_the_fringe_whose_steps_run_the_other_way_is_named(turned, named):
    found = check_fringe_set(_set(sign=[-1 if i == turned else 1 for i in range(3)], noise=0.02))
    assert found.is_error
    assert f"fringe of {named} periods" in found.explanation
    assert "reversed = true" in found.explanation


def test_the_number_of_periods_that_fits_is_named():
    found = check_fringe_set(_set(said=(55.0, 63.0, 64.0)))
    assert found.is_error
    assert "frames 8, 9, 10, 11 56.0" in found.explanation


@pytest.mark.parametrize(("angle", "is_error"), [(30, False), (90, True), (-90, True), (180, True)])
def test_steps_that_all_begin_elsewhere_are_named_with_their_angle(angle, is_error):
    found = check_fringe_set(_set(offset=[angle] * 3))
    assert found.is_error is is_error
    assert f"add {angle} to each" in found.explanation


def test_one_fringe_that_begins_elsewhere_is_told():
    assert "begin elsewhere" in check_fringe_set(_set(offset=(0, 40, 0))).explanation


def test_phases_without_a_relation_that_are_smooth_are_an_error():
    others = _set()
    strange = np.broadcast_to(7 * np.linspace(0, 1, 400) ** 2, others.usable.shape)
    phases = np.stack([others.phases[0], strange - np.rint(strange), others.phases[2]])
    assert check_fringe_set(others._replace(phases=phases)).is_error


def test_too_few_pixels_tell_nothing():
    turned = _set(sign=(1, -1, 1))
    assert check_fringe_set(turned._replace(usable=np.zeros_like(turned.usable))) is None
