"""Which frame of a recording means what: Gray code, phase shift, and where they stand.

A pattern sequence codes the projector's columns, its rows, or both.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from typing import Annotated

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from exposight.cell import BitDepth
from exposight.errors import ImageError
from exposight.files import check_plain
from exposight.imaging.codings import FrameNumber, Fringe, GrayCode
from exposight.imaging.frame_files import Alignment, Channel
from exposight.imaging.frames import check_saturation_level
from exposight.imaging.ladders import Ladder, unwrapping_ladder
from exposight.imaging.response import check_gamma, light_of_levels

_LARGEST_PROJECTOR = 100_000


@dataclass(frozen=True, kw_only=True)
class AxisCoding:
    """How one projector axis is coded: by Gray code, phase-shifted fringes, or both.

    Fringes are unwrapped from coarse to fine, by themselves and by their beats
    (`exposight.imaging.ladders`). The first phase is absolute, as it has one period or less over
    the projector, or is unwrapped by the Gray code.

    Parameters
    ----------
    gray_code : GrayCode, optional
        The coordinate, or a coarse one where there are fringes.
    fringes : tuple of Fringe
        Of different periods, in any order; kept from few periods to many.
    mirrored : bool
        True where the projector showed the patterns mirrored along this axis: what is meant for its
        first column on its last one.

    Raises
    ------
    ImageError
        If nothing codes the axis, or two fringes have the same number of periods.
    """

    gray_code: GrayCode | None = None
    fringes: tuple[Fringe, ...] = ()
    mirrored: bool = False

    def __post_init__(self) -> None:
        fringes = tuple(sorted(self.fringes, key=lambda fringe: fringe.periods))
        object.__setattr__(self, "fringes", fringes)
        for coarse, fine in pairwise(fringes):
            if coarse.periods == fine.periods:
                msg = (
                    f"two fringes of {fine.periods:g} periods: give one of them, or both as one "
                    "fringe with the shifts of all their steps"
                )
                raise ImageError(msg)
        if self.gray_code is None and not fringes:
            msg = "columns and rows each need a gray_code table, fringes, or both"
            raise ImageError(msg)

    @property
    def frames(self) -> tuple[int, ...]:
        """Every frame it uses."""
        steps = tuple(frame for fringe in self.fringes for frame in fringe.frames)
        return steps if self.gray_code is None else steps + self.gray_code.all_frames

    def ladder(self, size: int) -> Ladder:
        """Return the steps by which the fringes are unwrapped over an axis of `size` px.

        Raises
        ------
        ImageError
            If nothing makes them absolute.
        """
        return unwrapping_ladder(
            tuple(fringe.periods for fringe in self.fringes),
            tuple(len(fringe.frames) for fringe in self.fringes),
            size,
            None if self.gray_code is None else self.gray_code.finest_width,
        )

    def slides(self, size: int) -> dict[int, NDArray[np.float64]]:
        """Return the light of the code's frames along an axis of `size` px, (size,), by frame."""
        if self.gray_code is None:
            return {}
        slides = self.gray_code.slides(size)
        return {frame: lit[::-1] for frame, lit in slides.items()} if self.mirrored else slides

    def shown_deg(self, fringe: Fringe, size: int) -> tuple[float, ...]:
        """Return a fringe's shifts as the projector shows them: I_k = A + B·cos(2π·p·u/size − δ_k).

        They differ from its `steps_deg` where the axis is mirrored.
        """
        if not self.mirrored:
            return fringe.steps_deg
        last = 360.0 * fringe.periods * (size - 1) / size  # the phase that column 0 shows
        return tuple(last - step for step in fringe.steps_deg)


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
        Fully lit and unlit frame; both or neither. Gray code needs them where it has no inverse
        frames and there are no fringes.
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
    projector_gamma : float
        The projector's light is its input to this power; phases are corrected for it.
    pattern_contrast : float
        Contrast of the fringes as they are sent to a projector with a gamma: (brightest − darkest)
        over their sum, 1 where they go down to black.
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
    white_frame: FrameNumber | None = None
    black_frame: FrameNumber | None = None
    unused_frames: tuple[FrameNumber, ...] = ()
    bit_depth: BitDepth = 8
    alignment: Alignment = "low"
    channel: Channel | None = None
    saturation_level: int | None = None
    camera_response: tuple[tuple[float, float], ...] = ()
    camera_gamma: float | None = None
    projector_gamma: float = 1.0
    pattern_contrast: float = 1.0
    file_pattern: str = "*.png"
    grey_noise: Annotated[float, Field(gt=0, lt=255)] | None = None

    def __post_init__(self) -> None:
        check_plain(self.name, "the pattern sequence", ImageError)
        check_saturation_level(self.saturation_level, self.bit_depth)
        self.response()  # refuses what is none
        check_gamma(self.projector_gamma, "projector_gamma")
        if not 0 < self.pattern_contrast <= 1:
            msg = f"pattern_contrast must be above 0 and at most 1, got {self.pattern_contrast}"
            raise ImageError(msg)
        for fault in self._faults():
            raise ImageError(fault)

    def _faults(self) -> Iterator[str]:
        sides = (self.projector_width, self.projector_height)
        if min(sides) < 1 or max(sides) > _LARGEST_PROJECTOR:
            yield (
                f"a projector has 1 to {_LARGEST_PROJECTOR} px a side, got "
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
            if coding.gray_code is not None:
                yield from self._faults_of_code(axis, coding.gray_code, size)
            if coding.fringes:
                try:
                    coding.ladder(size)
                except ImageError as error:
                    yield f"{axis}: {error}"
        twice = sorted({frame for frame in used if used.count(frame) > 1})
        if twice:
            yield f"a frame has one meaning, but {twice} are used more than once"

    def _faults_of_code(self, axis: str, gray: GrayCode, size: int) -> Iterator[str]:
        if (
            not gray.inverse_frames
            and self.white_frame is None
            and not self.threshold_fringes(axis)
        ):
            yield (
                f"the Gray code of the {axis} has no inverse frames; say which frames are "
                "white and black, or which are the inverses"
            )
        covered = (2 ** len(gray.frames) - (gray.first_code or 0)) * gray.code_width
        if covered < size:
            yield (
                f"the Gray code of the {axis} covers {covered} px of a projector of {size} px; "
                "check the number of bits, the width of a code and the first code"
            )

    def threshold_fringes(self, axis: str) -> tuple[Fringe, ...]:
        """Return the fringes whose mean is a code's threshold: the axis' own, else the other's."""
        own = {name: coding.fringes for name, coding, _ in self.axes()}
        return own.pop(axis) or next(iter(own.values()), ())

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
            shape = (1, -1) if axis == "columns" else (-1, 1)
            lit = coding.slides(size)
            slides |= {frame: each.reshape(shape) for frame, each in lit.items()}
        if self.white_frame is not None and self.black_frame is not None:
            slides[self.white_frame] = np.ones((1, 1))
            slides[self.black_frame] = np.zeros((1, 1))
        return slides

    @property
    def finest_frames(self) -> tuple[int, ...]:
        """Frames of the finest pattern: all steps of a fringe, or a bit and its inverse.

        Where a Gray code has no inverse frames they are the white and the black one, or else the
        steps of the other axis' fringe. Their mean is what is lit evenly.
        """
        axis, coding, _ = self.axes()[0]
        if coding.fringes or coding.gray_code is None:
            return coding.fringes[-1].frames
        if coding.gray_code.inverse_frames:
            return coding.gray_code.frames[-1:] + coding.gray_code.inverse_frames[-1:]
        if self.white_frame is not None and self.black_frame is not None:
            return (self.white_frame, self.black_frame)
        return self.threshold_fringes(axis)[-1].frames

    @property
    def n_frames(self) -> int:
        """Number of frames that a recording must have."""
        return max(self._used_frames()) + 1
