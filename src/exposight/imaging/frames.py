"""Stacks of grey frames taken with one exposure.

`re_expose` emulates other exposure times, for scenes that were recorded only once.
"""

import math
from dataclasses import dataclass, replace
from typing import NamedTuple, TypeAlias, cast

import numpy as np
from numpy.typing import NDArray

from exposight.cell import GREY_MAX, BitDepth, Image, check_levels, full_scale
from exposight.errors import ImageError

Levels: TypeAlias = "Image | NDArray[np.float32]"
"""Frames as they are, or linearised."""


class Light(NamedTuple):
    """Frames in proportion to light.

    `frames` are (n, rows, columns), on the scale of grey levels, clipped from `clips_at` on; times
    `scale` they are on the scale 0–255.
    """

    frames: Levels
    clips_at: float
    scale: float

    @property
    def image_shape(self) -> tuple[int, int]:
        """Rows and columns of every frame."""
        return int(self.frames.shape[1]), int(self.frames.shape[2])


@dataclass(frozen=True, kw_only=True, eq=False)
class FrameStack:
    """Grey frames of one scene, taken one after the other with one exposure time.

    Parameters
    ----------
    frames : (n, rows, columns) ndarray of uint8 or uint16
        Grey levels; made read-only.
    bit_depth : int, 8 to 16
        More than 8 stand in the low bits of uint16.
    saturation_level : int, optional
        Grey level from which on a sample counts as clipped, where the sensor saturates below full
        scale.
    response : (2**bit_depth,) ndarray of float64, optional
        The camera's response: light of each grey level, on the scale of grey levels, rising.
        Without it grey levels are proportional to light.
    exposure_ms : float, ms, optional
        Exposure time; None where it was not recorded.
    emulated : bool
        True if the grey levels were not recorded as they are (see `re_expose`).

    Raises
    ------
    ImageError
        If frames, bit depth, saturation level and response do not fit, or the exposure time is not
        positive.
    """

    frames: Image
    bit_depth: BitDepth = 8
    saturation_level: int | None = None
    response: NDArray[np.float64] | None = None
    exposure_ms: float | None = None
    emulated: bool = False

    def __post_init__(self) -> None:
        frames = np.asarray(self.frames)
        if frames.ndim != 3 or 0 in frames.shape:
            msg = f"frames must have shape (n, rows, columns), none of them 0, got {frames.shape}"
            raise ImageError(msg)
        frames = np.ascontiguousarray(check_levels(frames, self.bit_depth, "frames")).view()
        if self.exposure_ms is not None and not 0 < self.exposure_ms < np.inf:
            msg = f"an exposure time must be above 0 ms and finite, got {self.exposure_ms}"
            raise ImageError(msg)
        check_saturation_level(self.saturation_level, self.bit_depth)
        if self.response is not None:
            expected = (self.full_scale + 1,)
            if self.response.shape != expected or not (np.diff(self.response) > 0).all():
                msg = (
                    f"a camera's response of {self.bit_depth} bits must be {expected[0]} rising "
                    f"numbers, got shape {self.response.shape}"
                )
                raise ImageError(msg)
        frames.setflags(write=False)
        object.__setattr__(self, "frames", frames)

    @property
    def n_frames(self) -> int:
        """Number of frames."""
        return int(self.frames.shape[0])

    @property
    def image_shape(self) -> tuple[int, int]:
        """Rows and columns of every frame."""
        return int(self.frames.shape[1]), int(self.frames.shape[2])

    @property
    def full_scale(self) -> int:
        """The largest grey level of the bit depth."""
        return full_scale(self.bit_depth)

    @property
    def clipping_level(self) -> int:
        """The grey level from which on a sample counts as clipped."""
        return self.full_scale if self.saturation_level is None else self.saturation_level

    def light(self) -> Light:
        """Return the frames in proportion to light: as they are, or through the response."""
        scale = GREY_MAX / self.full_scale
        if self.response is None:
            return Light(self.frames, self.clipping_level, scale)
        table = self.response.astype(np.float32)
        return Light(table[self.frames], float(table[self.clipping_level]), scale)


def check_saturation_level(level: int | None, bit_depth: int) -> None:
    """Refuse a saturation level that is no grey level of the bit depth.

    Raises
    ------
    ImageError
        If it is given and below 1 or above full scale.
    """
    if level is not None and not 1 <= level <= full_scale(bit_depth):
        msg = (
            f"a saturation level must be from 1 to {full_scale(bit_depth)}, the full scale of "
            f"{bit_depth} bits, got {level}"
        )
        raise ImageError(msg)


def re_expose(stack: FrameStack, factor: float) -> FrameStack:
    """Change a stack's grey levels as if it had been exposed `factor` times as long.

    The light of each grey level is multiplied: by the stack's `response` where it has one, else
    grey levels are light. They are rounded and clipped where the camera clips. Nothing else is
    modelled: noise and the black level grow with the factor, and what was clipped stays clipped at
    its old level where the factor is below 1. The result is therefore always labelled emulated.

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
    scaled = levels * factor
    if stack.response is not None:
        scaled = np.interp(stack.response * factor, stack.response, levels)
    scaled = np.minimum(np.rint(scaled), stack.clipping_level)
    return replace(
        stack,
        frames=cast("Image", scaled.astype(stack.frames.dtype)[stack.frames]),
        exposure_ms=None if stack.exposure_ms is None else stack.exposure_ms * factor,
        emulated=True,
    )
