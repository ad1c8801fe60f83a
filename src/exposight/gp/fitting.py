"""Hyperparameters by maximum marginal likelihood: L-BFGS-B from several starts."""

import logging
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import minimize
from threadpoolctl import threadpool_limits

from exposight.errors import InputError, NotPositiveDefiniteError, NumericalError
from exposight.gp.bounds import NOISE_VARIANCE, Bounds, DataScale, starting_values
from exposight.gp.kernels import Kernel
from exposight.gp.likelihood import likelihood_and_gradient
from exposight.gp.observations import BoolArray, FloatArray, check_learnable
from exposight.gp.regression import (
    GaussianProcess,
    check_noise_variance,
    check_observations,
)

__all__ = ["FitResult", "StartResult", "fit"]

_logger = logging.getLogger(__name__)

# Later starts vary the first by a factor of e and more: far enough to leave its basin.
_START_SPREAD = 1.0
# A first guess of the noise, as a share of the targets' mean square.
_NOISE_SHARE = 0.01
# A logarithm this near to its limit counts as at it; L-BFGS-B projects onto the limits exactly.
_AT_BOUND = 1e-6
# The objective is the likelihood of one observation: these stop within 1e-6 of the maximum's
# likelihood for a thousand observations.
_OPTIONS = {"ftol": 1e-11, "gtol": 1e-6, "maxcor": 20}


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
        The optimiser's own word, or the reason of the failure.
    """

    start: FloatArray
    end: FloatArray
    log_marginal_likelihood: float
    converged: bool
    evaluations: int
    message: str


@dataclass(frozen=True, kw_only=True, eq=False)
class FitResult:
    """A fitted Gaussian process and how it was found.

    Attributes
    ----------
    process : GaussianProcess
        With the best hyperparameters, conditioned on all observations.
    log_marginal_likelihood : float
        Of the process.
    converged : bool
        Whether the best start converged.
    evaluations : int
        Of likelihood and gradient, over all starts.
    seconds : float
        Wall time.
    starts : tuple of StartResult
        In the order in which they ran.
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
    progress: Callable[[int, int], None] | None = None,
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
    progress : callable, optional
        Called with (starts done, all starts).

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
    if restarts < 1:
        msg = f"restarts must be at least 1, got {restarts}"
        raise InputError(msg)
    if first_start not in ("data", "given"):
        msg = f"first_start must be 'data' or 'given', got {first_start!r}"
        raise InputError(msg)
    inputs, targets, active = check_observations(kernel, x, y)
    check_learnable(inputs, targets, dims=kernel.columns)
    scale = DataScale.of(inputs[active], targets[active])
    if noise_variance is None:
        noise_variance = _NOISE_SHARE * scale.target
    check_noise_variance(noise_variance)
    limits = (bounds or Bounds()).log_limits(kernel, scale)
    values = starting_values(kernel, scale) if first_start == "data" else kernel.log_parameters
    first = np.append(values, np.log(noise_variance))

    shifts = _START_SPREAD * rng.standard_normal((restarts - 1, len(first)))
    results = []
    for number, start in enumerate([first, *(first + shifts)], start=1):
        clipped = np.clip(start, limits[:, 0], limits[:, 1])
        results.append(_run(kernel, inputs, targets, active, clipped, limits, max_iterations))
        _logger.info("start %d of %d: %s", number, restarts, results[-1].message)
        if progress is not None:
            progress(number, restarts)

    best = max(results, key=lambda result: result.log_marginal_likelihood)
    if best.log_marginal_likelihood == -np.inf:
        reasons = "; ".join(sorted({result.message for result in results}))
        msg = f"every one of {restarts} starts failed: {reasons}"
        raise NumericalError(msg)
    process = GaussianProcess.condition(
        kernel.with_log_parameters(best.end[:-1]), float(np.exp(best.end[-1])), inputs, targets
    )
    return FitResult(
        process=process,
        log_marginal_likelihood=process.log_marginal_likelihood,
        converged=best.converged,
        evaluations=sum(result.evaluations for result in results),
        seconds=time.perf_counter() - began,
        starts=tuple(results),
        parameters_at_bound=_at_bound(kernel, best.end, limits),
    )


def _run(
    kernel: Kernel,
    x: FloatArray,
    y: FloatArray,
    active: BoolArray,
    start: FloatArray,
    limits: FloatArray,
    max_iterations: int,
) -> StartResult:
    """Run the optimiser from one start."""
    evaluations = 0
    worst = -np.inf

    def objective(logs: FloatArray) -> tuple[float, FloatArray]:
        nonlocal evaluations, worst
        evaluations += 1
        try:
            likelihood, gradient = likelihood_and_gradient(
                kernel.with_log_parameters(logs[:-1]), float(np.exp(logs[-1])), x, y, active=active
            )
        except NotPositiveDefiniteError:
            if worst == -np.inf:
                raise
            # higher than anything seen, so that the line search turns back
            return worst + 1.0, np.zeros_like(logs)
        value = -likelihood / len(y)
        worst = max(worst, value)
        return value, -gradient / len(y)

    try:
        # At a few thousand rows a second BLAS thread gains little, and costs up to tenfold where
        # other work wants the same cores: OpenBLAS spins while it waits.
        with threadpool_limits(limits=1, user_api="blas"):
            found = minimize(
                objective,
                start,
                jac=True,
                method="L-BFGS-B",
                bounds=limits,
                options={**_OPTIONS, "maxiter": max_iterations},
            )
    except NotPositiveDefiniteError as error:
        return StartResult(
            start=start,
            end=start,
            log_marginal_likelihood=-np.inf,
            converged=False,
            evaluations=evaluations,
            message=str(error),
        )
    return StartResult(
        start=start,
        end=found.x,
        log_marginal_likelihood=-len(y) * float(found.fun),
        converged=bool(found.success),
        evaluations=evaluations,
        message=str(found.message),
    )


def _at_bound(kernel: Kernel, logs: FloatArray, limits: FloatArray) -> tuple[str, ...]:
    """Names of the hyperparameters at a limit that leaves them room."""
    names = [*(parameter.name for parameter in kernel.free_parameters), NOISE_VARIANCE]
    near = np.any(np.abs(limits - logs[:, None]) < _AT_BOUND, axis=1)
    roomy = limits[:, 1] - limits[:, 0] > _AT_BOUND
    return tuple(name for name, at in zip(names, near & roomy, strict=True) if at)
