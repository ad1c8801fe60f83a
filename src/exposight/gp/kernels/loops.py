"""Compiled loops over a tile of pairs: distances, correlations, weighted derivatives.

They release Python's lock, so that tiles can run in threads. The exponential and the logarithm are
written out without branches, for the compiler to work on four or eight pairs at once; the
library's functions would be called pair by pair.
"""

import math
from typing import Any

import numpy as np

from exposight.compiled import njit
from exposight.gp.observations import FloatArray, IntArray

# Only multiply-adds may be fused where every rounding counts; sums may be taken in any order.
_EXACT: dict[str, Any] = {
    "nogil": True,
    "error_model": "numpy",
    "fastmath": {"contract"},
}
_SUMS: dict[str, Any] = {**_EXACT, "fastmath": {"contract", "reassoc", "nsz"}}

# ln 2 in two parts, the first short enough for its multiples to be exact
_LN2_HIGH, _LN2_LOW = 6.93147180369123816490e-01, 1.90821492927058770002e-10
_LOG2_E = 1.4426950408889634
# 1.5 * 2^52: adding it leaves a number's nearest integer in the last bits of the sum
_SHIFTER, _SHIFTER_BITS = 6755399441055744.0, 0x4338000000000000
_ONE_EXPONENT, _MANTISSA_BITS = 1023, 52
_ROOT_HALF_BITS = 0x3FE6A09E00000000
_LEAST_EXPONENT = -708.0  # e^x of less is not a normal number
_E2, _E3, _E4, _E5, _E6, _E7, _E8, _E9, _E10, _E11, _E12, _E13 = (
    1.0 / math.factorial(order) for order in range(2, 14)
)
_NEARLY_0 = 1e-300  # what stands for 0 in a denominator
_ROOT_3, _ROOT_5 = math.sqrt(3.0), math.sqrt(5.0)


@njit(**_EXACT)
def _exp(x: float) -> float:
    """e^x for x <= 0: its power series within half of ln 2, scaled by a power of two."""
    bounded = max(x, _LEAST_EXPONENT)
    shifted = bounded * _LOG2_E + _SHIFTER
    count = shifted - _SHIFTER
    r = bounded - count * _LN2_HIGH - count * _LN2_LOW
    p = _E13
    p = p * r + _E12
    p = p * r + _E11
    p = p * r + _E10
    p = p * r + _E9
    p = p * r + _E8
    p = p * r + _E7
    p = p * r + _E6
    p = p * r + _E5
    p = p * r + _E4
    p = p * r + _E3
    p = p * r + _E2
    p = (p * r + 1.0) * r + 1.0
    bits = (np.float64(shifted).view(np.int64) + _ONE_EXPONENT) << _MANTISSA_BITS
    scaled: float = p * np.int64(bits).view(np.float64)
    return scaled if x > _LEAST_EXPONENT else 0.0


@njit(**_EXACT)
def _log1p(u: float) -> float:
    """log(1 + u) for u >= 0: 2 artanh(f / (2 + f)) by its series, 1 + f within root 2 of 1."""
    w = 1.0 + u
    # what w lost of u in rounding; beside the logarithm it counts only while u is small
    lost = u - (w - 1.0) if u < 1.0 else 0.0
    bits = np.float64(w).view(np.int64)
    exponent = (bits - _ROOT_HALF_BITS) >> _MANTISSA_BITS
    f = np.int64(bits - (exponent << _MANTISSA_BITS)).view(np.float64) - 1.0
    count = np.int64(exponent + _SHIFTER_BITS).view(np.float64) - _SHIFTER
    s = f / (2.0 + f)
    z = s * s
    # 2/3, 2/5, ...; |z| < 0.0295, so that the tenth term is below half a unit in the last place
    p = 2.0 / 21.0
    p = p * z + 2.0 / 19.0
    p = p * z + 2.0 / 17.0
    p = p * z + 2.0 / 15.0
    p = p * z + 2.0 / 13.0
    p = p * z + 2.0 / 11.0
    p = p * z + 2.0 / 9.0
    p = p * z + 2.0 / 7.0
    p = p * z + 2.0 / 5.0
    p = p * z + 2.0 / 3.0
    half = 0.5 * f * f
    tail = s * (half + p * z) + (count * _LN2_LOW + lost)
    result: float = count * _LN2_HIGH - ((half - tail) - f)
    return result


