"""Phase-shifted fringes: from frames to projector coordinates, unwrapped step by step.

For I_k = A + B·cos(φ − δ_k) the least-squares solution of A, B·cos φ and B·sin φ is linear in the
samples. With three equal steps it is φ = atan2(√3·(I₂ − I₃), 2·I₁ − I₂ − I₃). A phase of p periods
over a projector of W px means the coordinate φ/(2π·p)·W, phase 0 being the centre of pixel 0.
"""

import numba
import numpy as np
from numpy.typing import NDArray

from exposight.compiled import njit
from exposight.imaging.decoded import (
    AMBIGUOUS,
    CLIPPED,
    LOW_MODULATION,
    OUTSIDE,
    AxisMap,
    DecodingLimits,
)
from exposight.imaging.frames import Levels, Light
from exposight.imaging.gray_code import CodeMap
from exposight.imaging.response import phase_correction
from exposight.imaging.sequences import AxisCoding, PatternSequence


def decode_fringes(
    light: Light,
    sequence: PatternSequence,
    coding: AxisCoding,
    size: int,
    limits: DecodingLimits,
    by_code: CodeMap | None,
) -> AxisMap:
    """Decode the fringes of one projector axis.

    Parameters
    ----------
    light : Light
        All frames of the recording.
    sequence : PatternSequence
        What they show.
    coding : AxisCoding
        The coding of this axis.
    size : int, px
        The projector's length along this axis.
    limits : DecodingLimits
        When a pixel counts as decoded.
    by_code : CodeMap, optional
        What the axis' Gray code says of every pixel; its modulation and flags are taken over.

    Returns
    -------
    AxisMap
        A pixel with a clipped sample has no coordinate: its phase is wrong.
    """
    fringes, ladder = coding.fringes, coding.ladder(size)
    numbers = np.array(ladder.combinations, dtype=np.float64)
    periods = numbers @ np.array([fringe.periods for fringe in fringes])
    solvers = [fringe.solver() for fringe in fringes]
    corrections: NDArray[np.float64] = np.empty((0, 0))
    if sequence.projector_gamma != 1.0:
        corrections = np.stack(
            [
                phase_correction(
                    fringe.steps_deg, sequence.projector_gamma, sequence.pattern_contrast
                )
                for fringe in fringes
            ]
        )
    # A whole number of periods repeats at the border: there, −ε and W − ε look alike.
    cyclic = by_code is None and all(float(fringe.periods).is_integer() for fringe in fringes)
    known = by_code or CodeMap(  # nothing is known before the first phase
        coordinate=np.empty((0, 0)),
        modulation=np.full(light.image_shape, np.inf, dtype=np.float32),
        flags=np.zeros(light.image_shape, dtype=np.uint8),
        is_located=np.empty((0, 0), dtype=np.bool_),
        is_decided=np.empty((0, 0), dtype=np.bool_),
        half_code=0.0,
    )
    coordinate = np.empty(light.image_shape)
    _unwrap(
        light.frames,
        np.concatenate([fringe.frames for fringe in fringes]).astype(np.int64),
        np.cumsum([0, *(len(fringe.frames) for fringe in fringes)]),
        np.concatenate([solver[1] for solver in solvers]),
        np.concatenate([solver[2] for solver in solvers]),
        corrections,
        numbers,
        size / periods,
        ladder.n_checks,
        known.coordinate,
        known.is_located,
        known.is_decided,
        known.half_code,
        size,
        cyclic,
        light.clips_at,
        light.scale,
        limits.min_modulation,
        limits.max_residual,
        coordinate,
        known.modulation,
        known.flags,
    )
    return AxisMap(coordinate, known.modulation, known.flags)


_BEYOND = 0.05
"""Periods by which phase and the code's border may differ for noise."""


