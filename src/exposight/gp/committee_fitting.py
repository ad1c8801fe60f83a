"""Hyperparameters of a committee: the sum of the shards' likelihoods, evaluated anywhere."""

import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike

from exposight.errors import InputError, NumericalError
from exposight.gp.bounds import Bounds, DataScale
from exposight.gp.committee import Committee
from exposight.gp.experts import Rows, count_shards, partition
from exposight.gp.fitting import EVALUATIONS, FitResult, Search, StartResult, counting, fit
from exposight.gp.kernels import Kernel
from exposight.gp.likelihood import MarginalLikelihood
from exposight.gp.observations import FloatArray, check_observations
from exposight.gp.regression import GaussianProcess
from exposight.gp.tiling import choose_threads, in_threads, limit_blas
from exposight.workers import Progress, ignore_progress


@dataclass(frozen=True, kw_only=True, eq=False)
class ShardTask:
    """One evaluation of one shard's likelihood; small, and fit to travel to another process.

    Attributes
    ----------
    kernel : Kernel
        Prior covariance.
    noise_variance : float
        In squared units of the target.
    x : (m, D) array
        The shard's inputs, all inside the kernel's gate.
    y : (m,) array
        Its targets.
    """

    kernel: Kernel
    noise_variance: float
    x: FloatArray
    y: FloatArray


def evaluate_shard(task: ShardTask) -> tuple[float, FloatArray]:
    """Evaluate a shard's `MarginalLikelihood` and its gradient, on one thread."""
    everywhere = np.ones(len(task.y), dtype=np.bool_)
    likelihood = MarginalLikelihood(task.x, task.y, active=everywhere, threads=1)
    return likelihood.value_and_gradient(task.kernel, task.noise_variance)


class ShardMap(Protocol):
    """Applies a function to tasks and returns the results in their order, as `map` does.

    `concurrent.futures.Executor.map` is one; for Dask's ``client`` take
    ``lambda work, tasks: client.gather(client.map(work, tasks, pure=False))``.
    """

    def __call__(
        self, work: Callable[[ShardTask], tuple[float, FloatArray]], tasks: Sequence[ShardTask], /
    ) -> Iterable[tuple[float, FloatArray]]:
        """Apply `work` to every task."""


@dataclass(frozen=True, kw_only=True, eq=False)
class CommitteeFitResult:
    """A fitted committee and how it was found.

    Attributes
    ----------
    committee : Committee
        With the hyperparameters found, conditioned on all observations.
    log_marginal_likelihood : float
        Sum over the shards that were searched on.
    converged : bool
        Whether the search on them reports a maximum.
    evaluations : int
        Of that sum with its gradient.
    seconds : float
        Wall time.
    searched : int
        Observations in the shards that were searched on.
    warm_start : FitResult
        The exact fit on the communication set, where the search began.
    parameters_at_bound : tuple of str
        Names of hyperparameters that ended at a limit.
    """

    committee: Committee
    log_marginal_likelihood: float
    converged: bool
    evaluations: int
    seconds: float
    searched: int
    warm_start: FitResult
    parameters_at_bound: tuple[str, ...]


@dataclass(frozen=True, kw_only=True, eq=False)
class _SumOfShards:
    """The likelihood of shards that know nothing of each other."""

    shards: Sequence[tuple[FloatArray, FloatArray]]
    shard_map: ShardMap

    @property
    def n_observations(self) -> int:
        """Of all shards."""
        return sum(len(y) for _, y in self.shards)

    def value_and_gradient(self, kernel: Kernel, noise_variance: float) -> tuple[float, FloatArray]:
        """Sum over the shards."""
        tasks = [
            ShardTask(kernel=kernel, noise_variance=noise_variance, x=x, y=y)
            for x, y in self.shards
        ]
        values, gradients = zip(*self.shard_map(evaluate_shard, tasks), strict=True)
        return float(sum(values)), np.sum(gradients, axis=0)


