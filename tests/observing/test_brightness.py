"""Grey values of a ring: closed forms, agreement with NumPy, and images of every depth."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from exposight.cell import Capture, Cloud
from exposight.geometry import RigidTransform
from exposight.observing import ring_brightness

ROUNDING = 1e-9
"""Sums of a few thousand grey values."""

STATISTICS = ("i_avg", "i_std", "i_median", "i_p05", "i_p95", "clipped_share")


@pytest.fixture
def grey_row(sensor, facing, make_capture, observe, hole):
    """Return a function that observes one hole on the axis in an image."""

    def row(image, **settings):
        (only,) = observe(sensor, hole(20.0), make_capture(sensor, facing, image=image, **settings))
        return only

    return row


@pytest.fixture
def size(sensor):
    return sensor.camera.height, sensor.camera.width


def statistics(row):
    return [getattr(row, name) for name in STATISTICS]


def test_an_even_image(grey_row, size):
    row = grey_row(np.full(size, 77, dtype=np.uint8))
    assert statistics(row) == pytest.approx([77, 0, 77, 77, 77, 0], abs=ROUNDING)


def test_a_gradient_has_the_mean_and_median_of_the_rings_centre(grey_row, size):
    # the ring is centred on column 320 and 67 px wide, where the image runs from 87 to 153
    gradient = np.clip(np.arange(size[1]) - 200, 0, 255).astype(np.uint8)
    row = grey_row(np.broadcast_to(gradient, size))
    assert (row.i_avg, row.i_median) == pytest.approx((120, 120), abs=ROUNDING)


def test_a_gradients_standard_deviation_is_that_of_a_thin_ring(grey_row, size):
    gradient = np.clip(np.arange(size[1]) - 200, 0, 255).astype(np.uint8)
    row = grey_row(np.broadcast_to(gradient, size))
    # over a ring from r₁ to r₂ the variance of x is (r₁² + r₂²) / 4
    inner_px, outer_px = 23 * 800 / 600, 25 * 800 / 600
    assert row.i_std == pytest.approx(np.sqrt((inner_px**2 + outer_px**2) / 4), rel=0.01)


def test_only_the_rings_pixels_count(grey_row, sensor, size):
    v, u = np.mgrid[: size[0], : size[1]]
    radius_mm = np.hypot(u - sensor.camera.cx, v - sensor.camera.cy) * 600 / sensor.camera.fx
    image = np.where((radius_mm >= 23) & (radius_mm <= 25), 200, 3).astype(np.uint8)
    assert grey_row(image).i_avg == pytest.approx(200, abs=ROUNDING)


def test_the_clipped_share_is_that_of_full_scale(grey_row, size):
    image = np.full(size, 254, dtype=np.uint8)
    image[:, 321:] = 255
    row = grey_row(image)
    # the ring's middle column lies left of the border and holds less than 2 % of it
    assert row.clipped_share == pytest.approx(0.5, abs=0.02)


@pytest.mark.parametrize(
    ("bit_depth", "per_step"), [(12, 273), (16, 17 * 257)], ids=["12 bits", "16 bits"]
)
def test_deeper_images_give_what_their_8_bit_equivalent_gives(grey_row, size, bit_depth, per_step):
    steps = np.random.default_rng(0).integers(0, 16, size)  # of 17 grey levels of 8 bits
    shallow = grey_row((17 * steps).astype(np.uint8))
    deep = grey_row((per_step * steps).astype(np.uint16), bit_depth=bit_depth)
    assert statistics(deep) == pytest.approx(statistics(shallow), abs=ROUNDING)


@given(
    seed=st.integers(0, 2**32 - 1), n=st.integers(1, 300), bit_depth=st.sampled_from([8, 12, 16])
)
@settings(max_examples=40, deadline=None)
def test_statistics_are_numpys(seed, n, bit_depth):
    rng = np.random.default_rng(seed)
    full_scale = 2**bit_depth - 1
    top = rng.integers(1, full_scale, endpoint=True)  # few levels, with ties, or many
    image = rng.integers(0, top, (40, 40), endpoint=True)
    image = image.astype(np.uint8 if bit_depth == 8 else np.uint16)
    capture = Capture(
        view="v1",
        exposure_ms=10.0,
        image=image,
        cloud=Cloud(points=np.zeros((1, 3))),
        camera_from_part=RigidTransform(),
        bit_depth=bit_depth,
    )
    rows, columns = np.divmod(rng.permutation(1600)[:n], 40)
    found = ring_brightness(capture, rows, columns)
    grey = image[rows, columns] * (255 / full_scale)
    p05, median, p95 = np.percentile(grey, [5, 50, 95])
    clipped = np.mean(image[rows, columns] == full_scale)
    assert [found[name] for name in STATISTICS] == pytest.approx(
        [grey.mean(), grey.std(), median, p05, p95, clipped], abs=ROUNDING
    )
