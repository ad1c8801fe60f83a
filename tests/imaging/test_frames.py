import re

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from exposight.cell import right_aligned
from exposight.errors import ImageError, MissingFileError
from exposight.imaging import FrameStack, re_expose, read_frames
from exposight.imaging.response import light_of_levels


def write(folder, name, image):
    path = folder / name
    assert cv2.imwrite(str(path), image)
    return path


@pytest.fixture
def recording(tmp_path):
    """Three frames whose alphabetical order is not their natural order."""
    for number in (2, 10, 1):
        write(tmp_path, f"frame_{number}.png", np.full((4, 6), number, dtype=np.uint8))
    return tmp_path


def test_frames_come_in_natural_order(recording):
    assert read_frames(recording).frames[:, 0, 0].tolist() == [1, 2, 10]


def test_listed_files_keep_their_order(recording):
    paths = [recording / "frame_10.png", recording / "frame_1.png"]
    assert read_frames(paths).frames[:, 0, 0].tolist() == [10, 1]


def test_exposure_and_depth_are_kept(recording):
    stack = read_frames(recording, exposure_ms=12.5)
    assert (stack.exposure_ms, stack.bit_depth, stack.full_scale, stack.emulated) == (
        12.5, 8, 255, False,
    )  # fmt: skip


@pytest.mark.parametrize(("bit_depth", "level"), [(12, 4095), (16, 65535)])
def test_deeper_images_are_read_where_the_stack_says_so(tmp_path, bit_depth, level):
    write(tmp_path, "a.png", np.full((4, 6), level, dtype=np.uint16))
    stack = read_frames(tmp_path, bit_depth=bit_depth)
    assert stack.frames.dtype == np.uint16
    assert stack.full_scale == level == stack.frames.max()


def test_missing_folder_is_named(tmp_path):
    with pytest.raises(MissingFileError, match=r"nowhere: expected a folder of frames, found none"):
        read_frames(tmp_path / "nowhere")


def test_missing_frame_is_named(recording):
    with pytest.raises(MissingFileError, match=r"frame_3\.png: no such frame"):
        read_frames([recording / "frame_1.png", recording / "frame_3.png"])


def test_pattern_without_match(recording):
    with pytest.raises(MissingFileError, match=r"no frame matches '\*\.bmp'"):
        read_frames(recording, pattern="*.bmp")


def test_frames_that_lie_a_folder_deeper_are_named(recording):
    for folder in ("skull_gray", "skull_2x3"):
        (recording / folder).mkdir()
        write(recording / folder, "a.bmp", np.zeros((4, 6), dtype=np.uint8))
    message = r"matches '\*\.bmp'; there are some in its folders skull_2x3, skull_gray: give one"
    with pytest.raises(MissingFileError, match=message):
        read_frames(recording, pattern="*.bmp")


def test_no_paths():
    with pytest.raises(MissingFileError, match="at least one frame is needed"):
        read_frames([])


def test_wrong_count_says_which_numbers_are_skipped(recording):
    write(recording, "frame_4.png", np.zeros((4, 6), dtype=np.uint8))
    message = r"expected 5 frames, found 4; the numbering skips 3, 5, 6, 7, 8, 9; check"
    with pytest.raises(ImageError, match=message):
        read_frames(recording, count=5)


def test_truncated_frame_is_named(recording):
    path = recording / "frame_2.png"
    path.write_bytes(path.read_bytes()[:40])
    with pytest.raises(ImageError, match=r"frame_2\.png: cannot be read .* truncated"):
        read_frames(recording)


def test_other_size_says_expected_and_got(recording):
    write(recording, "frame_2.png", np.zeros((4, 7), dtype=np.uint8))
    with pytest.raises(ImageError, match=r"frame_2\.png: expected 4 rows × 6 columns .* got 4 × 7"):
        read_frames(recording)


def test_16_bits_where_8_are_expected(recording):
    write(recording, "frame_2.png", np.zeros((4, 6), dtype=np.uint16))
    with pytest.raises(ImageError, match=r"frame_2\.png: expected 8 bits in uint8, got uint16"):
        read_frames(recording)


def test_8_bits_where_12_are_expected(recording):
    with pytest.raises(ImageError, match=r"frame_1\.png: expected 12 bits .* got uint8"):
        read_frames(recording, bit_depth=12)


