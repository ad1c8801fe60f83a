"""The runs of a served folder: begun, paused, continued and stopped by any server process.

All that is known of a run is on disk (`exposight.service.run_files`). A run's lock is taken here
and inherited by the process that measures, so that there is no moment at which two could begin it,
or none seems to work on it. That process ends when the server process that began it does.
"""

from __future__ import annotations

import os
import re
import subprocess
import sys
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from dataclasses import replace
from pathlib import Path
from typing import Literal

from exposight.errors import FileError, LockedError, MissingFileError, did_you_mean
from exposight.files import durable_folder, hold_writer_lock, make_folder
from exposight.leash import leashed
from exposight.service.faults import RequestError
from exposight.service.folder import ServedFolder
from exposight.service.run_files import (
    LIVING,
    RUN_NAME,
    RUNS,
    RunFolder,
    RunRequest,
    RunState,
    first_state,
    now,
)
from exposight.service.run_work import check_work

_MOST_LIVING = 4
"""Runs that measure at the same time."""

_LOCK_S = 2.0
"""Within this time whoever looks whether a run's lock is free has let go of it."""

_PLACE_S = 10.0
"""Within this time those who begin a run before us have begun it."""

_SPAWN_S = 30.0

_END_S = 5.0
"""Within this time a process that measures lets go of its devices."""


