"""Kills every command that writes at every touch of the disk, and fills the disk at every touch.

After each kill whatever has a final name is whole, the same call again ends well with what an
undisturbed one writes, to the byte, and nothing is left, neither files nor processes. On a full
disk a command says so in a line, and leaves what was there. What is written is on the disk before
it gets its name, and its name before the command ends.

``python -m tests.crash.crash_points`` (``make crash``) tries all points; with numbers and names
after it so many kills of those commands.
"""

from __future__ import annotations

import hashlib
import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass, field, fields
from pathlib import Path
from queue import Queue
from typing import Any

import numpy as np
from tests.crash.commands import COMMANDS, Command, write_inputs
from tests.crash.runner import MARK

from exposight.files import is_unfinished

_FULL = re.compile("disk is full|No space left")
GONE_S = 5.0
"""Processes that a killed command began are gone after so long."""
KILLED = -9
_LOCK = ".lock"

Content = dict[str, str]
"""Checksums of files, by their paths in the sandbox; folders have none."""


@dataclass
class Found:
    """What became of a command's kills and full disks."""

    name: str
    points: int = 0
    kills: int = 0
    full_disks: int = 0
    torn: int = 0
    bytes_different: int = 0
    left_over_files: int = 0
    left_over_processes: int = 0
    unsaid: int = 0
    unsynced: int = 0
    seconds: float = 0.0
    faults: list[str] = field(default_factory=list)

    def count(self, what: str, names: Sequence[str], when: str) -> None:
        """Add faults of a kind."""
        setattr(self, what, getattr(self, what) + len(names))
        self.faults += [f"{self.name}, {when}: {what}: {name}" for name in names]


