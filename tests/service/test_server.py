"""The server's processes: workers, signals, limits and clients that misbehave."""

import contextlib
import http.client
import json
import os
import signal
import socket
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from urllib.parse import urlsplit

import pytest

from exposight.errors import ContradictionError, InputError, MissingFileError, PoseError
from exposight.service.client import Client, ServiceError

TOKEN = "a-token-of-enough-characters"
ABOUT = {"models": "models", "campaign": "campaign", "view": "v1"}

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="looks at processes in /proc")


def connection(address, timeout=20.0):
    return http.client.HTTPConnection(urlsplit(address).netloc, timeout=timeout)


def raw(address):
    host, port = urlsplit(address).hostname, urlsplit(address).port
    return socket.create_connection((host, port), timeout=20.0)


def workers_of(process):
    children = Path(f"/proc/{process}/task/{process}/children").read_text().split()
    return sorted(map(int, children))


def listening_process(address):
    """The process that has the listening socket, whose children are the workers."""
    port = f"{urlsplit(address).port:04X}"
    lines = Path("/proc/net/tcp").read_text().splitlines()[1:]
    inode = next(
        fields[9]
        for fields in map(str.split, lines)
        if fields[1].endswith(f":{port}") and fields[3] == "0A"
    )
    for each in Path("/proc").glob("[0-9]*"):
        with contextlib.suppress(OSError):
            if any(str(fd.readlink()) == f"socket:[{inode}]" for fd in (each / "fd").iterdir()):
                return int(each.name)
    raise AssertionError("nobody listens")


def connections_of(worker, address):
    """Number of the worker's connections to clients of the address."""
    port = f"{urlsplit(address).port:04X}"
    inodes = {
        fields[9]
        for fields in map(str.split, Path("/proc/net/tcp").read_text().splitlines()[1:])
        if fields[1].endswith(f":{port}") and fields[3] == "01"
    }
    count = 0
    for each in Path(f"/proc/{worker}/fd").iterdir():
        with contextlib.suppress(OSError):
            count += str(each.readlink()).removeprefix("socket:[").removesuffix("]") in inodes
    return count


def eventually(condition, seconds=20.0):
    deadline = time.monotonic() + seconds
    while time.monotonic() < deadline:
        if condition():
            return True
        time.sleep(0.02)
    return False


def test_connections_are_spread_evenly_over_the_workers(address):
    workers = workers_of(listening_process(address))
    assert len(workers) == 2
    for _ in range(5):
        clients = [connection(address) for _ in range(4)]
        for client in clients:
            client.request("GET", "/v1/plans")
            client.getresponse().read()
        assert [connections_of(each, address) for each in workers] == [2, 2]
        for client in clients:
            client.close()
        assert eventually(lambda: sum(connections_of(each, address) for each in workers) == 0)
        time.sleep(0.05)  # until the parent has heard of it


def test_many_clients_at_once_are_all_answered(address):
    def ask(_):
        with Client(address) as client:
            return client.recommend(**ABOUT)["exposures_ms"]

    with ThreadPoolExecutor(8) as pool:
        answers = list(pool.map(ask, range(40)))
    assert all(each == answers[0] for each in answers)


def test_a_worker_that_dies_is_begun_again(original, serving):
    with serving(original, workers=2) as address:
        parent = listening_process(address)
        before = workers_of(parent)
        os.kill(before[0], signal.SIGKILL)
        assert eventually(lambda: before[0] not in workers_of(parent))
        with Client(address) as client:  # by the other one
            assert client.health()["status"] == "ok"
        assert eventually(lambda: len(workers_of(parent)) == 2 and workers_of(parent) != before)
        with Client(address) as client:
            assert client.health()["status"] == "ok"


def test_workers_end_with_a_killed_parent(original, tmp_path):
    log = (tmp_path / "log").open("w")
    command = [sys.executable, "-m", "exposight", "serve", str(original), "--port", "0"]
    process = subprocess.Popen(command, stdout=log, stderr=log)
    assert eventually(lambda: "http" in (tmp_path / "log").read_text(), 60.0)
    workers = workers_of(process.pid)
    process.kill()
    process.wait()
    assert len(workers) == 2
    assert eventually(lambda: not any(Path(f"/proc/{each}/fd").exists() for each in workers))
    log.close()


def test_what_is_being_answered_is_finished_at_sigterm(original, serving):
    with serving(original, workers=1) as address, Client(address) as client:
        client.health()
        with ThreadPoolExecutor(1) as pool:
            answer = pool.submit(client.forecast, **ABOUT)
            time.sleep(0.01)
            os.kill(listening_process(address), signal.SIGTERM)
            assert answer.result()["features"]


def test_bodies_of_200_mb_are_refused_before_they_have_arrived(address):
    with raw(address) as client:
        client.sendall(
            b"POST /v1/observe HTTP/1.1\r\nHost: localhost\r\nContent-Type: multipart/form-data; "
            b"boundary=x\r\nContent-Length: 200000000\r\n\r\n"
        )
        assert client.recv(1000).startswith(b"HTTP/1.1 413")
    sent = 0
    with raw(address) as client:
        client.sendall(
            b"POST /v1/recommend HTTP/1.1\r\nHost: localhost\r\n"
            b"Content-Type: application/json\r\nTransfer-Encoding: chunked\r\n\r\n"
        )
        piece = b"100000\r\n" + bytes(0x100000) + b"\r\n"
        with contextlib.suppress(OSError):
            while sent < 200:
                client.sendall(piece)
                sent += 1
        with contextlib.suppress(OSError):
            assert b"413" in client.recv(1000)
    assert sent < 150


