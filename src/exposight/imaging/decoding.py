"""Decode a recording: frames and their meaning in, projector coordinates out.

Gray codes are decoded by `exposight.imaging.gray_code`, phase-shifted fringes here. For
I_k = A + B·cos(φ − δ_k) the least-squares solution of A, B·cos φ and B·sin φ is linear in the
samples. With three equal steps it is φ = atan2(√3·(I₂ − I₃), 2·I₁ − I₂ − I₃). A phase of p periods
over a projector of W px means the coordinate φ/(2π·p)·W, phase 0 being the centre of pixel 0.
"""

from collections.abc import Collection, Sequence
from itertools import pairwise
from pathlib import Path

import numba
import numpy as np
from numpy.typing import NDArray

from exposight.compiled import njit
from exposight.contradictions import settle
from exposight.errors import ImageError
from exposight.imaging.consistency import frame_contradictions
from exposight.imaging.decoded import (
    AMBIGUOUS,
    CLIPPED,
    LOW_MODULATION,
    OUTSIDE,
    AxisMap,
    DecodedMap,
    DecodingLimits,
)
from exposight.imaging.frame_files import read_frames
from exposight.imaging.frames import FrameStack, Levels, Light
from exposight.imaging.gray_code import decode_gray_code
from exposight.imaging.sequences import AxisCoding, Fringe, PatternSequence


def read_recording(
    folder: str | Path, sequence: PatternSequence, *, exposure_ms: float | None = None
) -> FrameStack:
    """Read a folder's frames as a sequence describes them: files, number, grey levels.

    Parameters
    ----------
    folder : path
        Where the frames are.
    sequence : PatternSequence
        What they mean.
    exposure_ms : float, ms, optional
        Exposure time of the recording.

    Raises
    ------
    MissingFileError, ImageError
        As `read_frames`.
    """
    return read_frames(
        folder,
        pattern=sequence.file_pattern,
        bit_depth=sequence.bit_depth,
        alignment=sequence.alignment,
        channel=sequence.channel,
        saturation_level=sequence.saturation_level,
        response=sequence.response(),
        count=sequence.n_frames,
        exposure_ms=exposure_ms,
    )


def decode(
    stack: FrameStack,
    sequence: PatternSequence,
    limits: DecodingLimits | None = None,
    *,
    despite: Collection[str] = (),
    checked: bool = True,
) -> DecodedMap:
    """Find the projector coordinate that every camera pixel sees.

    Parameters
    ----------
    stack : FrameStack
        The recording.
    sequence : PatternSequence
        What its frames mean.
    limits : DecodingLimits, optional
        When a pixel counts as decoded.
    despite : collection of str
        Names of checks whose errors are accepted (see `exposight.imaging.consistency`).
    checked : bool
        False for frames that are known to be what the sequence says, as simulated ones are.

    Raises
    ------
    ImageError
        If the stack has another number of frames, bit depth, saturation level or response than the
        sequence says.
    ContradictionError
        If the frames contradict the sequence, or one another.
    """
    if stack.n_frames != sequence.n_frames:
        msg = (
            f"sequence '{sequence.name}' needs {sequence.n_frames} frames, got {stack.n_frames}; "
            "check that the recording is complete, or describe its sequence"
        )
        raise ImageError(msg)
    if stack.bit_depth != sequence.bit_depth:
        msg = (
            f"sequence '{sequence.name}' is of {sequence.bit_depth} bits, the stack of "
            f"{stack.bit_depth}; say the same bit depth in both"
        )
        raise ImageError(msg)
    for what, of_stack, of_sequence in (
        ("saturation level", stack.saturation_level, sequence.saturation_level),
        ("response of the camera", stack.response, sequence.response()),
    ):
        if not np.array_equal(of_stack, of_sequence):  # type: ignore[arg-type]
            msg = (
                f"the stack's {what} is another than that of sequence '{sequence.name}'; say the "
                "same in both, as read_recording does"
            )
            raise ImageError(msg)
    limits = limits or DecodingLimits()
    found = settle(frame_contradictions(stack, sequence, limits), despite) if checked else ()
    light = stack.light()
    maps = {
        axis: _decode_axis(light, sequence, coding, size, limits)
        for axis, coding, size in sequence.axes()
    }
    columns, rows = maps.get("columns"), maps.get("rows")
    both = list(maps.values())
    return DecodedMap(
        column=None if columns is None else columns.coordinate,
        row=None if rows is None else rows.coordinate,
        modulation=np.minimum(both[0].modulation, both[-1].modulation),
        flags=both[0].flags | both[-1].flags,
        projector_width=sequence.projector_width,
        projector_height=sequence.projector_height,
        exposure_ms=stack.exposure_ms,
        emulated=stack.emulated,
        contradictions=found,
    )


