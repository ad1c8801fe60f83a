"""A sequence from the frames alone: what was projected is found, in whatever order."""

import cv2
import numpy as np
import pytest

from exposight.errors import ImageError, MissingFileError
from exposight.imaging import FrameStack, read_sequence, sequence_to_toml
from exposight.imaging.guessing import guess_sequence
from exposight.imaging.unknown_recording import read_unknown_recording

_SIZE = (512, 384)
_SHAPE = (120, 320)
_SHUFFLED = (3, 0, 6, 1, 5, 2, 4)


def _coordinates():
    """(rows, columns) px of the projector: a tilted plane with a box before it."""
    v, u = np.mgrid[0 : _SHAPE[0], 0 : _SHAPE[1]].astype(float)
    box = (u > 120) & (u < 200) & (v > 30) & (v < 90)
    return 30 + 1.3 * u + 0.1 * v + 40 * box, 20 + 2.2 * v + 0.05 * u


class _Recording:
    """Frames one after the other, with noise, on a scene of varying albedo."""

    def __init__(self, noise=1.5):
        self.frames = []
        self.rng = np.random.default_rng(5)
        v, u = np.mgrid[0 : _SHAPE[0], 0 : _SHAPE[1]]
        self.albedo = 0.6 + 0.3 * np.sin(u / 50.0) * np.cos(v / 30.0)
        self.noise = noise

    def add(self, lit):
        """Take a frame of light from 0 to 1 and return its number."""
        grey = 15 + 190 * self.albedo * lit + self.rng.normal(0, self.noise, _SHAPE)
        self.frames.append(np.clip(np.rint(grey), 0, 255).astype(np.uint8))
        return len(self.frames) - 1

    def flat(self, light):
        return self.add(np.full(_SHAPE, float(light)))

    def bits(self, axis, n, width, *, order=None, inverses="", binary=False):
        """Add bits, coarse to fine or in another order; return frames of bits and inverses."""
        code = np.floor((_coordinates()[axis] + 0.5) / width).astype(int)
        shown = code if binary else code ^ (code >> 1)
        frames, inverse_frames = {}, {}
        for b in order or range(n):
            bit = ((shown >> (n - 1 - b)) & 1).astype(float)
            if inverses == "first":
                inverse_frames[b] = self.add(1 - bit)
            frames[b] = self.add(bit)
            if inverses == "after":
                inverse_frames[b] = self.add(1 - bit)
        coarse_first = sorted(frames)
        return (
            tuple(frames[b] for b in coarse_first),
            tuple(inverse_frames[b] for b in coarse_first if inverse_frames),
        )

    def fringe(self, axis, periods, n, *, sign=1):
        phase = 2 * np.pi * periods * _coordinates()[axis] / _SIZE[axis]
        return tuple(
            self.add(0.5 + 0.45 * np.cos(phase - sign * 2 * np.pi * k / n)) for k in range(n)
        )

    def guess(self):
        return guess_sequence(FrameStack(frames=np.stack(self.frames)), projector_size=_SIZE)


@pytest.mark.parametrize("binary", [False, True], ids=["Gray", "binary"])
@pytest.mark.parametrize("inverses", ["", "first", "after"])
@pytest.mark.parametrize("order", ["coarse first", "fine first", "shuffled"])
@pytest.mark.parametrize("axis", [0, 1], ids=["columns", "rows"])
def test_bits_in_any_order_are_found(inverses, order, binary, axis):
    if binary and inverses == "first":
        pytest.skip("plain binary and its inverse mirror each other: frames cannot tell them apart")
    recording = _Recording()
    orders = {
        "coarse first": None,
        "fine first": range(6, -1, -1),
        "shuffled": (3, 0, 6, 1, 5, 2, 4),
    }
    if not inverses:
        white, black = recording.flat(1), recording.flat(0)
    frames, inverse_frames = recording.bits(
        axis, 7, 4 - axis, order=orders[order], inverses=inverses, binary=binary
    )
    sequence = recording.guess().sequence
    code = (sequence.columns, sequence.rows)[axis].gray_code
    assert (code.frames, code.inverse_frames) == (frames, inverse_frames)
    assert code.code_width == 4 - axis
    assert code.code == ("binary" if binary else "gray")
    if not inverses:
        assert (sequence.white_frame, sequence.black_frame) == (white, black)


@pytest.mark.parametrize("n", [3, 4, 5])
@pytest.mark.parametrize("fine_first", [False, True])
def test_fringes_without_a_code_are_found(n, fine_first):
    recording = _Recording()
    periods = (12, 1) if fine_first else (1, 12)
    frames = {each: recording.fringe(0, each, n) for each in periods}
    coarse, fine = recording.guess().sequence.columns.fringes
    assert (coarse.periods, coarse.frames) == (1, frames[1])
    assert (fine.periods, fine.frames) == (12, frames[12])
    assert fine.shifts_deg == tuple(360.0 * k / n for k in range(n))


