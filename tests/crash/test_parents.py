"""Commands with workers whose parent alone is ended: all processes are gone at once."""

import os
import signal
import subprocess
import sys
import time

import pytest
from tests.crash.commands import write_sheet
from tests.crash.crash_points import GONE_S, marked
from tests.crash.runner import MARK

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(sys.platform != "linux", reason="it looks into /proc"),
]

START_S = 240.0


@pytest.fixture(scope="module")
def sheet(tmp_path_factory):
    folder = tmp_path_factory.mktemp("sheet")
    write_sheet(folder)
    return folder


@pytest.mark.parametrize("after_s", [0.0, 0.7, 3.0])
@pytest.mark.parametrize(("by", "status"), [(signal.SIGKILL, -9), (signal.SIGTERM, 143)])
def test_workers_end_with_their_parent(sheet, tmp_path, by, status, after_s):
    words = ["simulate", sheet / "sheet.toml", "--scene", sheet / "scene", "-o", tmp_path / "out"]
    mark = f"{os.getpid()}-{tmp_path.name}"
    process = subprocess.Popen(
        [sys.executable, "-m", "exposight", *map(str, words), "--rings-only", "--workers", "2"],
        stderr=subprocess.PIPE,
        encoding="utf-8",
        env={**os.environ, MARK: mark},
    )
    until = time.monotonic() + START_S
    while sum("spawn_main" in each for each in marked(mark)) < 2:
        assert process.poll() is None
        assert time.monotonic() < until
        time.sleep(0.02)
    time.sleep(after_s)
    process.send_signal(by)
    _, told = process.communicate(timeout=60)
    ended = time.monotonic()
    if process.returncode == 0:
        pytest.skip("it was done before")
    assert process.returncode == status
    assert by == signal.SIGKILL or told.splitlines()[-1].startswith("error: stopped by SIGTERM")
    while left := marked(mark):
        assert time.monotonic() - ended < GONE_S, left
        time.sleep(0.02)
