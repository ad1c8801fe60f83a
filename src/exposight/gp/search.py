"""One search for the hyperparameters, from one start: L-BFGS-B over their logarithms."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from scipy.optimize import minimize

from exposight.errors import NotPositiveDefiniteError
from exposight.gp.bounds import NOISE_VARIANCE
from exposight.gp.kernels import Kernel
from exposight.gp.observations import FloatArray
from exposight.gp.priors import LogNormal, log_prior

__all__ = ["Likelihood", "Search", "StartResult"]

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

    @property
    def names(self) -> list[str]:
        """Names of what is searched for."""
        return [*(own.name for own in self.kernel.free_parameters), NOISE_VARIANCE]

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
        names, evaluations, worst = self.names, 0, -np.inf

        def objective(logs: FloatArray) -> tuple[float, FloatArray]:
            nonlocal evaluations, worst
            evaluations += 1
            try:
                value, slope = likelihood.value_and_gradient(
                    self.kernel.with_log_parameters(logs[:-1]), float(np.exp(logs[-1]))
                )
            except NotPositiveDefiniteError:
                if worst == -np.inf:
                    raise
                # higher than anything seen, so that the line search turns back
                return worst + 1.0, np.zeros_like(logs)
            prior, prior_slope = log_prior(self.priors, names, logs)
            loss = -(value + prior) / likelihood.observations
            worst = max(worst, loss)
            return loss, -(slope + prior_slope) / likelihood.observations

        options = {**_OPTIONS, "maxiter": self.max_iterations}
        try:
            found = minimize(
                objective, start, jac=True, method="L-BFGS-B", bounds=self.limits, options=options
            )
        except NotPositiveDefiniteError as error:
            return StartResult(
                start=start,
                end=start,
                log_marginal_likelihood=-np.inf,
                log_prior=0.0,
                converged=False,
                evaluations=evaluations,
                message=str(error),
                error=error,
            )
        prior, _ = log_prior(self.priors, names, found.x)
        return StartResult(
            start=start,
            end=found.x,
            log_marginal_likelihood=-likelihood.observations * float(found.fun) - prior,
            log_prior=prior,
            converged=bool(found.success),
            evaluations=evaluations,
            message=str(found.message),
            error=None,
        )

    def at_bound(self, result: StartResult) -> tuple[str, ...]:
        """Names of the hyperparameters that ended at a limit which leaves them room."""
        near = np.any(np.abs(self.limits - result.end[:, None]) < _AT_BOUND, axis=1)
        roomy = self.limits[:, 1] - self.limits[:, 0] > _AT_BOUND
        return tuple(name for name, at in zip(self.names, near & roomy, strict=True) if at)
