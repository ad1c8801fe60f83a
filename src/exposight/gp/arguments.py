"""What every process asks of its noise variance and its observations."""

import math

import numpy as np
from numpy.typing import ArrayLike

from exposight.errors import InputError, ObservationError
from exposight.gp.kernels import Kernel
from exposight.gp.observations import BoolArray, FloatArray, IntArray, check_inputs, check_targets


def check_noise_variance(noise_variance: float) -> None:
    """Check that a noise variance is positive and finite.

    Parameters
    ----------
    noise_variance : float
        In squared units of the target.

    Raises
    ------
    InputError
        If it is not.
    """
    if not (noise_variance > 0.0 and math.isfinite(noise_variance)):
        msg = (
            f"noise_variance must be positive and finite, got {noise_variance!r}; for targets "
            "without noise take a small share of their variance, such as 1e-6"
        )
        raise InputError(msg)


def check_observations(
    kernel: Kernel, x: ArrayLike, y: ArrayLike
) -> tuple[FloatArray, FloatArray, BoolArray]:
    """Check inputs against targets and find those that the kernel's gate lets in.

    Parameters
    ----------
    kernel : Kernel
        Prior covariance.
    x : (n, D) array
        Inputs.
    y : (n,) array
        Targets.

    Returns
    -------
    x : (n, D) array
        Checked inputs.
    y : (n,) array
        Checked targets.
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
    active = ~kernel.gate(inputs)
    if not active.any():
        msg = (
            f"all {len(inputs)} observations lie outside the range in which the kernel is not "
            "zero, so there is nothing to learn from; check the columns' order and units"
        )
        raise ObservationError(msg)
    return inputs, targets, active


def check_shards(shard: ArrayLike, active: BoolArray) -> IntArray:
    """Check that observations are shared out among experts.

    Parameters
    ----------
    shard : (n,) array of int
        The number of the expert of each observation; −1 for those that all share.
    active : (n,) bool array
        The observations that count.

    Returns
    -------
    (n,) array of int

    Raises
    ------
    InputError
        If there is not one integer an observation, or the active ones do not hold −1 and all
        numbers from 0 to the largest.
    """
    owner = np.asarray(shard)
    if owner.shape == active.shape and np.issubdtype(owner.dtype, np.integer):
        numbers = np.unique(owner[active])
        if len(numbers) > 1 and np.array_equal(numbers, np.arange(-1, len(numbers) - 1)):
            return owner.astype(np.int64)
    msg = (
        f"shard must hold an integer for each of the {len(active)} observations: -1 for those that "
        "all experts share, else the expert's number, from 0 without gaps; got "
        f"{owner.dtype} of shape {owner.shape}"
    )
    raise InputError(msg)


def check_rows(rows: ArrayLike, *, observations: int) -> BoolArray:
    """Check that rows are among the observations, and mark them.

    Parameters
    ----------
    rows : (k,) array of int
        Counted from 0; one that is named twice counts once.
    observations : int
        How many there are.

    Returns
    -------
    (n,) bool array
        True for the rows.

    Raises
    ------
    InputError
        If a row is not an integer from 0 to n − 1.
    """
    array = np.asarray(rows)
    out = np.zeros(observations, dtype=np.bool_)
    if array.size == 0:
        return out
    whole = array.ndim == 1 and np.issubdtype(array.dtype, np.integer)
    if not (whole and array.min() >= 0 and array.max() < observations):
        msg = (
            f"rows must be integers from 0 to {observations - 1}, one for each observation, got "
            f"{array.dtype} of shape {array.shape}"
        )
        if whole:
            msg += f", from {array.min()} to {array.max()}"
        elif array.dtype == np.bool_:
            msg += "; turn a mask into rows with np.flatnonzero"
        raise InputError(msg)
    out[array] = True
    return out
