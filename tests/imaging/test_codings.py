"""Codings that scanners use beside the plain ones, each recorded and decoded."""

from dataclasses import replace

import numpy as np
import pytest

from exposight.errors import ContradictionError
from exposight.imaging import (
    AxisCoding,
    FrameStack,
    Fringe,
    GrayCode,
    PatternSequence,
    PixelFlag,
    decode,
)

SIZE = 256


def sequence_of(coding, **settings):
    return PatternSequence(
        **{
            "name": "test", "projector_width": SIZE, "projector_height": 64, "columns": coding,
            **settings,
        }
    )  # fmt: skip


def recorded(sequence, column, *, noise=0.0, blur_px=0.0, seed=1, row=None):
    """Frames as a camera takes them that sees projector coordinates, fringes and slides alike."""
    rng = np.random.default_rng(seed)
    frames = np.zeros((sequence.n_frames, *column.shape))
    offsets = np.linspace(-0.5, 0.5, 9) * blur_px if blur_px else np.zeros(1)
    for frame, lit in sequence.slides().items():
        along = column if lit.shape[0] == 1 else row
        line = lit.ravel()
        places = [np.rint(along + offset).astype(int).clip(0, line.size - 1) for offset in offsets]
        frames[frame] = np.mean([line[place] for place in places], axis=0)
    for axis, coding, size in sequence.axes():
        along = column if axis == "columns" else row
        for fringe in coding.fringes:
            for frame, shift in zip(fringe.frames, coding.shown_deg(fringe, size), strict=True):
                phase = 2 * np.pi * fringe.periods * along / size - np.radians(shift)
                frames[frame] = 0.5 + 0.4 * np.cos(phase)
    grey = 20 + 180 * frames + rng.normal(0, noise, frames.shape)
    return FrameStack(frames=np.rint(grey).clip(0, 255).astype(np.uint8))


def ramp(start=10.0, stop=240.0, n=900):
    return np.tile(np.linspace(start, stop, n), (3, 1))


@pytest.mark.parametrize("periods", [(64, 63, 56), (59, 70, 64), (8, 9), (24.5, 25.1, 28)])
def test_fringes_whose_beats_are_absolute(periods):
    fringes = tuple(
        Fringe(periods=count, frames=tuple(range(4 * i, 4 * i + 4)))
        for i, count in enumerate(periods)
    )
    sequence = sequence_of(AxisCoding(fringes=fringes), projector_width=1024)
    column = ramp(3, 1020)
    decoded = decode(recorded(sequence, column, noise=1.0), sequence)
    assert decoded.valid.all()
    assert np.abs(decoded.column - column).max() < 0.05 * 1024 / max(periods)


def test_every_step_and_every_fringe_is_held_against_the_others():
    fringes = tuple(
        Fringe(periods=count, frames=tuple(range(4 * i, 4 * i + 4)))
        for i, count in enumerate((64, 63, 56))
    )
    sequence = sequence_of(AxisCoding(fringes=fringes), projector_width=1024)
    stack = recorded(sequence, ramp(3, 1020))
    backwards = stack.frames[[0, 1, 2, 3, 4, 5, 6, 7, 8, 11, 10, 9]]  # 56 runs the other way
    with pytest.raises(ContradictionError, match=r"fringe of 56 periods .* run the other way"):
        decode(FrameStack(frames=backwards), sequence)
    decoded = decode(FrameStack(frames=backwards), sequence, despite=["fringe-order"])
    # Three phases of one coordinate leave two residuals, of which 0.8 each are within ±0.4.
    assert decoded.flagged(PixelFlag.AMBIGUOUS).mean() == pytest.approx(1 - 0.8**2, abs=0.06)


