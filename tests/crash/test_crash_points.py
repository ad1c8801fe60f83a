"""Commands are killed, and disks are full, at a few touches of the disk; `make crash`: at all."""

import sys

import pytest
from tests.crash.commands import COMMANDS
from tests.crash.crash_points import totals, try_commands, unsynced

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(sys.platform != "linux", reason="it forks, and looks into /proc"),
]


def test_nothing_is_torn_lost_or_left_behind():
    quick = [each for each in COMMANDS if each.most is None]
    found = try_commands(quick, 2, 1)
    assert not [fault for each in found for fault in each.faults]
    assert totals(found)["kills"] == 2 * len(quick)


RIGHT = [
    ("open", "/d/t", ""),
    ("fsync", "/d/t", ""),
    ("os.rename", "/d/t", "/d/name"),
    ("fsync", "/d", ""),
]


@pytest.mark.parametrize(
    ("missing", "said"),
    [(1, "before its content was on the disk"), (3, "not pushed to the disk after the names")],
)
def test_what_a_loss_of_power_may_cost_is_found(tmp_path, missing, said):
    assert not list(unsynced(RIGHT, tmp_path))
    (fault,) = unsynced([*RIGHT[:missing], *RIGHT[missing + 1 :]], tmp_path)
    assert said in fault


def test_a_file_written_under_its_final_name_is_found(tmp_path):
    (tmp_path / "name").touch()
    (fault,) = unsynced([("open", str(tmp_path / "name"), "")], tmp_path)
    assert "under its final name" in fault
