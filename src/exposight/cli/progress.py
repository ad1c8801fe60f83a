"""Progress bars on standard error, and what is said where Ctrl-C ends the work."""

from __future__ import annotations

from contextlib import contextmanager
from typing import TYPE_CHECKING

from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)
from rich.progress import Progress as Bars

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from rich.progress import TaskID

    from exposight.workers import Progress


@contextmanager
def progress_bars(kept_in: Path | None = None) -> Iterator[Progress]:
    """Show how far work is: bars on a terminal, elsewhere a line for each stage.

    Parameters
    ----------
    kept_in : Path, optional
        Where finished work is kept, so that the same command goes on with it.

    Yields
    ------
    Progress
        To be handed to what works.

    Raises
    ------
    KeyboardInterrupt
        With a message that says how far work was and what is kept.
    """
    console = Console(stderr=True, highlight=False)
    bars = Bars(
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        TextColumn("left"),
        TimeRemainingColumn(),
        console=console,
        disable=not console.is_terminal,
        speed_estimate_period=600.0,  # s: steps of such work may be a minute apart
    )
    tasks: dict[str, TaskID] = {}
    last = ""

    def progress(stage: str, done: int, total: int) -> None:
        nonlocal last
        last = f"{stage}, {done} of {total}" if total else stage
        if stage not in tasks:
            # What was done before does not count as speed.
            tasks[stage] = bars.add_task(stage, completed=done, total=total or None)
            if not console.is_terminal:
                console.print(f"{stage} …", soft_wrap=True)
        bars.update(tasks[stage], completed=done, total=total or None)

    try:
        with bars:
            yield progress
    except KeyboardInterrupt as error:
        msg = "stopped by Ctrl-C" + (f" ({last})" if last else "")
        if kept_in is not None and kept_in.exists():
            msg += f"; what is finished is kept in {kept_in}, and the same command goes on"
        raise KeyboardInterrupt(msg) from error
