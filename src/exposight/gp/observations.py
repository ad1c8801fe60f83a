"""Checks of what processes are built from: observations, noise variance, a kernel's fields."""

import math
import operator
from collections.abc import Sequence
from typing import Protocol, TypeAlias, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from exposight.errors import InputError, ObservationError

FloatArray: TypeAlias = NDArray[np.float64]
BoolArray: TypeAlias = NDArray[np.bool_]
IntArray: TypeAlias = NDArray[np.int64]


_Scalar = TypeVar("_Scalar", bound=np.generic)


def read_only(array: NDArray[_Scalar]) -> NDArray[_Scalar]:
    """Copy an array, so that nobody can change it."""
    out = array.copy()
    out.setflags(write=False)
    return out


def _as_floats(values: ArrayLike, name: str) -> FloatArray:
    try:
        return np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError) as error:
        msg = f"{name} must be an array of numbers, got {type(values).__name__}: {error}"
        raise ObservationError(msg) from error


def check_inputs(
    x: ArrayLike, *, name: str = "x", dims: tuple[int, ...] = (), columns: int | None = None
) -> FloatArray:
    """Check an array of inputs and return it as float64.

    Parameters
    ----------
    x : (n, D) array
        One row an observation, one column an input variable, each in its own unit.
    name : str
        The array's name in messages.
    dims : tuple of int
        Columns that a kernel is going to read.
    columns : int, optional
        The number of columns that `x` must have.

    Returns
    -------
    (n, D) float64 array
        In C order.

    Raises
    ------
    ObservationError
        If `x` is not a matrix, lacks a column, or holds a NaN or an infinite value.
    """
    array = _as_floats(x, name)
    if array.ndim != 2:
        msg = (
            f"{name} must have shape (observations, dimensions), got shape {array.shape}; "
            "a single input variable is a matrix of one column"
        )
        raise ObservationError(msg)
    if columns is not None and array.shape[1] != columns:
        msg = (
            f"{name} must have the {columns} columns of the training inputs, got "
            f"{array.shape[1]}; pass the same variables in the same order"
        )
        raise ObservationError(msg)
    if dims and max(dims) >= array.shape[1]:
        msg = (
            f"the kernel reads column {max(dims)} (counted from 0), but {name} has "
            f"{array.shape[1]} columns; add the column or change the kernel's dims"
        )
        raise ObservationError(msg)
    finite = np.isfinite(array)
    if not finite.all():
        row, column = np.argwhere(~finite)[0]
        msg = (
            f"{name} must be finite, got {array[row, column]} in row {row}, column {column} "
            f"({int((~finite).any(axis=1).sum())} rows are affected); "
            "remove these observations or measure them again"
        )
        raise ObservationError(msg)
    return np.ascontiguousarray(array)


def check_targets(y: ArrayLike, *, observations: int) -> FloatArray:
    """Check an array of targets, one an observation and all finite; return it as float64."""
    array = _as_floats(y, "y")
    if array.shape != (observations,):
        msg = (
            f"y must hold one target for each of the {observations} rows of the inputs, "
            f"shape ({observations},), got shape {array.shape}"
        )
        raise ObservationError(msg)
    finite = np.isfinite(array)
    if not finite.all():
        row = int(np.flatnonzero(~finite)[0])
        msg = (
            f"y must be finite, got {array[row]} in row {row} "
            f"({int((~finite).sum())} rows are affected); remove these observations"
        )
        raise ObservationError(msg)
    return array


class Gated(Protocol):
    """A kernel, as far as checks of its observations are concerned."""

    @property
    def columns(self) -> tuple[int, ...]:
        """Columns of the inputs that the kernel reads."""

    def closed(self, x: FloatArray) -> BoolArray:
        """Rows of checked inputs that the kernel multiplies by zero."""


def check_observations(
    kernel: Gated, x: ArrayLike, y: ArrayLike
) -> tuple[FloatArray, FloatArray, BoolArray]:
    """Check inputs against targets and find those that the kernel's gate lets in.

    Returns
    -------
    x, y : (n, D) and (n,) array
        Checked inputs and targets.
    active : (n,) bool array
        False where the kernel multiplies by zero.

    Raises
    ------
    ObservationError
        If the arrays do not fit together, are not finite, are empty, or lie wholly outside the
        kernel's range.
    """
    inputs = check_inputs(x, dims=kernel.columns)
    targets = check_targets(y, observations=len(inputs))
    if len(inputs) == 0:
        msg = "at least one observation is needed, got none"
        raise ObservationError(msg)
    active = ~kernel.closed(inputs)
    if not active.any():
        msg = (
            f"all {len(inputs)} observations lie outside the range in which the kernel is not "
            "zero, so there is nothing to learn from; check the columns' order and units"
        )
        raise ObservationError(msg)
    return inputs, targets, active


