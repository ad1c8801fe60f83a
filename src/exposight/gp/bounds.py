"""How large hyperparameters may become, and where a fit begins, measured by the data."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from typing import TypeAlias

import numpy as np

from exposight.errors import InputError
from exposight.gp.kernels import Kernel, Parameter, Product, Quantity, Sum
from exposight.gp.observations import FloatArray

Limits: TypeAlias = tuple[float, float]

NOISE_VARIANCE = "noise_variance"

_VARIANCES = (Quantity.VARIANCE, Quantity.SLOPE_VARIANCE)


@dataclass(frozen=True, kw_only=True)
class DataScale:
    """The sizes by which hyperparameters are measured.

    Attributes
    ----------
    target : float
        Mean square of the targets: the prior's mean is zero, so this and not their variance is
        what the kernel has to account for.
    column_std : (D,) array
        Standard deviation of each column of the inputs; 1 where a column is constant.
    column_mean_square : (D,) array
        Mean square of each column of the inputs; 1 where a column is zero.
    """

    target: float
    column_std: FloatArray
    column_mean_square: FloatArray

    @classmethod
    def of(cls, x: FloatArray, y: FloatArray) -> "DataScale":
        """Measure checked observations, (n, D) inputs and (n,) targets."""
        std, mean_square = x.std(axis=0), np.mean(x**2, axis=0)
        return cls(
            target=float(np.mean(y**2)) or 1.0,
            column_std=np.where(std > 0.0, std, 1.0),
            column_mean_square=np.where(mean_square > 0.0, mean_square, 1.0),
        )


@dataclass(frozen=True, kw_only=True)
class Bounds:
    """Limits of the hyperparameters during a fit.

    All but `alpha` and `named` are multiples of the data's own scale, so that the same bounds do
    for grey levels and for millimetres. On smooth data the exponential kernel's noise tends to 0
    and its variance and length scales grow together; the noise floor and the upper limits end
    that.

    Attributes
    ----------
    variance : (low, high)
        Times the mean square of the targets.
    length_scale : (low, high)
        Times the standard deviation of the column; of the narrowest and the widest column for a
        length scale that several share.
    alpha : (low, high)
        As it is. Table 8 of the paper goes down to 0.004.
    slope_variance : (low, high)
        Times the mean square of the targets over that of the column.
    noise_variance : (low, high)
        Times the mean square of the targets.
    named : mapping of str to (low, high)
        Limits in the hyperparameter's own unit that replace those above, by the name in
        `Kernel.parameters`, or ``"noise_variance"``. Equal limits hold a value fixed.

    Raises
    ------
    InputError
        If limits are not positive, finite and in order.
    """

    variance: Limits = (1e-4, 1e4)
    length_scale: Limits = (1e-3, 1e4)
    alpha: Limits = (1e-3, 1e3)
    slope_variance: Limits = (1e-8, 1e4)
    noise_variance: Limits = (1e-6, 1e1)
    named: Mapping[str, Limits] = field(default_factory=dict)

    def __post_init__(self) -> None:
        every = {
            bound.name: getattr(self, bound.name) for bound in fields(self) if bound.name != "named"
        }
        for name, limits in {**every, **self.named}.items():
            low, high = limits
            if not (0.0 < low <= high and math.isfinite(high)):
                msg = f"bounds of {name} must be 0 < low <= high, both finite, got {limits}"
                raise InputError(msg)

    def log_limits(self, kernel: Kernel, scale: DataScale) -> FloatArray:
        """Limits of the logarithms of the free hyperparameters, then of the noise variance.

        Returns
        -------
        (p + 1, 2) array
            Natural logarithms of low and high, in the order of `Kernel.log_parameters`.

        Raises
        ------
        InputError
            If `named` holds a name that the kernel's free hyperparameters do not.
        """
        free = kernel.free_parameters
        known = [*(parameter.name for parameter in free), NOISE_VARIANCE]
        if unknown := sorted(set(self.named) - set(known)):
            msg = f"bounds are given for {unknown}, but the free hyperparameters are {known}"
            raise InputError(msg)
        limits = [self._limits(parameter, scale) for parameter in free]
        limits.append(
            (self.noise_variance[0] * scale.target, self.noise_variance[1] * scale.target)
        )
        return np.log(
            [self.named.get(name, usual) for name, usual in zip(known, limits, strict=True)]
        )

    def _limits(self, parameter: Parameter, scale: DataScale) -> Limits:
        columns = list(parameter.dims)
        match parameter.quantity:
            case Quantity.VARIANCE:
                low = high = scale.target
            case Quantity.LENGTH_SCALE:
                low = float(scale.column_std[columns].min())
                high = float(scale.column_std[columns].max())
            case Quantity.ALPHA:
                low = high = 1.0
            case Quantity.SLOPE_VARIANCE:
                low = high = scale.target / float(scale.column_mean_square[columns].mean())
        factor: Limits = getattr(self, parameter.quantity.value)
        return factor[0] * low, factor[1] * high


def starting_values(kernel: Kernel, scale: DataScale) -> FloatArray:
    """Plausible hyperparameters for observations of a given scale.

    Parameters
    ----------
    kernel : Kernel
        Its form counts, not its values.
    scale : DataScale
        Of the observations.

    Returns
    -------
    (p,) array
        Natural logarithms, ordered as `Kernel.log_parameters`: prior variance as large as the
        targets, typical pairs one to two length scales apart.
    """
    return np.log(_starts(kernel, scale.target, scale))


def _starts(kernel: Kernel, variance: float, scale: DataScale) -> list[float]:
    """Start values of the free hyperparameters of a kernel that is to have this variance."""
    if isinstance(kernel, Sum):
        share = variance / len(kernel.terms)
        return [start for term in kernel.terms for start in _starts(term, share, scale)]
    if isinstance(kernel, Product):
        starts: list[float] = []
        remaining = variance
        for factor in kernel.factors:
            starts += _starts(factor, remaining, scale)
            if any(each.quantity in _VARIANCES for each in factor.free_parameters):
                remaining = 1.0
        return starts
    columns = list(kernel.columns)
    starts = []
    for parameter in kernel.free_parameters:
        match parameter.quantity:
            case Quantity.VARIANCE:
                starts.append(variance)
            case Quantity.LENGTH_SCALE:
                spread = float(np.mean(scale.column_std[list(parameter.dims)] ** 2))
                starts.append(math.sqrt(len(columns) * spread))
            case Quantity.ALPHA:
                starts.append(1.0)
            case Quantity.SLOPE_VARIANCE:
                size = float(scale.column_mean_square[list(parameter.dims)].mean())
                starts.append(variance / (len(columns) * size))
    return starts
