"""Periods and direction of fringes of which only the steps are known.

With a code they follow from its coordinate. Without one the phases themselves tell: a fringe, or a
beat Σk_i·φ_i of several, that does not repeat in view is a coordinate; finer beats are unwrapped by
it, up to the finest fringe (as `exposight.imaging.ladders` does with known periods). All phases
against that coordinate give the ratios of their periods, and the least whole numbers of such ratios
are proposed.
"""

import math
from collections.abc import Sequence
from itertools import product
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from exposight.contradictions.steps import Relation, best_relation, relation
from exposight.errors import ImageError
from exposight.imaging.codings import Fringe

_Array = NDArray[np.float64]

_SPAN = 1000
"""Length that a coordinate of unknown scale is given, from one side of the view to the other."""
_LARGEST_SUMS = {1: 1, 2: 4, 3: 4}
"""Largest Σ|k_i| of beats by number of fringes; 3 from four on."""
_MOST_TIMES = 24
"""The coarsest beat in view has at most so many periods over the projector."""
_WHOLE = 0.03
"""Periods that stray less from whole numbers are whole."""


class View(NamedTuple):
    """Samples of lit pixels along lines of one direction: (n, lines, length), and where lit."""

    samples: _Array
    lit: NDArray[np.bool_]


class PlacedFringe(NamedTuple):
    """A fringe with its periods and shifts, how sure these are (0 to 1 or None), and why."""

    fringe: Fringe
    sure: float | None
    why: str


def phase_of(view: View, fringe: Sequence[int]) -> _Array:
    """Return the phase of equal steps, (lines, length), in periods from 0 to 1."""
    turn = np.exp(2j * np.pi * np.arange(len(fringe)) / len(fringe))
    wave = np.tensordot(turn, view.samples[list(fringe)], axes=1)
    return np.asarray(np.angle(wave) / (2 * np.pi) % 1.0, dtype=np.float64)


def periods_in_view(view: View, phase: _Array) -> float:
    """Return by how many periods a phase rises along the view's lines, negative where it falls."""
    rise = _wrapped(np.diff(phase, axis=1))
    return _along_lines(rise, view.lit[:, 1:] & view.lit[:, :-1])


def _wrapped(periods: NDArray[np.floating]) -> _Array:
    return np.asarray(periods - np.rint(periods), dtype=np.float64)


def _along_lines(rise: _Array, both: NDArray[np.bool_]) -> float:
    """Sum a rise from pixel to pixel, and return the median of the lines that are mostly lit."""
    count = both.sum(axis=1)
    whole = count >= max(1, 0.5 * float(count.max(initial=0)))
    if not whole.any():
        return 0.0
    return float(np.median(np.sum(rise, axis=1, where=both)[whole]))


def place_by_code(
    view: View,
    fringes: Sequence[tuple[int, ...]],
    coordinate: _Array,
    size: int,
    code_width: int | None,
    why: str = "coherence with the code",
) -> list[PlacedFringe]:
    """Give fringes their periods and direction by the coordinate of a code.

    Parameters
    ----------
    view : View
        Along the axis.
    fringes : sequence of tuple of int
        Frames of each one's steps, from few periods to many.
    coordinate : (lines, length) ndarray, px
        Of the code; NaN where unknown.
    size : int, px
        The projector's length.
    code_width : int, px, or None
        Of a code, where periods may be simple in codes.
    why : str
        What the numbers rest on, for people.
    """
    placed = []
    for fringe in fringes:
        phase = phase_of(view, fringe)
        usable = view.lit & np.isfinite(coordinate)
        exact = _periods(coordinate[usable], phase[usable], size, code_width)
        placed.append(_placed(fringe, exact, why))
        if exact.coherence > 0.5 and exact.periods != 0:  # a finer coordinate for the next one
            coordinate = np.where(usable, _refined(coordinate, phase, exact, size), np.nan)
    return placed


