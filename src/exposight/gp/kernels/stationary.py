"""Kernels of the scaled distance r, r² = sum_d (x_d − x'_d)² / l_d²."""

import math
from abc import abstractmethod
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, ClassVar, Self

import numpy as np

from exposight.errors import InputError
from exposight.gp import observations
from exposight.gp.kernels import loops
from exposight.gp.kernels.base import Leaf, Parameter, Quantity
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

    def __post_init__(self) -> None:
        name = type(self).__name__
        dims = observations.check_dims(self.dims, kernel=name)
        scales = observations.check_positive(self.length_scales, name=f"{name}.length_scales")
        if len(scales) not in (1, len(dims)):
            msg = (
                f"{name} over {len(dims)} dimensions takes 1 length scale or {len(dims)}, "
                f"got {len(scales)}"
            )
            raise InputError(msg)
        (variance,) = observations.check_positive((self.variance,), name=f"{name}.variance")
        object.__setattr__(self, "dims", dims)
        object.__setattr__(self, "length_scales", scales)
        object.__setattr__(self, "variance", variance)
        object.__setattr__(
            self, "fixed", observations.check_fixed(self.fixed, allowed=self._fields(), kernel=name)
        )

    # -- the shape of the kernel as a function of r² ----------------------------------------

    @abstractmethod
    def _correlate(self, r2: observations.FloatArray) -> None:
        """Turn a tile of squared scaled distances into covariances, in place."""

    @abstractmethod
    def _derive(
        self, r2: observations.FloatArray, weights: observations.FloatArray
    ) -> tuple[float, ...]:
        """Turn a tile of squared scaled distances into weight times −2 dk/dr², in place.

        That is what (x_d − x'_d)²/l_d² has to be weighed by for the derivative with respect to
        log l_d. Returns the weighted sums of the derivatives for the logs of the variance and of
        the hyperparameters after the length scales.
        """

    @classmethod
    def _fields(cls) -> tuple[str, ...]:
        """Names of the fields that hold hyperparameters, in order."""
        return ("variance", "length_scales")

    # -- the contract -----------------------------------------------------------------------

    @property
    def columns(self) -> tuple[int, ...]:
        """Columns of the inputs that this kernel reads."""
        return self.dims

    @property
    def hyperparameters(self) -> tuple[Parameter, ...]:
        """The variance, then the length scales."""
        free = "length_scales" not in self.fixed
        scales: list[tuple[str, float, tuple[int, ...]]]
        if len(self.length_scales) > 1:
            scales = [
                (f"length_scale[{dim}]", scale, (dim,))
                for dim, scale in zip(self.dims, self.length_scales, strict=True)
            ]
        else:
            scales = [("length_scale", self.length_scales[0], self.dims)]
        return (
            Parameter(
                name="variance",
                value=self.variance,
                quantity=Quantity.VARIANCE,
                dims=self.dims,
                free="variance" not in self.fixed,
            ),
            *(
                Parameter(
                    name=name, value=value, quantity=Quantity.LENGTH_SCALE, dims=dims, free=free
                )
                for name, value, dims in scales
            ),
        )

    def to_dict(self) -> dict[str, Any]:
        """Describe the kernel with what JSON can hold; `kernel_from_dict` reads it back."""
        return {
            "type": self.type_name,
            "variance": self.variance,
            "length_scales": list(self.length_scales),
            "dims": list(self.dims),
            "fixed": list(self.fixed),
        }

    def _with_values(self, values: tuple[float, ...]) -> Self:
        return replace(self, variance=values[0], length_scales=values[1:])

    def fill(
        self, x: observations.FloatArray, y: observations.FloatArray, out: observations.FloatArray
    ) -> None:
        """See `Kernel.fill`."""
        squared_distances(x, y, self._columns, self._rates, out)
        self._correlate(out)

    def weigh(
        self,
        x: observations.FloatArray,
        y: observations.FloatArray,
        weights: observations.FloatArray,
    ) -> observations.FloatArray:
        """See `Kernel.weigh`."""
        r2 = np.empty_like(weights)
        squared_distances(x, y, self._columns, self._rates, r2)
        variance, *further = self._derive(r2, weights)
        scales = weighted_square_differences(x, y, self._columns, self._rates, r2)
        if len(self.length_scales) == 1:
            scales = scales.sum(keepdims=True)
        out: observations.FloatArray = np.array([variance, *scales, *further])[self._free]
        return out

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


