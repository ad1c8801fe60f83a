"""Chances of captures, by themselves and together."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.special import ndtr

from exposight.errors import InputError
from exposight.planning.capture_chances import CaptureChances

TIMES = np.geomspace(1.0, 100.0, 41)


def chances(std: float, edge: float = 0.0, low: float = 8.0, high: float = 30.0) -> CaptureChances:
    return CaptureChances.of_windows(
        [[low, high]], TIMES, features=["hole"], std=std, edge_std=edge
    )


def drawn(std: float, edge: float, low: float, high: float) -> np.ndarray:
    rng = np.random.default_rng(1)
    shift = std * rng.standard_normal(200_000)
    first = np.log(low) - shift + edge * rng.standard_normal(len(shift))
    last = np.log(high) - shift + edge * rng.standard_normal(len(shift))
    at = np.log(TIMES)[:, None]
    return (at >= first) & (at <= last)


def test_one_capture_is_the_difference_of_two_normal_distributions() -> None:
    log = np.log(TIMES)
    expected = ndtr((log - np.log(8.0)) / 0.2) - ndtr((log - np.log(30.0)) / 0.2)
    assert chances(0.2).chance[0] == pytest.approx(expected, abs=2e-3)


def test_a_known_window_is_kept_or_missed() -> None:
    inside = (TIMES >= 8.0) & (TIMES <= 30.0)
    assert chances(0.0).chance[0] == pytest.approx(inside.astype(float), abs=1e-5)


@settings(deadline=None)
@given(
    std=st.floats(0.02, 0.8),
    edge=st.floats(0.0, 0.2),
    places=st.lists(st.integers(0, 40), min_size=1, max_size=4),
)
def test_several_captures_serve_as_often_as_in_draws(
    std: float, edge: float, places: list[int]
) -> None:
    served = drawn(std, edge, 8.0, 30.0)[places].any(axis=0).mean()
    assert chances(std, edge).any_of(places)[0] == pytest.approx(served, abs=0.012)


@settings(deadline=None)
@given(places=st.lists(st.integers(0, 40), min_size=2, max_size=5, unique=True))
def test_gains_along_a_path_add_up(places: list[int]) -> None:
    each, ordered = chances(0.4, 0.05), sorted(places)
    total = each.chance[0, ordered[0]]
    total += sum(each.gain[0, s, t] for s, t in pairwise(ordered))
    assert total == pytest.approx(each.any_of(places)[0], abs=1e-9)
    rest = total - each.chance[0, ordered[0]]
    assert rest <= each.later[0, ordered[0]] + 1e-9


def test_the_same_exposure_time_twice_gains_nothing() -> None:
    each = chances(0.4)
    assert each.any_of([20, 20]) == pytest.approx(each.chance[:, 20])


def test_a_pair_nearly_a_window_apart_is_surest() -> None:
    """Planning notes: with σ 0.6 and a window of ln(110/27) the best pair gives 0.979."""
    each = CaptureChances.of_windows(
        [[10.0, 10.0 * 110 / 27]], np.geomspace(2.0, 200.0, 81), features=["hole"], std=0.6
    )
    pairs = [each.any_of([i, j])[0] for i in range(81) for j in range(i, 81)]
    assert each.chance.max() == pytest.approx(0.758, abs=0.004)
    assert max(pairs) == pytest.approx(0.979, abs=0.004)


def test_where_there_is_no_window_there_is_no_chance() -> None:
    each = CaptureChances.of_windows([[np.nan, np.nan]], TIMES, features=["hole"], std=0.1)
    assert each.chance.max() == 0.0
    assert each.any_of([3, 5])[0] == 0.0


@pytest.mark.parametrize("times", [[], [3.0, 2.0], [0.0, 1.0]])
def test_settings_ascend(times: list[float]) -> None:
    with pytest.raises(InputError, match="ascend"):
        CaptureChances.of_windows([[1.0, 2.0]], times, features=["hole"])
