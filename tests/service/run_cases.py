"""Runs for tests: what is asked for, how it is waited for and compared, a server to ask."""

import hashlib
import socket
import threading
import time
from contextlib import contextmanager

import httpx
import uvicorn

from exposight.service.app import create_app

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
