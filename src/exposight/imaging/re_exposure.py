"""Emulate other exposure times from one recording, for scenes that were recorded only once."""

from __future__ import annotations

import math

import numpy as np

from exposight.errors import ImageError
from exposight.imaging.frames import FrameStack, check_frames


def re_expose(stack: FrameStack, factor: float) -> FrameStack:
    """Scale a stack's grey levels as if it had been exposed `factor` times as long.

    Grey levels are multiplied, rounded and clipped at full scale. Nothing else is modelled: noise
    and the black level grow with the factor, and what was clipped stays clipped at its old level
    where the factor is below 1. The result is therefore always labelled emulated.

    Parameters
    ----------
    stack : FrameStack
        The recording.
    factor : float
        New exposure time over recorded one, above 0.

    Returns
    -------
    FrameStack
        Of the same size and bit depth, its exposure time scaled where known, `emulated` True.

    Raises
    ------
    ImageError
        If the factor is not positive and finite.
    """
    if not 0 < factor < math.inf:
        msg = f"a factor on the exposure time must be above 0 and finite, got {factor}"
        raise ImageError(msg)
    # Every grey level maps to one other: a table is exact and quicker than scaling the frames.
    levels = np.arange(stack.full_scale + 1, dtype=np.float64)
    scaled = np.minimum(np.rint(levels * factor), stack.full_scale).astype(stack.frames.dtype)
    frames = scaled[stack.frames]
    return FrameStack(
        frames=check_frames(frames, stack.bit_depth),
        bit_depth=stack.bit_depth,
        exposure_ms=None if stack.exposure_ms is None else stack.exposure_ms * factor,
        emulated=True,
    )
