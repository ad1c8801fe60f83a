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
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Literal

from exposight.errors import FileError, MissingFileError, did_you_mean
from exposight.files import durable_folder, make_folder
from exposight.leash import leashed
from exposight.service.faults import RequestError
from exposight.service.folder import ServedFolder
from exposight.service.run_files import (
    CAMPAIGN,
    LIVING,
    RUN_NAME,
    CellDriver,
    RecordedDriver,
    RunFolder,
    RunRequest,
    RunState,
    now,
)
from exposight.service.run_work import plan_of

RUNS = "runs"
"""Folder of the runs in the served folder."""

_MOST_LIVING = 4
"""Runs that measure at the same time."""

_LOCK_S = 2.0
"""Within this time whoever looks whether a run's lock is free has let go of it."""

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
        if not re.fullmatch(RUN_NAME, name) or not folder.is_run():
            msg = f"no run {name!r}{did_you_mean(name, self._names())}; GET /v1/runs lists them"
            raise MissingFileError(msg)
        return folder

    def states(self) -> list[RunState]:
        """Return how each run stands, those begun last first; damaged ones are left out."""
        states = []
        for name in self._names():
            with suppress(FileError):
                states.append(self.run(name).state)
        return sorted(states, key=lambda each: (each.started, each.name), reverse=True)

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
            409 if there is a run of this name, or as many measure as may.
        ExposightError
            If the plan, the models or the recording are not there, or do not fit each other.
        """
        path = self._served.new(f"{RUNS}/{request.name}", "run")
        self._check_free(path, request.name)
        n_features = self._checked(request)
        living = [each.name for each in self.states() if each.state in LIVING]
        if len(living) >= _MOST_LIVING:
            msg = f"{len(living)} runs are measuring, and no more may; stop one of {living}"
            raise RequestError(409, msg)
        state = _first_state(request, n_features)
        make_folder(self._root, "runs")
        try:
            with durable_folder(path) as unfinished:
                RunFolder(unfinished).write(request, state)
                lock = RunFolder(unfinished).take_lock()
        except FileError:
            self._check_free(path, request.name)  # another client was faster
            raise
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
            409 if it is finished or stopping.
        """
        folder = self.run(name)
        state = folder.state
        if state.state in {"finished", "stopping"}:
            raise _refusal(state, "continue")
        if state.lives:
            folder.give_order("run")
            return folder.state
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

    def _check_free(self, path: Path, name: str) -> None:
        if path.exists():
            state = self.run(name).state if RunFolder(path).is_run() else None
            stands = f"is {state.state}" if state else "is no run's"
            msg = f"the name {name!r} is taken by what {stands}; choose another, or continue that"
            raise RequestError(409, msg, {"state": vars(state)} if state else {})

    def _checked(self, request: RunRequest) -> int:
        """Check what a run needs as far as that is done at once; return the number of features."""
        plan = plan_of(request, self._served)
        if request.models is not None:
            self._served.models(request.models)
        if isinstance(request.driver, RecordedDriver):
            self._served.campaign(request.driver.recording)
        if isinstance(request.driver, CellDriver):
            self._served.inside(request.driver.cell, "file of a cell")
        return len(plan.features)

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


def _first_state(request: RunRequest, n_features: int) -> RunState:
    began = now()
    return RunState(
        name=request.name,
        state="starting",
        plan=request.plan,
        models=request.models,
        driver=request.driver.model_dump(exclude_none=True),
        campaign=f"{RUNS}/{request.name}/{CAMPAIGN}",
        n_captures=0,
        n_features=n_features,
        n_had=None,
        verdict="",
        error="",
        started=began,
        updated=began,
        last_seq=0,
    )


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
