"""From a pattern sequence to what a projector shows, frame by frame."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from exposight.errors import ImageError, SensorError
from exposight.imaging import Fringe, GrayCode, PatternSequence, PhaseShift
from exposight.twin.sensors.slides import blurred_slide
from exposight.twin.sensors.stripes import Patterns

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from exposight.cell import ActiveSensor, Projector


STRIPES = PatternSequence(
    name="1, 8 and 64 stripes, four steps each",
    projector_width=1920,
    projector_height=1200,
    columns=PhaseShift(
        fringes=(
            Fringe(periods=1, frames=(0, 1, 2, 3)),
            Fringe(periods=8, frames=(4, 5, 6, 7)),
            Fringe(periods=64, frames=(8, 9, 10, 11)),
        )
    ),
)
"""Stripes of the twin's first prototype, over the 1920 columns of the paper's sensor's preset."""


def projector_of(sensor: ActiveSensor) -> Projector:
    """Return a sensor's projector.

    Raises
    ------
    SensorError
        If its document has none.
    """
    if sensor.projector is None:
        msg = f"sensor {sensor.name!r} has no projector; the simulated cell needs one"
        raise SensorError(msg)
    return sensor.projector


def default_sequence(projector: Projector) -> PatternSequence:
    """Return the stripes of `STRIPES` over a projector's columns."""
    return replace(STRIPES, projector_width=projector.width, projector_height=projector.height)


def fringe_sequence(periods: Sequence[float], projector: Projector) -> PatternSequence:
    """Return fringes over a projector's columns, four steps each.

    Parameters
    ----------
    periods : sequence of float
        Periods of each fringe over the projector's width, from few to many; the first at most one.
    projector : Projector
        That shows them.

    Raises
    ------
    ImageError
        If the fringes do not ascend, or begin with more than one period.
    """
    fringes = tuple(
        Fringe(periods=count, frames=(4 * i, 4 * i + 1, 4 * i + 2, 4 * i + 3))
        for i, count in enumerate(periods)
    )
    return PatternSequence(
        name=f"{', '.join(f'{count:g}' for count in periods)} stripes, four steps each",
        projector_width=projector.width,
        projector_height=projector.height,
        columns=PhaseShift(fringes=fringes),
    )


def gray_code_of(coding: GrayCode | PhaseShift | None) -> GrayCode | None:
    """Return the Gray code in an axis's coding, or None where it has none."""
    return coding.gray_code if isinstance(coding, PhaseShift) else coding


def image_frame(sequence: PatternSequence) -> int:
    """Return the frame that becomes a capture's image: the first of the finest pattern.

    Many stripes cross every ring there, as in the pattern that the paper's sensor shows while one
    sets the exposure (Sect. 3.2.1).
    """
    _, coding, _ = sequence.axes()[0]
    if isinstance(coding, PhaseShift):
        return coding.fringes[-1].frames[0]
    return coding.frames[-1]


def projected(sequence: PatternSequence, contrast: float) -> Patterns:
    """Return what a projector shows.

    Parameters
    ----------
    sequence : PatternSequence
        What each frame means. Frames that mean nothing show the mean light.
    contrast : float
        c₀ of the projector: dark parts pass (1 − c₀)/2 of the light, lit ones (1 + c₀)/2.

    Raises
    ------
    ImageError
        If the frames are to have another bit depth than 8.
    """
    if sequence.bit_depth != 8:
        msg = (
            f"the simulated camera takes frames of 8 bits, sequence {sequence.name!r} has "
            f"{sequence.bit_depth}; describe it with bit_depth = 8"
        )
        raise ImageError(msg)
    planes = np.zeros((sequence.n_frames, 2), dtype=np.int64)
    weights = np.zeros((sequence.n_frames, 2), dtype=np.float32)
    waves: dict[str, list[float]] = {"columns": [], "rows": []}
    n_planes = 0
    for axis, coding, size in sequence.axes():
        for fringe in coding.fringes if isinstance(coding, PhaseShift) else ():
            shift = np.radians(fringe.shifts_deg)
            planes[list(fringe.frames)] = n_planes
            weights[list(fringe.frames)] = np.stack([np.cos(shift), np.sin(shift)], axis=-1)
            waves[axis].append(fringe.periods / size)
            n_planes += 1
    slides = _lit(sequence)
    for frame in slides:
        planes[frame] = (n_planes, 0)
        weights[frame] = (1.0, 0.0)
        n_planes += 1
    return Patterns(
        column_waves=np.array(waves["columns"]),
        row_waves=np.array(waves["rows"]),
        slides=tuple(
            blurred_slide((0.5 * (1.0 + contrast * (2.0 * lit - 1.0))).astype(np.float32))
            for lit in slides.values()
        ),
        planes=planes,
        weights=weights,
    )


def _lit(sequence: PatternSequence) -> dict[int, NDArray[np.float64]]:
    """Return where the frames of a Gray code, white and black are lit, by frame: 0 or 1."""
    lit: dict[int, NDArray[np.float64]] = {}
    for axis, coding, size in sequence.axes():
        gray = gray_code_of(coding)
        if gray is None:
            continue
        code = np.arange(size) // gray.code_width
        shape = (1, size) if axis == "columns" else (size, 1)
        for i, frame in enumerate(gray.frames):
            bit = ((code ^ (code >> 1)) >> (len(gray.frames) - 1 - i)) & 1
            lit[frame] = bit.reshape(shape).astype(np.float64)
            if gray.inverse_frames:
                lit[gray.inverse_frames[i]] = 1.0 - lit[frame]
    if sequence.white_frame is not None and sequence.black_frame is not None:
        lit[sequence.white_frame] = np.ones((1, 1))
        lit[sequence.black_frame] = np.zeros((1, 1))
    return lit
