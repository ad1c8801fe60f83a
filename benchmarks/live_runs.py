"""A served folder whose server is killed again and again while it measures.

After each SIGKILL the server is started again and the run continued; in the end captures, decisions
and outcomes must be those of a run that nothing interrupted.
"""

from __future__ import annotations

import hashlib
import json
import os
import random
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import httpx
from tests.measuring.conftest import PlateDriver, plate_exposure_plan

from exposight.cell import Driver
from exposight.measuring import measure_adaptively
from exposight.measuring.decisions import DECISIONS_FILE, OUTCOMES_FILE
from exposight.planning import write_exposure_plan
from exposight.planning.exposure_plan import ExposurePlan, PlannedExposure

_TIMES_MS = tuple(float(each) for each in range(1, 33))
_MOST_EVENTS = 70
"""A server is killed when a run that goes on has told up to so many events: it is half through."""

_AT_START = 0.2
"""Share of the servers that are killed while the run begins to go on."""

_ENDED = {"stopped", "interrupted", "failed", "finished"}


def killed_service_lost(folder: Path, *, kills: int = 20, seed: int = 1) -> dict[str, Any]:
    """Kill a server in runs, and count what is lost or taken twice.

    Parameters
    ----------
    folder : Path
        Empty, for what is served.
    kills : int
        SIGKILLs of the server while a run is measuring.
    seed : int
        Decides when.

    Returns
    -------
    dict
        ``killed_service_lost`` captures that are missing, changed or taken twice, and outcomes that
        differ, of ``killed_runs`` runs; ``killed_in_runs`` servers.
    """
    plan = _long_plan()
    write_exposure_plan(folder / "plan.json", plan)
    driver: Driver = PlateDriver()  # type: ignore[no-untyped-call]
    measure_adaptively(plan, driver, folder / "whole", models=None)
    expected, chance = _content(folder / "whole"), random.Random(seed)
    lost = killed = finished = 0
    while killed < kills:
        name = f"run-{finished}"
        campaign = folder / "runs" / name / "campaign"
        known: dict[str, str] = {}
        while True:
            with _server(folder) as (process, client):
                there = _captures(campaign)
                lost += sum(there.get(path) != sha256 for path, sha256 in known.items())
                _go_on(client, name)
                n_events = 0 if chance.random() < _AT_START else chance.randint(1, _MOST_EVENTS)
                pause_s = chance.uniform(0.0, 0.1)  # anywhere between two events
                if killed < kills and not _ends(client, name, n_events, pause_s):
                    process.send_signal(signal.SIGKILL)
                    process.wait()
                    killed += 1
                    known = _captures(campaign)
                    continue
                _ends(client, name)
                break
        lost += _differences(_content(campaign), expected) + _repeated(campaign.parent)
        finished += 1
    return {"killed_service_lost": lost, "killed_in_runs": killed, "killed_runs": finished}


def _long_plan() -> ExposurePlan:
    """Return the plan of the tests' plate with many exposure times."""
    plan: ExposurePlan = plate_exposure_plan()  # type: ignore[no-untyped-call]
    exposures = tuple(
        PlannedExposure(exposure_ms=t, set_value=t, set_unit="ms", order=order, covers=())
        for order, t in enumerate(_TIMES_MS, start=1)
    )
    return replace(plan, views=tuple(replace(view, exposures=exposures) for view in plan.views))


@contextmanager
def _server(folder: Path) -> Iterator[tuple[subprocess.Popen[bytes], httpx.Client]]:
    """Run ``exposight serve``, and give the process and a client."""
    words = ["serve", str(folder), "--port", "0", "--workers", "1"]
    process = subprocess.Popen(
        [sys.executable, "-m", "exposight", *words],
        stdout=subprocess.PIPE,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))},
    )
    assert process.stdout is not None
    try:
        address = next(filter(None, map(_address, iter(process.stdout.readline, b""))))
        with httpx.Client(base_url=address, timeout=60.0) as client:
            yield process, client
    finally:
        process.kill()
        process.wait()
        process.stdout.close()


def _go_on(client: httpx.Client, name: str) -> None:
    """Start a run, or continue it."""
    answer = client.get(f"/v1/runs/{name}")
    if answer.status_code == 404:
        driver = {"kind": "replay", "recording": "whole"}
        request = {"name": name, "plan": "plan.json", "driver": driver}
        client.post("/v1/runs", json=request).raise_for_status()
        return
    deadline = time.monotonic() + 10.0
    while (state := answer.json()["state"]) not in _ENDED:  # the killed server's child is ending
        if time.monotonic() > deadline:
            msg = f"run {name} is {state} without a server"
            raise RuntimeError(msg)
        time.sleep(0.02)
        answer = client.get(f"/v1/runs/{name}")
    if state != "finished":
        client.post(f"/v1/runs/{name}/continue").raise_for_status()


def _ends(
    client: httpx.Client, name: str, n_events: int | None = None, pause_s: float = 0.0
) -> bool:
    """Wait until a run has ended, or told so many events more; say whether it has ended."""
    first, deadline = None, time.monotonic() + 120.0
    while True:
        state = client.get(f"/v1/runs/{name}").raise_for_status().json()
        first = state["last_seq"] if first is None else first
        if state["state"] == "finished":
            return True
        if state["state"] in _ENDED or time.monotonic() > deadline:
            msg = f"run {name} is {state['state']}: {state['error']}"
            raise RuntimeError(msg)
        if n_events is not None and state["last_seq"] - first >= n_events:
            time.sleep(pause_s)
            return False
        time.sleep(0.02)


def _captures(campaign: Path) -> dict[str, str]:
    """Return checksums of the captures' files."""
    return {
        str(path.relative_to(campaign)): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in sorted((campaign / "captures").glob("[0-9]*/*"))
    }


def _content(campaign: Path) -> dict[str, str]:
    """Return checksums of the captures' files, and what was decided and achieved."""
    texts = {name: (campaign / name).read_text() for name in (DECISIONS_FILE, OUTCOMES_FILE)}
    return {**_captures(campaign), **texts}


def _differences(one: dict[str, str], other: dict[str, str]) -> int:
    return sum(one.get(path) != other.get(path) for path in {*one, *other})


def _repeated(run: Path) -> int:
    """Return how many decisions a run's events tell twice, or not at all."""
    events = [json.loads(line) for line in (run / "events.jsonl").read_text().splitlines()]
    numbers = [each["data"]["number"] for each in events if each["kind"] == "decision"]
    return abs(len(numbers) - len(set(numbers))) + len(set(range(len(numbers))) - set(numbers))


def _address(line: bytes) -> str:
    """Return the address in a line of output; an empty text where there is none."""
    words = [word for word in line.decode().split() if word.startswith("http://")]
    return words[0] if words else ""
