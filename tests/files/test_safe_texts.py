"""Words in tables: every text comes back, and no spreadsheet computes one."""

import csv
import io

import polars as pl
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from exposight.errors import FormatError
from exposight.files import (
    check_plain,
    csv_of,
    csv_pieces,
    guarded,
    spelled,
    unguarded,
    without_guards,
)

texts = st.text(st.sampled_from("=+-@'\t\ra1.e \"") | st.characters(exclude_categories=["C"]))


@given(text=texts)
@settings(deadline=None)
def test_a_guarded_text_comes_back_and_is_no_formula(text):
    written = guarded(text)
    assert unguarded(written) == text
    assert written[:1] not in tuple("=@\t\r")
    if written[:1] in tuple("+-"):
        assert float(written) is not None


@given(cells=st.lists(texts.filter(lambda text: text and "\r" not in text), min_size=1, max_size=5))
@settings(deadline=None)
def test_a_frame_is_written_as_its_texts_are_guarded(cells):
    frame = pl.DataFrame({"=name": cells, "n": [-1.5] * len(cells)})
    written = csv_of(frame)
    rows = list(csv.reader(io.StringIO(written.decode(), newline="")))
    assert rows[0] == ["'=name", "n"]
    assert rows[1:] == [[guarded(cell), "-1.5"] for cell in cells]
    back = without_guards(pl.read_csv(written, schema_overrides={"'=name": pl.String}))
    assert back.equals(frame)


@pytest.mark.parametrize("character", ["\x1b", "\n", "\x00", "\x7f", "\x9b", "\u202e", "\u2066"])
def test_a_control_character_is_named(character):
    with pytest.raises(FormatError) as refused:
        check_plain(f"f{character}1", "the view")
    assert spelled(character) in str(refused.value)
    assert character not in str(refused.value)
    assert check_plain("Bohrung 1 – ø 😀", "the view") == "Bohrung 1 – ø 😀"


def test_a_long_table_in_pieces_is_the_whole():
    frame = pl.DataFrame({"x": range(120_001), "name": ["=a"] * 120_001})
    pieces = list(csv_pieces(frame))
    assert len(pieces) == 3
    plain = pl.read_csv(io.BytesIO(b"".join(pieces)))
    assert without_guards(plain).equals(frame)
    assert list(csv_pieces(frame.head(0))) == [b"x,name\n"]


def test_a_name_is_as_long_as_file_systems_have_them_and_no_longer():
    assert check_plain("ä" * 255, "the view")
    with pytest.raises(FormatError, match=r"the view 'ä+…' has 256 characters, and may have 255"):
        check_plain("ä" * 256, "the view")
