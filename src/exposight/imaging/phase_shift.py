"""Phase shift: from N ≥ 3 shifted fringes to a phase, and from phases to projector coordinates.

For I_k = A + B·cos(φ − δ_k) the least-squares solution of A, B·cos φ and B·sin φ is linear in the
samples. With three equal steps it is φ = atan2(√3·(I₂ − I₃), 2·I₁ − I₂ − I₃). A phase of p periods
over a projector of W px means the coordinate φ/(2π·p)·W, phase 0 being the centre of pixel 0.
"""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING

import numba
import numpy as np

from exposight.cell import GREY_MAX
from exposight.compiled import njit
from exposight.imaging.decoded import AxisMap, DecodingLimits, PixelFlag
from exposight.imaging.gray_code import decode_gray_code

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from exposight.cell import Image
    from exposight.imaging.frames import FrameStack
    from exposight.imaging.sequences import Fringe, PatternSequence, PhaseShift


_LOW = np.uint8(PixelFlag.LOW_MODULATION)
_CLIPPED = np.uint8(PixelFlag.CLIPPED)
_AMBIGUOUS = np.uint8(PixelFlag.AMBIGUOUS)
_OUTSIDE = np.uint8(PixelFlag.OUTSIDE)


def _solver(shifts_deg: Sequence[float]) -> NDArray[np.float64]:
    """Return the (3, n) pseudo-inverse that takes samples to A, B·cos φ, B·sin φ."""
    shifts = np.radians(np.asarray(shifts_deg, dtype=np.float64))
    design = np.column_stack([np.ones_like(shifts), np.cos(shifts), np.sin(shifts)])
    return np.asarray(np.linalg.pinv(design))


def decode_phase_shift(
    stack: FrameStack,
    sequence: PatternSequence,
    phase_shift: PhaseShift,
    size: int,
    limits: DecodingLimits,
) -> AxisMap:
    """Decode the phase-shifted fringes of one projector axis; parameters as `decode_gray_code`.

    Returns
    -------
    AxisMap
        A pixel with a clipped sample has no coordinate: its phase is wrong.
    """
    fringes = phase_shift.fringes
    if phase_shift.gray_code is None:
        coarse, modulation, flags = _unknown(stack.image_shape)
    else:
        coarse, modulation, flags = decode_gray_code(
            stack, sequence, phase_shift.gray_code, size, limits
        )
    coordinate = np.empty(stack.image_shape)
    steps, periods_px = _unwrapping_steps(
        fringes, size, has_gray_code=phase_shift.gray_code is not None
    )
    solvers = [_solver(fringe.shifts_deg) for fringe in fringes]
    # A whole number of periods repeats at the border: there, −ε and W − ε look alike.
    cyclic = coarse.size == 0 and all(float(fringe.periods).is_integer() for fringe in fringes)
    _unwrap(
        stack.frames,
        np.concatenate([fringe.frames for fringe in fringes]).astype(np.int64),
        np.cumsum([0, *(len(fringe.frames) for fringe in fringes)]),
        np.concatenate([solver[1] for solver in solvers]),
        np.concatenate([solver[2] for solver in solvers]),
        steps,
        periods_px,
        coarse,
        size,
        cyclic,
        stack.full_scale,
        GREY_MAX / stack.full_scale,
        limits.min_modulation,
        limits.max_residual,
        coordinate,
        modulation,
        flags,
    )
    return AxisMap(coordinate, modulation, flags)


def _unknown(shape: tuple[int, int]) -> AxisMap:
    """Return what is known before any fringe: nothing, as an empty array, and no flag."""
    modulation = np.full(shape, np.inf, dtype=np.float32)
    return AxisMap(np.empty((0, 0)), modulation, np.zeros(shape, dtype=np.uint8))


def _unwrapping_steps(
    fringes: Sequence[Fringe], size: int, *, has_gray_code: bool
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Return the steps of unwrapping: (fringe, fringe to subtract or −1) and each one's period."""
    steps = [(i, -1) for i in range(len(fringes))]
    periods_px = [size / fringe.periods for fringe in fringes]
    if has_gray_code:
        for coarse, fine in list(pairwise(fringes))[:1]:
            steps.insert(0, (1, 0))
            periods_px.insert(0, size / (fine.periods - coarse.periods))
    return np.array(steps, dtype=np.int64), np.array(periods_px)


@njit(inline="always", error_model="numpy")
def _unwrap_pixel(
    phase: NDArray[np.float64],
    steps: NDArray[np.int64],
    periods_px: NDArray[np.float64],
    absolute: float,
    is_known: bool,
    size: int,
) -> tuple[float, float]:
    """Unwrap one pixel's phases (in periods) step by step; return coordinate and worst residual."""
    worst = 0.0
    for i in range(periods_px.size):
        part = phase[steps[i, 0]]
        if steps[i, 1] >= 0:
            part -= phase[steps[i, 1]]
        if i == 0 and not is_known:
            # Of the values a period apart, the one nearest to the projector's middle.
            middle = 0.5 * (size - 1) / periods_px[0]
            absolute = (part + np.rint(middle - part)) * periods_px[0]
            continue
        order = np.rint(absolute / periods_px[i] - part)
        fine = (part + order) * periods_px[i]
        # The first step after a Gray code only bridges the code's width: that is no residual.
        if i > 0:
            worst = max(worst, abs(absolute - fine) / periods_px[i])
        absolute = fine
    return absolute, worst


@njit(parallel=True, error_model="numpy")
def _unwrap(
    frames: Image,
    frame: NDArray[np.int64],
    first: NDArray[np.int64],
    to_cosine: NDArray[np.float64],
    to_sine: NDArray[np.float64],
    steps: NDArray[np.int64],
    periods_px: NDArray[np.float64],
    coarse: NDArray[np.float64],
    size: int,
    cyclic: bool,
    full_scale: int,
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
                    if sample >= full_scale:
                        flag |= _CLIPPED
                amplitude = np.sqrt(cosine[i] * cosine[i] + sine[i] * sine[i]) * scale
                weakest = min(weakest, amplitude)
            modulation[r, c] = weakest
            if weakest < min_modulation or weakest <= 0.0:
                flag |= _LOW
            absolute = 0.0
            if coarse.size:
                absolute = coarse[r, c]
            flags[r, c] = flag
            if flag & (_LOW | _CLIPPED) or np.isnan(absolute):
                continue
            for i in range(n_fringes):
                phase[i] = np.arctan2(sine[i], cosine[i]) / turn
            absolute, residual = _unwrap_pixel(
                phase, steps, periods_px, absolute, coarse.size > 0, size
            )
            if cyclic:
                absolute -= size * np.floor((absolute + 0.5) / size)
            if residual > max_residual:
                flags[r, c] = flag | _AMBIGUOUS
            elif absolute < -0.5 or absolute >= size - 0.5:
                flags[r, c] = flag | _OUTSIDE
            else:
                coordinate[r, c] = absolute
