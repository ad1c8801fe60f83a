import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from exposight.errors import ImageError
from exposight.imaging import FrameStack, re_expose


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
