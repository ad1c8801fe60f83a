"""Gray code: from frames to projector coordinates, located between pixels where the code allows.

Every pixel gets a code; the code's edges are then located between neighbouring pixels, where the
one bit that differs crosses zero, and the coordinate runs linearly from edge to edge. Where a run
of one code lacks an edge on a side (a depth step, a hole, a fold), its pixels keep the code's
centre.
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
from exposight.imaging.sequences import GrayCode, PatternSequence


def decode_gray_code(
    light: Light,
    sequence: PatternSequence,
    gray_code: GrayCode,
    size: int,
    limits: DecodingLimits,
) -> AxisMap:
    """Decode the Gray code of one projector axis.

    The white and black frames give the contrast, and the threshold where there are no inverse
    frames. Without them the contrast is the largest difference between a bit's frame and its
    inverse.

    Parameters
    ----------
    light : Light
        All frames of the recording.
    sequence : PatternSequence
        What they show.
    gray_code : GrayCode
        The coding of this axis.
    size : int, px
        The projector's length along this axis.
    limits : DecodingLimits
        When a pixel counts as decoded.

    Returns
    -------
    AxisMap
        Clipped pixels keep their coordinate: a sample at full scale does not flip a bit.
    """
    bits = np.array(gray_code.frames, dtype=np.int64)
    inverses = np.array(gray_code.inverse_frames, dtype=np.int64)
    white = -1 if sequence.white_frame is None else sequence.white_frame
    black = -1 if sequence.black_frame is None else sequence.black_frame
    frames = light.frames
    code = np.empty(light.image_shape, dtype=np.int32)
    modulation = np.empty(light.image_shape, dtype=np.float32)
    flags = np.empty(light.image_shape, dtype=np.uint8)
    _read_codes(
        frames,
        bits,
        inverses,
        white,
        black,
        light.clips_at,
        light.scale,
        limits.min_modulation,
        limits.min_bit_contrast,
        (size - 1) // gray_code.code_width,
        code,
        modulation,
        flags,
    )
    coordinate = np.empty(light.image_shape)
    width = gray_code.code_width
    if _steps(code, 1) >= _steps(code, 0):
        _locate(frames, bits, inverses, white, black, code, width, coordinate)
    else:  # the code runs along the image's columns
        turned = frames.transpose(0, 2, 1)
        _locate(turned, bits, inverses, white, black, code.T, width, coordinate.T)
    return AxisMap(coordinate, modulation, flags)


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
    bit: int,
    r: int,
    c: int,
) -> float:
    """Lit minus unlit of one bit at one pixel, on the scale of white minus black."""
    lit = float(frames[bits[bit], r, c])
    if inverses.size:
        return lit - float(frames[inverses[bit], r, c])
    return 2.0 * lit - float(frames[white, r, c]) - float(frames[black, r, c])


@njit(parallel=True)
def _read_codes(
    frames: Levels,
    bits: NDArray[np.int64],
    inverses: NDArray[np.int64],
    white: int,
    black: int,
    clips_at: float,
    scale: float,
    min_modulation: float,
    min_bit_contrast: float,
    last_code: int,
    code: NDArray[np.int32],
    modulation: NDArray[np.float32],
    flags: NDArray[np.uint8],
) -> None:
    """Fill code (−1 where there is none), modulation and flags of every pixel."""
    n_bits = bits.size
    for r in numba.prange(code.shape[0]):
        signals = np.empty(n_bits)
        for c in range(code.shape[1]):
            flag = np.uint8(0)
            contrast = 0.0
            if white >= 0:
                contrast = float(frames[white, r, c]) - float(frames[black, r, c])
                if frames[white, r, c] >= clips_at:
                    flag |= CLIPPED
            for b in range(n_bits):
                signals[b] = _signal(frames, bits, inverses, white, black, b, r, c)
                if white < 0:
                    contrast = max(contrast, abs(signals[b]))
                if frames[bits[b], r, c] >= clips_at or (
                    inverses.size > 0 and frames[inverses[b], r, c] >= clips_at
                ):
                    flag |= CLIPPED
            modulation[r, c] = max(0.0, 0.5 * contrast * scale)
            value, bit, undecided = 0, 0, 0
            for b in range(n_bits):
                if signals[b] > 0.0:
                    bit ^= 1
                value = 2 * value + bit
                if abs(signals[b]) < min_bit_contrast * contrast:
                    undecided += 1
            if 0.5 * contrast * scale < min_modulation or contrast <= 0.0:
                flag |= LOW_MODULATION
                value = -1
            elif undecided > 1:
                flag |= AMBIGUOUS
                value = -1
            elif value > last_code:
                flag |= OUTSIDE
                value = -1
            code[r, c] = value
            flags[r, c] = flag


@njit(parallel=True, error_model="numpy")
def _locate(
    frames: Levels,
    bits: NDArray[np.int64],
    inverses: NDArray[np.int64],
    white: int,
    black: int,
    code: NDArray[np.int32],
    width: int,
    coordinate: NDArray[np.float64],
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
                differing = (value ^ (value >> 1)) ^ (following ^ (following >> 1))
                bit = bits.size - 1
                while differing > 1:
                    differing >>= 1
                    bit -= 1
                here = _signal(frames, bits, inverses, white, black, bit, r, end - 1)
                there = _signal(frames, bits, inverses, white, black, bit, r, end)
                right_at = end - 1 + here / (here - there)  # opposite in sign: never 0/0
                right_edge = max(value, following) * width - 0.5
            # False without an edge (NaN), and for a fold, where both edges are the same.
            between = right_at > left_at and right_edge != left_edge
            for i in range(start, end):
                position = np.nan
                if value >= 0:
                    position = value * width + 0.5 * (width - 1)
                if between:
                    share = (i - left_at) / (right_at - left_at)
                    position = left_edge + share * (right_edge - left_edge)
                coordinate[r, i] = position
            start, left_at, left_edge = end, right_at, right_edge
