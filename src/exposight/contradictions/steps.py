"""Steps of a shifted fringe: against the sinusoid that they sample, and against a coordinate.

N steps I_k = A + B·cos(φ − δ_k) have three unknowns a pixel. From four steps on, what is left over
tells gamma, flicker, swapped frames and motion. Three steps leave nothing over; but there the
harmonic that gamma adds, q·B·cos 2(φ − δ_k), appears as a modulation that varies with 3φ:
|e^{iφ} + q·e^{−2iφ}| = √(1 + q² + 2q·cos 3φ), and one brighter frame as a mean that varies with φ.

For light (½ + ½·cos φ)^γ the second harmonic is q = (γ − 1)/(γ + 2) of the first.
"""

import math
from collections.abc import Iterator, Sequence
from functools import lru_cache
from itertools import combinations
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from exposight.contradictions.contradiction import Contradiction

_Array = NDArray[np.float64]

# Fewer pixels tell nothing for certain; more than this many add time and no certainty.
_LEAST_PIXELS, _MOST_PIXELS = 1_000, 8_000


class Steps(NamedTuple):
    """Samples of one shifted fringe along lines of pixels.

    Parameters
    ----------
    samples : (n, lines, length) ndarray, grey levels
    usable : (lines, length) ndarray of bool
        Pixels that the fringe lights well and that no sample clips.
    shifts_deg : (n,) degrees
    frames : (n,) int
        Their numbers, for messages.
    periods : float
        Periods across the projector.
    size : int, px
        Length of the projector along this axis.
    name : str
        What messages call the fringe.
    is_reversed : bool
        True where the sequence says so of it: `shifts_deg` are then minus the ones written there.
    """

    samples: _Array
    usable: NDArray[np.bool_]
    shifts_deg: Sequence[float]
    frames: Sequence[int]
    periods: float
    size: int
    name: str
    is_reversed: bool = False


class _Fit(NamedTuple):
    """Least-squares sinusoid of every pixel: (p,) mean, amplitude and phase; (n, p) residual."""

    mean: _Array
    amplitude: _Array
    phase: _Array
    residual: _Array
    leftover: _Array
    """(n, n) projector onto what three unknowns cannot fit."""


@lru_cache(maxsize=64)
def _solver(shifts_deg: tuple[float, ...]) -> tuple[_Array, _Array]:
    """Return what takes samples to mean, cosine and sine, and to what these leave over."""
    shifts = np.radians(np.asarray(shifts_deg, dtype=np.float64))
    design = np.column_stack([np.ones_like(shifts), np.cos(shifts), np.sin(shifts)])
    inverse = np.linalg.pinv(design)
    return inverse, np.eye(len(shifts)) - design @ inverse


def _fit(samples: _Array, shifts_deg: Sequence[float]) -> _Fit:
    inverse, leftover = _solver(tuple(shifts_deg))
    mean, cosine, sine = inverse @ samples
    return _Fit(
        mean, np.hypot(cosine, sine), np.arctan2(sine, cosine), leftover @ samples, leftover
    )


def check_steps(steps: Steps, gamma: float = 1.0) -> Iterator[Contradiction]:
    """Hold the steps of a fringe against the sinusoid that they sample.

    Parameters
    ----------
    steps : Steps
        Samples of one fringe.
    gamma : float
        Of the projector, as far as the sequence says and decoding takes it into account.

    Yields
    ------
    Contradiction
        ``fringe-steps``: an error where frames are swapped or the phase is wrong by more than a
        projector pixel, else a warning.
    """
    where = np.flatnonzero(steps.usable)
    if where.size < _LEAST_PIXELS:
        return
    where = where[:: math.ceil(where.size / _MOST_PIXELS)]
    samples = steps.samples.reshape(len(steps.samples), -1)[:, where]
    found = _three(samples, steps, gamma) if len(samples) == 3 else _more(samples, steps, gamma)
    if found is not None:
        yield found


