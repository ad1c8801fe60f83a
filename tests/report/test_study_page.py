"""The study's page, tables and pictures, on a study in miniature."""

import csv
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import polars as pl
import pytest

from exposight.models import Training, model_named
from exposight.observing import Observation, ObservationTable
from exposight.paper import (
    Dataset,
    DependenceMatrix,
    Finding,
    LearningCurve,
    LearningStep,
    StudyFigure,
    StudyResult,
    StudySettings,
    StudyTables,
    TrainedVariant,
    Variant,
    study_figures,
)
from exposight.report import write_study
from exposight.report.study_page import draw_figures, study_page
from exposight.statistics import score

SL = "structured-light"
EVIL = "<x>&\"'</script>"
"""A statement that would break a page which does not escape it."""

pytestmark = pytest.mark.slow


def observation(feature, view, exposure_ms, place):
    x, y, z = place
    i_avg = min(255.0, exposure_ms * (3.0 + 0.01 * x - 0.004 * z))
    p_norm = min(1.0, max(0.0, (i_avg - 10) / 20)) * min(1.0, max(0.0, (200 - i_avg) / 60))
    return Observation(
        feature=feature,
        view=view,
        exposure_ms=exposure_ms,
        p_norm=p_norm,
        i_avg=i_avg,
        x_mm=x,
        y_mm=y,
        z_mm=z,
        w_deg=0.01 * x,
        p_deg=0.02 * y,
        r_deg=0.0,
        radius_mm=5.0,
    )


def observations(features, shift):
    return ObservationTable.from_observations(
        [
            observation(
                feature,
                f"v{i}{j}",
                exposure_ms,
                (80.0 * i + 20 * number + shift, 60.0 * j, 150 * j),
            )
            for number, feature in enumerate(features)
            for i in (-1, 1)
            for j in (-1, 0, 1)
            for exposure_ms in (5.0, 10.0, 20.0, 40.0, 60.0)
        ]
    )


def dataset(name, table, p_norm_min=None):
    own = table if p_norm_min is None else table.with_quality(p_norm_min)
    return Dataset(
        name=name,
        title=name,
        sensor=SL,
        features=(),
        p_norm_min=p_norm_min,
        table=own,
        train=own,
        validation=own,
    )


def trained(name, data):
    specification = model_named(name)
    model = Training(specification=specification, table=data.table, seed=1, restarts=1).run()
    variant = Variant(
        name=name,
        title=name,
        sensor=SL,
        specification=model.specification,
        dataset=data.name,
        evaluations=(),
    )
    return TrainedVariant(variant=variant, model=model, scores=())


LINE = {
    "table": 2,
    "variant": "q_k4",
    "variant_title": "quality, 4D",
    "trained_on": "X",
    "n_train": 1912,
    "dataset": "X4_test",
    "role": "test",
    "features": "f1-4_test",
    "n": 1779,
    "unit": "%",
    "r2_percent": 91.23456789,
    "mse": 0.0123456789,
    "rmse": 11.1111111,
    "mae": 7.654321,
    "relative_error_percent": None,
    "coverage_1sigma_percent": 70.123,
    "coverage_2sigma_percent": 93.456,
    "paper_r2_percent": 92.74,
    "paper_mse": 0.011,
    "paper_rmse": 10.49,
    "r2_difference": 91.23456789 - 92.74,
    "rmse_difference": 11.1111111 - 10.49,
}
NO_ROWS = LINE | {
    "table": 6,
    "dataset": "X_out",
    "role": "extended",
    "n": 0,
    **dict.fromkeys(
        (
            "r2_percent", "mse", "rmse", "mae", "coverage_1sigma_percent",
            "coverage_2sigma_percent", "r2_difference", "rmse_difference",
        )
    ),
}  # fmt: skip
RANGES = ("p_norm", "i_avg", "exposure_ms", "x_mm", "y_mm", "z_mm", "w_deg", "p_deg")
FINDING = Finding(
    name="true-one",
    sensor=SL,
    statement=f"A statement that holds, {EVIL}.",
    source="Sect. 3.3.6, Table 2",
    measure="R² of the 4D quality model",
    figure=91.2345,
    comparison="≥",
    threshold=85.125,
    unit="%",
    reason="midway",
    paper_figure=92.74,
    holds=True,
    explanation="",
)


