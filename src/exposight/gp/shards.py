"""Observations split by space into shards of equal size, for a committee of experts."""

from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from exposight.errors import InputError
from exposight.gp.bounds import DataScale
from exposight.gp.kernels import Kernel, Quantity
from exposight.gp.observations import FloatArray

Rows: TypeAlias = NDArray[np.intp]


@dataclass(frozen=True, kw_only=True, eq=False)
class Partition:
    """Which observations the experts share, and which are whose.

    Attributes
    ----------
    communication : (c,) array of int
        Rows that every expert knows.
    shards : tuple of (m,) arrays of int
        Rows of each expert's own.
    """

    communication: Rows
    shards: tuple[Rows, ...]


def partition(
    kernel: Kernel, x: FloatArray, rng: np.random.Generator, *, shard_size: int, communication: int
) -> Partition:
    """Draw a communication set and split the other observations by space.

    Parameters
    ----------
    kernel : Kernel
        Its length scales measure space.
    x : (n, D) array
        Checked inputs, all inside the kernel's gate.
    rng : numpy.random.Generator
        Draws the communication set.
    shard_size : int
        Observations of one expert, at most.
    communication : int
        Observations that all experts share.

    Returns
    -------
    Partition

    Raises
    ------
    InputError
        If a size is below 1, or nothing is left for the experts.
    """
    count = count_shards(len(x), shard_size=shard_size, communication=communication)
    drawn = np.sort(rng.choice(len(x), size=communication, replace=False))
    others = np.delete(np.arange(len(x)), drawn)
    shards = split_by_space(in_length_scales(kernel, x[others]), count)
    return Partition(communication=drawn, shards=tuple(others[rows] for rows in shards))


def count_shards(observations: int, *, shard_size: int, communication: int) -> int:
    """Count the experts of a committee that shares out observations.

    Parameters
    ----------
    observations : int
        Inside the kernel's gate.
    shard_size, communication : int
        As for `partition`.

    Returns
    -------
    int

    Raises
    ------
    InputError
        If a size is below 1, or nothing is left for the experts.
    """
    if shard_size < 1 or not 1 <= communication < observations:
        msg = (
            "a committee takes shards of at least 1 observation, and a communication set of at "
            f"least 1 and fewer than the {observations} observations inside the kernel's range; "
            f"got shard_size={shard_size}, communication={communication}. Few observations need "
            "no committee: use fit or GaussianProcess.condition"
        )
        raise InputError(msg)
    return -(-(observations - communication) // shard_size)


def in_length_scales(kernel: Kernel, x: FloatArray) -> FloatArray:
    """Measure inputs by the kernel's length scales.

    Parameters
    ----------
    kernel : Kernel
        With hyperparameters that suit the observations.
    x : (n, D) array
        Checked inputs.

    Returns
    -------
    (n, d) array
        The columns that the kernel reads, each divided by the shortest length scale that acts on
        it; by its standard deviation where none does.
    """
    spans = DataScale.of(x, np.zeros(1)).column_std
    shortest = np.full(x.shape[1], np.inf)
    for own in kernel.parameters:
        if own.quantity is Quantity.LENGTH_SCALE:
            dims = list(own.dims)
            shortest[dims] = np.minimum(shortest[dims], own.value)
    columns = list(kernel.columns)
    scaled: FloatArray = x[:, columns] / np.where(np.isfinite(shortest), shortest, spans)[columns]
    return scaled


def split_by_space(scaled: FloatArray, shards: int) -> tuple[Rows, ...]:
    """Split inputs into boxes that hold equally many of them.

    The widest column is cut first, so that the boxes stay compact; halves are cut again.

    Parameters
    ----------
    scaled : (n, d) array
        Inputs in units that make their columns comparable.
    shards : int
        From 1 to n.

    Returns
    -------
    tuple of (m,) arrays of int
        Rows of each shard, ascending; their numbers differ by one at most.
    """
    return tuple(np.sort(rows) for rows in _split(scaled, np.arange(len(scaled)), shards))


def _split(scaled: FloatArray, rows: Rows, shards: int) -> list[Rows]:
    if shards == 1:
        return [rows]
    widest = int(np.argmax(np.ptp(scaled[rows], axis=0)))
    ordered = rows[np.argsort(scaled[rows, widest], kind="stable")]
    first = shards // 2
    # whole shards on either side; the larger ones come first
    size, larger = divmod(len(rows), shards)
    cut = first * size + min(first, larger)
    return [
        *_split(scaled, ordered[:cut], first),
        *_split(scaled, ordered[cut:], shards - first),
    ]
