"""Read mutants in a process that may crash, hang or run out of memory, and judge what came of it.

A mutant is made from its format's name and its number alone, so that a fault found once is found
again: ``python -m tests.fuzz.mutants "PLY cloud" 1234`` reads that one and shows what comes of it.
"""

from __future__ import annotations

import json
import os
import queue
import resource
import subprocess
import sys
import tempfile
import threading
import time
import traceback
import warnings
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from random import Random
from typing import Any

from tests.fuzz.formats import Format, Sample, all_formats
from tests.fuzz.mutators import mutated

from exposight.errors import ExposightError

HANG_S = 10.0
_MEMORY = "/dev/shm" if os.path.isdir("/dev/shm") else None  # noqa: PTH112
"""Where samples lie: on a disk, writing and syncing mutants takes most of the time."""
_ADDRESS_SPACE = 8_000_000_000
_FAULTY_SHARE = 0.25
"""Share of the mutants that are made by a format's own faults, where it has some."""


@dataclass
class Findings:
    """What came of a format's mutants; each fault with the number of the mutant."""

    name: str
    mutants: int = 0
    accepted: int = 0
    peak_gb: float = 0.0
    seconds: float = 0.0
    faults: dict[str, list[str]] = field(default_factory=dict)

    def add(self, kind: str, number: int, what: str) -> None:
        """Note a fault: ``tracebacks``, ``crashes``, ``hangs`` or ``wrongly_accepted``."""
        self.faults.setdefault(kind, []).append(f"{number}: {what}")

    def count(self, kind: str) -> int:
        """Return how many faults of a kind there are."""
        return len(self.faults.get(kind, ()))


def find(
    format_: Format,
    numbers: Sequence[int],
    *,
    tell: Callable[[int], None] = lambda _: None,
) -> Findings:
    """Read mutants of a format in processes of their own, one process as long as it lives.

    Parameters
    ----------
    format_ : Format
    numbers : sequence of int
        Which mutants.
    tell : callable
        Called with the count of mutants done.
    """
    findings, left = Findings(format_.name), list(numbers)
    began = time.monotonic()
    while left:
        with tempfile.TemporaryDirectory(prefix="mutants-", dir=_MEMORY) as folder:
            left = _run(format_, left, Path(folder), findings, tell)
    findings.seconds = time.monotonic() - began
    return findings


def _run(
    format_: Format,
    numbers: list[int],
    folder: Path,
    findings: Findings,
    tell: Callable[[int], None],
) -> list[int]:
    """Read mutants until the process dies or hangs; return those that are left."""
    command = [sys.executable, "-m", "tests.fuzz.mutants", "--serve", format_.name, str(folder)]
    process = subprocess.Popen(
        command,
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
        env={**os.environ, "TMPDIR": str(folder.parent)},
    )
    lines: queue.Queue[str | None] = queue.Queue()
    errors: list[str] = []
    threads = [
        threading.Thread(target=_read_lines, args=(process.stdout, lines.put), daemon=True),
        threading.Thread(target=_read_lines, args=(process.stderr, errors.append), daemon=True),
    ]
    for thread in threads:
        thread.start()
    assert process.stdin is not None
    process.stdin.write(json.dumps(numbers) + "\n")
    process.stdin.flush()
    now: int | None = None
    done = 0
    try:
        while True:
            try:
                line = lines.get(timeout=HANG_S if now is not None else 120.0)
            except queue.Empty:
                if now is None:
                    msg = f"{format_.name}: making its samples took more than two minutes"
                    raise RuntimeError(msg) from None
                findings.mutants += 1
                findings.add("hangs", now, f"more than {HANG_S:g} s")
                break
            if line is None:
                if now is None and done == len(numbers):
                    break
                said = " / ".join(filter(None, [each and each.strip() for each in errors[-3:]]))
                if now is None:
                    msg = f"{format_.name}: the process ended between mutants: {said}"
                    raise RuntimeError(msg)
                findings.mutants += 1
                findings.add("crashes", now, f"exit status {process.wait()} {said}")
                break
            event = json.loads(line)
            if "begin" in event:
                now = event["begin"]
                continue
            now = None
            done += 1
            findings.mutants += 1
            findings.accepted += event["accepted"]
            findings.peak_gb = max(findings.peak_gb, event["peak_gb"])
            for kind, what in event["faults"]:
                findings.add(kind, event["end"], what)
            tell(1)
    finally:
        process.kill()
        process.wait()
        for thread in threads:
            thread.join()
        for stream in (process.stdin, process.stdout, process.stderr):
            with suppress(BrokenPipeError):
                if stream is not None:
                    stream.close()
    return numbers[done + (now is not None) :]


