"""Stripe codes of neighbouring pixels, and against the projector."""

import re

import numpy as np
import pytest

from exposight.contradictions.codes import (
    Reading,
    check_bits,
    check_coverage,
    check_exchanged,
    check_neighbours,
    read_codes,
)

_BITS = 10
_ORDER = tuple(range(_BITS))


def _words(codes, *, binary=False, order=_ORDER, inverted=False):
    """Return words of bits as they come when `codes` are shown in this way."""
    shown = codes if binary else codes ^ (codes >> 1)
    bits = [(shown >> (_BITS - 1 - place)) & 1 for place in range(_BITS)]
    word = np.zeros_like(codes)
    for place in order:
        word = 2 * word + (bits[place] ^ int(inverted))
    return word


@pytest.fixture
def codes():
    """A tilted plane with a step, 32 rows × 300 columns, codes 100 to 800."""
    u = np.arange(300)
    row = 100 + (2.0 * u).astype(int) + 100 * (u > 140)
    return np.tile(row, (32, 1)) + np.arange(32)[:, None] // 16


@pytest.mark.parametrize("binary", [False, True])
def test_codes_are_read_back(codes, binary):
    words = _words(codes, binary=binary)
    np.testing.assert_array_equal(read_codes(words, Reading(_ORDER, binary)), codes)


@pytest.mark.parametrize("binary", [False, True])
def test_codes_that_follow_each_other_have_no_contradiction(codes, binary):
    words = _words(codes, binary=binary)
    assert check_neighbours(words, Reading(_ORDER, binary), _ORDER, "columns") is None


@pytest.mark.parametrize(
    ("shown", "explanation"),
    [
        ({"order": _ORDER[::-1]}, "finest bit first"),
        ({"inverted": True}, "exchanged"),
        ({"binary": True}, "plain binary, not Gray"),
        ({"order": (0, 1, 2, 3, 7, 5, 6, 4, 8, 9)}, "frames 4 and 7 change places"),
    ],
)
def test_another_reading_that_fits_is_named(codes, shown, explanation):
    found = check_neighbours(_words(codes, **shown), Reading(_ORDER), _ORDER, "columns")
    assert found.is_error
    assert explanation in found.explanation


def test_codes_at_random_are_an_error(codes):
    words = np.random.default_rng(0).integers(0, 1 << _BITS, codes.shape)
    found = check_neighbours(words, Reading(_ORDER), _ORDER, "columns")
    assert found.is_error
    assert "at random" in found.found


def test_codes_beyond_the_projector_are_an_error_that_names_the_offset(codes):
    found = check_coverage(_words(codes), Reading(_ORDER), 750, 0, "columns")
    assert found.is_error
    low, high = map(int, re.findall(r"first_code of (\d+) to (\d+)", found.explanation)[0])
    assert (low, high) == (pytest.approx(50, abs=4), pytest.approx(100, abs=4))
    assert "centred" not in found.explanation  # (1024 − 750) / 2 = 137 is not among them
    assert check_coverage(_words(codes), Reading(_ORDER), 900, 0, "columns") is None


def test_a_first_code_that_nobody_said_is_asked_for_unless_the_frames_tell(codes):
    found = check_coverage(_words(codes), Reading(_ORDER), 900, None, "columns")
    assert found.is_error
    assert "first_code = 62" in found.explanation
    assert check_coverage(_words(codes - 90), Reading(_ORDER), 900, None, "columns") is None
    assert check_coverage(_words(codes), Reading(_ORDER), 1024, None, "columns") is None


_CODES = np.tile(np.arange(900).repeat(2), (40, 1))


def _with_bits(change):
    """Return words of ten bits, most significant first, whose bits (10, …) were changed."""
    words = _words(_CODES)
    bits = [(words >> (9 - place)) & 1 for place in range(10)]
    changed = change(bits)
    return sum(bit << (9 - place) for place, bit in enumerate(changed))


@pytest.mark.parametrize("place", [4, 5, 6])
def test_one_frame_that_is_inverted(place):
    words = _with_bits(lambda bits: [*bits[:place], 1 - bits[place], *bits[place + 1 :]])
    found = check_neighbours(words, Reading(_ORDER), _ORDER, "columns")
    assert found.is_error
    assert f"exchanged in frame {place} alone" in found.explanation


@pytest.mark.parametrize("place", [3, 5, 9])
def test_a_white_frame_among_the_bits(place):
    words = _with_bits(lambda bits: [*bits[:place], 0 * bits[0] + 1, *bits[place + 1 :]])
    assert f"frame {place} is the same everywhere" in check_bits(words, _ORDER, "columns").found


def test_a_frame_given_twice():
    words = _with_bits(lambda bits: [*bits[:5], bits[4], *bits[6:]])
    assert "frames 4 and 5 show the same" in check_bits(words, _ORDER, "columns").found


@pytest.mark.parametrize("window", [slice(0, 900), slice(300, 620), slice(500, 530)])
def test_bits_of_a_part_of_the_projector(window):
    words = _words(np.tile(np.arange(900)[window].repeat(6), (8, 1)))
    assert check_bits(words, _ORDER, "columns") is None


def test_white_and_black_exchanged():
    white = np.full(1000, 180.0)
    assert check_exchanged(white, white - 160, 20.0) is None
    assert check_exchanged(white, white + 1, 20.0) is None
    found = check_exchanged(white - 160, white, 20.0)
    assert "exchanged" in found.explanation
