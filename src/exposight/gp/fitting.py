"""Hyperparameters by maximum marginal likelihood: several starts, the most likely end wins."""

import logging
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import count
from typing import Literal, Protocol

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import minimize

from exposight.errors import InputError, NotPositiveDefiniteError, NumericalError
from exposight.gp import observations
from exposight.gp.bounds import NOISE_VARIANCE, Bounds, DataScale, starting_values
from exposight.gp.kernels import Kernel
from exposight.gp.likelihood import MarginalLikelihood
from exposight.gp.regression import GaussianProcess
from exposight.workers import Progress, ignore_progress

_logger = logging.getLogger(__name__)

# Later starts vary the first by a factor of e and more: far enough to leave its basin.
_START_SPREAD = 1.0
# A first guess of the noise, as a share of the targets' mean square.
_NOISE_SHARE = 0.01
# The objective is the likelihood of one observation: these stop within 1e-6 of the maximum's
# likelihood for a thousand observations.
_OPTIONS = {"ftol": 1e-11, "gtol": 1e-6, "maxcor": 20}
# A logarithm this near to its limit counts as at it; L-BFGS-B projects onto the limits exactly.
_AT_BOUND = 1e-6

EVALUATIONS = "evaluations of the likelihood"
"""The stage of progress within a start, of whose evaluations nobody knows the number before."""


class Likelihood(Protocol):
    """What a search climbs: the likelihood of observations."""

    @property
    def n_observations(self) -> int:
        """Their number."""

    def value_and_gradient(
        self, kernel: Kernel, noise_variance: float
    ) -> tuple[float, observations.FloatArray]:
        """Evaluate, with derivatives by the kernel's `log_parameters` and the noise's logarithm."""


