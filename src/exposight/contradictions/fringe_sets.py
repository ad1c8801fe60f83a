"""Phases of a set of fringes against each other, where their beats alone make them absolute.

Every step of unwrapping from a beat to a finer one says the same coordinate twice: the difference,
up to whole periods, is 0 but for noise. Fringes whose steps run the other way, of another number of
periods, or that begin elsewhere, leave other differences. Which of these it is, the phases of
neighbouring pixels tell: from one pixel to another they grow as the numbers of periods do.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from exposight.contradictions.contradiction import Contradiction

_Array = NDArray[np.float64]

_LEAST_PIXELS = 1_000

# Of one step of unwrapping: noise of 0.19 periods leaves a coherence of 0.5. Right sets are off by
# less than 0.01 in the mean; from 0.15 periods on, orders are wrong where noise adds to it.
_COHERENT, _OFFSET, _OFFSET_ERROR = 0.5, 0.07, 0.15

_PERIODS = 0.006
"""Numbers of periods that differ by less are the same; 63 and 64 differ by 1.6 %."""


class FringeSet(NamedTuple):
    """Phases of several fringes along lines of pixels, and how they are unwrapped.

    Parameters
    ----------
    phases : (n, lines, length) ndarray, periods
    usable : (lines, length) ndarray of bool
        Where all fringes are lit well and not clipped.
    periods : (n,) float
        Over the projector's length along this axis.
    frames : (n,) sequence of int
        Frames of each fringe, for messages.
    combinations : (m, n) ndarray of int
        Whole numbers with which phases add up to the beats, from coarse to fine.
    size : int, px
        Length of the projector along this axis.
    axis : str
        ``columns`` or ``rows``.
    """

    phases: _Array
    usable: NDArray[np.bool_]
    periods: Sequence[float]
    frames: Sequence[Sequence[int]]
    combinations: NDArray[np.int64]
    size: int
    axis: str


def check_fringe_set(fringes: FringeSet) -> Contradiction | None:
    """Hold the fringes of a set without a Gray code against each other.

    Parameters
    ----------
    fringes : FringeSet
        Of two or more fringes.

    Returns
    -------
    Contradiction or None
        ``fringe-order``.
    """
    if np.count_nonzero(fringes.usable) < _LEAST_PIXELS:
        return None
    differences = _differences(fringes)
    for number, difference in enumerate(differences, start=1):
        wave = np.exp(2j * np.pi * difference)
        mean = complex(wave[fringes.usable].mean())
        offset = float(np.angle(mean)) / (2 * np.pi)
        if abs(mean) < _COHERENT:
            return _incoherent(fringes, wave, abs(mean))
        if abs(offset) > _OFFSET:
            return _offset(fringes, number, offset)
    return None


def _differences(fringes: FringeSet) -> list[_Array]:
    """Return the difference of each step of unwrapping, in periods of the finer beat."""
    beats = np.tensordot(fringes.combinations, fringes.phases, axes=1)
    periods = fringes.combinations @ np.array(fringes.periods)
    middle = 0.5 * (fringes.size - 1) / fringes.size
    share = (beats[0] + np.rint(middle * periods[0] - beats[0])) / periods[0]
    differences = []
    for beat, count in zip(beats[1:], periods[1:], strict=True):
        order = np.rint(share * count - beat)
        differences.append(beat + order - share * count)
        share = (beat + order) / count
    return differences


def _contradiction(
    fringes: FringeSet, found: str, explanation: str, *, is_error: bool = True
) -> Contradiction:
    listed = ", ".join(f"{each:g}" for each in fringes.periods)
    return Contradiction(
        check="fringe-order",
        compared=f"phases of the fringes of {listed} periods across the {fringes.axis}",
        found=found,
        explanation=explanation,
        is_error=is_error,
    )


def _offset(fringes: FringeSet, number: int, offset: float) -> Contradiction:
    """Name the step that is off, and the shift of all fringes that would explain it."""
    combination = fringes.combinations[number]
    count = float(combination @ np.array(fringes.periods))
    explanation = "the steps of one fringe begin elsewhere than those of the others: say shifts_deg"
    angles = [angle for angle in range(-170, 181, 5) if angle]
    left, angle = min((_left(fringes, angle), angle) for angle in angles)
    if left < 0.5 * _OFFSET:
        explanation = (
            f"steps that all begin {angle:+d}° from those said fit (a sine for a cosine is ±90°): "
            f"add {angle} to each of shifts_deg"
        )
    return _contradiction(
        fringes,
        f"their beats do not meet: that of {count:g} periods is ahead of the coarser ones by "
        f"{offset:+.2f} periods ({offset * fringes.size / count:+.1f} px)",
        explanation,
        is_error=abs(offset) > _OFFSET_ERROR,
    )


def _left(fringes: FringeSet, angle_deg: float) -> float:
    """Return the largest offset, in periods, that shifting all steps by an angle leaves."""
    shifted = fringes._replace(phases=fringes.phases + angle_deg / 360.0)
    means = [
        complex(np.exp(2j * np.pi * difference)[fringes.usable].mean())
        for difference in _differences(shifted)
    ]
    return max(
        abs(float(np.angle(mean))) / (2 * np.pi) if abs(mean) > _COHERENT else 1.0 for mean in means
    )


def _incoherent(
    fringes: FringeSet, wave: NDArray[np.complex128], mean: float
) -> Contradiction | None:
    """Explain phases that have no relation, by how they grow from pixel to pixel; None: noise."""
    both = fringes.usable[:, 1:] & fringes.usable[:, :-1]
    alike = abs(complex((wave[:, 1:] * wave[:, :-1].conj())[both].mean())) if both.any() else 0.0
    found = f"their beats do not meet (coherence {mean:.2f}; 1 is perfect)"
    seen = _seen_periods(fringes)
    if seen is not None:
        said = np.array(fringes.periods)
        turned = seen[0] < 0
        other = np.abs(np.abs(seen[0]) / said - 1) > seen[1]
        reasons = []
        for i in np.flatnonzero(turned):
            reasons.append(
                f"the steps of the fringe of {said[i]:g} periods (frames "
                f"{_list(fringes.frames[i])}) run the other way than those of the others: reversed"
                " = true, or the others are the reversed ones"
            )
        if other.any():
            pairs = ", ".join(
                f"frames {_list(frames)} {abs(count):.1f}"
                for frames, count in zip(fringes.frames, seen[0], strict=True)
            )
            reasons.append(f"other numbers of periods fit, up to a common factor: {pairs}")
        if reasons:
            return _contradiction(fringes, found, "; ".join(reasons))
    # Noise differs from pixel to pixel.
    if alike < 0.8 or alike < 2 * mean:
        return None
    return _contradiction(
        fringes,
        found,
        "they do not belong together: check which frames are which, the numbers of periods and "
        "shifts_deg",
    )


def _list(frames: Sequence[int]) -> str:
    return ", ".join(map(str, frames))


def _seen_periods(fringes: FringeSet) -> tuple[_Array, float] | None:
    """Return the numbers of periods, negative where a phase falls, and their relative uncertainty.

    They are known up to a factor: it is chosen so that most agree with those said.
    """
    near = _growth(fringes, 1)
    typical = [float(np.median(np.abs(each))) if each.size else 0.0 for each in near]
    fastest = int(np.argmax(typical))
    if not 0.0 < typical[fastest] < 0.3:
        return None  # less than three pixels a period: nothing is known of neighbours
    growth = _growth(fringes, max(1, min(64, round(0.25 / typical[fastest]))))
    reference = growth[fastest]
    usual = (np.abs(reference) > 0.05) & (np.abs(reference) < 0.4)
    if np.count_nonzero(usual) < _LEAST_PIXELS // 2:
        return None
    ratios, spread = [], 0.0
    for each in growth:
        ratio = float(np.median(each[usual] / reference[usual]))
        left = np.abs(each[usual] - ratio * reference[usual])
        spread = max(spread, 1.5 * float(np.median(left)))
        ratios.append(ratio)
    noise = spread / float(np.median(np.abs(reference[usual])))
    if noise > 0.5:
        return None
    said, seen = np.array(fringes.periods), np.array(ratios)
    tolerance = _PERIODS + noise**2  # noise of the reference makes ratios smaller
    trials = [seen * (said[i] / seen[i]) for i in range(len(said)) if abs(seen[i]) > 1e-3]

    def misfit(trial: _Array) -> tuple[int, int]:
        wrong = np.abs(np.abs(trial) / said - 1) > tolerance
        return int(np.count_nonzero(wrong)), int(np.count_nonzero(trial < 0))

    return (min(trials, key=misfit), tolerance) if trials else None


def _growth(fringes: FringeSet, lag: int) -> list[_Array]:
    """Return by how much each phase grows over `lag` pixels along the lines, −½ … ½ periods."""
    both = fringes.usable[:, lag:] & fringes.usable[:, :-lag]
    steps = fringes.phases[:, :, lag:] - fringes.phases[:, :, :-lag]
    steps -= np.rint(steps)
    return [each[both] for each in steps]
