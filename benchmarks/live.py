"""The service, the live page and cameras on a network, measured over loopback.

Run with ``make bench NAME=live``, on an otherwise idle machine: 10 000 recommendations at new poses
by four clients, schemathesis' requests made of the interface's description, servers killed in
runs, a cell's cameras read and unplugged, and the page drawn in Chromium. The folder that is served
is made once and kept in the cache. A part of it: ``python -m benchmarks.live page``, of `SECTIONS`.
"""

from __future__ import annotations

import sys
import tempfile
import time
from collections.abc import Callable, Mapping
from pathlib import Path

import httpx

from benchmarks import live_gige, live_page, live_runs, live_service
from benchmarks.measuring import Figure, at_least, at_most, publish, say
from exposight.twin.part.car_door import cache_folder

_RUN_S = 300.0
_ENDED = frozenset({"finished", "failed", "stopped", "interrupted"})


def service_figures() -> list[Figure]:
    """Time recommendations, compare answers with the library's, and send odd requests."""
    folder = _served()
    say("asking for 10 000 recommendations")
    times = live_service.recommending(folder)
    equal = live_service.library_equal(folder)["library_equal"]
    say("sending schemathesis' requests")
    cases = live_service.openapi(folder)
    return [
        at_most("recommend_p50_ms", times["recommend_p50_ms"], 10.0, "ms"),
        at_most("recommend_p99_ms", times["recommend_p99_ms"], 40.0, "ms"),
        at_most("errors", times["errors"], 0),
        Figure(name="recommend_cpu_ms", value=times["recommend_cpu_ms"], unit="ms"),
        Figure(name="recommend_again_p50_ms", value=times["recommend_again_p50_ms"], unit="ms"),
        _true("library_equal", equal),
        at_least("openapi_cases", cases["openapi_cases"], 2000),
        at_most("server_errors", cases["server_errors"], 0),
    ]


def gige_figures() -> list[Figure]:
    """Compare frames over GigE Vision with the simulated cell's, and unplug a camera in a run."""
    say("serving the simulated cell as a GigE Vision camera")
    return [_true(name, value) for name, value in live_gige.gige_figures().items()]


def page_figures() -> list[Figure]:
    """Draw the page of a finished run of the door."""
    with live_service.server(_served()) as (address, _):
        found = live_page.measure_page(f"{address}/#run={_finished_run(address)}")
    return [
        at_most("page_load_s", found["page_load_s"], 1.5, "s"),
        Figure(name="part_turnable_s", value=found["part_turnable_s"], unit="s"),
        at_most("page_bytes_mb", found["page_bytes_mb"], 6.0, "MB"),
    ]


def kill_figures() -> list[Figure]:
    """Kill servers in runs."""
    say("killing servers in runs")
    with tempfile.TemporaryDirectory() as folder:
        found = live_runs.killed_service_lost(Path(folder))
    return [
        at_most("killed_service_lost", found["killed_service_lost"], 0),
        at_least("killed_in_runs", found["killed_in_runs"], 20),
    ]


SECTIONS: Mapping[str, Callable[[], list[Figure]]] = {
    "service": service_figures,
    "page": page_figures,
    "gige": gige_figures,
    "kills": kill_figures,
}


def _served() -> Path:
    return live_service.served_folder(cache_folder() / "live-bench")


def _finished_run(address: str) -> str:
    """Return the name of a run in the simulated cell that has ended, made where there is none."""
    name, deadline = "door", time.monotonic() + _RUN_S
    with httpx.Client(base_url=address, timeout=60.0) as client:
        answer = client.get(f"/v1/runs/{name}")
        if answer.status_code == 404:
            say("measuring the door by the service")
            wanted = {"name": name, "plan": "plan.json", "models": "models"}
            driver = {"kind": "simulated", "rings_only": True}
            client.post("/v1/runs", json={**wanted, "driver": driver}).raise_for_status()
        elif answer.json()["state"] in _ENDED - {"finished"}:
            client.post(f"/v1/runs/{name}/continue").raise_for_status()
        while (state := client.get(f"/v1/runs/{name}").json())["state"] != "finished":
            if state["state"] in _ENDED or time.monotonic() > deadline:
                msg = f"run {name} is {state['state']}: {state['error']}"
                raise RuntimeError(msg)
            time.sleep(0.5)
    return name


def _true(name: str, value: bool | None) -> Figure:
    return Figure(name=name, value=value, mark="true", met=value is True)


def main() -> None:
    """Print all figures, or those of the sections that are named."""
    chosen = sys.argv[1:] or list(SECTIONS)
    publish("live", [figure for name in chosen for figure in SECTIONS[name]()])


if __name__ == "__main__":
    main()