class Server:
    """A fork server (`tests.crash.runner`) and the folder that its commands may touch."""

    def __init__(self, work: Path, inputs: Path) -> None:
        self.work, self.inputs = work, inputs
        self.sandbox, self.log, self.note = work / "sandbox", work / "log", work / "note.json"
        self.old = work / "old"
        self._mark = f"{os.getpid()}-{work.name}"
        self._process = subprocess.Popen(
            [sys.executable, "-m", "tests.crash.runner"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            encoding="utf-8",
            env={**os.environ, "OPENBLAS_NUM_THREADS": "1", "COLUMNS": "200"},
        )
        assert self._process.stdout is not None
        assert self._process.stdout.readline() == "ready\n"

    def close(self) -> None:
        """End it."""
        self._process.kill()
        self._process.communicate()

    def restore(self, old: Path | None) -> None:
        """Bring the sandbox to a state that was kept, or to the first."""
        shutil.rmtree(self.sandbox, ignore_errors=True)
        if old is not None:
            shutil.copytree(old, self.sandbox)
            return
        for name in ("out", "home", "tmp"):
            (self.sandbox / name).mkdir(parents=True)

    def run(self, words: str, at: int | None = None, how: str = "kill") -> int:
        """Run a command, up to a touch of the disk."""
        places = {"{in}": str(self.inputs), "{out}": "out"}
        task = {
            "words": [_placed(word, places) for word in words.split()],
            "folder": str(self.sandbox),
            "environment": {
                MARK: self._mark,
                "HOME": str(self.sandbox / "home"),
                "XDG_CACHE_HOME": str(self.sandbox / "home" / ".cache"),
                "TMPDIR": str(self.sandbox / "tmp"),
            },
            "log": str(self.log),
            "note": str(self.note),
            "at": at,
            "how": how,
        }
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        print(json.dumps(task), file=self._process.stdin, flush=True)
        return int(json.loads(self._process.stdout.readline())["status"])

    def left_processes(self) -> list[str]:
        """Return what is still running of a command, once it had time to end."""
        until = time.monotonic() + GONE_S
        while (left := marked(self._mark)) and time.monotonic() < until:
            time.sleep(0.02)
        return left

    def said(self) -> list[str]:
        """Return the lines that the last command printed."""
        return self.log.read_text("utf-8", errors="replace").splitlines()

    def content(self) -> Content:
        """Return all files and folders of the sandbox."""
        return {
            str(path.relative_to(self.sandbox)): _sha256(path) if path.is_file() else ""
            for path in sorted(self.sandbox.rglob("*"))
        }


def _placed(word: str, places: dict[str, str]) -> str:
    for name, place in places.items():
        word = word.replace(name, place)
    return word


def _sha256(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


def marked(mark: str) -> list[str]:
    """Return the processes, but for dead ones that nobody has asked for, with a mark."""
    found = []
    for process in Path("/proc").glob("[0-9]*"):
        try:
            if f"{MARK}={mark}".encode() in (process / "environ").read_bytes().split(b"\0"):
                state = (process / "stat").read_text().rpartition(")")[2].split()[0]
                found += [(process / "cmdline").read_text()] if state != "Z" else []
        except OSError:
            continue
    return found


def try_command(server: Server, command: Command, kills: int | None, full: int | None) -> Found:
    """Kill a command, and fill its disk, at so many of its points; None means all."""
    found, began = Found(command.name), time.monotonic()
    server.restore(None)
    if command.before:
        _must_end_well(server, command.before)
    shutil.rmtree(server.old, ignore_errors=True)
    shutil.copytree(server.sandbox, server.old)
    before = server.content()
    _must_end_well(server, command.words)
    note = json.loads(server.note.read_text("utf-8"))
    found.points, after = note["count"], server.content()
    found.count("left_over_files", [*filter(is_unfinished, map(Path, after))], "undisturbed")
    found.count("unsynced", list(unsynced(note["operations"], server.sandbox)), "undisturbed")
    whole = {(name, data) for state in (before, after) for name, data in state.items()}
    whole |= {(os.path.relpath(name, server.sandbox), data) for name, data in note["whole"]}
    for at in _spread(found.points, kills):
        server.restore(server.old)
        if server.run(command.words, at) != KILLED:
            continue
        found.kills += 1
        when = f"killed at {at}"
        found.count("left_over_processes", server.left_processes(), when)
        found.count("torn", _torn(server.content(), whole), when)
        _try_again(server, command, after, found, when)
    for at in _spread(found.points, full):
        server.restore(server.old)
        status = server.run(command.words, at, "full")
        found.full_disks += 1
        when = f"disk full at {at}"
        if status == 0:  # what it could not write is not needed, as a cache
            continue
        said = [line for line in server.said() if "error:" in line]
        if status != 1 or len(said) != 1 or not _FULL.search(server.said()[-1]):
            found.count("unsaid", [f"status {status}: {server.said()[-3:]}"], when)
        content = server.content()
        found.count("torn", _torn(content, whole), when)
        left = [name for name in content if is_unfinished(Path(name))]
        found.count("left_over_files", left, when)
        _try_again(server, command, after, found, when)
    found.seconds = time.monotonic() - began
    return found


def _try_again(server: Server, command: Command, after: Content, found: Found, when: str) -> None:
    """Run a command again after it was disturbed, and compare."""
    status = server.run(command.words)
    if status and not (command.once and server.content() == after):
        found.count("bytes_different", [f"status {status}: {server.said()[-3:]}"], when)
        return
    content = server.content()
    different = [name for name, data in after.items() if content.get(name) != data]
    found.count("bytes_different", different, when)
    found.count("left_over_files", sorted(content.keys() - after.keys()), when)
    found.count("left_over_processes", server.left_processes(), when)


def _must_end_well(server: Server, words: str) -> None:
    if status := server.run(words):
        lines = "\n".join(server.said())
        msg = f"exposight {words} ended with status {status}:\n{lines}"
        raise RuntimeError(msg)


def _torn(content: Content, whole: set[tuple[str, str]]) -> list[str]:
    """Return files under final names that are neither old nor new."""
    return [
        name
        for name, data in content.items()
        if data
        and (name, data) not in whole
        and not any(is_unfinished(Path(part)) for part in Path(name).parts)
        and not name.endswith(_LOCK)
    ]


def _spread(points: int, most: int | None) -> list[int]:
    if most is None or most >= points:
        return list(range(1, points + 1))
    return sorted({int(at) for at in np.linspace(1, points, most).round()}) if most else []


def unsynced(operations: Sequence[Sequence[str]], folder: Path) -> Iterator[str]:
    """Yield what a loss of power may cost: names of what is not on the disk, names that are not.

    Parameters
    ----------
    operations : sequence of (event, path, target)
        All that a command did, in its order.
    folder : Path
        Where it did so.
    """
    opened: dict[str, int] = {}
    synced: dict[str, int] = {}
    named: dict[str, int] = {}
    for number, (event, path, target) in enumerate(operations):
        if event == "open":
            opened[path] = number
        elif event == "fsync":
            synced[path] = number
        elif event == "os.rename":
            inside = [name for name in opened if name == path or name.startswith(f"{path}/")]
            for name in inside:
                if synced.get(name, -1) < opened[name]:
                    yield f"{target} was named before its content was on the disk"
                del opened[name]
            named[str(Path(target).parent)] = number
    for parent, number in named.items():
        if synced.get(parent, -1) < number:
            yield f"{parent} was not pushed to the disk after the names in it"
    for name in opened:
        if Path(name).is_file() and not name.endswith(_LOCK):
            yield f"{name} was written under its final name"


@contextmanager
def servers(inputs: Path | None = None, count: int = 2) -> Iterator[Queue[Server]]:
    """Start fork servers, with the commands' inputs."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name).resolve()
        if inputs is None:
            inputs = folder / "in"
            inputs.mkdir()
            write_inputs(inputs)
        free: Queue[Server] = Queue()
        began = []
        try:
            for number in range(count):
                (folder / str(number)).mkdir()
                began.append(Server(folder / str(number), inputs))
                free.put(began[-1])
            yield free
        finally:
            for each in began:
                each.close()


def try_commands(
    commands: Sequence[Command],
    kills: int | None = None,
    full: int | None = None,
    *,
    inputs: Path | None = None,
    count: int = 2,
) -> list[Found]:
    """Try commands, those that take long first, at so many points each."""

    def attempt(command: Command) -> Found:
        server = free.get()
        try:
            limits = (_least(kills, command.most), _least(full, command.most))
            try:
                found = try_command(server, command, *limits)
            except RuntimeError as error:
                found = Found(command.name, bytes_different=1, faults=[str(error)])
            print(
                f"{found.name}: {found.points} points, {found.kills} kills, "
                f"{len(found.faults)} faults, {found.seconds:.0f} s",
                *found.faults[:6],
                sep="\n  ",
                file=sys.stderr,
                flush=True,
            )
            return found
        finally:
            free.put(server)

    ordered = sorted(commands, key=lambda each: each.most is None)
    with servers(inputs, count) as free, ThreadPoolExecutor(count) as pool:
        return list(pool.map(attempt, ordered))


def _least(number: int | None, most: int | None) -> int | None:
    return number if number is None or most is None else min(number, most)


def totals(results: Sequence[Found]) -> dict[str, Any]:
    """Return the sums over all commands."""
    names = [each.name for each in fields(Found) if each.type == "int"]
    return {name: sum(getattr(found, name) for found in results) for name in names}


def main(words: Sequence[str]) -> int:
    """Try all points, or so many of some commands, and print a table."""
    most = int(words[0]) if words else None
    inputs = Path(os.environ["CRASH_INPUTS"]) if "CRASH_INPUTS" in os.environ else None
    wanted = [each for each in COMMANDS if not words[1:] or each.name in words[1:]]
    results = try_commands(wanted, most, most, inputs=inputs)
    keys = list(totals([]))
    print("".join(f"{key[:16]:>17}" for key in keys), "command")
    for found in results:
        print("".join(f"{getattr(found, key):>17}" for key in keys), found.name)
    print(json.dumps(totals(results)))
    return 1 if any(found.faults for found in results) else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
