"""``exposight compare``: strategies on a sweep."""

import json
from pathlib import Path

import numpy as np
import polars as pl
import pytest

from exposight.observing import ObservationTable, read_observations

EXAMPLE = Path(__file__).parents[2] / "examples" / "07_own_strategy.py"


@pytest.fixture(scope="module")
def sweep(tmp_path_factory) -> Path:
    """A table of two views at eight exposure times."""
    rows = [
        {"view": view, "feature": f"f{i}", "exposure_ms": 2.0 * 2**k, "grey": light * 2.0 * 2**k}
        for view, lights in {"one": (1.0, 2.0), "two": (0.5, 16.0)}.items()
        for i, light in enumerate(lights)
        for k in range(8)
    ]
    grey = pl.col("grey")
    frame = pl.DataFrame(rows).with_columns(
        p_norm=grey.is_between(20.0, 120.0).cast(pl.Float64),
        i_avg=grey.clip(upper_bound=255.0),
        radius_mm=pl.lit(5.0),
        **dict.fromkeys(("x_mm", "y_mm", "z_mm", "w_deg", "p_deg", "r_deg"), pl.lit(0.0)),
    )
    path = tmp_path_factory.mktemp("sweep") / "sweep.csv"
    ObservationTable.from_frame(frame.drop("grey")).write(path)
    return path


def test_it_writes_results_and_a_page_with_a_strategy_of_ones_own(sweep, tmp_path, run, run_json):
    out = tmp_path / "out"
    told = run_json(
        "compare", "--sweep", sweep, "--strategies", "adaptive", "--add", EXAMPLE, "-o", out
    )
    assert [row["strategy"] for row in told["scores"]] == ["oracle", "halving", "adaptive"]
    assert told["verdict"].split(":")[0] in ("halving", "adaptive")
    results = json.loads((out / "results.json").read_text("utf-8"))
    assert (results["format"], results["version"]) == ("exposight comparison", 1)
    assert len(results["outcomes"]) == 6
    assert pl.read_csv(out / "results.csv")["strategy"].to_list()[0] == "oracle"
    assert "halving" in (out / "comparison.html").read_text("utf-8")
    ended = run(
        "compare", "--sweep", sweep, "--strategies", "geometric_2", "--with", out, "-o", tmp_path
    )
    assert ended.exit_code == 0
    assert "halving" in ended.stdout
    assert " exposures a view" in ended.stdout.splitlines()[0]


def test_a_simulated_sweep_that_is_there_is_used(sweep, tmp_path, run_json):
    read_observations(sweep).write(tmp_path / "sweep.parquet")
    told = run_json("compare", "--simulated", "--strategies", "adaptive", "-o", tmp_path)
    assert told["views"] == 2
    assert any("sweep.parquet was there" in note for note in told["notes"])


def test_a_campaign_is_a_sweep(campaign, tmp_path, run_json):
    told = run_json(
        "compare", "--sweep", campaign, "--strategies", "geometric_2", "-o", tmp_path / "out"
    )
    assert told["views"] == 3
    assert np.isfinite(told["scores"][1]["exposures_over_oracle"])


def test_models_that_learnt_from_the_sweep_are_named_first(campaign, observations, tmp_path, run):
    models = tmp_path / "models"
    assert (
        run("train", observations, "-o", models, "--sensor", campaign / "sensor.json").exit_code
        == 0
    )
    table = tmp_path / "copy.csv"  # not the file that they were trained on
    assert run("observe", campaign, "-o", table).exit_code == 0
    words = ("--sweep", table, "--strategies", "open_loop", "-o", tmp_path / "out")
    ended = run("compare", models, *words)
    assert ended.exit_code == 0, ended.stderr
    first = ended.stdout.splitlines()[0]
    assert first.startswith("quality has learnt from")
    assert "of this sweep, so that its scores tell nothing" in first
    about = json.loads((tmp_path / "out" / "results.json").read_text("utf-8"))["about"]
    assert "quality has learnt" in about["learnt_from_this_sweep"][0]


@pytest.mark.parametrize(
    ("arguments", "status", "fact"),
    [
        ((), 2, "either --sweep"),
        (("--sweep", "{sweep}", "--simulated"), 2, "either --sweep"),
        (("--sweep", "{sweep}", "--strategies", "open_loop"), 2, "give some first"),
        (("--sweep", "{sweep}", "--strategies", "adaptiv"), 1, "did you mean 'adaptive'"),
        (("--sweep", "{sweep}", "--limits", "nobody"), 1, "no exposure limits are called 'nobody'"),
        (("--sweep", "{sweep}", "--add", "nothing.py"), 1, "no such Python file"),
        (("{sweep}", "--sweep", "{sweep}"), 1, "observations are given by --sweep"),
    ],
)
def test_wrong_calls(arguments, status, fact, sweep, tmp_path, run):
    given = [str(sweep) if each == "{sweep}" else each for each in arguments]
    ended = run("compare", *given, "-o", tmp_path)
    assert ended.exit_code == status
    assert fact in ended.stderr


def test_a_file_that_registers_nothing(sweep, tmp_path, run):
    for text, fact in (("x = 1", "registers no strategy"), ("1 / 0", "ZeroDivisionError")):
        (tmp_path / "mine.py").write_text(text)
        ended = run("compare", "--sweep", sweep, "--add", tmp_path / "mine.py", "-o", tmp_path)
        assert ended.exit_code == 1
        assert fact in ended.stderr
