"""The variance of very many predictions from a covariance's largest eigenvalues, with a bound.

With K = U Λ U' and the noise s², a row whose covariances with the observations are k has the
explained variance k'(K + s²)⁻¹k = Σ (u_i'k)² / (λ_i + s²). Smooth kernels have few eigenvalues
above the noise. What the first r leave of |k|² is T, no more than λ_{r+1} times the row's prior
variance (the covariance of row and observations is one), and the other terms add up to something
between T / (λ_{r+1} + s²) and T / (λ_n + s²): the middle is taken, half the difference is the error
at most. Rows for which that is too much are computed exactly.
"""

from dataclasses import dataclass
from typing import Self

import numpy as np
from scipy.linalg import blas, eigh

from exposight.gp.observations import BoolArray, FloatArray

TOLERANCE = 1e-4
"""By so much of itself a standard deviation may be wrong."""

_STEP = 32
# Beyond this share of the observations the exact product with a triangle is as quick.
_WORTHWHILE = 0.4
# Share of the rows that may have to be computed exactly.
_FEW = 0.01


@dataclass(frozen=True, kw_only=True, eq=False)
class Spectrum:
    """The r largest eigenvalues of a covariance of n observations, and what bounds the others.

    Attributes
    ----------
    vectors : (n, r) array
        U's first columns, in Fortran's order.
    weights : (r,) array
        1 / (λ_i + s²).
    rest : float
        λ_{r+1}.
    rest_weights : (float, float)
        1 / (λ_{r+1} + s²) and 1 / (λ_n + s²), between which the other terms are weighed.
    """

    vectors: FloatArray
    weights: FloatArray
    rest: float
    rest_weights: tuple[float, float]

    @classmethod
    def of(
        cls,
        covariance: FloatArray,
        noise_variance: float,
        cross: FloatArray,
        prior: FloatArray,
        variance: FloatArray,
        noise: float,
    ) -> Self | None:
        """Find how many eigenvalues predictions need, by a sample of m rows computed exactly.

        Parameters
        ----------
        covariance : (n, n) array
            K, its lower triangle in Fortran's order; overwritten.
        noise_variance : float
            s², the jitter included.
        cross : (m, n) array
            Covariances of the sample's rows with the observations.
        prior, variance : (m,) array
            Their variance before and after the observations were known.
        noise : float
            What is added to it before the root is taken: s² of new observations.

        Returns
        -------
        Spectrum or None
            None where too many would be needed, or rounding spoils their sum.
        """
        values, vectors = eigh(
            covariance, lower=True, overwrite_a=True, check_finite=False, driver="evd"
        )
        values, vectors = np.maximum(values[::-1], 0.0), vectors[:, ::-1]
        weights = 1.0 / (values + noise_variance)
        squares = (cross @ vectors) ** 2
        sums = np.cumsum(squares * weights, axis=1)
        left = np.cumsum(squares[:, ::-1], axis=1)[:, ::-1]
        exact, scale = prior - variance, variance + noise
        for rank in range(_STEP, int(_WORTHWHILE * len(values)), _STEP):
            found = cls(
                vectors=vectors[:, :rank],
                weights=weights[:rank],
                rest=float(values[rank]),
                rest_weights=(float(weights[rank]), float(weights[-1])),
            )
            middle, error = found._others(left[:, rank], prior)
            good = within(error, scale)
            if np.mean(~good) > _FEW:
                continue
            if not within(np.abs(sums[:, rank - 1] + middle - exact), scale)[good].all():
                continue
            found = cls(**{**vars(found), "vectors": np.asfortranarray(found.vectors)})
            middle, error = found.explain(cross, prior)
            sound = within(np.abs(middle - exact), scale) | ~within(error, scale)
            return found if sound.all() else None
        return None

    def explain(self, cross: FloatArray, prior: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the explained variance of m rows and its largest error, each (m,).

        Parameters
        ----------
        cross : (m, n) array
            Covariances with the observations, in C order.
        prior : (m,) array
            Variance before they were known.
        """
        squares = blas.dgemm(1.0, self.vectors, cross.T, trans_a=1)  # (r, m), without a copy
        np.square(squares, out=squares)
        left = np.einsum("ij,ij->i", cross, cross) - squares.sum(axis=0)
        middle, error = self._others(left, prior)
        return self.weights @ squares + middle, error

    def _others(self, left: FloatArray, prior: FloatArray) -> tuple[FloatArray, FloatArray]:
        low, high = self.rest_weights
        rest = np.minimum(np.maximum(left, 0.0), self.rest * prior)
        return 0.5 * (high + low) * rest, 0.5 * (high - low) * rest


def within(error: FloatArray, variance: FloatArray) -> BoolArray:
    """Return which errors of variances leave their roots right to half of `TOLERANCE`."""
    good: BoolArray = error <= TOLERANCE * variance
    return good
