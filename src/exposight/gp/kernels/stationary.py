"""Kernels of the scaled distance r, r² = sum_d (x_d − x'_d)² / l_d²."""

import math
from abc import abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from types import MappingProxyType
from typing import ClassVar

import numpy as np

from exposight.errors import InputError
from exposight.gp import observations
from exposight.gp.kernels import loops
from exposight.gp.kernels.base import Quantity
from exposight.gp.kernels.descriptions import register_kernel
from exposight.gp.kernels.leaves import Leaf
from exposight.gp.kernels.loops import squared_distances, weighted_square_differences


@dataclass(frozen=True, kw_only=True)
class Stationary(Leaf):
    """Base of the kernels that depend on the scaled distance alone.

    Attributes
    ----------
    variance : float
        sigma², in squared units of the target.
    length_scales : tuple of float
        One for all `dims`, or one for each of them (automatic relevance determination, ARD;
        Eq. 24 of the paper), in the units of the columns.
    dims : tuple of int
        Columns of the inputs that the kernel reads, counted from 0.
    fixed : tuple of str
        Names of fields that fitting leaves alone, such as ``("variance",)``.

    Raises
    ------
    InputError
        If a hyperparameter is not positive and finite, the length scales do not match the
        dimensions, or a field to fix does not exist.
    """

    variance: float
    length_scales: tuple[float, ...]
    dims: tuple[int, ...]
    fixed: tuple[str, ...] = ()
    quantities: ClassVar[Mapping[str, Quantity]] = MappingProxyType(
        {"variance": Quantity.VARIANCE, "length_scales": Quantity.LENGTH_SCALE}
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        scales = tuple(np.atleast_1d(self.length_scales).tolist())
        if len(scales) not in (1, len(self.dims)):
            msg = (
                f"{type(self).__name__} over {len(self.dims)} dimensions takes 1 length scale or "
                f"{len(self.dims)}, got {len(scales)}"
            )
            raise InputError(msg)
        object.__setattr__(self, "length_scales", scales)

    # -- the shape of the kernel as a function of r² ----------------------------------------

    @abstractmethod
    def correlate(self, r2: observations.FloatArray) -> None:
        """Turn a tile of squared scaled distances into covariances, in place."""

    @abstractmethod
    def derive(
        self, r2: observations.FloatArray, weights: observations.FloatArray
    ) -> tuple[float, ...]:
        """Turn a tile of squared scaled distances into weight times −2 dk/dr², in place.

        That is what (x_d − x'_d)²/l_d² has to be weighed by for the derivative with respect to
        log l_d. Returns the weighted sums of the derivatives for the logs of the variance and of
        the hyperparameters after the length scales.
        """

    # -- the contract -----------------------------------------------------------------------

    def fill(
        self, x: observations.FloatArray, y: observations.FloatArray, out: observations.FloatArray
    ) -> None:
        """See `Kernel.fill`."""
        squared_distances(x, y, self._columns, self._rates, out)
        self.correlate(out)

    def derivatives(
        self,
        x: observations.FloatArray,
        y: observations.FloatArray,
        weights: observations.FloatArray,
    ) -> observations.FloatArray:
        """See `Leaf.derivatives`."""
        r2 = np.empty_like(weights)
        squared_distances(x, y, self._columns, self._rates, r2)
        variance, *further = self.derive(r2, weights)
        scales = weighted_square_differences(x, y, self._columns, self._rates, r2)
        if len(self.length_scales) == 1:
            scales = scales.sum(keepdims=True)
        return np.array([variance, *scales, *further])

    def prior_variance(self, x: observations.FloatArray) -> observations.FloatArray:
        """See `Kernel.prior_variance`."""
        return np.full(len(x), self.variance)

    @cached_property
    def _columns(self) -> observations.IntArray:
        return np.array(self.dims, dtype=np.int64)

    @cached_property
    def _rates(self) -> observations.FloatArray:
        """One over the length scale of each column."""
        return np.full(len(self.dims), 1.0 / np.array(self.length_scales))


@register_kernel
@dataclass(frozen=True, kw_only=True)
class SquaredExponential(Stationary):
    """Squared exponential kernel, sigma² exp(−r²/2), Eq. 22 of the paper.

    The form printed under Eq. 18, sigma² exp(−(x−x')²/l²), is this kernel with a length scale of
    l/√2. The hyperparameters of Table 8 belong to `Exponential` instead.
    """

    type_name: ClassVar[str] = "squared_exponential"

    def correlate(self, r2: observations.FloatArray) -> None:
        """See `Stationary.correlate`."""
        loops.correlate_squared_exponential(r2, self.variance)

    def derive(
        self, r2: observations.FloatArray, weights: observations.FloatArray
    ) -> tuple[float, ...]:
        """See `Stationary.derive`."""
        return (loops.derive_squared_exponential(r2, weights, self.variance),)


@register_kernel
@dataclass(frozen=True, kw_only=True)
class Exponential(Stationary):
    """Exponential kernel, sigma² exp(−r), also known as Matérn ½.

    This is what the authors' software calls the exponential kernel, and what the length scales
    of their Table 8 fit: with sigma² = 1.14e6 and l = 5.45e5 it varies by 20 ms over 100 mm,
    the squared form printed under Eq. 18 by 0.3 ms. `SquaredExponential` is the squared form.
    """

    type_name: ClassVar[str] = "exponential"

    def correlate(self, r2: observations.FloatArray) -> None:
        """See `Stationary.correlate`."""
        loops.correlate_exponential(r2, self.variance)

    def derive(
        self, r2: observations.FloatArray, weights: observations.FloatArray
    ) -> tuple[float, ...]:
        """See `Stationary.derive`."""
        return (loops.derive_exponential(r2, weights, self.variance),)


@register_kernel
@dataclass(frozen=True, kw_only=True)
class Matern32(Stationary):
    """Matérn kernel of smoothness 3/2, sigma² (1 + √3 r) exp(−√3 r)."""

    type_name: ClassVar[str] = "matern32"

    def correlate(self, r2: observations.FloatArray) -> None:
        """See `Stationary.correlate`."""
        loops.correlate_matern32(r2, self.variance)

    def derive(
        self, r2: observations.FloatArray, weights: observations.FloatArray
    ) -> tuple[float, ...]:
        """See `Stationary.derive`."""
        return (loops.derive_matern32(r2, weights, self.variance),)


@register_kernel
@dataclass(frozen=True, kw_only=True)
class Matern52(Stationary):
    """Matérn kernel of smoothness 5/2, sigma² (1 + √5 r + 5r²/3) exp(−√5 r)."""

    type_name: ClassVar[str] = "matern52"

    def correlate(self, r2: observations.FloatArray) -> None:
        """See `Stationary.correlate`."""
        loops.correlate_matern52(r2, self.variance)

    def derive(
        self, r2: observations.FloatArray, weights: observations.FloatArray
    ) -> tuple[float, ...]:
        """See `Stationary.derive`."""
        return (loops.derive_matern52(r2, weights, self.variance),)


@register_kernel
@dataclass(frozen=True, kw_only=True)
class RationalQuadratic(Stationary):
    """Rational quadratic kernel, sigma² (1 + r²/(2 alpha))^(−alpha), Eq. 23 of the paper.

    Attributes
    ----------
    variance : float
        sigma², in squared units of the target.
    length_scales : tuple of float
        One for all `dims`, or one for each of them. GPy's length scales are larger by
        √alpha: see `gpy_length_scale`.
    alpha : float
        Weighs long against short distances; the kernel nears `SquaredExponential` as it grows.
    dims : tuple of int
        Columns of the inputs that the kernel reads, counted from 0.
    fixed : tuple of str
        Names of fields that fitting leaves alone.
    """

    alpha: float
    type_name: ClassVar[str] = "rational_quadratic"
    quantities = MappingProxyType({**Stationary.quantities, "alpha": Quantity.ALPHA})

    def correlate(self, r2: observations.FloatArray) -> None:
        """See `Stationary.correlate`."""
        loops.correlate_rational_quadratic(r2, self.variance, self.alpha)

    def derive(
        self, r2: observations.FloatArray, weights: observations.FloatArray
    ) -> tuple[float, ...]:
        """See `Stationary.derive`."""
        variance, alpha = loops.derive_rational_quadratic(r2, weights, self.variance, self.alpha)
        return variance, alpha


def gpy_length_scale(length_scale: float, *, alpha: float) -> float:
    """Length scale under which GPy's ``RatQuad`` equals `RationalQuadratic`.

    GPy writes sigma² (1 + r²/2)^(−alpha), which lacks Eq. 23's alpha in the denominator, so that
    l_GPy = l √alpha. The length scales in Table 8 of the paper are GPy's.

    Parameters
    ----------
    length_scale : float
        l of Eq. 23, in the unit of the column.
    alpha : float
        alpha of Eq. 23, ``power`` in GPy.
    """
    observations.check_positive((length_scale, alpha), name="length_scale and alpha")
    return length_scale * math.sqrt(alpha)
