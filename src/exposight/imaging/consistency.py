"""What a recording's frames say twice: assembled here, held against each other in `contradictions`.

Everything is looked at along pairs of adjacent rows or columns of the image, evenly spread.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import cast

import numpy as np
from numpy.typing import NDArray

from exposight.cell import Image
from exposight.contradictions import Contradiction
from exposight.contradictions.codes import (
    Reading,
    check_bits,
    check_coverage,
    check_exchanged,
    check_neighbours,
)
from exposight.contradictions.fringe_sets import FringeSet, check_fringe_set
from exposight.contradictions.greys import check_greys
from exposight.contradictions.intersections import Meeting, check_intersections
from exposight.contradictions.steps import Steps, check_phase, check_steps
from exposight.geometry import PinholeCamera, RigidTransform
from exposight.imaging.codings import Fringe, GrayCode
from exposight.imaging.decoded import DecodedMap, DecodingLimits
from exposight.imaging.frames import FrameStack, Light
from exposight.imaging.gray_code import decode_gray_code
from exposight.imaging.response import phase_correction
from exposight.imaging.sequences import AxisCoding, PatternSequence

FRAME_CHECKS = (
    "saturation-spike",
    "grey-levels",
    "mosaic",
    "neighbouring-codes",
    "code-range",
    "fringe-steps",
    "fringe-order",
)
"""Names of the checks of frames; see ``docs/contradictions.md``."""

# Pixels of a frame that are looked at: of 4 megapixels every 128th pair of lines.
_SAMPLED_PIXELS = 32_768
_SAMPLED_RAYS = 10_000


def frame_contradictions(
    stack: FrameStack, sequence: PatternSequence, limits: DecodingLimits
) -> Iterator[Contradiction]:
    """Hold a recording's frames against what its sequence says of them.

    Parameters
    ----------
    stack : FrameStack
        The recording.
    sequence : PatternSequence
        What its frames mean.
    limits : DecodingLimits
        When a pixel counts as decoded.

    Yields
    ------
    Contradiction
        Of the names in `FRAME_CHECKS`.
    """
    yield from check_greys(
        stack.frames, stack.full_scale, clips_at=stack.clipping_level, scaled=stack.emulated
    )
    lines = (line_pairs(stack, vertical=False), line_pairs(stack, vertical=True))
    if sequence.white_frame is not None and sequence.black_frame is not None:
        white, black = (lines[0].frames[f] for f in (sequence.white_frame, sequence.black_frame))
        least = 2.0 * limits.min_modulation / lines[0].scale
        exchanged = check_exchanged(white, black, max(least, 1e-6))
        if exchanged is not None:
            yield exchanged
            return
    for axis, coding, size in sequence.axes():
        along = max(lines, key=lambda each: _changes(each, sequence, coding, limits))
        yield from _axis_contradictions(along, sequence, coding, axis, size, limits)


def map_contradiction(
    decoded: DecodedMap,
    camera: PinholeCamera,
    projector: PinholeCamera,
    projector_from_camera: RigidTransform,
) -> Contradiction | None:
    """Hold a decoded map against the calibration by which points are made of it.

    Parameters
    ----------
    decoded : DecodedMap
        Of the whole image.
    camera, projector : PinholeCamera
        Intrinsic parameters of both.
    projector_from_camera : RigidTransform
        Extrinsic parameters, mm.

    Returns
    -------
    Contradiction or None
        ``intersections``; see ``docs/contradictions.md``.
    """
    rows, columns = decoded.image_shape
    step = max(1, math.isqrt(rows * columns // _SAMPLED_RAYS))
    # Evenly about the middle, so that the sample of a turned image is the turned sample.
    grid = np.ix_(
        np.arange((rows - 1) % step // 2, rows, step),
        np.arange((columns - 1) % step // 2, columns, step),
    )
    column, row = (
        None if coordinate is None else coordinate[grid]
        for coordinate in (decoded.column, decoded.row)
    )
    if (rows, columns) != (camera.height, camera.width):
        return None  # triangulation refuses it
    return check_intersections(
        Meeting(
            rays=camera.rays()[grid],
            column=column,
            row=row,
            rotation=projector_from_camera.rotation,
            translation_mm=projector_from_camera.translation_mm,
            matrix=projector.matrix,
            size=(projector.width, projector.height),
        )
    )


def line_pairs(stack: FrameStack, *, vertical: bool, most: int = _SAMPLED_PIXELS) -> Light:
    """Return the light of pairs of adjacent rows, or of columns turned to rows.

    Of about `most` pixels a frame.
    """
    frames = stack.frames.transpose(0, 2, 1) if vertical else stack.frames
    _, rows, columns = frames.shape
    pairs = max(1, rows // 2)
    step = max(1, math.ceil(2 * pairs * columns / most))
    first = 2 * np.arange(min(step // 2, pairs - 1), pairs, step)
    chosen = np.stack([first, np.minimum(first + 1, rows - 1)], axis=1).ravel()
    return replace(stack, frames=cast("Image", np.ascontiguousarray(frames[:, chosen]))).light()


def _changes(
    lines: Light, sequence: PatternSequence, coding: AxisCoding, limits: DecodingLimits
) -> float:
    """Return by how much the axis' finest pattern changes from pixel to pixel along the lines."""
    lines = lines._replace(frames=lines.frames[:, ::4])
    if coding.fringes:
        fringe = coding.fringes[-1]
        phase, amplitude = _phase(lines, fringe)
        wave = np.exp(2j * np.pi * phase)
        usable = _usable(lines, fringe, amplitude, limits)
        both = usable[:, 1:] & usable[:, :-1]
        steps = np.abs(wave[:, 1:] - wave[:, :-1])[both]
        return float(np.median(steps)) if steps.size else 0.0
    if coding.gray_code is None:
        return 0.0
    words = _words(lines, sequence, coding.gray_code, limits)
    both = (words[:, 1:] >= 0) & (words[:, :-1] >= 0)
    return float(np.mean((words[:, 1:] != words[:, :-1])[both])) if both.any() else 0.0


