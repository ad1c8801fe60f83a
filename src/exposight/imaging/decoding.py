"""Decode a recording: frames and their meaning in, projector coordinates out."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from exposight.errors import ImageError
from exposight.imaging.decoded import DecodedMap, DecodingLimits
from exposight.imaging.frames import FrameStack, read_frames
from exposight.imaging.gray_code import decode_gray_code
from exposight.imaging.phase_shift import decode_phase_shift
from exposight.imaging.sequences import GrayCode, PatternSequence

if TYPE_CHECKING:
    from pathlib import Path


def read_recording(
    folder: str | Path, sequence: PatternSequence, *, exposure_ms: float | None = None
) -> FrameStack:
    """Read a folder's frames as a sequence describes them: pattern, number, bit depth.

    Parameters
    ----------
    folder : path
        Where the frames are.
    sequence : PatternSequence
        What they mean.
    exposure_ms : float, ms, optional
        Exposure time of the recording.

    Raises
    ------
    MissingFileError, ImageError
        As `read_frames`.
    """
    return read_frames(
        folder,
        pattern=sequence.file_pattern,
        bit_depth=sequence.bit_depth,
        count=sequence.n_frames,
        exposure_ms=exposure_ms,
    )


def decode(
    stack: FrameStack, sequence: PatternSequence, limits: DecodingLimits | None = None
) -> DecodedMap:
    """Find the projector coordinate that every camera pixel sees.

    Parameters
    ----------
    stack : FrameStack
        The recording.
    sequence : PatternSequence
        What its frames mean.
    limits : DecodingLimits, optional
        When a pixel counts as decoded.

    Raises
    ------
    ImageError
        If the stack has another number of frames or bit depth than the sequence says.
    """
    if stack.n_frames != sequence.n_frames:
        msg = (
            f"sequence '{sequence.name}' needs {sequence.n_frames} frames, got {stack.n_frames}; "
            "check that the recording is complete, or describe its sequence"
        )
        raise ImageError(msg)
    if stack.bit_depth != sequence.bit_depth:
        msg = (
            f"sequence '{sequence.name}' is of {sequence.bit_depth} bits, the stack of "
            f"{stack.bit_depth}; say the same bit depth in both"
        )
        raise ImageError(msg)
    limits = limits or DecodingLimits()
    maps = {}
    for axis, coding, size in sequence.axes():
        decode_axis = decode_gray_code if isinstance(coding, GrayCode) else decode_phase_shift
        maps[axis] = decode_axis(stack, sequence, coding, size, limits)  # type: ignore[arg-type]
    columns, rows = maps.get("columns"), maps.get("rows")
    both = list(maps.values())
    return DecodedMap(
        column=None if columns is None else columns.coordinate,
        row=None if rows is None else rows.coordinate,
        modulation=np.minimum(both[0].modulation, both[-1].modulation),
        flags=both[0].flags | both[-1].flags,
        projector_width=sequence.projector_width,
        projector_height=sequence.projector_height,
        exposure_ms=stack.exposure_ms,
        emulated=stack.emulated,
    )
