from dataclasses import replace

import cv2
import numpy as np
import pytest

from exposight.errors import ImageError
from exposight.imaging import (
    AxisCoding,
    DecodingLimits,
    FrameStack,
    Fringe,
    GrayCode,
    PatternSequence,
    PixelFlag,
    decode,
    re_expose,
    read_recording,
)

BOTH = PatternSequence(
    name="both axes", projector_width=16, projector_height=8,
    columns=AxisCoding(fringes=(Fringe(periods=1, frames=(0, 1, 2)),)),
    rows=AxisCoding(gray_code=GrayCode(frames=(3, 4, 5), inverse_frames=(6, 7, 8))),
)  # fmt: skip


@pytest.fixture
def stack(render_fringe, render_gray):
    column, row = np.meshgrid(np.arange(16.0), np.arange(8.0))
    bits = render_gray(row, 3)
    images = np.concatenate([render_fringe(column, 1, 16, [0, 120, 240]), bits, 220 - bits])
    return FrameStack(frames=np.rint(images).astype(np.uint8), exposure_ms=10.0)


def test_columns_and_rows_each_in_their_own_way(stack):
    decoded = decode(stack, BOTH)
    column, row = np.meshgrid(np.arange(16.0), np.arange(8.0))
    assert np.abs(decoded.column - column).max() < 0.02  # 8-bit grey levels
    assert np.array_equal(decoded.row, row)
    assert decoded.valid.all()


def test_an_axis_that_is_not_coded_is_none(stack):
    rows_only = PatternSequence(name="rows", projector_width=16, projector_height=8, rows=BOTH.rows)
    assert decode(stack, rows_only).column is None


def test_emulation_is_passed_on(stack):
    decoded = decode(re_expose(stack, 0.5), BOTH)
    assert decoded.emulated
    assert decoded.exposure_ms == pytest.approx(5.0)


def test_counts_say_why_pixels_are_missing(stack):
    frames = stack.frames.copy()
    frames[:, 0, 0] = 5
    frames[1, 2, 3] = 255
    counts = decode(FrameStack(frames=frames), BOTH).counts()
    assert (counts.pixels, counts.decoded, counts.low_modulation, counts.clipped) == (
        128,
        126,
        1,
        1,
    )


def test_missing_frames(stack):
    with pytest.raises(ImageError, match="sequence 'both axes' needs 9 frames, got 8"):
        decode(FrameStack(frames=stack.frames[:8]), BOTH)


def test_other_bit_depth(stack):
    deep = FrameStack(frames=stack.frames.astype(np.uint16), bit_depth=12)
    with pytest.raises(ImageError, match="is of 8 bits, the stack of 12"):
        decode(deep, BOTH)


@pytest.mark.parametrize(
    "limits", [{"min_modulation": -1}, {"max_residual": 0.6}, {"min_bit_contrast": np.nan}]
)
def test_bad_limits(limits):
    with pytest.raises(ImageError, match="limits of decoding must be 0 or more"):
        DecodingLimits(**limits)


def test_a_modulation_beyond_grey_levels():
    with pytest.raises(ImageError, match=r"at most 255, where grey levels end .* got 300$"):
        DecodingLimits(min_modulation=300)


def test_recording_is_read_as_its_sequence_says(tmp_path, stack):
    for i, frame in enumerate(stack.frames):
        cv2.imwrite(str(tmp_path / f"frame{i}.png"), frame)
    read = read_recording(tmp_path, BOTH, exposure_ms=10.0)
    assert np.array_equal(read.frames, stack.frames)
    assert read.exposure_ms == 10.0


def test_incomplete_recording(tmp_path, stack):
    for i in (0, 1, 3):
        cv2.imwrite(str(tmp_path / f"frame{i}.png"), stack.frames[i])
    with pytest.raises(ImageError, match="expected 9 frames, found 3; the numbering skips 2"):
        read_recording(tmp_path, BOTH)


def test_samples_from_the_saturation_level_on_are_clipped(stack):
    frames = np.minimum(stack.frames, 180)
    saturating = replace(BOTH, saturation_level=180)
    seen = decode(FrameStack(frames=frames, saturation_level=180), saturating)
    clipped = (frames[:3] == 180).any(axis=0)
    assert clipped.any()
    assert np.array_equal(np.isnan(seen.column), clipped)
    assert (seen.flagged(PixelFlag.CLIPPED) >= clipped).all()


@pytest.mark.parametrize("changed", [{"saturation_level": 180}, {"camera_gamma": 2.2}])
def test_stack_and_sequence_say_the_same_of_grey_levels(stack, changed):
    with pytest.raises(ImageError, match="is another than that of sequence 'both axes'"):
        decode(stack, replace(BOTH, **changed))


def test_a_response_makes_frames_linear(render_fringe):
    # 16 bits, so that rounding is small beside the error that the curve makes of three steps.
    column = np.linspace(0, 15, 200).reshape(2, 100)
    light = render_fringe(column, 1, 16, [0, 120, 240]) / 255
    sequence = replace(BOTH, rows=None, bit_depth=16)
    frames = np.rint(65535 * light ** (1 / 2.2)).astype(np.uint16)
    bent = decode(FrameStack(frames=frames, bit_depth=16), sequence).column
    sequence = replace(sequence, camera_gamma=2.2)
    linear = FrameStack(frames=frames, bit_depth=16, response=sequence.response())
    assert np.abs(bent - column).max() > 0.1
    assert np.abs(decode(linear, sequence).column - column).max() < 1e-3


def test_frames_are_read_with_their_grey_levels(tmp_path, stack):
    sequence = replace(
        BOTH, bit_depth=12, alignment="high", saturation_level=4000, camera_gamma=2.0,
        unused_frames=(9,), file_pattern="*.tif",
    )  # fmt: skip
    for i, frame in enumerate([*stack.frames, stack.frames[0]]):
        cv2.imwrite(str(tmp_path / f"frame{i}.TIF"), frame.astype(np.uint16) << 8)
    read = read_recording(tmp_path, sequence)
    assert np.array_equal(read.frames[:9], stack.frames.astype(np.uint16) << 4)
    assert read.saturation_level == 4000
    assert np.array_equal(read.response, sequence.response())
    assert decode(read, sequence).valid.all()