def _placed(fringe: tuple[int, ...], found: Relation, why: str) -> PlacedFringe:
    n = len(fringe)
    sign = math.copysign(1.0, found.periods)
    offset_deg = 360.0 * _snapped(found.offset, n)
    shifts = tuple(_turned(sign * (360.0 * k / n - offset_deg)) for k in range(n))
    is_default = sign > 0 and not offset_deg
    return PlacedFringe(
        Fringe(periods=abs(found.periods), frames=fringe, shifts_deg=() if is_default else shifts),
        found.coherence,
        why + ("; it runs backwards" if sign < 0 else ""),
    )


def _refined(coordinate: _Array, phase: NDArray[np.floating], found: Relation, size: int) -> _Array:
    """Return the coordinate that a phase tells, its order taken from a coarser coordinate."""
    order = np.rint(coordinate * (found.periods / size) + found.offset - phase)
    return np.asarray((phase + order - found.offset) * (size / found.periods))


def _turned(degrees: float) -> float:
    """Return an angle in whole degrees, from −180 to 179."""
    return float(round((degrees + 180.0) % 360.0 - 180.0)) + 0.0


def _snapped(offset: float, n: int) -> float:
    """Return an offset in periods: none, or whole steps (another frame comes first), if near."""
    whole = round(offset * n) / n
    return whole if abs(offset - whole) < 0.08 else offset


def _periods(at: _Array, phase: _Array, size: int, code_width: int | None) -> Relation:
    """Return a fringe's periods: a whole number, or simple in periods a code, where one fits."""
    found = best_relation(at, phase, size / 8, size)
    # A view of a part of the projector tells periods only so well.
    seen = float(np.ptp(np.percentile(at, [1, 99]))) / size
    blur = max(0.15, 0.15 / max(seen, 0.05))
    sign = math.copysign(1.0, found.periods)
    near = range(math.ceil(abs(found.periods) - blur), int(abs(found.periods) + blur) + 1)
    simple = [float(each) for each in near if each >= 1]
    if code_width is not None:
        per_code = round(2 * abs(found.periods) * code_width / size) / 2
        in_px = per_code * size / code_width
        if per_code and abs(in_px - abs(found.periods)) < blur:
            simple.append(in_px)
    tried = [relation(at, phase, sign * each, size) for each in simple]
    # Nearly all fringes begin with a step at column 0: without an offset, a number fits better.
    good = [each for each in tried if each.coherence > 0.85 * found.coherence]
    if not good:
        return relation(at, phase, round(found.periods, 2), size)
    return max(good, key=lambda each: each.coherence * math.cos(2 * math.pi * each.offset))


# --- without a code -----------------------------------------------------------------------------


class _Beat(NamedTuple):
    """k of every phase, periods in view, and the standard deviation of their sum in periods."""

    k: tuple[int, ...]
    turns: float
    noise: float


