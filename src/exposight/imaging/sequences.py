"""Which frame of a recording means what: Gray code, phase shift, and where they stand.

A pattern sequence codes the projector's columns, its rows, or both. Projector coordinates follow
``docs/conventions.md``: pixel centres are integers, so code c of a Gray code whose codes are w
pixels wide covers c·w − ½ … (c + 1)·w − ½, and a fringe's phase is 0 at the centre of column 0.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from typing import Annotated

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from exposight.cell import BitDepth
from exposight.errors import ImageError
from exposight.imaging.frame_files import Alignment, Channel
from exposight.imaging.frames import check_saturation_level
from exposight.imaging.response import light_of_levels

_MAX_BITS = 16

_Frame = Annotated[int, Field(ge=0)]


@dataclass(frozen=True, kw_only=True)
class GrayCode:
    """Binary reflected Gray code of one projector axis.

    Parameters
    ----------
    frames : tuple of int
        Frame of every bit, most significant first.
    inverse_frames : tuple of int
        Frame of every bit's inverse; empty where the threshold is the middle of the sequence's
        white and black frames.
    code_width : int, px
        Projector pixels per code: 2 where the finest of the bits was left out.

    Raises
    ------
    ImageError
        If there is no bit or more than 16, the inverses do not match, or the width is below 1.
    """

    frames: tuple[_Frame, ...]
    inverse_frames: tuple[_Frame, ...] = ()
    code_width: int = 1

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
        if self.code_width < 1:
            msg = f"a Gray code's width must be at least 1 projector px, got {self.code_width}"
            raise ImageError(msg)

    def slides(self, size: int) -> dict[int, NDArray[np.float64]]:
        """Return 0 or 1 along an axis of `size` px, (size,), by frame."""
        code = np.arange(size) // self.code_width
        slides = {}
        for i, frame in enumerate(self.frames):
            bit = ((code ^ (code >> 1)) >> (len(self.frames) - 1 - i)) & 1
            slides[frame] = bit.astype(np.float64)
            if self.inverse_frames:
                slides[self.inverse_frames[i]] = 1.0 - slides[frame]
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

    Raises
    ------
    ImageError
        If steps are too few, do not match the shifts, or leave the phase undetermined.
    """

    periods: float
    frames: tuple[_Frame, ...]
    shifts_deg: tuple[float, ...] = ()

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


@dataclass(frozen=True, kw_only=True)
class AxisCoding:
    """How one projector axis is coded: by Gray code, phase-shifted fringes, or both.

    Fringes are unwrapped from coarse to fine. Without a Gray code the first one must have at most
    one period, and so is absolute. With one, the Gray code is what the fringes are unwrapped
    against; where there are two fringes or more, the beat of the two coarsest stands between, since
    a code is uncertain by its width.

    Parameters
    ----------
    gray_code : GrayCode, optional
        The coordinate, or a coarse one where there are fringes.
    fringes : tuple of Fringe
        In ascending order of their periods.

    Raises
    ------
    ImageError
        If nothing codes the axis, the fringes do not ascend, or nothing makes the coarsest
        absolute.
    """

    gray_code: GrayCode | None = None
    fringes: tuple[Fringe, ...] = ()

    def __post_init__(self) -> None:
        periods = [fringe.periods for fringe in self.fringes]
        if any(fine <= coarse for coarse, fine in pairwise(periods)):
            msg = f"fringes must be given from few periods to many, got {periods}"
            raise ImageError(msg)
        if self.gray_code is not None:
            return
        if not periods:
            msg = "columns and rows each need a gray_code table, fringes, or both"
            raise ImageError(msg)
        if periods[0] > 1:
            msg = (
                f"without a Gray code the coarsest fringe must have one period, got {periods[0]:g};"
                " add such a fringe or a Gray code"
            )
            raise ImageError(msg)

    @property
    def frames(self) -> tuple[int, ...]:
        """Every frame it uses."""
        steps = tuple(frame for fringe in self.fringes for frame in fringe.frames)
        gray = self.gray_code
        return steps if gray is None else steps + gray.frames + gray.inverse_frames


