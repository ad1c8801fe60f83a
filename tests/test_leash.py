"""Processes on a leash end with the one that began them, also where no thread of theirs can act."""

import os
import subprocess
import sys
import time

import pytest

from exposight import leash

SOON_S = 20.0
"""Ending takes a fraction of a second; a busy machine may take longer to get round to it."""

BUSY = """
import ctypes
print("busy", flush=True)
ctypes.PyDLL(None).sleep(60)  # holds the interpreter, as a compiled loop does
"""
PARENT = """
import subprocess, sys, time
from exposight.leash import leashed
subprocess.Popen(leashed(sys.argv[1], "word"), start_new_session=True)
time.sleep(60)
"""


@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere it has to look itself")
def test_a_busy_process_ends_when_its_parent_is_killed(tmp_path):
    (tmp_path / "busy.py").write_text(BUSY)
    command = [sys.executable, "-c", PARENT, str(tmp_path / "busy.py")]
    with subprocess.Popen(command, stdout=subprocess.PIPE) as parent:
        assert parent.stdout is not None
        assert parent.stdout.readline() == b"busy\n"
        parent.kill()
        start = time.monotonic()
        parent.stdout.read()  # ends when nobody holds its other end any more
    assert time.monotonic() - start < SOON_S


@pytest.mark.skipif(sys.platform == "win32", reason="a parent's number outlives it there")
@pytest.mark.parametrize("platform", ["linux", "darwin"])
def test_a_process_whose_parent_died_before_ends_at_once(monkeypatch, platform):
    class Ended(Exception):
        pass

    def end(_status):
        raise Ended

    monkeypatch.setattr(os, "_exit", end)
    monkeypatch.setattr(sys, "platform", platform)
    monkeypatch.setattr(leash, "_look_for", lambda _parent: None)
    monkeypatch.setattr(leash, "_PR_SET_PDEATHSIG", 0)  # this process stays as it is
    with pytest.raises(Ended):
        leash.end_with_parent(os.getppid() + 1)


def test_where_the_system_does_not_tell_a_process_looks_for_its_parent(monkeypatch):
    class Ended(Exception):
        pass

    def end(_status):
        raise Ended

    parents = iter([7, 7, 1])
    monkeypatch.setattr(os, "getppid", lambda: next(parents))
    monkeypatch.setattr(os, "_exit", end)
    monkeypatch.setattr(time, "sleep", lambda _seconds: None)
    with pytest.raises(Ended):
        leash._look_for(7)
    assert next(parents, None) is None
