"""What is printed: no text from a file steers the terminal."""

import io
import json
from contextlib import redirect_stderr, redirect_stdout

import pytest
from rich.table import Table
from rich.text import Text

from exposight.cli.terminal import console, print_error, print_json, printable

HOSTILE = "a\x1b]0;title\x07b\x1b[31mred\x9b2Jc\u202egnp.exe\x00d\re"


def printed(show) -> str:
    out = io.StringIO()
    with redirect_stdout(out), redirect_stderr(out):
        show()
    return out.getvalue()


def in_a_table():
    grid = Table(HOSTILE)
    grid.add_row(HOSTILE)
    console().print(grid, width=400)


@pytest.mark.parametrize(
    "show",
    [
        lambda: console().print(HOSTILE, soft_wrap=True),
        lambda: console().print(Text(HOSTILE), soft_wrap=True),
        lambda: print_error("E", HOSTILE, as_json=False),
        lambda: print_error("E", HOSTILE, as_json=True),
        lambda: print_json({HOSTILE: HOSTILE}),
        in_a_table,
    ],
)
def test_control_characters_never_reach_the_terminal(show):
    text = printed(show)
    assert not set(text) & set("\x1b\x07\x9b\x00\r\u202e")
    assert "1b]0;title" in text


def test_json_stays_json():
    assert json.loads(printed(lambda: print_json({HOSTILE: [HOSTILE]}))) == {HOSTILE: [HOSTILE]}


def test_brackets_and_colons_in_names_are_no_markup():
    assert printed(lambda: console().print("obs[bold].csv :smile: [/]")) == (
        "obs[bold].csv :smile: [/]\n"
    )


def test_ordinary_text_is_as_it_is():
    text = "Ø 12 µm, σ ≤ 0.1\tä 😀 ⟨x⟩"
    assert printable(text) == text
    assert printable("\x1b") == r"\x1b"
    assert printable("\u202e") == r"\u202e"
