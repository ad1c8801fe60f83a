"""Checks of what a kernel is built from."""

import operator
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from exposight.errors import InputError


def check_positive(values: ArrayLike, *, what: str) -> tuple[float, ...]:
    """Check that every value is a positive, finite number and return them as a tuple.

    Parameters
    ----------
    values : array-like
        A number or a sequence of numbers.
    what : str
        What the values are called in a message.

    Returns
    -------
    tuple of float

    Raises
    ------
    InputError
        If there is none, or one is not positive and finite.
    """
    try:
        array = np.atleast_1d(np.asarray(values, dtype=np.float64))
    except (TypeError, ValueError) as error:
        msg = f"{what} must be positive numbers, got {values!r}"
        raise InputError(msg) from error
    if array.ndim != 1 or len(array) == 0 or not np.all((array > 0.0) & np.isfinite(array)):
        msg = f"{what} must be positive and finite, got {values!r}"
        raise InputError(msg)
    return tuple(array.tolist())


def check_dims(dims: Sequence[int], *, kernel: str) -> tuple[int, ...]:
    """Check the columns that a kernel reads and return them as a tuple.

    Parameters
    ----------
    dims : sequence of int
        Columns of the inputs, counted from 0.
    kernel : str
        What the kernel is called in a message.

    Returns
    -------
    tuple of int

    Raises
    ------
    InputError
        If there is none, one is negative or not a whole number, or one comes twice.
    """
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
    """Check the names of the fields that fitting leaves alone and return them as a tuple.

    Parameters
    ----------
    fixed : sequence of str
        Names of fields.
    allowed : tuple of str
        Names that the kernel has.
    kernel : str
        What the kernel is called in a message.

    Returns
    -------
    tuple of str

    Raises
    ------
    InputError
        If a name is not one of the kernel's, or a lone string comes for a sequence.
    """
    if isinstance(fixed, str) or any(name not in allowed for name in fixed):
        msg = f"{kernel}.fixed takes a tuple with names out of {', '.join(allowed)}, got {fixed!r}"
        raise InputError(msg)
    return tuple(name for name in allowed if name in fixed)
