"""What people bring is read, asked about, or refused by name; a folder and a CAD file become plans.

Run with ``make bench NAME=bring``. Dialects, ambiguous files and cases are written anew by
`bring_dialects`, `bring_ambiguous` and `bring_cases`; the parts are those of `bring_cad`.
"""

from __future__ import annotations

import os
import tempfile
import time
from collections import Counter
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table

from benchmarks.bring_ambiguous import ambiguous
from benchmarks.bring_cad import cad
from benchmarks.bring_cases import CASES
from benchmarks.bring_dialects import dialects
from benchmarks.bring_folder import call, commands, write_folder
from benchmarks.contradictions_cases import tried
from benchmarks.measuring import Figure, at_least, at_most, publish, say
from exposight.observing import read_observations


def tried_dialects() -> list[Figure]:
    """Read every dialect; print by kind how many were read as what was written."""
    say("reading dialects")
    tried, read, faults = Counter[str](), Counter[str](), []
    with tempfile.TemporaryDirectory() as folder:
        for dialect in dialects():
            place = Path(folder) / dialect.kind
            place.mkdir(exist_ok=True)
            fault = dialect.fault(place)
            tried[dialect.kind] += 1
            read[dialect.kind] += not fault
            if fault:
                faults.append((dialect.kind, dialect.name, fault))
    table = Table("kind", "dialects", "read", title="dialects")
    for kind, number in tried.items():
        table.add_row(kind, str(number), str(read[kind]))
    Console(width=160).print(table)
    _print_faults("dialects that were not read", faults)
    total = sum(tried.values())
    return [
        at_least("dialects", total, 60),
        *(Figure(name=f"dialects_{kind}", value=number) for kind, number in tried.items()),
        Figure(
            name="dialects_read",
            value=sum(read.values()),
            mark=f"= {total}",
            met=sum(read.values()) == total,
        ),
    ]


def asked() -> list[Figure]:
    """Read every ambiguous file; each must be asked about."""
    say("reading ambiguous files")
    faults, files = [], ambiguous()
    with tempfile.TemporaryDirectory() as folder:
        for number, file in enumerate(files):
            place = Path(folder) / str(number)
            place.mkdir()
            outcome = file.outcome(place)
            if outcome:
                faults.append((file.question, file.name, outcome))
    _print_faults("ambiguous files that were not asked about", faults)
    return [
        at_least("ambiguous_files", len(files), 40),
        Figure(
            name="ambiguous_refused",
            value=not faults and len(files) >= 40,
            mark="true",
            met=not faults,
        ),
    ]


def folder_to_plan() -> list[Figure]:
    """Take a scanner's folder to a plan; compare what is observed on the way with the truth."""
    before = Path.cwd()
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary) / "folder"
        say("writing a scanner's folder")
        truth = write_folder(folder)
        os.chdir(folder)
        try:
            words = commands()
            begun = time.perf_counter()
            for each in words:
                say(f"exposight {each}")
                planned = call(each.split())
            seconds = time.perf_counter() - begun
            table = read_observations(Path("models/observations.csv")).measured().frame
        finally:
            os.chdir(before)
    means = table.group_by("view", "exposure_ms", maintain_order=True).mean()
    found = dict(
        zip(
            zip(
                [name.rjust(2, "0")[-2:] for name in means["view"]],
                means["exposure_ms"],
                strict=True,
            ),
            means["p_norm"],
            strict=True,
        )
    )
    off = [abs(found[view[-2:], time_ms] - p_norm) for (view, time_ms), p_norm in truth.items()]
    captures = planned.get("captures")
    if not captures:
        msg = f"no captures were planned: {planned}"
        raise RuntimeError(msg)
    return [
        at_most("folder_to_plan_commands", len(words), 4),
        Figure(name="folder_to_plan_s", value=seconds, unit="s"),
        Figure(name="folder_captures", value=len(truth)),
        at_most("folder_p_norm_difference", float(np.max(off)), 0.01),
        Figure(name="folder_planned_captures", value=_number(captures)),
    ]


def _number(value: object) -> int:
    return len(value) if isinstance(value, list | tuple) else int(str(value))


def _print_faults(title: str, faults: list[tuple[str, str, str]]) -> None:
    if faults:
        table = Table("kind", "file", "what came", title=title)
        for kind, name, fault in faults:
            table.add_row(kind, name, fault[:300])
        Console(width=180).print(table)


def main() -> None:
    """Print all figures."""
    publish("bring", [*tried_dialects(), *asked(), *tried(CASES), *cad(), *folder_to_plan()])


if __name__ == "__main__":
    main()
