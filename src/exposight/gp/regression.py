"""Exact Gaussian-process regression: zero mean, Gaussian noise, float64."""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg import solve_triangular

from exposight.errors import InputError, ObservationError
from exposight.gp.kernels import Kernel
from exposight.gp.likelihood import (
    factorise,
    likelihood_and_gradient,
    log_likelihood,
    solve,
    white_noise_log_likelihood,
)
from exposight.gp.observations import BoolArray, FloatArray, check_inputs, check_targets

__all__ = ["GaussianProcess", "Prediction", "check_noise_variance", "check_observations"]

# Rows predicted at once: large enough for matrix products at full speed, 30 MB at N = 2000.
_CHUNK = 2000


@dataclass(frozen=True, kw_only=True, eq=False)
class Prediction:
    """What a Gaussian process predicts.

    Attributes
    ----------
    mean : (m,) array
        In the unit of the targets.
    std : (m,) array
        Standard deviation, in the unit of the targets.
    """

    mean: FloatArray
    std: FloatArray


@dataclass(frozen=True, kw_only=True, eq=False)
class _Posterior:
    """What conditioning leaves behind, for the n' observations that the kernel's gate lets in."""

    x: FloatArray
    """(n', D) inputs."""
    factor: FloatArray
    """(n', n') Cholesky factor in the lower triangle; above it is nothing of use."""
    weights: FloatArray
    """(n',) K⁻¹ y."""


@dataclass(frozen=True, kw_only=True, eq=False)
class GaussianProcess:
    """A zero-mean Gaussian process conditioned on observations; build it with `condition`.

    Attributes
    ----------
    kernel : Kernel
        Prior covariance.
    noise_variance : float
        Variance of the observations' Gaussian noise, in squared units of the target.
    x : (n, D) array
        Training inputs, read-only.
    y : (n,) array
        Training targets, read-only.
    log_marginal_likelihood : float
        log p(y | x, hyperparameters).
    jitter : float
        What had to be added to the covariance's diagonal to factorise it, in squared units of
        the target; 0 almost always.
    """

    kernel: Kernel
    noise_variance: float
    x: FloatArray = field(repr=False)
    y: FloatArray = field(repr=False)
    log_marginal_likelihood: float
    jitter: float
    _posterior: _Posterior = field(repr=False)

    @classmethod
    def condition(
        cls, kernel: Kernel, noise_variance: float, x: ArrayLike, y: ArrayLike
    ) -> "GaussianProcess":
        """Condition a zero-mean prior on observations.

        Observations that the kernel multiplies by zero are left out of the factorisation; their
        likelihood is that of white noise, exactly.

        Parameters
        ----------
        kernel : Kernel
            Prior covariance.
        noise_variance : float
            Positive, in squared units of the target.
        x : (n, D) array
            Inputs, each column in its own unit.
        y : (n,) array
            Targets.

        Returns
        -------
        GaussianProcess

        Raises
        ------
        InputError
            If the noise variance is not positive.
        ObservationError
            If the arrays do not fit together, are not finite, are empty, or lie wholly outside
            the kernel's range.
        NotPositiveDefiniteError
            If the covariance matrix has no Cholesky factor, even with the largest jitter.
        """
        check_noise_variance(noise_variance)
        inputs, targets, active = check_observations(kernel, x, y)
        near = np.ascontiguousarray(inputs[active])
        factor, jitter = factorise(kernel.value(near, near), noise_variance)
        weights = solve(factor, targets[active])
        likelihood = log_likelihood(factor, weights, targets[active]) + white_noise_log_likelihood(
            targets[~active], noise_variance
        )
        return cls(
            kernel=kernel,
            noise_variance=float(noise_variance),
            x=_read_only(inputs),
            y=_read_only(targets),
            log_marginal_likelihood=likelihood,
            jitter=jitter,
            _posterior=_Posterior(x=near, factor=factor, weights=weights),
        )

    def log_marginal_likelihood_gradient(self) -> FloatArray:
        """Gradient of the log marginal likelihood.

        Returns
        -------
        (p + 1,) array
            With respect to the kernel's `log_parameters`, then the log of the noise variance.
        """
        return likelihood_and_gradient(
            self.kernel, self.noise_variance, self.x, self.y, active=~self.kernel.gate(self.x)
        )[1]

    def predict(
        self,
        x: ArrayLike,
        *,
        include_noise: bool = False,
        progress: Callable[[int, int], None] | None = None,
    ) -> Prediction:
        """Predict mean and standard deviation.

        Parameters
        ----------
        x : (m, D) array
            Inputs, columns as in training.
        include_noise : bool
            Whether the standard deviation is that of a new observation, or that of the function
            underneath.
        progress : callable, optional
            Called with (rows done, all rows).

        Returns
        -------
        Prediction

        Raises
        ------
        ObservationError
            If the inputs are not a finite matrix with the columns of training.
        """
        inputs = check_inputs(x, columns=self.x.shape[1])
        mean, variance = np.empty(len(inputs)), np.empty(len(inputs))
        for rows in _chunks(len(inputs)):
            cross = self.kernel.value(inputs[rows], self._posterior.x)
            mean[rows] = cross @ self._posterior.weights
            explained = solve_triangular(
                self._posterior.factor, cross.T, lower=True, overwrite_b=True, check_finite=False
            )
            variance[rows] = self.kernel.diagonal(inputs[rows])
            variance[rows] -= np.einsum("ij,ij->j", explained, explained)
            if progress is not None:
                progress(min(rows.stop, len(inputs)), len(inputs))
        # rounding may leave a variance a hair below zero at a training point
        np.maximum(variance, 0.0, out=variance)
        if include_noise:
            variance += self.noise_variance
        return Prediction(mean=mean, std=np.sqrt(variance))

    def predict_mean(self, x: ArrayLike) -> FloatArray:
        """Predict the mean alone, which takes no triangular solve.

        Parameters
        ----------
        x : (m, D) array
            Inputs, columns as in training.

        Returns
        -------
        (m,) array
            In the unit of the targets.

        Raises
        ------
        ObservationError
            If the inputs are not a finite matrix with the columns of training.
        """
        inputs = check_inputs(x, columns=self.x.shape[1])
        mean = np.empty(len(inputs))
        for rows in _chunks(len(inputs)):
            mean[rows] = self.kernel.value(inputs[rows], self._posterior.x) @ (
                self._posterior.weights
            )
        return mean

    def covariance(self, x: ArrayLike) -> FloatArray:
        """Posterior covariance of the function at several inputs, without noise.

        Parameters
        ----------
        x : (m, D) array
            Inputs, columns as in training.

        Returns
        -------
        (m, m) array
            In squared units of the target. `predict` costs far less where its diagonal is
            enough.

        Raises
        ------
        ObservationError
            If the inputs are not a finite matrix with the columns of training.
        """
        inputs = check_inputs(x, columns=self.x.shape[1])
        cross = self.kernel.value(inputs, self._posterior.x)
        explained = solve_triangular(
            self._posterior.factor, cross.T, lower=True, check_finite=False
        )
        out: FloatArray = self.kernel.value(inputs, inputs) - explained.T @ explained
        return out