@pytest.mark.parametrize("periods", [(64, 63, 56), (56, 64, 63), (70, 64, 59)])
@pytest.mark.parametrize("axis", [0, 1], ids=["columns", "rows"])
def test_fringes_of_which_none_has_one_period_tell_each_other_apart(periods, axis):
    recording = _Recording()
    frames = {each: recording.fringe(axis, each, 4) for each in periods}
    sequence = recording.guess().sequence
    coding = (sequence.columns, sequence.rows)[axis]
    assert (sequence.columns, sequence.rows)[1 - axis] is None
    assert [fringe.periods for fringe in coding.fringes] == sorted(periods)
    for fringe in coding.fringes:
        assert fringe.frames == frames[fringe.periods]
        assert fringe.shifts_deg == (0, 90, 180, 270)


def test_fringes_that_all_repeat_together_are_refused():
    recording = _Recording()
    for each in (64, 56, 48):
        recording.fringe(0, each, 4)
    with pytest.raises(ImageError, match=r"no beat .* say in a sequence's file how many periods"):
        recording.guess()


def test_a_coarsest_fringe_is_not_said_to_be_sure():
    recording = _Recording()
    for each in (1, 12):
        recording.fringe(0, each, 4)
    coarse, fine = (each for each in recording.guess().findings if "fringe" in each.what)
    assert coarse.sure is None
    assert "assumption" in coarse.why
    assert fine.sure > 0.95


def test_whole_numbers_are_found_where_even_the_coarsest_beat_in_view_is_not_one_period():
    recording = _Recording(noise=0.5)
    for each in (12, 7):  # the beat of 5 periods: all that a sixth of the projector shows
        recording.fringe(0, each, 4)
    stack = FrameStack(frames=np.stack(recording.frames)[:, :, 220:280])
    coarse, fine = guess_sequence(stack, projector_size=_SIZE).sequence.columns.fringes
    assert (coarse.periods, fine.periods) == (7, 12)
    assert coarse.shifts_deg == fine.shifts_deg == (0, 90, 180, 270)


@pytest.mark.parametrize("n", [3, 4, 5])
@pytest.mark.parametrize("sign", [1, -1])
def test_a_fringe_gets_periods_and_direction_from_the_code(n, sign):
    recording = _Recording()
    steps = recording.fringe(0, 16, n, sign=sign)
    bits, _ = recording.bits(0, 5, 16)
    white, black = recording.flat(1), recording.flat(0)
    sequence = recording.guess().sequence
    assert (sequence.white_frame, sequence.black_frame) == (white, black)
    assert sequence.columns.gray_code.frames == bits
    (fringe,) = sequence.columns.fringes
    assert (fringe.periods, fringe.frames) == (16, steps)
    turn = (np.array(fringe.shifts_deg) - sign * 360.0 * np.arange(n) / n) % 360
    np.testing.assert_allclose(np.minimum(turn, 360 - turn), 0, atol=1)


def test_columns_and_rows_are_told_apart(tmp_path):
    recording = _Recording()
    columns = recording.bits(0, 7, 4, inverses="after")
    rows = recording.bits(1, 7, 3, inverses="after")
    steps = recording.fringe(1, 24, 4)
    guess = recording.guess()
    sequence = guess.sequence
    assert sequence.columns.gray_code.frames == columns[0]
    assert not sequence.columns.fringes
    assert sequence.rows.gray_code.inverse_frames == rows[1]
    assert sequence.rows.fringes[0].frames == steps
    assert {each.what for each in guess.findings if each.sure is None} >= {"mirrored or turned"}
    path = tmp_path / "sequence.toml"
    path.write_text(sequence_to_toml(sequence), encoding="utf-8")
    assert read_sequence(path) == sequence


def test_frames_that_show_no_pattern_are_refused():
    frames = np.random.default_rng(0).normal(100, 2, (6, *_SHAPE)).astype(np.uint8)
    with pytest.raises(ImageError, match="no pattern"):
        guess_sequence(FrameStack(frames=frames))


def test_frames_are_the_largest_group_of_a_folder_and_tell_their_bits(tmp_path):
    levels = np.arange(40 * 50, dtype=np.uint16).reshape(40, 50) % 1024
    for i in range(3):
        cv2.imwrite(str(tmp_path / f"pat{i:02}.png"), levels << 6)
    cv2.imwrite(str(tmp_path / "color.png"), np.zeros((40, 50, 3), np.uint8))
    recording = read_unknown_recording(tmp_path)
    assert recording.stack.n_frames == 3
    assert (recording.file_pattern, recording.stack.bit_depth) == ("pat*.png", 10)
    assert recording.is_high
    np.testing.assert_array_equal(recording.stack.frames[0], levels)
    with pytest.raises(MissingFileError):
        read_unknown_recording(tmp_path / "nothing")
