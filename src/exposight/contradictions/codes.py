"""Binary codes of stripes: against their neighbours, and against the projector that shows them.

The codes of neighbouring pixels that see one surface follow each other. Read in another way than
they were shown (finest bit first, inverted, plain binary as Gray code) they jump. All ways of
reading are one-to-one, so the pairs of pixels with different codes are the same for each of them,
and the mean of log₂|difference| over these pairs is a fair measure of which one is right.
"""

from collections.abc import Sequence
from itertools import combinations
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from exposight.contradictions.contradiction import Contradiction

# Fewer pairs than this tell nothing for certain; more add time only.
_LEAST_PAIRS, _MOST_PAIRS = 300, 8_000

# By how much the mean log₂ of the jumps must shrink for another reading to be the right one; or, as
# little as _LESS where neighbours are several codes apart, if also so many more of the jumps stay
# below twice the typical one. The right reading beats the runner-up by 0.7 and more on the
# recordings; where neighbours are 20 codes apart, by 0.25, and with a share of 1.0 against 0.8.
_MARGIN, _LESS, _MORE_NEAR = 0.5, 0.1, 0.1


class Reading(NamedTuple):
    """A way of reading bits as a code."""

    order: tuple[int, ...]
    """Which bit stands at each place, most significant first."""
    binary: bool = False
    inverted: bool = False
    flipped: int = -1
    """Which bit alone is inverted; −1 for none."""


def read_codes(words: NDArray[np.int64], reading: Reading) -> NDArray[np.int64]:
    """Return the codes of words of bits.

    Parameters
    ----------
    words : ndarray of int
        Bits as they were given, the first one highest.
    reading : Reading
        How to read them.
    """
    n = len(reading.order)
    code = np.zeros_like(words)
    bit = np.zeros_like(words)
    for place in reading.order:
        inverted = reading.inverted != (place == reading.flipped)
        shown = ((words >> (n - 1 - place)) & 1) ^ int(inverted)
        bit = shown if reading.binary else bit ^ shown
        code = 2 * code + bit
    return code


def mean_jump(pairs: NDArray[np.int64], reading: Reading) -> float:
    """Return the mean of log₂|difference| of the codes of pairs of words, (2, p), that differ."""
    first, second = read_codes(pairs, reading)
    return float(np.mean(np.log2(np.abs(first - second))))


def share_near(pairs: NDArray[np.int64], reading: Reading, jump: float) -> float:
    """Return the share of pairs whose codes are at most twice 2^jump apart."""
    first, second = read_codes(pairs, reading)
    return float(np.mean(np.abs(first - second) <= 2.0 ** (jump + 1.0)))