@pytest.mark.parametrize("code", ["gray", "binary"])
def test_codes_centred_on_the_projector(code):
    gray = GrayCode(frames=tuple(range(2, 11)), code=code, first_code=(512 - SIZE) // 2)
    sequence = sequence_of(AxisCoding(gray_code=gray), white_frame=0, black_frame=1)
    column = np.arange(SIZE, dtype=float).repeat(2)[None]
    decoded = decode(recorded(sequence, column), sequence)
    assert np.abs(decoded.column - column).max() <= 0.5
    plain = replace(sequence, columns=AxisCoding(gray_code=replace(gray, first_code=0)))
    shifted = decode(recorded(sequence, column), plain, checked=False)
    assert np.nanmedian(shifted.column - column) == pytest.approx(128, abs=0.5)


def test_a_code_before_the_first_is_outside():
    gray = GrayCode(frames=tuple(range(2, 11)), first_code=128)
    sequence = sequence_of(AxisCoding(gray_code=gray), white_frame=0, black_frame=1)
    early = sequence_of(
        AxisCoding(gray_code=replace(gray, first_code=100)), white_frame=0, black_frame=1
    )
    decoded = decode(recorded(early, np.full((1, 3), 5.0)), sequence)
    assert decoded.flagged(PixelFlag.OUTSIDE).all()


def test_plain_binary_is_read_and_located():
    gray = GrayCode(frames=tuple(range(2, 10)), code="binary")
    sequence = sequence_of(AxisCoding(gray_code=gray), white_frame=0, black_frame=1)
    column = ramp(20.0, 200.0, 1800)
    decoded = decode(recorded(sequence, column, blur_px=0.5), sequence)
    read = decoded.valid
    assert read.mean() > 0.9
    assert np.abs(decoded.column - column)[read].max() < 0.6
    with_gray = replace(sequence, columns=AxisCoding(gray_code=replace(gray, code="gray")))
    other = decode(recorded(sequence, column), with_gray, checked=False)
    assert np.nanmedian(np.abs(other.column - column)) > 5


WIDE = Fringe(periods=16, frames=(0, 1, 2, 3))  # a period is 16 px


@pytest.mark.parametrize("start", [16.0, 20.0, 24.0, 28.0])
def test_complementary_code_leaves_no_pixel_a_period_off(start):
    gray = GrayCode(frames=(4, 5, 6, 7), code_width=16, complementary_frame=8)
    sequence = sequence_of(AxisCoding(gray_code=gray, fringes=(WIDE,)))
    # Short runs that begin and end within codes, with soft edges and noise.
    column = start + np.random.default_rng(2).uniform(0, 8, (200, 1)) + np.linspace(0, 9, 30)
    stack = recorded(sequence, column, noise=2.0, blur_px=5.0)
    decoded = decode(stack, sequence)
    assert decoded.valid.mean() > 0.98
    assert np.nanmax(np.abs(decoded.column - column)) < 1.0
    plain = replace(gray, complementary_frame=None)
    alone = replace(
        sequence, columns=AxisCoding(gray_code=plain, fringes=(WIDE,)), unused_frames=(8,)
    )
    assert decode(stack, alone).valid.mean() < decoded.valid.mean()


def test_a_pixel_of_which_the_code_does_not_know_the_period_is_ambiguous():
    gray = GrayCode(frames=(4, 5, 6, 7), code_width=16)
    sequence = sequence_of(AxisCoding(gray_code=gray, fringes=(WIDE,)))
    column = np.linspace(32.0, 47.0, 16)[None]  # one code from edge to edge, without its edges
    stack = recorded(sequence, column)
    decided = decode(stack, sequence)
    assert decided.valid.all()
    assert np.abs(decided.column - column).max() < 0.1
    # Stripes out of focus: where a bit is weak the pixel may belong to the next code.
    frames = stack.frames.astype(float)
    middle = frames[0:4].mean(axis=0)[:, [0, 1, -1]]
    frames[7, :, [0, 1, -1]] = (0.8 * middle + 0.2 * frames[7][:, [0, 1, -1]]).T
    soft = decode(replace(stack, frames=np.rint(frames).astype(np.uint8)), sequence)
    near_an_edge = np.minimum(column - 31.5, 47.5 - column) < 0.1 * 16 - 0.2
    assert soft.flagged(PixelFlag.AMBIGUOUS)[near_an_edge].all()
    assert np.nanmax(np.abs(soft.column - column)) < 0.1
    assert soft.valid.sum() >= 12


def test_fringe_and_code_that_contradict_each_other_are_flagged():
    gray = GrayCode(frames=(4, 5, 6, 7), code_width=16)
    shown = sequence_of(AxisCoding(gray_code=gray, fringes=(replace(WIDE, reversed=True),)))
    told = sequence_of(AxisCoding(gray_code=gray, fringes=(WIDE,)))
    stack = recorded(shown, ramp())
    assert decode(stack, shown).valid.mean() > 0.95
    unchecked = decode(stack, told, checked=False)
    assert unchecked.flagged(PixelFlag.AMBIGUOUS).mean() == pytest.approx(0.2, abs=0.05)


def test_reversed_steps_are_negative_shifts():
    shifts = (0.0, 70.0, 190.0)
    back = Fringe(periods=1, frames=(0, 1, 2), shifts_deg=shifts, reversed=True)
    negative = Fringe(periods=1, frames=(0, 1, 2), shifts_deg=tuple(-s for s in shifts))
    maps = [
        decode(recorded(sequence_of(AxisCoding(fringes=(back,))), ramp()), sequence_of(coding))
        for coding in (AxisCoding(fringes=(back,)), AxisCoding(fringes=(negative,)))
    ]
    assert np.array_equal(maps[0].column, maps[1].column)
    assert np.abs(maps[0].column - ramp()).max() < 1.0


@pytest.mark.parametrize("kind", ["gray", "fringes", "both"])
def test_a_mirrored_projector(kind):
    gray = GrayCode(frames=tuple(range(6, 14)), inverse_frames=tuple(range(14, 22)))
    fringes = (
        Fringe(periods=1, frames=(0, 1, 2)),
        Fringe(periods=7.5, frames=(3, 4, 5), shifts_deg=(10, 100, 230)),
    )
    coding = AxisCoding(
        gray_code=None if kind == "fringes" else gray,
        fringes=() if kind == "gray" else fringes,
        mirrored=True,
    )
    sequence = sequence_of(coding)
    decoded = decode(recorded(sequence, ramp()), sequence)
    assert np.nanmax(np.abs(decoded.column - ramp())) < 0.7
    assert decoded.valid.mean() > 0.99
    plain = sequence_of(replace(coding, mirrored=False))
    backwards = decode(recorded(sequence, ramp()), plain).column
    assert np.nanmax(np.abs(backwards - (SIZE - 1 - ramp()))) < 0.7


@pytest.mark.parametrize("axis", ["the same axis", "the other axis"])
def test_code_thresholded_by_the_fringes_mean(axis):
    albedo = 0.5 + 0.5 * np.random.default_rng(3).random((3, 900))
    gray = GrayCode(frames=(4, 5, 6, 7), code_width=16)
    row = np.broadcast_to(np.array([[10.0], [30.0], [50.0]]), albedo.shape)
    if axis == "the same axis":
        sequence = sequence_of(AxisCoding(gray_code=gray, fringes=(WIDE,)))
    else:
        one = Fringe(periods=1, frames=(0, 1, 2, 3), shifts_deg=(0, 80, 160, 270))
        sequence = sequence_of(
            AxisCoding(gray_code=gray), rows=AxisCoding(fringes=(one,)), white_frame=None
        )
    stack = recorded(sequence, ramp(), row=row)
    dim = FrameStack(frames=np.rint(stack.frames * albedo).astype(np.uint8))
    decoded = decode(dim, sequence)
    assert decoded.valid.mean() > 0.95
    worst = np.nanmax(np.abs(decoded.column - ramp()))
    assert worst < (0.3 if axis == "the same axis" else 8.1)
    if axis == "the other axis":
        assert sequence.finest_frames == (0, 1, 2, 3)
        assert np.nanmax(np.abs(decoded.row - row)) < 1


@pytest.mark.parametrize("steps", [3, 4])
def test_a_projectors_gamma_is_corrected(steps):
    fringes = tuple(
        Fringe(periods=count, frames=tuple(range(steps * i, steps * (i + 1))))
        for i, count in enumerate((1, 8))
    )
    sequence = sequence_of(AxisCoding(fringes=fringes), projector_gamma=2.2, bit_depth=16)
    shown = np.array(
        [
            0.5 + 0.5 * np.cos(2 * np.pi * f.periods * ramp() / SIZE - np.radians(shift))
            for f in fringes
            for shift in f.shifts_deg
        ]
    )
    stack = FrameStack(frames=np.rint(3000 + 50000 * shown**2.2).astype(np.uint16), bit_depth=16)
    decoded = decode(stack, sequence)
    assert np.abs(decoded.column - ramp()).max() < 0.01
    if steps == 3:
        bent = decode(stack, replace(sequence, projector_gamma=1.0), checked=False)
        assert np.nanmax(np.abs(bent.column - ramp())) > 0.3