def _decode_axis(
    light: Light,
    sequence: PatternSequence,
    coding: AxisCoding,
    size: int,
    limits: DecodingLimits,
) -> AxisMap:
    """Decode one projector axis of `size` px.

    A pixel with a clipped sample of a fringe has no coordinate: its phase is wrong.
    """
    fringes, gray_code = coding.fringes, coding.gray_code
    if gray_code is None:  # nothing is known before the first fringe
        coarse: NDArray[np.float64] = np.empty((0, 0))
        modulation: NDArray[np.float32] = np.full(light.image_shape, np.inf, dtype=np.float32)
        flags: NDArray[np.uint8] = np.zeros(light.image_shape, dtype=np.uint8)
    else:
        by_code = coarse, modulation, flags = decode_gray_code(
            light, sequence, gray_code, size, limits
        )
        if not fringes:
            return by_code
    coordinate = np.empty(light.image_shape)
    steps, periods_px = _unwrapping_steps(fringes, size, has_gray_code=gray_code is not None)
    solvers = [phase_solver(fringe.shifts_deg) for fringe in fringes]
    # A whole number of periods repeats at the border: there, −ε and W − ε look alike.
    cyclic = coarse.size == 0 and all(float(fringe.periods).is_integer() for fringe in fringes)
    _unwrap(
        light.frames,
        np.concatenate([fringe.frames for fringe in fringes]).astype(np.int64),
        np.cumsum([0, *(len(fringe.frames) for fringe in fringes)]),
        np.concatenate([solver[1] for solver in solvers]),
        np.concatenate([solver[2] for solver in solvers]),
        steps,
        periods_px,
        coarse,
        size,
        cyclic,
        light.clips_at,
        light.scale,
        limits.min_modulation,
        limits.max_residual,
        coordinate,
        modulation,
        flags,
    )
    return AxisMap(coordinate, modulation, flags)


def phase_solver(shifts_deg: Sequence[float]) -> NDArray[np.float64]:
    """Return the (3, n) pseudo-inverse that takes samples to A, B·cos φ, B·sin φ."""
    shifts = np.radians(np.asarray(shifts_deg, dtype=np.float64))
    design = np.column_stack([np.ones_like(shifts), np.cos(shifts), np.sin(shifts)])
    return np.asarray(np.linalg.pinv(design))


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
    frames: Levels,
    frame: NDArray[np.int64],
    first: NDArray[np.int64],
    to_cosine: NDArray[np.float64],
    to_sine: NDArray[np.float64],
    steps: NDArray[np.int64],
    periods_px: NDArray[np.float64],
    coarse: NDArray[np.float64],
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
            if weakest < min_modulation or weakest <= 0.0:
                flag |= LOW_MODULATION
            absolute = 0.0
            if coarse.size:
                absolute = coarse[r, c]
            flags[r, c] = flag
            if flag & (LOW_MODULATION | CLIPPED) or np.isnan(absolute):
                continue
            for i in range(n_fringes):
                phase[i] = np.arctan2(sine[i], cosine[i]) / turn
            absolute, residual = _unwrap_pixel(
                phase, steps, periods_px, absolute, coarse.size > 0, size
            )
            if cyclic:
                absolute -= size * np.floor((absolute + 0.5) / size)
            if residual > max_residual:
                flags[r, c] = flag | AMBIGUOUS
            elif absolute < -0.5 or absolute >= size - 0.5:
                flags[r, c] = flag | OUTSIDE
            else:
                coordinate[r, c] = absolute
