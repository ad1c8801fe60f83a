from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from exposight.errors import FormatError, ImageError, MissingFileError
from exposight.imaging import (
    SEQUENCE_PRESETS,
    AxisCoding,
    Fringe,
    GrayCode,
    PatternSequence,
    read_sequence,
    sequence_named_or_read,
    sequence_to_toml,
)

HEAD = 'name = "mine"\nprojector_width = 16\nprojector_height = 8\n'
GRAY = "[columns.gray_code]\nframes = [0, 1, 2, 3]\ninverse_frames = [4, 5, 6, 7]\n"


@pytest.fixture
def read(tmp_path):
    def read_text(text):
        path = tmp_path / "sequence.toml"
        path.write_text(text, encoding="utf-8")
        return read_sequence(path)

    return read_text


def test_gray_code(read):
    sequence = read(HEAD + 'bit_depth = 12\nfile_pattern = "p*.tif"\n' + GRAY)
    assert sequence.columns == AxisCoding(
        gray_code=GrayCode(frames=(0, 1, 2, 3), inverse_frames=(4, 5, 6, 7))
    )
    assert sequence.rows is None
    assert (sequence.bit_depth, sequence.file_pattern) == (12, "p*.tif")


def test_fringes(read):
    sequence = read(HEAD + "[[rows.fringes]]\nperiods = 1\nframes = [0, 1, 2]\n")
    assert sequence.rows == AxisCoding(fringes=(Fringe(periods=1, frames=(0, 1, 2)),))


def test_fringes_within_gray_code(read):
    sequence = read(HEAD + GRAY + "[[columns.fringes]]\nperiods = 8\nframes = [8, 9, 10]\n")
    assert sequence.columns.gray_code == GrayCode(frames=(0, 1, 2, 3), inverse_frames=(4, 5, 6, 7))


def test_missing_file(tmp_path):
    with pytest.raises(MissingFileError, match=r"no pattern sequence in TOML at .*none\.toml"):
        read_sequence(tmp_path / "none.toml")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("name = ", "not a readable pattern sequence"),
        (HEAD + "colour = 1\n" + GRAY, "key 'colour' is unknown"),
        (HEAD + GRAY + "bits = 4\n", r"key 'columns\.gray_code\.bits' is unknown"),
        ('name = "x"\nprojector_width = 8\n' + GRAY, "key 'projector_height' is missing"),
        (HEAD + "bit_depth = 17\n" + GRAY, "key 'bit_depth': expected 8, 9, .* or 16, got 17"),
        (
            HEAD + "white_frame = -1\n" + GRAY,
            "key 'white_frame': expected a number from 0 up, got -1",
        ),
        (HEAD + "[columns]\n", "each need a gray_code table, fringes, or both"),
        (HEAD, "columns, its rows, or both"),
        (HEAD + "[[rows.fringes]]\nperiods = 1\nframes = [0, 1]\n", "at least 3 steps, got 2"),
    ],
)
def test_bad_files(read, text, message):
    with pytest.raises(FormatError, match=rf"sequence\.toml(: | is).*{message}"):
        read(text)


@pytest.mark.parametrize("preset", SEQUENCE_PRESETS)
def test_what_is_written_is_read_again(tmp_path, preset):
    sequence = replace(SEQUENCE_PRESETS[preset], name='a "name" of its own', bit_depth=12)
    (tmp_path / "s.toml").write_text(sequence_to_toml(sequence), encoding="utf-8")
    assert read_sequence(tmp_path / "s.toml") == sequence


@st.composite
def sequences(draw):
    """Sequences with all keys: frames are handed out as they are needed."""
    frames = iter(range(1000))

    def take(n):
        return tuple(next(frames) for _ in range(n))

    def coding(size):
        n_bits = size.bit_length()
        kind = draw(st.sampled_from(["gray", "binary"]))
        width = draw(st.sampled_from([1, 2]))
        gray = GrayCode(
            frames=take(n_bits),
            inverse_frames=take(n_bits) if draw(st.booleans()) else (),
            code=kind,
            code_width=width,
            first_code=draw(st.integers(0, 3)),
            complementary_frame=take(1)[0] if width == 2 and kind == "gray" else None,
        )
        fringes = []
        for periods in draw(st.lists(st.floats(0.1, 7.9), max_size=3, unique=True)):
            n = draw(st.integers(3, 6))
            shifts = tuple(360.0 * k / n + draw(st.floats(-9, 9)) for k in range(n))
            fringes.append(
                Fringe(
                    periods=periods, frames=take(n), shifts_deg=shifts,
                    reversed=draw(st.booleans()),
                )
            )  # fmt: skip
        return AxisCoding(gray_code=gray, fringes=tuple(fringes), mirrored=draw(st.booleans()))

    lit = take(2)
    both = draw(st.booleans())
    depth = draw(st.integers(8, 16))
    return PatternSequence(
        name=draw(st.text(st.characters(codec="utf-8", exclude_categories=["Cc", "Cs"]))),
        projector_width=60, projector_height=28,
        columns=coding(64), rows=coding(32) if both else None,
        white_frame=lit[0], black_frame=lit[1], unused_frames=take(draw(st.integers(0, 2))),
        bit_depth=depth, alignment=draw(st.sampled_from(["low", "high"])),
        channel=draw(st.sampled_from([None, "red", "green", "blue"])),
        saturation_level=draw(st.sampled_from([None, 200, 2**depth - 1])),
        camera_response=draw(st.sampled_from([(), ((0.0, 0.0), (99.0, 0.3), (255.0, 1.25))])),
        projector_gamma=draw(st.floats(0.5, 3.0)),
        pattern_contrast=draw(st.floats(0.1, 1.0)),
        file_pattern="*.tif",
        grey_noise=draw(st.sampled_from([None, 1.5])),
    )  # fmt: skip


@settings(deadline=None)
@given(sequence=sequences())
def test_any_sequence_is_read_as_it_was_written(sequence):
    with TemporaryDirectory() as folder:
        path = Path(folder) / "s.toml"
        path.write_text(sequence_to_toml(sequence), encoding="utf-8")
        assert read_sequence(path) == sequence


def test_a_sequence_is_named_or_read(tmp_path):
    (tmp_path / "mine.toml").write_text(HEAD + GRAY, encoding="utf-8")
    assert sequence_named_or_read("board") is SEQUENCE_PRESETS["board"]
    assert sequence_named_or_read(tmp_path / "mine.toml").name == "mine"
    with pytest.raises(ImageError, match=r"or a TOML file.*did you mean 'skull_gray'"):
        sequence_named_or_read("skull_grey")
