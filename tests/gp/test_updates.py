"""Observations added and removed: the same as conditioning afresh, whatever the order."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from exposight.errors import InputError, ObservationError
from exposight.gp import (
    ChangePoint,
    GaussianProcess,
    RationalQuadratic,
    SquaredExponential,
    regression,
    updates,
)

# Well-conditioned factors of a few dozen rows, updated a few times.
ROUNDING = 1e-9
NOISE = 0.04
GATED = (
    RationalQuadratic(variance=1.5, length_scales=(0.4, 0.8), alpha=0.6, dims=(0, 1))
    * ChangePoint(dim=0, minimum=-1.0)
    * ChangePoint(dim=0, maximum=1.0)
)
NEW = np.random.default_rng(5).uniform(-1.2, 1.2, size=(7, 2))


def observations(count, seed=3):
    """A quarter of them lies outside the gate."""
    rng = np.random.default_rng(seed)
    x = rng.uniform(-1.3, 1.3, size=(count, 2))
    return x, np.sin(3 * x[:, 0]) + 0.3 * x[:, 1] + 0.1 * rng.normal(size=count)


def assert_same(one, other):
    np.testing.assert_array_equal(one.x, other.x)
    np.testing.assert_array_equal(one.y, other.y)
    assert one.log_marginal_likelihood == pytest.approx(other.log_marginal_likelihood, rel=ROUNDING)
    for mine, theirs in (
        (one.predict(NEW), other.predict(NEW)),
        (one.leave_one_out(), other.leave_one_out()),
    ):
        np.testing.assert_allclose(mine.mean, theirs.mean, atol=ROUNDING)
        np.testing.assert_allclose(mine.std, theirs.std, atol=ROUNDING)
    np.testing.assert_allclose(
        one.log_marginal_likelihood_gradient(),
        other.log_marginal_likelihood_gradient(),
        rtol=ROUNDING,
    )


@pytest.fixture
def afresh_is_forbidden(monkeypatch):
    def refuse(*arguments, **named):
        pytest.fail("the covariance was factorised afresh")

    monkeypatch.setattr(updates, "_MANY", 1.0)
    return lambda: monkeypatch.setattr(regression, "factorise", refuse)


@settings(max_examples=40, deadline=None)
@given(data=st.data())
def test_any_sequence_of_additions_and_removals_equals_conditioning_afresh(data):
    pool_x, pool_y = observations(60)
    held = list(range(20))
    process = GaussianProcess.condition(GATED, NOISE, pool_x[held], pool_y[held])
    for _ in range(data.draw(st.integers(1, 5))):
        if data.draw(st.booleans()):
            added = data.draw(st.lists(st.integers(0, 59), max_size=6))
            process = process.with_observations(pool_x[added].reshape(-1, 2), pool_y[added])
            held += added
        else:
            rows = data.draw(st.sets(st.integers(0, len(held) - 1), max_size=min(6, len(held) - 9)))
            process = process.without_observations(sorted(rows))
            held = [own for row, own in enumerate(held) if row not in rows]
    assert_same(process, GaussianProcess.condition(GATED, NOISE, pool_x[held], pool_y[held]))


@pytest.mark.parametrize("count", [1, 12])
def test_adding_uses_the_factor_that_is_there(count, afresh_is_forbidden):
    x, y = observations(40)
    process = GaussianProcess.condition(GATED, NOISE, x[count:], y[count:])
    whole = GaussianProcess.condition(GATED, NOISE, np.roll(x, -count, 0), np.roll(y, -count))
    afresh_is_forbidden()
    assert_same(process.with_observations(x[:count], y[:count]), whole)


@pytest.mark.parametrize("rows", [[0], [39], [3, 4, 5, 20], range(0, 40, 3)])
def test_removing_uses_the_factor_that_is_there(rows, afresh_is_forbidden):
    x, y = observations(40)
    process = GaussianProcess.condition(GATED, NOISE, x, y)
    rest = GaussianProcess.condition(GATED, NOISE, np.delete(x, rows, 0), np.delete(y, rows))
    afresh_is_forbidden()
    assert_same(process.without_observations(rows), rest)


def test_removing_many_at_once_gives_the_same():
    x, y = observations(40)
    process = GaussianProcess.condition(GATED, NOISE, x, y).without_observations(range(5, 35))
    keep = np.r_[:5, 35:40]
    assert_same(process, GaussianProcess.condition(GATED, NOISE, x[keep], y[keep]))


def test_rounding_does_not_grow_over_hundreds_of_updates():
    x, y = observations(60)
    start = process = GaussianProcess.condition(GATED, NOISE, x, y)
    rng = np.random.default_rng(0)
    for _ in range(300):
        row = int(rng.integers(60))
        process = process.with_observations(process.x[[row]], process.y[[row]])
        process = process.without_observations([row])
    order = np.lexsort(process.x.T), np.lexsort(start.x.T)
    np.testing.assert_array_equal(process.x[order[0]], start.x[order[1]])
    assert process.log_marginal_likelihood == pytest.approx(
        start.log_marginal_likelihood, rel=ROUNDING
    )
    np.testing.assert_allclose(process.predict_mean(NEW), start.predict_mean(NEW), atol=ROUNDING)


def test_the_process_itself_does_not_change():
    x, y = observations(30)
    process = GaussianProcess.condition(GATED, NOISE, x, y)
    before = process.predict(NEW)
    process.with_observations(NEW, np.ones(7))
    process.without_observations([0, 1])
    after = process.predict(NEW)
    np.testing.assert_array_equal(after.mean, before.mean)
    np.testing.assert_array_equal(after.std, before.std)


def test_observations_outside_the_gate_count_as_white_noise_alone():
    x, y = observations(30)
    process = GaussianProcess.condition(GATED, NOISE, x, y)
    more = process.with_observations([[5.0, 0.0]], [0.3])
    noise = -0.5 * (0.3**2 / NOISE + np.log(2 * np.pi * NOISE))
    assert more.log_marginal_likelihood - process.log_marginal_likelihood == pytest.approx(noise)
    np.testing.assert_array_equal(more.predict_mean(NEW), process.predict_mean(NEW))


SMOOTH = SquaredExponential(variance=1.0, length_scales=1.0, dims=(0,))


def test_a_repeated_observation_that_leaves_no_factor_is_given_jitter():
    process = GaussianProcess.condition(SMOOTH, 1e-20, [[0.0], [3.0]], [1.0, 2.0])
    assert process.jitter == 0.0
    repeated = process.with_observations([[0.0]], [1.0])
    assert 0.0 < repeated.jitter <= 1e-6
    np.testing.assert_allclose(repeated.predict_mean([[0.0]]), 1.0, atol=1e-5)


def test_without_the_repeated_observation_the_jitter_is_gone():
    x, y = [[0.0], [3.0], [0.0]], [1.0, 2.0, 1.0]
    process = GaussianProcess.condition(SMOOTH, 1e-20, x, y)
    assert process.jitter > 0.0
    assert process.without_observations([2]).jitter == 0.0


def test_all_observations_inside_the_gate_cannot_leave():
    process = GaussianProcess.condition(GATED, NOISE, [[0.0, 0.0], [5.0, 0.0]], [1.0, 0.0])
    with pytest.raises(ObservationError, match="all 1 observations lie outside the range"):
        process.without_observations([0])
    with pytest.raises(ObservationError, match="at least one observation"):
        process.without_observations([0, 1])


@pytest.mark.parametrize(
    ("rows", "message"),
    [
        ([3], r"integers from 0 to 2, .* from 3 to 3"),
        ([-1], "from -1 to -1"),
        ([0.0], "got float64"),
        ([True, False, True], "turn a mask into rows with np.flatnonzero"),
    ],
)
def test_rows_that_are_not_there_are_refused(rows, message):
    process = GaussianProcess.condition(SMOOTH, 0.1, [[0.0], [1.0], [2.0]], [0.0, 1.0, 2.0])
    with pytest.raises(InputError, match=message):
        process.without_observations(rows)


def test_malformed_new_observations_are_refused():
    process = GaussianProcess.condition(SMOOTH, 0.1, [[0.0]], [0.0])
    with pytest.raises(ObservationError, match=r"must have the 1 columns .* got 2"):
        process.with_observations([[0.0, 1.0]], [0.0])
    with pytest.raises(ObservationError, match="each of the 1 rows"):
        process.with_observations([[0.0]], [0.0, 1.0])
