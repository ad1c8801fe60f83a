"""docs/the-paper.md maps the paper to the code: all it names exists, and nothing is left out."""

import importlib
import re
from pathlib import Path

import pytest

MAP = (Path(__file__).parents[1] / "docs" / "the-paper.md").read_text(encoding="utf-8")
NAMES = sorted(set(re.findall(r"`(exposight\.[\w.]+)`", MAP)))


def resolve(name):
    """Import the longest part of a dotted name that is a module, and follow the rest."""
    parts = name.split(".")
    for length in range(len(parts), 0, -1):
        try:
            found = importlib.import_module(".".join(parts[:length]))
        except ModuleNotFoundError:
            continue
        for part in parts[length:]:
            found = getattr(found, part)
        return found
    raise ModuleNotFoundError(name)


def numbers_of(heading):
    """Return the numbers in the first column of the table under a heading."""
    body = MAP.split(f"## {heading}\n", 1)[1].split("\n## ", 1)[0]
    cells = re.findall(r"^\| ([^|]+) \|", body, re.MULTILINE)
    return {int(word) for cell in cells for word in re.findall(r"\d+", cell)}


@pytest.mark.parametrize("name", NAMES)
def test_every_name_exists(name):
    assert resolve(name) is not None


@pytest.mark.parametrize(("heading", "last"), [("Equations", 24), ("Tables", 9), ("Figures", 26)])
def test_nothing_of_the_paper_is_left_out(heading, last):
    assert numbers_of(heading) == set(range(1, last + 1))


def test_every_row_names_code():
    tables = MAP.split("## What differs", 1)[0]
    rows = [
        line for line in tables.splitlines() if line.startswith("| ") and "paper | what" not in line
    ]
    without = [row for row in rows if "`exposight." not in row]
    assert not without
