"""The ``exposight`` program: its commands, and what becomes of their results and errors.

A failure that exposight foresees ends in one line on standard error and exit status 1, a wrong call
in status 2, Ctrl-C in 130, SIGTERM in 143, a fault of exposight itself in 70 with its traceback in
a file; with ``--json``, each in one JSON object on standard output.
"""

import errno
import io
import os
import platform
import re
import shlex
import sys
import tempfile
import traceback
from collections.abc import Sequence
from dataclasses import replace
from typing import Annotated, Any

from cyclopts import App, CycloptsError, Group, Parameter
from cyclopts.exceptions import MissingArgumentError

from exposight import __version__
from exposight.cli.interrupts import ended_by_interrupts, interrupted_status, stopped_by
from exposight.cli.terminal import print_error, print_json, quit_quietly
from exposight.errors import ContradictionError, ExposightError, did_you_mean

COMMANDS = {
    "demo": "Run the whole method once on a simulated cell.",
    "measure": "Carry out a measuring plan or an exposure plan with a driver.",
    "next": "Say what to capture next, one step of the closed loop.",
    "simulate": "Carry out a measuring plan in a simulated cell.",
    "sensor": "Describe a sensor from its calibration.",
    "part": "Find the holes of a part from CAD, and write it for plan and simulate.",
    "decode": "Decode recorded stripe frames, or a stereo pair, to an organised point cloud.",
    "collect": "Collect a folder of images and clouds into a campaign.",
    "observe": "Measure quality, brightness and pose of every feature in every capture.",
    "merge": "Merge captures of a view at several exposure times into one (HDR).",
    "split": "Split an observation table into training and test data.",
    "train": "Train models on observations, or on a campaign.",
    "evaluate": "Evaluate models on held-out observations.",
    "predict": "Predict quality or exposure time from poses.",
    "forecast": "Forecast the quality of every visible feature over exposure time.",
    "recommend": "Recommend the exposures of a view, and name the features that will fail.",
    "plan": "Plan which exposures to take in which views of a part.",
    "compare": "Compare ways to choose exposure times on views whose every outcome is known.",
    "propose": "Name the capture that would tell most of what is to be measured.",
    "serve": "Answer over HTTP what models, campaigns and plans in a folder tell.",
    "report": "Write a page about a campaign and models.",
    "reproduce": "Repeat the paper's study and compare it with the published numbers.",
    "info": "Identify a file or folder and summarise its content.",
}
"""The commands in the order of the help, with the first line of their own.

Command NAME is the function ``NAME_command`` of module ``exposight.cli.NAME``, imported when it is
called: all of them together take seconds, which nobody who asks for help should wait.
"""


FAULT = 70
"""Exit status of a fault of exposight itself: EX_SOFTWARE of BSD's sysexits.h."""

_COMMON_OPTIONS = {"--help", "-h", "--version", "--json"}


class UsageError(Exception):
    """A command is called with options that do not go together."""


def _shown_default(value: Any) -> str | None:
    """Return a default as the help shows it; flags and missing values have none."""
    if value is None or isinstance(value, bool):
        return None
    if isinstance(value, list | tuple):
        return ", ".join(map(str, value)) or None
    return f"{value:g}" if isinstance(value, float) else str(value)


app = App(
    name="exposight",
    help="""Predict point-cloud quality and exposure time of active 3D sensors.

    Decode frames to a cloud, observe a part's features in it, train models on the observations,
    evaluate them, and predict with them. Start with the demo. Lengths are in mm, angles in degrees,
    exposure times in ms, grey levels 0 to 255 and p_norm 0 to 1.
    """,
    version=f"exposight {__version__}",
    help_format="markdown",
    default_parameter=Parameter(negative=(), show_default=_shown_default),
    group_parameters=Group("Options", sort_key=1),
    suppress_keyboard_interrupt=False,
    result_action="return_value",
    exit_on_error=False,
    print_error=False,
)
for position, (name, summary) in enumerate(COMMANDS.items()):
    path = f"exposight.cli.{name}:{name}_command"
    app.command(path, name=name, help=summary, sort_key=position)


app.meta.suppress_keyboard_interrupt = False


