"""The Cholesky factor of a covariance matrix, in the memory of the matrix.

It is found, inverted, and extended by further rows in squared instead of cubic time.
"""

import ctypes
import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any, TypeAlias

import numpy as np
from numba.extending import get_cython_function_address
from scipy.linalg import blas, lapack

from exposight.errors import InputError, NotPositiveDefiniteError
from exposight.gp.kernels import Kernel, Quantity
from exposight.gp.memory import check_memory, square_bytes
from exposight.gp.observations import FloatArray
from exposight.gp.tiling import fill_tiles, fill_triangle, in_threads, row_blocks, tile

# Variance of the noise of all rows alike, or of each row.
Noise: TypeAlias = float | FloatArray

# Added to the diagonal, in shares of its mean, one after the other until the factor exists. The
# last keeps a prediction's standard deviation right to a thousandth of the prior's.
JITTERS = (0.0, 1e-10, 1e-9, 1e-8, 1e-7, 1e-6)
# Above the first a length scale, in spans of its column, hardly separates observations; below the
# second a noise variance, in shares of the prior's, vanishes in rounding.
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
        In Fortran's order, L in the lower triangle; what stands above the diagonal is undefined.
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

    def consume(self) -> FloatArray:
        """Turn the factor's memory into (L L')⁻¹, its lower triangle; the factor is gone."""
        invert_lower(self.matrix)
        product: FloatArray = lapack.dlauum(self.matrix, lower=1, overwrite_c=1)[0]
        return product