class Runs:
    """The runs in a served folder.

    Parameters
    ----------
    served : ServedFolder
    """

    def __init__(self, served: ServedFolder) -> None:
        self._served = served
        # A child on a leash ends with the thread that began it: this one lasts as long as we do.
        self._spawner = ThreadPoolExecutor(1, thread_name_prefix="runs")
        self._children: list[subprocess.Popen[bytes]] = []

    def close(self) -> None:
        """End what this server process began; those runs are interrupted, and can be continued."""
        for child in self._children:
            child.terminate()  # devices get their settings back
        deadline = time.monotonic() + _END_S
        for child in self._children:
            try:
                child.wait(max(0.1, deadline - time.monotonic()))
            except subprocess.TimeoutExpired:
                child.kill()
                child.wait()
        self._spawner.shutdown()

    # -- how they stand -------------------------------------------------------------------------

    def run(self, name: str) -> RunFolder:
        """Return a run's folder.

        Raises
        ------
        MissingFileError
            If there is no run of this name.
        """
        folder = RunFolder(self._root / name)
        if not re.fullmatch(RUN_NAME, name) or not self._is_inside(folder) or not folder.is_run():
            msg = f"no run {name!r}{did_you_mean(name, self._names())}; GET /v1/runs lists them"
            raise MissingFileError(msg)
        return folder

    def states(self) -> list[RunState]:
        """Return how each run stands, those begun last first; damaged ones have failed."""
        states = []
        for name in self._names():
            with suppress(FileError):
                states.append(self.run(name).state)
        return sorted(states, key=lambda each: (each.started, each.name), reverse=True)

    def _is_inside(self, folder: RunFolder) -> bool:
        """Tell whether no link leads out of the served folder, at the run or at what it holds."""
        if not self._served.has(folder.path):
            return False
        try:
            links = [Path(each.path) for each in os.scandir(folder.path) if each.is_symlink()]
        except OSError:
            return False
        return all(map(self._served.has, links))

    @property
    def _root(self) -> Path:
        return self._served.root / RUNS

    def _names(self) -> list[str]:
        try:
            names = [each.name for each in os.scandir(self._root)]
        except OSError:
            return []
        return sorted(name for name in names if re.fullmatch(RUN_NAME, name))

    # -- what is done with them -----------------------------------------------------------------

    def start(self, request: RunRequest) -> RunState:
        """Begin a run; of two clients that ask for the same name, one begins it.

        Raises
        ------
        RequestError
            409 if there is a run of this name, 429 if as many measure as may.
        ExposightError
            If the plan, the models or the recording are not there, or do not fit each other.
        """
        path = self._served.new(f"{RUNS}/{request.name}", "run")
        self._check_free(path, request.name)
        n_features = check_work(request, self._served)
        make_folder(self._root, "runs")
        with self._place(request.name):
            self._check_free(path, request.name)  # another client may have been faster
            with durable_folder(path) as unfinished:
                state = first_state(request.name, request, time=now(), n_features=n_features)
                RunFolder(unfinished).write(request, state)
                lock = RunFolder(unfinished).take_lock()
        assert lock is not None  # nobody else knows the folder
        return self._spawn(RunFolder(path), lock)

    def order(self, name: str, order: Literal["pause", "stop"]) -> RunState:
        """Have a run pause or stop before its next capture.

        Raises
        ------
        MissingFileError
            If there is no such run.
        RequestError
            409 if nobody works on it.
        """
        folder = self.run(name)
        state = folder.state
        if not state.lives or (order == "pause" and state.state == "stopping"):
            raise _refusal(state, order)
        folder.give_order(order)
        return folder.state

    def proceed(self, name: str) -> RunState:
        """Have a run go on that is paused, stopped, interrupted or failed.

        Raises
        ------
        MissingFileError
            If there is no such run.
        RequestError
            409 if it is finished or stopping, 429 if as many measure as may.
        """
        folder = self.run(name)
        state = folder.state
        if state.state in {"finished", "stopping"}:
            raise _refusal(state, "continue")
        if state.lives:
            folder.give_order("run")
            return folder.state
        with self._place(name):
            lock = _awaited_lock(folder)
            if lock is None:  # another client continued it
                return folder.state
            try:
                state = folder.written_state
                if state.state == "finished":
                    raise _refusal(state, "continue")
                folder.give_order("run")
                folder.write_state(replace(state, state="starting", error="", updated=now()))
            except BaseException:
                os.close(lock)
                raise
        return self._spawn(folder, lock)

    @contextmanager
    def _place(self, name: str) -> Iterator[None]:
        """Hold a run's place among those that measure, while others wait, until it counts itself.

        Raises
        ------
        RequestError
            429 if as many measure as may, or others take too long to begin theirs.
        """
        try:
            lock = hold_writer_lock(self._root, "the runs", ".begin.lock", timeout_s=_PLACE_S)
        except LockedError as error:
            msg = "other runs are being begun; ask again a little later"
            raise RequestError(429, msg) from error
        try:
            living = [each.name for each in self.states() if each.state in LIVING]
            if name not in living and len(living) >= _MOST_LIVING:
                msg = f"{len(living)} runs are measuring, and no more may; stop one of {living}"
                raise RequestError(429, msg)
            yield
        finally:
            lock.release()

    def _check_free(self, path: Path, name: str) -> None:
        if path.exists():
            state = self.run(name).state if RunFolder(path).is_run() else None
            stands = f"is {state.state}" if state else "is no run's"
            msg = f"the name {name!r} is taken by what {stands}; choose another, or continue that"
            raise RequestError(409, msg, {"state": vars(state)} if state else {})

    def _spawn(self, folder: RunFolder, lock: int) -> RunState:
        """Begin the process that measures, which inherits the lock."""
        try:
            self._spawner.submit(self._begin, folder, lock).result(_SPAWN_S)
        except (OSError, TimeoutError) as error:
            reason = f"no process could be begun: {error}"
            folder.write_state(replace(folder.written_state, state="failed", error=reason))
            raise RequestError(429, reason) from error
        finally:
            os.close(lock)  # the child has it
        return folder.state

    def _begin(self, folder: RunFolder, lock: int) -> None:
        self._children = [each for each in self._children if each.poll() is None]
        script = Path(__file__).with_name("run_process.py")
        with (folder.path / "log.txt").open("ab") as log:
            child = subprocess.Popen(
                leashed(str(script), str(self._served.root), folder.name, str(lock)),
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=log,
                pass_fds=[lock],
                env={**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))},
                start_new_session=True,  # Ctrl-C ends the server, and that the child
            )
        self._children.append(child)


def _awaited_lock(folder: RunFolder) -> int | None:
    """Return a run's lock, which others hold for moments to look; None where one continued it."""
    deadline = time.monotonic() + _LOCK_S
    while (lock := folder.take_lock()) is None:
        if folder.written_state.lives:
            return None
        if time.monotonic() > deadline:
            msg = f"the process of run {folder.name!r} is still ending; ask again a little later"
            raise RequestError(409, msg)
        time.sleep(0.01)
    return lock


def _refusal(state: RunState, order: str) -> RequestError:
    can = {
        "finished": "it is finished; start another run",
        "stopping": "it is stopping; continue it once it is stopped",
    }
    why = can.get(state.state, f"it is {state.state}; continue it first")
    return RequestError(409, f"run {state.name!r} cannot {order}: {why}", {"state": vars(state)})