@pytest.fixture(scope="session")
def study():
    known, unseen = observations(("f1", "f2"), 0.0), observations(("f1_test", "f2_test"), 7.0)
    x, ex = dataset("X", known), dataset("eX", known, 0.75)
    columns = ("p_norm", "exposure_ms", "i_avg")
    ends = {"low": 0.125, "high": 1.875}
    ranges = {f"{name}_{end}": value for name in RANGES for end, value in ends.items()}
    step = LearningStep(n_train=60, score=score([0.0, 1.0], [0.1, 0.8]))
    return StudyResult(
        settings=StudySettings(sensors=(SL,), quick=True, seed=7),
        exposight_version="0",
        campaigns=("inside: 6 views, 30 captures, simulated",),
        datasets=(x, dataset("X_test", unseen), ex, dataset("eX_test", unseen, 0.75)),
        variants=(trained("q_k4", x), trained("e_k6", ex)),
        tables=StudyTables(
            scores=pl.DataFrame([LINE, NO_ROWS]),
            hyperparameters=pl.DataFrame(
                [
                    {
                        "variant": "q_k4", "parameter": "length_scale_0", "symbol": "ℓ",
                        "input": "i_avg", "unit": "grey levels", "value": 1.23456789,
                        "paper_value": 1.06, "at_bound": True,
                    }
                ]
            ),
            datasets=pl.DataFrame(
                [
                    dict(
                        dataset="X", sensor=SL, features="f1-4", n=1140, n_train=912,
                        n_validation=228, n_features=4, n_views=48, paper_n=1140,
                        paper_n_train=912, **ranges, **{f"paper_{name}": None for name in ranges},
                    )
                ]
            ),
        ),
        dependence=(DependenceMatrix(dataset="X", columns=columns, values=np.eye(3)),),
        learning_curves=(
            LearningCurve(variant="q_k4", dataset="X_test", role="test", steps=(step,)),
        ),
        findings=(
            FINDING,
            replace(FINDING, name="false-one", holds=False, figure=80.0, explanation="Because."),
            replace(FINDING, name="open-one", holds=None, figure=None),
        ),
    )  # fmt: skip


@pytest.fixture(scope="session")
def written(study, tmp_path_factory):
    return write_study(tmp_path_factory.mktemp("study"), study)


@pytest.fixture(scope="session")
def page(written):
    return written.report.read_text(encoding="utf-8")


def numbers_in(page, table):
    """Return the full values of the numbers in a table of the page."""
    found = re.search(f'<table id="{table}".*?</table>', page, re.DOTALL)
    return {float(value) for value in re.findall(r'<data value="([^"]+)"', found.group())}


def numbers_in_csv(written, name):
    (path,) = (own for own in written.tables if own.stem == name)
    with path.open(encoding="utf-8", newline="") as file:
        cells = [cell for row in csv.DictReader(file) for cell in row.values()]
    numbers = set()
    for cell in cells:
        try:
            numbers.add(float(cell))
        except ValueError:
            continue
    return numbers


@pytest.mark.parametrize("name", ["table-2", "table-6", "table-8", "table-9"])
def test_the_pages_numbers_are_the_files(page, written, name):
    shown = numbers_in(page, name)
    assert shown
    assert shown <= numbers_in_csv(written, name)


def test_the_findings_numbers_are_the_files(page, written):
    shown = numbers_in(page, f"findings-{SL}")
    assert {91.2345, 85.125, 80.0, 92.74} == shown
    assert shown <= numbers_in_csv(written, "findings")


def test_a_table_shows_ours_the_papers_and_the_difference(page):
    shown = numbers_in(page, "table-2")
    assert {
        LINE[name] for name in ("rmse", "paper_rmse", "rmse_difference", "r2_difference")
    } <= shown
    assert ">−1.5</data>" in page


def test_rows_that_were_not_measured_have_dashes(page):
    line = re.search(r'<table id="table-6".*?</table>', page, re.DOTALL).group()
    assert line.count("<td>–</td>") == 8
    assert 'value="0">0</data>' in line


def test_findings_are_true_false_or_open(page):
    assert re.findall(r'class="verdict (\w+)"', page) == ["yes", "no", "open"]
    assert "1 of 3 statements hold, 1 cannot be decided" in page
    assert "Because." in page


def test_a_statement_cannot_become_a_tag(page):
    assert "<x>" not in page
    assert "&lt;x&gt;" in page


def test_the_page_has_no_outside_address_and_no_script(page):
    assert "<script" not in page
    assert not re.search(r"(?:https?:)?//[\w-]+\.\w", page)
    assert not re.search(r"url\((?!#)", page)
    loaded = re.findall(r'(?:src|href)="([^"]*)"', page)
    assert loaded
    assert all(own.startswith(("#", "data:image/png;base64,")) for own in loaded)


def test_the_page_says_whose_numbers_these_are(page):
    assert "Its numbers are the simulated cell’s" in page
    figures = re.findall(r"<figcaption>(.*?)</figcaption>", page, re.DOTALL)
    assert sum("Measured in the simulated cell." in own for own in figures) == len(figures) - 1


