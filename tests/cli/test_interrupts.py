"""Ctrl-C and SIGTERM: a line and the status that shells expect, no traceback, nothing left."""

import json
import os
import signal
import subprocess
import sys

import pytest

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="Ctrl-C is another signal there")

MESSAGE = "stopped by Ctrl-C before anything was begun"


def interrupted_at(module, *words, by=signal.SIGINT):
    """Run the program and interrupt it as soon as it has imported a module."""
    process = subprocess.Popen(
        [sys.executable, "-X", "importtime", "-m", "exposight", *words],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        encoding="utf-8",
        env={**os.environ, "PYTHONUNBUFFERED": "1"},
    )
    try:
        assert process.stderr is not None
        for line in process.stderr:
            if line.rpartition("|")[2].strip() == module:
                process.send_signal(by)
                break
        stdout, stderr = process.communicate(timeout=60)
    finally:
        process.kill()
    lines = [line for line in stderr.splitlines() if not line.startswith("import time:")]
    return process.returncode, stdout, lines


@pytest.mark.parametrize("module", ["cyclopts", "numpy.linalg", "numba.core.types", "cv2"])
def test_while_modules_are_imported(module):
    status, stdout, told = interrupted_at(module, "observe", "none")
    assert status == 130
    assert stdout == ""
    assert told == [f"error: {MESSAGE}"]


def test_sigterm_while_modules_are_imported():
    status, stdout, told = interrupted_at("numpy.linalg", "observe", "none", by=signal.SIGTERM)
    assert status == 143
    assert stdout == ""
    assert told == ["error: stopped by SIGTERM before anything was begun"]


WRITER = """
import sys, time
from pathlib import Path
from exposight.cli import main

def stop(path, data):
    print("writing", flush=True)
    time.sleep(60)

Path.write_bytes = stop
sys.exit(main(sys.argv[1:]))
"""


@pytest.mark.parametrize(("by", "status"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_while_a_command_writes_nothing_is_left(tmp_path, by, status):
    words = ["sensor", "--resolution", "100", "80", "--field-of-view", "400", "300", "600"]
    words += ["-o", str(tmp_path / "sensor.json"), "--exposures", "1", "100", "--name", "s"]
    words += ["--working-distance", "500", "1000", "--json"]
    command = [sys.executable, "-c", WRITER, *words]
    with subprocess.Popen(command, stdout=subprocess.PIPE, encoding="utf-8") as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "writing\n"
        process.send_signal(by)
        error = json.loads(process.stdout.read())["error"]
    assert process.returncode == status
    name = {signal.SIGINT: "Ctrl-C", signal.SIGTERM: "SIGTERM"}[by]
    message = f"stopped by {name}; what was finished before is kept"
    assert error == {"type": "Interrupted", "message": message}
    assert list(tmp_path.iterdir()) == []


def test_for_machines():
    status, stdout, told = interrupted_at("numpy.linalg", "observe", "none", "--json")
    assert status == 130
    assert json.loads(stdout) == {"error": {"type": "Interrupted", "message": MESSAGE}}
    assert told == []


def test_a_program_that_ignores_interrupts_keeps_doing_so():
    script = (
        "import os, signal\n"
        "from exposight.cli.interrupts import ended_by_interrupts\n"
        "signal.signal(signal.SIGINT, signal.SIG_IGN)\n"
        "with ended_by_interrupts():\n"
        "    os.kill(os.getpid(), signal.SIGINT)\n"
        "print('on')\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, encoding="utf-8", check=False
    )
    assert (done.returncode, done.stdout) == (0, "on\n")


def test_afterwards_interrupts_are_python_s_again():
    script = (
        "import os, signal\n"
        "from exposight.cli.interrupts import ended_by_interrupts\n"
        "with ended_by_interrupts():\n"
        "    pass\n"
        "try:\n"
        "    os.kill(os.getpid(), signal.SIGINT)\n"
        "except KeyboardInterrupt:\n"
        "    print('heard')\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, encoding="utf-8", check=False
    )
    assert (done.returncode, done.stdout) == (0, "heard\n")
