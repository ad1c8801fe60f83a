"""What single patterns show: Gray code and phase-shifted fringes of one projector axis.

Projector coordinates follow ``docs/conventions.md``: pixel centres are integers, so code c of a
Gray code whose codes are w pixels wide covers c·w − ½ … (c + 1)·w − ½, and a fringe's phase is 0 at
the centre of column 0.
"""

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import Annotated, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from exposight.errors import ImageError

_MAX_BITS = 16

FrameNumber = Annotated[int, Field(ge=0)]


@dataclass(frozen=True, kw_only=True)
class GrayCode:
    """Code of one projector axis in black and white: binary reflected Gray code, or plain binary.

    A bit is lit where it is above the pixel's threshold: its inverse frame; without it the middle
    of the sequence's white and black frames; without these the mean of the fringes' steps.

    Parameters
    ----------
    frames : tuple of int
        Frame of every bit, most significant first.
    inverse_frames : tuple of int
        Frame of every bit's inverse, or none.
    code : {"gray", "binary"}
        Gray code, of which neighbours differ in one bit, or plain binary numbers, whose bits change
        together and which pixels on an edge therefore misread more easily.
    code_width : int, px
        Projector pixels per code: 2 where the finest of the bits was left out.
    first_code : int, optional
        Code that the projector's first column (or row) shows: (2**bits − size)/2 where a program
        centres its codes, one px wide, on the projector. Where it is not said, 0 is assumed, and
        decoding warns if the frames allow centred codes as well.
    complementary_frame : int, optional
        Frame of the next finer bit of the Gray code: stripes as wide as a code, shifted by half a
        code, so that their edges lie in the middle of codes; dark over the first half of code 0 and
        lit from its middle to that of code 1. It halves the codes, so that a fringe of the code's
        width is unwrapped with a margin of a quarter period everywhere (Zhang, Su, Xiang & Sun,
        *3-D shape measurement based on complementary Gray-code light*, Optics and Lasers in
        Engineering 2012).

    Raises
    ------
    ImageError
        If there is no bit or more than 16, the inverses do not match, the width is below 1, the
        first code is not one of the code's, or the complementary frame halves an odd width or a
        plain binary code.
    """

    frames: tuple[FrameNumber, ...]
    inverse_frames: tuple[FrameNumber, ...] = ()
    code: Literal["gray", "binary"] = "gray"
    code_width: int = 1
    first_code: int | None = None
    complementary_frame: FrameNumber | None = None

    def __post_init__(self) -> None:
        if not 1 <= len(self.frames) <= _MAX_BITS:
            msg = f"a Gray code needs 1 to {_MAX_BITS} frames, got {len(self.frames)}"
            raise ImageError(msg)
        if self.inverse_frames and len(self.inverse_frames) != len(self.frames):
            msg = (
                f"a Gray code of {len(self.frames)} frames needs as many inverse frames or none, "
                f"got {len(self.inverse_frames)}"
            )
            raise ImageError(msg)
        if self.code not in {"gray", "binary"}:
            msg = f'a code is "gray" or "binary", got {self.code!r}'
            raise ImageError(msg)
        if self.code_width < 1:
            msg = f"a Gray code's width must be at least 1 projector px, got {self.code_width}"
            raise ImageError(msg)
        if not 0 <= (self.first_code or 0) < 2 ** len(self.frames):
            msg = (
                f"the first code of {len(self.frames)} bits must be from 0 to "
                f"{2 ** len(self.frames) - 1}, got {self.first_code}"
            )
            raise ImageError(msg)
        if self.complementary_frame is None:
            return
        if self.code_width % 2 or self.code == "binary":
            msg = (
                "a complementary frame is the next finer bit of a Gray code of even width, got "
                f"a {self.code} code of {self.code_width} px; leave it out, or say what is so"
            )
            raise ImageError(msg)

    @property
    def bit_frames(self) -> tuple[int, ...]:
        """Frame of every bit, most significant first, the complementary one last."""
        finer = () if self.complementary_frame is None else (self.complementary_frame,)
        return self.frames + finer

    @property
    def all_frames(self) -> tuple[int, ...]:
        """Every frame that it uses."""
        return self.bit_frames + self.inverse_frames

    @property
    def finest_width(self) -> int:
        """Projector px between a code's edges, px: half the width with a complementary frame."""
        return self.code_width if self.complementary_frame is None else self.code_width // 2

    @property
    def finest_first_code(self) -> int:
        """The first column's code, counted in codes of `finest_width`."""
        return (self.first_code or 0) * (self.code_width // self.finest_width)

    def slides(self, size: int) -> dict[int, NDArray[np.float64]]:
        """Return 0 or 1 along an axis of `size` px, (size,), by frame."""
        code = np.arange(size) // self.finest_width + self.finest_first_code
        shown = code ^ (code >> 1) if self.code == "gray" else code
        slides = {}
        for i, frame in enumerate(self.bit_frames):
            bit = (shown >> (len(self.bit_frames) - 1 - i)) & 1
            slides[frame] = bit.astype(np.float64)
        for frame, inverse in zip(self.frames, self.inverse_frames, strict=False):
            slides[inverse] = 1.0 - slides[frame]
        return slides


@dataclass(frozen=True, kw_only=True)
class Fringe:
    """One sinusoidal fringe, shifted N ≥ 3 times: I_k = A + B·cos(φ − δ_k).

    Parameters
    ----------
    periods : float
        Periods across the projector's width (for columns) or height (for rows).
    frames : tuple of int
        Frame of every step.
    shifts_deg : tuple of float, degrees
        δ_k of every step; empty for equal steps δ_k = k·360°/N.
    reversed : bool
        True where the steps run the other way, I_k = A + B·cos(φ + δ_k): the same as negative
        shifts.

    Raises
    ------
    ImageError
        If steps are too few, do not match the shifts, or leave the phase undetermined.
    """

    periods: float
    frames: tuple[FrameNumber, ...]
    shifts_deg: tuple[float, ...] = ()
    reversed: bool = False

    def __post_init__(self) -> None:
        if not 0 < self.periods < math.inf:
            msg = f"a fringe's number of periods must be above 0, got {self.periods}"
            raise ImageError(msg)
        if len(self.frames) < 3:
            msg = f"a phase shift needs at least 3 steps, got {len(self.frames)} frames"
            raise ImageError(msg)
        if not self.shifts_deg:
            n = len(self.frames)
            object.__setattr__(self, "shifts_deg", tuple(360.0 * k / n for k in range(n)))
        if len(self.shifts_deg) != len(self.frames):
            msg = f"{len(self.frames)} steps need as many shifts, got {len(self.shifts_deg)}"
            raise ImageError(msg)
        shifts = np.exp(1j * np.radians(self.shifts_deg))
        design = np.column_stack([np.ones(len(shifts)), shifts.real, shifts.imag])
        if not np.isfinite(shifts).all() or np.linalg.cond(design) > 100.0:
            msg = (
                "a phase needs at least three different shifts, well apart over a period, got "
                f"{self.shifts_deg} degrees"
            )
            raise ImageError(msg)

    @property
    def steps_deg(self) -> tuple[float, ...]:
        """δ_k of every step with its sign, in degrees: I_k = A + B·cos(φ − δ_k)."""
        return tuple(-shift for shift in self.shifts_deg) if self.reversed else self.shifts_deg

    def solver(self) -> NDArray[np.float64]:
        """Return the (3, n) pseudo-inverse that takes samples to A, B·cos φ, B·sin φ."""
        return _solver(self.steps_deg).copy()


@lru_cache(maxsize=64)
def _solver(steps_deg: tuple[float, ...]) -> NDArray[np.float64]:
    shifts = np.radians(np.asarray(steps_deg, dtype=np.float64))
    design = np.column_stack([np.ones_like(shifts), np.cos(shifts), np.sin(shifts)])
    return np.asarray(np.linalg.pinv(design))
