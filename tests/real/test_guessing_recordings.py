"""Sequences of the real recordings, guessed from their frames; and no false alarm on them."""

from dataclasses import replace

import pytest

from exposight.imaging import SEQUENCE_PRESETS, decode, read_recording
from exposight.imaging.guessing import guess_sequence

_FOLDERS = {
    "skull_gray": "skull/skull_gray",
    "skull_2x3": "skull/skull_2x3",
    "board": "board/capture_0",
    "foam": "foam/object1",
}


@pytest.fixture(scope="module", params=_FOLDERS)
def recording(request, real_data):
    sequence = SEQUENCE_PRESETS[request.param]
    stack = read_recording(real_data / _FOLDERS[request.param], sequence)
    return request.param, stack, sequence


def test_the_preset_is_recovered(recording):
    name, stack, sequence = recording
    size = (sequence.projector_width, sequence.projector_height)
    guessed = guess_sequence(stack, projector_size=size).sequence
    assert (guessed.white_frame, guessed.black_frame) == (
        sequence.white_frame,
        sequence.black_frame,
    )
    for (_, found, _), (_, known, _) in zip(guessed.axes(), sequence.axes(), strict=True):
        if name != "foam":
            said = None if found.gray_code is None else replace(found.gray_code, first_code=0)
            assert replace(found, gray_code=said) == known
            continue
        # Codes of 100 px do not fill the display: their width, only, cannot be told.
        assert found.gray_code.frames == known.gray_code.frames
        assert found.gray_code.inverse_frames == known.gray_code.inverse_frames
        for each, right in zip(found.fringes, known.fringes, strict=True):
            assert each.frames == right.frames
            assert each.shifts_deg == right.shifts_deg
        ratio = found.fringes[1].periods / found.fringes[0].periods
        assert ratio == pytest.approx(1.5)


def test_a_right_sequence_has_no_contradiction(recording):
    name, stack, sequence = recording
    found = decode(stack, sequence).contradictions
    if name == "foam":  # a display of gamma 2.2, three steps: what is named is so
        found = [each for each in found if "gamma 2." not in each.explanation]
    assert not found