def _axis_contradictions(
    lines: Light,
    sequence: PatternSequence,
    coding: AxisCoding,
    axis: str,
    size: int,
    limits: DecodingLimits,
) -> Iterator[Contradiction]:
    coordinate: NDArray[np.float64] | None = None
    reference, expected, spoiled = "", 1.0, False
    gray_code = coding.gray_code
    if gray_code is not None:
        words = _words(lines, sequence, gray_code, limits)
        is_binary = gray_code.code == "binary"
        reading = Reading(tuple(range(len(gray_code.frames))), binary=is_binary)
        jumping = check_bits(words, gray_code.frames, axis) or check_neighbours(
            words, reading, gray_code.frames, axis
        )
        if jumping is not None:
            yield jumping
            return  # whatever follows from these codes is as wrong
        n_codes = -(-size // gray_code.code_width)
        beyond = check_coverage(words, reading, n_codes, gray_code.first_code, axis)
        if beyond is not None:
            yield beyond
        if coding.fringes:
            thresholds = sequence.threshold_fringes(axis)
            read = decode_gray_code(lines, sequence, gray_code, thresholds, size, limits)
            # Without an edge on a side a coordinate is its code's middle: too rough of a wide one.
            is_exact = read.is_located if gray_code.code_width >= 4 else True
            coordinate = np.where(is_exact, read.coordinate, np.nan)
        reference = f"the Gray code of the {axis}"
    phases, lit = [], []
    for fringe in coding.fringes:
        phase, amplitude = _phase(lines, fringe)
        if sequence.projector_gamma != 1.0:
            correction = phase_correction(
                fringe.steps_deg, sequence.projector_gamma, sequence.pattern_contrast
            )
            phase = phase + np.interp(phase, np.linspace(-0.5, 0.5, correction.size), correction)
        usable = _usable(lines, fringe, amplitude, limits)
        steps = _steps(lines, fringe, usable, size, axis)
        if len(fringe.frames) == 3 and _is_chosen(lines, fringe, amplitude, usable, limits):
            usable = np.zeros_like(usable)
        told = steps._replace(usable=usable)
        for each in check_steps(told, sequence.projector_gamma):
            yield each
            # What harmonics do to three steps, or swapped frames, is no other order or number.
            spoiled |= gray_code is None and (each.is_error or len(fringe.frames) == 3)
        phases.append(phase)
        lit.append(steps.usable)
        period_px = size / fringe.periods
        if coordinate is not None:
            where = steps.usable & np.isfinite(coordinate)
            found = None
            if not spoiled:
                at, here = coordinate[where], phase[where]
                found = check_phase(at, here, steps, reference, expected=expected)
            if found is not None:
                yield found
        if gray_code is None:
            if coordinate is None:
                if fringe.periods > 1:
                    continue
                middle = 0.5 * (size - 1) / period_px
                order = np.rint(middle - phase)
            else:
                order = np.rint(coordinate / period_px - phase)
            coordinate = np.where(steps.usable, (phase + order) * period_px, np.nan)
            reference = f"that of the coarser fringe of {fringe.periods:g}"
        if gray_code is None and fringe is not coding.fringes[-1]:
            finer = coding.fringes[coding.fringes.index(fringe) + 1]
            expected = _expected_coherence(coordinate, size / finer.periods)
    if gray_code is None and coordinate is None and not spoiled:
        found = check_fringe_set(
            FringeSet(
                phases=np.stack(phases),
                usable=np.logical_and.reduce(lit),
                periods=[fringe.periods for fringe in coding.fringes],
                frames=[fringe.frames for fringe in coding.fringes],
                combinations=np.array(coding.ladder(size).combinations),
                size=size,
                axis=axis,
            )
        )
        if found is not None:
            yield found


def _expected_coherence(coordinate: NDArray[np.float64] | None, period_px: float) -> float:
    """Return the coherence with a fringe's phase that a coordinate's noise leaves."""
    if coordinate is None:
        return 0.0
    bend = coordinate[:, 2:] - 2 * coordinate[:, 1:-1] + coordinate[:, :-2]
    bend = np.abs(bend[np.isfinite(bend)])
    noise_px = 1.4826 * float(np.median(bend)) / math.sqrt(6) if bend.size else math.inf
    return math.exp(-2 * (math.pi * min(noise_px / period_px, 10.0)) ** 2)


def _signals(
    lines: Light, sequence: PatternSequence, gray_code: GrayCode, thresholds: Sequence[Fringe]
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Return (bits, …) lit minus unlit of every bit, and the contrast that they should have."""
    frames = lines.frames
    lit = frames[list(gray_code.frames)].astype(np.float32)
    white, black = sequence.white_frame, sequence.black_frame
    if gray_code.inverse_frames:
        signals = lit - frames[list(gray_code.inverse_frames)]
    elif white is not None:
        signals = 2 * lit - (frames[white].astype(np.float32) + frames[black])
    else:
        mean = [np.tensordot(f.solver()[0], frames[list(f.frames)], axes=1) for f in thresholds]
        signals = (2 * (lit - np.mean(mean, axis=0))).astype(np.float32)
    if white is None or black is None:
        return signals, np.abs(signals).max(axis=0)
    return signals, frames[white].astype(np.float32) - frames[black]


def _words(
    lines: Light, sequence: PatternSequence, gray_code: GrayCode, limits: DecodingLimits
) -> NDArray[np.int64]:
    """Return the bits of every pixel as a word, the first frame's highest; −1 where uncertain."""
    axis = "columns" if sequence.columns and sequence.columns.gray_code is gray_code else "rows"
    thresholds = sequence.threshold_fringes(axis)
    signals, contrast = _signals(lines, sequence, gray_code, thresholds)
    word = np.zeros(contrast.shape, dtype=np.int64)
    for signal in signals:
        word = 2 * word + (signal > 0)
    weak = (np.abs(signals) < limits.min_bit_contrast * contrast).sum(axis=0)
    dark = contrast * (0.5 * lines.scale) < max(limits.min_modulation, 1e-6)
    return np.where((weak > 1) | dark, -1, word)


def _phase(lines: Light, fringe: Fringe) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return phase, in periods, and amplitude, in grey levels."""
    _, cosine, sine = np.tensordot(fringe.solver(), lines.frames[list(fringe.frames)], axes=1)
    return np.arctan2(sine, cosine) / (2 * np.pi), np.hypot(cosine, sine)


def _usable(
    lines: Light, fringe: Fringe, amplitude: NDArray[np.float64], limits: DecodingLimits
) -> NDArray[np.bool_]:
    """Return where the fringe is modulated well and not clipped."""
    amplitude = amplitude * lines.scale
    clipped = (lines.frames[list(fringe.frames)] >= lines.clips_at).any(axis=0)
    return np.asarray((amplitude >= max(limits.min_modulation, 1e-6)) & ~clipped)


def _is_chosen(
    lines: Light,
    fringe: Fringe,
    amplitude: NDArray[np.float64],
    usable: NDArray[np.bool_],
    limits: DecodingLimits,
) -> bool:
    """Return whether which pixels are usable depends on their phase: clipped, or nearly too dark.

    What three steps tell is how modulation and mean follow the phase.
    """
    if not usable.any():
        return True
    clipped = (lines.frames[list(fringe.frames)] >= lines.clips_at).any(axis=0)
    typical = float(np.median(amplitude[usable])) * lines.scale
    return bool(clipped.sum() > 0.02 * usable.sum()) or typical < 2.0 * limits.min_modulation


def _steps(lines: Light, fringe: Fringe, usable: NDArray[np.bool_], size: int, axis: str) -> Steps:
    return Steps(
        samples=lines.frames[list(fringe.frames)].astype(np.float64),
        usable=usable,
        shifts_deg=fringe.steps_deg,
        frames=fringe.frames,
        periods=fringe.periods,
        size=size,
        name=f"the fringe of {fringe.periods:g} periods across the {axis}",
        is_reversed=fringe.reversed,
    )
