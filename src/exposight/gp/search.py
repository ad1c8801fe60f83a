"""One search for the hyperparameters, from one start: L-BFGS-B over their logarithms."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from scipy.optimize import minimize

from exposight.errors import NotPositiveDefiniteError
from exposight.gp.bounds import NOISE_VARIANCE, Bounds, DataScale
from exposight.gp.kernels import Kernel
from exposight.gp.observations import FloatArray
from exposight.gp.priors import LogNormal, check_priors, log_prior

# The objective is the likelihood of one observation: these stop within 1e-6 of the maximum's
# likelihood for a thousand observations.
_OPTIONS = {"ftol": 1e-11, "gtol": 1e-6, "maxcor": 20}

# A logarithm this near to its limit counts as at it; L-BFGS-B projects onto the limits exactly.
_AT_BOUND = 1e-6


class Likelihood(Protocol):
    """What a search climbs."""

    @property
    def observations(self) -> int:
        """Their number."""

    def value_and_gradient(self, kernel: Kernel, noise_variance: float) -> tuple[float, FloatArray]:
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
    log_prior : float
        Log density of the priors at the end; 0 where there is none.
    converged : bool
        Whether the optimiser reports a maximum.
    evaluations : int
        Of likelihood and gradient.
    message : str
        The optimiser's own word, or the reason of the failure.
    error : NotPositiveDefiniteError or None
        What stopped a start that failed.
    """

    start: FloatArray
    end: FloatArray
    log_marginal_likelihood: float
    log_prior: float
    converged: bool
    evaluations: int
    message: str
    error: NotPositiveDefiniteError | None

    @property
    def log_posterior(self) -> float:
        """What the search maximised, up to a constant."""
        return self.log_marginal_likelihood + self.log_prior

    @classmethod
    def failed(
        cls, start: FloatArray, error: NotPositiveDefiniteError, *, evaluations: int
    ) -> "StartResult":
        """Say how a start ended that could not begin."""
        return cls(
            start=start,
            end=start,
            log_marginal_likelihood=-np.inf,
            log_prior=0.0,
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
    priors : mapping of str to LogNormal
        By hyperparameter.
    max_iterations : int
        Of the optimiser.
    """

    kernel: Kernel
    limits: FloatArray
    priors: Mapping[str, LogNormal]
    max_iterations: int

    @classmethod
    def of(
        cls,
        kernel: Kernel,
        scale: DataScale,
        *,
        bounds: Bounds | None,
        priors: Mapping[str, LogNormal],
        max_iterations: int,
    ) -> "Search":
        """Search within bounds that are measured by the observations.

        Parameters
        ----------
        kernel : Kernel
            Its form.
        scale : DataScale
            Of the observations.
        bounds : Bounds or None
            None for the usual ones.
        priors, max_iterations
            As above.

        Returns
        -------
        Search

        Raises
        ------
        InputError
            If bounds or priors are given for what the fit may not change.
        """
        limits = (bounds or Bounds()).log_limits(kernel, scale)
        out = cls(kernel=kernel, limits=limits, priors=priors, max_iterations=max_iterations)
        check_priors(priors, out.names)
        return out

    @property
    def names(self) -> list[str]:
        """Names of what is searched for."""
        return [*(own.name for own in self.kernel.free_parameters), NOISE_VARIANCE]

    def hyperparameters(self, logs: FloatArray) -> tuple[Kernel, float]:
        """Kernel and noise variance whose logarithms these are, (p + 1,)."""
        return self.kernel.with_log_parameters(logs[:-1]), float(np.exp(logs[-1]))

    def clip(self, logs: FloatArray) -> FloatArray:
        """Nearest logarithms within the limits, (p + 1,)."""
        out: FloatArray = np.clip(logs, self.limits[:, 0], self.limits[:, 1])
        return out

    def run(self, likelihood: Likelihood, start: FloatArray) -> StartResult:
        """Search from one start; a failure is part of the result.

        Parameters
        ----------
        likelihood : Likelihood
            Of the observations.
        start : (p + 1,) array
            Natural logarithms within the limits.

        Returns
        -------
        StartResult
        """
        loss = _Loss(search=self, likelihood=likelihood, names=self.names)
        options = {**_OPTIONS, "maxiter": self.max_iterations}
        try:
            found = minimize(
                loss, start, jac=True, method="L-BFGS-B", bounds=self.limits, options=options
            )
        except NotPositiveDefiniteError as error:
            return StartResult.failed(start, error, evaluations=loss.evaluations)
        prior, _ = log_prior(self.priors, self.names, found.x)
        return StartResult(
            start=start,
            end=found.x,
            log_marginal_likelihood=-likelihood.observations * float(found.fun) - prior,
            log_prior=prior,
            converged=bool(found.success),
            evaluations=loss.evaluations,
            message=str(found.message),
            error=None,
        )

    def at_bound(self, result: StartResult) -> tuple[str, ...]:
        """Names of the hyperparameters that ended at a limit which leaves them room."""
        near = np.any(np.abs(self.limits - result.end[:, None]) < _AT_BOUND, axis=1)
        roomy = self.limits[:, 1] - self.limits[:, 0] > _AT_BOUND
        return tuple(name for name, at in zip(self.names, near & roomy, strict=True) if at)


@dataclass(kw_only=True, eq=False)
class _Loss:
    """What the optimiser lowers: minus the log posterior, for each observation."""

    search: Search
    likelihood: Likelihood
    names: list[str]
    evaluations: int = 0
    worst: float = -np.inf

    def __call__(self, logs: FloatArray) -> tuple[float, FloatArray]:
        """Evaluate with the gradient, (p + 1,)."""
        self.evaluations += 1
        try:
            value, slope = self.likelihood.value_and_gradient(*self.search.hyperparameters(logs))
        except NotPositiveDefiniteError:
            if self.worst == -np.inf:
                raise
            # higher than anything seen, so that the line search turns back
            return self.worst + 1.0, np.zeros_like(logs)
        prior, prior_slope = log_prior(self.search.priors, self.names, logs)
        loss = -(value + prior) / self.likelihood.observations
        self.worst = max(self.worst, loss)
        return loss, -(slope + prior_slope) / self.likelihood.observations
