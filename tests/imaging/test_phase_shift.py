import numpy as np
import pytest

from exposight.imaging import (
    AxisCoding,
    DecodingLimits,
    FrameStack,
    Fringe,
    GrayCode,
    PatternSequence,
    PixelFlag,
    decode,
)

QUANTISED_PX = 2e-3  # 16-bit rounding: 1e-5 rad of a fringe of 64 px


def equal_steps(n):
    return [360.0 * k / n for k in range(n)]


def recorded(images, bit_depth=16):
    dtype = np.uint8 if bit_depth == 8 else np.uint16
    scale = 1.0 if bit_depth == 8 else 257.0
    images = np.rint(scale * np.concatenate(images)).astype(dtype)
    return FrameStack(frames=images, bit_depth=bit_depth)


def sequence_of(periods, n_steps, size=1024, bit_depth=16, gray_code=None, first=0):
    fringes = tuple(
        Fringe(periods=p, frames=tuple(range(first + i * n_steps, first + (i + 1) * n_steps)))
        for i, p in enumerate(periods)
    )
    return PatternSequence(
        name="test", projector_width=size, projector_height=8, bit_depth=bit_depth,
        columns=AxisCoding(fringes=fringes, gray_code=gray_code),
    )  # fmt: skip


@pytest.mark.parametrize(
    ("periods", "n_steps"),
    [((1, 16), 3), ((1, 8, 64), 4), ((1,), 3), ((1, 7), 5), ((1, 5, 21, 100), 3), ((0.5, 9), 8)],
)
def test_columns_are_found_across_the_projector(render_fringe, periods, n_steps):
    column = np.linspace(0, 1023, 3000).reshape(30, 100)
    images = [render_fringe(column, p, 1024, equal_steps(n_steps)) for p in periods]
    decoded = decode(recorded(images), sequence_of(periods, n_steps))
    tolerance = QUANTISED_PX * max(1.0, 16 / periods[-1])
    assert np.abs(decoded.column - column).max() < tolerance


def test_unequal_steps_and_ambient_light_do_not_move_a_column(render_fringe):
    column = np.linspace(0, 1023, 500).reshape(5, 100)
    shifts = (0.0, 50.0, 170.0, 181.0, 300.0)
    images = [render_fringe(column, p, 1024, shifts) for p in (1, 16)]
    fringes = tuple(
        Fringe(periods=p, frames=tuple(range(5 * i, 5 * i + 5)), shifts_deg=shifts)
        for i, p in enumerate((1, 16))
    )
    sequence = PatternSequence(
        name="test", projector_width=1024, projector_height=8, bit_depth=16,
        columns=AxisCoding(fringes=fringes),
    )  # fmt: skip
    for gain, ambient in ((1.0, 0.0), (0.4, 60.0)):
        stack = recorded([gain * image + ambient for image in images])
        assert np.abs(decode(stack, sequence).column - column).max() < 3 * QUANTISED_PX / gain


def test_columns_beside_the_border_do_not_jump_across(render_fringe):
    column = np.linspace(-0.45, 1023.45, 1000).reshape(1, -1)
    images = [render_fringe(column, p, 1024, equal_steps(3)) for p in (1, 16)]
    decoded = decode(recorded(images), sequence_of((1, 16), 3))
    assert np.abs(decoded.column - column).max() < QUANTISED_PX


def test_fringes_within_a_gray_code(render_gray, render_fringe):
    # Four bits of 100 px; fringes of 100 and 66.7 px, whose beat of 200 px bridges the code.
    size = 1500
    column = np.random.default_rng(2).uniform(0, size - 1, (30, 40))
    bits = render_gray(column, 4, code_width=100)
    images = [bits, 220 - bits]
    images += [render_fringe(column, p, size, equal_steps(3)) for p in (15, 22.5)]
    gray = GrayCode(frames=(0, 1, 2, 3), inverse_frames=(4, 5, 6, 7), code_width=100)
    decoded = decode(recorded(images), sequence_of((15, 22.5), 3, size, gray_code=gray, first=8))
    assert np.abs(decoded.column - column).max() < QUANTISED_PX


def test_clipped_sample_has_no_column(render_fringe):
    column = np.full((1, 2), 500.0)
    images = np.array([render_fringe(column, 1, 1024, equal_steps(3))])
    images[0, 1, 0, 0] = 255.0
    decoded = decode(recorded(images, 8), sequence_of((1,), 3, bit_depth=8))
    assert decoded.flagged(PixelFlag.CLIPPED).tolist() == [[True, False]]
    assert np.isnan(decoded.column).tolist() == [[True, False]]


def test_low_modulation_has_no_column(render_fringe):
    images = [
        np.concatenate([
            render_fringe(np.full((1, 1), 500.0), 1, 1024, equal_steps(3), amplitude=a)
            for a in (9.5, 10.5)
        ], axis=2)
    ]  # fmt: skip
    decoded = decode(recorded(images), sequence_of((1,), 3))
    assert decoded.flagged(PixelFlag.LOW_MODULATION).tolist() == [[True, False]]
    assert np.isnan(decoded.column).tolist() == [[True, False]]
    assert decoded.modulation[0] == pytest.approx([9.5, 10.5], abs=0.01)


def test_disagreeing_phases_are_ambiguous(render_fringe):
    column, wrong = np.full((1, 2), 500.0), np.array([[500.0, 500.0 + 0.45 * 64]])
    images = [
        render_fringe(wrong, 1, 1024, equal_steps(3)),
        render_fringe(column, 16, 1024, equal_steps(3)),
    ]
    decoded = decode(recorded(images), sequence_of((1, 16), 3))
    assert decoded.flagged(PixelFlag.AMBIGUOUS).tolist() == [[False, True]]
    assert decoded.column[0, 0] == pytest.approx(500.0, abs=QUANTISED_PX)
    assert np.isnan(decoded.column[0, 1])


def test_residual_limit_is_the_callers(render_fringe):
    wrong = np.full((1, 1), 500.0 + 0.45 * 64)
    images = [
        render_fringe(wrong, 1, 1024, equal_steps(3)),
        render_fringe(np.full((1, 1), 500.0), 16, 1024, equal_steps(3)),
    ]
    decoded = decode(recorded(images), sequence_of((1, 16), 3), DecodingLimits(max_residual=0.5))
    assert decoded.column[0, 0] == pytest.approx(500.0, abs=QUANTISED_PX)
