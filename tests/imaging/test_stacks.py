"""Stack images: known fringes have known swings, and windows of dots what NumPy finds in them."""

from dataclasses import replace

import numpy as np
import pytest

from exposight.imaging import (
    AxisCoding,
    DecodingLimits,
    FrameStack,
    Fringe,
    PatternSequence,
    StereoLimits,
    decode,
    mean_image,
    stack_images,
    window_images,
)

FRINGES = PatternSequence(
    name="two fringes",
    projector_width=64,
    projector_height=48,
    columns=AxisCoding(
        fringes=(Fringe(periods=1, frames=(0, 1, 2, 3)), Fringe(periods=8, frames=(4, 5, 6, 7)))
    ),
)
AMPLITUDES = (70.0, 40.5)


def fringes(bit_depth=8):
    """Frames of both fringes, about 120 grey levels, over a row of all phases."""
    top = 2**bit_depth - 1
    phase = np.linspace(0, 2 * np.pi, 200, endpoint=False)
    frames = [
        120 + amplitude * np.cos(periods * phase - k * np.pi / 2)
        for amplitude, periods in zip(AMPLITUDES, (1, 8), strict=True)
        for k in range(4)
    ]
    grey = np.rint(np.array(frames)[:, None] * top / 255)
    return FrameStack(
        frames=grey.astype(np.uint8 if bit_depth == 8 else np.uint16), bit_depth=bit_depth
    )


@pytest.mark.parametrize("bit_depth", [8, 10, 12, 16])
def test_the_swing_is_twice_the_weakest_amplitude(bit_depth):
    stack = fringes(bit_depth)
    sequence = PatternSequence(**{**vars(FRINGES), "bit_depth": bit_depth})
    images = stack_images(
        stack, sequence, decode(stack, sequence), DecodingLimits(min_modulation=7)
    )
    per_level = stack.full_scale / 255
    # Rounded samples shift an amplitude by up to a grey level.
    assert np.abs(images.modulation / per_level - 2 * min(AMPLITUDES)).max() <= 1.5
    assert np.abs(images.mean / per_level - 120).max() <= 1
    np.testing.assert_array_equal(images.maximum, stack.frames.max(axis=0))
    assert images.min_modulation == 7
    assert images.modulation.dtype == stack.frames.dtype


def test_a_mean_of_the_finest_frames_is_rounded_to_the_nearest():
    frames = np.zeros((8, 1, 3), dtype=np.uint8)
    frames[4:, 0] = [[1, 255, 0], [0, 255, 0], [1, 255, 0], [0, 255, 1]]
    assert mean_image(FrameStack(frames=frames), FRINGES).tolist() == [[1, 255, 0]]
    stack = FrameStack(frames=frames)
    images = stack_images(stack, FRINGES, decode(stack, FRINGES), with_mean=False)
    assert images.mean is None


def test_samples_that_saturate_are_full_scale_in_the_maximum():
    stack = fringes()
    brightest = int(stack.frames.max())
    saturating = replace(stack, saturation_level=brightest)
    sequence = replace(FRINGES, saturation_level=brightest)
    images = stack_images(saturating, sequence, decode(saturating, sequence))
    unclipped = stack.frames.max(axis=0)
    clipped = unclipped == brightest
    assert clipped.any()
    assert (images.maximum == np.where(clipped, 255, unclipped)).all()


def test_a_response_makes_stack_images_proportional_to_light():
    linear = fringes(16)
    sequence = replace(FRINGES, bit_depth=16, camera_gamma=2.2)
    levels = np.rint(65535 * (linear.frames / 65535) ** (1 / 2.2)).astype(np.uint16)
    bent = FrameStack(frames=levels, bit_depth=16, response=sequence.response())
    images = stack_images(bent, sequence, decode(bent, sequence))
    expected = stack_images(
        linear, (plain := replace(FRINGES, bit_depth=16)), decode(linear, plain)
    )
    for name, image in images.images().items():
        assert np.abs(image.astype(int) - expected.images()[name]).max() <= 3


def test_a_swing_beyond_full_scale_is_full_scale():
    frames = np.zeros((8, 1, 1), dtype=np.uint8)
    frames[[0, 1, 4, 5]] = 255  # a square wave's first harmonic is larger than its swing
    stack = FrameStack(frames=frames)
    assert stack_images(stack, FRINGES, decode(stack, FRINGES)).modulation.item() == 255


@pytest.mark.parametrize("window_px", [3, 9])
def test_windows_of_dots_are_what_numpy_finds_in_them(window_px):
    rng = np.random.default_rng(3)
    image = rng.choice([10, 11, 90, 200, 255], (23, 31), p=[0.4, 0.2, 0.1, 0.2, 0.1])
    image = image.astype(np.uint8)
    images = window_images(image, StereoLimits(window_px=window_px, min_texture=6.5))
    reach = window_px // 2
    windows = np.lib.stride_tricks.sliding_window_view(
        np.pad(image, reach, mode="reflect"), (window_px, window_px)
    ).reshape(*image.shape, -1)
    np.testing.assert_array_equal(images.mean, np.floor(windows.mean(axis=-1) + 0.5))
    eightieth = np.percentile(windows, 80, axis=-1, method="lower")
    np.testing.assert_array_equal(images.maximum, eightieth)
    assert np.abs(images.modulation - 2.0 * windows.std(axis=-1)).max() <= 0.5 + 1e-9
    assert images.min_modulation == 6.5
