"""The installed program itself: as a process of its own."""

import json
import os
import re
import signal
import subprocess
import sys

import pytest

import exposight

ENVIRONMENT = {**os.environ, "PYTHONIOENCODING": "utf-8", "COLUMNS": "80"}


def program(*arguments, **options):
    return subprocess.run(
        [sys.executable, "-m", "exposight", *map(str, arguments)],
        capture_output=True,
        encoding="utf-8",
        timeout=100,
        check=False,
        env=ENVIRONMENT,
        **options,
    )


def test_version():
    result = program("--version")
    assert result.returncode == 0
    assert result.stdout == f"exposight {exposight.__version__}\n"


@pytest.mark.slow
def test_json_is_all_there_is_on_standard_output(campaign, tmp_path):
    result = program("observe", campaign, "-o", tmp_path / "o.csv", "--json")
    assert result.returncode == 0, result.stderr
    assert json.loads(result.stdout)["rows"] == 234


def test_an_error_has_no_traceback(tmp_path):
    result = program("info", tmp_path / "none")
    assert result.returncode == 1
    assert result.stdout == ""
    assert result.stderr == (
        f"error: {tmp_path / 'none'}: no such file or folder, nor a plan or sensor of that name\n"
    )


@pytest.mark.skipif(sys.platform == "win32", reason="it has no SIGPIPE")
@pytest.mark.parametrize("words", [("simulate", "--list"), ("simulate", "--list", "--json")])
def test_a_reader_that_leaves_is_no_error(words):
    reader, writer = os.pipe()
    os.close(reader)
    try:
        done = subprocess.run(
            [sys.executable, "-m", "exposight", *words],
            stdout=writer,
            stderr=subprocess.PIPE,
            timeout=100,
            check=False,
            env=ENVIRONMENT,
        )
    finally:
        os.close(writer)
    assert (done.returncode, done.stderr) == (141, b"")  # as of a program that SIGPIPE ends


@pytest.mark.skipif(sys.platform == "win32", reason="Ctrl-C is another signal there")
@pytest.mark.slow
def test_ctrl_c_ends_in_a_line(observations, tmp_path):
    training = ("train", observations, "-m", "q_k6", "-o", tmp_path, "--restarts", "10000")
    process = subprocess.Popen(
        [sys.executable, "-m", "exposight", *map(str, training)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        encoding="utf-8",
        env=ENVIRONMENT,
    )
    try:
        assert process.stderr is not None
        assert any(line == "training q_k6 …\n" for line in process.stderr)
        process.send_signal(signal.SIGINT)
        stdout, stderr = process.communicate(timeout=60)
    finally:
        process.kill()
    assert process.returncode == 130
    assert stdout == ""
    assert re.fullmatch(r"error: stopped by Ctrl-C \(training q_k6, \d+ of 10000\)\n", stderr)


@pytest.mark.skipif(sys.platform == "win32", reason="it has no such encoding of its terminal")
@pytest.mark.slow
def test_a_terminal_without_greek_letters_is_no_error(models):
    pose = ("--i-avg", "100", "--x-mm", "0", "--y-mm", "0", "--z-mm", "0")
    model = models / "q_k4.exposight-model"
    result = subprocess.run(
        [sys.executable, "-m", "exposight", "predict", str(model), *pose],
        capture_output=True,
        timeout=100,
        check=False,
        env={**os.environ, "PYTHONIOENCODING": "latin-1"},
    )
    assert result.returncode == 0
    assert b"2? band" in result.stdout
