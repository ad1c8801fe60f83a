"""Hyperparameters by maximum marginal likelihood, or posterior: several starts, the best wins."""

import logging
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from exposight.errors import InputError, NumericalError
from exposight.gp.arguments import check_noise_variance, check_observations
from exposight.gp.bounds import Bounds, DataScale, starting_values
from exposight.gp.kernels import Kernel
from exposight.gp.likelihood import MarginalLikelihood
from exposight.gp.observations import BoolArray, FloatArray, check_learnable
from exposight.gp.priors import NO_PRIORS, LogNormal
from exposight.gp.regression import GaussianProcess
from exposight.gp.search import Search, StartResult
from exposight.workers import Progress, ignore_progress

_logger = logging.getLogger(__name__)

# Later starts vary the first by a factor of e and more: far enough to leave its basin.
_START_SPREAD = 1.0
# A first guess of the noise, as a share of the targets' mean square.
_NOISE_SHARE = 0.01
# Observations below which a third of them says too little.
_FEWEST_FOR_WARM_START = 60


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
        Of likelihood and gradient, over all starts, those of a warm start included.
    seconds : float
        Wall time.
    starts : tuple of StartResult
        In the order in which they ran, failures included. After a warm start there is one.
    warm_starts : tuple of StartResult
        Those on a part of the observations; empty where none was asked for.
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
    warm_starts: tuple[StartResult, ...]
    parameters_at_bound: tuple[str, ...]

    @property
    def warnings(self) -> tuple[str, ...]:
        """What to know before trusting the result, a sentence each; most often nothing."""
        out = [
            f"{name} ended at its bound: more data or other bounds would move it"
            for name in self.parameters_at_bound
        ]
        if not self.converged:
            out.append("the search stopped before a maximum: allow it more iterations")
        if self.process.jitter > 0.0:
            out.append(
                f"the covariance matrix needed {self.process.jitter:.1e} on its diagonal: "
                "raise the noise variance's lower bound, or remove repeated observations"
            )
        failed = sum(start.error is not None for start in (*self.starts, *self.warm_starts))
        if failed:
            out.append(f"{failed} starts failed; `starts` holds their errors")
        return tuple(out)