@app.meta.default
def _with_common_options(
    *tokens: Annotated[str, Parameter(show=False, allow_leading_hyphen=True)],
    as_json: Annotated[bool, Parameter("--json", group=Group("Output", sort_key=9))] = False,
    read_as: Annotated[
        str | None, Parameter(metavar="NAME=ANSWER,…", group=Group("Foreign files", sort_key=8))
    ] = None,
) -> Any:
    """Take the options that every command has.

    Parameters
    ----------
    as_json
        Print one JSON object instead of tables.
    read_as
        How foreign files are to be read where two readings fit: decimal=comma, size=diameter,
        unit=inch, … (docs/formats.md).
    """
    if "--help" in tokens or "-h" in tokens:
        return app(tokens)
    # Not above: it brings pydantic, for which nobody who asks for help should wait.
    from exposight.files import Reading, collected_remarks, reading_as

    with reading_as(Reading.parse(read_as or "")), collected_remarks() as remarks:
        result = app(tokens)
    if result is not None and remarks:
        result = replace(result, recognised=tuple(remarks))
    if result is not None and as_json:
        print_json(result.document())
    elif result is not None:
        result.show()
    return 1 if result is not None and result.failed else 0


def run(arguments: Sequence[str]) -> int:
    """Run a command, print its result or what went wrong, and return the exit status."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            # A terminal or pipe that has no σ or ² shall show a ? for it, not fail.
            stream.reconfigure(errors="replace")
    # Numbers such as -12,3,500 are no option: with a blank before them they are not taken for one.
    arguments = [f" {word}" if re.match(r"-[\d.].*[ ,;]", word) else word for word in arguments]
    command = next((word for word in arguments if not word.startswith("-")), None)
    try:
        if arguments and arguments[0].startswith("-") and arguments[0] not in _COMMON_OPTIONS:
            msg = f"unknown option {arguments[0]} before the command"
            raise UsageError(msg)
        if command is not None and command not in COMMANDS:
            msg = f"unknown command '{command}'{did_you_mean(command, COMMANDS)}"
            raise UsageError(msg)
        if command is not None:
            with ended_by_interrupts():
                app[command].help = None  # its docstring says more than its summary
        status = app.meta(arguments)
    except (SystemExit, GeneratorExit):
        raise
    except BaseException as error:  # a panic of a library in Rust is no Exception
        return _report(error, command or "", as_json="--json" in arguments)
    return status if isinstance(status, int) else 0


def _report(error: BaseException, command: str, *, as_json: bool) -> int:
    """Print what went wrong, and return the exit status."""
    kind, message, hint, status = type(error).__name__, str(error), "", 1
    match error:
        case OSError():
            if error.errno == errno.EPIPE:  # the reader of our output left
                quit_quietly()
            place = f"{error.filename}: " if error.filename else ""
            kind, message = "FileError", f"{place}{error.strerror or error}"
        case MemoryError():
            kind = "NumericalError"
            message = (
                f"there is not enough memory ({_first_line(error)}); what was kept before stays"
            )
        case ExposightError():
            pass
        case KeyboardInterrupt():
            kind, status = "Interrupted", interrupted_status()
            message = message or f"{stopped_by()}; what was finished before is kept"
        case CycloptsError() | UsageError():
            kind, status = "UsageError", 2
            message = _call_message(error)
            known = command if command in COMMANDS else ""
            hint = f"exposight {known} --help shows the form of the call".replace("  ", " ")
        case _:
            kind, status = "InternalError", FAULT
            message = (
                f"this is a fault of exposight, not of its input ({_first_line(error)}); the "
                f"traceback is in {_kept_traceback(error)}; please report it with what you called"
            )
    found = error.contradictions if isinstance(error, ContradictionError) else ()
    print_error(kind, message, hint=hint, contradictions=found, as_json=as_json)
    return status


def _first_line(error: BaseException) -> str:
    """Return an exception's type and the first line of what it says."""
    return f"{type(error).__name__}: {(str(error).splitlines() or [''])[0][:200]}".removesuffix(
        ": "
    )


def _kept_traceback(error: BaseException) -> str:
    """Write a traceback, with what is needed to understand it, to a new file; return its name."""
    about = {
        "exposight": __version__,
        "Python": sys.version.split()[0],
        "platform": platform.platform(),
        "called": shlex.join(sys.argv),
    }
    lines = [f"{name}: {value}" for name, value in about.items()]
    lines += ["", *traceback.format_exception(error)]
    try:
        descriptor, name = tempfile.mkstemp(prefix="exposight-fault-", suffix=".txt")
        with os.fdopen(descriptor, "w", encoding="utf-8", errors="backslashreplace") as file:
            file.write("\n".join(lines))
    except OSError as refused:
        return f"no file, which could not be written ({refused.strerror or refused})"
    return name


def _call_message(error: Exception) -> str:
    """Return what is wrong with a call."""
    if isinstance(error, MissingArgumentError) and error.argument is not None:
        count, _ = error.argument.token_count()
        if not error.tokens_so_far and error.keyword is None:
            return f"{error.argument.name} is missing"
        return f"{error.argument.name} needs {count} value{'s' if count > 1 else ''}"
    if isinstance(error, CycloptsError):
        error.verbose = False
    return str(error)
