"""The contract of a covariance function, and the products and sums of kernels."""

from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, replace
from enum import StrEnum
from functools import cached_property
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import ArrayLike

from exposight.errors import InputError
from exposight.gp.kernels.descriptions import build, describe, register_kernel
from exposight.gp.observations import BoolArray, FloatArray, check_inputs
from exposight.gp.tiling import fill_tiles, tile


class Quantity(StrEnum):
    """What a hyperparameter measures; decides its default bounds and starting value."""

    VARIANCE = "variance"
    LENGTH_SCALE = "length_scale"
    ALPHA = "alpha"
    SLOPE_VARIANCE = "slope_variance"


@dataclass(frozen=True, kw_only=True)
class Parameter:
    """One hyperparameter of a kernel.

    Attributes
    ----------
    name : str
        Unique within its tree: ``rational_quadratic.alpha``, ``exponential_2.length_scale[4]``
        (the number in brackets is the column of the inputs).
    value : float
        Positive; a variance in squared units of the target, a length scale in the unit of its
        column.
    quantity : Quantity
        What it measures.
    dims : tuple of int
        Columns of the inputs that it acts on.
    free : bool
        Whether fitting may change it.
    """

    name: str
    value: float
    quantity: Quantity
    dims: tuple[int, ...]
    free: bool


class Kernel(ABC):
    """A covariance function k(x, x'), immutable, with its derivatives.

    Kernels compose: ``a * b`` and ``a + b`` are kernels. Derivatives are taken with respect to
    the natural logarithms of the free hyperparameters, in the order of `parameters`.

    `fill`, `multiply`, `weigh`, `prior_variance` and `closed` are for inner loops: they take
    checked inputs in C order. The first three work on one tile of the covariance matrix, small
    enough for the processor's cache.
    """

    type_name: ClassVar[str]

    @property
    @abstractmethod
    def columns(self) -> tuple[int, ...]:
        """Columns of the inputs that the kernel reads, ascending for a tree."""

    @abstractmethod
    def leaves(self) -> tuple[tuple[str, tuple[Parameter, ...]], ...]:
        """Type name and hyperparameters of each leaf of the tree, from left to right."""

    @abstractmethod
    def _with_logs(self, logs: FloatArray) -> Self:
        """Do the work of `with_log_parameters`."""

    def to_dict(self) -> dict[str, Any]:
        """Describe the tree with what JSON can hold; `kernel_from_dict` reads it back.

        Raises
        ------
        InputError
            If a kernel's type is not registered (`register_kernel`), or a field does not fit JSON.
        """
        return describe(self)

    @abstractmethod
    def fill(self, x: FloatArray, y: FloatArray, out: FloatArray) -> None:
        """Write the covariances of (n, D) with (m, D) inputs into `out`, (n, m) in C order."""

    def multiply(self, x: FloatArray, y: FloatArray, out: FloatArray) -> None:
        """Multiply `out`, (n, m) in C order, by the covariances; as `fill`."""
        out *= tile(self, x, y)

    @abstractmethod
    def weigh(self, x: FloatArray, y: FloatArray, weights: FloatArray) -> FloatArray:
        """Sum the weighted derivatives of a tile.

        Parameters
        ----------
        x, y : (n, D) and (m, D) array
            As for `fill`.
        weights : (n, m) array
            W, in C order; may be overwritten.

        Returns
        -------
        (p,) array
            sum_ij W_ij dk(x_i, y_j) / dlog theta for each free hyperparameter.
        """

    @abstractmethod
    def prior_variance(self, x: FloatArray) -> FloatArray:
        """Return the prior variance k(x, x) of each row, in squared target units: (n,), fresh."""

    @abstractmethod
    def closed(self, x: FloatArray) -> BoolArray:
        """Return `gate` for checked inputs: a fresh (n,) array."""

    def value(self, x: ArrayLike, y: ArrayLike) -> FloatArray:
        """Covariance of every row of `x` with every row of `y`.

        Parameters
        ----------
        x, y : (n, D) and (m, D) array
            Inputs, each column in its own unit.

        Returns
        -------
        (n, m) array
            In squared units of the target.

        Raises
        ------
        ObservationError
            If an array is not a finite matrix with the columns that the kernel reads.
        """
        rows = check_inputs(x, dims=self.columns)
        columns = check_inputs(y, name="y", dims=self.columns)
        out = np.empty((len(rows), len(columns)))
        fill_tiles(self, rows, columns, out)
        return out

    def gate(self, x: ArrayLike) -> BoolArray:
        """Rows of (n, D) inputs that the kernel multiplies by zero, whatever its hyperparameters.

        Returns
        -------
        (n,) bool array
            True where k(x, ·) vanishes: there the prior, hence the prediction, is exactly 0.
        """
        return self.closed(check_inputs(x, dims=self.columns))

    def with_log_parameters(self, vector: ArrayLike) -> Self:
        """Return the same kernel with other values of its free hyperparameters.

        Parameters
        ----------
        vector : (p,) array
            Natural logarithms, ordered as `log_parameters`.

        Raises
        ------
        InputError
            If the vector has another length or is not finite.
        """
        logs = np.asarray(vector, dtype=np.float64)
        if logs.shape != (self._free_count,) or not np.isfinite(logs).all():
            names = ", ".join(parameter.name for parameter in self.free_parameters) or "none"
            msg = (
                f"expected {self._free_count} finite logarithms of hyperparameters ({names}), "
                f"got {logs}"
            )
            raise InputError(msg)
        return self._with_logs(logs)

    @cached_property
    def _free_count(self) -> int:
        return sum(parameter.free for _, parameters in self.leaves() for parameter in parameters)

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """All hyperparameters, fixed ones included, from left to right.

        Their names begin with their kernel's; kernels of one type are numbered from 1 where a tree
        holds several.
        """
        leaves = [(kind, parameters) for kind, parameters in self.leaves() if parameters]
        total, counted = Counter(kind for kind, _ in leaves), Counter[str]()
        named: list[Parameter] = []
        for kind, parameters in leaves:
            counted[kind] += 1
            prefix = f"{kind}_{counted[kind]}" if total[kind] > 1 else kind
            named += [replace(each, name=f"{prefix}.{each.name}") for each in parameters]
        return tuple(named)

    @property
    def free_parameters(self) -> tuple[Parameter, ...]:
        """The hyperparameters that fitting may change, ordered as `log_parameters`."""
        return tuple(parameter for parameter in self.parameters if parameter.free)

    @property
    def log_parameters(self) -> FloatArray:
        """Natural logarithms of the free hyperparameters, shape (p,)."""
        return np.log([parameter.value for parameter in self.free_parameters])

    def __mul__(self, other: "Kernel") -> "Product":
        if not isinstance(other, Kernel):
            return NotImplemented
        return Product(factors=(self, other))

    def __add__(self, other: "Kernel") -> "Sum":
        if not isinstance(other, Kernel):
            return NotImplemented
        return Sum(terms=(self, other))


