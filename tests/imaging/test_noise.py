"""Standard deviations of depth: closed forms, and what noise really does."""

from dataclasses import replace

import numpy as np
import pytest

from exposight.errors import ImageError
from exposight.imaging import (
    AxisCoding,
    FrameStack,
    Fringe,
    GrayCode,
    GreyNoise,
    PatternSequence,
    decode,
    noise_of_frames,
    recorded_sigma_z,
    triangulate,
    why_no_sigma,
    with_sigma_z,
)

MEAN, AMPLITUDE = 100.0, 60.0


def sequence_of(*, steps=4, shifts=(), rows=False, periods=16):
    def axis(first):
        return AxisCoding(
            fringes=tuple(
                Fringe(periods=p, frames=tuple(range(i, i + steps)), shifts_deg=shifts)
                for p, i in ((1, first), (periods, first + steps))
            )
        )

    return PatternSequence(
        name="test", projector_width=256, projector_height=192, bit_depth=16,
        columns=axis(0), rows=axis(2 * steps) if rows else None,
    )  # fmt: skip


def frames_of(scene, sequence, variance=lambda grey: 0.0 * grey, rng=None, gamma=1.0):
    """Frames of 16 bits; noise of a variance that depends on the grey level, 0–255."""
    images = np.zeros((sequence.n_frames, *scene.column.shape))
    for axis, coding, size in sequence.axes():
        coordinate = scene.column if axis == "columns" else scene.row
        for fringe in coding.fringes:
            phase = 2.0 * np.pi * fringe.periods * coordinate / size
            for frame, shift in zip(fringe.frames, fringe.shifts_deg, strict=True):
                images[frame] = MEAN + AMPLITUDE * np.cos(phase - np.radians(shift))
    images = 255.0 * (images / 255.0) ** gamma
    if rng is not None:
        images = images + np.sqrt(variance(images)) * rng.standard_normal(images.shape)
    return FrameStack(frames=np.rint(257.0 * images).astype(np.uint16), bit_depth=16)


def poses(scene):
    return {"projector": scene.projector, "projector_from_camera": scene.projector_from_camera}


@pytest.mark.parametrize(
    ("steps", "shifts", "rows"),
    [(4, (), False), (3, (), False), (5, (0.0, 50.0, 170.0, 181.0, 300.0), False), (4, (), True)],
    ids=["four steps", "three steps", "unequal steps", "columns and rows"],
)
def test_sigma_z_is_what_noise_does_to_depth(scene, steps, shifts, rows):
    sequence = sequence_of(steps=steps, shifts=shifts, rows=rows)

    def variance(grey):
        return 0.05 + 0.01 * grey

    rng = np.random.default_rng(1)
    clean = frames_of(scene, sequence)
    cloud = triangulate(decode(clean, sequence), camera=scene.camera, **poses(scene))
    noise = GreyNoise(dark=0.05, gain=0.01)
    predicted = with_sigma_z(cloud, clean, sequence, noise, **poses(scene)).sigma_z_mm
    np.testing.assert_array_equal(np.isnan(predicted), ~cloud.valid)
    noisy = decode(frames_of(scene, sequence, variance, rng), sequence)
    depth = triangulate(noisy, camera=scene.camera, **poses(scene)).points[..., 2]
    ratio = (depth - cloud.points[..., 2]) / predicted
    assert np.isfinite(ratio).mean() > 0.9
    # 12 000 pixels: a standard deviation is known to 0.7 %
    assert np.nanstd(ratio) == pytest.approx(1.0, abs=0.03)
    assert np.nanmean(ratio) == pytest.approx(0.0, abs=0.03)


def test_equal_steps_follow_the_formula(scene):
    """σ_φ = √(2/N)·σ_I/B, through the finest fringe to the projector's column."""
    sequence = sequence_of(steps=6)
    stack = frames_of(scene, sequence)
    cloud = triangulate(decode(stack, sequence), camera=scene.camera, **poses(scene))
    sigma = with_sigma_z(cloud, stack, sequence, GreyNoise(dark=4.0), **poses(scene)).sigma_z_mm
    column_px = np.sqrt(2 / 6) * 2.0 / AMPLITUDE * 256 / (2 * np.pi * 16)
    points = cloud.points.astype(np.float64)
    step = 1e-4
    ahead, behind = (
        scene.projector.project(scene.projector_from_camera.apply(points * (1 + s)))[..., 0]
        for s in (step, -step)
    )
    slope = np.abs(ahead - behind) / (2 * step * points[..., 2])
    np.testing.assert_allclose(sigma[cloud.valid], (column_px / slope)[cloud.valid], rtol=2e-3)


@pytest.mark.parametrize("gamma", [1.0, 1.5])
@pytest.mark.parametrize("steps", [4, 5, 8])
def test_noise_is_found_from_the_frames_whatever_harmonics_they_have(scene, steps, gamma):
    sequence = sequence_of(steps=steps)

    def variance(grey):
        return 0.2 + 0.01 * grey

    stack = frames_of(scene, sequence, variance, np.random.default_rng(2), gamma)
    noise = noise_of_frames(stack, sequence, decode(stack, sequence))
    level = 255.0 * (MEAN / 255.0) ** gamma
    assert noise.source == "recording"
    assert noise.at(level) == pytest.approx(np.sqrt(variance(level)), rel=0.05)
    if gamma == 1.0:
        assert noise.systematic < 0.1 * noise.at(level)
        assert not noise.remark
    elif steps == 4:  # the second harmonic
        assert noise.systematic > 3.0 * noise.at(level)
        assert "no pure sines" in noise.remark


