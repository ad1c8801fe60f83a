"""Runs over HTTP, by one server and by several on the same folder."""

import json
import os
import signal
import subprocess
import sys
import threading
import time
from contextlib import contextmanager

import httpx
import pytest
from tests.service.run_cases import ENDED, await_state, captured, request_of, serving_here

from exposight.service.guard import Limits
from exposight.service.run_files import RunState


@pytest.fixture
def served(run_folder):
    """Return the folder to measure in."""
    return run_folder


@pytest.fixture
def client(served):
    """Return a client of the folder."""
    with serving_here(served) as opened:
        yield opened


def state_of(client, name):
    """Return how a run stands."""
    return RunState(**client.get(f"/v1/runs/{name}").raise_for_status().json())


def started(client, name="one", **changes):
    answer = client.post("/v1/runs", json=request_of(name, **changes))
    assert answer.status_code == 201, answer.text
    return answer.json()


@contextmanager
def serving(folder, workers=2):
    """Run the command as a process, and give its address."""
    command = [sys.executable, "-m", "exposight", "serve", str(folder), "--port", "0"]
    process = subprocess.Popen(
        [*command, "--workers", str(workers)], stdout=subprocess.PIPE, stderr=subprocess.STDOUT
    )
    try:
        address = next(
            word
            for line in iter(process.stdout.readline, b"")
            for word in line.decode().split()
            if word.startswith("http://127.0.0.1")
        )
        yield process, address
    finally:
        process.kill()
        process.wait()
        process.stdout.close()


def test_a_run_from_start_to_report(client, served):
    state = started(client)
    assert state["campaign"] == "runs/one/campaign"
    await_state(lambda: state_of(client, "one"))
    answer = client.get("/v1/runs/one/events", params={"after": 0}).json()
    assert answer["state"]["state"] == "finished"
    assert [each["seq"] for each in answer["events"]] == list(range(1, 1 + len(answer["events"])))
    last = answer["events"][-1]["seq"]
    later = client.get("/v1/runs/one/events", params={"after": last - 2}).json()["events"]
    assert later == answer["events"][-2:]
    some = client.get("/v1/runs/one/events", params={"limit": 3}).json()["events"]
    assert some == answer["events"][:3]
    assert [each["name"] for each in client.get("/v1/runs").json()["runs"]] == ["one"]
    page = client.get("/v1/runs/one/report")
    assert page.headers["content-type"].startswith("text/html")
    assert "<title>" in page.text
    assert "b1" in page.text
    began = time.perf_counter()
    assert client.get("/v1/runs/one/report").text == page.text
    assert time.perf_counter() - began < 1.0  # it is kept
    assert client.get(f"/v1/campaigns/{state['campaign']}").json()["n_captures"] == 3


def test_a_report_of_a_run_without_clouds_has_its_rows(client):
    started(client, clouds=False)
    await_state(lambda: state_of(client, "one"))
    assert "b1" in client.get("/v1/runs/one/report").text


def test_a_report_that_cannot_be_made_yet_says_why(client, served):
    started(client)
    await_state(lambda: state_of(client, "one"))
    for path in sorted((served / "runs/one/campaign/captures").glob("*/*")):
        path.unlink()
    for path in (served / "runs/one/campaign/captures").glob("*"):
        path.rmdir()
    answer = client.get("/v1/runs/one/report")
    assert answer.status_code == 409
    assert "no report" in answer.json()["error"]


def test_a_report_that_takes_too_long_is_refused(served):
    with serving_here(served, limits=Limits(request_s=0.05)) as client:
        started(client)
        await_state(lambda: state_of(client, "one"))
        answer = client.get("/v1/runs/one/report")
    assert answer.status_code == 409
    assert "0.05 s" in answer.json()["error"]


def test_two_clients_start_the_same_run(client):
    answers = []
    post = lambda: answers.append(client.post("/v1/runs", json=request_of("race")))  # noqa: E731
    threads = [threading.Thread(target=post) for _ in range(2)]
    for each in threads:
        each.start()
    for each in threads:
        each.join()
    first, second = sorted(answers, key=lambda each: each.status_code)
    assert (first.status_code, second.status_code) == (201, 409)
    assert second.json()["facts"]["state"]["name"] == "race"
    await_state(lambda: state_of(client, "race"))


@pytest.mark.parametrize("action", ["pause", "stop", "continue"])
def test_a_finished_run_can_be_neither_paused_nor_continued(client, action):
    started(client)
    await_state(lambda: state_of(client, "one"))
    answer = client.post(f"/v1/runs/one/{action}")
    assert answer.status_code == 409
    assert answer.json()["facts"]["state"]["state"] == "finished"


@pytest.mark.parametrize(
    ("changes", "status"),
    [
        ({"name": "../x"}, 422),
        ({"name": "a b"}, 422),
        ({"name": "n" * 65}, 422),
        ({"name": 3}, 422),
        ({"plan": "/etc/passwd"}, 422),
        ({"plan": "../../etc/passwd"}, 422),
        ({"plan": "none.json"}, 404),
        ({"plan": "recorded/sensor.json"}, 422),
        ({"plan": "scene"}, 422),
        ({"models": "none"}, 404),
        ({"driver": {"kind": "magic"}}, 422),
        ({"driver": {"kind": "simulated", "lamp_power": -1}}, 422),
        ({"driver": {"kind": "replay"}}, 422),
        ({"driver": {"kind": "replay", "recording": "scene"}}, 404),
        ({"plan": "sheet.toml", "driver": {"kind": "simulated", "seed": 1}}, 422),
        ({"plan": "sheet.toml", "models": "models"}, 422),
        ({"colour": "red"}, 422),
    ],
)
def test_requests_that_cannot_be_are_refused(client, served, changes, status):
    answer = client.post("/v1/runs", json=request_of(**changes))
    assert answer.status_code == status, answer.text
    assert set(answer.json()) == {"error", "kind", "facts"}
    assert client.get("/v1/runs").json() == {"runs": []}


