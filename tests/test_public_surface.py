"""The names of ``import exposight as xs``: few, quick to import, each in its room."""

import subprocess
import sys

import pytest

import exposight

MOST_NAMES, MOST_SECONDS = 30, 0.1


def test_there_are_few_names():
    assert len(exposight.__all__) == len(set(exposight.__all__)) <= MOST_NAMES
    assert set(exposight.__all__) <= set(dir(exposight))


@pytest.mark.parametrize("name", exposight.__all__)
def test_every_name_is_there(name):
    assert getattr(exposight, name) is getattr(exposight, name)


def test_another_name_is_an_attribute_error():
    with pytest.raises(AttributeError, match="'exposight' has no attribute 'nothing'"):
        _ = exposight.nothing


def test_importing_loads_no_room_and_takes_no_time():
    script = (
        "import sys, time; start = time.perf_counter(); import exposight; "
        "print(time.perf_counter() - start, *(m for m in sys.modules if m.startswith('exposight')))"
    )
    seconds = []
    for _ in range(3):
        run = subprocess.run(
            [sys.executable, "-c", script], capture_output=True, text=True, check=True
        )
        took, *modules = run.stdout.split()
        assert set(modules) == {"exposight"}
        seconds.append(float(took))
    assert min(seconds) <= MOST_SECONDS