def test_variance_rises_with_the_grey_level(scene):
    sequence = sequence_of(steps=8)

    def variance(grey):
        return 0.1 + 0.02 * grey

    stack = frames_of(scene, sequence, variance, np.random.default_rng(3))
    rng = np.random.default_rng(4)
    clean = 0.3 * frames_of(scene, sequence).frames[:, :48] / 257.0
    dark = clean + np.sqrt(variance(clean)) * rng.standard_normal(clean.shape)
    frames = stack.frames.copy()
    frames[:, :48] = np.rint(257.0 * np.maximum(dark, 0.0)).astype(np.uint16)
    stack = FrameStack(frames=frames, bit_depth=16)
    noise = noise_of_frames(stack, sequence, decode(stack, sequence))
    assert noise.gain == pytest.approx(0.02, rel=0.1)
    assert noise.at(30.0) == pytest.approx(np.sqrt(variance(30.0)), rel=0.05)
    assert noise.at(100.0) == pytest.approx(np.sqrt(variance(100.0)), rel=0.05)


def test_three_steps_and_few_pixels_tell_no_noise(scene):
    three = sequence_of(steps=3)
    stack = frames_of(scene, three)
    assert noise_of_frames(stack, three, decode(stack, three)) is None
    four = sequence_of(steps=4)
    small = FrameStack(frames=frames_of(scene, four).frames[:, :10, :50], bit_depth=16)
    assert noise_of_frames(small, four, decode(small, four)) is None


def test_rounding_is_added_to_a_known_noise():
    assert GreyNoise.given(1.0, 8).at(100.0) == pytest.approx(np.sqrt(1.0 + 1.0 / 12.0))
    assert GreyNoise.given(1.0, 16).at(100.0) == pytest.approx(1.0, abs=1e-5)
    with pytest.raises(ImageError, match=r"grey_noise must be .* above 0 .* got 0"):
        GreyNoise.given(0.0, 8)


def test_gray_code_alone_has_no_sigma(scene):
    gray = AxisCoding(gray_code=GrayCode(frames=tuple(range(2, 10))))
    sequence = replace(sequence_of(), columns=gray, white_frame=0, black_frame=1)
    assert not why_no_sigma(sequence_of())
    assert "columns are coded by Gray code alone" in why_no_sigma(sequence)
    stack = FrameStack(frames=np.zeros((10, 96, 120), np.uint16), bit_depth=16)
    cloud = triangulate(decode(stack, sequence), camera=scene.camera, **poses(scene))
    with pytest.raises(ImageError, match="no sigma_z: the columns"):
        with_sigma_z(cloud, stack, sequence, GreyNoise(dark=1.0), **poses(scene))


def test_noise_of_recorded_levels_goes_through_the_cameras_response(scene):
    sequence = replace(sequence_of(), camera_gamma=1.8)
    straight = frames_of(scene, sequence_of(), gamma=1 / 1.8)
    rng = np.random.default_rng(6)
    noisy = np.rint(straight.frames + 257.0 * rng.standard_normal(straight.frames.shape))
    clean, noisy = (
        FrameStack(frames=f.astype(np.uint16), bit_depth=16, response=sequence.response())
        for f in (straight.frames, noisy)
    )
    cloud, other = (
        triangulate(decode(stack, sequence), camera=scene.camera, **poses(scene))
        for stack in (clean, noisy)
    )
    given, _ = recorded_sigma_z(
        cloud, clean, sequence, decode(clean, sequence), grey_noise=1.0, **poses(scene)
    )
    ratio = (other.points[..., 2] - cloud.points[..., 2]) / given.sigma_z_mm
    assert np.nanstd(ratio) == pytest.approx(1.0, abs=0.03)
    found, remark = recorded_sigma_z(
        other, noisy, sequence, decode(noisy, sequence), **poses(scene)
    )
    ratio = found.sigma_z_mm / given.sigma_z_mm
    assert np.nanmedian(ratio) == pytest.approx(1.0, abs=0.1)
    assert not remark


def test_three_steps_need_the_noise_from_the_sequence_or_the_caller(scene):
    sequence = sequence_of(steps=3)
    stack = frames_of(scene, sequence)
    decoded = decode(stack, sequence)
    cloud = triangulate(decoded, camera=scene.camera, **poses(scene))
    same, why = recorded_sigma_z(cloud, stack, sequence, decoded, **poses(scene))
    assert same.sigma_z_mm is None
    assert "give its standard deviation" in why
    said = replace(sequence, grey_noise=1.5)
    known, why = recorded_sigma_z(cloud, stack, said, decoded, **poses(scene))
    given, _ = recorded_sigma_z(cloud, stack, sequence, decoded, grey_noise=1.5, **poses(scene))
    assert not why
    np.testing.assert_array_equal(known.sigma_z_mm, given.sigma_z_mm)
