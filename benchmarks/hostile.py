"""Nothing silent, torn or hostile: large inputs, mutated files, strange names, kills.

Run with ``make bench NAME=hostile``. The mutants are those of `tests.fuzz` with numbers that no
test uses, the kills those of `tests.crash`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from rich.console import Console
from rich.table import Table
from tests.files.strange_names import strange_names_right
from tests.fuzz.formats import all_formats
from tests.fuzz.mutants import Findings, find_all, shown

from benchmarks.hostile_kills import kill_figures
from benchmarks.hostile_sizes import size_figures
from benchmarks.measuring import Figure, at_least, at_most, publish, say

MUTANTS, FORMATS = 70_000, 19
_FIRST = 100_000
_KINDS = {
    "tracebacks": "tracebacks",
    "crashes": "crashes",
    "hangs": "hangs_over_10_s",
    "wrongly_accepted": "wrongly_accepted",
}


def mutant_figures() -> list[Figure]:
    """Read mutants of every format, and count what should not have come of them."""
    formats = all_formats().values()
    quick = sum(not each.slow for each in formats)
    found = find_all(math.ceil(MUTANTS / quick), first=_FIRST)
    _print(found)
    counts = {name: sum(each.count(kind) for each in found) for kind, name in _KINDS.items()}
    return [
        at_least("mutants", sum(each.mutants for each in found), MUTANTS),
        at_least("formats", len(found), FORMATS),
        *(at_most(name, number, 0) for name, number in counts.items()),
        at_most("peak_memory_gb", max(each.peak_gb for each in found), 2.0, unit="GB"),
    ]


def _print(found: Sequence[Findings]) -> None:
    table = Table("format", "mutants", "accepted", "peak GB", "s", *_KINDS.values())
    for each in found:
        numbers = (str(each.mutants), str(each.accepted), f"{each.peak_gb:.2f}")
        counts = (str(each.count(kind)) for kind in _KINDS)
        table.add_row(each.name, *numbers, f"{each.seconds:.0f}", *counts)
    Console(width=150).print(table)
    for each in found:
        if each.faults:
            print(shown(each))


def name_figures() -> list[Figure]:
    """Write and read files under strange names."""
    say("writing and reading under strange names")
    faults = strange_names_right()
    for fault in faults:
        print(f"  strange name: {fault}")
    return [Figure(name="strange_names_right", value=not faults, mark="true", met=not faults)]


def main() -> None:
    """Print all figures."""
    publish("hostile", [*size_figures(), *mutant_figures(), *name_figures(), *kill_figures()])


if __name__ == "__main__":
    main()