@njit(inline="always", error_model="numpy")
def _unwrap_pixel(
    phase: NDArray[np.float64],
    numbers: NDArray[np.float64],
    periods_px: NDArray[np.float64],
    n_checks: int,
    absolute: float,
    is_known: bool,
    uncertain: float,
    size: int,
    max_residual: float,
) -> tuple[float, bool]:
    """Unwrap one pixel's phases (in periods) step by step; return coordinate and ambiguity.

    `uncertain` is how far the true coordinate may lie on either side of the coarse one, in px;
    below 0 where it surely lies no farther.
    """
    ambiguous = False
    for i in range(periods_px.size):
        part = 0.0
        for j in range(phase.size):
            if numbers[i, j] != 0.0:
                part += numbers[i, j] * phase[j]
        if i == 0 and not is_known:
            # Of the values a period apart, the one nearest to the projector's middle.
            middle = 0.5 * (size - 1) / periods_px[0]
            absolute = (part + np.rint(middle - part)) * periods_px[0]
            continue
        order = np.rint(absolute / periods_px[i] - part)
        fine = (part + order) * periods_px[i]
        residual = abs(absolute - fine) / periods_px[i]
        limit = max_residual
        if i == 0:
            # Within the code's width everything agrees, unless the next period lies there as well:
            # then its order is a toss-up.
            share = uncertain / periods_px[0]
            if share < 0.0:
                limit = max(limit, _BEYOND - share)
            elif share > 0.0:
                limit = min(share + 0.5 - max_residual, 0.5 + max_residual - share)
        ambiguous |= residual > limit
        if i < periods_px.size - n_checks:
            absolute = fine
    return absolute, ambiguous


_AT_LIMIT = 1.0 - 1e-9
"""Amplitudes of whole grey levels often equal the limit but for their last bit, which differs
between processors; these are not below it."""


@njit(parallel=True, error_model="numpy")
def _unwrap(
    frames: Levels,
    frame: NDArray[np.int64],
    first: NDArray[np.int64],
    to_cosine: NDArray[np.float64],
    to_sine: NDArray[np.float64],
    corrections: NDArray[np.float64],
    numbers: NDArray[np.float64],
    periods_px: NDArray[np.float64],
    n_checks: int,
    coarse: NDArray[np.float64],
    is_located: NDArray[np.bool_],
    is_decided: NDArray[np.bool_],
    half_code: float,
    size: int,
    cyclic: bool,
    clips_at: float,
    scale: float,
    min_modulation: float,
    max_residual: float,
    coordinate: NDArray[np.float64],
    modulation: NDArray[np.float32],
    flags: NDArray[np.uint8],
) -> None:
    """Fill coordinate, modulation and flags; fringe i uses steps first[i] … first[i + 1] − 1."""
    n_fringes = first.size - 1
    turn = 2.0 * np.pi
    for r in numba.prange(coordinate.shape[0]):
        cosine, sine, phase = np.empty(n_fringes), np.empty(n_fringes), np.empty(n_fringes)
        for c in range(coordinate.shape[1]):
            coordinate[r, c] = np.nan
            flag = flags[r, c]
            weakest = float(modulation[r, c])
            for i in range(n_fringes):
                cosine[i], sine[i] = 0.0, 0.0
                for k in range(first[i], first[i + 1]):
                    sample = frames[frame[k], r, c]
                    cosine[i] += to_cosine[k] * sample
                    sine[i] += to_sine[k] * sample
                    if sample >= clips_at:
                        flag |= CLIPPED
                amplitude = np.sqrt(cosine[i] * cosine[i] + sine[i] * sine[i]) * scale
                weakest = min(weakest, amplitude)
            modulation[r, c] = weakest
            if weakest < min_modulation * _AT_LIMIT or weakest <= 0.0:
                flag |= LOW_MODULATION
            absolute, uncertain = 0.0, 0.0
            if coarse.size:
                absolute = coarse[r, c]
                if not is_located[r, c]:
                    uncertain = -half_code if is_decided[r, c] else half_code
            flags[r, c] = flag
            if flag & (LOW_MODULATION | CLIPPED) or np.isnan(absolute):
                continue
            for i in range(n_fringes):
                phase[i] = np.arctan2(sine[i], cosine[i]) / turn
                if corrections.size:
                    phase[i] = _corrected(phase[i], corrections[i])
            absolute, ambiguous = _unwrap_pixel(
                phase,
                numbers,
                periods_px,
                n_checks,
                absolute,
                coarse.size > 0,
                uncertain,
                size,
                max_residual,
            )
            if cyclic:
                absolute -= size * np.floor((absolute + 0.5) / size)
            if ambiguous:
                flags[r, c] = flag | AMBIGUOUS
            elif absolute < -0.5 or absolute >= size - 0.5:
                flags[r, c] = flag | OUTSIDE
            else:
                coordinate[r, c] = absolute


@njit(inline="always", error_model="numpy")
def _corrected(phase: float, correction: NDArray[np.float64]) -> float:
    """Return a phase in periods, −½ … ½, with the table's correction, linear between entries."""
    place = (phase + 0.5) * (correction.size - 1)
    left = min(int(place), correction.size - 2)
    share = place - left
    return float(phase + (1.0 - share) * correction[left] + share * correction[left + 1])
