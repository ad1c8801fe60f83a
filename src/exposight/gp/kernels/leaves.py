"""The base of kernels that are not composed, and those of them that know no distance."""

import math
from abc import abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from types import MappingProxyType
from typing import Any, ClassVar, Self

import numpy as np

from exposight.errors import InputError
from exposight.gp import observations
from exposight.gp.kernels.base import Kernel, Parameter, Quantity
from exposight.gp.kernels.descriptions import register_kernel
from exposight.gp.kernels.loops import (
    close_between_categories,
    close_outside,
    sum_within_categories,
)


class Leaf(Kernel):
    """A kernel that is not composed of others: a frozen dataclass, registered by `register_kernel`.

    It has a `type_name`, a field `dims` or `dim` for the columns that it reads, and the methods
    `fill`, `derivatives` and `prior_variance`. Checks, names, limits and files follow from its
    fields and `quantities`.

    Attributes
    ----------
    quantities : mapping of str to Quantity
        Names of the fields that hold hyperparameters, and what these measure. A field holds one
        number, or a tuple of one for each of `dims`, or of one for all.
    fixed : tuple of str
        Which of these fields fitting leaves alone; a field too, where that may be chosen.
    """

    quantities: ClassVar[Mapping[str, Quantity]] = MappingProxyType({})
    fixed: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        kernel = type(self).__name__
        dims = observations.check_dims(self.columns, kernel=kernel)
        if "dims" in vars(self):
            object.__setattr__(self, "dims", dims)
        for name in self.quantities:
            value = getattr(self, name)
            checked = observations.check_positive(value, name=f"{kernel}.{name}")
            object.__setattr__(self, name, checked if np.ndim(value) else checked[0])
        allowed = tuple(self.quantities)
        fixed = observations.check_fixed(self.fixed, allowed=allowed, kernel=kernel)
        object.__setattr__(self, "fixed", fixed)

    @property
    def columns(self) -> tuple[int, ...]:
        """Columns of the inputs that this kernel reads: its field `dims`, or `dim`."""
        values = vars(self)
        dims: tuple[int, ...] = values["dims"] if "dims" in values else (values["dim"],)
        return dims

    @abstractmethod
    def derivatives(
        self,
        x: observations.FloatArray,
        y: observations.FloatArray,
        weights: observations.FloatArray,
    ) -> observations.FloatArray:
        """Sum the weighted derivatives of a tile for all hyperparameters, fixed ones included.

        Arguments and result are those of `Kernel.weigh`, in the order of `hyperparameters`.
        """

    @property
    def hyperparameters(self) -> tuple[Parameter, ...]:
        """The kernel's hyperparameters, named without the kernel's name."""
        parameters: list[Parameter] = []
        for name, quantity in self.quantities.items():
            value = getattr(self, name)
            values = value if isinstance(value, tuple) else (value,)
            short = name.removesuffix("s") if isinstance(value, tuple) else name
            several = len(values) > 1
            parameters += [
                Parameter(
                    name=f"{short}[{dims[0]}]" if several else short,
                    value=each,
                    quantity=quantity,
                    dims=dims,
                    free=name not in self.fixed,
                )
                for each, dims in zip(
                    values,
                    ((dim,) for dim in self.columns) if several else (self.columns,),
                    strict=True,
                )
            ]
        return tuple(parameters)

    def _with_logs(self, logs: observations.FloatArray) -> Self:
        values = iter(np.exp(logs).tolist())
        changes: dict[str, Any] = {}
        for name in self.quantities:
            value = getattr(self, name)
            if name not in self.fixed:
                several = isinstance(value, tuple)
                changes[name] = tuple(next(values) for _ in value) if several else next(values)
        return replace(self, **changes)  # type: ignore[type-var]  # a dataclass

    def leaves(self) -> tuple[tuple[str, tuple[Parameter, ...]], ...]:
        """See `Kernel.leaves`."""
        return ((self.type_name, self.hyperparameters),)

    def weigh(
        self,
        x: observations.FloatArray,
        y: observations.FloatArray,
        weights: observations.FloatArray,
    ) -> observations.FloatArray:
        """See `Kernel.weigh`."""
        return self.derivatives(x, y, weights)[self._free]

    def closed(self, x: observations.FloatArray) -> observations.BoolArray:
        """See `Kernel.gate`."""
        return np.zeros(len(x), dtype=np.bool_)

    @cached_property
    def _free(self) -> observations.BoolArray:
        return np.array([parameter.free for parameter in self.hyperparameters], dtype=np.bool_)


