import re

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from exposight.errors import ImageError, MissingFileError
from exposight.imaging import FrameStack, re_expose, read_frames


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


def test_colour_is_refused_even_with_equal_channels(recording):
    write(recording, "frame_2.png", np.full((4, 6, 3), 7, dtype=np.uint8))
    with pytest.raises(ImageError, match=r"frame_2\.png: expected a 8-bit grey .* got 3 channels"):
        read_frames(recording)


def test_12_bits_in_the_high_bits_are_noticed(tmp_path):
    write(tmp_path, "a.png", np.full((4, 6), 4096, dtype=np.uint16))
    with pytest.raises(ImageError, match=r"a\.png: grey levels of 12 bits go up to 4095, got 4096"):
        read_frames(tmp_path, bit_depth=12)


def test_unknown_bit_depth(recording):
    with pytest.raises(ImageError, match="a bit depth must be 8, 10, 12 or 16, got 14"):
        read_frames(recording, bit_depth=14)


@pytest.mark.parametrize(
    ("frames", "bit_depth", "message"),
    [
        (np.zeros((4, 6), np.uint8), 8, "frames must have shape (n, rows, columns)"),
        (np.zeros((0, 4, 6), np.uint8), 8, "none of them 0, got (0, 4, 6)"),
        (np.zeros((1, 4, 6)), 8, "frames: expected 8 bits in uint8, got float64"),
        (np.zeros((1, 4, 6), np.uint16), 8, "frames: expected 8 bits in uint8, got uint16"),
        (np.full((1, 4, 6), 5000, np.uint16), 12, "go up to 4095, got 5000"),
        (np.zeros((1, 4, 6), np.uint8), 9, "a bit depth must be 8, 10, 12 or 16, got 9"),
    ],
)
def test_stack_checks_its_frames(frames, bit_depth, message):
    with pytest.raises(ImageError, match=re.escape(message)):
        FrameStack(frames=frames, bit_depth=bit_depth)


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
