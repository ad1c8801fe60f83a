"""Committees: where they equal the exact process, where the prior returns, who does the work."""

import pickle
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from itertools import pairwise
from multiprocessing import get_context

import numpy as np
import pytest
from scipy.stats import norm

from exposight.errors import InputError, NotPositiveDefiniteError, ObservationError
from exposight.gp import (
    Bounds,
    ChangePoint,
    Committee,
    Exponential,
    GaussianProcess,
    RationalQuadratic,
    SquaredExponential,
    fit_committee,
    kernel_from_dict,
)
from exposight.gp.committee_fitting import ShardTask, evaluate_shard
from exposight.gp.experts import in_length_scales, split_by_space
from exposight.statistics import rmse

# Two ways to the same factor, of a few hundred rows.
ROUNDING = 1e-8
NOISE = 0.01
KERNEL = RationalQuadratic(variance=1.0, length_scales=(0.4, 0.8), alpha=1.0, dims=(0, 1))
GATED = KERNEL * ChangePoint(dim=0, minimum=-1.0, maximum=1.0)


def truth(x):
    return np.sin(3 * x[:, 0]) * np.cos(2 * x[:, 1])


def observe(count, seed=0):
    rng = np.random.default_rng(seed)
    x = rng.uniform(-1.2, 1.2, size=(count, 2))
    return x, truth(x) + np.sqrt(NOISE) * rng.normal(size=count)


def committee_of(x, y, *, kernel=GATED, shard_size=100, communication=50, **more):
    return Committee.condition(
        kernel,
        NOISE,
        x,
        y,
        rng=np.random.default_rng(1),
        shard_size=shard_size,
        communication=communication,
        **more,
    )


def test_one_expert_is_the_exact_process():
    x, y = observe(200)
    new = observe(50, seed=1)[0]
    ours = committee_of(x, y, shard_size=200).predict(new, include_noise=True)
    exact = GaussianProcess.condition(GATED, NOISE, x, y).predict(new, include_noise=True)
    np.testing.assert_allclose(ours.mean, exact.mean, atol=ROUNDING)
    np.testing.assert_allclose(ours.std, exact.std, atol=ROUNDING)


def test_experts_follow_the_published_rule():
    x, y = observe(230)
    inside = ~GATED.gate(x)
    x, y = x[inside], y[inside]
    new = np.random.default_rng(2).uniform(-1, 1, size=(9, 2))
    committee = committee_of(x, y, shard_size=60)
    known = np.sort(np.random.default_rng(1).choice(len(x), size=50, replace=False))
    others = np.delete(np.arange(len(x)), known)
    shards = split_by_space(in_length_scales(GATED, x[others]), committee.experts)

    def ask(rows):
        prediction = GaussianProcess.condition(GATED, NOISE, x[rows], y[rows]).predict(new)
        return prediction.mean, prediction.std**2

    shared_mean, shared_variance = ask(known)
    precision, weighted, weights = 0.0, 0.0, 0.0
    for number, shard in enumerate(shards):
        mean, variance = ask(np.concatenate([known, others[shard]]))
        weight = 1.0 if number == 0 else 0.5 * (np.log(shared_variance) - np.log(variance))
        precision += weight / variance
        weighted += weight * mean / variance
        weights += weight
    precision += (1.0 - weights) / shared_variance
    weighted += (1.0 - weights) * shared_mean / shared_variance
    prediction = committee.predict(new)
    assert committee.experts == 3
    np.testing.assert_allclose(prediction.mean, weighted / precision, atol=ROUNDING)
    np.testing.assert_allclose(prediction.std**2, 1.0 / precision, atol=ROUNDING)


def test_little_is_lost_against_the_exact_process():
    x, y = observe(1500)
    new, seen = observe(400, seed=1)
    ours = committee_of(x, y, shard_size=300, communication=100).predict(new, include_noise=True)
    exact = GaussianProcess.condition(GATED, NOISE, x, y).predict(new, include_noise=True)
    assert rmse(seen, ours.mean) < 1.02 * rmse(seen, exact.mean)
    density, exact_density = (norm.logpdf(seen, p.mean, p.std).mean() for p in (ours, exact))
    assert density > exact_density - 0.02


def test_far_from_all_observations_the_prior_returns():
    x, y = observe(300)
    far = committee_of(x, y, kernel=SquaredExponential(variance=2.0, length_scales=0.5, dims=(0,)))
    prediction = far.predict([[50.0, 0.0]])
    assert prediction.mean[0] == pytest.approx(0.0, abs=ROUNDING)
    assert prediction.std[0] == pytest.approx(np.sqrt(2.0))


