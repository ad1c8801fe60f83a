"""A fork server: each command runs in a process of its own, watched, and killed where one says.

It has imported everything and run nothing: forks of compiled threads hang. Each line that comes in
is a task (JSON): the command's words, the folder it may touch, and at which touch of the disk what
happens. A touch is an operation that changes the disk, before it happens, or half a file written.
"""

import errno
import hashlib
import importlib
import json
import os
import signal
import sys
import tempfile
from pathlib import Path

CHANGES = {"open", "os.mkdir", "os.rename", "os.remove", "os.rmdir", "os.link", "os.symlink"}
WRITES = os.O_WRONLY | os.O_RDWR | os.O_CREAT | os.O_TRUNC | os.O_APPEND
MARK = "EXPOSIGHT_CRASH_TEST"
"""In the environment of all that a command begins, so that what is left can be found."""


class Touches:
    """Counts what a process does to the disk below a folder, notes it, and lets it happen to it.

    Parameters
    ----------
    folder : str
        What is elsewhere is not counted.
    at : int or None
        The touch at which to act; None acts at none.
    how : str
        "kill", or "full": from there on the disk takes no more.
    """

    def __init__(self, folder, at, how):
        self.folder, self.at, self.how = folder, at, how
        self.count = 0
        self.whole = []
        self.operations = []
        self._process = os.getpid()
        self._inside = False
        self._write, self._sync = Path.write_bytes, os.fsync

    def watch(self):
        Path.write_bytes = lambda path, data: self.write(path, data)
        os.fsync = self.sync
        sys.addaudithook(self.see)

    def see(self, event, arguments):
        if event not in CHANGES or self._inside or os.getpid() != self._process:
            return
        if event == "open" and not (isinstance(arguments[2], int) and arguments[2] & WRITES):
            return
        if not isinstance(arguments[0], str | bytes | os.PathLike):
            return
        path = str(Path.cwd() / os.fsdecode(arguments[0]))
        relative = event in {"os.remove", "os.rmdir"} and arguments[-1] not in (-1, None)
        if not (relative or path.startswith(self.folder)):
            return
        self._inside = True
        self.touch(event, path)
        target = str(Path.cwd() / os.fsdecode(arguments[1])) if "rename" in event else ""
        self.operations.append((event, path, target))
        if target:
            self.note(Path(path), Path(target))
        self._inside = False

    def touch(self, event, path):
        self.count += 1
        if self.at is None or self.count < self.at:
            return
        if self.how == "kill":
            os.kill(os.getpid(), signal.SIGKILL)
        elif event not in {"os.remove", "os.rmdir"}:
            self._inside = False
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), path)

    def note(self, path, target):
        """Remember what gets a final name."""
        files = [p for p in path.rglob("*") if p.is_file()] if path.is_dir() else [path]
        for file in filter(Path.is_file, files):
            name = target / file.relative_to(path) if path.is_dir() else target
            self.whole.append((str(name), hashlib.sha256(file.read_bytes()).hexdigest()))

    def write(self, path, data):
        if str(path).startswith(self.folder) and self.count + 2 == self.at:
            self._write(path, data[: len(data) // 2])  # its opening is a touch
            self.touch("write", str(path))
        n = self._write(path, data)
        if str(path).startswith(self.folder):
            self.touch("write", str(path))
        return n

    def sync(self, descriptor):
        self._sync(descriptor)
        number = descriptor if isinstance(descriptor, int) else descriptor.fileno()
        self.operations.append(("fsync", str(Path(f"/proc/self/fd/{number}").readlink()), ""))


def serve():
    answers = os.fdopen(os.dup(1), "w")
    from numba.core.registry import cpu_target

    from exposight.cli import app, main
    from exposight.planning.covering import cover

    for name in app.COMMANDS:
        importlib.import_module(f"exposight.cli.{name}")
    for name in ("plotly.graph_objects", "matplotlib.figure", "exposight.report"):
        importlib.import_module(name)
    for context in (cpu_target.typing_context, cpu_target.target_context):
        context.refresh()  # what numba imports when it first compiles takes longest
    certificate = cover._certificate
    # A plan tells how long it took to find; nothing else that is written depends on the clock.
    cover._certificate = lambda plan, answer, _seconds: certificate(plan, answer, 1.0)
    print("ready", file=answers, flush=True)
    for line in sys.stdin:
        task = json.loads(line)
        child = os.fork()
        if not child:
            run(task, main)
        status = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
        print(json.dumps({"status": status}), file=answers, flush=True)


def run(task, main):
    status = 99
    try:
        os.setsid()
        os.environ.update(task["environment"])
        tempfile.tempdir = None
        os.chdir(task["folder"])
        log = os.open(task["log"], os.O_CREAT | os.O_TRUNC | os.O_WRONLY)
        os.dup2(log, 1)
        os.dup2(log, 2)
        touches = Touches(task["folder"], task["at"], task["how"])
        touches.watch()
        status = main(task["words"])
        touches.folder = "\0"
        note = {"count": touches.count, "whole": touches.whole, "operations": touches.operations}
        Path(task["note"]).write_text(json.dumps(note))
    except BaseException as error:
        print("raised", repr(error), flush=True)
        import traceback

        traceback.print_exc()
    finally:
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(status if isinstance(status, int) else 98)


if __name__ == "__main__":
    serve()
