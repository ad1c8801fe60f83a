"""The ``exposight`` program: its commands, and what becomes of errors.

A failure that exposight foresees ends in one line on standard error and exit status 1 (with
``--json``: in one JSON object on standard output), a wrong call in status 2, Ctrl-C in 130.
"""

from __future__ import annotations

import errno
import io
import sys
from typing import TYPE_CHECKING, Annotated, Any

import typer
from typer.core import TyperCommand

from exposight import __version__
from exposight.cli.decode import decode_command
from exposight.cli.demo import demo_command
from exposight.cli.evaluate import evaluate_command
from exposight.cli.info import info_command
from exposight.cli.observe import observe_command
from exposight.cli.output import print_error
from exposight.cli.predict import predict_command
from exposight.cli.reproduce import reproduce_command
from exposight.cli.simulate import simulate_command
from exposight.cli.train import train_command
from exposight.errors import ExposightError

if TYPE_CHECKING:
    from collections.abc import Callable

__all__ = ["app", "main"]

_INTERRUPTED = 130  # as shells have it: 128 + SIGINT


class _Command(TyperCommand):
    """A command whose foreseen failures are told in a line instead of a traceback."""

    def invoke(self, ctx: Any) -> Any:
        as_json = bool(ctx.params.get("as_json"))
        try:
            return super().invoke(ctx)
        except ExposightError as error:
            print_error(type(error).__name__, str(error), as_json=as_json)
            raise typer.Exit(1) from error
        except OSError as error:
            if error.errno == errno.EPIPE:  # the reader of our output left; typer ends quietly
                raise
            place = f"{error.filename}: " if error.filename else ""
            print_error("FileError", f"{place}{error.strerror or error}", as_json=as_json)
            raise typer.Exit(1) from error
        except KeyboardInterrupt as error:
            message = str(error)  # a command may know more
            message = message or "stopped by Ctrl-C; what was captured or finished before is kept"
            print_error("Interrupted", message, as_json=as_json)
            raise typer.Exit(_INTERRUPTED) from error


app = typer.Typer(
    name="exposight",
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
    context_settings={"help_option_names": ["-h", "--help"]},
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


def _register(name: str, command: Callable[..., None]) -> None:
    app.command(name, cls=_Command)(command)


_register("demo", demo_command)
_register("simulate", simulate_command)
_register("decode", decode_command)
_register("observe", observe_command)
_register("train", train_command)
_register("evaluate", evaluate_command)
_register("predict", predict_command)
_register("reproduce", reproduce_command)
_register("info", info_command)


def main() -> None:
    """Run the program with the command line's arguments, and exit."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            # A terminal or pipe that has no σ or ² shall show a ? for it, not fail.
            stream.reconfigure(errors="replace")
    app(prog_name="exposight")