@njit(**_SUMS)
def _scaled_columns(y: FloatArray, columns: IntArray, rates: FloatArray) -> FloatArray:
    """Columns of (m, D) inputs times rates, each contiguous: (d, m)."""
    out = np.empty((len(columns), len(y)))
    for d in range(len(columns)):
        for j in range(len(y)):
            out[d, j] = y[j, columns[d]] * rates[d]
    return out


@njit(**_SUMS)
def squared_distances(
    x: FloatArray, y: FloatArray, columns: IntArray, rates: FloatArray, out: FloatArray
) -> None:
    """Write r² = sum_d (x_d − y_d)² rate_d² of every pair.

    Parameters
    ----------
    x : (n, D) array
        Inputs of the rows, in C order.
    y : (m, D) array
        Inputs of the columns, in C order.
    columns : (d,) int array
        Which inputs count.
    rates : (d,) array
        One over the length scales.
    out : (n, m) array
        Overwritten.
    """
    scaled = _scaled_columns(y, columns, rates)
    for i in range(len(x)):
        origin = x[i, columns[0]] * rates[0]
        for j in range(len(y)):
            difference = origin - scaled[0, j]
            out[i, j] = difference * difference
        for d in range(1, len(columns)):
            origin = x[i, columns[d]] * rates[d]
            for j in range(len(y)):
                difference = origin - scaled[d, j]
                out[i, j] += difference * difference


@njit(**_EXACT)
def close_outside(
    x: FloatArray, y: FloatArray, column: int, low: float, high: float, out: FloatArray
) -> None:
    """Zero the pairs, (n, m), of which one input's column lies outside low … high."""
    for i in range(len(x)):
        if not low <= x[i, column] <= high:
            out[i, :] = 0.0
    for j in range(len(y)):
        if not low <= y[j, column] <= high:
            out[:, j] = 0.0


@njit(**_EXACT)
def close_between_categories(
    x: FloatArray, y: FloatArray, column: int, variance: float, out: FloatArray
) -> None:
    """Multiply the pairs, (n, m), by the variance; zero those that differ in one column."""
    codes = y[:, column].copy()
    for i in range(len(x)):
        code = x[i, column]
        for j in range(len(codes)):
            out[i, j] *= variance if codes[j] == code else 0.0


@njit(**_SUMS)
def sum_within_categories(x: FloatArray, y: FloatArray, column: int, weights: FloatArray) -> float:
    """Sum the weights, (n, m), of the pairs that are alike in one column."""
    codes, total = y[:, column].copy(), 0.0
    for i in range(len(x)):
        code = x[i, column]
        for j in range(len(codes)):
            total += weights[i, j] if codes[j] == code else 0.0
    return total


@njit(**_SUMS)
def weighted_square_differences(
    x: FloatArray, y: FloatArray, columns: IntArray, rates: FloatArray, weights: FloatArray
) -> FloatArray:
    """Sum_ij W_ij (x_id − y_jd)² rate_d² for each d; arguments as in `squared_distances`."""
    scaled = _scaled_columns(y, columns, rates)
    out = np.zeros(len(columns))
    for i in range(len(x)):
        for d in range(len(columns)):
            origin = x[i, columns[d]] * rates[d]
            total = 0.0
            for j in range(len(y)):
                difference = origin - scaled[d, j]
                total += weights[i, j] * (difference * difference)
            out[d] += total
    return out


@njit(**_EXACT)
def weigh_pairs(
    inverse: FloatArray, alpha: FloatArray, first_row: int, first_column: int, out: FloatArray
) -> None:
    """(αα' − K⁻¹)/2 in a tile, pairs above the diagonal twice, those below not at all."""
    rows, columns = out.shape
    others = alpha[first_column : first_column + columns]
    for i in range(rows):
        row = first_row + i
        factor, pairs = alpha[row], inverse[row, first_column : first_column + columns]
        for j in range(columns):
            out[i, j] = factor * others[j] - pairs[j]
        diagonal = row - first_column
        for j in range(min(diagonal, columns)):
            out[i, j] = 0.0
        if 0 <= diagonal < columns:
            out[i, diagonal] *= 0.5


# For each kernel two loops. `correlate` turns squared distances into covariances k, in place.
# `derive` turns them, in place, into weight times −2 dk/dr², by which the square differences of
# each column are to be weighed for the derivative with respect to the log of its length scale; it
# returns the sum of weight times k, the derivative for the log of the variance.


