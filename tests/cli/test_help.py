"""What the help says, and what it costs."""

import subprocess
import sys

import pytest
import typer

from exposight.cli.app import COMMANDS, load_command

HEAVY = ("numpy", "numba", "scipy", "cv2", "polars", "trimesh", "plotly", "matplotlib", "yaml")


@pytest.mark.parametrize("name", COMMANDS)
def test_the_summary_is_the_command_s_own(name):
    assert load_command(name).help.splitlines()[0] == COMMANDS[name]


def test_the_program_s_help_lists_every_command(run):
    told = " ".join(run("--help").stdout.replace("│", " ").split())
    assert all(f"{name} {summary}" in told for name, summary in COMMANDS.items())


@pytest.mark.parametrize("word", ["--help", "--version", "trian"])
def test_help_imports_nothing_that_takes_long(word):
    script = (
        f"import sys; sys.argv = ['exposight', {word!r}]\n"
        "from exposight.cli import main\n"
        "try:\n    main()\n"
        f"finally:\n    print(sorted({set(HEAVY)!r} & set(sys.modules)))\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, encoding="utf-8", check=False
    )
    assert done.stdout.splitlines()[-1] == "[]"


@pytest.mark.parametrize("name", COMMANDS)
def test_nothing_breaks_on_a_terminal_of_eighty_columns(name, run):
    lines = run(name, "--help").stdout.splitlines()
    assert max(map(len, lines)) <= 80
    words = [word for line in lines for word in line.replace("│", "  ").split("  ")]
    shown = {word.strip() for word in words}
    command = load_command(name)
    for parameter in command.params:
        kind = parameter.display_type_rich(ctx=typer.Context(command))
        limits = parameter._get_number_range_help_str()
        assert (f"{kind} [{limits}]" if limits else kind) in shown


@pytest.mark.parametrize("name", COMMANDS)
def test_every_command_gives_an_example(name, run):
    shown = run(name, "--help").stdout
    assert f"exposight {name}" in shown.partition("For example:")[2]
