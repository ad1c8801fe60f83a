import numpy as np
import pytest

from exposight.imaging import (
    AxisCoding,
    DecodingLimits,
    FrameStack,
    GrayCode,
    PatternSequence,
    PixelFlag,
    decode,
)

N_BITS = 8


def sequence_of(*, inverse=True, code_width=1, **changes):
    frames = tuple(range(2, 2 + N_BITS))
    coding = GrayCode(
        frames=frames,
        inverse_frames=tuple(range(10, 18)) if inverse else (),
        code_width=code_width,
    )
    settings = {
        "name": "test", "projector_width": 256 * code_width, "projector_height": 8,
        "columns": AxisCoding(gray_code=coding), "white_frame": 0, "black_frame": 1,
    }  # fmt: skip
    return PatternSequence(**{**settings, **changes})


def stack_of(bits, *, inverse=True, black=10.0, white=210.0, bit_depth=8):
    """Frames white, black, bits, inverse bits."""
    flat = np.ones((1, *bits.shape[1:]))
    parts = [white * flat, black * flat, bits] + ([white + black - bits] if inverse else [])
    dtype = np.uint8 if bit_depth == 8 else np.uint16
    return FrameStack(frames=np.rint(np.concatenate(parts)).astype(dtype), bit_depth=bit_depth)


@pytest.mark.parametrize("inverse", [True, False], ids=["inverse frames", "white and black"])
@pytest.mark.parametrize("code_width", [1, 2])
def test_hard_edges_decode_to_the_right_code(render_gray, inverse, code_width):
    coordinate = np.random.default_rng(1).integers(0, 256 * code_width, (20, 30)).astype(float)
    bits = render_gray(coordinate, N_BITS, code_width=code_width)
    decoded = decode(
        stack_of(bits, inverse=inverse),
        sequence_of(inverse=inverse, code_width=code_width),
        checked=False,  # codes at random
    )
    # Between neighbours a code apart, hard edges lie anywhere: half a pixel of a code, no more.
    assert np.abs(decoded.column - coordinate).max() <= 0.5 * code_width


def test_code_width_two_gives_the_codes_centre(render_gray):
    coordinate = np.array([[100.0, 100.0, 100.0]])  # no edge in sight
    decoded = decode(
        stack_of(render_gray(coordinate, N_BITS, code_width=2)), sequence_of(code_width=2)
    )
    assert decoded.column.tolist() == [[100.5, 100.5, 100.5]]


@pytest.mark.parametrize("along", ["rows", "columns"])
@pytest.mark.parametrize("inverse", [True, False], ids=["inverse frames", "white and black"])
def test_edges_are_located_between_pixels(render_gray, along, inverse):
    # 0.23 projector px per camera px; edges blurred over one projector pixel.
    ramp = np.tile(20.0 + 0.23 * np.arange(200), (5, 1))
    coordinate = ramp if along == "rows" else ramp.T
    decoded = decode(
        stack_of(render_gray(coordinate, N_BITS, blur_px=1.0), inverse=inverse),
        sequence_of(inverse=inverse),
    )
    error = (
        np.abs(decoded.column - coordinate)[2:-2, 6:-6]
        if along == "rows"
        else np.abs(decoded.column - coordinate)[6:-6, 2:-2]
    )
    assert error.max() < 5e-3  # rounding to grey levels: 1/200 of the blur's width


def test_falling_coordinates_are_located_too(render_gray):
    coordinate = np.tile(90.0 - 0.23 * np.arange(200), (2, 1))
    decoded = decode(stack_of(render_gray(coordinate, N_BITS, blur_px=1.0)), sequence_of())
    assert np.abs(decoded.column - coordinate)[:, 6:-6].max() < 5e-3


def test_depth_step_is_not_smoothed(render_gray):
    coordinate = np.concatenate([np.full((1, 20), 40.0), np.full((1, 20), 120.0)], axis=1)
    decoded = decode(stack_of(render_gray(coordinate, N_BITS)), sequence_of())
    assert np.array_equal(decoded.column, coordinate)


def test_brightness_and_ambient_light_do_not_matter(render_gray):
    coordinate = np.tile(20.0 + 0.23 * np.arange(200), (2, 1))
    maps = [
        decode(
            stack_of(
                render_gray(coordinate, N_BITS, blur_px=1.0, black=black, white=white),
                black=black, white=white, bit_depth=16,
            ),
            sequence_of(bit_depth=16),
        ).column
        for black, white in ((0.0, 20000.0), (9000.0, 59000.0))
    ]  # fmt: skip
    assert np.allclose(maps[0], maps[1], atol=1e-3)  # grey levels are rounded


def test_dark_pixel_has_no_column(render_gray):
    bits = render_gray(np.full((1, 2), 5.0), N_BITS, black=10, white=29)
    decoded = decode(stack_of(bits, white=29), sequence_of())
    assert np.isnan(decoded.column).all()
    assert decoded.flagged(PixelFlag.LOW_MODULATION).all()
    assert decoded.modulation == pytest.approx(9.5)


def test_modulation_counts_on_the_scale_of_8_bits(render_gray):
    white = 10 + 20 * 65535 / 255  # half the difference is 10 of 255 grey levels
    bits = render_gray(np.full((1, 2), 5.0), N_BITS, white=white)
    decoded = decode(stack_of(bits, white=white, bit_depth=16), sequence_of(bit_depth=16))
    assert decoded.valid.all()
    assert decoded.modulation == pytest.approx(10.0)


def test_clipped_pixel_is_marked_and_kept(render_gray):
    coordinate = np.full((1, 2), 77.0)
    decoded = decode(
        stack_of(render_gray(coordinate, N_BITS, white=255.0), white=255.0), sequence_of()
    )
    assert decoded.flagged(PixelFlag.CLIPPED).all()
    assert np.array_equal(decoded.column, coordinate)


def test_two_undecided_bits_are_ambiguous(render_gray):
    bits = render_gray(np.full((1, 3), 77.0), N_BITS)
    bits[3, 0, 0] = 110.0
    bits[[3, 5], 0, 1] = 110.0
    decoded = decode(stack_of(bits), sequence_of())
    assert decoded.flagged(PixelFlag.AMBIGUOUS).tolist() == [[False, True, False]]
    assert np.isfinite(decoded.column).tolist() == [[True, False, True]]


def test_code_beyond_the_projector_is_outside(render_gray):
    decoded = decode(
        stack_of(render_gray(np.array([[199.0, 200.0]]), N_BITS)),
        sequence_of(projector_width=200),
    )
    assert decoded.flagged(PixelFlag.OUTSIDE).tolist() == [[False, True]]
    assert np.isfinite(decoded.column).tolist() == [[True, False]]


def test_contrast_without_white_and_black(render_gray):
    coordinate = np.array([[3.0, 200.0]])
    stack = stack_of(render_gray(coordinate, N_BITS))
    sequence = sequence_of(white_frame=None, black_frame=None)
    decoded = decode(stack, sequence, DecodingLimits(min_modulation=99))
    assert np.array_equal(decoded.column, coordinate)
    assert decoded.modulation == pytest.approx(100.0)
