"""The service over loopback: how fast it recommends, whether it says what the library says.

Functions for ``benchmarks.live``, each returns figures by name. The folder that is served is the
demonstration's campaign, simulated once, and models trained on it.
"""

from __future__ import annotations

import http.client
import json
import re
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from functools import partial
from multiprocessing import get_context
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import numpy as np

from benchmarks.measuring import say
from exposight.files import make_folder
from exposight.geometry import RigidTransform
from exposight.measuring import measure
from exposight.observing import open_campaign
from exposight.planning import ExposureLimits, SensorModels, plan, train, write_exposure_plan
from exposight.plans import PLANS
from exposight.service.questions import forecast_document, recommendation_document
from exposight.twin import SimulatedCell

REQUESTS, CLIENTS, WORKERS = 10_000, 4, 2
_EQUAL = 20
_EXAMPLES, _CASES_S = 40, 240
_START_S = 300.0
_ABOUT = {"models": "models", "campaign": "campaign"}


def served_folder(folder: Path) -> Path:
    """Make a folder with a campaign of the door's 13 features, models and a plan, once."""
    make_folder(folder)
    made = PLANS["demo"]
    driver = SimulatedCell.for_plan(made, rings_only=True)
    if not (folder / "plan.json").is_file():
        say("simulating the demonstration's campaign")
        measure(made, driver, folder / "campaign", workers=2)
        campaign = open_campaign(folder / "campaign")
        models = train(campaign.observe(), sensor=campaign.sensor)
        models.save(folder / "models")
        poses = {each.view: each.camera_from_part for each in campaign.descriptions()}
        views = dict(list(poses.items())[::5])
        planned = plan(models, campaign.part, views, sensor=campaign.sensor, time_limit_s=10.0)
        write_exposure_plan(folder / "plan.json", planned)
    return folder


@contextmanager
def server(folder: Path, *options: str, workers: int = WORKERS) -> Iterator[tuple[str, int]]:
    """Run the server, and yield its address and process number."""
    command = [sys.executable, "-m", "exposight", "serve", str(folder), "--port", "0"]
    with tempfile.TemporaryFile("w+") as log:
        process = subprocess.Popen(
            [*command, "--workers", str(workers), *options], stdout=log, stderr=log
        )
        try:
            yield _address(process, log), process.pid
        finally:
            process.terminate()
            process.wait(30)


def _address(process: subprocess.Popen[bytes], log: Any) -> str:
    deadline = time.monotonic() + _START_S
    while time.monotonic() < deadline and process.poll() is None:
        log.seek(0)
        if found := re.search(r"http://\S+", log.read()):
            return found.group()
        time.sleep(0.1)
    log.seek(0)
    msg = f"the server did not start: {log.read()}"
    raise RuntimeError(msg)


def random_poses(folder: Path, count: int, seed: int) -> Iterator[RigidTransform]:
    """Yield poses near those of the campaign, each of them new."""
    rng = np.random.default_rng(seed)
    campaign = open_campaign(folder / "campaign")
    poses = list({each.view: each.camera_from_part for each in campaign.descriptions()}.values())
    for _ in range(count):
        aside = RigidTransform.from_fanuc_wpr(rng.normal(0.0, 4.0, 3), *rng.normal(0.0, 1.0, 3))
        yield poses[rng.integers(len(poses))] @ aside


