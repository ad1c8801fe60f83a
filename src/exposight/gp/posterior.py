"""A Gaussian process's posterior: what conditioning leaves behind, and what follows from it."""

from dataclasses import dataclass

import numpy as np

from exposight.gp.factor import Factor
from exposight.gp.kernels import Kernel, tiles
from exposight.gp.likelihood import log_likelihood
from exposight.gp.observations import FloatArray
from exposight.gp.threads import limit_blas


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
class Posterior:
    """A zero-mean prior, conditioned on n observations inside the kernel's gate.

    With K the covariance of the targets, noise included, L L' = K and α = K⁻¹ y (Rasmussen and
    Williams 2006, Algorithm 2.1). All arguments of its methods are checked inputs.

    Attributes
    ----------
    kernel : Kernel
        Prior covariance.
    x : (n, D) array
        Inputs, in C order.
    y : (n,) array
        Targets.
    factor : Factor
        L.
    alpha : (n,) array
        K⁻¹ y.
    """

    kernel: Kernel
    x: FloatArray
    y: FloatArray
    factor: Factor
    alpha: FloatArray

    @classmethod
    def of(cls, factor: Factor, kernel: Kernel, x: FloatArray, y: FloatArray) -> "Posterior":
        """Condition on observations whose covariance has been factorised."""
        with limit_blas(1):
            alpha = factor.solve(y)
        return cls(kernel=kernel, x=np.ascontiguousarray(x), y=y, factor=factor, alpha=alpha)

    @property
    def log_marginal_likelihood(self) -> float:
        """Of the targets."""
        return log_likelihood(self.factor, self.alpha, self.y)

    def mean(self, x: FloatArray) -> FloatArray:
        """Mean at (m, D) inputs, k(x, X) α of Eq. 2.25, without keeping the matrix: (m,)."""
        return tiles.product(self.kernel, x, self.x, self.alpha)

    def mean_and_variance(self, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Mean and variance of the function at (m, D) inputs, Eq. 2.25 and 2.26, each (m,)."""
        cross = np.empty((len(x), len(self.x)))
        tiles.fill(self.kernel, x, self.x, cross)
        mean = cross @ self.alpha
        explained = self.factor.half_solve(cross.T).T
        variance = self.kernel.prior_variance(x) - np.einsum("ij,ij->i", explained, explained)
        # rounding may leave a variance a hair below zero at a training point
        return mean, np.maximum(variance, 0.0)

    def covariance(self, x: FloatArray) -> FloatArray:
        """Covariance of the function at (m, D) inputs, Eq. 2.24: (m, m)."""
        cross = self.kernel.value(x, self.x)
        with limit_blas(1):
            explained = self.factor.half_solve(cross.T)
            out: FloatArray = self.kernel.value(x, x) - explained.T @ explained
        return out

    def leave_one_out(self) -> tuple[FloatArray, FloatArray]:
        """Mean and variance of each target given all the others, Eq. 5.12, each (n,).

        The mean is y_i − α_i / K⁻¹_ii, the variance, noise included, 1 / K⁻¹_ii.
        """
        with limit_blas(1):
            variance = 1.0 / self.factor.inverse_diagonal()
        return self.y - self.alpha * variance, variance
