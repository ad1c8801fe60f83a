"""Adding and removing observations in a Cholesky factor, in squared instead of cubic time."""

import numba
import numpy as np
from numpy.typing import NDArray
from scipy.linalg import blas

from exposight.gp.factor import Factor
from exposight.gp.kernels import Kernel, tiles
from exposight.gp.observations import FloatArray
from exposight.gp.triangular import factor_lower

# A share of the rows from which on factorising afresh takes no longer than removing them one by
# one; measured at 2000 rows.
_MANY = 1 / 20


def append_rows(
    factor: Factor, kernel: Kernel, noise_variance: float, x: FloatArray, new: FloatArray
) -> Factor | None:
    """Factorise the covariance of more observations, starting from the factor of the first ones.

    With L L' the covariance of `x`, that of both is the square of [[L, 0], [Z', C]], where
    L Z = k(x, new) and C C' = k(new, new) + noise 1 − Z'Z.

    Parameters
    ----------
    factor : Factor
        Of the covariance of `x`, without jitter; left as it is.
    kernel : Kernel
        Prior covariance.
    noise_variance : float
        Positive, in squared units of the target.
    x : (n, D) array
        Checked inputs in C order.
    new : (k, D) array
        Checked inputs in C order, all inside the kernel's gate.

    Returns
    -------
    Factor or None
        None where rounding leaves no factor, so that one has to be found afresh.
    """
    if len(new) == 0:
        return factor
    below, corner = complement(factor, kernel, noise_variance, x, new)
    if not factor_lower(corner):
        return None
    rows = len(x) + len(new)
    out = np.empty((rows, rows))
    _join(factor.matrix.T, below, corner.T, out)
    return Factor(matrix=out.T, jitter=0.0)


def complement(
    factor: Factor, kernel: Kernel, noise_variance: float, x: FloatArray, new: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Find what the observations of `x` leave unexplained of new ones.

    Parameters
    ----------
    factor, kernel, noise_variance, x, new
        As for `append_rows`; a factor with jitter will do.

    Returns
    -------
    below : (n, k) array
        Z = L⁻¹ k(x, new), in Fortran's order.
    corner : (k, k) array
        The Schur complement k(new, new) + noise 1 − Z'Z, its lower triangle, in Fortran's order.
    """
    cross = np.empty((len(new), len(x)))
    tiles.fill(kernel, new, x, cross)
    # not by L⁻¹, which takes cubic time to compute
    below: FloatArray = blas.dtrsm(1.0, factor.matrix, cross.T, lower=1, overwrite_b=1)
    corner = np.empty((len(new), len(new)))
    for rows in tiles.row_blocks(len(new)):
        tiles.fill_triangle(kernel, new, rows, corner)
    np.einsum("ii->i", corner)[:] += noise_variance
    # C order's upper triangle is the lower one in LAPACK's
    rest: FloatArray = blas.dsyrk(
        -1.0, below, beta=1.0, c=corner.T, trans=1, lower=1, overwrite_c=1
    )
    return below, rest


def remove_rows(factor: Factor, rows: NDArray[np.intp]) -> Factor | None:
    """Factorise the covariance of fewer observations, starting from the factor of all.

    A row that leaves takes its column along; Givens rotations work that column into the columns
    to its right. Nothing is subtracted, so that this is as accurate as a factor found afresh.

    Parameters
    ----------
    factor : Factor
        Of the covariance of n observations, without jitter; left as it is.
    rows : (k,) array of int
        Which ones leave: ascending, none twice, fewer than n.

    Returns
    -------
    Factor or None
        None where so many leave that a factor is found afresh as quickly.
    """
    if len(rows) == 0:
        return factor
    total = len(factor.matrix)
    if len(rows) > 1 and len(rows) > _MANY * total:
        return None
    leaves = np.zeros(total, dtype=np.bool_)
    leaves[rows] = True
    kept = np.flatnonzero(~leaves)
    out = np.empty((len(kept), len(kept)))
    _rotate(factor.matrix.T, leaves, kept, np.zeros((len(rows), len(kept))), out)
    return Factor(matrix=out.T, jitter=0.0)


# All matrices below are seen transposed: row j holds column j of the factor, from j on.


@numba.njit(nogil=True, cache=True, error_model="numpy")
def _join(upper: FloatArray, below: FloatArray, corner: FloatArray, out: FloatArray) -> None:
    """Put together the transpose of [[L, 0], [Z', C]] from L', Z and C'."""
    n, new = below.shape
    for j in range(n):
        out[j, j:n] = upper[j, j:]
        out[j, n:] = below[j]
    for j in range(new):
        out[n + j, n + j :] = corner[j, j:]


@numba.njit(nogil=True, cache=True, error_model="numpy", fastmath={"contract"})
def _rotate(
    upper: FloatArray,
    leaves: NDArray[np.bool_],
    kept: NDArray[np.intp],
    carried: FloatArray,
    out: FloatArray,
) -> None:
    """Copy the columns that stay, rotating into each of them those that have left before it."""
    size, done, gone = len(kept), 0, 0
    for j in range(len(leaves)):
        target = carried[gone] if leaves[j] else out[done]
        for i in range(done, size):
            target[i] = upper[j, kept[i]]
        if leaves[j]:
            gone += 1
            continue
        for leaver in carried[:gone]:
            length = np.hypot(target[done], leaver[done])
            cosine, sine = target[done] / length, leaver[done] / length
            for i in range(done, size):
                own, other = target[i], leaver[i]
                target[i] = cosine * own + sine * other
                leaver[i] = cosine * other - sine * own
        done += 1