def place_alone(view: View, fringes: Sequence[tuple[int, ...]]) -> list[PlacedFringe]:
    """Give fringes their periods and direction by each other's phases.

    The coarsest beat is taken to rise to the camera's right, or downwards, and to be 0 at the
    projector's first pixel.

    Parameters
    ----------
    view : View
        Along the axis.
    fringes : sequence of tuple of int
        Frames of each one's steps.

    Raises
    ------
    ImageError
        If every fringe, and every beat of some, repeats in view.
    """
    phases = np.array([phase_of(view, fringe) for fringe in fringes])
    beats = _beats(view, phases)
    clear = [beat for beat in beats if 10 * beat.noise < abs(beat.turns) <= 1.05]
    clear = [beat for beat in clear if abs(beat.turns) <= 0.9] or clear[:1]  # whole in view, or so
    if not clear:
        msg = (
            "no fringe, and no beat of several, has one period in view, and no code tells periods "
            "apart: say in a sequence's file how many periods each fringe has"
        )
        raise ImageError(msg)
    coarsest = max(clear, key=lambda beat: abs(beat.turns) / beat.noise)
    x = _coordinate(view, phases, beats, coarsest)
    usable = np.isfinite(x)
    at = x[usable]
    fits = [_fit(at, phase[usable], periods_in_view(view, phase)) for phase in phases]
    rates = np.array([fit.periods for fit in fits])
    of_beat = abs(float(np.dot(coarsest.k, rates)))
    is_single = sum(map(abs, coarsest.k)) == 1
    named = "a fringe" if is_single else "a beat"
    whole = _whole(rates / of_beat)
    if whole is None:  # harmonics bend phases: only numbers of which one is likely are left
        phase = np.tensordot(coarsest.k, phases, axes=1) % 1.0
        rising = phase if coarsest.turns > 0 else (1.0 - phase) % 1.0
        why = f"coherence with {named} that does not repeat in view, taken as one period"
        order = sorted(range(len(fringes)), key=lambda i: abs(rates[i]))
        by_beat = np.where(view.lit, rising * _SPAN, np.nan)
        found = place_by_code(view, [fringes[i] for i in order], by_beat, _SPAN, None, why)
        placed = [found[order.index(i)] for i in range(len(fringes))]
        return _assumed(placed, coarsest) if is_single else placed
    periods, times = whole
    exact = [
        relation(at, phase[usable], each * of_beat / times, _SPAN)
        for phase, each in zip(phases, periods, strict=True)
    ]
    offsets = _offsets(np.array([each.offset for each in exact]), periods, coarsest.k, times)
    why = f"ratio to {named} that does not repeat in view, in whole numbers; coherence with it"
    placed = []
    for i, fringe in enumerate(fringes):
        at_first = Relation(exact[i].coherence, offsets[i], float(periods[i]))
        placed.append(_placed(fringe, at_first, why))
    return _assumed(placed, coarsest) if is_single else placed


def _assumed(placed: Sequence[PlacedFringe], coarsest: _Beat) -> list[PlacedFringe]:
    """Say of the fringe on which the others rest that its own number is an assumption."""
    return [
        each._replace(
            sure=None,
            why=(
                "it does not repeat in view; its number over the projector, and that it rises to "
                "the camera's right (or downwards), are assumptions"
            ),
        )
        if k
        else each
        for each, k in zip(placed, coarsest.k, strict=True)
    ]