@njit(**_EXACT)
def correlate_squared_exponential(r2: FloatArray, variance: float) -> None:
    """Variance exp(−r²/2)."""
    flat = r2.ravel()
    for i in range(flat.size):
        flat[i] = variance * _exp(-0.5 * flat[i])


@njit(**_SUMS)
def derive_squared_exponential(r2: FloatArray, weights: FloatArray, variance: float) -> float:
    """W k."""
    flat, w, total = r2.ravel(), weights.ravel(), 0.0
    for i in range(flat.size):
        weighted = w[i] * (variance * _exp(-0.5 * flat[i]))
        total += weighted
        flat[i] = weighted
    return total


@njit(**_EXACT)
def correlate_exponential(r2: FloatArray, variance: float) -> None:
    """Variance exp(−r)."""
    flat = r2.ravel()
    for i in range(flat.size):
        flat[i] = variance * _exp(-math.sqrt(flat[i]))


@njit(**_SUMS)
def derive_exponential(r2: FloatArray, weights: FloatArray, variance: float) -> float:
    """W k / r, and 0 where r is: there the derivative, k r, vanishes."""
    flat, w, total = r2.ravel(), weights.ravel(), 0.0
    for i in range(flat.size):
        r = math.sqrt(flat[i])
        weighted = w[i] * (variance * _exp(-r))
        total += weighted
        slope = weighted / max(r, _NEARLY_0)
        flat[i] = slope if r > 0.0 else 0.0
    return total


@njit(**_EXACT)
def correlate_matern32(r2: FloatArray, variance: float) -> None:
    """Variance (1 + √3 r) exp(−√3 r)."""
    flat = r2.ravel()
    for i in range(flat.size):
        a = _ROOT_3 * math.sqrt(flat[i])
        flat[i] = variance * (1.0 + a) * _exp(-a)


@njit(**_SUMS)
def derive_matern32(r2: FloatArray, weights: FloatArray, variance: float) -> float:
    """3 W exp(−√3 r) times the variance."""
    flat, w, total = r2.ravel(), weights.ravel(), 0.0
    for i in range(flat.size):
        a = _ROOT_3 * math.sqrt(flat[i])
        decay = w[i] * (variance * _exp(-a))
        total += decay * (1.0 + a)
        flat[i] = 3.0 * decay
    return total


@njit(**_EXACT)
def correlate_matern52(r2: FloatArray, variance: float) -> None:
    """Variance (1 + √5 r + 5r²/3) exp(−√5 r)."""
    flat = r2.ravel()
    for i in range(flat.size):
        a = _ROOT_5 * math.sqrt(flat[i])
        flat[i] = variance * (1.0 + a + a * a * (1.0 / 3.0)) * _exp(-a)


@njit(**_SUMS)
def derive_matern52(r2: FloatArray, weights: FloatArray, variance: float) -> float:
    """5/3 W (1 + √5 r) exp(−√5 r) times the variance."""
    flat, w, total = r2.ravel(), weights.ravel(), 0.0
    for i in range(flat.size):
        a = _ROOT_5 * math.sqrt(flat[i])
        decay = w[i] * (variance * _exp(-a))
        total += decay * (1.0 + a + a * a * (1.0 / 3.0))
        flat[i] = (5.0 / 3.0) * decay * (1.0 + a)
    return total


@njit(**_EXACT)
def correlate_rational_quadratic(r2: FloatArray, variance: float, alpha: float) -> None:
    """Variance (1 + r²/(2 alpha))^(−alpha)."""
    flat, rate = r2.ravel(), 0.5 / alpha
    for i in range(flat.size):
        flat[i] = variance * _exp(-alpha * _log1p(flat[i] * rate))


@njit(**_SUMS)
def derive_rational_quadratic(
    r2: FloatArray, weights: FloatArray, variance: float, alpha: float
) -> tuple[float, float]:
    """W k / (1 + u), u = r²/(2 alpha); also sums W k alpha (u/(1 + u) − log(1 + u))."""
    flat, w, total, further = r2.ravel(), weights.ravel(), 0.0, 0.0
    rate = 0.5 / alpha
    for i in range(flat.size):
        u = flat[i] * rate
        logarithm = _log1p(u)
        weighted = w[i] * (variance * _exp(-alpha * logarithm))
        slope = weighted / (1.0 + u)
        total += weighted
        further += slope * u - weighted * logarithm
        flat[i] = slope
    return total, alpha * further
