"""Gray code: from frames to projector coordinates, located between pixels where the code allows.

Every pixel gets a code; the code's edges are then located between neighbouring pixels, where the
one bit that differs crosses zero, and the coordinate runs linearly from edge to edge. Where a run
of one code lacks an edge on a side (a depth step, a hole, a fold), its pixels keep the code's
centre.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray

from exposight.compiled import njit
from exposight.imaging.codings import Fringe, GrayCode
from exposight.imaging.decoded import (
    AMBIGUOUS,
    CLIPPED,
    LOW_MODULATION,
    OUTSIDE,
    DecodingLimits,
)
from exposight.imaging.frames import Levels, Light
from exposight.imaging.sequences import PatternSequence

_DECIDED = 0.6
"""Share of a pixel's contrast that each of its bits has: a fifth of it may lie beyond an edge."""


class CodeMap(NamedTuple):
    """What a Gray code says of every pixel.

    `coordinate` (px, NaN where there is none), `modulation` and `flags` are those of an `AxisMap`.
    `is_located` is false where the coordinate is the code's centre, known to ± `half_code` px;
    `is_decided` is true where no bit is near its threshold: the pixel does not straddle an edge.
    """

    coordinate: NDArray[np.float64]
    modulation: NDArray[np.float32]
    flags: NDArray[np.uint8]
    is_located: NDArray[np.bool_]
    is_decided: NDArray[np.bool_]
    half_code: float


def decode_gray_code(
    light: Light,
    sequence: PatternSequence,
    gray_code: GrayCode,
    thresholds: Sequence[Fringe],
    size: int,
    limits: DecodingLimits,
) -> CodeMap:
    """Decode the Gray code of one projector axis.

    The white and black frames give the contrast, and the threshold where there are no inverse
    frames. Without them the contrast is the largest difference between a bit's frame and its
    inverse, or twice that from its threshold.

    Parameters
    ----------
    light : Light
        All frames of the recording.
    sequence : PatternSequence
        What they show.
    gray_code : GrayCode
        The coding of this axis.
    thresholds : sequence of Fringe
        Whose mean is the threshold where there is nothing else.
    size : int, px
        The projector's length along this axis.
    limits : DecodingLimits
        When a pixel counts as decoded.

    Returns
    -------
    CodeMap
        Clipped pixels keep their coordinate: a sample at full scale does not flip a bit.
    """
    bits = np.array(gray_code.bit_frames, dtype=np.int64)
    inverses = np.array(gray_code.inverse_frames, dtype=np.int64)
    white = -1 if sequence.white_frame is None else sequence.white_frame
    black = -1 if sequence.black_frame is None else sequence.black_frame
    frames, shape = light.frames, light.image_shape
    twice_threshold: NDArray[np.float32] = np.empty((0, 0), dtype=np.float32)
    if white < 0 and bits.size > inverses.size:
        twice_threshold = _twice_threshold(light, gray_code, thresholds)
    width, first_code = gray_code.finest_width, gray_code.finest_first_code
    is_binary = gray_code.code == "binary"
    code = np.empty(shape, dtype=np.int32)
    modulation = np.empty(shape, dtype=np.float32)
    flags = np.empty(shape, dtype=np.uint8)
    is_decided = np.empty(shape, dtype=np.bool_)
    _read_codes(
        frames,
        bits,
        inverses,
        white,
        black,
        twice_threshold,
        is_binary,
        light.clips_at,
        light.scale,
        limits.min_modulation,
        limits.min_bit_contrast,
        first_code,
        first_code + (size - 1) // width,
        code,
        modulation,
        flags,
        is_decided,
    )
    coordinate, is_located = np.empty(shape), np.empty(shape, dtype=np.bool_)
    place = (frames, code, twice_threshold, coordinate, is_located)
    if _steps(code, 1) < _steps(code, 0):  # the code runs along the image's columns
        place = (
            frames.transpose(0, 2, 1),
            *(code.T, twice_threshold.T, coordinate.T, is_located.T),
        )
    turned, codes, levels, at, located = place
    _locate(
        turned,
        bits,
        inverses,
        white,
        black,
        levels,
        is_binary,
        codes,
        width,
        first_code,
        at,
        located,
    )
    return CodeMap(coordinate, modulation, flags, is_located, is_decided, 0.5 * width)


