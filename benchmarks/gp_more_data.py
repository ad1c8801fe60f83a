"""More data: one observation more, and committees of exact experts for many.

Run by ``make bench NAME=gp``, or alone: ``python -m benchmarks.gp_more_data``. The committee is
compared with the exact process at the same hyperparameters, those that the committee found, on
observations that neither has seen.
"""

from __future__ import annotations

import time

import numpy as np
from numpy.typing import NDArray
from scipy.stats import norm

from benchmarks.gp_peers import exposure_problem, inputs, quality_kernel
from benchmarks.measuring import Figure, at_most, best_of, publish, say
from exposight.gp import CommitteeFitResult, GaussianProcess, Prediction, fit_committee
from exposight.statistics import rmse

_ROWS, _MANY_ROWS, _UNSEEN = 10_000, 100_000, 2000
_NOISE = 0.03  # of p_norm, about what a ring of a few hundred pixels has
_SEARCH_SHARDS = 8

_Array = NDArray[np.float64]


def main() -> None:
    """Run this part alone."""
    publish("Gaussian processes: more data", more_data())


def more_data() -> list[Figure]:
    """Measure updates, then committees of ten and of a hundred thousand observations."""
    return [*updates(), *against_exact(), *hundred_thousand()]


def updates() -> list[Figure]:
    """Add one observation to 2000."""
    say("2000 observations, one more")
    problem = exposure_problem()
    rng = np.random.default_rng(6)
    x = inputs(rng, 2001, 6)
    y = rng.standard_normal(2001)
    process = GaussianProcess.condition(problem.kernel, problem.noise_variance, x[:2000], y[:2000])
    added = best_of(15, lambda: process.with_observations(x[2000:], y[2000:]))
    afresh = best_of(
        5, lambda: GaussianProcess.condition(problem.kernel, problem.noise_variance, x, y)
    )
    return [
        at_most("add_one_ms", 1e3 * added.wall_s, 30.0, "ms, wall"),
        Figure(name="add_one_cpu_ms", value=1e3 * added.cpu_s, unit="ms"),
        Figure(name="afresh_cpu_ms", value=1e3 * afresh.cpu_s, unit="ms"),
    ]


def quality(x: _Array) -> _Array:
    """Return a smooth p_norm of (n, 4) inputs: it rises, stays and falls with the brightness."""
    i_avg, x_mm, y_mm, z_mm = x.T
    rise = 1.0 / (1.0 + np.exp((25.0 - i_avg - 0.03 * z_mm) / 6.0))
    edge = 170.0 - 0.15 * x_mm - 20.0 * np.sin(y_mm / 60.0) + 0.1 * z_mm
    fall = 1.0 / (1.0 + np.exp((i_avg - edge) / 15.0))
    level = 0.85 + 0.1 * np.cos(x_mm / 90.0) * np.sin(z_mm / 70.0) + 0.05 * np.sin(y_mm / 40.0)
    out: _Array = rise * fall * level
    return out


def _observe(rng: np.random.Generator, rows: int) -> tuple[_Array, _Array]:
    x = inputs(rng, rows, 4)
    return x, quality(x) + _NOISE * rng.standard_normal(rows)


def against_exact() -> list[Figure]:
    """Compare with the exact process, same hyperparameters, on unseen observations and truth."""
    say("10 000 observations, committee and exact process")
    rng = np.random.default_rng(7)
    x, y = _observe(rng, _ROWS)
    unseen_x, unseen_y = _observe(rng, _UNSEEN)
    result = fit_committee(quality_kernel(), x, y, rng=np.random.default_rng(8), restarts=1)
    committee = result.committee
    _describe(result)
    exact = GaussianProcess.condition(committee.kernel, committee.noise_variance, x, y)
    ours = committee.predict(unseen_x, include_noise=True)
    theirs = exact.predict(unseen_x, include_noise=True)
    truth = quality(unseen_x)
    return [
        at_most("committee_rmse_ratio", _ratio(unseen_y, ours, theirs), 1.05),
        Figure(name="committee_rmse_ratio_truth", value=_ratio(truth, ours, theirs)),
        Figure(
            name="committee_nlpd_loss",
            value=_log_density(unseen_y, theirs) - _log_density(unseen_y, ours),
            unit="nats an observation",
        ),
    ]


def _ratio(observed: _Array, ours: Prediction, theirs: Prediction) -> float:
    return rmse(observed, ours.mean) / rmse(observed, theirs.mean)


def _log_density(observed: _Array, prediction: Prediction) -> float:
    """Mean log density of the observations, in nats."""
    return float(np.mean(norm.logpdf(observed, prediction.mean, prediction.std)))


def hundred_thousand() -> list[Figure]:
    """Fit a hundred thousand observations and predict."""
    say(f"100 000 observations, searching on {_SEARCH_SHARDS} shards of 2000")
    rng = np.random.default_rng(9)
    x, y = _observe(rng, _MANY_ROWS)
    unseen_x, unseen_y = _observe(rng, _UNSEEN)
    began = time.process_time()
    result = fit_committee(
        quality_kernel(),
        x,
        y,
        rng=np.random.default_rng(8),
        restarts=1,
        search_shards=_SEARCH_SHARDS,
    )
    cpu_s = time.process_time() - began
    _describe(result)
    began = time.process_time()
    prediction = result.committee.predict(unseen_x)
    predicted_s = time.process_time() - began
    return [
        Figure(name="committee_100k_fit_s", value=result.seconds, unit="s, wall, two threads"),
        Figure(name="committee_100k_fit_cpu_s", value=cpu_s, unit="s"),
        Figure(name="committee_100k_predict_2000_cpu_s", value=predicted_s, unit="s"),
        Figure(
            name="committee_100k_rmse", value=rmse(unseen_y, prediction.mean), unit="noise 0.03"
        ),
        Figure(name="committee_100k_rmse_truth", value=rmse(quality(unseen_x), prediction.mean)),
    ]


def _describe(result: CommitteeFitResult) -> None:
    say(
        f"  {result.committee.experts} experts, {result.evaluations} evaluations on "
        f"{result.searched} observations, {result.seconds:.0f} s, "
        f"jitter {result.committee.jitter:g}, at bound: {result.parameters_at_bound}"
    )
    say(f"  {result.committee.kernel}, noise {result.committee.noise_variance:.2e}")


if __name__ == "__main__":
    main()
