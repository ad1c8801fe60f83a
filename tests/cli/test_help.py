"""What the help says, and what it costs."""

import subprocess
import sys

import pytest

from exposight.cli.app import COMMANDS, app

HEAVY = ("numpy", "numba", "scipy", "cv2", "polars", "trimesh", "plotly", "matplotlib", "yaml")


@pytest.mark.parametrize("name", COMMANDS)
def test_a_command_explains_itself_within_eighty_columns(name, run):
    ended = run(name, "--help")
    assert ended.exit_code == 0
    assert " ".join(ended.stdout.split()).count(COMMANDS[name]) == 1
    assert f"exposight {name}" in ended.stdout.partition("For example:")[2]
    assert "--json" in ended.stdout
    assert max(map(len, ended.stdout.splitlines())) <= 80


@pytest.mark.parametrize("name", COMMANDS)
def test_every_option_is_documented(name):
    for argument in app[name].assemble_argument_collection(parse_docstring=True):
        if argument.parse and argument.show and not argument.children:
            assert argument.parameter.help, argument.name


def test_the_program_lists_every_command(run):
    shown = " ".join(run("--help").stdout.replace("│", " ").split())
    assert all(f"{name} {summary}" in shown for name, summary in COMMANDS.items())


@pytest.mark.parametrize("word", ["--help", "--version", "trian", "--loud"])
def test_help_imports_nothing_that_takes_long(word):
    script = (
        "import sys; from exposight.cli import main\n"
        f"main([{word!r}]); print(sorted({set(HEAVY)!r} & set(sys.modules)))\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, encoding="utf-8", check=True
    )
    assert done.stdout.splitlines()[-1] == "[]"