@dataclass(frozen=True, kw_only=True, eq=False)
class StartResult:
    """How one start of a fit ended.

    Attributes
    ----------
    start : (p + 1,) array
        Natural logarithms of the hyperparameters, then of the noise variance.
    end : (p + 1,) array
        The same, where the search stopped.
    log_marginal_likelihood : float
        At the end; −inf for a start that failed.
    converged : bool
        Whether the optimiser reports a maximum.
    evaluations : int
        Of likelihood and gradient.
    message : str
        The optimiser's message, or the reason of the failure.
    error : NotPositiveDefiniteError or None
        What stopped a start that failed.
    """

    start: observations.FloatArray
    end: observations.FloatArray
    log_marginal_likelihood: float
    converged: bool
    evaluations: int
    message: str
    error: NotPositiveDefiniteError | None

    @classmethod
    def failed(
        cls, start: observations.FloatArray, error: NotPositiveDefiniteError, *, evaluations: int
    ) -> "StartResult":
        """Describe a start at which the search could not begin."""
        return cls(
            start=start,
            end=start,
            log_marginal_likelihood=-np.inf,
            converged=False,
            evaluations=evaluations,
            message=str(error),
            error=error,
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class Search:
    """What all starts of a fit have in common.

    Attributes
    ----------
    kernel : Kernel
        Its form.
    limits : (p + 1, 2) array
        Of the logarithms.
    max_iterations : int
        Of the optimiser.
    """

    kernel: Kernel
    limits: observations.FloatArray
    max_iterations: int

    @classmethod
    def of(
        cls,
        kernel: Kernel,
        scale: DataScale,
        *,
        bounds: Bounds | None,
        max_iterations: int,
    ) -> "Search":
        """Search within bounds, the usual ones for None, measured by the observations' scale."""
        limits = (bounds or Bounds()).log_limits(kernel, scale)
        return cls(kernel=kernel, limits=limits, max_iterations=max_iterations)

    @property
    def names(self) -> list[str]:
        """Names of what is searched for."""
        return [*(each.name for each in self.kernel.free_parameters), NOISE_VARIANCE]

    def hyperparameters(self, logs: observations.FloatArray) -> tuple[Kernel, float]:
        """Kernel and noise variance whose logarithms these are, (p + 1,)."""
        return self.kernel.with_log_parameters(logs[:-1]), float(np.exp(logs[-1]))

    def clip(self, logs: observations.FloatArray) -> observations.FloatArray:
        """Nearest logarithms within the limits, (p + 1,)."""
        out: observations.FloatArray = np.clip(logs, self.limits[:, 0], self.limits[:, 1])
        return out

    def run(
        self,
        likelihood: Likelihood,
        start: observations.FloatArray,
        evaluated: Callable[[], None] = lambda: None,
    ) -> StartResult:
        """Search from logarithms within the limits, (p + 1,); a failure is part of the result.

        `evaluated` is called after each evaluation.
        """
        loss = _Loss(search=self, likelihood=likelihood, evaluated=evaluated)
        options = {**_OPTIONS, "maxiter": self.max_iterations}
        try:
            end = minimize(
                loss, start, jac=True, method="L-BFGS-B", bounds=self.limits, options=options
            )
        except NotPositiveDefiniteError as error:
            return StartResult.failed(start, error, evaluations=loss.evaluations)
        return StartResult(
            start=start,
            end=end.x,
            log_marginal_likelihood=-likelihood.n_observations * float(end.fun),
            converged=bool(end.success),
            evaluations=loss.evaluations,
            message=str(end.message),
            error=None,
        )

    def at_bound(self, result: StartResult) -> tuple[str, ...]:
        """Names of the hyperparameters that ended at a limit which leaves them room."""
        near = np.any(np.abs(self.limits - result.end[:, None]) < _AT_BOUND, axis=1)
        roomy = self.limits[:, 1] - self.limits[:, 0] > _AT_BOUND
        return tuple(name for name, at in zip(self.names, near & roomy, strict=True) if at)


@dataclass(kw_only=True, eq=False)
class _Loss:
    """What the optimiser lowers: minus the log likelihood, for each observation."""

    search: Search
    likelihood: Likelihood
    evaluated: Callable[[], None]
    evaluations: int = 0
    worst: float = -np.inf

    def __call__(self, logs: observations.FloatArray) -> tuple[float, observations.FloatArray]:
        """Evaluate with the gradient, (p + 1,)."""
        self.evaluations += 1
        try:
            value, slope = self.likelihood.value_and_gradient(*self.search.hyperparameters(logs))
        except NotPositiveDefiniteError:
            if self.worst == -np.inf:
                raise
            # higher than anything before, so that the line search turns back
            return self.worst + 1.0, np.zeros_like(logs)
        self.evaluated()
        loss = -value / self.likelihood.n_observations
        self.worst = max(self.worst, loss)
        return loss, -slope / self.likelihood.n_observations


@dataclass(frozen=True, kw_only=True, eq=False)
class FitResult:
    """A fitted Gaussian process and how it was found.

    Attributes
    ----------
    process : GaussianProcess
        With the best hyperparameters, conditioned on all observations; its `jitter` says what
        its covariance matrix needed to be factorised.
    log_marginal_likelihood : float
        Of the process.
    converged : bool
        Whether the best start converged.
    evaluations : int
        Of likelihood and gradient, over all starts.
    seconds : float
        Wall time.
    starts : tuple of StartResult
        In the order in which they ran, failures included.
    parameters_at_bound : tuple of str
        Names of hyperparameters that ended at a limit: more data or other bounds would move
        them.
    """

    process: GaussianProcess
    log_marginal_likelihood: float
    converged: bool
    evaluations: int
    seconds: float
    starts: tuple[StartResult, ...]
    parameters_at_bound: tuple[str, ...]


def fit(
    kernel: Kernel,
    x: ArrayLike,
    y: ArrayLike,
    *,
    rng: np.random.Generator,
    noise_variance: float | None = None,
    first_start: Literal["data", "given"] = "data",
    bounds: Bounds | None = None,
    restarts: int = 3,
    max_iterations: int = 300,
    threads: int = 1,
    progress: Progress = ignore_progress,
) -> FitResult:
    """Find the hyperparameters that make the observations most likely.

    Parameters
    ----------
    kernel : Kernel
        Its form; its values too, with ``first_start="given"``. Fixed hyperparameters keep them.
    x : (n, D) array
        Inputs, each column in its own unit.
    y : (n,) array
        Targets.
    rng : numpy.random.Generator
        Draws the starts after the first; the same seed gives the same result.
    noise_variance : float, optional
        Where the search for the noise variance begins, in squared units of the target; a
        hundredth of the targets' mean square if left out.
    first_start : {"data", "given"}
        Begin at values measured by the data, or at the kernel's own.
    bounds : Bounds, optional
        Limits of the hyperparameters.
    restarts : int
        Number of starts in all; the paper used three.
    max_iterations : int
        Of the optimiser, for each start.
    threads : int
        As for `MarginalLikelihood`: more help from a few thousand observations on, and only on
        cores that have nothing else to do.
    progress : Progress
        Called with the stage "fitting", starts done, and all starts; and with the stage
        `EVALUATIONS`, evaluations done over all starts, and 0 for a number that is not known.

    Returns
    -------
    FitResult

    Raises
    ------
    InputError
        If an argument cannot be right.
    ObservationError
        If the observations are malformed, fewer than dimensions, or all alike.
    NumericalError
        If every start failed; the message holds each one's reason.
    """
    began = time.perf_counter()
    _check_arguments(restarts, first_start, noise_variance)
    inputs, targets, active = observations.check_observations(kernel, x, y)
    observations.check_learnable(inputs, targets, dims=kernel.columns)
    scale = DataScale.of(inputs[active], targets[active])
    search = Search.of(kernel, scale, bounds=bounds, max_iterations=max_iterations)
    first = _first_start(kernel, scale, first_start, noise_variance)
    starts = _vary(first, search, restarts, rng)
    # the likelihood's N × N buffer is gone before the process takes one of its own
    results = _search_from(
        starts,
        search,
        MarginalLikelihood(inputs, targets, active=active, threads=threads),
        progress,
    )
    best = max(results, key=lambda result: result.log_marginal_likelihood)
    if best.error is not None:
        reasons = "; ".join(sorted({result.message for result in results}))
        msg = f"every one of {restarts} starts failed: {reasons}"
        raise NumericalError(msg) from best.error
    process = GaussianProcess.condition(*search.hyperparameters(best.end), inputs, targets)
    return FitResult(
        process=process,
        log_marginal_likelihood=process.log_marginal_likelihood,
        converged=best.converged,
        evaluations=sum(start.evaluations for start in results),
        seconds=time.perf_counter() - began,
        starts=tuple(results),
        parameters_at_bound=search.at_bound(best),
    )


def _search_from(
    starts: Sequence[observations.FloatArray],
    search: Search,
    likelihood: Likelihood,
    progress: Progress,
) -> list[StartResult]:
    results = []
    evaluated = counting(progress)
    for done, start in enumerate(starts, start=1):
        results.append(search.run(likelihood, start, evaluated))
        _logger.info("start %d of %d: %s", done, len(starts), results[-1].message)
        progress("fitting", done, len(starts))
    return results


def counting(progress: Progress) -> Callable[[], None]:
    """Return what reports one more evaluation each time it is called."""
    numbers = count(1)
    return lambda: progress(EVALUATIONS, next(numbers), 0)


def _check_arguments(restarts: int, first_start: str, noise_variance: float | None) -> None:
    if restarts < 1:
        msg = f"restarts must be at least 1, got {restarts}"
        raise InputError(msg)
    if first_start not in ("data", "given"):
        msg = f"first_start must be 'data' or 'given', got {first_start!r}"
        raise InputError(msg)
    if noise_variance is not None:
        observations.check_noise_variance(noise_variance)


def _first_start(
    kernel: Kernel, scale: DataScale, first_start: str, noise_variance: float | None
) -> observations.FloatArray:
    """Where the first start begins: logarithms of the hyperparameters, then of the noise."""
    values = starting_values(kernel, scale) if first_start == "data" else kernel.log_parameters
    return np.append(values, np.log(noise_variance or _NOISE_SHARE * scale.target))


def _vary(
    first: observations.FloatArray, search: Search, restarts: int, rng: np.random.Generator
) -> list[observations.FloatArray]:
    """Draw the other starts about the first one; all keep to the limits."""
    shifts = _START_SPREAD * rng.standard_normal((restarts - 1, len(first)))
    return [search.clip(start) for start in (first, *(first + shifts))]