def neighbouring_pairs(words: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return (2, p) words of horizontal neighbours, and of vertical ones in pairs of rows.

    Parameters
    ----------
    words : (rows, columns) ndarray of int
        −1 where the bits are uncertain; row 2k and 2k + 1 are adjacent.
    """
    across = np.stack([words[:, :-1].ravel(), words[:, 1:].ravel()])
    even = words[: len(words) // 2 * 2]
    down = np.stack([even[::2].ravel(), even[1::2].ravel()])
    pairs = np.concatenate([across, down], axis=1)
    pairs = pairs[:, (pairs >= 0).all(axis=0) & (pairs[0] != pairs[1])]
    return pairs[:, :: max(1, pairs.shape[1] // _MOST_PAIRS)]


def _is_better(
    pairs: NDArray[np.int64], other: Reading, said: Reading, jumps: tuple[float, float]
) -> bool:
    """Return whether the other reading, with the first of two jumps, is the right one."""
    smaller, larger = jumps
    if smaller <= larger - _MARGIN:
        return True
    if smaller > larger - _LESS:
        return False
    near, said_near = (share_near(pairs, reading, smaller) for reading in (other, said))
    return near > 0.9 and said_near < near - _MORE_NEAR


def _readings(said: Reading) -> list[Reading]:
    # Plain binary inverted is plain binary mirrored: that is no other smoothness.
    orders = (said.order, said.order[::-1])
    ways = [
        Reading(order, binary, inverted)
        for order in orders
        for binary, inverted in ((False, False), (False, True), (True, False))
    ]
    return list(dict.fromkeys([said, *ways]))


def _swapped(said: Reading, a: int, b: int) -> Reading:
    order = list(said.order)
    order[a], order[b] = order[b], order[a]
    return said._replace(order=tuple(order))


def _best_repair(pairs: NDArray[np.int64], said: Reading, jump: float) -> Reading:
    """Return the reading that makes nearly all far jumps short, or `said`.

    Two coarse bits that changed places, or one that is inverted, show at their few edges only.
    """
    codes = read_codes(pairs, said)
    far = np.abs(codes[0] - codes[1]) > 2.0 ** (jump + 2.0)
    count = int(np.count_nonzero(far))
    # Steps of the surface make 3 % of far jumps (board); no exchange shortens most of them.
    if count < max(40, 0.003 * far.size):
        return said
    thin = pairs[:, far][:, :: max(1, count // 500)]

    tried = [_swapped(said, a, b) for a, b in combinations(range(len(said.order)), 2)]
    if not said.binary:
        tried += [said._replace(flipped=place) for place in said.order[1:]]
    best = min(tried, key=lambda reading: mean_jump(thin, reading))
    first, second = read_codes(pairs, best)
    still_far = np.count_nonzero(np.abs(first - second) > 2.0 ** (jump + 2.0))
    return best if still_far < 0.3 * count else said


def check_neighbours(
    words: NDArray[np.int64], said: Reading, frames: Sequence[int], axis: str
) -> Contradiction | None:
    """Hold the codes of neighbouring pixels against each other.

    Parameters
    ----------
    words : (rows, columns) ndarray of int
        Bits of every pixel, the first frame's highest; −1 where they are uncertain. Row 2k and
        2k + 1 are adjacent.
    said : Reading
        How the sequence says that the bits are read.
    frames : sequence of int
        Frame of every bit, for the message.
    axis : str
        ``columns`` or ``rows``.

    Returns
    -------
    Contradiction or None
        ``neighbouring-codes``.
    """
    pairs = neighbouring_pairs(words)
    if pairs.shape[1] < _LEAST_PAIRS or len(said.order) < 3:
        return None
    jump = mean_jump(pairs, said)
    tried = {reading: mean_jump(pairs, reading) for reading in _readings(said)}
    best = min(tried, key=lambda reading: tried[reading])
    smallest = tried[best]
    is_better = _is_better(pairs, best, said, (smallest, jump))
    if not is_better:
        best = _best_repair(pairs, said, jump)
        smallest = mean_jump(pairs, best)
        is_better = best != said
    compared = f"codes of the {axis} in neighbouring pixels"
    typical = 2.0**jump
    found = f"where they differ, it is typically by {typical:.1f}"
    if is_better:
        return Contradiction(
            check="neighbouring-codes",
            compared=compared,
            found=f"{found}, and by {2.0**smallest:.1f} if read otherwise",
            explanation=_name(best, said, frames),
        )
    # Random codes of n bits differ by 2^(n − 2) in this mean.
    if jump > len(said.order) - 3 and len(said.order) >= 6:
        return Contradiction(
            check="neighbouring-codes",
            compared=compared,
            found=f"{found}, as codes at random do",
            explanation="no other order of the bits does better: check which frames are the bits",
        )
    return None


def _name(best: Reading, said: Reading, frames: Sequence[int]) -> str:
    """Say what differs between the reading that fits and the one that was said."""
    reasons = []
    if best.order == said.order[::-1]:
        reasons.append("the frames are given finest bit first: turn their order round")
    elif best.order != said.order:
        moved = [frames[a] for a, b in zip(said.order, best.order, strict=True) if a != b]
        reasons.append(f"frames {' and '.join(map(str, moved))} change places")
    if best.inverted != said.inverted:
        reasons.append(
            "light and dark are exchanged: the inverse frames come first, or white and black are "
            "exchanged"
        )
    if best.flipped >= 0:
        reasons.append(f"light and dark are exchanged in frame {frames[best.flipped]} alone")
    if best.binary != said.binary:
        kind = "plain binary, not Gray code" if best.binary else "Gray code, not plain binary"
        reasons.append(f"the bits are {kind}")
    return "; ".join(reasons)


_SAME, _CHANGES = 0.999, 0.02
_BLOCKS, _FILLED = 3, 10
"""So many runs of one value of the coarser bits, of so many pixels each, hold an edge of a bit."""


def check_bits(words: NDArray[np.int64], frames: Sequence[int], axis: str) -> Contradiction | None:
    """Check that each frame of a code shows a bit of its own.

    Parameters
    ----------
    words, frames, axis
        As `check_neighbours`.

    Returns
    -------
    Contradiction or None
        ``neighbouring-codes``: a frame that is the same everywhere though it cannot be, as a white
        one is, or two that show the same.
    """
    known = words[words >= 0]
    if known.size < _LEAST_PAIRS:
        return None
    known = known[:: max(1, known.size // _MOST_PAIRS)]
    n = len(frames)
    bits = ((known[:, None] >> np.arange(n)[::-1]) & 1).astype(np.bool_)
    share = bits.mean(axis=0)
    rare = np.minimum(share, 1.0 - share)
    found = ""
    for place in range(n):
        # Between two edges of the coarser bits lies one of this bit.
        _, blocks = np.unique(known >> (n - place), return_counts=True)
        if rare[place] < 1.0 - _SAME and np.count_nonzero(blocks >= _FILLED) >= _BLOCKS:
            found = f"frame {frames[place]} is the same everywhere, though coarser bits change"
    for a, b in combinations(np.flatnonzero(rare > _CHANGES).tolist(), 2):
        if np.mean(bits[:, a] == bits[:, b]) > _SAME:
            found = f"frames {frames[a]} and {frames[b]} show the same"
    if not found:
        return None
    return Contradiction(
        check="neighbouring-codes",
        compared=f"the bits of the {axis} with one another",
        found=found,
        explanation="check which frames are the bits: one may be missing, or be a white one",
    )


def check_exchanged(
    white: NDArray[np.floating], black: NDArray[np.floating], least: float
) -> Contradiction | None:
    """Check that the white frame is brighter than the black one.

    Parameters
    ----------
    white, black : ndarray
        Grey levels of the same pixels.
    least : float
        Difference from which on a pixel counts.
    """
    difference = np.asarray(white, dtype=np.float64) - black
    lit = np.abs(difference) >= least
    if np.count_nonzero(lit) < _LEAST_PAIRS or np.mean(difference[lit] < 0) < 0.9:
        return None
    return Contradiction(
        check="neighbouring-codes",
        compared="the white frame against the black one",
        found=f"{100 * float(np.mean(difference[lit] < 0)):.0f} % of the pixels are darker in it",
        explanation="white_frame and black_frame are exchanged",
    )


def check_coverage(
    words: NDArray[np.int64], said: Reading, n_codes: int, first_code: int | None, axis: str
) -> Contradiction | None:
    """Hold the codes that are read against those that the projector shows.

    Parameters
    ----------
    words, said, axis
        As `check_neighbours`.
    n_codes : int
        How many codes lie on the projector.
    first_code : int or None
        Code at the projector's first pixel; None where nobody said, and 0 is assumed.

    Returns
    -------
    Contradiction or None
        ``code-range``: codes beyond the projector are read, or the frames allow centred codes and
        nobody said which code comes first.
    """
    supported = _supported(words, said)
    if supported.size < _LEAST_PAIRS:
        return None
    total = 1 << len(said.order)
    assumed = first_code or 0
    lowest, highest = (int(each) for each in np.percentile(supported, [0.2, 99.8]))
    beyond = int(np.count_nonzero((supported < assumed) | (supported >= assumed + n_codes)))
    centred = (total - n_codes) // 2
    fits = max(0, highest - n_codes + 1), min(lowest, total - n_codes)
    other = "" if fits[0] > fits[1] else f"a first_code of {fits[0]} to {fits[1]} fits"
    if other and fits[0] <= centred <= fits[1] and centred != assumed:
        other += f" (codes centred on the projector: {centred})"
    compared = f"codes of the {axis} against the projector's {n_codes}"
    # Stray light and edges of shadows make codes beyond it: below 0.01 % on the recordings.
    if beyond > 0.005 * supported.size:
        return Contradiction(
            check="code-range",
            compared=compared,
            found=(
                f"{100 * beyond / supported.size:.1f} % of well lit pixels read codes that it does "
                f"not show: {lowest} to {highest}, where {assumed} to {assumed + n_codes - 1} are"
            ),
            explanation=other or "check the projector's size, the bits, and the width of a code",
        )
    if first_code is None and 0 < centred <= fits[1]:
        return Contradiction(
            check="code-range",
            compared=compared,
            found=(
                f"{len(said.order)} bits make {total} codes; which of them its first pixel shows "
                "nobody said, and 0 is assumed"
            ),
            explanation=(
                f"the frames allow {fits[0]} to {fits[1]}, and many programs centre the codes: "
                f"first_code = {centred}; say it (or first_code = 0): all coordinates differ by "
                f"{centred} codes"
            ),
        )
    return None


def _supported(words: NDArray[np.int64], said: Reading) -> NDArray[np.int64]:
    """Return the codes of pixels whose right neighbour reads nearly the same code."""
    codes = np.where(words >= 0, read_codes(words, said), -(1 << 20))
    near = (np.abs(codes[:, 1:] - codes[:, :-1]) <= 8) & (words[:, 1:] >= 0)
    return np.asarray(codes[:, 1:][near & (words[:, :-1] >= 0)])
