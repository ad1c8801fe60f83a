"""Grey levels against their bit depth, and a colour camera's mosaic in a grey image."""

import numpy as np
import pytest

from exposight.contradictions.greys import check_greys

_ROWS, _COLUMNS = 128, 160


def _light(seed=0, spread=0.02):
    """A smooth scene, 0.1 to 1.3 of what reaches full scale, with noise."""
    v, u = np.mgrid[0:_ROWS, 0:_COLUMNS]
    smooth = 0.1 + 0.6 * u / _COLUMNS + 0.6 * np.exp(-((u - 100) ** 2 + (v - 60) ** 2) / 600)
    rng = np.random.default_rng(seed)
    return smooth + rng.normal(0, spread, smooth.shape)


def _image(full_scale, light=None):
    light = _light() if light is None else light
    return np.clip(np.rint(light * full_scale), 0, full_scale).astype(np.uint16)


def _found(image, full_scale):
    return {each.check: each for each in check_greys(image, full_scale)}


@pytest.mark.parametrize("full_scale", [1023, 4095, 65535])
def test_an_image_that_is_what_it_is_said_to_be_has_no_contradiction(full_scale):
    assert not _found(_image(full_scale), full_scale)
    assert not _found(_image(full_scale, 0.3 * _light()), full_scale)


@pytest.mark.parametrize(("bits", "said"), [(10, 12), (10, 16), (12, 16), (14, 16)])
def test_clipping_at_the_full_scale_of_fewer_bits_is_an_error_that_names_them(bits, said):
    found = _found(_image(2**bits - 1), 2**said - 1)["saturation-spike"]
    assert found.is_error
    assert f"a bit depth of {bits}" in found.explanation


def test_clipping_at_another_level_is_a_warning_that_names_it():
    image = np.minimum(_image(255), 240).astype(np.uint8)
    found = _found(image, 255)["saturation-spike"]
    assert not found.is_error
    assert "saturation_level = 240" in found.explanation


def test_a_flat_bright_surface_is_no_clipping():
    light = np.where(_light() > 0.5, 0.8, 0.2)
    light = light + np.random.default_rng(1).normal(0, 0.01, light.shape)
    assert not _found(_image(255, light), 255)


def test_an_8_bit_image_scaled_to_10_bits_and_said_to_be_12_is_an_error():
    scaled = np.rint(_image(255, 0.5 * _light()) * (1023 / 255)).astype(np.uint16)
    assert not _found(scaled, 1023)
    for said in (4095, 65535):
        found = _found(scaled, said)["grey-levels"]
        assert found.is_error
        assert "a bit depth of 10" in found.explanation


def test_levels_in_the_high_bits_are_an_error_where_they_clip():
    shifted = (_image(1023) << 6).astype(np.uint16)
    found = _found(shifted, 65535)
    assert any(each.is_error for each in found.values())
    assert all("high" in each.explanation for each in found.values())
    dark = _found((_image(1023, 0.4 * _light()) << 6).astype(np.uint16), 65535)
    assert not dark["grey-levels"].is_error


def test_levels_far_below_full_scale_are_a_warning():
    found = _found(_image(1023, 0.7 * _light(spread=0.004)), 65535)["grey-levels"]
    assert not found.is_error
    assert "10 bits" in found.explanation


@pytest.mark.parametrize(
    ("sites", "pattern"),
    [([[1.0, 0.45], [0.45, 0.1]], "RGGB"), ([[0.6, 0.9], [0.5, 0.6]], "GRBG")],
)
def test_a_raw_mosaic_is_an_error_that_names_its_pattern(sites, pattern):
    mosaic = np.tile(sites, (_ROWS // 2, _COLUMNS // 2))
    found = _found(_image(255, 0.7 * _light() * mosaic).astype(np.uint8), 255)["mosaic"]
    assert found.is_error
    assert pattern in found.explanation


@pytest.mark.parametrize("axis", [0, 1])
def test_stripes_and_amplifiers_of_columns_are_no_mosaic(axis):
    stripes = np.expand_dims(np.where(np.arange(_ROWS) % 2, 1.0, 0.4), 1 - axis)
    light = 0.7 * _light()[:, :_ROWS] * stripes
    assert "mosaic" not in _found(_image(255, light).astype(np.uint8), 255)


def test_scaled_levels_tell_nothing_of_the_camera():
    image = np.rint(_image(255, 0.5 * _light()) * 4.0).astype(np.uint16)
    assert not list(check_greys(image, 4095, scaled=True))