def check_noise_variance(noise_variance: float) -> None:
    """Check that a noise variance is positive and finite.

    Parameters
    ----------
    noise_variance : float
        In squared units of the target.

    Raises
    ------
    InputError
        If it is not.
    """
    if not (noise_variance > 0.0 and math.isfinite(noise_variance)):
        msg = (
            f"noise_variance must be positive and finite, got {noise_variance!r}; for targets "
            "without noise take a small share of their variance, such as 1e-6"
        )
        raise InputError(msg)


def check_observations(
    kernel: Kernel, x: ArrayLike, y: ArrayLike
) -> tuple[FloatArray, FloatArray, BoolArray]:
    """Check inputs against targets and find those that the kernel's gate lets in.

    Parameters
    ----------
    kernel : Kernel
        Prior covariance.
    x : (n, D) array
        Inputs.
    y : (n,) array
        Targets.

    Returns
    -------
    x : (n, D) array
        Checked inputs.
    y : (n,) array
        Checked targets.
    active : (n,) bool array
        False where the kernel multiplies by zero.

    Raises
    ------
    ObservationError
        If the arrays do not fit together, are not finite, are empty, or lie wholly outside the
        kernel's range.
    """
    inputs = check_inputs(x, dims=kernel.columns)
    targets = check_targets(y, observations=len(inputs))
    if len(inputs) == 0:
        msg = "at least one observation is needed, got none"
        raise ObservationError(msg)
    active = ~kernel.gate(inputs)
    if not active.any():
        msg = (
            f"all {len(inputs)} observations lie outside the range in which the kernel is not "
            "zero, so there is nothing to learn from; check the columns' order and units"
        )
        raise ObservationError(msg)
    return inputs, targets, active


def _chunks(rows: int) -> Iterator[slice]:
    for start in range(0, rows, _CHUNK):
        yield slice(start, start + _CHUNK)


def _read_only(array: FloatArray) -> FloatArray:
    out = array.copy()
    out.setflags(write=False)
    return out