def _twice_threshold(
    light: Light, gray_code: GrayCode, thresholds: Sequence[Fringe]
) -> NDArray[np.float32]:
    """Return twice the middle between lit and unlit: of bits and inverses, or the fringes' mean."""
    if gray_code.inverse_frames:
        frames = gray_code.frames + gray_code.inverse_frames
        weights = np.full(len(frames), 1.0 / len(gray_code.frames))
    else:
        frames = tuple(frame for fringe in thresholds for frame in fringe.frames)
        weights = np.concatenate([fringe.solver()[0] for fringe in thresholds])
        weights *= 2.0 / len(thresholds)
    total = np.empty(light.image_shape, dtype=np.float32)
    _add(light.frames, np.array(frames, dtype=np.int64), weights, total)
    return total


@njit(parallel=True)
def _add(
    frames: Levels,
    frame: NDArray[np.int64],
    weights: NDArray[np.float64],
    total: NDArray[np.float32],
) -> None:
    for r in numba.prange(total.shape[0]):
        for c in range(total.shape[1]):
            value = 0.0
            for k in range(frame.size):
                value += weights[k] * frames[frame[k], r, c]
            total[r, c] = value


def _steps(code: NDArray[np.int32], axis: int) -> int:
    """Count the neighbours along an axis whose codes follow each other."""
    rows, columns = code.shape
    first = code[:, : columns - 1] if axis == 1 else code[: rows - 1]
    second = code[:, 1:] if axis == 1 else code[1:]
    return int(_count_steps(first, second))


@njit(parallel=True)
def _count_steps(first: NDArray[np.int32], second: NDArray[np.int32]) -> int:
    count = 0
    for r in numba.prange(first.shape[0]):
        for c in range(first.shape[1]):
            a, b = first[r, c], second[r, c]
            if a >= 0 and b >= 0 and abs(a - b) == 1:
                count += 1
    return count


@njit(inline="always")
def _signal(
    frames: Levels,
    bits: NDArray[np.int64],
    inverses: NDArray[np.int64],
    white: int,
    black: int,
    twice_threshold: NDArray[np.float32],
    bit: int,
    r: int,
    c: int,
) -> float:
    """Lit minus unlit of one bit at one pixel, on the scale of white minus black."""
    lit = float(frames[bits[bit], r, c])
    if bit < inverses.size:
        return lit - float(frames[inverses[bit], r, c])
    if twice_threshold.size:
        return 2.0 * lit - float(twice_threshold[r, c])
    return 2.0 * lit - float(frames[white, r, c]) - float(frames[black, r, c])


