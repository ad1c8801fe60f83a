"""Decode a recording: frames and their meaning in, projector coordinates out.

Gray codes are decoded by `exposight.imaging.gray_code`, phase-shifted fringes by
`exposight.imaging.phase_shift`.
"""

from collections.abc import Collection
from pathlib import Path

import numpy as np

from exposight.contradictions import settle
from exposight.errors import ImageError
from exposight.imaging.consistency import frame_contradictions
from exposight.imaging.decoded import AxisMap, DecodedMap, DecodingLimits
from exposight.imaging.frame_files import read_frames
from exposight.imaging.frames import FrameStack, Light
from exposight.imaging.gray_code import decode_gray_code
from exposight.imaging.phase_shift import decode_fringes
from exposight.imaging.sequences import AxisCoding, PatternSequence


def read_recording(
    folder: str | Path, sequence: PatternSequence, *, exposure_ms: float | None = None
) -> FrameStack:
    """Read a folder's frames as a sequence describes them: files, number, grey levels.

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
        alignment=sequence.alignment,
        channel=sequence.channel,
        saturation_level=sequence.saturation_level,
        response=sequence.response(),
        count=sequence.n_frames,
        exposure_ms=exposure_ms,
    )


def decode(
    stack: FrameStack,
    sequence: PatternSequence,
    limits: DecodingLimits | None = None,
    *,
    despite: Collection[str] = (),
    checked: bool = True,
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
    despite : collection of str
        Names of checks whose errors are accepted (see `exposight.imaging.consistency`).
    checked : bool
        False for frames that are known to be what the sequence says, as simulated ones are.

    Raises
    ------
    ImageError
        If the stack has another number of frames, bit depth, saturation level or response than the
        sequence says.
    ContradictionError
        If the frames contradict the sequence, or one another.
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
    for what, of_stack, of_sequence in (
        ("saturation level", stack.saturation_level, sequence.saturation_level),
        ("response of the camera", stack.response, sequence.response()),
    ):
        if not np.array_equal(of_stack, of_sequence):  # type: ignore[arg-type]
            msg = (
                f"the stack's {what} is another than that of sequence '{sequence.name}'; say the "
                "same in both, as read_recording does"
            )
            raise ImageError(msg)
    limits = limits or DecodingLimits()
    found = settle(frame_contradictions(stack, sequence, limits), despite) if checked else ()
    light = stack.light()
    maps = {
        axis: _decode_axis(light, sequence, axis, coding, size, limits)
        for axis, coding, size in sequence.axes()
    }
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
        contradictions=found,
    )


def _decode_axis(
    light: Light,
    sequence: PatternSequence,
    axis: str,
    coding: AxisCoding,
    size: int,
    limits: DecodingLimits,
) -> AxisMap:
    """Decode one projector axis of `size` px."""
    by_code = None
    if coding.gray_code is not None:
        thresholds = sequence.threshold_fringes(axis)
        by_code = decode_gray_code(light, sequence, coding.gray_code, thresholds, size, limits)
    if coding.fringes or by_code is None:
        decoded = decode_fringes(light, sequence, coding, size, limits, by_code)
    else:
        decoded = AxisMap(by_code.coordinate, by_code.modulation, by_code.flags)
    if coding.mirrored:
        np.subtract(size - 1, decoded.coordinate, out=decoded.coordinate)
    return decoded