def _more(samples: _Array, steps: Steps, gamma: float) -> Contradiction | None:
    """Explain what four steps and more leave over."""
    fit = _fit(samples, steps.shifts_deg)
    n = len(samples)
    left = float(np.sum(fit.residual**2))
    modulation = float(np.sqrt(np.mean(fit.amplitude**2)))
    rms = math.sqrt(left / (samples.shape[1] * (n - 3))) / modulation
    if rms > 0.1:
        swap, smaller = _best_swap(samples, steps.shifts_deg)
        # With the right order noise is left over: less than half of what a swap leaves.
        if smaller < 0.25 * left:
            first, second = (steps.frames[i] for i in swap)
            return _contradiction(
                steps,
                f"{100 * rms:.0f} % of their amplitude is left over",
                f"frames {first} and {second} fit when they change places",
                is_error=True,
            )
    level = _clipping(samples, fit.residual) if rms > 0.03 else None
    if level is not None:
        return _contradiction(
            steps,
            f"{100 * rms:.0f} % of their amplitude is left over, nearly all of it where samples "
            f"reach {level:.0f}",
            f"the camera clips there, below full scale: saturation_level = {level:.0f}",
            is_error=True,
        )
    angles = fit.phase[None] - np.radians(np.asarray(steps.shifts_deg))[:, None]
    second_harmonic = fit.leftover @ (fit.amplitude * np.cos(2 * angles))
    q, by_gamma = _regression(fit.residual, second_harmonic)
    gains = [_regression(fit.residual, np.outer(fit.leftover[:, k], samples[k])) for k in range(n)]
    flickering = max(range(n), key=lambda k: gains[k][1])
    part, by_flicker = gains[flickering]
    gain = part / (1.0 - part)  # of the frame as it was taken, then as it should have been
    # A harmonic of 3 % and a frame 2 % brighter are the least that matter: of 64 px, they shift
    # four steps by up to 0.1 px. What is left over of noise alone is explained to less than 1 %.
    if by_gamma > by_flicker and by_gamma > 0.2 and abs(q) > 0.03:
        return _gamma(steps, q, gamma, f"{100 * rms:.1f} % of the amplitude is left over")
    if by_flicker > 0.2 and abs(gain) > 0.02:
        return _flicker(steps, flickering, gain, float(fit.mean.mean()) / modulation)
    return _unexplained(steps)


