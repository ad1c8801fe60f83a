"""The terminal: JSON objects, errors in a line, progress bars, and readers that leave.

Names come from files of others: what in them would steer the terminal (escape sequences, signs that
turn the direction of writing) is shown as its code.
"""

from __future__ import annotations

import json
import math
import os
import re
import sys
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import asdict, is_dataclass
from pathlib import Path
from typing import NoReturn

from rich.console import Console, ConsoleOptions, ConsoleRenderable, RenderHook, RenderResult
from rich.measure import Measurement
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    TaskID,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)
from rich.progress import Progress as Bars
from rich.segment import Segment
from rich.text import Text

from exposight.cli.interrupts import stopped_by
from exposight.contradictions import Contradiction

BROKEN_PIPE = 141
"""Exit status where the reader of the output left, as shells have it: 128 + SIGPIPE."""


def print_json(document: Mapping[str, object]) -> None:
    """Print one JSON object; NaN, which JSON does not know, becomes null."""
    text = json.dumps(_plain(document), indent=2, ensure_ascii=False, allow_nan=False)
    escaped = _STEERING.sub(lambda found: f"\\u{ord(found[0]):04x}", text)
    console().print(escaped, soft_wrap=True)


def print_error(
    kind: str,
    message: str,
    *,
    hint: str = "",
    contradictions: Sequence[Contradiction] = (),
    as_json: bool,
) -> None:
    """Print a failure: one line on standard error, or a JSON object on standard output."""
    if as_json:
        document: dict[str, object] = {"type": kind, "message": message}
        if contradictions:
            document["contradictions"] = contradictions
        print_json({"error": document})
        return
    line = Text.assemble(("error: ", "bold red"), " ".join(message.split()))
    stderr = console(stderr=True)
    stderr.print(line, soft_wrap=True)
    if hint:
        stderr.print(hint, soft_wrap=True)


def quit_quietly() -> NoReturn:
    """Leave without a word, as programs do that SIGPIPE ends: nobody reads the rest."""
    with suppress(OSError, ValueError):  # no file behind it
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # else Python's exit fails
    raise SystemExit(BROKEN_PIPE)


_STEERING = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\u200e\u200f\u2028-\u202e\u2066-\u2069]")
"""Control characters but for tab and newline, and signs that turn the direction of writing."""


def printable(text: str) -> str:
    r"""Return a text in which what would steer a terminal is written as its code: ``\x1b``."""
    return _STEERING.sub(lambda found: ascii(found[0])[1:-1], text)


class _Printable:
    """What is to be printed, with its text made printable and its styles as they are."""

    def __init__(self, renderable: ConsoleRenderable) -> None:
        self._renderable = renderable

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        for segment in console.render(self._renderable, options):
            if segment.control:
                yield segment  # the console's own, of its progress bars
            else:
                yield Segment(printable(segment.text), segment.style)

    def __rich_measure__(self, console: Console, options: ConsoleOptions) -> Measurement:
        return Measurement.get(console, options, self._renderable)


class _Console(Console, RenderHook):
    """A console whose reader may leave, and which no text can steer."""

    def __init__(self, *, stderr: bool) -> None:
        # No text has markup: [1] in a name is no style, nor :x: an emoji.
        super().__init__(stderr=stderr, highlight=False, markup=False, emoji=False)
        self.push_render_hook(self)

    def process_renderables(self, renderables: list[ConsoleRenderable]) -> list[ConsoleRenderable]:
        return [_Printable(each) for each in renderables]

    def on_broken_pipe(self) -> None:
        quit_quietly()


def console(*, stderr: bool = False) -> Console:
    """Return a console on standard output, or on standard error."""
    return _Console(stderr=stderr)


def _plain(value: object) -> object:
    """Return a value in JSON's own types."""
    match value:
        case Mapping():
            return {str(key): _plain(item) for key, item in value.items()}
        case float():
            return value if math.isfinite(value) else None
        case str() | int() | None:
            return value
        case Path():
            return str(value)
        case Iterable():
            return [_plain(item) for item in value]
    if is_dataclass(value) and not isinstance(value, type):
        return _plain(asdict(value))
    msg = f"no JSON for a {type(value).__name__}"
    raise TypeError(msg)


class Shown:
    """Bars on standard error, and lines above them (`exposight.workers.Progress`)."""

    def __init__(self, bars: Bars, stderr: Console) -> None:
        self._bars, self._stderr = bars, stderr
        self._tasks: dict[str, TaskID] = {}
        self.last = ""

    def __call__(self, stage: str, done: int, total: int) -> None:
        """Report progress."""
        self.last = f"{stage}, {done} of {total}" if total else stage
        if stage not in self._tasks:
            # What was done before does not count as speed.
            self._tasks[stage] = self._bars.add_task(stage, completed=done, total=total or None)
            if not self._stderr.is_terminal:
                self._stderr.print(f"{stage} …", soft_wrap=True)
        self._bars.update(self._tasks[stage], completed=done, total=total or None)

    def line(self, text: str) -> None:
        """Print a line above the bars."""
        self._stderr.print(Text(text), soft_wrap=True)


@contextmanager
def progress_bars(kept_in: Path | None = None) -> Iterator[Shown]:
    """Show how far work is: bars on a terminal, elsewhere a line for each stage.

    Parameters
    ----------
    kept_in : Path, optional
        Where finished work is kept, so that the same command goes on with it.

    Yields
    ------
    Shown
        To be handed to what works.

    Raises
    ------
    KeyboardInterrupt
        With a message that says how far work was and what is kept.
    """
    stderr = console(stderr=True)
    bars = Bars(
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        TextColumn("left"),
        TimeRemainingColumn(),
        console=stderr,
        disable=not stderr.is_terminal,
        speed_estimate_period=600.0,  # s: steps of such work may be a minute apart
    )
    shown = Shown(bars, stderr)
    try:
        with bars:
            yield shown
    except KeyboardInterrupt as error:
        msg = stopped_by() + (f" ({shown.last})" if shown.last else "")
        if kept_in is not None and kept_in.exists():
            msg += f"; what is finished is kept in {kept_in}, and the same command goes on"
        raise KeyboardInterrupt(msg) from error