def test_three_equal_channels_are_grey(recording):
    write(recording, "frame_2.png", np.full((4, 6, 3), 7, dtype=np.uint8))
    assert read_frames(recording).frames[1].tolist() == np.full((4, 6), 7).tolist()


def test_one_channel_of_colour_is_read_where_it_is_named(tmp_path):
    blue_green_red = np.dstack([np.full((4, 6), level, np.uint8) for level in (10, 20, 30)])
    write(tmp_path, "a.png", blue_green_red)
    with pytest.raises(ImageError, match=r'a\.png: .* got 3 different channels; .*channel = "red"'):
        read_frames(tmp_path)
    for channel, level in (("blue", 10), ("green", 20), ("red", 30)):
        assert (read_frames(tmp_path, channel=channel).frames == level).all()


def test_a_channel_of_a_grey_image(recording):
    with pytest.raises(ImageError, match=r"channel 'red' of a grey image; leave out"):
        read_frames(recording, channel="red")


@pytest.mark.parametrize("bit_depth", range(9, 17))
@pytest.mark.parametrize("fill", ["zero", "repeated"])
def test_grey_levels_in_the_high_bits(tmp_path, bit_depth, fill):
    levels = np.linspace(0, 2**bit_depth - 1, 24).astype(np.uint16).reshape(4, 6)
    written = levels << (16 - bit_depth)
    if fill == "repeated":
        written |= levels >> (2 * bit_depth - 16)
    write(tmp_path, "a.png", written)
    stack = read_frames(tmp_path, bit_depth=bit_depth, alignment="high")
    assert np.array_equal(stack.frames[0], levels)


def test_eight_bits_in_the_high_bits_of_16(tmp_path):
    write(tmp_path, "a.png", np.full((4, 6), 200 << 8, dtype=np.uint16))
    frames = read_frames(tmp_path, alignment="high").frames
    assert frames.dtype == np.uint8
    assert (frames == 200).all()


def test_low_bits_in_use_contradict_grey_levels_in_the_high_bits(tmp_path):
    write(tmp_path, "a.png", np.full((4, 6), (1000 << 4) + 4, dtype=np.uint16))
    with pytest.raises(ImageError, match=r"a\.png: of 12 bits in the high .* but bit 2 is used"):
        read_frames(tmp_path, bit_depth=12, alignment="high")


def test_high_bits_of_8():
    with pytest.raises(ImageError, match="high bits need an image of uint16, got uint8"):
        right_aligned(np.zeros((2, 2), np.uint8), 8, "image")


def test_an_extension_in_capitals_matches(tmp_path):
    write(tmp_path, "IMG_1.BMP", np.zeros((4, 6), dtype=np.uint8))
    write(tmp_path, "IMG_2.bmp", np.zeros((4, 6), dtype=np.uint8))
    assert read_frames(tmp_path, pattern="IMG_*.bmp").n_frames == 2


def test_too_many_frames_may_be_named(recording):
    with pytest.raises(ImageError, match=r"expected 2 frames, found 3; .* unused_frames"):
        read_frames(recording, count=2)


def test_12_bits_in_the_high_bits_are_noticed(tmp_path):
    write(tmp_path, "a.png", np.full((4, 6), 4096, dtype=np.uint16))
    with pytest.raises(ImageError, match=r"a\.png: grey levels of 12 bits go up to 4095, got 4096"):
        read_frames(tmp_path, bit_depth=12)


def test_unknown_bit_depth(recording):
    with pytest.raises(ImageError, match="a bit depth must be a whole number from 8 to 16, got 17"):
        read_frames(recording, bit_depth=17)


@pytest.mark.parametrize(
    ("frames", "bit_depth", "message"),
    [
        (np.zeros((4, 6), np.uint8), 8, "frames must have shape (n, rows, columns)"),
        (np.zeros((0, 4, 6), np.uint8), 8, "none of them 0, got (0, 4, 6)"),
        (np.zeros((1, 4, 6)), 8, "frames: expected 8 bits in uint8, got float64"),
        (np.zeros((1, 4, 6), np.uint16), 8, "frames: expected 8 bits in uint8, got uint16"),
        (np.full((1, 4, 6), 5000, np.uint16), 12, "go up to 4095, got 5000"),
        (
            np.zeros((1, 4, 6), np.uint8),
            7,
            "a bit depth must be a whole number from 8 to 16, got 7",
        ),
    ],
)
def test_stack_checks_its_frames(frames, bit_depth, message):
    with pytest.raises(ImageError, match=re.escape(message)):
        FrameStack(frames=frames, bit_depth=bit_depth)


