"""Ladders of unwrapping: which sets of fringes are absolute, and by which steps best."""

import math

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from exposight.errors import ImageError
from exposight.imaging.ladders import unwrapping_ladder


def ladder(periods, *, steps=4, size=1024, code_width=None):
    return unwrapping_ladder(tuple(periods), (steps,) * len(periods), size, code_width)


@pytest.mark.parametrize("periods", [(1,), (0.5, 9), (1, 16), (1, 8, 64), (1, 5, 21, 100)])
def test_a_chain_from_one_period_is_climbed_fringe_by_fringe(periods):
    assert ladder(periods).combinations == tuple(map(tuple, np.eye(len(periods), dtype=int)))


def test_beats_of_three_fine_fringes():
    found = ladder((56, 63, 64))
    # beats of 1 and 8 periods, the finest fringe, then the others held against it
    assert found.combinations == ((0, -1, 1), (-1, 0, 1), (0, 0, 1), (1, 0, 0), (0, 1, 0))
    assert found.n_checks == 2
    # worst step: 8·(φ64 − φ63) against φ64 − φ56, σ_φ = √(2/4)·0.02/2π periods
    sigma = math.sqrt(2 / 4) * 0.02 / (2 * math.pi)
    assert found.deviation == pytest.approx(sigma * math.sqrt(7**2 + 8**2 + 1))


def test_a_beat_of_three_fringes():
    assert ladder((59, 64, 70)).combinations[0] == (1, -2, 1)


def test_a_fringe_of_more_steps_is_trusted_more():
    first = [
        unwrapping_ladder((8, 9, 10, 64), steps, 1024).combinations[0]
        for steps in ((12, 12, 3, 4), (3, 12, 12, 4))
    ]
    assert first == [(-1, 1, 0, 0), (0, -1, 1, 0)]


@pytest.mark.parametrize(
    ("periods", "message"),
    [
        ((12, 18), r"of 12, 18 periods repeat every 170\.667 px of 1024"),
        ((16,), "repeat every 64 px of 1024"),
        ((19.2, 28.8), r"repeat every 106\.667 px"),
        ((31, 33), "no combination of fringes of 31, 33 periods with small whole numbers"),
    ],
)
def test_what_is_not_absolute_is_refused(periods, message):
    with pytest.raises(ImageError, match=message):
        ladder(periods)


def test_a_beat_that_noise_upsets_is_refused():
    with pytest.raises(ImageError, match=r"noise of 2 % .* periods of standard deviation"):
        ladder((100, 101), steps=3)


def test_codes_wider_than_what_they_unwrap():
    with pytest.raises(ImageError, match="64 px wide, more than the 32 px"):
        ladder((32,), code_width=64)
    assert ladder((32,), code_width=32).combinations == ((1,),)


@settings(deadline=None)
@given(
    periods=st.lists(st.integers(2, 90), min_size=2, max_size=4, unique=True).map(sorted),
    place=st.floats(0, 1),
    seed=st.integers(0, 1000),
)
def test_a_ladder_finds_the_place_despite_its_noise(periods, place, seed):
    try:
        found = ladder(periods)
    except ImageError:
        assume(False)
        raise
    sigma = math.sqrt(2 / 4) * 0.02 / (2 * math.pi)
    noise = np.random.default_rng(seed).normal(0, sigma, len(periods)).clip(-2 * sigma, 2 * sigma)
    true = (0.1 + 0.8 * place) * np.array(periods)  # off the border, where a beat of 1 wraps
    phase = (true + 0.1 * noise) % 1.0
    absolute = None
    for step in found.combinations[: len(found.combinations) - found.n_checks]:
        frequency = float(np.dot(step, periods))
        part = float(np.dot(step, phase))
        if absolute is None:
            absolute = (part % 1.0) / frequency
        else:
            absolute = (part + round(absolute * frequency - part)) / frequency
    assert absolute * periods[-1] == pytest.approx(true[-1], abs=0.01)
