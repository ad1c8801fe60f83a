"""``exposight reproduce`` on recorded tables: output, resuming, and what it says to bad calls."""

import json

import pytest

from exposight.observing import Observation, ObservationTable

FEATURES = [*(f"f{n}" for n in range(1, 10)), *(f"f{n}_test" for n in range(1, 5))]


def observation(number, feature, i, j, exposure_ms):
    """A ring that is brighter to the right and nearer, good between 25 and 140 grey levels."""
    x, y, z = 70.0 * i + 12 * number - 70, 60.0 * j - 6 * number, 150.0 * j
    i_avg = min(255.0, exposure_ms * (2.5 + 0.006 * x - 0.004 * z))
    p_norm = min(1.0, max(0.0, (i_avg - 10) / 15)) * min(1.0, max(0.0, (200 - i_avg) / 60))
    return Observation(
        feature=feature,
        view=f"v{i}{j}",
        exposure_ms=exposure_ms,
        p_norm=p_norm,
        i_avg=i_avg,
        x_mm=x,
        y_mm=y,
        z_mm=z,
        w_deg=0.5 * (number % 5),
        p_deg=-0.3 * (number % 4) + 0.01 * i,
        r_deg=0.0,
        radius_mm=3.0 + number,
    )


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    folder = tmp_path_factory.mktemp("recorded")
    rows = [
        observation(number, feature, i, j, exposure_ms)
        for number, feature in enumerate(FEATURES)
        for i in (0, 1)
        for j in (-1, 0, 1)
        for exposure_ms in (6.0, 12.0, 20.0, 32.0, 50.0, 80.0)
    ]
    ObservationTable.from_observations(rows).write(folder / "inside.csv")
    return folder


@pytest.fixture(scope="module")
def call(recorded, tmp_path_factory):
    output = tmp_path_factory.mktemp("paper")
    words = ("--sensors", "structured-light", "--quick", "--workers", 1, "--json")
    return output, ("reproduce", "-o", output, "--campaigns", recorded, *words)


@pytest.fixture(scope="module")
def first(run, call):
    result = run(*call[1])
    assert result.exit_code == 0, result.output
    return json.loads(result.stdout)


def contents(folder):
    paths = sorted(path for path in folder.rglob("*") if path.is_file())
    return {path.relative_to(folder): path.read_bytes() for path in paths}


@pytest.mark.slow
def test_it_writes_page_tables_and_figures(first, call):
    output = call[0]
    names = {str(path) for path in contents(output)}
    assert {
        "report.html",
        "tables/table-2.csv",
        "tables/table-9.csv",
        "tables/findings.csv",
    } <= names
    assert {"figures/figure-10.png", "figures/figure-24.svg"} <= names
    assert first["files"][0]["path"] == str(output / "report.html")


@pytest.mark.slow
def test_the_document_has_scores_and_findings(first):
    assert not first["simulated"]
    assert first["findings_true"] + first["findings_false"] + first["findings_open"] == len(
        first["findings"]
    )
    lines = {(row["variant"], row["role"]): row for row in first["scores"] if row["n"]}
    assert lines["q_k4", "test"]["paper_rmse"] == 10.49
    assert lines["e_k1", "test"]["r2_percent"] < 100


@pytest.mark.slow
def test_again_uses_what_is_there_and_gives_the_same_bytes(first, call, run):
    output, words = call
    before = contents(output)
    written = {path: path.stat().st_mtime_ns for path in (output / "models").iterdir()}
    assert run(*words).exit_code == 0
    assert contents(output) == before
    assert {path: path.stat().st_mtime_ns for path in (output / "models").iterdir()} == written


def failure(run, *words):
    result = run("reproduce", *words)
    assert result.exit_code == 1
    return result.stderr.splitlines()[-1]


def test_an_output_that_is_a_file(run, tmp_path):
    file = tmp_path / "taken"
    file.write_text("x", encoding="utf-8")
    assert "the output must be a folder, and this is a file" in failure(run, "-o", file)


def test_a_missing_folder_of_campaigns(run, tmp_path):
    message = failure(run, "-o", tmp_path / "out", "--campaigns", tmp_path / "none")
    assert "no such folder of campaigns" in message
    assert not (tmp_path / "out").exists()


def test_a_folder_without_the_campaign_that_must_be_there(run, tmp_path):
    (tmp_path / "empty").mkdir()
    message = failure(run, "-o", tmp_path / "out", "--campaigns", tmp_path / "empty")
    assert "expected a campaign folder 'inside' or a table 'inside.parquet' or .csv" in message


def test_an_unknown_sensor(run, tmp_path):
    result = run("reproduce", "-o", tmp_path, "--sensors", "time-of-flight")
    assert result.exit_code == 2
    assert "structured-light" in result.stderr


def test_a_negative_seed(run, tmp_path):
    assert run("reproduce", "-o", tmp_path, "--seed", -1).exit_code == 1
