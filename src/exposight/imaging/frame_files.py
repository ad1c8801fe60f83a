"""Read a recording's frames from image files, as cameras write them.

Grey levels of 8 to 16 bits stand in the low bits of a file's samples, or in the high ones; a colour
image is read where its channels are equal or one is named.
"""

import re
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from fnmatch import fnmatchcase
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Any, Literal, TypeAlias, cast

import numpy as np
from numpy.typing import NDArray

from exposight.cell import BitDepth, Image, check_levels, full_scale, right_aligned
from exposight.cell.image_files import decoded_image, is_lossy
from exposight.errors import ImageError, MissingFileError
from exposight.files import read_bytes, recognised
from exposight.imaging.frames import FrameStack

Alignment: TypeAlias = Literal["low", "high"]
"""Which bits of a file's samples hold the grey level."""

Channel: TypeAlias = Literal["red", "green", "blue"]

_PLANES = {"blue": 0, "green": 1, "red": 2}  # as OpenCV orders them


def read_frames(
    source: str | Path | Sequence[str | Path],
    *,
    pattern: str = "*.png",
    bit_depth: BitDepth = 8,
    alignment: Alignment = "low",
    channel: Channel | None = None,
    saturation_level: int | None = None,
    response: NDArray[np.float64] | None = None,
    count: int | None = None,
    exposure_ms: float | None = None,
) -> FrameStack:
    """Read a recording's frames from image files.

    Parameters
    ----------
    source : path or sequence of paths
        A folder, whose files that match `pattern` are taken in natural order (2 before 10); or the
        files themselves, taken in the order given.
    pattern : str
        Which files of a folder are frames; its extension matches in capitals, too. Where none
        matches, others that differ in capitals, or by .tif instead of .tiff, are taken and said.
    bit_depth : int, 8 to 16
        What the files must hold.
    alignment : {"low", "high"}
        Which bits of 16 hold the grey level. Where they are the high ones, the low bits are 0 or
        repeat the highest; others contradict it.
    channel : {"red", "green", "blue"}, optional
        Which channel of colour images is read. Without it they are refused unless their three
        channels are equal: a camera's colour path interpolates and often bends the grey levels, and
        only the user can know that it did not.
    saturation_level : int, optional
        As for `FrameStack`, in grey levels of `bit_depth`.
    response : (2**bit_depth,) ndarray of float64, optional
        As for `FrameStack`.
    count : int, optional
        How many frames there must be.
    exposure_ms : float, ms, optional
        Exposure time of the recording.

    Raises
    ------
    MissingFileError
        If the folder, or a file, is not there, or none matches.
    ImageError
        If the number of frames is another, or one is unreadable (truncated, say), of another size
        than the first, of another bit depth or alignment, or in colour.
    """
    paths = _frame_paths(source, pattern)
    _check_count(paths, count)
    full_scale(bit_depth)  # refuses others, before any file is read
    read = partial(_read_grey, bit_depth=bit_depth, alignment=alignment, channel=channel)
    first = read(paths[0], shape=None)
    frames = np.empty((len(paths), *first.shape), dtype=first.dtype)
    frames[0] = first

    def read_into(index: int) -> None:
        frames[index] = read(paths[index], shape=first.shape)

    with ThreadPoolExecutor() as pool:  # decoding image files leaves the interpreter free
        list(pool.map(read_into, range(1, len(paths))))
    return FrameStack(
        frames=frames,
        bit_depth=bit_depth,
        saturation_level=saturation_level,
        response=response,
        exposure_ms=exposure_ms,
    )


def _frame_paths(source: str | Path | Sequence[str | Path], pattern: str) -> list[Path]:
    if not isinstance(source, str | Path):
        paths = [Path(path) for path in source]
        if not paths:
            msg = "at least one frame is needed, got an empty list of paths"
            raise MissingFileError(msg)
        return paths
    folder = Path(source)
    if not folder.is_dir():
        msg = f"{folder}: expected a folder of frames, found none; check the path"
        raise MissingFileError(msg)
    paths = sorted(folder.glob(_any_case(pattern)), key=_natural_key)
    if not paths:
        paths = sorted(_nearly_matching(folder, pattern), key=_natural_key)
        if paths:
            recognised(folder, f"frames such as {paths[0].name}, for none matches {pattern}")
    if not paths:
        msg = f"{folder}: no frame matches '{pattern}'; {_advice(folder, pattern)}"
        raise MissingFileError(msg)
    return paths


