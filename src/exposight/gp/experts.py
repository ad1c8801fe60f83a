"""A committee's experts: how observations are shared out, and what an expert knows of its shard.

All experts share a communication set; the other observations are split by space into shards of
equal size. The covariance of the c shared observations and the m of a shard, noise included, is
the square of [[L, 0], [Z', C]]: L belongs to the shared ones, so that it is found once for all.
"""

from dataclasses import dataclass
from typing import Self, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.linalg import blas

from exposight.errors import InputError, NotPositiveDefiniteError
from exposight.gp.bounds import DataScale
from exposight.gp.factor import JITTERS, Factor, complement, factor_with_jitter, factorise
from exposight.gp.kernels import Kernel, Quantity
from exposight.gp.observations import BoolArray, FloatArray, IntArray
from exposight.gp.tiling import fill_tiles

Rows: TypeAlias = NDArray[np.intp]


@dataclass(frozen=True, kw_only=True, eq=False)
class Partition:
    """Which observations the experts share, and which are whose.

    Attributes
    ----------
    communication : (c,) array of int
        Rows that every expert knows.
    shards : tuple of (m,) arrays of int
        Rows of each expert alone.
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
    """Count the experts that share out observations inside the gate; sizes as for `partition`."""
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
    """Measure checked inputs, (n, D), by the kernel's length scales.

    Returns
    -------
    (n, d) array
        The columns that the kernel reads, each divided by the shortest length scale that acts on
        it; by its standard deviation where none does.
    """
    spans = DataScale.of(x, np.zeros(1)).column_std
    shortest = np.full(x.shape[1], np.inf)
    for parameter in kernel.parameters:
        if parameter.quantity is Quantity.LENGTH_SCALE:
            dims = list(parameter.dims)
            shortest[dims] = np.minimum(shortest[dims], parameter.value)
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


def check_shards(shard: ArrayLike, active: BoolArray) -> IntArray:
    """Check each observation's number of an expert; only the (n,) active ones count."""
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


@dataclass(frozen=True, kw_only=True, eq=False)
class CommunicationSet:
    """The observations that all experts share.

    Attributes
    ----------
    x : (c, D) array
        Inputs, in C order.
    factor : Factor
        L.
    whitened : (c,) array
        L⁻¹ y.
    """

    x: FloatArray
    factor: Factor
    whitened: FloatArray

    @classmethod
    def condition(cls, kernel: Kernel, noise_variance: float, x: FloatArray, y: FloatArray) -> Self:
        """Condition on checked observations inside the kernel's gate, x in C order.

        Raises
        ------
        NotPositiveDefiniteError
            If their covariance has no Cholesky factor, even with the largest jitter.
        """
        factor = factorise(kernel, noise_variance, x)
        return cls(x=x, factor=factor, whitened=blas.dtrsv(factor.matrix, y, lower=1))

    def project(self, kernel: Kernel, x: FloatArray) -> FloatArray:
        """Compute L⁻¹ k(shared, x) of checked inputs: (c, n) for (n, D)."""
        cross = np.empty((len(x), len(self.x)))
        fill_tiles(kernel, x, self.x, cross)
        out: FloatArray = blas.dtrsm(1.0, self.factor.matrix, cross.T, lower=1, overwrite_b=1)
        return out


@dataclass(frozen=True, kw_only=True, eq=False)
class Expert:
    """One shard of observations beside the communication set.

    Attributes
    ----------
    x : (m, D) array
        Inputs of the shard, in C order.
    below : (c, m) array
        Z.
    corner : (m, m) array
        C, in Fortran's order; what stands above the diagonal is undefined.
    whitened : (m,) array
        C⁻¹ (y − Z' L⁻¹ y_c): the targets, less what the communication set says of them.
    jitter : float
        What had to be added to the diagonal of C C', in squared units of the target.
    """

    x: FloatArray
    below: FloatArray
    corner: FloatArray
    whitened: FloatArray
    jitter: float

    @classmethod
    def condition(
        cls,
        shared: CommunicationSet,
        kernel: Kernel,
        noise_variance: float,
        x: FloatArray,
        y: FloatArray,
    ) -> Self:
        """Condition on a shard of checked observations inside the gate, x in C order.

        Raises
        ------
        NotPositiveDefiniteError
            If there is no C, even with the largest jitter; the message names the remedy.
        """
        below, corner = complement(shared.factor, kernel, noise_variance, shared.x, x)
        scale, kept = float(corner.diagonal().mean()), corner.copy(order="F")
        jitter = factor_with_jitter(corner, lambda: np.copyto(corner, kept))
        if jitter is None:
            raise NotPositiveDefiniteError(_why(len(x), noise_variance, scale))
        rest = y - below.T @ shared.whitened
        whitened = blas.dtrsv(corner, rest, lower=1)
        return cls(x=x, below=below, corner=corner, whitened=whitened, jitter=jitter)

    def gain(self, kernel: Kernel, x: FloatArray, known: FloatArray) -> FloatArray:
        """Compute C⁻¹ (k(shard, x) − Z' known), (m, n), of (n, D) checked inputs.

        `known`, (c, n), is the communication set's `project` of them. A column u takes |u|² off the
        variance and adds u · whitened to the mean.
        """
        cross = np.empty((len(x), len(self.x)))
        fill_tiles(kernel, x, self.x, cross)
        rest = blas.dgemm(-1.0, self.below, known, beta=1.0, c=cross.T, trans_a=1, overwrite_c=1)
        out: FloatArray = blas.dtrsm(1.0, self.corner, rest, lower=1, overwrite_b=1)
        return out


def _why(observations: int, noise_variance: float, scale: float) -> str:
    """Explain why a shard has no factor, and what to do."""
    return (
        f"the covariance of a shard of {observations} observations, given those that all experts "
        f"share, has no Cholesky factor, even with {JITTERS[-1]:g} of its mean variance "
        f"{scale:g} added to the diagonal: observations nearly repeat each other, and "
        f"noise_variance={noise_variance:g} does not keep them apart. Raise the noise variance, "
        "shorten the length scales, or remove repeated observations"
    )