class _Composite(Kernel):
    """A kernel composed of others, which one of its fields holds."""

    _field: ClassVar[str]

    def __post_init__(self) -> None:
        flat: list[Kernel] = []
        for child in self._children:
            if not isinstance(child, Kernel):
                msg = f"{self._field} must be kernels, got {type(child).__name__}"
                raise InputError(msg)
            flat += child._children if isinstance(child, type(self)) else (child,)
        if len(flat) < 2:
            msg = f"at least two {self._field} are needed, got {len(flat)}; use the kernel itself"
            raise InputError(msg)
        object.__setattr__(self, self._field, tuple(flat))

    @property
    def _children(self) -> tuple[Kernel, ...]:
        """The kernels that this one is composed of, from left to right."""
        children: tuple[Kernel, ...] = getattr(self, self._field)
        return children

    @property
    def columns(self) -> tuple[int, ...]:
        """Columns of the inputs that the kernel reads, ascending."""
        return tuple(sorted({column for child in self._children for column in child.columns}))

    def leaves(self) -> tuple[tuple[str, tuple[Parameter, ...]], ...]:
        """See `Kernel.leaves`."""
        return tuple(leaf for child in self._children for leaf in child.leaves())

    def _with_logs(self, logs: FloatArray) -> Self:
        parts = np.split(logs, np.cumsum([child._free_count for child in self._children])[:-1])
        children = tuple(
            child._with_logs(part) for child, part in zip(self._children, parts, strict=True)
        )
        return replace(self, **{self._field: children})  # type: ignore[type-var]  # a dataclass