def check_noise_variance(noise_variance: float) -> None:
    """Check that a noise variance, in squared units of the target, is positive and finite."""
    if not (noise_variance > 0.0 and math.isfinite(noise_variance)):
        msg = (
            f"noise_variance must be positive and finite, got {noise_variance!r}; for targets "
            "without noise take a small share of their variance, such as 1e-6"
        )
        raise InputError(msg)


def check_row_noise(row_noise: ArrayLike | None, *, observations: int) -> FloatArray | None:
    """Check the variance of each row's further noise, in squared units of the target.

    Raises
    ------
    ObservationError
        If there is not one for each row, finite and not negative.
    """
    if row_noise is None:
        return None
    array = _as_floats(row_noise, "row_noise")
    if array.shape != (observations,) or not np.all((array >= 0.0) & np.isfinite(array)):
        msg = (
            f"row_noise must hold a variance for each of the {observations} rows, finite and not "
            f"negative, got shape {array.shape}"
            + (f" and values down to {array.min():g}" if array.size else "")
            + "; leave it out where the rows have the same noise"
        )
        raise ObservationError(msg)
    return array


def check_learnable(x: FloatArray, y: FloatArray, *, dims: tuple[int, ...]) -> None:
    """Check that hyperparameters can be learnt from checked observations.

    Raises
    ------
    ObservationError
        If there are fewer observations than dimensions, or all of them are alike in the columns
        `dims` or in their targets.
    """
    n, d = x.shape
    if n < d:
        msg = (
            f"fewer observations than dimensions: {n} observations of {d} input variables; "
            "measure more, or use a model with fewer inputs"
        )
        raise ObservationError(msg)
    if n < 2:
        msg = f"at least two observations are needed to learn from, got {n}; measure more"
        raise ObservationError(msg)
    read = x[:, list(dims)]
    if np.all(read == read[0]):
        msg = (
            f"all observations are alike: the {n} rows hold the same inputs in every column the "
            "kernel reads; vary the exposure time or the pose"
        )
        raise ObservationError(msg)
    if np.all(y == y[0]):
        msg = (
            f"all observations are alike: each of the {n} targets is {y[0]:g}; "
            "widen the range of exposure times until the target varies"
        )
        raise ObservationError(msg)


def check_positive(values: ArrayLike, *, name: str) -> tuple[float, ...]:
    """Check a hyperparameter's values, one or several: positive and finite."""
    try:
        given = np.asarray(values)
    except (TypeError, ValueError) as error:
        msg = f"{name} must be positive numbers, got {values!r}"
        raise InputError(msg) from error
    if given.dtype.kind not in "fiu":  # numpy would take texts, and truth values, for numbers
        msg = f"{name} must be positive numbers, got {values!r}"
        raise InputError(msg)
    array = np.atleast_1d(given.astype(np.float64))
    if array.ndim != 1 or len(array) == 0 or not np.all((array > 0.0) & np.isfinite(array)):
        msg = f"{name} must be positive and finite, got {values!r}"
        raise InputError(msg)
    return tuple(array.tolist())


def check_dims(dims: Sequence[int], *, kernel: str) -> tuple[int, ...]:
    """Check the columns that a kernel reads: whole numbers from 0 on, each once."""
    try:
        columns = tuple(operator.index(dim) for dim in dims)
    except TypeError as error:
        msg = f"{kernel}.dims must be whole numbers, the columns counted from 0, got {dims!r}"
        raise InputError(msg) from error
    if not columns or min(columns) < 0 or len(set(columns)) != len(columns):
        msg = f"{kernel}.dims must name columns from 0 on, each once, got {dims!r}"
        raise InputError(msg)
    return columns


def check_fixed(fixed: Sequence[str], *, allowed: tuple[str, ...], kernel: str) -> tuple[str, ...]:
    """Check the names of the fields that fitting leaves alone."""
    if isinstance(fixed, str) or any(name not in allowed for name in fixed):
        msg = f"{kernel}.fixed takes a tuple with names out of {', '.join(allowed)}, got {fixed!r}"
        raise InputError(msg)
    return tuple(name for name in allowed if name in fixed)
