"""What commands print: tables for people, one JSON document for machines, errors in a line."""

from __future__ import annotations

import json
import math
import os
import sys
from collections.abc import Collection, Iterable, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich import box
from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)
from rich.table import Table
from rich.text import Text

if TYPE_CHECKING:
    from collections.abc import Iterator
    from typing import NoReturn

    from exposight.workers import Progress as ReportsProgress


BROKEN_PIPE = 141
"""Exit status where the reader of the output left, as shells have it: 128 + SIGPIPE."""


def quit_quietly() -> NoReturn:
    """Leave without a word, as programs do that SIGPIPE ends: nobody reads the rest."""
    with suppress(OSError, ValueError):  # no file behind it
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # else Python's exit fails
    raise SystemExit(BROKEN_PIPE)


class _Console(Console):
    """A console whose reader may leave."""

    def on_broken_pipe(self) -> None:
        quit_quietly()


JsonOption = Annotated[
    bool,
    typer.Option("--json", help="Print one JSON document instead of tables, for machines."),
]


def number(value: float | None, digits: int = 4) -> str:
    """Spell a number with so many significant digits, without an exponent where it can be.

    Nothing and NaN are a dash.
    """
    if value is None or math.isnan(value):
        return "–"
    if value and not 1e-4 <= abs(value) < 1e6:
        return f"{value:.{digits - 1}e}"
    spelled = f"{value:.{digits}g}"
    return f"{value:.0f}" if "e" in spelled else spelled.replace("-", "−")


def count(value: int) -> str:
    """Spell a whole number with blanks between its thousands, as the field's papers do."""
    return f"{value:,}".replace(",", " ")


def counted(value: int, thing: str) -> str:
    """Spell how many there are of a thing: "1 row", "20 rows"."""
    return f"{count(value)} {thing}{'' if value == 1 else 's'}"


def percent(share: float | None) -> str:
    """Spell a share of 1 in percent; nothing is a dash."""
    return "–" if share is None or math.isnan(share) else f"{100 * share:.1f}"


def print_json(document: Mapping[str, object]) -> None:
    """Print one JSON document; NaN, which JSON does not know, becomes null."""
    text = json.dumps(_plain(document), indent=2, ensure_ascii=False, allow_nan=False)
    typer.echo(text)


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
    msg = f"no JSON for a {type(value).__name__}"
    raise TypeError(msg)


def print_error(kind: str, message: str, *, as_json: bool) -> None:
    """Tell a failure: one line on standard error, or a JSON document on standard output."""
    if as_json:
        print_json({"error": {"type": kind, "message": message}})
        return
    line = Text.assemble(("error: ", "bold red"), " ".join(message.split()))
    Console(stderr=True, highlight=False).print(line, soft_wrap=True)


def print_line(text: str, *, style: str = "") -> None:
    """Print a line that is never broken: paths in it stay whole."""
    _Console(highlight=False).print(Text(text, style=style), soft_wrap=True)


def wrote(what: str, path: Path, *, replaced: bool) -> None:
    """Say where something was written, and whether another file had that name."""
    own = f"the {what}: " if what else ""
    print_line(f"{'replaced' if replaced else 'wrote'} {own}{path}")


def note(text: str) -> None:
    """Print a remark that the reader should not miss."""
    _Console(highlight=False).print(Text.assemble(("note: ", "bold yellow"), text))


def print_facts(title: str, facts: Iterable[tuple[str, str]]) -> None:
    """Print what is known about one thing, a line each.

    Parameters
    ----------
    title : str
        What it is.
    facts : iterable of (str, str)
        Name and value.
    """
    print_line(title, style="bold")
    grid = Table.grid(padding=(0, 2))
    grid.add_column(style="cyan", no_wrap=True)
    grid.add_column(overflow="fold")
    for name, value in facts:
        grid.add_row(f"  {name}", Text(value))
    _Console(highlight=False).print(grid)


def print_table(
    columns: Sequence[str],
    rows: Iterable[Sequence[str]],
    *,
    title: str = "",
    words: Collection[str] = (),
) -> None:
    r"""Print a table.

    Parameters
    ----------
    columns : sequence of str
        Headings, with units; ``"p_norm\n%"`` makes two lines.
    rows : iterable of sequence of str
        Cells.
    title : str
        Stands above the table.
    words : collection of str
        Columns that hold words and may be folded. The first one holds names, all others numbers.
    """
    if title:
        print_line(title, style="bold")
    table = Table(box=box.SIMPLE_HEAD, padding=(0, 1, 0, 0), show_edge=False)
    for position, column in enumerate(columns):
        table.add_column(
            column,
            justify="left" if position == 0 or column in words else "right",
            overflow="fold",
            no_wrap=column not in words,
            header_style="cyan",
        )
    for row in rows:
        table.add_row(*map(Text, row))
    _Console(highlight=False).print(table)


@contextmanager
def progress_bars(*, keep: bool = False, time_left: bool = False) -> Iterator[ReportsProgress]:
    """Show how far work is, on standard error and only where that is a terminal.

    Parameters
    ----------
    keep : bool
        Leave the finished bars standing; where there is no terminal, name each stage in a line.
    time_left : bool
        Tell the time left, too, for work of many minutes.

    Yields
    ------
    Progress
        Draws a bar for each stage.
    """
    console = Console(stderr=True, highlight=False)
    if not console.is_terminal:
        named: set[str] = set()

        def tell_once(stage: str, done: int, total: int) -> None:
            if keep and stage not in named:
                typer.echo(f"{stage} …", err=True)
            named.add(stage)

        yield tell_once
        return
    bars = Progress(
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        *((TextColumn("left"), TimeRemainingColumn()) if time_left else ()),
        console=console,
        transient=not keep,
        speed_estimate_period=600.0,  # s: steps of such work may be a minute apart
    )
    with bars:
        tasks: dict[str, object] = {}

        def tell(stage: str, done: int, total: int) -> None:
            if stage not in tasks:
                # What was done before does not count as speed.
                tasks[stage] = bars.add_task(stage, completed=done, total=total)
            bars.update(tasks[stage], completed=done, total=total)  # type: ignore[arg-type]

        yield tell