def test_the_page_names_recorded_campaigns_without_their_place(study):
    recorded = replace(study, settings=replace(study.settings, campaigns=Path("/secret/mine")))
    figure = StudyFigure(number=20, data=study.dependence[0])
    page = study_page(recorded, draw_figures((figure,)))
    assert "read from the folder mine" in page
    assert "/secret" not in page
    assert "Measured in the recorded campaigns." in page
    assert "Measured in the simulated cell." not in page


def test_figures_have_the_papers_numbers_in_order(page):
    shown = [int(own) for own in re.findall(r"<b>Figure (\d+)\.</b>", page)]
    assert shown == [5, 10, 11, 12, 13, 15, 20, 21, 22, 24]


def test_a_figure_that_the_study_cannot_show_says_why(page):
    assert "Figure 14 is left out: e_k6 can be shown on curves of at least 4 exposure" in page
    assert "Figure 23 is left out: the study has no learning curve of" in page


@pytest.mark.parametrize(
    ("first", "second", "told"),
    [
        (15.8, 18.8, "worsens the quality model here: its RMSE on unseen features goes from "
         "15.8 to 18.8 %; in the paper it improves it, from 18.4 to 10.5 %."),
        (18.8, 15.8, "improves the quality model here: its RMSE on unseen features goes from "
         "18.8 to 15.8 %; in the paper it improves it, from 18.4 to 10.5 %."),
    ],
)  # fmt: skip
def test_the_summary_says_whether_position_helps(study, first, second, told):
    lines = tuple(
        LINE | {"variant": variant, "rmse": rmse, "paper_rmse": paper}
        for variant, rmse, paper in (("q_k1", first, 18.4), ("q_k4", second, 10.5))
    )
    tables = replace(study.tables, scores=pl.DataFrame(lines))
    page = study_page(replace(study, tables=tables), ())
    text = re.sub(r"<[^>]+>", "", page).replace("\u00a0", " ")
    assert f"Position added to brightness {told}" in text


def test_the_page_has_a_title_of_its_own(page):
    assert "<h1>The paper’s study: point-cloud quality and exposure time, predicted</h1>" in page


def test_sections_are_in_their_order(page):
    titles = re.findall(r'<span class="no">\d</span> ([^<]+)</h2>', page)
    assert titles[:2] == ["Summary", "Findings"]
    assert titles[-2:] == ["Figures", "Settings, versions, seeds"]


def test_every_figure_is_a_png_and_an_svg(written):
    names = {path.name for path in written.figures}
    assert {"figure-05.png", "figure-05.svg", "figure-24.png", "figure-24.svg"} <= names
    for path in written.figures:
        data = path.read_bytes()
        assert data.startswith(b"\x89PNG" if path.suffix == ".png" else b"<?xml")
        assert b"matplotlib.org" not in data
        assert b"<dc:date>" not in data


def test_the_same_study_gives_the_same_bytes(study):
    figures = [own for own in study_figures(study) if own.number in {5, 10, 20}]
    first, second = (draw_figures(figures) for _ in range(2))
    assert [own.still.png for own in first] == [own.still.png for own in second]
    assert [own.still.svg for own in first] == [own.still.svg for own in second]
    assert study_page(study, first) == study_page(study, second)


def test_the_page_is_of_a_reasonable_size(written):
    assert written.report.stat().st_size < 25e6


def test_progress_is_told(study, tmp_path):
    told = []
    figures = study_figures(study, lambda _, done, total: told.append((done, total)))
    assert told[0] == (0, 12)
    assert told[-1] == (12, 12)
    assert draw_figures(figures[:1])[0].number == 5


def test_a_table_with_both_targets_is_shown_in_two(study):
    both = pl.DataFrame([LINE | {"table": 4}, LINE | {"table": 4, "variant": "e_k6", "unit": "ms"}])
    page = study_page(replace(study, tables=replace(study.tables, scores=both)), ())
    assert '<table id="table-4-quality"' in page
    assert '<table id="table-4-exposure-time"' in page
    assert "MSE, ms²" in page


def test_a_further_model_has_lines_of_its_own_without_the_papers_numbers(study):
    theirs = {name: None for name in LINE if name.startswith("paper") or "difference" in name}
    lines = pl.DataFrame([LINE, LINE | theirs | {"variant": "theirs <1>", "rmse": 7.25}])
    page = study_page(replace(study, tables=replace(study.tables, scores=lines)), ())
    assert "<code>theirs &lt;1&gt;</code>" in page
    assert 7.25 in numbers_in(page, "table-2")
