"""Counter-based random numbers: the n-th number of a stream, without the ones before it.

A pixel's noise is a function of the stream's key and the pixel's number, so the bytes of an image
depend neither on the number of threads nor on which part of the image is computed. The mixing
function is the finaliser of SplitMix64 (Steele, Lea & Flood, *Fast splittable pseudorandom number
generators*, OOPSLA 2014, constants of variant 13 by Stafford).
"""

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri

from exposight.compiled import njit
from exposight.errors import InputError

_GOLDEN = np.uint64(0x9E3779B97F4A7C15)
_FIRST = np.uint64(0xBF58476D1CE4E5B9)
_SECOND = np.uint64(0x94D049BB133111EB)
_30, _27, _31 = np.uint64(30), np.uint64(27), np.uint64(31)

NORMAL_BITS = 12
"""Random bits that select one entry of `NORMAL_TABLE`; five draws fit into 64 bits."""


def _normal_table() -> NDArray[np.float32]:
    """Return the standard normal's quantiles at the middle of 4096 equal shares, variance 1.

    They reach ±3.7; an image needs no rarer values, and a table is ten times quicker than a
    transformation of uniform numbers.
    """
    count = 2**NORMAL_BITS
    quantiles = ndtri((np.arange(count) + 0.5) / count)
    table = (quantiles / np.sqrt(np.mean(quantiles**2))).astype(np.float32)
    table.setflags(write=False)
    return np.asarray(table)


NORMAL_TABLE = _normal_table()


def stream_key(*numbers: int) -> np.uint64:
    """Return the key of a stream of random numbers.

    Parameters
    ----------
    *numbers : int, 0 or more
        What tells the stream from others: a campaign's seed, the view, the exposure, the purpose.

    Raises
    ------
    InputError
        If one is negative.
    """
    if any(number < 0 for number in numbers):
        msg = f"a stream of random numbers is named by whole numbers of 0 or more, got {numbers}"
        raise InputError(msg)
    # SeedSequence fills up with zeros: without its length, (1,) and (1, 0) would be one stream.
    sequence = np.random.SeedSequence((len(numbers), *numbers))
    return np.uint64(sequence.generate_state(1, np.uint64)[0])


@njit(inline="always")
def mix_bits(key: np.uint64, counter: np.uint64) -> np.uint64:
    """Return 64 random bits: number `counter` of the stream with this key."""
    x = key + (counter + np.uint64(1)) * _GOLDEN
    x = (x ^ (x >> _30)) * _FIRST
    x = (x ^ (x >> _27)) * _SECOND
    return x ^ (x >> _31)
