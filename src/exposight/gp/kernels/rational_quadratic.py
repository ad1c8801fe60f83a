"""The rational quadratic kernel, and GPy's way of writing it."""

import math
from dataclasses import dataclass, replace
from typing import Any, ClassVar, Self

from exposight.gp.kernels import loops
from exposight.gp.kernels.arguments import check_positive
from exposight.gp.kernels.parameters import Parameter, Quantity
from exposight.gp.kernels.stationary import Stationary
from exposight.gp.observations import FloatArray


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
        (alpha,) = check_positive((self.alpha,), what="RationalQuadratic.alpha")
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

    def _correlate(self, r2: FloatArray) -> None:
        loops.correlate_rational_quadratic(r2, self.variance, self.alpha)

    def _derive(self, r2: FloatArray, weights: FloatArray) -> tuple[float, ...]:
        variance, alpha = loops.derive_rational_quadratic(r2, weights, self.variance, self.alpha)
        return variance, alpha


def gpy_length_scale(length_scale: float, *, alpha: float) -> float:
    """Length scale under which GPy's ``RatQuad`` equals `RationalQuadratic`.

    GPy writes sigma² (1 + r²/2)^(−alpha), which lacks Eq. 23's alpha in the denominator, so that
    l_GPy = l √alpha.

    Parameters
    ----------
    length_scale : float
        l of Eq. 23, in the unit of the column.
    alpha : float
        alpha of Eq. 23, ``power`` in GPy.

    Returns
    -------
    float
        In the unit of the column.

    Raises
    ------
    InputError
        If a value is not positive and finite.
    """
    check_positive((length_scale, alpha), what="length_scale and alpha")
    return length_scale * math.sqrt(alpha)


def length_scale_from_gpy(gpy_length_scale: float, *, alpha: float) -> float:
    """Length scale of `RationalQuadratic` that equals one of GPy's ``RatQuad``.

    The inverse of `gpy_length_scale`: l = l_GPy / √alpha. The length scales in Table 8 of the
    paper are GPy's.

    Parameters
    ----------
    gpy_length_scale : float
        In the unit of the column.
    alpha : float
        alpha of Eq. 23, ``power`` in GPy.

    Returns
    -------
    float
        l of Eq. 23, in the unit of the column.

    Raises
    ------
    InputError
        If a value is not positive and finite.
    """
    check_positive((gpy_length_scale, alpha), what="gpy_length_scale and alpha")
    return gpy_length_scale / math.sqrt(alpha)
