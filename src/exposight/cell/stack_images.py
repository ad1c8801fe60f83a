"""What all frames behind a capture tell of each pixel, beyond the capture's one image."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import Any, Literal, get_args

from exposight.cell.image import GREY_MAX, Image, read_only
from exposight.errors import ImageError, InputError

BrightnessSource = Literal["stripe", "stripes-mean", "texture", "dots", "merged"]
"""What a capture's image is: one stripe image; the mean of the finest pattern's images; a texture
image, evenly lit; random dots; pixels of several exposures (`exposight.imaging.merge_captures`)."""

EVEN_SOURCES: tuple[BrightnessSource, ...] = ("stripes-mean", "texture")
"""Images in which no pattern is left."""


@dataclass(frozen=True, kw_only=True, eq=False)
class StackImages:
    """Brightness and modulation over all frames of a capture, pixel by pixel.

    Of structured light the frames are its patterns. Of random dots, of which there is one image,
    they are the pixels of the matching window round each pixel.

    Parameters
    ----------
    mean : (rows, columns) ndarray of uint8 or uint16, or None
        Brightness without the pattern: the mean of the finest fringe's frames, or of the window.
        None where the capture's image is it already.
    maximum : (rows, columns) ndarray of uint8 or uint16
        The brightest frame; of dots, the window's 80th percentile.
    modulation : (rows, columns) ndarray of uint8 or uint16
        The weakest peak-to-peak swing of the patterns, twice the amplitude that decoding judges, so
        that 8 bits lose nothing; of dots, twice the window's standard deviation.
    min_modulation : float or None, grey levels 0–255
        Amplitude (half the swing) below which a pixel is not decoded, or matched; None where the
        limit is not known.

    Raises
    ------
    InputError
        If the limit is not from 0 to 255.
    """

    mean: Image | None = None
    maximum: Image
    modulation: Image
    min_modulation: float | None = None

    def __post_init__(self) -> None:
        limit = self.min_modulation
        if limit is not None and not 0 <= limit <= GREY_MAX:
            msg = f"min_modulation must be from 0 to 255 grey levels, got {limit}"
            raise InputError(msg)

    def images(self) -> dict[str, Image]:
        """Return the images that are there by name."""
        named = ((each.name, getattr(self, each.name)) for each in fields(self)[:3])
        return {name: image for name, image in named if image is not None}

    def checked(self, shape: tuple[int, ...], bit_depth: int) -> StackImages:
        """Return read-only copies of the images.

        Parameters
        ----------
        shape : (int, int)
            Rows and columns that they must have.
        bit_depth : int, 8 to 16
            Their bits.

        Raises
        ------
        ImageError
            If an image has another size, or its type or range is not that of the bit depth.
        """
        images: dict[str, Any] = {}
        for name, image in self.images().items():
            images[name] = read_only(image, bit_depth, f"stack image {name!r}")
            if image.shape != shape:
                msg = (
                    f"stack image {name!r} must have the {shape[0]} rows × {shape[1]} columns of "
                    f"the capture's image, got {image.shape[0]} × {image.shape[1]}"
                )
                raise ImageError(msg)
        return replace(self, **images)


def check_source(source: str, stack: StackImages | None) -> None:
    """Check what a capture's image is said to be.

    Parameters
    ----------
    source : str
        A `BrightnessSource`.
    stack : StackImages or None
        The capture's.

    Raises
    ------
    InputError
        If there is no such source, or the stack has a mean beside an image that is it already.
    """
    known = get_args(BrightnessSource)
    if source not in known:
        msg = f"brightness_source must be one of {', '.join(known)}, got {source!r}"
        raise InputError(msg)
    if source == "stripes-mean" and stack is not None and stack.mean is not None:
        msg = (
            "the capture's image is said to be the stripes' mean, and its stack has another mean; "
            "leave one out, or say brightness_source='stripe'"
        )
        raise InputError(msg)