def _beats(view: View, phases: _Array) -> list[_Beat]:
    """Return beats of small whole numbers, from coarse to fine, none finer than the fringes."""
    n = len(phases)
    thin = slice(None, None, max(1, view.lit.size // 40_000))
    lit = view.lit[thin]
    both = lit[:, 1:] & lit[:, :-1]
    rises = _wrapped(np.diff(phases[:, thin], axis=2))
    bends = np.abs(_wrapped(np.diff(rises, axis=2)))[:, both[:, 1:] & both[:, :-1]]
    noise = np.maximum(1.4826 / math.sqrt(6) * np.median(bends, axis=1), 5e-4)
    largest = _LARGEST_SUMS.get(n, 3)
    typical = np.median(rises[:, both], axis=1)
    finest = min(0.4, 1.02 * float(np.abs(typical).max()))  # of 0.5 on a sum only seems coarse
    beats = []
    for k in product(range(-largest, largest + 1), repeat=n):
        first = next((each for each in k if each), 0)
        if first <= 0 or sum(map(abs, k)) > largest or math.gcd(*k) != 1:
            continue
        if abs(float(np.dot(k, typical))) <= finest:
            turns = _along_lines(_wrapped(np.tensordot(k, rises, axes=1)), both)
            beats.append(_Beat(k, turns, float(np.hypot.reduce(np.array(k) * noise))))
    return sorted(beats, key=lambda beat: abs(beat.turns))


def _coordinate(view: View, phases: _Array, beats: Sequence[_Beat], coarsest: _Beat) -> _Array:
    """Return a coordinate of unknown scale, 0 to `_SPAN` over the view, by ever finer beats."""
    beat = coarsest
    phase = np.tensordot(beat.k, phases, axes=1) % 1.0
    counts = np.histogram(phase[view.lit], bins=60, range=(0, 1))[0]
    smooth = counts + np.roll(counts, 1) + np.roll(counts, -1)
    # Where it is least seen the beat may begin anew; that is column 0 if there is nothing to tell.
    cut = 0.0 if smooth[0] <= 1.2 * smooth.min() + 5 else (float(smooth.argmin()) + 0.5) / 60
    x = np.where(view.lit, (phase - cut) % 1.0, np.nan)
    x = _spread(x if beat.turns > 0 else -x)
    left = [each for each in beats if abs(each.turns) > 1.5 * abs(beat.turns)]
    while left:
        noise = beat.noise / abs(beat.turns)
        left = [each for each in left if each.noise / abs(each.turns) < 0.7 * noise]
        # Of the next one's periods; what makes orders wrong is edges more than this noise.
        upset = [abs(each.turns) * noise for each in left]
        safe = [each for each, of_period in zip(left, upset, strict=True) if of_period < 0.06]
        if not left or (not safe and min(upset) > 0.15):
            break
        finer = safe[-1] if safe else left[0]
        phase = np.tensordot(finer.k, phases, axes=1) % 1.0
        usable = np.isfinite(x)
        fit = _fit(x[usable], phase[usable], finer.turns)
        left.remove(finer)
        if fit.coherence > 0.5:
            beat, x = finer, _spread(_refined(x, phase, fit, _SPAN))
    return x


def _spread(x: _Array) -> _Array:
    low, high = np.nanpercentile(x, [0.5, 99.5])
    return np.asarray((x - low) * (_SPAN / (high - low)))


def _fit(at: _Array, phase: NDArray[np.float64], turns: float) -> Relation:
    """Return the periods over `_SPAN` that fit best, exactly: a line through the whole phase."""
    found = best_relation(at, phase, max(2.0 * abs(turns), 8.0), _SPAN)
    for _ in range(3):
        share = at / _SPAN
        left = _wrapped(phase - share * found.periods - found.offset)
        near = np.abs(left) < 0.25
        slope, more = np.polyfit(share[near], left[near], 1)
        found = Relation(found.coherence, found.offset + more, found.periods + slope)
    return relation(at, phase, found.periods, _SPAN)


def _whole(ratios: _Array) -> tuple[_Array, int] | None:
    """Return periods of such ratios to the coarsest beat, and the beat's: least whole numbers.

    Not those that chance would find as well.
    """
    by_chance = (2 * _WHOLE) ** (len(ratios) - 1)
    for times in range(1, 1 + min(_MOST_TIMES, int(0.35 / by_chance))):
        periods = np.rint(ratios * times)
        near = np.abs(ratios * times - periods) < _WHOLE
        if near.all() and np.abs(periods).min() >= 1:
            return periods, times
    return None


def _offsets(offsets: _Array, periods: _Array, k: Sequence[int], times: int) -> list[float]:
    """Return offsets at the projector's first pixel, of those where the view's coordinate is 0.

    The coarsest beat is taken to be 0 there, and all phases if one place near that makes them so.
    """
    of_beat = float(np.dot(k, periods))
    at_beat = float(np.dot(k, offsets))
    # Where the view begins, as a share of the projector: one place for every period of the beat.
    begins = (math.copysign(1.0, of_beat) * at_beat + np.arange(times)) / times % 1.0
    near = begins[:, None] + np.linspace(-0.01, 0.01, 401)[None]
    left = offsets[:, None, None] - periods[:, None, None] * near
    score = np.cos(2 * np.pi * left).mean(axis=0)
    best = np.unravel_index(int(score.argmax()), score.shape)
    begin = near[best] if score[best] > 0.8 else begins[best[0]]
    return [float(each) for each in _wrapped(offsets - periods * begin)]