@njit(parallel=True)
def _read_codes(
    frames: Levels,
    bits: NDArray[np.int64],
    inverses: NDArray[np.int64],
    white: int,
    black: int,
    twice_threshold: NDArray[np.float32],
    is_binary: bool,
    clips_at: float,
    scale: float,
    min_modulation: float,
    min_bit_contrast: float,
    first_code: int,
    last_code: int,
    code: NDArray[np.int32],
    modulation: NDArray[np.float32],
    flags: NDArray[np.uint8],
    is_decided: NDArray[np.bool_],
) -> None:
    """Fill code (−1 where there is none), modulation and flags of every pixel."""
    n_bits, n_inverses = bits.size, inverses.size
    for r in numba.prange(code.shape[0]):
        signals = np.empty(n_bits)
        for c in range(code.shape[1]):
            flag = np.uint8(0)
            contrast = 0.0
            if white >= 0:
                contrast = float(frames[white, r, c]) - float(frames[black, r, c])
                if frames[white, r, c] >= clips_at:
                    flag |= CLIPPED
            twice = 0.0
            if twice_threshold.size:
                twice = float(twice_threshold[r, c])
            elif white >= 0:
                twice = float(frames[white, r, c]) + float(frames[black, r, c])
            for b in range(n_bits):
                lit = frames[bits[b], r, c]
                if lit >= clips_at:
                    flag |= CLIPPED
                if b < n_inverses:
                    unlit = frames[inverses[b], r, c]
                    signals[b] = float(lit) - float(unlit)
                    if unlit >= clips_at:
                        flag |= CLIPPED
                else:
                    signals[b] = 2.0 * lit - twice
                if white < 0:
                    contrast = max(contrast, abs(signals[b]))
            modulation[r, c] = max(0.0, 0.5 * contrast * scale)
            value, bit, undecided, decided = 0, 0, 0, True
            for b in range(n_bits):
                if is_binary:
                    bit = 0
                if signals[b] > 0.0:
                    bit ^= 1
                value = 2 * value + bit
                if abs(signals[b]) < _DECIDED * contrast:
                    decided = False
                if abs(signals[b]) < min_bit_contrast * contrast:
                    # Of a binary code only the last bit changes alone.
                    undecided += 2 if is_binary and b < n_bits - 1 else 1
            if 0.5 * contrast * scale < min_modulation or contrast <= 0.0:
                flag |= LOW_MODULATION
                value = -1
            elif undecided > 1:
                flag |= AMBIGUOUS
                value = -1
            elif value < first_code or value > last_code:
                flag |= OUTSIDE
                value = -1
            code[r, c] = value
            flags[r, c] = flag
            is_decided[r, c] = decided


@njit(parallel=True, error_model="numpy")
def _locate(
    frames: Levels,
    bits: NDArray[np.int64],
    inverses: NDArray[np.int64],
    white: int,
    black: int,
    twice_threshold: NDArray[np.float32],
    is_binary: bool,
    code: NDArray[np.int32],
    width: int,
    first_code: int,
    coordinate: NDArray[np.float64],
    is_located: NDArray[np.bool_],
) -> None:
    """Run along the rows and interpolate between the code's edges."""
    n_pixels = code.shape[1]
    for r in numba.prange(code.shape[0]):
        start = 0
        left_at, left_edge = np.nan, 0.0
        while start < n_pixels:
            value = code[r, start]
            end = start + 1  # one past the run of pixels with this code
            while end < n_pixels and code[r, end] == value:
                end += 1
            right_at, right_edge = np.nan, 0.0
            following = code[r, end] if end < n_pixels else -1
            if value >= 0 and following >= 0 and abs(value - following) == 1:
                bit = bits.size - 1  # the last bit of a binary code changes at every edge
                if not is_binary:
                    differing = (value ^ (value >> 1)) ^ (following ^ (following >> 1))
                    while differing > 1:
                        differing >>= 1
                        bit -= 1
                here = _signal(
                    frames, bits, inverses, white, black, twice_threshold, bit, r, end - 1
                )
                there = _signal(frames, bits, inverses, white, black, twice_threshold, bit, r, end)
                right_at = end - 1 + here / (here - there)  # opposite in sign: never 0/0
                right_edge = (max(value, following) - first_code) * width - 0.5
            # False without an edge (NaN), and for a fold, where both edges are the same.
            between = right_at > left_at and right_edge != left_edge
            for i in range(start, end):
                position = np.nan
                if value >= 0:
                    position = (value - first_code) * width + 0.5 * (width - 1)
                if between:
                    share = (i - left_at) / (right_at - left_at)
                    position = left_edge + share * (right_edge - left_edge)
                coordinate[r, i] = position
                is_located[r, i] = between
            start, left_at, left_edge = end, right_at, right_edge
