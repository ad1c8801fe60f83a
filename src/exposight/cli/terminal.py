"""The terminal: JSON objects, errors in a line, progress bars, and readers that leave."""

from __future__ import annotations

import json
import math
import os
import sys
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import asdict, is_dataclass
from pathlib import Path
from typing import NoReturn

from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    TaskID,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)
from rich.progress import Progress as Bars
from rich.text import Text

from exposight.contradictions import Contradiction

BROKEN_PIPE = 141
"""Exit status where the reader of the output left, as shells have it: 128 + SIGPIPE."""


def print_json(document: Mapping[str, object]) -> None:
    """Print one JSON object; NaN, which JSON does not know, becomes null."""
    text = json.dumps(_plain(document), indent=2, ensure_ascii=False, allow_nan=False)
    console().print(text, soft_wrap=True, markup=False)


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
    stderr = Console(stderr=True, highlight=False)
    stderr.print(line, soft_wrap=True)
    if hint:
        stderr.print(hint, soft_wrap=True)


def quit_quietly() -> NoReturn:
    """Leave without a word, as programs do that SIGPIPE ends: nobody reads the rest."""
    with suppress(OSError, ValueError):  # no file behind it
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # else Python's exit fails
    raise SystemExit(BROKEN_PIPE)


class _Console(Console):
    """A console whose reader may leave."""

    def on_broken_pipe(self) -> None:
        quit_quietly()


def console() -> Console:
    """Return a console on standard output."""
    return _Console(highlight=False)


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
    stderr = Console(stderr=True, highlight=False)
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
        msg = "stopped by Ctrl-C" + (f" ({shown.last})" if shown.last else "")
        if kept_in is not None and kept_in.exists():
            msg += f"; what is finished is kept in {kept_in}, and the same command goes on"
        raise KeyboardInterrupt(msg) from error
