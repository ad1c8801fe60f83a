"""What matching two cameras yields: a cloud, and why the other pixels have no point."""

from collections.abc import Mapping
from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from exposight.cell import Cloud
from exposight.contradictions import Contradiction
from exposight.errors import ImageError
from exposight.geometry import PinholeCamera
from exposight.imaging.rectification import RectifiedPair


class MatchOutcome(IntEnum):
    """What became of a pixel of the first image."""

    MATCHED = 0
    """It has a point."""
    NOT_DECODED = 1
    """Matching codes: its projector coordinate was not read."""
    CLIPPED = 2
    """Matching images: too many pixels round it are at full scale."""
    NO_TEXTURE = 3
    """Matching images: the grey values round it hardly vary."""
    NO_PARTNER = 4
    """The second image shows nothing like it where it may be: hidden there, or not read."""
    AMBIGUOUS = 5
    """Matching codes: the second image shows it in more places than one, or it mixes
    two surfaces."""
    OUTSIDE = 6
    """Its depth is outside the limits."""


@dataclass(frozen=True, kw_only=True, eq=False)
class StereoMatch:
    """A matched pair.

    Parameters
    ----------
    cloud : Cloud
        Organised like the first image, in the first camera's frame.
    outcome : (rows, columns) ndarray of uint8
        A `MatchOutcome` of each pixel.
    contradictions : tuple of Contradiction
        What does not fit, where the cloud may still be right.
    """

    cloud: Cloud
    outcome: NDArray[np.uint8]
    contradictions: tuple[Contradiction, ...] = ()

    def counts(self) -> Mapping[MatchOutcome, int]:
        """Count the pixels of each outcome."""
        numbers = np.bincount(self.outcome.ravel(), minlength=len(MatchOutcome)).tolist()
        return dict(zip(MatchOutcome, numbers, strict=True))


def check_sizes(
    pair: RectifiedPair, first_shape: tuple[int, ...], second_shape: tuple[int, ...]
) -> None:
    """Check that both images are of their cameras' sizes.

    Raises
    ------
    ImageError
        If one is not.
    """
    images: tuple[tuple[str, tuple[int, ...], PinholeCamera], ...] = (
        ("first", first_shape, pair.first),
        ("second", second_shape, pair.second),
    )
    for name, shape, camera in images:
        if shape != (camera.height, camera.width):
            size = " × ".join(map(str, shape[::-1]))
            msg = (
                f"the {name} image has {size} px, its camera {camera.width} × {camera.height}; use "
                "the calibration of the camera that took it, at the same resolution"
            )
            raise ImageError(msg)