def factorise(
    kernel: Kernel,
    noise_variance: Noise,
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
    noise_variance : float or (n,) array
        Positive, of all rows or of each, in squared units of the target.
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
    if buffer is None:
        check_memory(
            square_bytes(len(x)),
            f"an exact process of {len(x)} observations",
            "take a committee, whose memory grows with the rows (train the model again: above "
            "3000 rows one is taken), or fewer rows",
        )
    matrix = np.empty((len(x), len(x))) if buffer is None else buffer

    def fill() -> None:
        for _ in in_threads(
            lambda rows: fill_triangle(kernel, x, rows, matrix),
            row_blocks(len(x)),
            threads=threads,
        ):
            pass

    # C order's upper triangle is the lower one in LAPACK's
    jitter = factor_with_jitter(matrix.T, fill, noise_variance=noise_variance)
    if jitter is None:
        raise NotPositiveDefiniteError(_why(kernel, float(np.min(noise_variance)), x))
    return Factor(matrix=matrix.T, jitter=jitter)


def factor_with_jitter(
    matrix: FloatArray, fill: Callable[[], None], *, noise_variance: Noise = 0.0
) -> float | None:
    """Factorise a covariance in place, with the least of `JITTERS` that allows it.

    Parameters
    ----------
    matrix : (n, n) array
        In Fortran's order; its lower triangle becomes the factor's.
    fill : callable
        Writes the covariance into the lower triangle; called before each try.
    noise_variance : float or (n,) array
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
    """Explain why there is no factor, and what to do."""
    if not all(np.isfinite(tile(kernel, x[rows], x)).all() for rows in row_blocks(len(x))):
        return "the covariance matrix holds values that are not finite; check the hyperparameters"
    scale = float(kernel.prior_variance(x).mean())
    causes = []
    if repeated := len(x) - len(np.unique(x[:, kernel.columns], axis=0)):
        causes.append(f"{repeated} observations repeat another one's inputs")
    causes += [
        f"{each.name}={each.value:g} is {each.value / span:.0f} times what its column spans"
        for each in kernel.parameters
        if each.quantity is Quantity.LENGTH_SCALE
        for span in [float(np.ptp(x[:, each.dims], axis=0).max()) or each.value]
        if each.value > _LONG * span
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


def append_rows(
    factor: Factor, kernel: Kernel, noise_variance: Noise, x: FloatArray, new: FloatArray
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
    noise_variance : float or (k,) array
        Positive, of the new rows, in squared units of the target.
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
    rows, first = len(x) + len(new), len(x)
    out = np.empty((rows, rows), order="F")
    out[:first, :first] = factor.matrix
    out[first:, :first] = below.T
    out[first:, first:] = corner
    return Factor(matrix=out, jitter=0.0)


def complement(
    factor: Factor, kernel: Kernel, noise_variance: Noise, x: FloatArray, new: FloatArray
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
    fill_tiles(kernel, new, x, cross)
    # not by L⁻¹, which takes cubic time to compute
    below: FloatArray = blas.dtrsm(1.0, factor.matrix, cross.T, lower=1, overwrite_b=1)
    corner = np.empty((len(new), len(new)))
    for rows in row_blocks(len(new)):
        fill_triangle(kernel, new, rows, corner)
    np.einsum("ii->i", corner)[:] += noise_variance
    # C order's upper triangle is the lower one in LAPACK's
    rest: FloatArray = blas.dsyrk(
        -1.0, below, beta=1.0, c=corner.T, trans=1, lower=1, overwrite_c=1
    )
    return below, rest


# Columns that LAPACK factorises at once, and rows below which it inverts as quickly; measured.
_PANEL, _SMALL = 96, 128
_DOUBLE_BYTES = 8

_CHAR, _MATRIX = ctypes.c_char_p, ctypes.c_void_p
_INT, _DOUBLE = ctypes.POINTER(ctypes.c_int), ctypes.POINTER(ctypes.c_double)


def _routine(library: str, name: str, *arguments: Any) -> Any:
    address = get_cython_function_address(f"scipy.linalg.cython_{library}", name)
    return ctypes.CFUNCTYPE(None, *arguments)(address)


# side, triangle, transposed, unit diagonal, rows, columns, factor, triangle, matrix
_ON_A_SIDE = (*(_CHAR,) * 4, _INT, _INT, _DOUBLE, _MATRIX, _INT, _MATRIX, _INT)
_trmm = _routine("blas", "dtrmm", *_ON_A_SIDE)
_trsm = _routine("blas", "dtrsm", *_ON_A_SIDE)
# triangle, transposed, rows, columns, factor, matrix, factor, result
_syrk = _routine(
    "blas", "dsyrk", _CHAR, _CHAR, _INT, _INT, _DOUBLE, _MATRIX, _INT, _DOUBLE, _MATRIX, _INT
)
# triangle, rows, matrix, outcome
_potrf = _routine("lapack", "dpotrf", _CHAR, _INT, _MATRIX, _INT, _INT)
# triangle, unit diagonal, rows, matrix, outcome
_trtri = _routine("lapack", "dtrtri", _CHAR, _CHAR, _INT, _MATRIX, _INT, _INT)


def _int(value: int) -> ctypes.c_int:
    return ctypes.c_int(value)


_ONE, _MINUS_ONE = ctypes.c_double(1.0), ctypes.c_double(-1.0)


def factor_lower(matrix: FloatArray) -> bool:
    """Replace the lower triangle of a symmetric matrix by its Cholesky factor.

    LAPACK's own routines reach two thirds of the machine's rate at a thousand rows. Cutting the
    matrix otherwise leaves more of the work to the products of BLAS: a tenth less time for the
    factor, a fifth to a third less for the inverse. BLAS is called by address, for SciPy's
    wrappers copy a block of a matrix before they work on it.

    Parameters
    ----------
    matrix : (n, n) array
        In Fortran's order; what stands above the diagonal counts for nothing and stays.

    Returns
    -------
    bool
        Whether there is a factor; if not, the lower triangle holds nothing of use.

    Raises
    ------
    InputError
        If it is not a square, writeable matrix of float64 in Fortran's order.
    """
    n = _check_in_place(matrix)
    stride, outcome = _int(n), _int(0)
    for start in range(0, n, _PANEL):
        columns = min(_PANEL, n - start)
        below = n - start - columns
        corner = matrix.ctypes.data + _DOUBLE_BYTES * start * (n + 1)
        _potrf(b"L", _int(columns), corner, stride, outcome)
        if outcome.value != 0:
            return False
        if below > 0:
            panel, rows = corner + _DOUBLE_BYTES * columns, _int(below)
            rest = corner + _DOUBLE_BYTES * columns * (n + 1)
            width = _int(columns)
            _trsm(b"R", b"L", b"T", b"N", rows, width, _ONE, corner, stride, panel, stride)
            _syrk(b"L", b"N", rows, width, _MINUS_ONE, panel, stride, _ONE, rest, stride)
    return bool(np.isfinite(matrix.diagonal()).all())


def invert_lower(matrix: FloatArray) -> None:
    """Replace the lower triangle of a matrix by its inverse.

    Parameters
    ----------
    matrix : (n, n) array
        In Fortran's order, no zero on its diagonal; what stands above the diagonal stays.

    Raises
    ------
    InputError
        If it is not a square, writeable matrix of float64 in Fortran's order.
    """
    n = _check_in_place(matrix)
    if n > 0:
        _invert(matrix.ctypes.data, n, n)


def _invert(address: int, n: int, rows_in_memory: int) -> None:
    """Invert [[A, 0], [B, C]] into [[A⁻¹, 0], [−C⁻¹ B A⁻¹, C⁻¹]]."""
    stride = _int(rows_in_memory)
    if n <= _SMALL:
        _trtri(b"L", b"N", _int(n), address, stride, _int(0))
        return
    upper = n // 2
    lower = n - upper
    below = address + _DOUBLE_BYTES * upper
    corner = address + _DOUBLE_BYTES * upper * (rows_in_memory + 1)
    _invert(address, upper, rows_in_memory)
    _invert(corner, lower, rows_in_memory)
    rows, columns = _int(lower), _int(upper)
    _trmm(b"R", b"L", b"N", b"N", rows, columns, _MINUS_ONE, address, stride, below, stride)
    _trmm(b"L", b"L", b"N", b"N", rows, columns, _ONE, corner, stride, below, stride)


def _check_in_place(matrix: FloatArray) -> int:
    """Check that a matrix can be worked on in place and return its number of rows."""
    square = matrix.ndim == 2 and matrix.shape[0] == matrix.shape[1]
    flags = matrix.flags
    if not (square and matrix.dtype == np.float64 and flags.f_contiguous and flags.writeable):
        msg = (
            "working in place takes a square, writeable float64 matrix in Fortran's order, got "
            f"{matrix.dtype} of shape {matrix.shape}; copy it with np.asfortranarray"
        )
        raise InputError(msg)
    return len(matrix)
