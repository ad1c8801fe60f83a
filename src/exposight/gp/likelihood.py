"""The log marginal likelihood and its gradient, on LAPACK."""

import math

import numpy as np
from scipy.linalg import lapack

from exposight.errors import NotPositiveDefiniteError
from exposight.gp.kernels import Kernel
from exposight.gp.observations import BoolArray, FloatArray

__all__ = [
    "factorise",
    "likelihood_and_gradient",
    "log_likelihood",
    "solve",
    "white_noise_log_likelihood",
]

# Added to the diagonal, in shares of its mean, one after the other until the factor exists. The
# last keeps a prediction's standard deviation right to a thousandth of the prior's.
_JITTERS = (0.0, 1e-10, 1e-9, 1e-8, 1e-7, 1e-6)
_LOG_2PI = math.log(2.0 * math.pi)


def likelihood_and_gradient(
    kernel: Kernel, noise_variance: float, x: FloatArray, y: FloatArray, *, active: BoolArray
) -> tuple[float, FloatArray]:
    """Log marginal likelihood of checked observations, and its gradient.

    One Cholesky factorisation and one inverse; the derivatives are sums over the elements of
    (αα' − K⁻¹)/2 with α = K⁻¹ y.

    Parameters
    ----------
    kernel : Kernel
        Prior covariance.
    noise_variance : float
        Positive, in squared units of the target.
    x : (n, D) array
        Checked inputs.
    y : (n,) array
        Checked targets.
    active : (n,) bool array
        Rows that the kernel's gate lets in.

    Returns
    -------
    likelihood : float
    gradient : (p + 1,) array
        With respect to the kernel's `log_parameters`, then the log of the noise variance.

    Raises
    ------
    NotPositiveDefiniteError
        If the covariance matrix has no Cholesky factor, even with the largest jitter.
    """
    targets, rest = y[active], y[~active]
    covariance, gradient_dot = kernel.linearise(x[active])
    factor, _ = factorise(covariance, noise_variance)
    alpha = solve(factor, targets)
    likelihood = log_likelihood(factor, alpha, targets) + white_noise_log_likelihood(
        rest, noise_variance
    )

    inverse, _ = lapack.dpotri(factor, lower=1, overwrite_c=1)
    # The inverse fills one triangle. The derivatives of K are symmetric, so that triangle taken
    # twice, its diagonal once, weighs them like the whole.
    weights = np.triu(inverse.T)
    np.negative(weights, out=weights)
    diagonal = np.einsum("ii->i", weights)
    diagonal *= 0.5
    weights += np.outer(0.5 * alpha, alpha)
    noise_derivative = noise_variance * float(diagonal.sum())
    noise_derivative += 0.5 * float(rest @ rest / noise_variance - len(rest))
    return likelihood, np.append(gradient_dot(weights), noise_derivative)


def factorise(covariance: FloatArray, noise_variance: float) -> tuple[FloatArray, float]:
    """Factorise covariance + noise by Cholesky.

    Parameters
    ----------
    covariance : (n, n) array
        Symmetric, in C order; its memory is used up.
    noise_variance : float
        Positive, in squared units of the target.

    Returns
    -------
    factor : (n, n) array
        In the lower triangle; what stands above the diagonal is of no use.
    jitter : float
        What had to be added to the diagonal; 0 almost always.

    Raises
    ------
    NotPositiveDefiniteError
        If there is no factor, even with the largest jitter.
    """
    diagonal = covariance.diagonal().copy()
    scale = float(diagonal.mean())
    matrix = covariance.T  # LAPACK's column order
    for share in _JITTERS:
        jitter = share * scale
        np.einsum("ii->i", matrix)[:] = diagonal + (noise_variance + jitter)
        factor, info = lapack.dpotrf(matrix, lower=1, clean=0, overwrite_a=1)
        if info == 0 and math.isfinite(factor[-1, -1]):
            return factor, jitter
        # what the attempt overwrote below the diagonal still stands above it
        lower = np.tril_indices(len(matrix), -1)
        matrix = np.asfortranarray(factor)
        matrix[lower] = matrix.T[lower]
    if not (np.isfinite(matrix[np.triu_indices(len(matrix), 1)]).all() and math.isfinite(scale)):
        msg = "the covariance matrix holds values that are not finite; check the hyperparameters"
        raise NotPositiveDefiniteError(msg)
    msg = (
        f"the covariance matrix of {len(matrix)} observations has no Cholesky factor, even with "
        f"{_JITTERS[-1]:g} of its mean variance {scale:g} added to the diagonal: observations "
        f"nearly repeat each other for these length scales and noise_variance={noise_variance:g} "
        "does not keep them apart. Raise the noise variance or its lower bound, shorten the "
        "length scales, or remove repeated observations"
    )
    raise NotPositiveDefiniteError(msg)


def solve(factor: FloatArray, y: FloatArray) -> FloatArray:
    """Solve (L L') α = y.

    Parameters
    ----------
    factor : (n, n) array
        As `factorise` returns it.
    y : (n,) array
        Targets.

    Returns
    -------
    (n,) array
    """
    solution: FloatArray = lapack.dpotrs(factor, y, lower=1)[0]
    return solution


def log_likelihood(factor: FloatArray, alpha: FloatArray, y: FloatArray) -> float:
    """Log marginal likelihood of targets with a factorised covariance.

    Parameters
    ----------
    factor : (n, n) array
        As `factorise` returns it.
    alpha : (n,) array
        As `solve` returns it.
    y : (n,) array
        Targets.

    Returns
    -------
    float
    """
    log_determinant = 2.0 * float(np.log(factor.diagonal()).sum())
    return -0.5 * (float(y @ alpha) + log_determinant + len(y) * _LOG_2PI)


def white_noise_log_likelihood(y: FloatArray, noise_variance: float) -> float:
    """Log likelihood of targets that are noise and nothing else.

    Parameters
    ----------
    y : (n,) array
        Targets.
    noise_variance : float
        Positive, in squared units of the target.

    Returns
    -------
    float
    """
    return -0.5 * (float(y @ y) / noise_variance + len(y) * (math.log(noise_variance) + _LOG_2PI))