def fit_committee(
    kernel: Kernel,
    x: ArrayLike,
    y: ArrayLike,
    *,
    rng: np.random.Generator,
    shard_size: int = 2000,
    communication: int = 1000,
    search_shards: int | None = None,
    bounds: Bounds | None = None,
    restarts: int = 3,
    max_iterations: int = 300,
    shard_map: ShardMap | None = None,
    threads: int | None = None,
    progress: Progress = ignore_progress,
) -> CommitteeFitResult:
    """Find the hyperparameters that make the shards most likely, and condition a committee.

    The starts run on a sample as large as the communication set; from the best end one search
    climbs the sum of the shards' likelihoods.

    Parameters
    ----------
    kernel : Kernel
        Its form. Fixed hyperparameters keep their values.
    x : (n, D) array
        Inputs, each column in its own unit.
    y : (n,) array
        Targets.
    rng : numpy.random.Generator
        Draws the samples, the starts after the first, and the shards to search on.
    shard_size, communication
        As for `Committee.condition`.
    search_shards : int, optional
        Search on so many shards, drawn at random, instead of all: a handful of hyperparameters
        needs no hundred thousand observations.
    bounds, restarts, max_iterations
        As for `fit`.
    shard_map : ShardMap, optional
        Evaluates the shards, for instance the `map` of a pool of processes; threads of this
        process if left out.
    threads : int, optional
        For what is done in this process; chosen if left out.
    progress : Progress
        Called with the stage "fitting", steps done, and all steps: the starts, the search, then
        the experts; and within a start and the search as by `fit`.

    Returns
    -------
    CommitteeFitResult

    Raises
    ------
    InputError
        If an argument cannot be right, or the observations are too few for a committee.
    ObservationError
        If the observations are malformed, or all alike.
    NumericalError
        If every start failed, or the search could not begin.
    """
    began = time.perf_counter()
    _check_search_shards(search_shards)
    inputs, targets, active = check_observations(kernel, x, y)
    near, near_y = np.ascontiguousarray(inputs[active]), targets[active]
    experts = count_shards(len(near_y), shard_size=shard_size, communication=communication)
    steps = restarts + 1 + experts
    sample = rng.choice(len(near_y), size=communication, replace=False)
    warm = fit(
        kernel,
        near[sample],
        near_y[sample],
        rng=rng,
        bounds=bounds,
        restarts=restarts,
        max_iterations=max_iterations,
        progress=lambda stage, done, total: progress(
            stage, done, total if stage == EVALUATIONS else steps
        ),
    )
    parts = partition(
        warm.process.kernel, near, rng, shard_size=shard_size, communication=communication
    )
    likelihood = _SumOfShards(
        shards=[(near[rows], near_y[rows]) for rows in _choose(parts.shards, search_shards, rng)],
        shard_map=shard_map or _in_threads(choose_threads(threads, worthwhile=True)),
    )
    scale = DataScale.of(near, near_y)
    search = Search.of(kernel, scale, bounds=bounds, max_iterations=max_iterations)
    best = _climb(search, likelihood, warm.process, progress)
    progress("fitting", restarts + 1, steps)
    committee = Committee.condition(
        *search.hyperparameters(best.end),
        inputs,
        targets,
        rng=rng,
        shard_size=shard_size,
        communication=communication,
        threads=threads,
        progress=lambda _, done, __: progress("fitting", restarts + 1 + done, steps),
    )
    return CommitteeFitResult(
        committee=committee,
        log_marginal_likelihood=best.log_marginal_likelihood,
        converged=best.converged,
        evaluations=best.evaluations,
        seconds=time.perf_counter() - began,
        searched=likelihood.n_observations,
        warm_start=warm,
        parameters_at_bound=search.at_bound(best),
    )


def _in_threads(threads: int) -> ShardMap:
    return lambda work, tasks: in_threads(work, tasks, threads=threads)


def _check_search_shards(asked: int | None) -> None:
    if asked is not None and asked < 1:
        msg = f"search_shards must be at least 1, got {asked}; leave it out to search on all"
        raise InputError(msg)


def _choose(shards: Sequence[Rows], asked: int | None, rng: np.random.Generator) -> Sequence[Rows]:
    """Draw the shards to search on."""
    if asked is None:
        return shards
    drawn = rng.choice(len(shards), size=min(asked, len(shards)), replace=False)
    return [shards[i] for i in sorted(drawn)]


def _climb(
    search: Search, likelihood: _SumOfShards, warm: GaussianProcess, progress: Progress
) -> StartResult:
    """Search from where the exact fit ended, as far as the limits allow."""
    start = np.append(warm.kernel.log_parameters, np.log(warm.noise_variance))
    with limit_blas(1):
        end = search.run(likelihood, search.clip(start), counting(progress))
    if end.error is not None:
        count = len(likelihood.shards)
        msg = f"the search on {count} shards could not begin: {end.message}"
        raise NumericalError(msg) from end.error
    return end
