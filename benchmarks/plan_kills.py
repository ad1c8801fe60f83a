"""Closed loops killed at random instants: whether a capture or a decision is lost.

A loop on the simulated cell, under a lamp that its models never saw, is killed in the middle again
and again, and goes on each time; so is ``exposight next``, call by call. What is there after a kill
must be there afterwards, and what comes out in the end must be what an uninterrupted loop gives, to
the last byte.
"""

from __future__ import annotations

import io
import json
import os
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stdout, suppress
from pathlib import Path
from typing import Any

from benchmarks.measuring import Figure, at_most, say
from benchmarks.models_campaigns import COMET, SEEDS
from benchmarks.plan_campaigns import sweep_plan, training_table
from exposight.observing import View
from exposight.planning import (
    ExposureLimits,
    ExposurePlan,
    SensorModels,
    plan_exposures,
    train,
    write_exposure_plan,
)
from exposight.twin.simulated_cell import scene_at

KILLS = 30
_VIEWS = 8
_LAMP, _NEED = 0.55, 0.98
"""Far from what is expected, so that there is much to correct."""
_LATEST_S = 0.7
"""A kill comes so long after a loop began or took a capture, at most."""

_RUNNER = """
import json, os, sys
from pathlib import Path
from exposight.cli import main
from exposight.measuring import measure_adaptively
from exposight.planning import SensorModels, read_exposure_plan
from exposight.twin import SimulatedCell, SimulatedCellSettings
from exposight.twin.simulated_cell import scene_at

scene_at(None)

def say(word, number):
    os.write(1, f"{word} {number}\\n".encode())  # at once: two processes write

for line in sys.stdin:  # each in a process of its own, forked after the imports, which take longest
    task = json.loads(line)
    child = os.fork()
    if child:
        say("ended", os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]))
        continue
    if "state" in task:
        say("begun", os.getpid())
        sys.stdout = open(os.devnull, "w")
        os._exit(main(["next", task["state"], "--capture", task["capture"], "--json"]))
    plan, models = read_exposure_plan(Path(task["plan"])), SensorModels.load(task["models"])
    settings = SimulatedCellSettings(lamp=task["lamp"], rings_only=True)
    names = [each.feature for each in plan.features]
    cell = SimulatedCell(models.sensor, settings, features=names)
    say("begun", os.getpid())
    captured = lambda decision: say("captured", decision.number)
    measure_adaptively(plan, cell, task["folder"], models=models, tell=captured)
    os._exit(0)
"""


def kill_figures(kills: int = KILLS) -> list[Figure]:
    """Kill closed loops and steps of them, and count what was lost."""
    with tempfile.TemporaryDirectory() as name, _runner() as run:
        folder = Path(name)
        models = train(training_table(SEEDS[0]), sensor=COMET)
        models.save(folder / "models")
        write_exposure_plan(folder / "plan.json", _plan(models))
        task = {"plan": folder / "plan.json", "models": folder / "models", "lamp": _LAMP}
        lost, resumed = _killed_loops(run, folder, task, kills)
        lost_steps = _killed_steps(run, folder, kills)
    say(f"{kills} kills of loops, {resumed} of them with captures to go on from: {lost} lost")
    say(f"{kills} kills of steps: {lost_steps} lost")
    return [at_most("killed_lost", lost, 0), at_most("killed_steps_lost", lost_steps, 0)]


def _plan(models: SensorModels) -> ExposurePlan:
    """Return the fewest captures of all features from some views that no model has learnt from."""
    part, limits = scene_at(None).part_with_finishes(), ExposureLimits.of(COMET)
    planned = sweep_plan(_VIEWS, SEEDS[0])
    poses = {view.name: view.camera_from_part for view in planned.views(part)}
    views = [
        View.of(planned.observed_part(part), COMET, pose, name=name) for name, pose in poses.items()
    ]
    return plan_exposures(
        [models.recommend(view, limits, need=_NEED).chances for view in views],
        limits,
        poses=poses,
        sensor=COMET.name,
        part=part.name,
    )


