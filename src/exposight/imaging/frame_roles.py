"""What each frame of a recording shows, from grey levels alone: white, black, bits, fringes.

A fully lit frame is brighter than all others nearly everywhere, an unlit one darker. The steps of a
fringe add up to the same in every pixel and have one amplitude. A bit and its inverse add up to
white and black. What is left over are bits.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

_Array = NDArray[np.float32]

_MAX_STEPS = 16

# Shares of a pixel's contrast. Steps that belong together add up within 0.01 on the recordings, and
# steps of different fringes miss by 0.1 and more; a bit and its inverse within 0.03.
_SUM_TOLERANCE = 0.04
_INVERSE_TOLERANCE = 0.10


@dataclass(frozen=True, kw_only=True)
class FrameRoles:
    """What the frames show.

    Parameters
    ----------
    white, black : int or None
    fringes : tuple of tuple of int
        Frames of each fringe's steps, in the order of the recording.
    bits : tuple of int
        Frames of bits, in the order of the recording.
    inverses : tuple of int
        Of each bit, or none. Which of the two is the bit is not known from sums.
    agreement : dict
        Share of lit pixels that agree: of "white and black", "inverses" and each fringe's number.
    """

    white: int | None
    black: int | None
    fringes: tuple[tuple[int, ...], ...]
    bits: tuple[int, ...]
    inverses: tuple[int, ...]
    agreement: dict[str, float]


def frame_roles(samples: _Array) -> FrameRoles:
    """Tell what each frame shows.

    Parameters
    ----------
    samples : (n, pixels) ndarray of float32
        Grey levels of pixels that the projector lights.
    """
    dark, bright = samples.min(axis=0), samples.max(axis=0)
    share = (samples - dark) / np.maximum(bright - dark, 1e-6)
    agreement: dict[str, float] = {}
    white, black = _white_and_black(share, agreement)
    rest = [i for i in range(len(samples)) if i not in {white, black}]
    # Sets of steps add up to the same, which white and black tell; without them, sets tell it.
    known = None if white is None else np.full(share.shape[1], np.nan, dtype=np.float32)
    fringes = _fringes(share, rest, known, agreement)
    rest = [i for i in rest if not any(i in fringe for fringe in fringes)]
    bits, inverses = _pairs(share, rest, agreement)
    return FrameRoles(
        white=white,
        black=black,
        fringes=tuple(fringes),
        bits=tuple(bits),
        inverses=tuple(inverses),
        agreement=agreement,
    )


def _white_and_black(share: _Array, agreement: dict[str, float]) -> tuple[int | None, int | None]:
    """Return the brightest and the darkest frame, where they are so in nearly all pixels."""
    lit, unlit = (share > 0.85).mean(axis=1), (share < 0.15).mean(axis=1)
    n = len(share)

    def rank(pair: tuple[int, int]) -> tuple[bool, bool, float]:
        # A coarse bit and its inverse look the same where the view is on one side of its edge;
        # but white and black mostly begin or end a recording.
        in_a_row = abs(pair[0] - pair[1]) == 1
        return in_a_row, bool({0, n - 1} & set(pair)), float(lit[pair[0]] + unlit[pair[1]])

    likely = [
        (int(i), int(j)) for i in np.flatnonzero(lit > 0.9) for j in np.flatnonzero(unlit > 0.9)
    ]
    if not likely:
        return None, None
    white, black = max(likely, key=rank)
    agreement["white and black"] = float(min(lit[white], unlit[black]))
    return white, black


def _fringes(
    share: _Array, frames: Sequence[int], mean: _Array | None, agreement: dict[str, float]
) -> list[tuple[int, ...]]:
    """Return sets of equal steps: in a row, or every second, third … frame."""
    left = list(frames)
    found: list[tuple[int, ...]] = []
    while len(left) >= 3:
        # The mean of whole sets is that of each of them.
        sums = share[left].mean(axis=0) if mean is None else mean
        for group in _groups(left):
            alone = mean is None and len(group) == len(left)
            agreeing = _is_fringe(share[list(group)], sums, all_round=alone)
            if agreeing > 0.7:
                found.append(group)
                agreement[f"steps {group[0]} to {group[-1]}"] = agreeing
                left = [i for i in left if i not in group]
                mean = share[list(group)].mean(axis=0) if mean is None else mean
                break
        else:
            left = left[1:]  # no set begins with it: a bit out of focus
    return found


def _groups(frames: Sequence[int]) -> Iterator[tuple[int, ...]]:
    """Yield candidates for one fringe: the first frames of a row, or every d-th one."""
    for stride in range(1, 1 + min(8, len(frames) // 3)):
        for n in range(3, min(_MAX_STEPS, 1 + (len(frames) - 1) // stride) + 1):
            group = tuple(frames[: (n - 1) * stride + 1 : stride])
            if len(group) == n and np.ptp(np.diff(group)) == 0:
                yield group


def _is_fringe(steps: _Array, mean: _Array, *, all_round: bool) -> float:
    """Return the share of pixels in which steps can be those of one fringe; 0 where few can.

    Without a mean to compare with (NaN) theirs must be the same share of each pixel's contrast.
    """
    n = len(steps)
    if mean.size >= 2_000:  # most candidates fail at a glance
        few = steps[:, ::64].mean(axis=0)
        target = float(np.median(few)) if np.isnan(mean[0]) else mean[::64]
        if np.median(np.abs(few - target)) > 2 * _SUM_TOLERANCE:
            return 0.0
    own = steps.mean(axis=0)
    sums = np.abs(own - (float(np.median(own)) if np.isnan(mean[0]) else mean))
    if np.median(sums) > _SUM_TOLERANCE:
        return 0.0
    # Of a sinusoid a quarter of all samples is that near to the middle; of sharp bits, none.
    if np.mean(np.abs(steps - 0.5) < 0.2) < 0.1:
        return 0.0
    turn = np.exp(-2j * np.pi * np.arange(n) / n)
    wave = 2.0 / n * np.tensordot(turn, steps, axes=1)
    amplitude = np.abs(wave)
    typical = float(np.median(amplitude))
    if typical < 0.1:
        return 0.0
    fitted = (wave[None] * turn.conj()[:, None]).real + own
    residual = np.sqrt(np.mean((steps - fitted) ** 2, axis=0))
    # Phases of a fringe are spread about the circle, or a part of it; those of bits are few.
    counts = np.histogram(np.angle(wave), bins=24, range=(-np.pi, np.pi))[0]
    occupied = np.mean(counts > 0.005 * wave.size)
    if occupied < (0.6 if all_round else 0.15):
        return 0.0
    # Gamma 2.2 leaves a residual of 0.2 times the amplitude; light that returns from other places
    # weakens a fringe.
    good = (
        (sums < 2 * _SUM_TOLERANCE)
        & (amplitude > 0.3 * typical)
        & (amplitude < 2.0 * typical)
        & (residual < 0.35 * typical)
    )
    return float(np.mean(good))


def _pairs(
    share: _Array, frames: Sequence[int], agreement: dict[str, float]
) -> tuple[list[int], list[int]]:
    """Split frames into bits and inverses: alternating, or one half after the other."""
    n = len(frames)
    if n >= 4 and n % 2 == 0:
        half = n // 2
        for first, second in ((frames[::2], frames[1::2]), (frames[:half], frames[half:])):
            total = share[list(first)] + share[list(second)]
            agreeing = np.mean(np.abs(total - 1) < 2 * _INVERSE_TOLERANCE, axis=1)
            if np.median(agreeing) > 0.8 and agreeing.min() > 0.5:
                agreement["inverses"] = float(agreeing.mean())
                return list(first), list(second)
    return list(frames), []
