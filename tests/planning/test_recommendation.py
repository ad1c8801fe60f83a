"""Recommended exposures of one view, against the integer program over the same path."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import Bounds, LinearConstraint, milp

from exposight.errors import InputError
from exposight.planning.capture_chances import CaptureChances
from exposight.planning.exposure_limits import CaptureCosts, ExposureLimits
from exposight.planning.outlook import targets_of
from exposight.planning.path_search import cheapest_captures, fewest_captures
from exposight.planning.recommendation import recommend

LIMITS = ExposureLimits(name="any", min_ms=1.0, max_ms=1000.0, increment_ms=0.5)
COSTS = CaptureCosts(frames=12, overhead_ms=500.0)


def program(chances: CaptureChances, targets: np.ndarray, costs: np.ndarray) -> float:
    """Return the least cost of a path from the source over settings to the sink, by HiGHS."""
    m = len(costs)
    arcs = [(s, t) for s in range(-1, m) for t in range(s + 1, m + 1)]
    cost = np.array([costs[t] if t < m else 0.0 for _, t in arcs])
    gain = np.zeros((len(targets), len(arcs)))
    for a, (s, t) in enumerate(arcs):
        if t < m:
            gain[:, a] = chances.chance[:, t] if s < 0 else chances.gain[:, s, t]
    flow = np.zeros((m + 1, len(arcs)))
    for a, (s, t) in enumerate(arcs):
        flow[s + 1, a] += 1.0
        if t < m:
            flow[t + 1, a] -= 1.0
    source = np.zeros(m + 1)
    source[0] = 1.0
    solved = milp(
        cost,
        integrality=np.ones(len(arcs)),
        bounds=Bounds(0.0, 1.0),
        options={"mip_rel_gap": 0.0},
        constraints=[
            LinearConstraint(flow, source, source),
            LinearConstraint(gain, np.where(targets > 0.0, targets - 1e-9, -np.inf), np.inf),
        ],
    )
    return float(cost @ np.round(solved.x))


def drawn(seed: int) -> CaptureChances:
    rng = np.random.default_rng(seed)
    n, m = int(rng.integers(1, 9)), int(rng.integers(6, 18))
    low = np.exp(rng.uniform(np.log(2.0), np.log(90.0), n))
    ends = np.column_stack([low, low * np.exp(rng.uniform(0.5, 1.8, n))])
    times = np.sort(rng.choice(np.arange(2, 400), m, replace=False)).astype(float)
    return CaptureChances.of_windows(
        ends,
        times,
        features=[f"f{i}" for i in range(n)],
        std=rng.choice([0.0, 0.05, 0.2, 0.5]),
        edge_std=0.05,
    )


@given(seed=st.integers(0, 10**6))
@settings(max_examples=40, deadline=None)
def test_count_and_time_are_those_of_the_integer_program(seed: int) -> None:
    chances = drawn(seed)
    targets = targets_of(chances, 0.9)
    if not (targets > 0.0).any():
        return
    costs, m = 12.0 * chances.settings_ms + 500.0, len(chances.settings_ms)
    path = fewest_captures(chances, targets, costs, prefer="time", most=m)
    cheapest = cheapest_captures(chances, targets, costs, most=m)
    assert path is not None
    assert cheapest is not None
    assert (path.proven, cheapest.proven) == (True, True)
    huge = 1e5
    total = costs[list(path.places)].sum() + huge * len(path.places)
    assert total == pytest.approx(program(chances, targets, costs + huge))
    assert costs[list(cheapest.places)].sum() == pytest.approx(program(chances, targets, costs))


@given(seed=st.integers(0, 10**6), confidence=st.floats(0.3, 0.99))
@settings(max_examples=40, deadline=None)
def test_what_is_promised_is_the_chance_of_what_is_taken(seed: int, confidence: float) -> None:
    chances = drawn(seed)
    made = recommend(chances, LIMITS, COSTS, confidence=confidence)
    places = [int(np.flatnonzero(chances.settings_ms == t)[0]) for t in made.exposures_ms]
    promised = chances.any_of(places)
    assert [each.chance for each in made.features] == pytest.approx(promised.tolist())
    possible = chances.any_of(range(len(chances.settings_ms))) >= confidence
    reached = [each.status == "planned" for each in made.features]
    assert all(np.array(reached) >= possible)
    assert all(each.reason for each in made.features if each.status != "planned")


def test_the_robust_choice_lies_in_the_middle_and_the_short_one_at_the_start() -> None:
    chances = CaptureChances.of_windows(
        [[10.0, 90.0]], np.arange(5.0, 100.0), features=["hole"], std=0.2
    )
    robust = recommend(chances, LIMITS, COSTS).exposures_ms
    short = recommend(chances, LIMITS, COSTS, prefer="time").exposures_ms
    assert robust == (pytest.approx(30.0, abs=1.0),)  # √(10·90)
    assert short[0] == pytest.approx(10.0 * np.exp(1.2816 * 0.2), abs=1.0)


def test_two_holes_that_share_no_exposure_time_need_two() -> None:
    chances = CaptureChances.of_windows(
        [[5.0, 20.0], [40.0, 160.0]], np.arange(1.0, 200.0), features=["a", "b"], std=0.05
    )
    made = recommend(chances, LIMITS, COSTS)
    assert (len(made.exposures), made.proven) == (2, True)
    assert [each.covers for each in made.exposures] == [("a",), ("b",)]
    assert [each.order for each in made.exposures] == [1, 2]
    assert made.time_ms == pytest.approx(12 * sum(made.exposures_ms) + 1000.0)


def test_who_fails_is_said_and_why() -> None:
    limits = ExposureLimits(
        name="mains", min_ms=5.0, max_ms=100.0, increment_ms=1.0, flicker_hz=50.0
    )
    chances = CaptureChances.of_windows(
        [[400.0, 900.0], [1.0, 3.0], [12.0, 18.0], [30.0, 100.0]],
        limits.settings(1.0, 1000.0),
        features=["dark", "bright", "between", "good"],
        std=0.05,
    )
    made = recommend(chances, limits, COSTS)
    reasons = {each.feature: each.reason for each in made.features}
    assert "too dark" in reasons["dark"]
    assert "100 ms" in reasons["dark"]
    assert "too bright" in reasons["bright"]
    assert "flicker 50 Hz" in reasons["between"]
    assert reasons["good"] == ""
    assert [each.feature for each in made.planned] == ["good"]
    assert "flicker 50 Hz" in str(made.table)
    assert made.notes == ()  # each reason stands in one place


def test_a_sensor_that_takes_exactly_two_takes_two_and_one_of_a_list_its_values() -> None:
    limits = ExposureLimits(
        name="two", min_ms=10, max_ms=40, increment_ms=1, allowed_ms=(10, 20, 40),
        least_per_view=2, most_per_view=2,
    )  # fmt: skip
    chances = CaptureChances.of_windows(
        [[5.0, 100.0]], limits.settings(1.0, 100.0), features=["a"], std=0.05
    )
    made = recommend(chances, limits, COSTS)
    assert len(made.exposures) == 2
    assert {*made.exposures_ms} <= {10.0, 20.0, 40.0}


def test_where_a_view_may_have_one_capture_it_serves_most() -> None:
    limits = ExposureLimits(
        name="one", min_ms=1, max_ms=1000, increment_ms=1, most_per_view=1
    )  # fmt: skip
    chances = CaptureChances.of_windows(
        [[5.0, 20.0], [6.0, 22.0], [40.0, 160.0]], np.arange(1.0, 200.0), features=["a", "b", "c"],
        std=0.05,
    )  # fmt: skip
    made = recommend(chances, limits, COSTS)
    assert [each.feature for each in made.planned] == ["a", "b"]
    assert "more captures than the 1" in made.failing[0].reason
    assert (made.failing[0].status, made.failing[0].exposure_ms) == ("not planned", None)


def test_the_first_exposure_wins_so_the_surest_goes_first() -> None:
    limits = ExposureLimits(name="first", min_ms=1, max_ms=1000, increment_ms=1, lowest_wins=True)
    chances = CaptureChances.of_windows(
        [[5.0, 20.0], [40.0, 160.0], [50.0, 170.0]],
        np.arange(1.0, 200.0),
        features=["a", "b", "c"],
        std=0.05,
    )
    made = recommend(chances, limits, COSTS)
    assert [each.covers for each in made.exposures] == [("b", "c"), ("a",)]


@pytest.mark.parametrize("confidence", [0.0, 1.0, -1.0, float("nan")])
def test_a_confidence_is_a_chance(confidence: float) -> None:
    with pytest.raises(InputError, match="above 0 and below 1"):
        recommend(drawn(1), LIMITS, COSTS, confidence=confidence)
