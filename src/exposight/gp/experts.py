"""What a committee's experts know: the observations that all share, and a shard of each one's own.

The covariance of the c shared observations and the m of a shard, noise included, is the square of
[[L, 0], [Z', C]]: L belongs to the shared ones, so that it is found once for all experts.
"""

from dataclasses import dataclass
from typing import Self

import numpy as np
from scipy.linalg import blas

from exposight.errors import NotPositiveDefiniteError
from exposight.gp.factor import JITTERS, Factor, factor_with_jitter, factorise
from exposight.gp.kernels import Kernel, tiles
from exposight.gp.observations import FloatArray
from exposight.gp.updates import complement


@dataclass(frozen=True, kw_only=True, eq=False)
class CommunicationSet:
    """The observations that all experts share.

    Attributes
    ----------
    x : (c, D) array
        Inputs, in C order.
    factor : Factor
        L.
    whitened : (c,) array
        L⁻¹ y.
    """

    x: FloatArray
    factor: Factor
    whitened: FloatArray

    @classmethod
    def condition(cls, kernel: Kernel, noise_variance: float, x: FloatArray, y: FloatArray) -> Self:
        """Condition on checked observations inside the kernel's gate, x in C order.

        Raises
        ------
        NotPositiveDefiniteError
            If their covariance has no Cholesky factor, even with the largest jitter.
        """
        factor = factorise(kernel, noise_variance, x)
        return cls(x=x, factor=factor, whitened=blas.dtrsv(factor.matrix, y, lower=1))

    def project(self, kernel: Kernel, x: FloatArray) -> FloatArray:
        """Find what they know of checked inputs, L⁻¹ k(own, x): (c, n) for (n, D)."""
        cross = np.empty((len(x), len(self.x)))
        tiles.fill(kernel, x, self.x, cross)
        out: FloatArray = blas.dtrsm(1.0, self.factor.matrix, cross.T, lower=1, overwrite_b=1)
        return out


@dataclass(frozen=True, kw_only=True, eq=False)
class Expert:
    """One shard of observations beside the communication set.

    Attributes
    ----------
    x : (m, D) array
        Inputs of the shard, in C order.
    below : (c, m) array
        Z.
    corner : (m, m) array
        C, in Fortran's order; what stands above the diagonal is of no use.
    whitened : (m,) array
        C⁻¹ (y − Z' L⁻¹ y_c): the targets, less what the communication set says of them.
    jitter : float
        What had to be added to the diagonal of C C', in squared units of the target.
    """

    x: FloatArray
    below: FloatArray
    corner: FloatArray
    whitened: FloatArray
    jitter: float

    @classmethod
    def condition(
        cls,
        shared: CommunicationSet,
        kernel: Kernel,
        noise_variance: float,
        x: FloatArray,
        y: FloatArray,
    ) -> Self:
        """Condition on a shard of checked observations inside the gate, x in C order.

        Raises
        ------
        NotPositiveDefiniteError
            If there is no C, even with the largest jitter; the message names the remedy.
        """
        below, corner = complement(shared.factor, kernel, noise_variance, shared.x, x)
        scale, kept = float(corner.diagonal().mean()), corner.copy(order="F")
        jitter = factor_with_jitter(corner, lambda: np.copyto(corner, kept))
        if jitter is None:
            raise NotPositiveDefiniteError(_why(len(x), noise_variance, scale))
        rest = y - below.T @ shared.whitened
        whitened = blas.dtrsv(corner, rest, lower=1)
        return cls(x=x, below=below, corner=corner, whitened=whitened, jitter=jitter)

    def gain(self, kernel: Kernel, x: FloatArray, known: FloatArray) -> FloatArray:
        """Find what the shard adds: u, with |u|² off the variance and u · whitened on the mean.

        Parameters
        ----------
        kernel : Kernel
            Prior covariance.
        x : (n, D) array
            Checked inputs.
        known : (c, n) array
            What the communication set knows of them, as from its `project`.

        Returns
        -------
        (m, n) array
            C⁻¹ (k(shard, x) − Z' known).
        """
        cross = np.empty((len(x), len(self.x)))
        tiles.fill(kernel, x, self.x, cross)
        rest = blas.dgemm(-1.0, self.below, known, beta=1.0, c=cross.T, trans_a=1, overwrite_c=1)
        out: FloatArray = blas.dtrsm(1.0, self.corner, rest, lower=1, overwrite_b=1)
        return out


def _why(observations: int, noise_variance: float, scale: float) -> str:
    """Say why a shard has no factor, and what to do."""
    return (
        f"the covariance of a shard of {observations} observations, given those that all experts "
        f"share, has no Cholesky factor, even with {JITTERS[-1]:g} of its mean variance "
        f"{scale:g} added to the diagonal: observations nearly repeat each other, and "
        f"noise_variance={noise_variance:g} does not keep them apart. Raise the noise variance, "
        "shorten the length scales, or remove repeated observations"
    )