def _best_swap(samples: _Array, shifts_deg: Sequence[float]) -> tuple[tuple[int, int], float]:
    """Return the two steps whose exchange leaves least, and how much (sum of squares)."""
    thin = samples[:, :: max(1, samples.shape[1] // 4_000)]
    scale = samples.shape[1] / thin.shape[1]
    leftover = _solver(tuple(shifts_deg))[1]

    def left(pair: tuple[int, int]) -> float:
        order = list(range(len(samples)))
        order[pair[0]], order[pair[1]] = pair[1], pair[0]
        return float(np.sum((leftover @ thin[order]) ** 2)) * scale

    tried = {pair: left(pair) for pair in combinations(range(len(samples)), 2)}
    least = min(tried.values())
    # Exchanges that turn the order round fit as well: neighbours are likelier.
    likely = [pair for pair, each in tried.items() if each <= 1.5 * least]
    best = min(likely, key=lambda pair: pair[1] - pair[0])
    return best, tried[best]


def _regression(values: _Array, basis: _Array) -> tuple[float, float]:
    """Return the factor of `basis` that fits `values` best, and the share of squares it explains.

    Both are tried pixel by pixel; a basis of nothing explains nothing.
    """
    squares = float(np.sum(basis**2))
    total = float(np.sum(values**2))
    if squares <= 1e-12 * total or total <= 0:
        return 0.0, 0.0
    product = float(np.sum(values * basis))
    return product / squares, product**2 / squares / total


def _three(samples: _Array, steps: Steps, gamma: float) -> Contradiction | None:
    """Find gamma and flicker in three steps, from modulation and mean that follow the phase."""
    fit = _fit(samples, steps.shifts_deg)
    # Few periods: light and shade of the scene would be taken for modulation.
    turns = steps.periods * _covered(fit.phase)
    if turns < 6 or not _equal_steps(steps.shifts_deg):
        return None
    bins = np.floor(fit.phase * (24 / (2 * np.pi))).astype(np.intp) % 24
    if np.bincount(bins, minlength=24).min() < 20:
        return None
    of_contrast = _by_phase(fit.amplitude / np.maximum(fit.mean, 1.0), bins)
    q = _harmonic(of_contrast, 3).real
    by_density = 2 / 3 * complex(np.mean(np.exp(-3j * fit.phase)))
    # Both tell the same harmonic in phase with the fringe; else it is the scene.
    if abs(q) > 0.05 and by_density.real * q > 0 and abs(by_density) > 0.3 * abs(q):
        return _gamma(steps, q, gamma, f"modulation varies by ±{100 * abs(q):.0f} % with 3φ")
    # One frame brighter by g: the mean follows its light by g/3, the amplitude by 2g/3.
    mean, amplitude = _by_phase(fit.mean, bins), _by_phase(fit.amplitude, bins)
    ratio = float(mean.mean() / amplitude.mean())
    by_mean = 3 * ratio * _harmonic(mean, 1)
    by_amplitude = 1.5 / ratio * _harmonic(amplitude, 1)
    own = np.exp(-1j * np.radians(np.asarray(steps.shifts_deg)))
    gains = np.real(by_mean * own.conj())
    step = int(np.abs(gains).argmax())
    gain, other = float(gains[step]), float(np.real(by_amplitude * own[step].conj()))
    one_frame = abs(gain) > 0.9 * abs(by_mean) and abs(other) > 0.9 * abs(by_amplitude)
    if one_frame and min(gain / other, other / gain) > 0.5 and abs(gain) > 0.03:
        return _flicker(steps, step, gain, ratio)
    return None


def _by_phase(values: _Array, bins: NDArray[np.intp]) -> _Array:
    """Return the median in each of 24 parts of the period."""
    return np.array([np.median(values[bins == each]) for each in range(24)])


def _harmonic(middle: _Array, order: int) -> complex:
    """Return the harmonic of values by phase as a share of their mean: h·cos(order·φ − arg)."""
    turn = np.exp(-1j * order * (np.arange(24) + 0.5) * (2 * np.pi / 24))
    return 2 * complex(np.mean(middle * turn)) / float(middle.mean())


def _equal_steps(shifts_deg: Sequence[float]) -> bool:
    total = np.exp(1j * np.radians(np.asarray(shifts_deg))).sum()
    return bool(abs(total) < 1e-6)


def _covered(phase: _Array) -> float:
    """Return the share of a period's phases that occur, 0 to 1."""
    part = np.floor(phase * (24 / (2 * np.pi))).astype(np.intp) % 24
    return np.count_nonzero(np.bincount(part, minlength=24)) / 24


def _gamma(steps: Steps, q: float, known: float, figure: str) -> Contradiction | None:
    """Name the gamma of a second harmonic q, unless it is known already."""
    gamma = (1 + 2 * q) / (1 - q)
    if known != 1.0 and abs(gamma - known) < 0.25 * known:
        return None  # patterns that do not go down to black look like a smaller gamma
    is_three = len(steps.frames) == 3
    error_px = abs(q) / (2 * np.pi) * steps.size / steps.periods if is_three else 0.0
    found = f"the steps are no sinusoid: {figure}, a second harmonic of {100 * q:.0f} %"
    found += (
        f", which shifts the coordinate by up to {error_px:.1f} projector px"
        if is_three
        else ", which four steps and more cancel in the phase"
    )
    said = "" if known == 1.0 else f" ({known:g} is said)"
    return _contradiction(
        steps,
        found,
        f"light of gamma {gamma:.1f} looks so{said}: say projector_gamma, let the projector show "
        "grey linearly, or take more steps",
        is_error=error_px > 1.0,
    )


def _flicker(steps: Steps, step: int, gain: float, mean_over_amplitude: float) -> Contradiction:
    error = abs(gain) * (mean_over_amplitude + 1) * 2 / len(steps.frames)
    error_px = error / (2 * np.pi) * steps.size / steps.periods
    return _contradiction(
        steps,
        f"frame {steps.frames[step]} is {100 * abs(gain):.0f} % "
        f"{'brighter' if gain > 0 else 'darker'} as a whole than the others, which shifts the "
        f"coordinate by up to {error_px:.1f} projector px",
        "the light flickers or was not steady: expose for whole periods of the mains and of the "
        "projector",
        is_error=error_px > 1.0,
    )


def _unexplained(steps: Steps) -> Contradiction | None:
    """Report what is left over alike in neighbouring pixels, and so is no noise."""
    inverse, leftover = (matrix.astype(np.float32) for matrix in _solver(tuple(steps.shifts_deg)))
    samples = steps.samples.astype(np.float32).reshape(len(steps.samples), -1)
    residual = np.where(steps.usable, (leftover @ samples).reshape(steps.samples.shape), 0)
    waves = (inverse[1:] @ samples).reshape(2, *steps.usable.shape)[:, :, 1:]
    pairs = steps.usable[:, 1:] & steps.usable[:, :-1]
    alike = float(np.sum(residual[:, :, 1:] * residual[:, :, :-1])) / (len(residual) - 3)
    share = math.sqrt(max(alike, 0.0) / float(np.sum(waves**2, where=pairs)))
    if share < 0.1:
        return None
    found = f"{100 * share:.0f} % of their amplitude is left over, alike in neighbouring pixels"
    return _contradiction(
        steps,
        found,
        "the part or the sensor moved, frames are of other fringes, or the steps are not those "
        "said: check frames and shifts_deg",
        is_error=share > 0.3,
    )


def _clipping(samples: _Array, residual: _Array) -> float | None:
    """Return the level that samples do not exceed, where nearly all that is left over is there."""
    highest = samples.max(axis=0)
    level = float(highest.max())
    there = highest >= level - 1.0
    squares = (residual**2).sum(axis=0)
    share = float(squares[there].sum() / max(float(squares.sum()), 1e-12))
    return level if share > 0.8 and 30 <= np.count_nonzero(there) < 0.5 * there.size else None


def _contradiction(steps: Steps, found: str, explanation: str, *, is_error: bool) -> Contradiction:
    frames = ", ".join(map(str, steps.frames))
    return Contradiction(
        check="fringe-steps",
        compared=f"{len(steps.frames)} steps of {steps.name} (frames {frames}) and a sinusoid",
        found=found,
        explanation=explanation,
        is_error=is_error,
    )


class Relation(NamedTuple):
    """How a fringe's phase follows a coordinate: coherence 0–1 and offset in periods."""

    coherence: float
    offset: float
    periods: float


def relation(coordinate: _Array, phase: _Array, periods: float, size: int) -> Relation:
    """Return how well a phase is ``periods``·coordinate/size plus an offset.

    Parameters
    ----------
    coordinate : (p,) ndarray, px
    phase : (p,) ndarray, periods
    periods : float
        Periods across `size`; negative where the phase falls.
    size : int, px
    """
    mean = complex(np.mean(np.exp(2j * np.pi * (phase - coordinate * (periods / size)))))
    return Relation(abs(mean), float(np.angle(mean)) / (2 * np.pi), periods)


def best_relation(coordinate: _Array, phase: _Array, periods: float, size: int) -> Relation:
    """Return the number of periods, rising or falling, with which a phase follows a coordinate.

    The mean of e^{iφ} along the coordinate is a wave; its Fourier transform has a peak there.

    Parameters
    ----------
    coordinate, phase, size
        As `relation`.
    periods : float
        The number that is expected; up to four times as many are looked for.
    """
    bins = int(max(64, 8 * abs(periods)))
    at = np.clip((coordinate + 0.5) * (bins / size), 0, bins - 1).astype(np.intp)
    wave = np.exp(2j * np.pi * phase)
    count = np.maximum(np.bincount(at, minlength=bins), 1)
    mean = (
        np.bincount(at, wave.real, minlength=bins) + 1j * np.bincount(at, wave.imag, minlength=bins)
    ) / count
    spectrum = np.fft.fft(mean, 4 * bins)
    peak = int(np.abs(spectrum).argmax())
    rough = (peak if peak < 2 * bins else peak - 4 * bins) / 4
    near = [relation(coordinate, phase, rough + d, size) for d in np.linspace(-0.5, 0.5, 21)]
    return max([*near, relation(coordinate, phase, -periods, size)])


def check_phase(
    coordinate: _Array, phase: _Array, steps: Steps, reference: str, *, expected: float = 1.0
) -> Contradiction | None:
    """Hold a fringe's phase against a coordinate that is known without it.

    Parameters
    ----------
    coordinate : (p,) ndarray, px
        Of the pixels where both are known.
    phase : (p,) ndarray, periods
        Of the same pixels.
    steps : Steps
        The fringe.
    reference : str
        Where the coordinate comes from, for the message.
    expected : float
        The coherence that the coordinate's noise leaves; where it is below 0.3, no relation at all
        tells nothing.

    Returns
    -------
    Contradiction or None
        ``fringe-order``.
    """
    if coordinate.size < _LEAST_PIXELS or expected < 0.3:
        return None
    thin = slice(None, None, math.ceil(coordinate.size / _MOST_PIXELS))
    coordinate, phase = coordinate[thin], phase[thin]
    said = relation(coordinate, phase, steps.periods, steps.size)
    period_px = steps.size / steps.periods
    # Where all is right the coherence is near 1 (of foam's recording 0.9), the offset near 0. From
    # 0.25 periods on, orders are wrong where the code is uncertain too.
    if said.coherence > 0.5:
        if abs(said.offset) < 0.1:
            return None
        found = (
            f"the phase is ahead by {said.offset:+.2f} periods ({said.offset * period_px:+.1f} px)"
        )
        moved = _shifts(steps, 1, said.offset)
        explanation = (
            f"an offset of the code of {-said.offset * period_px:.0f} px (or that and whole "
            f"periods of {period_px:g} px) explains it, or steps of shifts_deg = {moved}"
        )
        return _phase_contradiction(
            steps, reference, found, explanation, is_error=abs(said.offset) > 0.2
        )
    if said.coherence > 0.3 * expected:
        return None  # noise of a coarse fringe, which decoding flags pixel by pixel
    other = best_relation(coordinate, phase, steps.periods, steps.size)
    found = f"the phase follows it with a coherence of {said.coherence:.2f} (1 is perfect)"
    if other.coherence > 0.5 * expected:
        turned = abs(other.periods + steps.periods) < max(1.0, 0.05 * steps.periods)
        if turned:
            again = relation(coordinate, phase, -steps.periods, steps.size)
            other_way = str(not steps.is_reversed).lower()
            shifts = f"shifts_deg = {_shifts(steps, -1, again.offset)}"
            explanation = "the steps run the other way: " + (
                f"reversed = {other_way}, or {shifts}" if abs(again.offset) < 0.1 else shifts
            )
        else:
            way = " that run the other way" if other.periods < 0 else ""
            explanation = (
                f"{abs(other.periods):.3g} periods{way} fit (coherence {other.coherence:.2f}), "
                f"{steps.periods:g} are said"
            )
        return _phase_contradiction(steps, reference, found, explanation, is_error=True)
    return _phase_contradiction(
        steps,
        reference,
        found,
        "they do not belong together: check which frames are which, the number of periods and the "
        "width of a code",
        is_error=said.coherence < 0.15,
    )


def _shifts(steps: Steps, sign: int, offset: float) -> list[float]:
    """Return shifts with which the phase, whose sign is turned for −1, has no such offset.

    They are those to write where the fringe stays as reversed as it is.
    """
    offset_deg = 0.0 if abs(offset) < 0.1 else 360.0 * offset
    written = -sign if steps.is_reversed else sign
    turned = [written * (shift - offset_deg) for shift in steps.shifts_deg]
    return [round((each + 180.0) % 360.0 - 180.0) + 0.0 for each in turned]


def _phase_contradiction(
    steps: Steps, reference: str, found: str, explanation: str, *, is_error: bool
) -> Contradiction:
    return Contradiction(
        check="fringe-order",
        compared=f"phase of {steps.name} and {reference}",
        found=found,
        explanation=explanation,
        is_error=is_error,
    )