def fit(
    kernel: Kernel,
    x: ArrayLike,
    y: ArrayLike,
    *,
    rng: np.random.Generator,
    noise_variance: float | None = None,
    first_start: Literal["data", "given"] = "data",
    bounds: Bounds | None = None,
    priors: Mapping[str, LogNormal] = NO_PRIORS,
    restarts: int = 3,
    warm_start: bool = False,
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
        Draws the starts after the first, and a warm start's rows; the same seed gives the same
        result.
    noise_variance : float, optional
        Where the search for the noise variance begins, in squared units of the target; a
        hundredth of the targets' mean square if left out.
    first_start : {"data", "given"}
        Begin at values measured by the data, or at the kernel's own.
    bounds : Bounds, optional
        Limits of the hyperparameters.
    priors : mapping of str to LogNormal, optional
        By the name in `Kernel.parameters`, or ``"noise_variance"``. With priors the result is
        the most probable point of the hyperparameters' logarithms.
    restarts : int
        Number of starts in all; the paper used three.
    warm_start : bool
        Run the starts on a third of the observations, and from the best end one search on all:
        about half the time, and as a rule the same maximum.
    max_iterations : int
        Of the optimiser, for each start.
    threads : int
        As for `MarginalLikelihood`: more help from a few thousand observations on, and only on
        cores that have nothing else to do.
    progress : Progress
        Called with the stage "fitting", starts done, and all starts.

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
    inputs, targets, active = check_observations(kernel, x, y)
    check_learnable(inputs, targets, dims=kernel.columns)
    scale = DataScale.of(inputs[active], targets[active])
    search = Search.of(kernel, scale, bounds=bounds, priors=priors, max_iterations=max_iterations)
    first = _first_start(kernel, scale, first_start, noise_variance)
    starts = _vary(first, search, restarts, rng)
    report = _Reporter(total=restarts + warm_start, progress=progress)

    warm: list[StartResult] = []
    if warm_start:
        part = _third(active, rng)
        warm = report.run(
            search, starts, MarginalLikelihood(inputs[part], targets[part], active=active[part])
        )
        starts = [_best(warm).end]
    # the likelihood's N × N buffer is gone before the process takes one of its own
    results = report.run(
        search, starts, MarginalLikelihood(inputs, targets, active=active, threads=threads)
    )
    best = _best_that_ended(results, restarts)
    process = GaussianProcess.condition(*search.hyperparameters(best.end), inputs, targets)
    return FitResult(
        process=process,
        log_marginal_likelihood=process.log_marginal_likelihood,
        converged=best.converged,
        evaluations=sum(start.evaluations for start in (*warm, *results)),
        seconds=time.perf_counter() - began,
        starts=tuple(results),
        warm_starts=tuple(warm),
        parameters_at_bound=search.at_bound(best),
    )


@dataclass(kw_only=True)
class _Reporter:
    """Tells how far a fit is."""

    total: int
    progress: Progress
    done: int = 0

    def run(
        self, search: Search, starts: Sequence[FloatArray], likelihood: MarginalLikelihood
    ) -> list[StartResult]:
        """Search from all starts."""
        return [self._told(search.run(likelihood, start)) for start in starts]

    def _told(self, result: StartResult) -> StartResult:
        """Pass a start's result through."""
        self.done += 1
        _logger.info("start %d of %d: %s", self.done, self.total, result.message)
        self.progress("fitting", self.done, self.total)
        return result


def _check_arguments(restarts: int, first_start: str, noise_variance: float | None) -> None:
    if restarts < 1:
        msg = f"restarts must be at least 1, got {restarts}"
        raise InputError(msg)
    if first_start not in ("data", "given"):
        msg = f"first_start must be 'data' or 'given', got {first_start!r}"
        raise InputError(msg)
    if noise_variance is not None:
        check_noise_variance(noise_variance)


def _first_start(
    kernel: Kernel, scale: DataScale, first_start: str, noise_variance: float | None
) -> FloatArray:
    """Where the first start begins: logarithms of the hyperparameters, then of the noise."""
    values = starting_values(kernel, scale) if first_start == "data" else kernel.log_parameters
    return np.append(values, np.log(noise_variance or _NOISE_SHARE * scale.target))


def _vary(
    first: FloatArray, search: Search, restarts: int, rng: np.random.Generator
) -> list[FloatArray]:
    """Draw the other starts about the first one; all keep to the limits."""
    shifts = _START_SPREAD * rng.standard_normal((restarts - 1, len(first)))
    return [search.clip(start) for start in (first, *(first + shifts))]


def _third(active: BoolArray, rng: np.random.Generator) -> BoolArray:
    """Draw a third of the rows that the kernel's gate lets in."""
    rows = np.flatnonzero(active)
    if len(rows) < _FEWEST_FOR_WARM_START:
        msg = (
            f"warm_start takes a third of the observations, which is too little of {len(rows)}: "
            "leave it out, a fit on so few takes no time"
        )
        raise InputError(msg)
    out = np.zeros(len(active), dtype=np.bool_)
    out[rng.choice(rows, size=len(rows) // 3, replace=False)] = True
    return out


def _best(results: list[StartResult]) -> StartResult:
    return max(results, key=lambda result: result.log_posterior)


def _best_that_ended(results: list[StartResult], restarts: int) -> StartResult:
    """Take the best, unless all starts failed."""
    best = _best(results)
    if best.error is not None:
        reasons = "; ".join(sorted({result.message for result in results}))
        msg = f"every one of {restarts} starts failed: {reasons}"
        raise NumericalError(msg) from best.error
    return best