def test_outside_the_gate_the_prediction_is_exactly_zero_without_variance():
    prediction = committee_of(*observe(300)).predict([[1.1, 0.0], [0.0, 0.0], [-3.0, 0.0]])
    assert prediction.mean[[0, 2]].tolist() == prediction.std[[0, 2]].tolist() == [0.0, 0.0]
    assert prediction.std[1] > 0.0


def test_observations_outside_the_gate_do_not_count():
    x, y = observe(300)
    assert committee_of(x, y).n_observations == int((~GATED.gate(x)).sum()) < 300


def test_threads_change_nothing_and_progress_is_told():
    x, y = observe(1500)
    new = observe(1200, seed=1)[0]
    steps, rows = [], []
    one = committee_of(x, y, threads=1, progress=lambda *step: steps.append(step))
    two = committee_of(x, y, threads=2)
    ours = one.predict(new, threads=1, progress=lambda *step: rows.append(step))
    theirs = two.predict(new, threads=2)
    np.testing.assert_array_equal(ours.mean, theirs.mean)
    np.testing.assert_array_equal(ours.std, theirs.std)
    assert steps == [("conditioning", done + 1, one.experts) for done in range(one.experts)]
    inside = int((~GATED.gate(new)).sum())
    assert rows[-1] == ("predicting", inside, inside)


def test_a_committee_is_rebuilt_from_what_describes_it():
    new = observe(50, seed=1)[0]
    first = committee_of(*observe(300))
    kernel = kernel_from_dict(first.kernel.to_dict())
    again = Committee.from_shards(kernel, first.noise_variance, first.x, first.y, first.shard)
    assert again.experts == first.experts == 3
    assert again.n_observations == first.n_observations
    one, other = (committee.predict(new, include_noise=True) for committee in (first, again))
    np.testing.assert_array_equal(one.mean, other.mean)
    np.testing.assert_array_equal(one.std, other.std)


@pytest.mark.parametrize("shard", [[0, 0, 0], [-1, -1, -1], [-1, 0, 2], [-1.0, 0.0, 1.0], [-1, 0]])
def test_observations_that_are_not_shared_out_are_refused(shard):
    with pytest.raises(InputError, match="an integer for each of the 3 observations"):
        Committee.from_shards(KERNEL, NOISE, np.eye(3)[:, :2], np.ones(3), shard)


def test_shards_are_equal_compact_and_complete():
    x = np.random.default_rng(0).uniform(size=(1003, 2)) * [1.0, 10.0]
    shards = split_by_space(x, 7)
    assert sorted(np.concatenate(shards)) == list(range(1003))
    assert {len(rows) for rows in shards} == {143, 144}
    # cut along the wide column alone, seven pieces lie side by side
    ordered = sorted(shards, key=lambda rows: x[rows, 1].mean())
    for below, above in pairwise(ordered):
        assert x[below, 1].max() <= x[above, 1].min()


def test_space_is_measured_by_the_shortest_length_scale_of_a_column():
    kernel = KERNEL * Exponential(variance=1.0, length_scales=0.2, dims=(1, 2))
    x = np.ones((4, 4))
    np.testing.assert_allclose(in_length_scales(kernel, x)[0], [1 / 0.4, 1 / 0.2, 1 / 0.2])


def test_a_column_without_length_scale_is_measured_by_its_spread():
    x = np.column_stack([np.arange(4.0), [0.0, 0.0, 6.0, 6.0]])
    kernel = SquaredExponential(variance=1.0, length_scales=2.0, dims=(0,)) * ChangePoint(
        dim=1, minimum=0.0
    )
    np.testing.assert_allclose(in_length_scales(kernel, x)[3], [1.5, 2.0])


def test_a_repeated_observation_is_given_jitter():
    x = np.repeat(np.linspace(0, 1, 20), 3)[:, None]
    kernel = SquaredExponential(variance=1.0, length_scales=0.1, dims=(0,))
    committee = Committee.condition(
        kernel,
        1e-20,
        x,
        np.sin(x[:, 0]),
        rng=np.random.default_rng(0),
        shard_size=30,
        communication=10,
    )
    assert committee.jitter > 0.0
    np.testing.assert_allclose(committee.predict(x).mean, np.sin(x[:, 0]), atol=1e-2)


def test_a_shard_without_factor_names_cause_and_remedy(monkeypatch):
    monkeypatch.setattr("exposight.gp.experts.factor_with_jitter", lambda matrix, fill: None)
    with pytest.raises(
        NotPositiveDefiniteError, match=r"a shard of 100 observations.*Raise the noise variance"
    ):
        committee_of(*observe(150), kernel=KERNEL)


