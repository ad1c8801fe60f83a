"""A served folder: a plate's recording and plan, and a sheet that the simulated cell measures."""

import hashlib
import shutil
import socket
import threading
import time
from contextlib import contextmanager
from dataclasses import replace

import pytest

pytest.importorskip("fastapi")
pytest.importorskip("httpx")

import httpx
import uvicorn
from tests.measuring.conftest import PlateDriver, plate_exposure_plan

from exposight.measuring import measure, measure_adaptively
from exposight.planning import write_exposure_plan
from exposight.plans import read_plan, write_plan
from exposight.service.app import create_app
from exposight.twin import SimulatedCell

ENDED = frozenset({"stopped", "interrupted", "failed", "finished"})


def request_of(name="one", **changes):
    """Return a request for a run that replays the plate."""
    driver = {"kind": "replay", "recording": "recorded"}
    return {"name": name, "plan": "plan.json", "driver": driver, **changes}


def await_state(look, states=ENDED, timeout_s=60.0):
    """Return a run's state once it is one of these."""
    deadline = time.monotonic() + timeout_s
    while (state := look()).state not in states:
        assert time.monotonic() < deadline, state
        assert state.state not in ENDED, state
        time.sleep(0.02)
    return state


def captured(campaign):
    """Return checksums of what a campaign's captures hold, by path."""
    return {
        str(path.relative_to(campaign)): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in sorted((campaign / "captures").glob("[0-9]*/*"))
    }


@pytest.fixture(scope="session")
def folder_to_serve(tmp_path_factory, sheet_plan, scene):
    folder = tmp_path_factory.mktemp("served")
    plan = plate_exposure_plan()
    write_exposure_plan(folder / "plan.json", plan)
    measure_adaptively(plan, PlateDriver(), folder / "recorded", models=None)
    measure_adaptively(plan, PlateDriver(), folder / "whole", models=None)
    measure_adaptively(plan, PlateDriver(), folder / "expected", models=None)
    shutil.copytree(scene, folder / "scene")
    exposures_ms = tuple(map(float, range(30, 110, 20)))
    plane = replace(sheet_plan.planes[0], exposures_ms=exposures_ms)
    simulated = {**sheet_plan.simulated, "scene": "scene", "rings_only": True}
    write_plan(folder / "sheet.toml", replace(sheet_plan, planes=(plane,), simulated=simulated))
    plan = read_plan(folder / "sheet.toml")
    measure(plan, SimulatedCell.for_plan(plan, folder=folder), folder / "sheet-expected")
    return folder


@pytest.fixture
def served(folder_to_serve, tmp_path):
    """Return a copy of the folder, to be changed."""
    return shutil.copytree(folder_to_serve, tmp_path / "served")


@pytest.fixture
def sheet_run():
    """Return a request for a run that takes seconds."""
    driver = {"kind": "simulated"}
    return {"name": "sheet", "plan": "sheet.toml", "driver": driver}


@pytest.fixture(scope="session")
def sheet_expected(folder_to_serve):
    """Return what such a run captures where nothing interrupts it."""
    return captured(folder_to_serve / "sheet-expected")


@contextmanager
def serving_here(folder, **options):
    """Serve a folder by this process, and give a client."""
    config = uvicorn.Config(
        create_app(folder, **options), log_level="warning", lifespan="on", ws="none"
    )
    server, listener = uvicorn.Server(config), socket.create_server(("127.0.0.1", 0))
    listener.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)  # as the command's workers
    thread = threading.Thread(target=server.run, args=([listener],))
    thread.start()
    try:
        while not server.started:
            assert thread.is_alive()
            time.sleep(0.01)
        address = f"http://127.0.0.1:{listener.getsockname()[1]}"
        with httpx.Client(base_url=address, timeout=60) as client:
            yield client
    finally:
        server.should_exit = True
        thread.join(20)
        listener.close()


@pytest.fixture
def client(served):
    """Return a client of the folder."""
    with serving_here(served) as opened:
        yield opened
