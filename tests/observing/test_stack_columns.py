"""What a ring tells beyond one image: closed forms of hand-made stacks, and NumPy's percentiles."""

from dataclasses import replace

import numpy as np
import pytest

from exposight.cell import StackImages
from exposight.observing import ring_brightness

PERCENTS = (5, 25, 50, 75, 95)
PIXELS = np.divmod(np.arange(101), 16)
"""The first 101 pixels of rows of 16: percentiles fall on pixels."""


def columns(stem):
    return [f"{stem}_p{percent:02d}" for percent in PERCENTS]


def ramp(first, step, dtype=np.uint8):
    return (first + step * np.arange(112)).astype(dtype).reshape(7, 16)


@pytest.fixture
def capture(sensor, facing, make_capture):
    """A ramp of brightness whose swing falls as the maximum rises."""
    return replace(
        make_capture(sensor, facing),
        image=ramp(50, 1),
        brightness_source="stripes-mean",
        stack=StackImages(
            maximum=ramp(155, 1, np.int64).clip(0, 255).astype(np.uint8),
            modulation=ramp(200, -1),
            min_modulation=60.0,
        ),
    )


def test_percentiles_of_ramps(capture):
    ring = ring_brightness(capture, *PIXELS)
    assert ring["i_mean"] == 100
    assert [ring[name] for name in columns("i_mean")] == [55, 75, 100, 125, 145]
    assert [ring[name] for name in columns("i_max")] == [160, 180, 205, 230, 250]
    # The swing runs from 200 down to 100, and the amplitude is half of it.
    assert [ring[name] for name in columns("i_mod")] == [52.5, 62.5, 75, 87.5, 97.5]
    assert ring["stack_clipped_share"] == 1 / 101  # the last pixel is at 255
    assert ring["low_modulation_share"] == 20 / 101  # swings from 100 to 119


def test_what_is_not_known_is_left_out(capture):
    stack = replace(capture.stack, min_modulation=None)
    ring = ring_brightness(replace(capture, stack=stack, brightness_source="stripe"), *PIXELS)
    assert not {"i_mean", "i_mean_p50", "low_modulation_share"} & ring.keys()
    assert ring["i_max_p50"] == 205
    alone = ring_brightness(replace(capture, stack=None, brightness_source="dots"), *PIXELS)
    assert not {"i_mean", "i_max_p50", "stack_clipped_share"} & alone.keys()
    texture = ring_brightness(replace(capture, stack=None, brightness_source="texture"), *PIXELS)
    assert (texture["i_mean"], texture["i_mean_p05"]) == (100, 55)
    assert "i_max_p50" not in texture


def test_the_stacks_own_mean_goes_before_the_image(capture):
    for source in ("stripe", "texture", "dots"):
        stack = replace(capture.stack, mean=ramp(20, 1))
        ring = ring_brightness(replace(capture, stack=stack, brightness_source=source), *PIXELS)
        assert (ring["i_avg"], ring["i_mean"], ring["i_mean_p95"]) == (100, 70, 115)


@pytest.mark.parametrize("bit_depth", [8, 10, 12, 16])
@pytest.mark.parametrize("n", [1, 2, 7, 90])
def test_percentiles_are_numpys_at_every_bit_depth(capture, bit_depth, n):
    rng = np.random.default_rng(n)
    top = 2**bit_depth - 1
    dtype = np.uint8 if bit_depth == 8 else np.uint16
    images = rng.integers(0, top, (3, 7, 16), endpoint=True).astype(dtype)
    images[1, :2] = top
    deep = replace(
        capture,
        image=images[0],
        bit_depth=bit_depth,
        stack=StackImages(maximum=images[1], modulation=images[2], min_modulation=30.0),
    )
    rows, places = np.divmod(rng.permutation(112)[:n], 16)
    ring = ring_brightness(deep, rows, places)
    grey = images[:, rows, places] * (255 / top)
    for stem, levels, factor in zip(("i_mean", "i_max", "i_mod"), grey, (1, 1, 0.5), strict=True):
        expected = factor * np.percentile(levels, PERCENTS)
        assert [ring[name] for name in columns(stem)] == pytest.approx(expected, abs=1e-9)
    assert ring["i_mean"] == pytest.approx(ring["i_avg"], abs=1e-9)
    assert ring["stack_clipped_share"] == np.mean(images[1, rows, places] == top)
    assert ring["low_modulation_share"] == np.mean(grey[2] / 2 < 30.0)


def test_a_row_of_the_table_has_them(sensor, facing, make_capture, observe, hole):
    size = (sensor.camera.height, sensor.camera.width)
    of = lambda level: np.full(size, level, dtype=np.uint8)  # noqa: E731
    stack = StackImages(mean=of(90), maximum=of(255), modulation=of(61), min_modulation=31.0)
    capture = make_capture(sensor, facing, stack=stack)
    (row,) = observe(sensor, hole(20.0), capture)
    assert (row.brightness_source, row.i_avg, row.i_mean) == ("stripe", 100, 90)
    assert (row.i_max_p05, row.i_mod_p95) == (255, 30.5)
    assert (row.stack_clipped_share, row.low_modulation_share) == (1, 1)
