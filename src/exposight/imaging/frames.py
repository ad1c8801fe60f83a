"""Stacks of grey frames taken with one exposure, in memory and from image files.

`re_expose` emulates other exposure times, for scenes that were recorded only once.
"""

import math
import re
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import cast

import cv2
import numpy as np

from exposight.cell import BitDepth, Image, check_levels, full_scale
from exposight.errors import ImageError, MissingFileError


@dataclass(frozen=True, kw_only=True, eq=False)
class FrameStack:
    """Grey frames of one scene, taken one after the other with one exposure time.

    Parameters
    ----------
    frames : (n, rows, columns) ndarray of uint8 or uint16
        Grey levels; made read-only.
    bit_depth : 8, 10, 12 or 16
        10 and 12 stand in the low bits of uint16.
    exposure_ms : float, ms, optional
        Exposure time; None where it was not recorded.
    emulated : bool
        True if the grey levels were not recorded as they are (see `re_expose`).

    Raises
    ------
    ImageError
        If frames and bit depth do not fit, or the exposure time is not positive.
    """

    frames: Image
    bit_depth: BitDepth = 8
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
        """The largest grey level, at which a sample counts as clipped."""
        return full_scale(self.bit_depth)


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
        frames=cast("Image", frames),
        bit_depth=stack.bit_depth,
        exposure_ms=None if stack.exposure_ms is None else stack.exposure_ms * factor,
        emulated=True,
    )


def read_frames(
    source: str | Path | Sequence[str | Path],
    *,
    pattern: str = "*.png",
    bit_depth: BitDepth = 8,
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
        Which files of a folder are frames.
    bit_depth : 8, 10, 12 or 16
        What the files must hold. Colour images are refused, also those with three equal channels:
        a camera's colour path interpolates and often bends the grey levels, and only the user can
        know that it did not.
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
        than the first, of another bit depth, or in colour.
    """
    paths = _frame_paths(source, pattern)
    _check_count(paths, count)
    full_scale(bit_depth)  # refuses others, before any file is read
    first = _read_grey(paths[0], bit_depth, None)
    frames = np.empty((len(paths), *first.shape), dtype=first.dtype)
    frames[0] = first

    def read_into(index: int) -> None:
        frames[index] = _read_grey(paths[index], bit_depth, first.shape)

    with ThreadPoolExecutor() as pool:  # decoding image files leaves the interpreter free
        list(pool.map(read_into, range(1, len(paths))))
    return FrameStack(frames=frames, bit_depth=bit_depth, exposure_ms=exposure_ms)


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
    paths = sorted(folder.glob(pattern), key=_natural_key)
    if not paths:
        msg = f"{folder}: no frame matches '{pattern}'; {_advice(folder, pattern)}"
        raise MissingFileError(msg)
    return paths


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
    raise ImageError(msg)


def _missing_numbers(paths: list[Path]) -> list[int]:
    """Return numbers that the last number in the file names skips, at most eight."""
    digits = [re.findall(r"\d+", path.stem) for path in paths]
    if not all(digits):
        return []
    numbers = [int(groups[-1]) for groups in digits]
    return [gap for a, b in pairwise(numbers) for gap in range(a + 1, min(b, a + 9))][:8]


def _read_grey(path: Path, bit_depth: int, shape: tuple[int, ...] | None) -> Image:
    if not path.is_file():
        msg = f"{path}: no such frame"
        raise MissingFileError(msg)
    image = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    if image is None:
        msg = f"{path}: cannot be read as an image; it may be truncated: copy or record it again"
        raise ImageError(msg)
    if image.ndim != 2:
        msg = (
            f"{path}: expected a {bit_depth}-bit grey image, got {image.shape[2]} channels; record "
            "in grey, or save one channel of it as a grey image"
        )
        raise ImageError(msg)
    check_levels(image, bit_depth, str(path))
    if shape is not None and image.shape != shape:
        msg = (
            f"{path}: expected {shape[0]} rows × {shape[1]} columns as in the first frame, got "
            f"{image.shape[0]} × {image.shape[1]}; frames of one recording have one size"
        )
        raise ImageError(msg)
    return cast("Image", image)
