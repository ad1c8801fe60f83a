"""What every benchmark needs: timing by wall clock and CPU, memory, and its printed result."""

from __future__ import annotations

import json
import os
import sys
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any

from rich.console import Console
from rich.table import Table


@dataclass(frozen=True, kw_only=True)
class Timing:
    """The best of several runs.

    Parameters
    ----------
    wall_s, cpu_s : float, s
        Of the run with the shortest wall time; CPU time sums over threads.
    """

    wall_s: float
    cpu_s: float


def best_of(runs: int, call: Callable[[], object]) -> Timing:
    """Time a call several times after one warm-up and return the quickest run."""
    call()
    timings = []
    for _ in range(runs):
        wall, cpu = time.perf_counter(), time.process_time()
        call()
        timings.append(Timing(wall_s=time.perf_counter() - wall, cpu_s=time.process_time() - cpu))
    return min(timings, key=lambda timing: timing.wall_s)


@dataclass(frozen=True, kw_only=True)
class Figure:
    """One number of a benchmark.

    Parameters
    ----------
    name : str
        Key in the JSON object.
    value : float, int or None
        None where it could not be measured.
    unit : str
        For people.
    mark : str
        What it should be, for people; empty where nothing was set.
    met : bool or None
        Whether it is; None where nothing was set.
    """

    name: str
    value: float | int | None
    unit: str = ""
    mark: str = ""
    met: bool | None = None


def at_most(name: str, value: float, limit: float, unit: str = "") -> Figure:
    """Return a figure that should not exceed a limit."""
    return Figure(name=name, value=value, unit=unit, mark=f"≤ {limit:g}", met=value <= limit)


def at_least(name: str, value: float, limit: float, unit: str = "") -> Figure:
    """Return a figure that should reach a limit."""
    return Figure(name=name, value=value, unit=unit, mark=f"≥ {limit:g}", met=value >= limit)


def say(text: str) -> None:
    """Tell people on the error stream what is going on."""
    print(text, file=sys.stderr, flush=True)


def publish(title: str, figures: list[Figure]) -> None:
    """Print the table and, as the last line, one JSON object."""
    table = Table(title=title)
    table.add_column("figure")
    table.add_column("value", justify="right")
    table.add_column("unit")
    table.add_column("mark")
    table.add_column("")
    words = {True: "met", False: "missed", None: ""}
    for figure in figures:
        value = "–" if figure.value is None else f"{figure.value:.5g}"
        table.add_row(figure.name, value, figure.unit, figure.mark, words[figure.met])
    Console(width=100).print(table)
    result: dict[str, Any] = {figure.name: figure.value for figure in figures}
    print(json.dumps(result), flush=True)


_PROCESSES = Path("/proc")
_PERIOD_S = 0.2


class PeakMemory:
    """Remembers the largest memory that this process and its workers held at the same time.

    Sums the resident memory of this process and its children five times a second; pages that they
    share count once for each. Works where there is ``/proc`` (Linux).
    """

    def __init__(self) -> None:
        self._peak_bytes = 0
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._watch, daemon=True)

    def __enter__(self) -> PeakMemory:
        self._thread.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self._over.set()
        self._thread.join()

    @property
    def peak_gb(self) -> float | None:
        """10⁹ bytes; None where memory cannot be watched."""
        return self._peak_bytes / 1e9 if self._peak_bytes else None

    def _watch(self) -> None:
        while not self._over.wait(_PERIOD_S):
            held = sum(map(_resident_bytes, [os.getpid(), *_children()]))
            self._peak_bytes = max(self._peak_bytes, held)


def _children() -> list[int]:
    found: list[int] = []
    for task in (_PROCESSES / str(os.getpid()) / "task").glob("*/children"):
        found += map(int, _read(task).split())
    return found


def _resident_bytes(process: int) -> int:
    for line in _read(_PROCESSES / str(process) / "status").splitlines():
        if line.startswith("VmRSS:"):
            return 1024 * int(line.split()[1])
    return 0


def _read(path: Path) -> str:
    try:
        return path.read_text(encoding="utf-8")
    except OSError:  # the process or thread is over, or there is no such system
        return ""
