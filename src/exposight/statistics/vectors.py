"""Vectors of numbers, checked at the boundary of the room."""

from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from exposight.errors import ObservationError

FloatArray: TypeAlias = NDArray[np.float64]
IntArray: TypeAlias = NDArray[np.int64]


def as_floats(values: ArrayLike, name: str) -> FloatArray:
    """Turn values of any shape into float64; `name` is theirs in the message of the error."""
    try:
        return np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError) as error:
        msg = f"{name} must be an array of numbers, got {values!r}"
        raise ObservationError(msg) from error


def check_vector(values: ArrayLike, name: str, *, fewest: int = 1) -> FloatArray:
    """Check a vector of at least `fewest` finite numbers and return it as float64."""
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