def recommending(folder: Path, requests: int = REQUESTS) -> dict[str, float]:
    """Measure recommendations at new poses, and at one that is asked for again and again."""
    bodies = [
        json.dumps({**_ABOUT, "camera_from_part": pose.to_matrix().tolist()}).encode()
        for pose in random_poses(folder, requests, seed=1)
    ]
    with server(folder) as (address, process), _clients() as pool:
        ask = partial(_asked, address)
        list(pool.map(ask, [bodies[:20]] * CLIENTS))
        cpu_s = _cpu_s(process)
        times, errors = _together(pool.map(ask, [bodies[i::CLIENTS] for i in range(CLIENTS)]))
        cpu_s = _cpu_s(process) - cpu_s
        again, more = _together(pool.map(ask, [[bodies[0]] * (requests // 20)] * CLIENTS))
    return {
        "recommend_p50_ms": float(np.percentile(times, 50)),
        "recommend_p99_ms": float(np.percentile(times, 99)),
        "recommend_cpu_ms": 1e3 * cpu_s / requests,
        "recommend_again_p50_ms": float(np.percentile(again, 50)),
        "errors": errors + more,
    }


def _clients() -> ProcessPoolExecutor:
    return ProcessPoolExecutor(CLIENTS, mp_context=get_context("spawn"))


def _asked(address: str, bodies: Sequence[bytes]) -> tuple[list[float], int]:
    """Ask by one connection that is kept open; return the times in ms, and how many failed."""
    place = urlsplit(address)
    head = f"POST /v1/recommend HTTP/1.1\r\nHost: {place.netloc}\r\n".encode()
    head += b"Content-Type: application/json\r\nContent-Length: "
    requests = [head + str(len(body)).encode() + b"\r\n\r\n" + body for body in bodies]
    times, errors = [], 0
    assert place.hostname is not None
    with socket.create_connection((place.hostname, place.port or 80), timeout=30.0) as connection:
        for request in requests:
            start = time.perf_counter()
            connection.sendall(request)
            errors += not _answered(connection)
            times.append(1e3 * (time.perf_counter() - start))
    return times, errors


def _answered(connection: socket.socket) -> bool:
    """Receive one answer whole, by plain sockets: the clients share the server's processors."""
    data = b""
    while (end := data.find(b"\r\n\r\n")) < 0:
        received = connection.recv(65536)
        if not received:
            return False
        data += received
    found = re.search(rb"content-length: (\d+)", data[:end].lower())
    left = (int(found[1]) if found else 0) - (len(data) - end - 4)
    while left > 0 and (received := connection.recv(65536)):
        left -= len(received)
    return data.startswith(b"HTTP/1.1 200 ") and found is not None and left == 0


def _together(parts: Any) -> tuple[list[float], int]:
    found = list(parts)
    return [each for times, _ in found for each in times], sum(errors for _, errors in found)


def _cpu_s(parent: int) -> float:
    """Return the processor time of a server's processes, s."""
    children = Path(f"/proc/{parent}/task/{parent}/children").read_text().split()
    ticks = 0
    for process in (parent, *children):
        fields = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()
        ticks += int(fields[11]) + int(fields[12])
    return ticks / 100.0


def library_equal(folder: Path) -> dict[str, bool]:
    """Compare answers at random poses with the library's, to the last bit."""
    models, campaign = SensorModels.load(folder / "models"), open_campaign(folder / "campaign")
    limits = ExposureLimits.of(campaign.sensor)
    equal = True
    with server(folder, workers=1) as (address, _):
        for pose in random_poses(folder, _EQUAL, seed=2):
            matrix = pose.to_matrix().tolist()
            view = campaign.view(RigidTransform.from_matrix(matrix))
            if not view.visible:
                continue
            forecast = models.forecast(view)
            hidden = {
                each.feature.name: each.visibility.value
                for each in view.features
                if each not in view.visible
            }
            expected = {
                "recommend": recommendation_document(models.recommend(view, limits)),
                "forecast": forecast_document(forecast, 0.9, hidden, "ms"),
            }
            for question, answer in expected.items():
                got = _answer(address, question, {**_ABOUT, "camera_from_part": matrix})
                equal &= got == json.loads(json.dumps(answer))
    return {"library_equal": equal}


def _answer(address: str, question: str, body: dict[str, Any]) -> Any:
    connection = http.client.HTTPConnection(urlsplit(address).netloc, timeout=30.0)
    headers = {"Content-Type": "application/json"}
    connection.request("POST", f"/v1/{question}", json.dumps(body), headers)
    answer = json.loads(connection.getresponse().read())
    connection.close()
    return answer


def openapi(folder: Path) -> dict[str, int]:
    """Send schemathesis' cases, made of the interface's description; count answers of 500."""
    program = _schemathesis()
    with (
        tempfile.TemporaryDirectory() as place,
        server(folder, "--max-seconds", "20") as (address, _),
    ):
        command = [
            *(str(program), "run", f"{address}/openapi.json", "--max-examples", str(_EXAMPLES)),
            *("--phases", "examples,coverage,fuzzing", "--checks", "not_a_server_error"),
            *("--continue-on-failure", "--max-time", str(_CASES_S), "--workers", "2"),
            *("--report", "ndjson", "--report-dir", place),
        ]
        subprocess.run(command, cwd=place, timeout=3 * _CASES_S, capture_output=True, check=False)
        statuses = [
            int(status)
            for file in Path(place).glob("*.ndjson")
            for status in re.findall(r'"status_code":\s*(\d+)', file.read_text())
        ]
    return {
        "openapi_cases": len(statuses),
        "server_errors": sum(status >= 500 for status in statuses),
    }


def _schemathesis() -> Path:
    """Return the program, in an environment of its own, made where it is absent."""
    environment = Path(sys.prefix) / "schemathesis"
    program = environment / "bin" / "schemathesis"
    if not program.is_file():
        say("installing schemathesis")
        subprocess.run([sys.executable, "-m", "venv", str(environment)], check=True)
        pip = [str(environment / "bin" / "python"), "-m", "pip", "install", "--quiet"]
        subprocess.run([*pip, "schemathesis>=4,<5"], check=True)
    return program


def main() -> None:
    """Print the figures."""
    folder = served_folder(Path(tempfile.gettempdir()) / "exposight-live-service")
    for part in (library_equal, recommending, openapi):
        say(json.dumps(part(folder)))


if __name__ == "__main__":
    main()
