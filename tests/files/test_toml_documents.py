"""TOML is read in a time that grows with its length, or refused."""

import time

import pytest

from exposight.errors import FormatError
from exposight.files import parse_toml

_HOSTILE = {
    "dotted": "a" + ".a" * 100_000 + " = 1",
    "dotted table": "[a" + ".a" * 100_000 + "]",
    "quoted parts": '"a,".' * 50_000 + "a = 1",
    "nested": "a = " + "[" * 100_000,
    "quotes": '"""' * 300_000,
    "digits": "a = " + "9" * 100_000,
}


@pytest.mark.parametrize("text", _HOSTILE.values(), ids=_HOSTILE)
def test_a_small_document_takes_no_long_time(text):
    began = time.process_time()
    with pytest.raises(FormatError, match=r"scene\.toml is not a readable scene"):
        parse_toml(text, "scene.toml", "scene")
    assert time.process_time() - began < 5


def test_dots_in_texts_comments_and_numbers_are_no_keys():
    dots = "." * 300
    text = f'# {dots}\na = "{dots}"\nb = [{"0.5, " * 300}]\nc = """\n{dots}"""\n'
    assert parse_toml(text, "x", "scene") == {"a": dots, "b": [0.5] * 300, "c": dots}


def test_a_key_twice_is_refused():
    with pytest.raises(FormatError, match=r"Cannot overwrite a value \(at line 2"):
        parse_toml("a = 1\na = 2\n", "x", "scene")