@register_kernel
@dataclass(frozen=True, kw_only=True)
class Linear(Leaf):
    """Linear kernel, sum_d sigma_d² x_d x'_d: linear regression through the origin.

    Attributes
    ----------
    variances : tuple of float
        sigma_d², one for each of `dims`, in squared units of target over column; Table 8 of the
        paper lists them for its linear model.
    dims : tuple of int
        Columns of the inputs that the kernel reads, counted from 0.
    fixed : tuple of str
        Names of fields that fitting leaves alone, such as ``("variances",)``.

    Raises
    ------
    InputError
        If a variance is not positive and finite, their number does not match the dimensions, or
        a field to fix does not exist.
    """

    variances: tuple[float, ...]
    dims: tuple[int, ...]
    fixed: tuple[str, ...] = ()
    type_name: ClassVar[str] = "linear"
    quantities = MappingProxyType({"variances": Quantity.SLOPE_VARIANCE})

    def __post_init__(self) -> None:
        super().__post_init__()
        variances = tuple(np.atleast_1d(self.variances).tolist())
        if len(variances) != len(self.dims):
            msg = (
                f"Linear over {len(self.dims)} dimensions takes as many variances, "
                f"got {len(variances)}"
            )
            raise InputError(msg)
        object.__setattr__(self, "variances", variances)

    def fill(
        self, x: observations.FloatArray, y: observations.FloatArray, out: observations.FloatArray
    ) -> None:
        """See `Kernel.fill`."""
        np.matmul(x[:, self.dims] * np.array(self.variances), y[:, self.dims].T, out=out)

    def derivatives(
        self,
        x: observations.FloatArray,
        y: observations.FloatArray,
        weights: observations.FloatArray,
    ) -> observations.FloatArray:
        """See `Leaf.derivatives`."""
        products = np.sum(x[:, self.dims] * (weights @ y[:, self.dims]), axis=0)
        out: observations.FloatArray = products * np.array(self.variances)
        return out

    def prior_variance(self, x: observations.FloatArray) -> observations.FloatArray:
        """See `Kernel.prior_variance`."""
        out: observations.FloatArray = x[:, self.dims] ** 2 @ np.array(self.variances)
        return out


@register_kernel
@dataclass(frozen=True, kw_only=True)
class ChangePoint(Leaf):
    """Change point kernel of Eq. 9 of the paper: 1 where both inputs are in range, else 0.

    Multiplied into a kernel it makes the prior, hence the prediction, exactly 0 outside the
    range. The limits belong to the range. It has no hyperparameters.

    Attributes
    ----------
    dim : int
        Column of the inputs that is compared with the limits, counted from 0.
    minimum, maximum : float, optional
        Limits in the unit of the column; at least one of them.

    Raises
    ------
    InputError
        If no limit is given, a limit is not finite, or they leave no range.
    """

    dim: int
    minimum: float | None = None
    maximum: float | None = None
    type_name: ClassVar[str] = "change_point"

    def __post_init__(self) -> None:
        super().__post_init__()
        limits = [limit for limit in (self.minimum, self.maximum) if limit is not None]
        if not limits or not all(math.isfinite(limit) for limit in limits):
            msg = f"ChangePoint takes a finite minimum, maximum or both, got {limits}"
            raise InputError(msg)
        if len(limits) == 2 and limits[0] >= limits[1]:
            msg = f"ChangePoint's minimum must lie below its maximum, got {limits}"
            raise InputError(msg)

    @cached_property
    def _limits(self) -> tuple[float, float]:
        low = -math.inf if self.minimum is None else self.minimum
        return low, math.inf if self.maximum is None else self.maximum

    def closed(self, x: observations.FloatArray) -> observations.BoolArray:
        """See `Kernel.gate`."""
        low, high = self._limits
        out: observations.BoolArray = (x[:, self.dim] < low) | (x[:, self.dim] > high)
        return out

    def fill(
        self, x: observations.FloatArray, y: observations.FloatArray, out: observations.FloatArray
    ) -> None:
        """See `Kernel.fill`."""
        out[:] = 1.0
        self.multiply(x, y, out)

    def multiply(
        self, x: observations.FloatArray, y: observations.FloatArray, out: observations.FloatArray
    ) -> None:
        """See `Kernel.multiply`."""
        close_outside(x, y, self.dim, *self._limits, out)

    def derivatives(
        self,
        x: observations.FloatArray,
        y: observations.FloatArray,
        weights: observations.FloatArray,
    ) -> observations.FloatArray:
        """See `Leaf.derivatives`: there are none."""
        del x, y, weights
        return np.empty(0)

    def prior_variance(self, x: observations.FloatArray) -> observations.FloatArray:
        """See `Kernel.prior_variance`."""
        return (~self.closed(x)).astype(np.float64)


@register_kernel
@dataclass(frozen=True, kw_only=True)
class Category(Leaf):
    """An independent effect of each category: variance where x[dim] == x'[dim], else 0.

    A random effect of the features or views that observations belong to. A category that training
    did not hold has the prior's mean, 0, and variance.

    Attributes
    ----------
    variance : float
        Of the effects, in squared units of the target.
    dim : int
        Column of the inputs that holds the category's number, counted from 0; only equal numbers
        are alike, so they should be whole.
    fixed : tuple of str
        ``("variance",)`` if fitting shall leave it alone.

    Raises
    ------
    InputError
        If the variance is not positive and finite, or `dim` or `fixed` cannot be right.
    """

    variance: float
    dim: int
    fixed: tuple[str, ...] = ()
    type_name: ClassVar[str] = "category"
    quantities = MappingProxyType({"variance": Quantity.VARIANCE})

    def fill(
        self, x: observations.FloatArray, y: observations.FloatArray, out: observations.FloatArray
    ) -> None:
        """See `Kernel.fill`."""
        out[:] = 1.0
        self.multiply(x, y, out)

    def multiply(
        self, x: observations.FloatArray, y: observations.FloatArray, out: observations.FloatArray
    ) -> None:
        """See `Kernel.multiply`."""
        close_between_categories(x, y, self.dim, self.variance, out)

    def derivatives(
        self,
        x: observations.FloatArray,
        y: observations.FloatArray,
        weights: observations.FloatArray,
    ) -> observations.FloatArray:
        """See `Leaf.derivatives`."""
        return np.array([self.variance * sum_within_categories(x, y, self.dim, weights)])

    def prior_variance(self, x: observations.FloatArray) -> observations.FloatArray:
        """See `Kernel.prior_variance`."""
        return np.full(len(x), self.variance)