@dataclass(frozen=True, kw_only=True)
class PatternSequence:
    """What the frames of a recording mean.

    Parameters
    ----------
    name : str
        For people.
    projector_width, projector_height : int, px
        Size of the projector's image.
    columns, rows : AxisCoding, optional
        How projector columns (u) and rows (v) are coded; at least one of them is.
    white_frame, black_frame : int, optional
        Fully lit and unlit frame; both or neither. Gray code without inverse frames needs them.
    unused_frames : tuple of int
        Frames of the folder without a meaning.
    bit_depth : int, 8 to 16
        Of the recorded frames.
    alignment : {"low", "high"}
        Which bits of the files' samples hold the grey level (`read_frames`).
    channel : {"red", "green", "blue"}, optional
        Which channel of colour images is read.
    saturation_level : int, optional
        Grey level from which on a sample counts as clipped; full scale by default.
    camera_response : tuple of (float, float)
        Grey level and relative light of the camera, pair by pair (`light_of_levels`).
    camera_gamma : float, optional
        In place of that: light is the grey level to this power.
    file_pattern : str
        Which files of the recording's folder are its frames.
    grey_noise : float, grey levels 0–255, optional
        Standard deviation of a sample of the camera, for `exposight.imaging.recorded_sigma_z`; by
        default it is found from fringes of four steps or more.

    Raises
    ------
    ImageError
        If the pieces do not fit together.
    """

    name: str
    projector_width: int
    projector_height: int
    columns: AxisCoding | None = None
    rows: AxisCoding | None = None
    white_frame: _Frame | None = None
    black_frame: _Frame | None = None
    unused_frames: tuple[_Frame, ...] = ()
    bit_depth: BitDepth = 8
    alignment: Alignment = "low"
    channel: Channel | None = None
    saturation_level: int | None = None
    camera_response: tuple[tuple[float, float], ...] = ()
    camera_gamma: float | None = None
    file_pattern: str = "*.png"
    grey_noise: Annotated[float, Field(gt=0, lt=255)] | None = None

    def __post_init__(self) -> None:
        check_saturation_level(self.saturation_level, self.bit_depth)
        self.response()  # refuses what is none
        for fault in self._faults():
            raise ImageError(fault)

    def _faults(self) -> Iterator[str]:
        if min(self.projector_width, self.projector_height) < 1:
            yield (
                "a projector's size must be positive, got "
                f"{self.projector_width} × {self.projector_height} px"
            )
        if self.columns is None and self.rows is None:
            yield "a pattern sequence must code the projector's columns, its rows, or both"
        if (self.white_frame is None) != (self.black_frame is None):
            yield "a white and a black frame are given together or not at all"
        used = self._used_frames()
        if min(used) < 0:
            yield f"frames are numbered from 0, got {min(used)}"
        for axis, coding, size in self.axes():
            gray = coding.gray_code
            if gray is None:
                continue
            if not gray.inverse_frames and self.white_frame is None:
                yield (
                    f"the Gray code of the {axis} has no inverse frames; say which frames are "
                    "white and black, or which are the inverses"
                )
            covered = 2 ** len(gray.frames) * gray.code_width
            if covered < size:
                yield (
                    f"the Gray code of the {axis} covers {covered} px of a projector of {size} px; "
                    "check the number of bits and the width of a code"
                )
            if not coding.fringes:
                continue
            periods = [fringe.periods for fringe in coding.fringes]
            coarsest = size / (periods[1] - periods[0] if len(periods) > 1 else periods[0])
            if coarsest < gray.code_width:
                yield (
                    f"the Gray code of the {axis} is {gray.code_width} px wide, more than the "
                    f"{coarsest:g} px over which the coarsest fringes are unambiguous"
                )
        twice = sorted({frame for frame in used if used.count(frame) > 1})
        if twice:
            yield f"a frame has one meaning, but {twice} are used more than once"

    def _used_frames(self) -> list[int]:
        used = [frame for _, coding, _ in self.axes() for frame in coding.frames]
        lit = [f for f in (self.white_frame, self.black_frame) if f is not None]
        return [*used, *lit, *self.unused_frames]

    def response(self) -> NDArray[np.float64] | None:
        """Return the light of each grey level, (2**bit_depth,), or None where they are light."""
        return light_of_levels(self.bit_depth, pairs=self.camera_response, gamma=self.camera_gamma)

    def axes(self) -> list[tuple[str, AxisCoding, int]]:
        """Return name, coding and length in px of every coded projector axis."""
        axes = (
            ("columns", self.columns, self.projector_width),
            ("rows", self.rows, self.projector_height),
        )
        return [(axis, coding, size) for axis, coding, size in axes if coding is not None]

    def slides(self) -> dict[int, NDArray[np.float64]]:
        """Return what the frames that are no fringes show: light from 0 to 1, by frame.

        Returns
        -------
        dict of int to ndarray
            (projector height, projector width), of length 1 along an axis on which it is the same.
        """
        slides: dict[int, NDArray[np.float64]] = {}
        for axis, coding, size in self.axes():
            if coding.gray_code is not None:
                shape = (1, -1) if axis == "columns" else (-1, 1)
                lit = coding.gray_code.slides(size)
                slides |= {frame: each.reshape(shape) for frame, each in lit.items()}
        if self.white_frame is not None and self.black_frame is not None:
            slides[self.white_frame] = np.ones((1, 1))
            slides[self.black_frame] = np.zeros((1, 1))
        return slides

    @property
    def finest_frames(self) -> tuple[int, ...]:
        """Frames of the finest pattern: all steps of a fringe, or a bit and its inverse.

        Where a Gray code has no inverse frames they are the white and the black one. Their mean is
        what is lit evenly.
        """
        _, coding, _ = self.axes()[0]
        if coding.fringes or coding.gray_code is None:
            return coding.fringes[-1].frames
        if coding.gray_code.inverse_frames:
            return coding.gray_code.frames[-1:] + coding.gray_code.inverse_frames[-1:]
        return tuple(f for f in (self.white_frame, self.black_frame) if f is not None)

    @property
    def n_frames(self) -> int:
        """Number of frames that a recording must have."""
        return max(self._used_frames()) + 1
