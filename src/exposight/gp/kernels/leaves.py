"""Kernels of no distance, and kernels of every kind read back from descriptions."""

import math
from collections.abc import Mapping
from dataclasses import MISSING, dataclass, fields, replace
from functools import cached_property
from typing import Any, ClassVar, Self

import numpy as np

from exposight.errors import InputError
from exposight.gp import observations
from exposight.gp.kernels import stationary
from exposight.gp.kernels.base import Kernel, Leaf, Parameter, Product, Quantity, Sum
from exposight.gp.kernels.loops import (
    close_between_categories,
    close_outside,
    sum_within_categories,
)


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

    def __post_init__(self) -> None:
        dims = observations.check_dims(self.dims, kernel="Linear")
        variances = observations.check_positive(self.variances, name="Linear.variances")
        if len(variances) != len(dims):
            msg = (
                f"Linear over {len(dims)} dimensions takes as many variances, got {len(variances)}"
            )
            raise InputError(msg)
        object.__setattr__(self, "dims", dims)
        object.__setattr__(self, "variances", variances)
        object.__setattr__(
            self,
            "fixed",
            observations.check_fixed(self.fixed, allowed=("variances",), kernel="Linear"),
        )

    @property
    def columns(self) -> tuple[int, ...]:
        """Columns of the inputs that this kernel reads."""
        return self.dims

    @property
    def hyperparameters(self) -> tuple[Parameter, ...]:
        """One variance a dimension."""
        return tuple(
            Parameter(
                name=f"variance[{dim}]",
                value=variance,
                quantity=Quantity.SLOPE_VARIANCE,
                dims=(dim,),
                free="variances" not in self.fixed,
            )
            for dim, variance in zip(self.dims, self.variances, strict=True)
        )

    def to_dict(self) -> dict[str, Any]:
        """Describe the kernel with what JSON can hold; `kernel_from_dict` reads it back."""
        return {
            "type": self.type_name,
            "variances": list(self.variances),
            "dims": list(self.dims),
            "fixed": list(self.fixed),
        }

    def _with_values(self, values: tuple[float, ...]) -> Self:
        return replace(self, variances=values)

    def fill(
        self, x: observations.FloatArray, y: observations.FloatArray, out: observations.FloatArray
    ) -> None:
        """See `Kernel.fill`."""
        np.matmul(x[:, self.dims] * np.array(self.variances), y[:, self.dims].T, out=out)

    def weigh(
        self,
        x: observations.FloatArray,
        y: observations.FloatArray,
        weights: observations.FloatArray,
    ) -> observations.FloatArray:
        """See `Kernel.weigh`."""
        products = np.sum(x[:, self.dims] * (weights @ y[:, self.dims]), axis=0)
        out: observations.FloatArray = (products * np.array(self.variances))[self._free]
        return out

    def prior_variance(self, x: observations.FloatArray) -> observations.FloatArray:
        """See `Kernel.prior_variance`."""
        out: observations.FloatArray = x[:, self.dims] ** 2 @ np.array(self.variances)
        return out


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
        (dim,) = observations.check_dims((self.dim,), kernel="ChangePoint")
        object.__setattr__(self, "dim", dim)
        limits = [limit for limit in (self.minimum, self.maximum) if limit is not None]
        if not limits or not all(math.isfinite(limit) for limit in limits):
            msg = f"ChangePoint takes a finite minimum, maximum or both, got {limits}"
            raise InputError(msg)
        if len(limits) == 2 and limits[0] >= limits[1]:
            msg = f"ChangePoint's minimum must lie below its maximum, got {limits}"
            raise InputError(msg)

    @property
    def columns(self) -> tuple[int, ...]:
        """Columns of the inputs that this kernel reads."""
        return (self.dim,)

    @property
    def hyperparameters(self) -> tuple[Parameter, ...]:
        """None."""
        return ()

    def to_dict(self) -> dict[str, Any]:
        """Describe the kernel with what JSON can hold; `kernel_from_dict` reads it back."""
        return {
            "type": self.type_name,
            "dim": self.dim,
            "minimum": self.minimum,
            "maximum": self.maximum,
        }

    def _with_values(self, values: tuple[float, ...]) -> Self:
        del values
        return self

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

    def weigh(
        self,
        x: observations.FloatArray,
        y: observations.FloatArray,
        weights: observations.FloatArray,
    ) -> observations.FloatArray:
        """See `Kernel.weigh`: there is nothing to differentiate."""
        del x, y, weights
        return np.empty(0)

    def prior_variance(self, x: observations.FloatArray) -> observations.FloatArray:
        """See `Kernel.prior_variance`."""
        return (~self.closed(x)).astype(np.float64)


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

    def __post_init__(self) -> None:
        (dim,) = observations.check_dims((self.dim,), kernel="Category")
        (variance,) = observations.check_positive((self.variance,), name="Category.variance")
        fixed = observations.check_fixed(self.fixed, allowed=("variance",), kernel="Category")
        object.__setattr__(self, "dim", dim)
        object.__setattr__(self, "variance", variance)
        object.__setattr__(self, "fixed", fixed)

    @property
    def columns(self) -> tuple[int, ...]:
        """Columns of the inputs that this kernel reads."""
        return (self.dim,)

    @property
    def hyperparameters(self) -> tuple[Parameter, ...]:
        """The variance."""
        return (
            Parameter(
                name="variance",
                value=self.variance,
                quantity=Quantity.VARIANCE,
                dims=(self.dim,),
                free="variance" not in self.fixed,
            ),
        )

    def to_dict(self) -> dict[str, Any]:
        """Describe the kernel with what JSON can hold; `kernel_from_dict` reads it back."""
        return {
            "type": self.type_name,
            "variance": self.variance,
            "dim": self.dim,
            "fixed": list(self.fixed),
        }

    def _with_values(self, values: tuple[float, ...]) -> Self:
        return replace(self, variance=values[0])

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

    def weigh(
        self,
        x: observations.FloatArray,
        y: observations.FloatArray,
        weights: observations.FloatArray,
    ) -> observations.FloatArray:
        """See `Kernel.weigh`."""
        derivative = self.variance * sum_within_categories(x, y, self.dim, weights)
        return np.array([derivative])[self._free]

    def prior_variance(self, x: observations.FloatArray) -> observations.FloatArray:
        """See `Kernel.prior_variance`."""
        return np.full(len(x), self.variance)


