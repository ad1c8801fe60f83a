"""A writer that is killed, without a chance to clean up, at each of its steps on the disk."""

import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from exposight.cell import CampaignFolder, CampaignWriter
from exposight.errors import MissingFileError
from exposight.files import is_unfinished

EXPOSURES = (20.0, 10.0)

WRITER = """
import importlib.util, os, signal, sys
from pathlib import Path

spec = importlib.util.spec_from_file_location("cell_conftest", sys.argv[1])
cell = importlib.util.module_from_spec(spec)
spec.loader.exec_module(cell)
from exposight.cell import CampaignWriter


def fill(folder, exposures):
    arguments = dict(name="door", sensor=cell.small_sensor(), part=cell.small_part())
    with CampaignWriter.open_or_create(Path(folder), **arguments) as writer:
        for exposure in exposures:
            writer.add(cell.small_capture(float(exposure)))
"""

AT_EVERY_STEP = """
STEPS = {"open", "os.mkdir", "os.rename", "os.remove", "os.rmdir"}
WRITE = Path.write_bytes


def kill_at(last_step, folder):
    step = 0

    def count(event, arguments):
        nonlocal step
        if event in STEPS and str(arguments[0]).startswith(folder):
            step += 1
            if step == last_step:
                os.kill(os.getpid(), signal.SIGKILL)

    def write_half(path, data):  # every other run dies in the middle of a file, not before it
        nonlocal step
        if step == last_step - 1 and last_step % 2:
            WRITE(path, data[: len(data) // 2])
            os.kill(os.getpid(), signal.SIGKILL)
        return WRITE(path, data)

    Path.write_bytes = write_half
    sys.addaudithook(count)


for step in range(1, 1000):
    folder = os.path.join(sys.argv[2], f"{step:03d}")
    child = os.fork()
    if not child:
        kill_at(step, folder)
        fill(folder, map(float, sys.argv[3:]))
        os._exit(0)
    if not os.WIFSIGNALED(os.waitpid(child, 0)[1]):
        break
"""

WITHOUT_END = """
fill(sys.argv[2], range(1, 1000))
"""

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(sys.platform == "win32", reason="SIGKILL and fork are POSIX"),
]


def command(script: str, *arguments: object) -> list[str]:
    conftest = Path(__file__).with_name("conftest.py")
    return [sys.executable, "-c", WRITER + script, str(conftest), *map(str, arguments)]


@pytest.fixture(scope="module")
def interrupted(tmp_path_factory) -> list[Path]:
    """Folders left by writers killed at their first, second, … step; the last one got through."""
    root = tmp_path_factory.mktemp("interrupted")
    subprocess.run(command(AT_EVERY_STEP, root, *EXPOSURES), check=True, timeout=300)
    return sorted(root.iterdir())


def exposures_in(folder: Path) -> list[float]:
    try:
        campaign = CampaignFolder(folder)
    except MissingFileError:
        return []  # killed before the campaign was made
    return [capture.exposure_ms for capture in campaign.captures()]


def test_the_writer_was_killed_at_many_moments(interrupted):
    assert len(interrupted) > 25
    assert exposures_in(interrupted[-1]) == list(EXPOSURES)
    halves = [any(map(is_unfinished, folder.rglob("*"))) for folder in interrupted]
    assert sum(halves) > 10


def test_whatever_was_complete_is_readable(interrupted):
    found = [exposures_in(folder) for folder in interrupted]
    assert all(some == list(EXPOSURES[: len(some)]) for some in found)
    assert [len(some) for some in found] == sorted(len(some) for some in found)


def test_going_on_completes_the_campaign(interrupted, make_sensor, make_part, make_capture):
    arguments = {"name": "door", "sensor": make_sensor(), "part": make_part()}
    for folder in interrupted:
        with CampaignWriter.open_or_create(folder, **arguments) as writer:
            for exposure in EXPOSURES:
                if not writer.has("v1", exposure):
                    writer.add(make_capture(exposure))
        assert exposures_in(folder) == list(EXPOSURES)
        assert not any(map(is_unfinished, folder.rglob("*")))


def test_a_kill_from_outside_loses_nothing_that_was_complete(tmp_path, make_capture):
    folder = tmp_path / "campaign"
    writer = subprocess.Popen(command(WITHOUT_END, folder))
    deadline = time.monotonic() + 60
    while not (folder / "captures" / "000020").exists():
        assert writer.poll() is None
        assert time.monotonic() < deadline
        time.sleep(0.001)
    writer.send_signal(signal.SIGKILL)
    writer.wait()
    captures = list(CampaignFolder(folder).captures())
    assert len(captures) > 20
    for number, capture in enumerate(captures, start=1):
        np.testing.assert_array_equal(capture.image, make_capture(float(number)).image)
