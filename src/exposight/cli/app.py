"""The ``exposight`` program: its commands, and what becomes of errors.

A failure that exposight foresees ends in one line on standard error and exit status 1, a wrong call
in status 2, Ctrl-C in 130; with ``--json``, each in one JSON object on standard output.
"""

from __future__ import annotations

import errno
import io
import re
import sys
from contextlib import contextmanager
from importlib import import_module
from typing import TYPE_CHECKING, Annotated, Any

import typer
from typer.core import TyperCommand, TyperGroup

from exposight.cli.interrupts import INTERRUPTED, ended_by_interrupts
from exposight.cli.output import print_error, quit_quietly
from exposight.errors import ExposightError, did_you_mean
from exposight.version import __version__

if TYPE_CHECKING:
    from collections.abc import Iterator


COMMANDS = {
    "demo": "Run the whole method once, on a simulated cell or a recording.",
    "simulate": "Carry out a measuring plan in a simulated cell.",
    "sensor": "Describe a sensor by its calibration, for the other commands.",
    "decode": "Decode recorded stripe frames to an organised point cloud.",
    "observe": "Measure every feature in every capture: quality, brightness, pose.",
    "split": "Split a table of observations into one to train and one to test.",
    "train": "Train the paper's models on observations.",
    "evaluate": "Hold models against observations that they have not seen.",
    "predict": "Predict quality or exposure time, and say how far to believe it.",
    "reproduce": "Repeat the paper's study, and hold it against the published numbers.",
    "info": "Say what a file or folder is, and what is in it.",
}
"""The commands in the order of the help, with the first line of their own.

Command NAME is the function ``NAME_command`` of module ``exposight.cli.NAME``, imported when it is
called: all of them together take seconds, which nobody who asks for help should wait.
"""

_CONTEXT = {"help_option_names": ["-h", "--help"]}


def load_command(name: str) -> Any:
    """Import one of `COMMANDS` and return it as typer's command."""
    module = import_module(f"exposight.cli.{name}")
    own = typer.Typer(
        add_completion=False,
        rich_markup_mode="rich",
        pretty_exceptions_enable=False,
        context_settings=_CONTEXT,
    )
    own.command(name)(getattr(module, f"{name}_command"))
    return typer.main.get_command(own)


class _Command(TyperCommand):
    """A command's name and summary; the command itself once it is called."""

    def __init__(self, name: str, summary: str) -> None:
        super().__init__(name, help=summary)

    def make_context(
        self, info_name: str | None, args: list[str], parent: Any = None, **extra: Any
    ) -> Any:
        with ended_by_interrupts():
            command = load_command(str(self.name))
        return command.make_context(info_name, args, parent, **extra)


class _Program(TyperGroup):
    """The commands, whose foreseen failures are told in a line instead of a traceback."""

    def __init__(self, **attributes: Any) -> None:
        super().__init__(**attributes)
        for name, summary in COMMANDS.items():
            self.add_command(_Command(name, summary))

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        with _told(as_json="--json" in args):
            return super().parse_args(ctx, args)

    def invoke(self, ctx: Any) -> Any:
        with _told(as_json="--json" in ctx.args):
            return super().invoke(ctx)


@contextmanager
def _told(*, as_json: bool) -> Iterator[None]:
    """Tell foreseen failures, and leave with the exit status that they have."""
    try:
        yield
    except ExposightError as error:
        print_error(type(error).__name__, str(error), as_json=as_json)
        raise typer.Exit(1) from error
    except OSError as error:
        if error.errno == errno.EPIPE:  # the reader of our output left
            quit_quietly()
        place = f"{error.filename}: " if error.filename else ""
        print_error("FileError", f"{place}{error.strerror or error}", as_json=as_json)
        raise typer.Exit(1) from error
    except typer.TyperException as error:  # a wrong call
        error.message = _plainer(error.message)
        if not as_json:  # typer shows the call's form, too
            raise
        print_error("UsageError", error.format_message(), as_json=True)
        raise typer.Exit(error.exit_code) from error
    except KeyboardInterrupt as error:
        message = str(error)  # a command may know more
        message = message or "stopped by Ctrl-C; what was captured or finished before is kept"
        print_error("Interrupted", message, as_json=as_json)
        raise typer.Exit(INTERRUPTED) from error


def _plainer(message: str) -> str:
    """Say what a value of an option had to be, without the words of who checks it."""
    message = message.replace("Value error, ", "")
    for kind, expected in (("an integer", "a whole number"), ("a number", "a number")):
        unread = rf"Input should be a valid (integer|number), unable to parse string as {kind}"
        message = re.sub(unread, f"expected {expected}", message)
    choice = re.fullmatch(r"(?s).*?'([^']+)' is not one of (.*?)\.?", message)
    if choice is None:
        return message
    return message.rstrip(".") + did_you_mean(choice[1], re.findall(r"'([^']+)'", choice[2]))


app = typer.Typer(
    name="exposight",
    cls=_Program,
    help=(
        "Predict point-cloud quality and exposure time of active 3D sensors.\n\n"
        "Decode frames to a cloud, observe a part's features in it, train models on\n"
        "the observations, evaluate them, and predict with them. Begin with the demo.\n"
        "Lengths are in mm, angles in degrees, exposure times in ms, grey levels 0 to\n"
        "255 and p_norm 0 to 1."
    ),
    no_args_is_help=True,
    add_completion=False,
    rich_markup_mode="rich",
    pretty_exceptions_enable=False,
    context_settings=_CONTEXT,
)


def _show_version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"exposight {__version__}")
        raise typer.Exit


@app.callback()
def _options(
    version: Annotated[
        bool,
        typer.Option(
            "--version",
            callback=_show_version,
            is_eager=True,
            help="Print the version and leave.",
        ),
    ] = False,
) -> None:
    """Take what stands before the command's name; the program's help is in `app`."""


def run() -> None:
    """Run the program with the command line's arguments, and exit."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            # A terminal or pipe that has no σ or ² shall show a ? for it, not fail.
            stream.reconfigure(errors="replace")
    app(prog_name="exposight")
