"""What a capture keeps of its frames: brightness without the pattern, brightest frame, swing."""

from typing import cast

import cv2
import numba
import numpy as np
from numpy.typing import NDArray

from exposight.cell import GREY_MAX, Image, StackImages
from exposight.compiled import njit
from exposight.imaging.decoded import DecodedMap, DecodingLimits
from exposight.imaging.frames import FrameStack
from exposight.imaging.sequences import PatternSequence
from exposight.imaging.stereo import StereoLimits


def mean_image(stack: FrameStack, sequence: PatternSequence) -> Image:
    """Return the mean of the finest pattern's frames, rounded: brightness without the pattern.

    Of a stack with a response it is the mean light, on the scale of grey levels.

    Parameters
    ----------
    stack : FrameStack
        The recording.
    sequence : PatternSequence
        What its frames mean.
    """
    if stack.response is not None:
        light = stack.response[stack.frames[list(sequence.finest_frames)]].mean(axis=0)
        return cast("Image", np.rint(light).astype(stack.frames.dtype))
    first, *others = sequence.finest_frames
    total = stack.frames[first].astype(np.uint16 if stack.bit_depth == 8 else np.uint32)
    for frame in others:
        total += stack.frames[frame]
    n = 1 + len(others)
    return cast("Image", ((total + n // 2) // n).astype(stack.frames.dtype))


def stack_images(
    stack: FrameStack,
    sequence: PatternSequence,
    decoded: DecodedMap,
    limits: DecodingLimits | None = None,
    *,
    with_mean: bool = True,
) -> StackImages:
    """Return what a recording tells of each pixel beyond one image of it.

    Parameters
    ----------
    stack : FrameStack
        The recording.
    sequence : PatternSequence
        What its frames mean.
    decoded : DecodedMap
        What came of it (`exposight.imaging.decode`).
    limits : DecodingLimits, optional
        With which it was decoded.
    with_mean : bool
        False where the capture's own image is `mean_image`.
    """
    per_amplitude = np.float32(2.0 * stack.full_scale / GREY_MAX)
    swing: NDArray[np.float32] = decoded.modulation * per_amplitude
    np.minimum(np.rint(swing, out=swing), np.float32(stack.full_scale), out=swing)
    maximum = stack.frames.max(axis=0)
    if stack.clipping_level < stack.full_scale or stack.response is not None:
        light = np.arange(stack.full_scale + 1.0) if stack.response is None else stack.response
        table = np.rint(light).astype(maximum.dtype)
        table[stack.clipping_level :] = stack.full_scale  # where whoever reads it takes it to clip
        maximum = table[maximum]
    return StackImages(
        mean=mean_image(stack, sequence) if with_mean else None,
        maximum=cast("Image", maximum),
        modulation=cast("Image", swing.astype(stack.frames.dtype)),
        min_modulation=(limits or DecodingLimits()).min_modulation,
    )


_BRIGHT_SHARE = 0.8
"""The window's 80th percentile: a fifth of clipped pixels spoils a match (`StereoLimits`)."""


def window_images(image: NDArray[np.uint8], limits: StereoLimits | None = None) -> StackImages:
    """Return what the window round each pixel of an image of dots tells, as a stack's images do.

    The dots have one image; what shifted stripes show of a pixel over time, its neighbours show
    here.

    Parameters
    ----------
    image : (rows, columns) ndarray of uint8
        As recorded.
    limits : StereoLimits, optional
        With the side of the window, and the least texture.

    Returns
    -------
    StackImages
        ``mean``: of the window; ``maximum``: its 80th percentile, the brightness above which a
        fifth of its pixels lie; ``modulation``: twice its standard deviation. Beyond the image's
        border lies its mirror image, as in `matchable`.
    """
    limits = limits or StereoLimits()
    side = limits.window_px
    reach, border = side // 2, cv2.BORDER_REFLECT_101
    padded = np.asarray(
        cv2.copyMakeBorder(image, reach, reach, reach, reach, border), dtype=np.uint8
    )
    mean, bright, swing = (np.empty(image.shape, dtype=np.uint8) for _ in range(3))
    _fill_window_images(padded, side, int(_BRIGHT_SHARE * (side**2 - 1)), mean, bright, swing)
    return StackImages(
        mean=mean, maximum=bright, modulation=swing, min_modulation=min(limits.min_texture, 255.0)
    )


@njit(parallel=True, error_model="numpy")
def _fill_window_images(
    padded: NDArray[np.uint8],
    side: int,
    rank: int,
    mean: NDArray[np.uint8],
    bright: NDArray[np.uint8],
    swing: NDArray[np.uint8],
) -> None:
    """Run along the rows with the window's histogram (Huang 1979); `rank` counts from 0."""
    n = side * side
    for r in numba.prange(mean.shape[0]):
        histogram = np.zeros(256, dtype=np.int64)
        total, squares = np.int64(0), np.int64(0)
        level, below = 0, np.int64(0)  # `below` pixels of the window are darker than `level`
        for c in range(mean.shape[1] + side - 1):
            for i in range(side):
                entering = np.int64(padded[r + i, c])
                histogram[entering] += 1
                below += np.int64(entering < level)
                total += entering
                squares += entering * entering
                if c >= side:
                    leaving = np.int64(padded[r + i, c - side])
                    histogram[leaving] -= 1
                    below -= np.int64(leaving < level)
                    total -= leaving
                    squares -= leaving * leaving
            if c < side - 1:
                continue
            while below > rank:
                level -= 1
                below -= histogram[level]
            while below + histogram[level] <= rank:
                below += histogram[level]
                level += 1
            u = c - side + 1
            mean[r, u] = (2 * total + n) // (2 * n)
            bright[r, u] = level
            deviation = np.sqrt(np.float64(n * squares - total * total)) / n
            swing[r, u] = np.uint8(min(np.rint(2.0 * deviation), 255.0))
