"""Frames of a folder of which nothing is known: their files, bit depth and alignment."""

import re
from collections import defaultdict
from pathlib import Path
from typing import NamedTuple, cast

import numpy as np

from exposight.cell import BitDepth, Image
from exposight.cell.image_files import decoded_image
from exposight.errors import MissingFileError
from exposight.files import read_bytes
from exposight.imaging.frame_files import read_frames
from exposight.imaging.frames import FrameStack

_SUFFIXES = {".png", ".tif", ".tiff", ".bmp", ".pgm", ".jpg", ".jpeg"}


class UnknownRecording(NamedTuple):
    """Frames, how their files are named, and which bits hold the grey level."""

    stack: FrameStack
    file_pattern: str
    is_high: bool
    """True where levels stand in the high bits of the files' samples."""


def read_unknown_recording(folder: Path) -> UnknownRecording:
    """Read the frames of a folder, whatever they are called.

    Frames are the largest group of images whose names differ in numbers only. Of 16-bit files, the
    bit depth is the least even one that holds all levels, in the low bits or the high ones.

    Parameters
    ----------
    folder : Path
        Where they are.

    Raises
    ------
    MissingFileError
        If there is no such folder, or no image in it.
    ImageError
        If the frames are of different sizes, in colour, or unreadable.
    """
    groups: dict[tuple[str, str], list[Path]] = defaultdict(list)
    for path in folder.glob("*") if folder.is_dir() else ():
        if path.suffix.lower() in _SUFFIXES:
            groups[re.sub(r"\d+", "#", path.stem), path.suffix].append(path)
    if not groups:
        msg = (
            f"{folder}: expected a folder with images ({', '.join(sorted(_SUFFIXES))}), found none"
        )
        raise MissingFileError(msg)
    (stem, suffix), paths = max(groups.items(), key=lambda item: len(item[1]))
    pattern = f"{re.split('#', stem)[0]}*{suffix}"
    if len(list(folder.glob(pattern))) != len(paths):
        pattern = f"{stem.replace('#', '[0-9]*')}{suffix}"
    first = decoded_image(read_bytes(paths[0], "frame"), paths[0])
    if first.dtype == np.uint8:
        return UnknownRecording(read_frames(folder, pattern=pattern), pattern, is_high=False)
    frames = read_frames(folder, pattern=pattern, bit_depth=16).frames
    occurring = int(np.bitwise_or.reduce(frames, axis=None))
    unused = (occurring & -occurring).bit_length() - 1 if occurring else 0
    is_high = unused >= 2 and occurring.bit_length() == 16
    bits = 16 - unused if is_high else max(10, occurring.bit_length() + occurring.bit_length() % 2)
    levels = cast("Image", frames >> unused if is_high else frames)
    return UnknownRecording(
        FrameStack(frames=levels, bit_depth=cast("BitDepth", bits)), pattern, is_high
    )