@pytest.mark.parametrize(
    "sizes",
    [{"shard_size": 0}, {"communication": 0}, {"communication": 200}],
)
def test_impossible_sizes_are_refused(sizes):
    with pytest.raises(InputError, match=r"200 observations .* Few observations need no committee"):
        committee_of(*observe(200), kernel=KERNEL, **sizes)


def test_predicting_with_other_columns_is_refused():
    with pytest.raises(ObservationError, match=r"must have the 2 columns .* got 1"):
        committee_of(*observe(200)).predict([[1.0]])


def fitted(**more):
    x, y = observe(400)
    settings = {"shard_size": 100, "communication": 60, "restarts": 1, **more}
    return fit_committee(GATED, x, y, rng=np.random.default_rng(4), **settings)


@pytest.fixture(scope="module")
def fit_here():
    return fitted(threads=1)


def test_a_fit_finds_the_noise_and_predicts(fit_here):
    new, seen = observe(300, seed=1)
    inside = ~GATED.gate(new)
    assert fit_here.converged
    assert fit_here.committee.noise_variance == pytest.approx(NOISE, rel=0.3)
    predicted = fit_here.committee.predict(new).mean
    assert rmse(seen[inside], predicted[inside]) < 1.2 * np.sqrt(NOISE)


def test_the_search_climbs_from_where_the_warm_start_ended(fit_here):
    kernel = fit_here.committee.kernel
    assert fit_here.evaluations > 1
    assert not np.allclose(kernel.log_parameters, fit_here.warm_start.process.kernel.log_parameters)


def test_a_shards_likelihood_agrees_with_conditioning(gradient_of):
    x, y = observe(80)
    likelihood, gradient = evaluate_shard(ShardTask(kernel=KERNEL, noise_variance=NOISE, x=x, y=y))
    process = GaussianProcess.condition(KERNEL, NOISE, x, y)
    assert likelihood == pytest.approx(process.log_marginal_likelihood, rel=ROUNDING)
    np.testing.assert_allclose(gradient, gradient_of(process), rtol=1e-6)


def assert_same_fit(one, other):
    new = observe(20, seed=1)[0]
    assert one.log_marginal_likelihood == other.log_marginal_likelihood
    assert one.evaluations == other.evaluations
    np.testing.assert_array_equal(
        one.committee.predict(new).mean, other.committee.predict(new).mean
    )


def test_a_pool_of_threads_gives_the_same_numbers(fit_here):
    with ThreadPoolExecutor(2) as pool:
        assert_same_fit(fit_here, fitted(shard_map=pool.map))


@pytest.mark.slow
def test_a_pool_of_processes_gives_the_same_numbers(fit_here):
    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as pool:
        assert_same_fit(fit_here, fitted(shard_map=pool.map))


def test_dask_gives_the_same_numbers(fit_here):
    distributed = pytest.importorskip("distributed", reason="Dask is not installed")
    with (
        distributed.LocalCluster(n_workers=1, processes=False, dashboard_address=None) as cluster,
        distributed.Client(cluster) as client,
    ):

        def on_cluster(work, tasks):
            return client.gather(client.map(work, tasks, pure=False))

        assert_same_fit(fit_here, fitted(shard_map=on_cluster))


def test_a_search_on_some_shards_conditions_on_all():
    result = fitted(search_shards=2)
    assert result.searched < 200 < result.committee.n_observations


def test_bounds_hold():
    low, high = 0.02, 0.03
    result = fitted(bounds=Bounds(named={"noise_variance": (low, high)}))
    assert result.committee.noise_variance == pytest.approx(low)
    assert "noise_variance" in result.parameters_at_bound


def test_progress_counts_starts_search_and_experts():
    seen = []
    result = fitted(progress=lambda *step: seen.append(step), threads=1)
    steps = 1 + 1 + result.committee.experts
    counted = [step for step in seen if step[0] == "fitting"]
    assert counted == [("fitting", done + 1, steps) for done in range(steps)]


def test_few_observations_are_sent_to_fit():
    with pytest.raises(InputError, match=r"use fit or GaussianProcess\.condition"):
        fit_committee(KERNEL, *observe(100), rng=np.random.default_rng(0))


def test_a_search_on_no_shard_is_refused():
    with pytest.raises(InputError, match="search_shards must be at least 1, got 0"):
        fitted(search_shards=0)


def test_a_pickle_carries_no_factors_and_predicts_the_same():
    x, y = observe(600)
    committee = committee_of(x, y, shard_size=200)
    sent = pickle.dumps(committee)
    assert len(sent) < 2 * (x.nbytes + y.nbytes) + 10_000
    there = pickle.loads(sent)
    assert there.experts == committee.experts
    new = observe(50, seed=1)[0]
    np.testing.assert_array_equal(there.predict(new).std, committee.predict(new).std)
