"""Checks at the boundary of the room: arrays of numbers."""

from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from exposight.errors import ObservationError

FloatArray: TypeAlias = NDArray[np.float64]


def as_floats(values: ArrayLike, name: str) -> FloatArray:
    """Turn values into an array of float64.

    Parameters
    ----------
    values : array-like
    name : str
        What they are called in a message.

    Returns
    -------
    float64 array
        Of whatever shape.

    Raises
    ------
    ObservationError
        If they are not numbers.
    """
    try:
        return np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError) as error:
        msg = f"{name} must be an array of numbers, got {values!r}"
        raise ObservationError(msg) from error


def check_vector(values: ArrayLike, name: str, *, fewest: int = 1) -> FloatArray:
    """Check a vector of numbers and return it as float64.

    Parameters
    ----------
    values : (n,) array
    name : str
        What the vector is called in a message.
    fewest : int
        The least n.

    Returns
    -------
    (n,) float64 array

    Raises
    ------
    ObservationError
        If it is not a vector, is too short, or holds a NaN or an infinite value.
    """
    array = as_floats(values, name)
    if array.ndim != 1 or len(array) < fewest:
        least = "one number" if fewest == 1 else f"{fewest} numbers"
        msg = f"{name} must be a vector of at least {least}, got shape {array.shape}"
        raise ObservationError(msg)
    if not np.isfinite(array).all():
        row = int(np.flatnonzero(~np.isfinite(array))[0])
        msg = f"{name} must be finite, got {array[row]} in row {row}; leave these rows out first"
        raise ObservationError(msg)
    return array
