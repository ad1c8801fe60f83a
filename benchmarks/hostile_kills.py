"""Every command killed at the touches of the disk that it writes with: whether anything is lost."""

from __future__ import annotations

import sys

from tests.crash.commands import COMMANDS
from tests.crash.crash_points import totals, try_commands

from benchmarks.measuring import Figure, at_least, at_most, say

KILLS = 500


def kill_figures(kills: int = KILLS) -> list[Figure]:
    """Kill commands, run them again, and count what was torn, lost or left behind."""
    quick = [each for each in COMMANDS if each.most is None]
    results = try_commands([each for each in COMMANDS if each.most], kills, 0)
    done = totals(results)["kills"]
    share = kills // 8  # many commands have fewer touches
    while done < kills:
        more = try_commands(quick, share, 1)
        results += more
        done += totals(more)["kills"]
    for found in results:
        for fault in found.faults:
            say(fault)
    total = totals(results)
    return [
        at_least("kills", total["kills"], kills),
        at_most("bytes_different", total["bytes_different"], 0),
        at_most("torn", total["torn"], 0),
        at_most("left_over_files", total["left_over_files"], 0),
        at_most("left_over_processes", total["left_over_processes"], 0),
    ]


if __name__ == "__main__":
    from benchmarks.measuring import publish

    publish("Killed commands", kill_figures(int(sys.argv[1]) if len(sys.argv) > 1 else KILLS))