_KINDS: dict[str, type[Kernel]] = {
    kind.type_name: kind
    for kind in (
        Category,
        ChangePoint,
        stationary.Exponential,
        Linear,
        stationary.Matern32,
        stationary.Matern52,
        Product,
        stationary.RationalQuadratic,
        stationary.SquaredExponential,
        Sum,
    )
}


def kernel_from_dict(description: Mapping[str, Any]) -> Kernel:
    """Build the kernel that `Kernel.to_dict` described.

    Parameters
    ----------
    description : mapping
        ``type`` and the fields of the kernel; ``factors`` or ``terms`` hold descriptions.

    Raises
    ------
    InputError
        If the type is unknown, a key is missing or unexpected, or a value cannot be right.
    """
    if not isinstance(description, Mapping):
        msg = f"a kernel is described by a mapping, got {type(description).__name__}"
        raise InputError(msg)
    if "type" not in description:
        msg = f"a kernel's description needs the key 'type', got {sorted(description)}"
        raise InputError(msg)
    name = description["type"]
    kind = _KINDS.get(name) if isinstance(name, str) else None
    if kind is None:
        msg = (
            f"unknown kernel type {name!r}; this version of exposight knows "
            f"{', '.join(sorted(_KINDS))}. A newer version may have written it"
        )
        raise InputError(msg)
    values = {key: value for key, value in description.items() if key != "type"}
    _check_keys(values, kind)
    if issubclass(kind, Product | Sum):
        (key,) = values
        values = {key: _children(values[key], f"{key} of a {name}")}
    return kind(**values)


def _check_keys(values: dict[str, Any], kind: type[Kernel]) -> None:
    known = fields(kind)  # type: ignore[arg-type]  # every kind is a dataclass
    allowed = {field.name for field in known}
    missing = {field.name for field in known if field.default is MISSING} - set(values)
    unexpected = set(values) - allowed
    if missing or unexpected:
        msg = (
            f"the description of a kernel of type {kind.type_name!r} "
            f"lacks {sorted(missing)} and has the unexpected {sorted(unexpected)}; "
            f"it holds {sorted(allowed)}"
        )
        raise InputError(msg)


def _children(descriptions: object, name: str) -> tuple[Kernel, ...]:
    if not isinstance(descriptions, list | tuple):
        msg = f"{name} must be a list of kernels, got {descriptions!r}"
        raise InputError(msg)
    return tuple(kernel_from_dict(child) for child in descriptions)
