"""Frames against their sequence: each kind of trouble is named, and right recordings are not."""

from dataclasses import replace

import numpy as np
import pytest

from exposight.cli.decode import decode_command
from exposight.errors import ContradictionError, InputError
from exposight.imaging import AxisCoding, FrameStack, Fringe, GrayCode, PatternSequence, decode

_WIDTH, _BITS, _PERIOD = 512, 7, 64.0
_SHAPE = (96, 320)


def _column():
    """(rows, columns) px: a tilted plane with a step of 40 px."""
    v, u = np.mgrid[0 : _SHAPE[0], 0 : _SHAPE[1]]
    return 20.0 + 1.25 * u + 0.1 * v + 40.0 * ((u > 120) & (u < 200))


def _sequence(n=4, **fringe):
    """White, black, seven bits of 4 px, and a fringe of n steps."""
    first = 2 + _BITS
    return PatternSequence(
        name="test",
        projector_width=_WIDTH,
        projector_height=400,
        columns=AxisCoding(
            gray_code=GrayCode(frames=tuple(range(2, first)), code_width=4),
            fringes=(
                Fringe(periods=_WIDTH / _PERIOD, frames=tuple(range(first, first + n)), **fringe),
            ),
        ),
        white_frame=0,
        black_frame=1,
    )


def _frames(n=4, *, sign=1, gamma=1.0, noise=1.0, axis=0):
    column = _column()
    code = np.floor((column + 0.5) / 4).astype(int)
    gray = code ^ (code >> 1)
    lit = [np.ones(_SHAPE), np.zeros(_SHAPE)]
    lit += [((gray >> (_BITS - 1 - b)) & 1).astype(float) for b in range(_BITS)]
    phase = sign * 2 * np.pi * column / _PERIOD
    lit += [(0.5 + 0.48 * np.cos(phase - 2 * np.pi * k / n)) ** gamma for k in range(n)]
    grey = 12 + 180 * np.stack(lit) + np.random.default_rng(3).normal(0, noise, (len(lit), *_SHAPE))
    return np.clip(np.rint(grey), 0, 255).astype(np.uint8)


def _names(frames, sequence):
    try:
        found = decode(FrameStack(frames=frames), sequence).contradictions
    except ContradictionError as error:
        found = error.contradictions
    return {each.check for each in found}


@pytest.mark.parametrize("n", [3, 4])
@pytest.mark.parametrize("noise", [0.0, 1.0, 3.0])
def test_a_right_recording_has_no_contradiction(n, noise):
    assert not _names(_frames(n, noise=noise), _sequence(n))


@pytest.mark.parametrize("n", [3, 4])
def test_steps_that_run_the_other_way_are_an_error(n):
    with pytest.raises(ContradictionError, match="run the other way"):
        decode(FrameStack(frames=_frames(n, sign=-1)), _sequence(n))
    shifts = tuple(-360.0 * k / n for k in range(n))
    assert not _names(_frames(n, sign=-1), _sequence(n, shifts_deg=shifts))


def test_bits_given_finest_first_are_an_error_that_can_be_accepted():
    sequence = _sequence()
    bits = replace(sequence.columns.gray_code, frames=sequence.columns.gray_code.frames[::-1])
    wrong = replace(sequence, columns=AxisCoding(gray_code=bits))
    stack = FrameStack(frames=_frames()[: 2 + _BITS])
    with pytest.raises(ContradictionError, match="finest bit first"):
        decode(stack, wrong)
    (kept,) = decode(stack, wrong, despite=["neighbouring-codes"]).contradictions
    assert kept.check == "neighbouring-codes"
    assert not decode(stack, wrong, checked=False).contradictions


def test_codes_along_the_images_columns_are_checked_too():
    turned = _frames(sign=-1).transpose(0, 2, 1)
    assert _names(turned, _sequence()) == {"fringe-order"}


def test_gamma_is_named():
    assert _names(_frames(4, gamma=2.2), _sequence(4)) == {"fringe-steps"}


def test_a_check_that_there_is_not_is_refused(tmp_path):
    with pytest.raises(InputError, match="fringe-order"):
        decode_command(
            tmp_path, calibration=tmp_path / "c.yml", sequence="board", despite=("fringe-ordre",)
        )
