"""Memory of this process and the processes it started, watched while they run."""

from __future__ import annotations

import os
import threading
from pathlib import Path
from types import TracebackType

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