def _any_case(pattern: str) -> str:
    """Return a pattern whose extension also matches in capitals: cameras write .BMP, .TIF."""
    name, dot, extension = pattern.rpartition(".")
    if not dot or not extension.isalnum():
        return pattern
    either = (f"[{c.lower()}{c.upper()}]" if c.isalpha() else c for c in extension)
    return f"{name}.{''.join(either)}"


_TWINS = {"jpg": "jpeg", "jpeg": "jpg", "tif": "tiff", "tiff": "tif"}


def _nearly_matching(folder: Path, pattern: str) -> list[Path]:
    """Return files that a pattern matches but for capitals, and for .tif instead of .tiff."""
    name, _, extension = pattern.casefold().rpartition(".")
    tried = (extension, _TWINS.get(extension, extension))
    return [
        path
        for path in folder.iterdir()
        if any(fnmatchcase(path.name.casefold(), f"{name}.{each}") for each in tried)
        and path.is_file()
    ]


def _advice(folder: Path, pattern: str) -> str:
    """Say where frames may be that are not in a folder itself."""
    inside = sorted({path.parent.name for path in folder.glob(f"*/{pattern}")})
    if inside:
        more = f" and {len(inside) - 4} more" if len(inside) > 4 else ""
        return f"there are some in its folders {', '.join(inside[:4])}{more}: give one of these"
    return (
        "check the folder, or say how its frames are named: file_pattern in the pattern sequence's "
        "TOML file"
    )


def _natural_key(path: Path) -> list[tuple[bool, int, str]]:
    parts = re.split(r"(\d+)", path.name)
    return [(part.isdigit(), int(part) if part.isdigit() else 0, part) for part in parts]


def _check_count(paths: list[Path], count: int | None) -> None:
    if count is None or len(paths) == count:
        return
    msg = f"{paths[0].parent}: expected {count} frames, found {len(paths)}"
    gaps = _missing_numbers(paths)
    if gaps:
        msg += f"; the numbering skips {', '.join(map(str, gaps))}"
    msg += "; check that the recording is complete and that the pattern matches frames only"
    if len(paths) > count:
        msg += ", or name those that mean nothing in the pattern sequence's unused_frames"
    raise ImageError(msg)


def _missing_numbers(paths: list[Path]) -> list[int]:
    """Return numbers that the last number in the file names skips, at most eight."""
    digits = [re.findall(r"\d+", path.stem) for path in paths]
    if not all(digits):
        return []
    numbers = [int(groups[-1]) for groups in digits]
    return [gap for a, b in pairwise(numbers) for gap in range(a + 1, min(b, a + 9))][:8]


def _read_grey(
    path: Path,
    *,
    bit_depth: int,
    alignment: Alignment,
    channel: Channel | None,
    shape: tuple[int, ...] | None,
) -> Image:
    if not path.is_file():
        msg = f"{path}: no such frame"
        raise MissingFileError(msg)
    data = read_bytes(path, "frame")
    image = decoded_image(data, path)
    if shape is None and is_lossy(data):  # said of the first frame
        recognised(path, "JPEG, whose compression changes grey levels: PNG or TIFF keep them")
    grey = _grey_of(image, channel, path)
    if alignment == "high":
        grey = right_aligned(grey, bit_depth, str(path))
    check_levels(grey, bit_depth, str(path))
    if shape is not None and grey.shape != shape:
        msg = (
            f"{path}: expected {shape[0]} rows × {shape[1]} columns as in the first frame, got "
            f"{grey.shape[0]} × {grey.shape[1]}; frames of one recording have one size"
        )
        raise ImageError(msg)
    return cast("Image", grey)


def _grey_of(image: NDArray[Any], channel: Channel | None, path: Path) -> NDArray[Any]:
    """Return the grey levels of an image: its own, of the channel named, or of equal channels."""
    if image.ndim == 2:
        if channel is None:
            return image
        msg = f"{path}: channel {channel!r} of a grey image; leave out the channel"
        raise ImageError(msg)
    if image.shape[2] < 3:
        return image[..., 0]  # grey and opacity
    if channel is not None:
        return image[..., _PLANES[channel]]
    blue, green, red = (image[..., i] for i in range(3))
    if np.array_equal(blue, green) and np.array_equal(green, red):
        return green
    msg = (
        f"{path}: expected a grey image, got {image.shape[2]} different channels; record in grey, "
        'or say which channel is read: channel = "red", "green" or "blue"'
    )
    raise ImageError(msg)