class _Runs:
    """Runs tasks in processes of their own, and kills them."""

    def __init__(self, process: subprocess.Popen[str]) -> None:
        self._process = process

    def __call__(
        self, task: dict[str, Any], after_s: float | None = None, *, captures: int = 0
    ) -> bool:
        """Run a task, and return whether it was killed so long after it began or captured."""
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        print(json.dumps(task, default=str), file=self._process.stdin, flush=True)
        line = self._process.stdout.readline()
        if after_s is not None and line.startswith("begun"):
            process = int(line.split()[1])
            while captures and not line.startswith("ended"):
                line = self._process.stdout.readline()
                captures -= line.startswith("captured")
            time.sleep(after_s)
            with suppress(ProcessLookupError):  # it may have come to its end
                os.kill(process, signal.SIGKILL)
        while not line.startswith("ended"):
            line = self._process.stdout.readline()
        status = int(line.split()[1])
        if status not in {0, -signal.SIGKILL}:
            msg = f"a run failed with status {status}: {task}"
            raise RuntimeError(msg)
        return status != 0


@contextmanager
def _runner() -> Iterator[_Runs]:
    process = subprocess.Popen(
        [sys.executable, "-c", _RUNNER],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        encoding="utf-8",
    )
    with process:
        yield _Runs(process)
        process.kill()


def _killed_loops(run: _Runs, folder: Path, task: dict[str, Any], kills: int) -> tuple[int, int]:
    """Return how many files kills cost, and how often there were captures to go on from."""
    whole = folder / "whole"
    run({**task, "folder": whole})
    reference = _content(whole)
    moments, lost, resumed, killed = random.Random(1), 0, 0, 0
    campaign = folder / "killed"
    while killed < kills:
        before = _captures(campaign)
        captures = len(before) + moments.randint(0, 1)
        killed += run(
            {**task, "folder": campaign}, moments.uniform(0.0, _LATEST_S), captures=captures
        )
        resumed += bool(before)
        after = _captures(campaign)
        lost += sum(after.get(name) != data for name, data in before.items())
        if (campaign / "result.json").is_file():  # it came to its end
            lost += _differing(_content(campaign), reference)
            shutil.rmtree(campaign)
    run({**task, "folder": campaign})
    return lost + _differing(_content(campaign), reference), resumed


def _killed_steps(run: _Runs, folder: Path, kills: int) -> int:
    """Return how many calls of ``exposight next`` left neither the old nor the new state."""
    from exposight.cli import main

    state, whole = folder / "loop.json", folder / "whole"
    captures = sorted((whole / "captures").iterdir())
    begin = ["next", str(state), "--plan", str(folder / "plan.json"), "--campaign", str(whole)]
    with redirect_stdout(io.StringIO()):
        main([*begin, "--models", str(folder / "models"), "--json"])
    states = [state.read_bytes()]
    for capture in captures:
        run({"state": state, "capture": capture})
        states.append(state.read_bytes())
    moments, lost, step, killed = random.Random(2), 0, 0, 0
    state.write_bytes(states[0])
    began = time.perf_counter()
    run({"state": state, "capture": captures[0]})
    longest_s = time.perf_counter() - began
    state.write_bytes(states[0])
    while killed < kills:
        killed += run({"state": state, "capture": captures[step]}, moments.uniform(0.0, longest_s))
        now = state.read_bytes()
        lost += now not in states[step : step + 2]
        step += now == states[step + 1]
        if step == len(captures):
            step = 0
            state.write_bytes(states[0])
    for capture in captures[step:]:
        run({"state": state, "capture": capture})
    return lost + (state.read_bytes() != states[-1])


def _captures(campaign: Path) -> dict[str, bytes]:
    """Return the descriptions of all captures that are there, which hold their files' checksums."""
    paths = campaign.glob("captures/[0-9]*/capture.json")
    return {path.parent.name: path.read_bytes() for path in paths}


def _content(folder: Path) -> dict[str, bytes]:
    files = (path for path in folder.rglob("*") if path.is_file())
    return {str(path.relative_to(folder)): path.read_bytes() for path in files}


def _differing(one: dict[str, bytes], other: dict[str, bytes]) -> int:
    return sum(one.get(name) != other.get(name) for name in {**one, **other})


if __name__ == "__main__":
    from benchmarks.measuring import publish

    publish("Killed loops", kill_figures(int(sys.argv[1]) if len(sys.argv) > 1 else KILLS))
