"""The contract of a covariance function, and the products and sums that kernels compose to."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Any, ClassVar, Self, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from exposight.errors import InputError
from exposight.gp.kernels.parameters import Parameter, check_log_parameters, name_parameters
from exposight.gp.observations import BoolArray, FloatArray, check_inputs

__all__ = ["GradientDot", "Kernel", "Product", "Sum"]

GradientDot: TypeAlias = Callable[[FloatArray], FloatArray]
"""Maps weights W (n, n) to sum_ij W_ij dK_ij / dlog theta, one number a free parameter."""


class Kernel(ABC):
    """A covariance function k(x, x'), immutable, with its derivatives.

    Kernels compose: ``a * b`` and ``a + b`` are kernels. Derivatives are taken with respect to
    the natural logarithms of the free hyperparameters, in the order of `parameters`.
    """

    type_name: ClassVar[str]

    @property
    @abstractmethod
    def columns(self) -> tuple[int, ...]:
        """Columns of the inputs that the kernel reads, ascending for a tree."""

    @abstractmethod
    def _leaves(self) -> tuple[tuple[str, tuple[Parameter, ...]], ...]:
        """Type name and hyperparameters of each leaf of the tree, from left to right."""

    @abstractmethod
    def _value(self, x: FloatArray, y: FloatArray) -> FloatArray:
        """Covariances of checked inputs: a fresh (n, m) array."""

    @abstractmethod
    def _diagonal(self, x: FloatArray) -> FloatArray:
        """Variances of checked inputs: a fresh (n,) array."""

    @abstractmethod
    def _gate(self, x: FloatArray) -> BoolArray:
        """Rows of checked inputs that the kernel multiplies by zero."""

    @abstractmethod
    def _linearise(self, x: FloatArray) -> tuple[FloatArray, GradientDot]:
        """Value at checked inputs, and the weighted sum of its derivatives."""

    @abstractmethod
    def _gradient(self, x: FloatArray) -> Iterator[FloatArray]:
        """Generate dK / dlog theta at checked inputs, one (n, n) array a free parameter."""

    @abstractmethod
    def with_log_parameters(self, vector: ArrayLike) -> "Kernel":
        """Return the same kernel with other values of its free hyperparameters.

        Parameters
        ----------
        vector : (p,) array
            Natural logarithms, ordered as `log_parameters`.

        Returns
        -------
        Kernel

        Raises
        ------
        InputError
            If the vector has another length or is not finite.
        """

    @abstractmethod
    def to_dict(self) -> dict[str, Any]:
        """Describe the tree with what JSON can hold; `kernel_from_dict` reads it back."""

    def value(self, x: ArrayLike, y: ArrayLike) -> FloatArray:
        """Covariance of every row of `x` with every row of `y`.

        Parameters
        ----------
        x : (n, D) array
            Inputs, each column in its own unit.
        y : (m, D) array
            Inputs, same columns.

        Returns
        -------
        (n, m) array
            In squared units of the target.

        Raises
        ------
        ObservationError
            If an array is not a finite matrix with the columns that the kernel reads.
        """
        read = self.columns
        return self._value(check_inputs(x, dims=read), check_inputs(y, name="y", dims=read))

    def diagonal(self, x: ArrayLike) -> FloatArray:
        """Prior variance k(x, x) of every row of `x`, without building a matrix.

        Parameters
        ----------
        x : (n, D) array
            Inputs, each column in its own unit.

        Returns
        -------
        (n,) array
            In squared units of the target.
        """
        return self._diagonal(check_inputs(x, dims=self.columns))

    def gate(self, x: ArrayLike) -> BoolArray:
        """Rows that the kernel multiplies by zero: there the prior is exactly 0.

        Parameters
        ----------
        x : (n, D) array
            Inputs, each column in its own unit.

        Returns
        -------
        (n,) bool array
            True where k(x, ·) vanishes whatever the hyperparameters.
        """
        return self._gate(check_inputs(x, dims=self.columns))

    def linearise(self, x: ArrayLike) -> tuple[FloatArray, GradientDot]:
        """Covariance matrix of `x` together with the weighted sums of its derivatives.

        Parameters
        ----------
        x : (n, D) array
            Inputs, each column in its own unit.

        Returns
        -------
        value : (n, n) array
            As ``value(x, x)``.
        gradient_dot : callable
            Maps weights (n, n) to sum_ij W_ij dK_ij / dlog theta, shape (p,).
        """
        return self._linearise(check_inputs(x, dims=self.columns))

    def gradient_dot(self, x: ArrayLike, weights: ArrayLike) -> FloatArray:
        """Weighted sums of the covariance's derivatives.

        Parameters
        ----------
        x : (n, D) array
            Inputs, each column in its own unit.
        weights : (n, n) array
            W; need not be symmetric.

        Returns
        -------
        (p,) array
            sum_ij W_ij dK_ij / dlog theta for each free hyperparameter.

        Raises
        ------
        InputError
            If the weights have another shape.
        """
        inputs = check_inputs(x, dims=self.columns)
        matrix = np.ascontiguousarray(weights, dtype=np.float64)
        if matrix.shape != (len(inputs), len(inputs)):
            msg = f"weights must have shape {(len(inputs),) * 2}, got {matrix.shape}"
            raise InputError(msg)
        return self._linearise(inputs)[1](matrix)

    def gradient(self, x: ArrayLike) -> Iterator[FloatArray]:
        """Generate the derivatives of the covariance matrix, one after the other.

        Parameters
        ----------
        x : (n, D) array
            Inputs, each column in its own unit.

        Yields
        ------
        (n, n) array
            dK / dlog theta for each free hyperparameter. Fitting uses `gradient_dot` instead,
            which needs none of these matrices.
        """
        return self._gradient(check_inputs(x, dims=self.columns))

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """All hyperparameters, fixed ones included, named and ordered from left to right."""
        return name_parameters(self._leaves())

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

    def _multiply_into(self, x: FloatArray, y: FloatArray, out: FloatArray) -> None:
        """Multiply `out` by the covariances of checked inputs, in place."""
        out *= self._value(x, y)


class _Composite(Kernel):
    """What products and sums have in common."""

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
    @abstractmethod
    def _children(self) -> tuple[Kernel, ...]:
        """The kernels that this one is composed of, from left to right."""

    @abstractmethod
    def _with_children(self, children: tuple[Kernel, ...]) -> Self:
        """Return the same composition of other kernels."""

    @property
    def columns(self) -> tuple[int, ...]:
        """Columns of the inputs that the kernel reads, ascending."""
        return tuple(sorted({column for child in self._children for column in child.columns}))

    def with_log_parameters(self, vector: ArrayLike) -> Self:
        """See `Kernel.with_log_parameters`."""
        ends = np.cumsum([len(child.free_parameters) for child in self._children])
        parts = np.split(check_log_parameters(vector, self.free_parameters), ends[:-1])
        return self._with_children(
            tuple(
                child.with_log_parameters(part)
                for child, part in zip(self._children, parts, strict=True)
            )
        )

    def to_dict(self) -> dict[str, Any]:
        """See `Kernel.to_dict`."""
        return {"type": self.type_name, self._field: [own.to_dict() for own in self._children]}

    def _leaves(self) -> tuple[tuple[str, tuple[Parameter, ...]], ...]:
        return tuple(leaf for child in self._children for leaf in child._leaves())


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

    @property
    def _children(self) -> tuple[Kernel, ...]:
        return self.factors

    def _with_children(self, children: tuple[Kernel, ...]) -> Self:
        return replace(self, factors=children)

    def _value(self, x: FloatArray, y: FloatArray) -> FloatArray:
        first, *others = self.factors
        out = first._value(x, y)
        for factor in others:
            factor._multiply_into(x, y, out)
        return out

    def _diagonal(self, x: FloatArray) -> FloatArray:
        out: FloatArray = np.prod([factor._diagonal(x) for factor in self.factors], axis=0)
        return out

    def _gate(self, x: FloatArray) -> BoolArray:
        out: BoolArray = np.any([factor._gate(x) for factor in self.factors], axis=0)
        return out

    def _linearise(self, x: FloatArray) -> tuple[FloatArray, GradientDot]:
        linear = [factor._linearise(x) for factor in self.factors if factor.free_parameters]
        constant = [factor for factor in self.factors if not factor.free_parameters]
        out = linear[0][0].copy() if linear else np.ones((len(x), len(x)))
        for value, _ in linear[1:]:
            out *= value
        for factor in constant:
            factor._multiply_into(x, x, out)

        def gradient_dot(weights: FloatArray) -> FloatArray:
            parts = [np.empty(0)]
            for own, (_, own_gradient_dot) in enumerate(linear):
                others = weights.copy()
                for other, (value, _) in enumerate(linear):
                    if other != own:
                        others *= value
                for factor in constant:
                    factor._multiply_into(x, x, others)
                parts.append(own_gradient_dot(others))
            return np.concatenate(parts)

        return out, gradient_dot

    def _gradient(self, x: FloatArray) -> Iterator[FloatArray]:
        for own, factor in enumerate(self.factors):
            for derivative in factor._gradient(x):
                for other, rest in enumerate(self.factors):
                    if other != own:
                        rest._multiply_into(x, x, derivative)
                yield derivative


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

    @property
    def _children(self) -> tuple[Kernel, ...]:
        return self.terms

    def _with_children(self, children: tuple[Kernel, ...]) -> Self:
        return replace(self, terms=children)

    def _value(self, x: FloatArray, y: FloatArray) -> FloatArray:
        first, *others = self.terms
        out = first._value(x, y)
        for term in others:
            out += term._value(x, y)
        return out

    def _diagonal(self, x: FloatArray) -> FloatArray:
        out: FloatArray = np.sum([term._diagonal(x) for term in self.terms], axis=0)
        return out

    def _gate(self, x: FloatArray) -> BoolArray:
        out: BoolArray = np.all([term._gate(x) for term in self.terms], axis=0)
        return out

    def _linearise(self, x: FloatArray) -> tuple[FloatArray, GradientDot]:
        linear = [term._linearise(x) for term in self.terms]
        out = linear[0][0].copy()
        for value, _ in linear[1:]:
            out += value

        def gradient_dot(weights: FloatArray) -> FloatArray:
            return np.concatenate([term_gradient_dot(weights) for _, term_gradient_dot in linear])

        return out, gradient_dot

    def _gradient(self, x: FloatArray) -> Iterator[FloatArray]:
        for term in self.terms:
            yield from term._gradient(x)
