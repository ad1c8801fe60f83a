"""The Cholesky factor of a covariance matrix, in the memory of the matrix."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.linalg import blas, lapack

from exposight.errors import NotPositiveDefiniteError
from exposight.gp.kernels import Kernel, Quantity, tiles
from exposight.gp.observations import FloatArray
from exposight.gp.threads import in_threads
from exposight.gp.triangular import factor_lower, invert_lower

# Added to the diagonal, in shares of its mean, one after the other until the factor exists. The
# last keeps a prediction's standard deviation right to a thousandth of the prior's.
JITTERS = (0.0, 1e-10, 1e-9, 1e-8, 1e-7, 1e-6)
# From here on a length scale leaves nothing to tell observations apart by, a noise variance no
# digits beside the prior's.
_LONG, _QUIET = 100.0, 1e-10
# Ratio of the largest to the smallest element on L's diagonal, up to which L⁻¹ is kept; its error
# is some tens of ratios times 1e-16. Beyond this many rows it would take more than 128 MB.
_ILL_CONDITIONED, _LARGE = 1e5, 4096


@dataclass(frozen=True, kw_only=True, eq=False)
class Factor:
    """L with L L' = K + (noise + jitter) 1.

    Attributes
    ----------
    matrix : (n, n) array
        In Fortran's order, L in the lower triangle; what stands above the diagonal is of no use.
    jitter : float
        What had to be added to the diagonal, in squared units of the target; 0 almost always.
    """

    matrix: FloatArray
    jitter: float

    @property
    def log_determinant(self) -> float:
        """Of L L'."""
        return 2.0 * float(np.log(self.matrix.diagonal()).sum())

    def solve(self, y: FloatArray) -> FloatArray:
        """Solve (L L') α = y for a vector."""
        solution: FloatArray = lapack.dpotrs(self.matrix, y, lower=1)[0]
        return solution

    def half_solve(self, columns: FloatArray) -> FloatArray:
        """Solve L Z = B: by the inverse of L, kept after the first time, where that is accurate.

        Parameters
        ----------
        columns : (n, m) array
            B; overwritten where it is in Fortran's order.

        Returns
        -------
        (n, m) array
        """
        # the product with a triangle is a third faster than the solution
        if self.inverse is not None:
            product: FloatArray = blas.dtrmm(1.0, self.inverse, columns, lower=1, overwrite_b=1)
            return product
        solution: FloatArray = blas.dtrsm(1.0, self.matrix, columns, lower=1, overwrite_b=1)
        return solution

    @cached_property
    def inverse(self) -> FloatArray | None:
        """L⁻¹, laid out as `matrix`; None where it would be inaccurate, or too large to keep."""
        diagonal = self.matrix.diagonal()
        if len(diagonal) > _LARGE or diagonal.max() > _ILL_CONDITIONED * diagonal.min():
            return None
        out = self.matrix.copy(order="F")
        invert_lower(out)
        return out

    def inverse_diagonal(self) -> FloatArray:
        """Diagonal of (L L')⁻¹, shape (n,): sums of squares down the columns of L⁻¹."""
        inverse = self.inverse
        if inverse is None:
            inverse = self.matrix.copy(order="F")
            invert_lower(inverse)
        return np.array([column[row:] @ column[row:] for row, column in enumerate(inverse.T)])

    def consume(self) -> FloatArray:
        """Turn the factor's memory into (L L')⁻¹, its lower triangle; the factor is gone."""
        invert_lower(self.matrix)
        product: FloatArray = lapack.dlauum(self.matrix, lower=1, overwrite_c=1)[0]
        return product


def factorise(
    kernel: Kernel,
    noise_variance: float,
    x: FloatArray,
    *,
    buffer: FloatArray | None = None,
    threads: int = 1,
) -> Factor:
    """Factorise the covariance of observations.

    Parameters
    ----------
    kernel : Kernel
        Prior covariance.
    noise_variance : float
        Positive, in squared units of the target.
    x : (n, D) array
        Checked inputs, n at least 1, in C order.
    buffer : (n, n) array, optional
        In C order; becomes the factor's memory.
    threads : int
        For building the matrix.

    Returns
    -------
    Factor

    Raises
    ------
    NotPositiveDefiniteError
        If there is no factor, even with the largest jitter; the message names the cause.
    """
    matrix = np.empty((len(x), len(x))) if buffer is None else buffer

    def fill() -> None:
        for _ in in_threads(
            lambda rows: tiles.fill_triangle(kernel, x, rows, matrix),
            tiles.row_blocks(len(x)),
            threads=threads,
        ):
            pass

    # C order's upper triangle is the lower one in LAPACK's
    jitter = factor_with_jitter(matrix.T, fill, noise_variance=noise_variance)
    if jitter is None:
        raise NotPositiveDefiniteError(_why(kernel, noise_variance, x))
    return Factor(matrix=matrix.T, jitter=jitter)


def factor_with_jitter(
    matrix: FloatArray, fill: Callable[[], None], *, noise_variance: float = 0.0
) -> float | None:
    """Factorise a covariance in place, with the least of `JITTERS` that allows it.

    Parameters
    ----------
    matrix : (n, n) array
        In Fortran's order; its lower triangle becomes the factor's.
    fill : callable
        Writes the covariance into the lower triangle; called before each try.
    noise_variance : float
        Added to the diagonal, in squared units of the target.

    Returns
    -------
    float or None
        What was added to the diagonal beside the noise, in squared units of the target; None
        where there is no factor.
    """
    diagonal = np.einsum("ii->i", matrix)
    for share in JITTERS:
        fill()
        scale = float(diagonal.mean())
        if not math.isfinite(scale):
            return None
        jitter = share * scale
        diagonal += noise_variance + jitter
        if factor_lower(matrix):
            return jitter
    return None


def _why(kernel: Kernel, noise_variance: float, x: FloatArray) -> str:
    """Say why there is no factor, and what to do."""
    if not all(
        np.isfinite(tiles.tile(kernel, x[rows], x)).all() for rows in tiles.row_blocks(len(x))
    ):
        return "the covariance matrix holds values that are not finite; check the hyperparameters"
    scale = float(kernel.prior_variance(x).mean())
    causes = []
    if repeated := len(x) - len(np.unique(x[:, kernel.columns], axis=0)):
        causes.append(f"{repeated} observations repeat another one's inputs")
    causes += [
        f"{own.name}={own.value:g} is {own.value / span:.0f} times what its column spans"
        for own in kernel.parameters
        if own.quantity is Quantity.LENGTH_SCALE
        for span in [float(np.ptp(x[:, own.dims], axis=0).max()) or own.value]
        if own.value > _LONG * span
    ]
    if noise_variance < _QUIET * scale:
        causes.append(f"the noise is {noise_variance / scale:.0e} of the prior's variance")
    return (
        f"the covariance matrix of {len(x)} observations has no Cholesky factor, even with "
        f"{JITTERS[-1]:g} of its mean variance {scale:g} added to the diagonal: observations "
        f"nearly repeat each other for these length scales and noise_variance={noise_variance:g} "
        f"does not keep them apart ({'; '.join(causes) or 'no single cause stands out'}). "
        "Raise the noise variance or its lower bound, shorten the length scales or lower their "
        "upper bound, or remove repeated observations"
    )
