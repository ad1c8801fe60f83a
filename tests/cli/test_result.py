"""What commands return, as people and machines read it."""

import json
import math
from pathlib import Path

import pytest

from exposight.cli.result import Result, Written, fact
from exposight.cli.terminal import print_json
from exposight.errors import FileError
from exposight.tables import Column, Table


@pytest.fixture
def result(tmp_path):
    return Result(
        title="door",
        facts=(
            fact("rows", 1234),
            fact("depth_mm", {"min": 1.0, "max": math.nan}, "1 mm or more"),
            fact("seconds", 2.5, ""),
        ),
        tables=(
            Table.of("models", [{"model": "q_k4", "rmse": 0.1}], (Column(name="model"),)),
            Table(name="all", frame=Table.of("", [{"a": 1}], ()).frame, columns=(), shown_rows=0),
        ),
        notes=("few rows",),
        files=(Written(kind="table", path=Path("t.csv"), replaced=True),),
        next_step="train t.csv",
    )


def test_machines_get_every_fact_and_row(result, capsys):
    print_json(result.document())
    assert json.loads(capsys.readouterr().out) == {
        "rows": 1234,
        "depth_mm": {"min": 1.0, "max": None},
        "seconds": 2.5,
        "models": [{"model": "q_k4", "rmse": 0.1}],
        "all": [{"a": 1}],
        "notes": ["few rows"],
        "contradictions": [],
        "files": [{"kind": "table", "path": "t.csv", "replaced": True}],
    }


def test_people_read_what_is_meant_for_them(result, capsys):
    result.show()
    lines = [" ".join(line.split()) for line in capsys.readouterr().out.splitlines()]
    assert lines[:3] == ["door", "rows 1 234", "depth mm 1 mm or more"]
    assert "q_k4" in lines
    assert lines[-3:] == [
        "note: few rows",
        "replaced the table: t.csv",
        "next: exposight train t.csv",
    ]


def test_a_narrow_terminal_cuts_no_digits(capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "20")
    rows = [dict.fromkeys(("alpha", "beta", "gamma"), 123456.75)]
    columns = tuple(Column(name=name, decimals=2) for name in rows[0])
    Result(tables=(Table.of("wide", rows, columns),)).show()
    assert capsys.readouterr().out.count("123456.75") == 3


def test_an_output_is_no_input(tmp_path):
    path = tmp_path / "a.csv"
    assert not Written.at(path, "table", inputs=(path,)).replaced
    path.write_text("", "utf-8")
    assert Written.at(path, "table").replaced
    with pytest.raises(FileError, match="would be replaced"):
        Written.at(path, "table", inputs=(None, path))
