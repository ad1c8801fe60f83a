"""What decoding yields: a projector coordinate for every camera pixel, and why some have none."""

from dataclasses import dataclass
from enum import IntFlag
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from exposight.cell import GREY_MAX
from exposight.contradictions import Contradiction
from exposight.errors import ImageError


class AxisMap(NamedTuple):
    """One projector axis decoded: coordinate in px (NaN where none), modulation 0–255, flags."""

    coordinate: NDArray[np.float64]
    modulation: NDArray[np.float32]
    flags: NDArray[np.uint8]


class PixelFlag(IntFlag):
    """What was noticed about a camera pixel while decoding."""

    LOW_MODULATION = 1
    """The patterns change its grey level too little: unlit, too dark, or out of focus."""
    CLIPPED = 2
    """A sample is at full scale. Spoils a phase, but not a Gray code's bit."""
    AMBIGUOUS = 4
    """Two bits or more are undecided, or coarse and fine phase disagree."""
    OUTSIDE = 8
    """The decoded coordinate is not on the projector."""


LOW_MODULATION, CLIPPED, AMBIGUOUS, OUTSIDE = map(np.uint8, PixelFlag)
"""The flags as they stand in `DecodedMap.flags`, for compiled code."""


@dataclass(frozen=True, kw_only=True)
class DecodingLimits:
    """When a pixel counts as decoded.

    Parameters
    ----------
    min_modulation : float, grey levels 0–255
        Least amplitude of the patterns: of each fringe, or half the difference between lit and
        unlit for a Gray code. Deeper recordings are scaled to 0–255 first.
    min_bit_contrast : float
        Least |lit − unlit| of a bit as a share of the pixel's full contrast. Neighbouring codes
        differ by one bit, so one undecided bit only says that the pixel straddles a code's edge;
        two make it ambiguous.
    max_residual : float, periods
        Largest disagreement between a coarse coordinate and the finer phase that it unwraps, in
        periods of the latter; at 0.5 the order of the fringe is a toss-up.

    Raises
    ------
    ImageError
        If a limit is negative or not finite, the modulation above 255, or the residual above 0.5.
    """

    min_modulation: float = 10.0
    min_bit_contrast: float = 0.02
    max_residual: float = 0.4

    def __post_init__(self) -> None:
        limits = (self.min_modulation, self.min_bit_contrast, self.max_residual)
        if not all(0 <= limit < np.inf for limit in limits) or self.max_residual > 0.5:
            msg = (
                "limits of decoding must be 0 or more, and the residual at most 0.5 periods, got "
                f"min_modulation {self.min_modulation}, min_bit_contrast {self.min_bit_contrast}, "
                f"max_residual {self.max_residual}"
            )
            raise ImageError(msg)
        if self.min_modulation > GREY_MAX:
            msg = (
                "the least modulation must be at most 255, where grey levels end (10 is usual), "
                f"got {self.min_modulation:g}"
            )
            raise ImageError(msg)


@dataclass(frozen=True)
class DecodingCounts:
    """How many pixels were decoded, and how many carry each flag; one may carry several.

    `half_read` are those of which one coded axis was read and the other was not.
    """

    pixels: int
    decoded: int
    half_read: int
    low_modulation: int
    clipped: int
    ambiguous: int
    outside: int


@dataclass(frozen=True, kw_only=True, eq=False)
class DecodedMap:
    """The projector coordinate that every camera pixel sees.

    Parameters
    ----------
    column, row : (rows, columns) ndarray of float64, px, or None
        Projector coordinate u and v, pixel centres integers; NaN where not decoded, None where the
        sequence does not code that axis.
    modulation : (rows, columns) ndarray of float32, grey levels 0–255
        The weakest amplitude of all patterns; see `DecodingLimits.min_modulation`.
    flags : (rows, columns) ndarray of uint8
        Combinations of `PixelFlag`.
    projector_width, projector_height : int, px
        Size of the projector's image.
    exposure_ms : float, ms, or None
        Exposure time of the frames.
    emulated : bool
        True if the frames were not recorded as they are.
    contradictions : tuple of Contradiction
        What in the frames does not fit their sequence, where the map may still be right.
    """

    column: NDArray[np.float64] | None
    row: NDArray[np.float64] | None
    modulation: NDArray[np.float32]
    flags: NDArray[np.uint8]
    projector_width: int
    projector_height: int
    exposure_ms: float | None
    emulated: bool
    contradictions: tuple[Contradiction, ...] = ()

    def __post_init__(self) -> None:
        for array in (self.column, self.row, self.modulation, self.flags):
            if array is not None:
                array.setflags(write=False)

    @property
    def image_shape(self) -> tuple[int, int]:
        """Rows and columns of the camera's image."""
        return int(self.flags.shape[0]), int(self.flags.shape[1])

    @property
    def valid(self) -> NDArray[np.bool_]:
        """(rows, columns): where every coded axis was decoded."""
        valid = np.ones(self.flags.shape, dtype=np.bool_)
        for coordinate in (self.column, self.row):
            if coordinate is not None:
                valid &= np.isfinite(coordinate)
        return valid

    def flagged(self, flag: PixelFlag) -> NDArray[np.bool_]:
        """Return (rows, columns): where a flag is set."""
        return np.asarray((self.flags & np.uint8(flag)) != 0)

    def counts(self) -> DecodingCounts:
        """Count the decoded pixels and each flag."""
        flagged = [int(np.count_nonzero(self.flagged(flag))) for flag in PixelFlag]
        half_read = 0
        if self.column is not None and self.row is not None:
            half_read = int(np.count_nonzero(np.isnan(self.column) != np.isnan(self.row)))
        n_decoded = int(np.count_nonzero(self.valid))
        return DecodingCounts(self.flags.size, n_decoded, half_read, *flagged)
