"""The log marginal likelihood and its gradient, in one N × N buffer."""

import math

import numpy as np

from exposight.gp import tiling
from exposight.gp.factor import Factor, Noise, factorise
from exposight.gp.kernels import Kernel
from exposight.gp.kernels.loops import weigh_pairs
from exposight.gp.memory import check_memory, square_bytes
from exposight.gp.observations import BoolArray, FloatArray

_LOG_2PI = math.log(2.0 * math.pi)


class MarginalLikelihood:
    """Log marginal likelihood of observations, for one form of kernel.

    Holds the one N × N buffer in which every evaluation takes place: the covariance, its Cholesky
    factor, its inverse, each in the place of the one before.

    Parameters
    ----------
    x : (n, D) array
        Checked inputs.
    y : (n,) array
        Checked targets.
    active : (n,) bool array
        Rows that the kernel's gate lets in. The others leave the factorisation; their likelihood
        is that of white noise, exactly.
    row_noise : (n,) array, optional
        Checked variance of further noise of each row, in squared units of the target; fitting
        leaves it alone.
    threads : int
        For building, factorising and differentiating. More than one help from a few thousand
        observations on, on cores that have nothing else to do: linear algebra spins while it
        waits, and beside other work two threads took three times as long as one.

    Raises
    ------
    InputError
        If fewer than one thread is asked for.
    OutOfMemoryError
        If the buffer does not fit into memory.
    """

    def __init__(
        self,
        x: FloatArray,
        y: FloatArray,
        *,
        active: BoolArray,
        row_noise: FloatArray | None = None,
        threads: int = 1,
    ) -> None:
        self._x = np.ascontiguousarray(x[active])
        self._y, self._active, self._row_noise = y, active, row_noise
        self._threads = tiling.choose_threads(threads, worthwhile=False)
        check_memory(
            square_bytes(len(self._x)),
            f"fitting an exact process of {len(self._x)} observations",
            "take a committee (fit_committee; trained models do above 3000 rows) or fewer rows",
        )
        self._buffer = np.empty((len(self._x), len(self._x)))

    @property
    def n_observations(self) -> int:
        """Their number, those outside the gate included."""
        return len(self._y)

    def value_and_gradient(self, kernel: Kernel, noise_variance: float) -> tuple[float, FloatArray]:
        """Evaluate for the targets given at construction; arguments and errors of `evaluate`.

        Returns
        -------
        likelihood : float
        gradient : (p + 1,) array
            With respect to the kernel's `log_parameters`, then the log of the noise variance.
        """
        likelihood, gradient, _ = self.evaluate(kernel, noise_variance)
        return likelihood, gradient

    def evaluate(
        self, kernel: Kernel, noise_variance: float, y: FloatArray | None = None
    ) -> tuple[float, FloatArray, FloatArray]:
        """Evaluate by one Cholesky factorisation and one inverse.

        The derivatives are sums over the elements of (αα' − K⁻¹)/2 with α = K⁻¹ y. Where the prior
        has a mean m, a function of parameters β, pass y − m(β): the likelihood's derivatives with
        respect to β are J'α, with J = dm/dβ.

        Parameters
        ----------
        kernel : Kernel
            Prior covariance.
        noise_variance : float
            Positive, in squared units of the target.
        y : (n,) array, optional
            Checked targets in place of those given at construction.

        Returns
        -------
        likelihood : float
        gradient : (p + 1,) array
            With respect to the kernel's `log_parameters`, then the log of the noise variance.
        alpha : (n,) array
            K⁻¹ y of all rows, minus the likelihood's derivative with respect to each target.

        Raises
        ------
        NotPositiveDefiniteError
            If the covariance matrix has no Cholesky factor, even with the largest jitter.
        """
        targets = self._y if y is None else y
        near, rest = targets[self._active], targets[~self._active]
        noise = noise_of(noise_variance, self._row_noise, self._active)
        rest_noise = noise_of(noise_variance, self._row_noise, ~self._active)
        with tiling.limit_blas(self._threads):
            factor = factorise(kernel, noise, self._x, buffer=self._buffer, threads=self._threads)
            alpha = factor.solve(near)
            likelihood = log_likelihood(factor, alpha, near)
            # LAPACK's lower triangle is C order's upper one
            inverse = factor.consume().T
        with tiling.limit_blas(1):
            gradient = self._gradient(kernel, inverse, alpha)
        rest_alpha, everywhere = rest / rest_noise, np.empty(len(targets))
        everywhere[self._active], everywhere[~self._active] = alpha, rest_alpha
        precision = np.trace(inverse) + np.sum(np.ones(len(rest)) / rest_noise)
        by_noise = 0.5 * noise_variance * float(everywhere @ everywhere - precision)
        likelihood += white_noise_log_likelihood(rest, rest_noise)
        return likelihood, np.append(gradient, by_noise), everywhere

    def _gradient(self, kernel: Kernel, inverse: FloatArray, alpha: FloatArray) -> FloatArray:
        """Sum the derivatives, weighed by (αα' − K⁻¹)/2, over the kernel's matrix."""

        def weights(rows: slice, columns: slice) -> FloatArray:
            out = np.empty((rows.stop - rows.start, columns.stop - columns.start))
            weigh_pairs(inverse, alpha, rows.start, columns.start, out)
            return out

        def derivatives(rows: slice) -> FloatArray:
            return tiling.weighted_derivatives(kernel, self._x, rows, weights)

        blocks = tiling.in_threads(
            derivatives, tiling.row_blocks(len(self._x)), threads=self._threads
        )
        gradient: FloatArray = np.sum(list(blocks), axis=0)
        return gradient


def log_likelihood(factor: Factor, alpha: FloatArray, y: FloatArray) -> float:
    """Log marginal likelihood of targets, from their covariance's factor and alpha = K⁻¹ y."""
    return -0.5 * (float(y @ alpha) + factor.log_determinant + len(y) * _LOG_2PI)


def noise_of(noise_variance: float, row_noise: FloatArray | None, rows: BoolArray) -> Noise:
    """Variance of the noise of chosen rows: one number where no row has further noise."""
    return noise_variance if row_noise is None else noise_variance + row_noise[rows]


def white_noise_log_likelihood(y: FloatArray, noise_variance: Noise) -> float:
    """Log likelihood of targets that are noise and nothing else."""
    variance = np.broadcast_to(noise_variance, y.shape)
    return -0.5 * float(np.sum(y * y / variance + np.log(variance) + _LOG_2PI))