@register_kernel
@dataclass(frozen=True, kw_only=True)
class Product(_Composite):
    """Product of kernels, k(x, x') = k_1(x, x') k_2(x, x') …, Eq. 21 of the paper.

    The variances of several factors act only through their product: fix all but one of them
    (``fixed=("variance",)``), or the likelihood has a ridge instead of a maximum.

    Attributes
    ----------
    factors : tuple of Kernel
        At least two; a product among them is taken apart.

    Raises
    ------
    InputError
        If there are fewer than two factors or one is not a kernel.
    """

    factors: tuple[Kernel, ...]
    type_name: ClassVar[str] = "product"
    _field: ClassVar[str] = "factors"

    @cached_property
    def _free_factors(self) -> tuple[Kernel, ...]:
        return tuple(factor for factor in self.factors if factor._free_count)

    @cached_property
    def _fixed_factors(self) -> tuple[Kernel, ...]:
        """Factors that fitting leaves alone, gates above all."""
        return tuple(factor for factor in self.factors if not factor._free_count)

    def fill(self, x: FloatArray, y: FloatArray, out: FloatArray) -> None:
        """See `Kernel.fill`."""
        first, *others = self.factors
        first.fill(x, y, out)
        for factor in others:
            factor.multiply(x, y, out)

    def weigh(self, x: FloatArray, y: FloatArray, weights: FloatArray) -> FloatArray:
        """See `Kernel.weigh`; a factor's weights are multiplied by all other factors."""
        for factor in self._fixed_factors:
            factor.multiply(x, y, weights)
        if len(self._free_factors) == 1:
            return self._free_factors[0].weigh(x, y, weights)
        values = [tile(factor, x, y) for factor in self._free_factors]
        parts: list[FloatArray] = [np.empty(0)]
        for index, factor in enumerate(self._free_factors):
            others = weights.copy()
            for other, value in enumerate(values):
                if other != index:
                    others *= value
            parts.append(factor.weigh(x, y, others))
        return np.concatenate(parts)

    def prior_variance(self, x: FloatArray) -> FloatArray:
        """See `Kernel.prior_variance`."""
        out: FloatArray = np.prod([factor.prior_variance(x) for factor in self.factors], axis=0)
        return out

    def closed(self, x: FloatArray) -> BoolArray:
        """See `Kernel.gate`: closed where one factor is."""
        out: BoolArray = np.any([factor.closed(x) for factor in self.factors], axis=0)
        return out


@register_kernel
@dataclass(frozen=True, kw_only=True)
class Sum(_Composite):
    """Sum of kernels, k(x, x') = k_1(x, x') + k_2(x, x') + ….

    Attributes
    ----------
    terms : tuple of Kernel
        At least two; a sum among them is taken apart.

    Raises
    ------
    InputError
        If there are fewer than two terms or one is not a kernel.
    """

    terms: tuple[Kernel, ...]
    type_name: ClassVar[str] = "sum"
    _field: ClassVar[str] = "terms"

    def fill(self, x: FloatArray, y: FloatArray, out: FloatArray) -> None:
        """See `Kernel.fill`."""
        first, *others = self.terms
        first.fill(x, y, out)
        for term in others:
            out += tile(term, x, y)

    def weigh(self, x: FloatArray, y: FloatArray, weights: FloatArray) -> FloatArray:
        """See `Kernel.weigh`."""
        return np.concatenate([term.weigh(x, y, weights.copy()) for term in self.terms])

    def prior_variance(self, x: FloatArray) -> FloatArray:
        """See `Kernel.prior_variance`."""
        out: FloatArray = np.sum([term.prior_variance(x) for term in self.terms], axis=0)
        return out

    def closed(self, x: FloatArray) -> BoolArray:
        """See `Kernel.gate`: closed only where all terms are."""
        out: BoolArray = np.all([term.closed(x) for term in self.terms], axis=0)
        return out


def kernel_from_dict(description: Mapping[str, Any]) -> Kernel:
    """Build the kernel that `Kernel.to_dict` described.

    Parameters
    ----------
    description : mapping
        ``type`` and the fields of the kernel; ``factors`` or ``terms`` hold descriptions. A type
        that is not exposight's also names the ``module`` that defines it, which is never imported
        on a file's behalf.

    Raises
    ------
    InputError
        If the type is unknown, a key is missing or unexpected, or a value cannot be right.
    """
    kernel: Kernel = build(description)
    return kernel