def test_a_client_that_sends_slowly_is_answered_408(address):
    with raw(address) as client:
        client.sendall(
            b"POST /v1/recommend HTTP/1.1\r\nHost: localhost\r\nContent-Type: application/json\r\n"
            b"Content-Length: 100\r\n\r\n{"
        )
        assert client.recv(1000).startswith(b"HTTP/1.1 408")


def test_a_client_that_never_sends_its_headers_is_left(address):
    with raw(address) as client:
        client.sendall(b"GET /v1/health HTTP/1.1\r\nHost: local")
        assert client.recv(1000) == b""


def test_a_header_without_end_is_not_taken(address):
    with raw(address) as client:
        client.sendall(b"GET /v1/health HTTP/1.1\r\nHost: localhost\r\nX: ")
        sent = 0
        with contextlib.suppress(ConnectionError):
            while sent < 5_000_000:
                sent += client.send(b"a" * 10_000)
                time.sleep(0.001)
        assert sent < 5_000_000
    with raw(address) as client:
        client.sendall(b"GET /v1/health HTTP/1.1\r\nHost: localhost\r\nX: " + b"a" * 65_536)
        assert client.recv(1000).startswith(b"HTTP/1.1 431 ")


def test_clients_that_leave_in_the_middle_do_no_harm(address):
    for _ in range(5):
        with raw(address) as client:
            client.sendall(
                b"POST /v1/observe HTTP/1.1\r\nHost: localhost\r\nContent-Type: "
                b"multipart/form-data; boundary=x\r\nContent-Length: 100000\r\n\r\n--x\r\n"
            )
        client = connection(address)
        client.request("POST", "/v1/forecast", json.dumps(ABOUT))
        client.close()
    with Client(address) as client:
        assert client.health()["status"] == "ok"


def test_no_http_at_all(address):
    for sent in (b"\x16\x03\x01\x02\x00", b"GARBAGE\r\n\r\n", b"GET / HTTP/9.9\r\n\r\n", b""):
        with raw(address) as client:
            client.sendall(sent)
            client.shutdown(socket.SHUT_WR)
            assert not client.recv(1000).startswith(b"HTTP/1.1 5")


def test_the_client_raises_what_the_library_raises(address, capture_files, capture_of):
    with Client(address) as client:
        with pytest.raises(MissingFileError, match="did you mean"):
            client.recommend("model", campaign="campaign", view="v1")
        with pytest.raises(PoseError):
            client.recommend("models", campaign="campaign", camera_from_part=[[1.0] * 4] * 4)
        with pytest.raises(InputError):
            client.recommend("models", campaign="campaign", veiw="v1")
        image, cloud = capture_files / "image.png", capture_files / "cloud.ply"
        pose = capture_of("v1", 8.0).camera_from_part.to_matrix()
        about = {"campaign": "campaign", "exposure_ms": 8.0}
        rows = client.observe(image, cloud, camera_from_part=pose, **about)["observations"]
        assert len(rows) == 13
        pose[2, 3] = 690.0
        with pytest.raises(ContradictionError) as caught:
            client.observe(image, cloud, camera_from_part=pose, **about)
        assert caught.value.contradictions[0].check
        assert client.models()[0]["name"] == "models"
        assert client.parts()[0]["part"] == "plate"
        assert client.plans()["exposure_plans"] == ["plan.json"]
    unreachable = pytest.raises(ServiceError, match="is the server running")
    with Client("http://127.0.0.1:9", timeout_s=2.0) as client, unreachable:
        client.health()


def test_the_client_sends_neither_files_that_are_missing_nor_poses_that_are_none(tmp_path):
    with Client("http://127.0.0.1:9") as client:
        with pytest.raises(MissingFileError, match="image"):
            client.observe(tmp_path / "none.png", tmp_path / "none.ply", campaign="campaign")
        for number in (float("nan"), float("inf")):
            with pytest.raises(PoseError):
                client.forecast("models", camera_from_part=[[number] * 4] * 4)


def test_a_token_is_asked_for_by_every_worker(original, serving, tmp_path):
    (tmp_path / "token.txt").write_text(TOKEN + "\n")
    with serving(original, "--token-file", str(tmp_path / "token.txt"), workers=1) as address:
        with Client(address, TOKEN) as client:
            assert client.health()["status"] == "ok"
        for token in (None, TOKEN[:-1], TOKEN + "x"):
            with Client(address, token) as client:
                with pytest.raises(ServiceError) as caught:
                    client.health()
                assert (caught.value.kind, caught.value.status) == ("NotAuthorised", 401)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--host", "0.0.0.0"], "token"),
        (["--token-file", "nothing.txt"], "nothing.txt"),
        (["--port", "70000"], "port"),
    ],
)
def test_calls_that_are_refused(run, original, options, words, monkeypatch):
    monkeypatch.delenv("EXPOSIGHT_TOKEN", raising=False)
    ended = run("serve", str(original), *options)
    assert ended.exit_code in {1, 2}
    assert words in ended.stderr


def test_short_tokens_and_ports_that_are_taken(run, original, monkeypatch, address):
    monkeypatch.setenv("EXPOSIGHT_TOKEN", "short")
    assert "16 or more" in run("serve", str(original)).stderr
    monkeypatch.delenv("EXPOSIGHT_TOKEN")
    ended = run("serve", str(original), "--port", str(urlsplit(address).port))
    assert "--port" in ended.stderr
    assert run("serve", str(original / "nothing")).exit_code == 2