@pytest.mark.parametrize(
    ("media_type", "body", "status"),
    [
        ("text/plain", b"{}", 415),
        ("application/json", b"[" * 10_000, 422),
        ("application/json", b"[" * 100_000, 413),
        ("application/json", b'{"name": "a", "name": "b"}', 422),
    ],
)
def test_bodies_are_read_strictly(client, media_type, body, status):
    answer = client.post("/v1/runs", content=body, headers={"Content-Type": media_type})
    assert answer.status_code == status
    assert "b'" not in answer.text
    assert "missing" not in answer.text  # it is the body's form that is refused
    assert client.post("/v1/runs/none/stop").status_code == 404  # needs no body


@pytest.mark.parametrize("path", ["", "/events", "/stream", "/report"])
def test_unknown_runs_are_not_found(client, path):
    for name in ("none", "..%2f..", "%00", "ä" * 200, "x" * 300):
        assert client.get(f"/v1/runs/{name}{path}").status_code == 404


@pytest.mark.parametrize("query", [{"after": -1}, {"after": "x"}, {"after": 10**30}, {"limit": 0}])
def test_impossible_numbers_of_events_are_refused(client, query):
    started(client)
    assert client.get("/v1/runs/one/events", params=query).status_code == 422
    await_state(lambda: state_of(client, "one"))


def test_how_a_run_stands_is_told_within_milliseconds(client):
    started(client)
    last = await_state(lambda: state_of(client, "one")).last_seq
    for path in ("/v1/runs/one", f"/v1/runs/one/events?after={last}", "/v1/runs"):
        times_s = []
        for _ in range(20):
            began = time.perf_counter()
            client.get(path)
            times_s.append(time.perf_counter() - began)
        assert min(times_s) < 0.01, path


def messages(lines, n):
    """Return n messages of a stream."""
    found, number = [], None
    for line in lines:
        if line.startswith("id: "):
            number = int(line[4:])
        elif line.startswith("data: ") and number is not None:
            found.append((number, json.loads(line[6:])))
            number = None
            if len(found) == n:
                break
    return found


def test_two_workers_answer_for_all_runs_and_streams_go_on_where_they_were(served, sheet_run):
    with serving(served) as (_, address):
        clients = [httpx.Client(base_url=address, timeout=30) for _ in range(4)]
        assert clients[0].post("/v1/runs", json=sheet_run).status_code == 201
        with clients[1].stream("GET", "/v1/runs/sheet/stream") as stream:
            first = messages(stream.iter_lines(), 5)
        assert [number for number, _ in first] == [1, 2, 3, 4, 5]
        assert all(number == event["seq"] for number, event in first)
        known = {"Last-Event-ID": "3"}
        with clients[2].stream("GET", "/v1/runs/sheet/stream?after=1", headers=known) as stream:
            again = messages(stream.iter_lines(), 4)
        assert [number for number, _ in again] == [4, 5, 6, 7]
        assert again[:2] == first[3:]
        for each in clients:  # on connections of different workers
            each.post("/v1/runs/sheet/pause").raise_for_status()
        await_state(lambda: state_of(clients[3], "sheet"), {"paused"})
        assert {state_of(each, "sheet").state for each in clients} == {"paused"}
        assert clients[2].post("/v1/runs/sheet/continue").status_code == 200
        await_state(lambda: state_of(clients[1], "sheet"))
        for each in clients:
            each.close()


@pytest.mark.slow
def test_a_killed_server_loses_nothing(served, sheet_run, sheet_expected):
    """Killed at random instants it is started again, and the run continued."""
    campaign, before = served / "runs/sheet/campaign", {}
    for seconds in (0.3, 1.2, 2.0, None):
        with (
            serving(served, workers=1) as (process, address),
            httpx.Client(base_url=address, timeout=30) as client,
        ):
            assert captured(campaign).items() >= before.items()
            if client.get("/v1/runs/sheet").status_code == 404:
                client.post("/v1/runs", json=sheet_run).raise_for_status()
            elif await_state(lambda: state_of(client, "sheet")).state != "finished":
                client.post("/v1/runs/sheet/continue").raise_for_status()
            if seconds is None:
                assert await_state(lambda: state_of(client, "sheet"), ENDED).state == "finished"
                break
            time.sleep(seconds)
            os.kill(process.pid, signal.SIGKILL)
            process.wait()
        before = captured(campaign)
    assert captured(campaign) == sheet_expected


def test_a_report_leaves_out_an_unfinished_capture(client, served):
    started(client)
    await_state(lambda: state_of(client, "one"))
    (served / "runs/one/campaign/captures/000007").mkdir()
    answer = client.get("/v1/runs/one/report")
    assert answer.status_code == 200, answer.text