def _read_lines(stream: Any, put: Callable[[str | None], None]) -> None:
    for line in stream:
        put(line)
    put(None)


# -- in the process -------------------------------------------------------------------------------


def _serve(name: str, folder: str) -> None:
    format_ = all_formats()[name]
    reader = _Reader(format_, Path(folder))
    resource.setrlimit(resource.RLIMIT_AS, (_ADDRESS_SPACE, _ADDRESS_SPACE))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    out = os.fdopen(os.dup(1), "w", buffering=1)
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
    for number in json.loads(sys.stdin.readline()):
        mutant = reader.mutant(number)
        print(json.dumps({"begin": number}), file=out)
        accepted, faults = reader.judge(*mutant)
        event = {"end": number, "accepted": accepted, "faults": faults, "peak_gb": _peak_gb()}
        print(json.dumps(event), file=out)


class _Reader:
    """Reads mutants of a format's samples, which are put back after each."""

    def __init__(self, format_: Format, folder: Path) -> None:
        self._format = format_
        self._samples = list(format_.samples(folder))
        self._whole = [each.file.read_bytes() for each in self._samples]
        self._values = [format_.read(each.opened or each.file) for each in self._samples]
        for value in self._values:
            assert not format_.wrong(value), format_.wrong(value)

    def judge(
        self, at: int, data: bytes, must: str, sealed: bool
    ) -> tuple[bool, list[tuple[str, str]]]:
        """Read what `mutant` made; return whether it was accepted, and faults by their kind."""
        sample, whole = self._samples[at], self._whole[at]
        sample.file.write_bytes(data)
        _forget_peak()  # of making the mutant
        with warnings.catch_warnings(record=True) as warned:
            warnings.simplefilter("always")
            try:
                value = self._format.read(sample.opened or sample.file)
            except ExposightError:
                return False, _printed(warned)
            except BaseException as error:
                return False, [("tracebacks", _described(error))]
            finally:
                sample.file.write_bytes(whole)
        if faults := _printed(warned):
            return True, faults
        try:
            return True, [("wrongly_accepted", why) for why in self._wrong(at, value, must, sealed)]
        except Exception as error:  # a value that cannot even be looked at
            return True, [("wrongly_accepted", f"cannot be used: {_described(error)}")]

    def mutant(self, number: int) -> tuple[int, bytes, str, bool]:
        """Return its sample, its content, why it must be refused, and whether a seal is broken."""
        random = Random(f"{self._format.name} {number}")
        at = random.randrange(len(self._samples))
        whole = self._whole[at]
        if self._format.faults and random.random() < _FAULTY_SHARE:
            name = random.choice(sorted(self._format.faults))
            data = self._format.faults[name](whole, random)
            if data is not None and data != whole:
                return at, data, name, False
        data = mutated(whole, random, text=self._format.text)
        if not self._format.sealed:
            return at, data, "", False
        if self._format.reseal is not None and random.random() < 0.5:
            try:
                return at, self._format.reseal(whole, data), "", False
            except Exception:  # it can no longer be taken apart, so its checksum stays wrong
                pass
        return at, data, "", data != whole

    def _wrong(self, at: int, value: object, must: str, sealed: bool) -> Iterator[str]:
        if must:
            yield f"must be refused: {must}"
        if sealed and not self._format.same(value, self._values[at]):
            yield "its bytes were changed, its checksum not, and it reads as something else"
        if why := self._format.wrong(value):
            yield why


def _printed(warned: Sequence[warnings.WarningMessage]) -> list[tuple[str, str]]:
    """Return warnings that a user would see in two lines between ours: a traceback, nearly."""
    hidden = (DeprecationWarning, PendingDeprecationWarning, ImportWarning, ResourceWarning)
    return [
        ("tracebacks", f"{each.category.__name__} at {Path(each.filename).name}: {each.message}")
        for each in warned
        if not issubclass(each.category, hidden)
    ]