@dataclass(frozen=True, kw_only=True)
class SquaredExponential(Stationary):
    """Squared exponential kernel, sigma² exp(−r²/2), Eq. 22 of the paper.

    The form printed under Eq. 18, sigma² exp(−(x−x')²/l²), is this kernel with a length scale of
    l/√2. The hyperparameters of Table 8 belong to `Exponential` instead.
    """

    type_name: ClassVar[str] = "squared_exponential"

    def _correlate(self, r2: observations.FloatArray) -> None:
        loops.correlate_squared_exponential(r2, self.variance)

    def _derive(
        self, r2: observations.FloatArray, weights: observations.FloatArray
    ) -> tuple[float, ...]:
        return (loops.derive_squared_exponential(r2, weights, self.variance),)


@dataclass(frozen=True, kw_only=True)
class Exponential(Stationary):
    """Exponential kernel, sigma² exp(−r), also known as Matérn ½.

    This is what the authors' software calls the exponential kernel, and what the length scales
    of their Table 8 fit: with sigma² = 1.14e6 and l = 5.45e5 it varies by 20 ms over 100 mm,
    the squared form printed under Eq. 18 by 0.3 ms. `SquaredExponential` is the squared form.
    """

    type_name: ClassVar[str] = "exponential"

    def _correlate(self, r2: observations.FloatArray) -> None:
        loops.correlate_exponential(r2, self.variance)

    def _derive(
        self, r2: observations.FloatArray, weights: observations.FloatArray
    ) -> tuple[float, ...]:
        return (loops.derive_exponential(r2, weights, self.variance),)


@dataclass(frozen=True, kw_only=True)
class Matern32(Stationary):
    """Matérn kernel of smoothness 3/2, sigma² (1 + √3 r) exp(−√3 r)."""

    type_name: ClassVar[str] = "matern32"

    def _correlate(self, r2: observations.FloatArray) -> None:
        loops.correlate_matern32(r2, self.variance)

    def _derive(
        self, r2: observations.FloatArray, weights: observations.FloatArray
    ) -> tuple[float, ...]:
        return (loops.derive_matern32(r2, weights, self.variance),)


@dataclass(frozen=True, kw_only=True)
class Matern52(Stationary):
    """Matérn kernel of smoothness 5/2, sigma² (1 + √5 r + 5r²/3) exp(−√5 r)."""

    type_name: ClassVar[str] = "matern52"

    def _correlate(self, r2: observations.FloatArray) -> None:
        loops.correlate_matern52(r2, self.variance)

    def _derive(
        self, r2: observations.FloatArray, weights: observations.FloatArray
    ) -> tuple[float, ...]:
        return (loops.derive_matern52(r2, weights, self.variance),)


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

    def __post_init__(self) -> None:
        super().__post_init__()
        (alpha,) = observations.check_positive((self.alpha,), name="RationalQuadratic.alpha")
        object.__setattr__(self, "alpha", alpha)

    @classmethod
    def _fields(cls) -> tuple[str, ...]:
        return (*super()._fields(), "alpha")

    @property
    def hyperparameters(self) -> tuple[Parameter, ...]:
        """The variance, the length scales, then alpha."""
        return (
            *super().hyperparameters,
            Parameter(
                name="alpha",
                value=self.alpha,
                quantity=Quantity.ALPHA,
                dims=self.dims,
                free="alpha" not in self.fixed,
            ),
        )

    def to_dict(self) -> dict[str, Any]:
        """Describe the kernel with what JSON can hold; `kernel_from_dict` reads it back."""
        return {**super().to_dict(), "alpha": self.alpha}

    def _with_values(self, values: tuple[float, ...]) -> Self:
        return replace(self, variance=values[0], length_scales=values[1:-1], alpha=values[-1])

    def _correlate(self, r2: observations.FloatArray) -> None:
        loops.correlate_rational_quadratic(r2, self.variance, self.alpha)

    def _derive(
        self, r2: observations.FloatArray, weights: observations.FloatArray
    ) -> tuple[float, ...]:
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