@pytest.mark.parametrize("level", [0, 256])
def test_stack_checks_its_saturation_level(level):
    with pytest.raises(ImageError, match=f"must be from 1 to 255, .* got {level}"):
        FrameStack(frames=np.zeros((1, 2, 2), np.uint8), saturation_level=level)


def test_stack_checks_its_response():
    with pytest.raises(ImageError, match="of 8 bits must be 256 rising numbers"):
        FrameStack(frames=np.zeros((1, 2, 2), np.uint8), response=np.zeros(256))


@pytest.mark.parametrize("exposure_ms", [0.0, -1.0, np.nan, np.inf])
def test_stack_checks_its_exposure(exposure_ms):
    with pytest.raises(ImageError, match="an exposure time must be above 0 ms"):
        FrameStack(frames=np.zeros((1, 2, 2), np.uint8), exposure_ms=exposure_ms)


def test_stack_is_read_only():
    stack = FrameStack(frames=np.zeros((1, 2, 2), np.uint8))
    with pytest.raises(ValueError, match="read-only"):
        stack.frames[0, 0, 0] = 1


def stack_of(*levels, **settings):
    dtype = np.uint8 if settings.get("bit_depth", 8) == 8 else np.uint16
    return FrameStack(frames=np.array([[levels]], dtype=dtype), **settings)


def test_levels_are_scaled_rounded_and_clipped():
    # 2.5 is halfway and goes to the even neighbour.
    assert re_expose(stack_of(0, 1, 101, 200), 2.5).frames.ravel().tolist() == [0, 2, 252, 255]


def test_full_scale_is_the_stacks():
    stack = stack_of(100, 3000, bit_depth=12)
    assert re_expose(stack, 2.0).frames.ravel().tolist() == [200, 4095]


def test_a_longer_exposure_ends_where_the_sensor_saturates():
    stack = stack_of(100, 300, 900, bit_depth=10, saturation_level=940)
    assert re_expose(stack, 5.0).frames.ravel().tolist() == [500, 940, 940]


def test_light_is_scaled_where_the_response_is_known():
    # A camera whose grey levels are the square root of light, at 1 and 2.5 times the exposure.
    light = np.linspace(1.0, 25.0, 100)
    recorded, expected = (
        np.rint(255 * np.sqrt(np.minimum(light * factor / 50, 1.0))) for factor in (1.0, 2.5)
    )
    curve = light_of_levels(8, gamma=2.0)
    straight = re_expose(stack_of(*recorded), 2.5)
    bent = re_expose(stack_of(*recorded, response=curve), 2.5)
    assert np.abs(straight.frames.ravel() - expected).max() > 50
    assert np.abs(bent.frames.ravel() - expected).max() <= 2  # roundings: 0.5·√2.5 and 0.5
    assert bent.emulated


def test_result_is_labelled_emulated():
    assert re_expose(stack_of(7), 1.0).emulated


def test_exposure_time_is_scaled():
    assert re_expose(stack_of(7, exposure_ms=10.0), 0.3).exposure_ms == pytest.approx(3.0)


def test_unknown_exposure_time_stays_unknown():
    assert re_expose(stack_of(7), 0.3).exposure_ms is None


@pytest.mark.parametrize("factor", [0.0, -1.0, np.nan, np.inf])
def test_bad_factor(factor):
    with pytest.raises(ImageError, match="a factor on the exposure time must be above 0"):
        re_expose(stack_of(7), factor)


@given(factor=st.floats(0.01, 100.0), more=st.floats(1.0, 10.0))
def test_longer_is_never_darker(factor, more):
    stack = stack_of(*range(256))
    shorter, longer = re_expose(stack, factor), re_expose(stack, factor * more)
    assert (longer.frames >= shorter.frames).all()


def test_factor_one_changes_nothing():
    stack = stack_of(*range(256))
    assert np.array_equal(re_expose(stack, 1.0).frames, stack.frames)