def _described(error: BaseException) -> str:
    """Return an exception with the last line of ours that it came through."""
    frames = traceback.extract_tb(error.__traceback__)
    ours = [each for each in frames if "exposight" in each.filename] or list(frames)
    place = f"{Path(ours[-1].filename).name}:{ours[-1].lineno}" if ours else "?"
    said = (str(error).splitlines() or [""])[0][:120]
    return f"{type(error).__name__} at {place}: {said}"


def _forget_peak() -> None:
    Path("/proc/self/clear_refs").write_text("5")


def _peak_gb() -> float:
    status = Path("/proc/self/status").read_text().splitlines()
    peak = next(int(line.split()[1]) for line in status if line.startswith("VmHWM"))
    children = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss
    return max(peak, children) / 1e6


# -- all of them ----------------------------------------------------------------------------------


def share_of(format_: Format, count: int) -> int:
    """Return how many mutants of a format are tried where there are so many of a quick one."""
    return max(count // 30, 10) if format_.slow else count


def find_all(
    count: int, *, first: int = 0, names: Sequence[str] = (), workers: int = 2
) -> list[Findings]:
    """Read so many mutants of each format; progress and a line a format on standard error."""
    formats = {name: each for name, each in all_formats().items() if not names or name in names}

    def one(format_: Format) -> Findings:
        findings = find(format_, range(first, first + share_of(format_, count)))
        print(_line(findings), file=sys.stderr, flush=True)
        return findings

    with ThreadPoolExecutor(workers) as pool:
        return list(pool.map(one, formats.values()))


def _line(findings: Findings) -> str:
    faults = ", ".join(f"{len(each)} {kind}" for kind, each in findings.faults.items()) or "right"
    return (
        f"{findings.name:28} {findings.mutants:6} mutants, {findings.accepted:5} accepted, "
        f"{findings.peak_gb:.2f} GB, {findings.seconds:5.0f} s: {faults}"
    )


def shown(findings: Findings, most: int = 12) -> str:
    """Return the faults that were found, alike ones once, with a number to make each again."""
    lines = []
    for kind, faults in findings.faults.items():
        alike: Counter[str] = Counter()
        example: dict[str, str] = {}
        for fault in faults:
            number, _, what = fault.partition(": ")
            alike[what] += 1
            example.setdefault(what, number)
        for what, count in alike.most_common(most):
            lines.append(f"  {findings.name}: {kind} {count} x, as mutant {example[what]}: {what}")
    return "\n".join(lines)


def _show(name: str, number: int) -> None:
    with tempfile.TemporaryDirectory() as folder:
        reader = _Reader(all_formats()[name], Path(folder))
        at, data, must, _ = reader.mutant(number)
        sample: Sample = reader._samples[at]
        sample.file.write_bytes(data)
        kept = Path(tempfile.gettempdir()) / f"mutant-{number}{sample.file.suffix}"
        kept.write_bytes(data)
        print(f"{kept}, {len(data)} bytes; of {sample.file.name}; {must or 'any change'}")
        value = reader._format.read(sample.opened or sample.file)
        print("accepted:", str(value)[:2000])
        print("wrong:", reader._format.wrong(value) or "nothing")


def main(arguments: Sequence[str]) -> int:
    """Run as ``python -m tests.fuzz.mutants [--mutants N] [FORMAT …]`` or ``FORMAT NUMBER``."""
    if arguments[:1] == ["--serve"]:
        _serve(*arguments[1:3])
        return 0
    if len(arguments) == 2 and arguments[0] in all_formats() and arguments[1].isdigit():
        _show(arguments[0], int(arguments[1]))
        return 0
    count, names = 5000, list(arguments)
    if names[:1] == ["--mutants"]:
        count, names = int(names[1]), names[2:]
    found = find_all(count, names=names)
    for each in found:
        if each.faults:
            print(shown(each))
    total = sum(each.mutants for each in found)
    faults = sum(len(list_) for each in found for list_ in each.faults.values())
    print(f"{total} mutants of {len(found)} formats, {faults} faults")
    return 1 if faults else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
