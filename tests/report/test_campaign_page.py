"""The page of any campaign: self-contained, safe, and its numbers the results'."""

import re

import numpy as np
import pytest

from exposight.errors import FileError, FormatError, InputError, ObservationError
from exposight.models import save_model
from exposight.observing import ObservationTable
from exposight.report import campaign_report, read_part_mesh, write_campaign_report

_LOADING = {"src", "srcset", "href", "action", "formaction", "data", "poster", "xlink:href"}


@pytest.mark.slow
def test_the_same_report_gives_the_same_bytes(report, page):
    assert report.html() == page


def test_the_page_needs_no_other_file(read_page, page):
    addresses = [v for _, a in read_page.tags for name, v in a.items() if name in _LOADING]
    assert addresses
    assert all(value.startswith(("data:image/", "#")) for value in addresses)
    (style,) = re.findall(r"<style>(.*?)</style>", page, re.DOTALL)
    assert not re.search(r"url\(|@import", style)
    script = read_page.scripts[-1]["text"]
    assert "newPlot" in script
    assert not re.search(r"https?:|//cdn|import\s*\(|import\s+|fetch|XMLHttpRequest", script)


def test_the_browser_is_told_to_refuse_every_address(read_page):
    (policy,) = (a["content"] for _, a in read_page.tags if "http-equiv" in a)
    assert policy.startswith("default-src 'none'")
    assert "http" not in policy
    assert "unsafe-eval" not in policy


def test_plotly_is_inlined_once(read_page):
    large = [script for script in read_page.scripts if len(script["text"]) > 1_000_000]
    assert len(large) == 1


def test_names_are_shown_and_cannot_become_tags(page, read_page):
    assert "<x>" not in page
    assert not any(tag in ("x", "rig", "everything") for tag, _ in read_page.tags)
    assert "tiny <rig>" in read_page.texts
    assert "A note on <everything>." in read_page.texts


def test_ids_are_unique_and_every_plot_has_its_data(read_page):
    ids = [attributes["id"] for _, attributes in read_page.tags if "id" in attributes]
    assert len(ids) == len(set(ids))
    places = [a["id"] for _, a in read_page.tags if a.get("class", "").split()[:1] == ["plot"]]
    assert places == ["part", "choice", "predicted-p_norm", "predicted-exposure_ms"]
    assert all(read_page.traces(place) for place in places)


def test_sections_and_figures_are_numbered_in_order(page):
    numbers = re.findall(r'<span class="no">(\d)</span>', page)
    assert numbers == list("123456789")
    assert re.findall(r"<b>Figure (\d+)\.</b>", page) == [str(n) for n in range(1, 11)]
    assert re.findall(r'<a href="#s(\d)">', page) == numbers


def test_every_axis_has_a_unit(read_page):
    for name in ("choice", "predicted-p_norm", "predicted-exposure_ms"):
        layout = read_page.json(f"{name}-figure")["layout"]
        for axis in ("xaxis", "yaxis"):
            assert layout[axis]["title"]["text"].endswith((" (1)", " (ms)"))


def test_the_best_exposure_time_comes_first(report, page):
    first = page[page.index('<div class="cards">') :]
    shown = [float(value) for value in re.findall(r'<data value="([^"]+)"', first)[:2]]
    summary = report.summary
    assert shown == [summary.exposures_ms[summary.best], 4]


def test_the_table_of_features_is_the_summarys(report, read_page):
    rows = read_page.rows["features"][2:]
    for row, own in zip(rows, report.summary.features, strict=True):
        assert row[0]["text"] == own.name
        assert row[1]["text"] == ("no" if own.name in report.unseen else "yes")
        values = [cell["value"] for cell in row if cell["value"] is not None]
        assert values == [
            own.radius_mm, own.views, own.observations, own.p_norm, own.exposure_ms,
            own.p_norm_at_best,
        ]  # fmt: skip


def test_the_table_of_the_forecast_is_the_views(report, read_page):
    view, taken = report.view, report.view.forecast.taken
    for i, row in enumerate(read_page.rows["forecast-table"][2:]):
        expected = [view.radii_mm[i], *taken.wanted_ms[i, [1, 0, 2]]]
        for k in range(3):
            expected += [taken.p_norm[i, k], taken.p_norm_low[i, k], taken.p_norm_high[i, k]]
            expected += [taken.chance[i, k], view.p_norm[i, k]]
        expected += [taken.brightness[i, view.main], view.i_avg[i, view.main]]
        assert [cell["value"] for cell in row[2:]] == expected


@pytest.mark.parametrize("model", ["q_k1", "q_k4", "e_k1", "e_k6"])
def test_scores_are_the_evaluations(report, read_page, model):
    own = next(own for own in report.results if own.name == model)
    name = f"scores-{own.model.target}"
    (row,) = (row for row in read_page.rows[name] if f" {model}" in row[0]["text"])
    score, inside = own.evaluation.score, own.evaluation.score_inside
    chances = own.probability
    expected = [own.model.n_observations, score.n, score.r2_percent, score.rmse]
    if own.model.target == "p_norm":
        expected += [chances.brier, chances.coverage_edge]
    else:
        expected += [chances.median_relative_error]
    expected += [chances.crps, score.coverage_1sigma, score.coverage_2sigma]
    expected += [inside.n, inside.r2_percent, inside.rmse] if inside else []
    expected += [own.training.score.r2_percent, own.training.score.rmse]
    shown = [cell["value"] for cell in row if cell["value"] is not None]
    assert shown == [value for value in expected if value is not None and np.isfinite(value)]


def test_hyperparameters_are_the_models(report, page):
    table = re.search(r'<table id="hyperparameters".*?</table>', page, re.DOTALL)[0]
    shown = {float(value) for value in re.findall(r'<data value="([^"]+)"', table)}
    for own in report.results:
        values = {each.value for each in own.model.hyperparameters() if each.remark != "fixed"}
        assert values <= shown


@pytest.mark.parametrize("model", ["q_k1", "q_k4", "e_k1", "e_k6"])
def test_predictions_are_drawn_over_observations(report, read_page, model):
    array = read_page.array
    own = next(own for own in report.results if own.name == model)
    traces = [
        t for t in read_page.traces(f"predicted-{own.model.target}") if t.get("meta") == model
    ]
    drawn = np.concatenate(
        [np.column_stack([array(t["x"]), array(t["y"]), array(t["error_y"]["array"])])
         for t in traces]
    )  # fmt: skip
    evaluation = own.evaluation
    expected = np.column_stack(
        [evaluation.observed, evaluation.prediction.mean, 2 * evaluation.prediction.std]
    ).astype(np.float32)
    np.testing.assert_array_equal(np.sort(drawn, axis=0), np.sort(expected, axis=0))
    symbols = {t["marker"]["symbol"]: len(array(t["x"])) for t in traces}
    inside = int(evaluation.prediction.inside.sum())
    assert symbols.get("circle", 0) == inside
    assert symbols.get("diamond-open", 0) == len(evaluation.observed) - inside


def test_the_forecast_is_drawn_over_the_exposure_time(report, read_page):
    *_, mean, measured = read_page.traces("choice")
    choice = report.view.forecast.choice
    np.testing.assert_array_equal(read_page.array(mean["y"]), choice.p_norm.mean(axis=0))
    np.testing.assert_array_equal(read_page.array(measured["y"]), report.view.p_norm.mean(axis=0))


def test_a_table_alone_has_a_page(table, reader):
    page = campaign_report(table).html()
    parsed = reader(page)
    assert {"features"} == set(parsed.rows)
    assert not any(tag == "img" for tag, _ in parsed.tags)
    assert parsed.traces("part")


def test_models_of_one_kind_are_evaluated_on_the_whole_table(table, models, reader):
    report = campaign_report(table, models[2:3])
    parsed = reader(report.html())
    assert report.results[0].evaluation.score.n == len(models[2].rows(table))
    assert {"features", "scores-exposure_ms", "hyperparameters"} == set(parsed.rows)


def test_unseen_features_must_be_there(table, models):
    with pytest.raises(InputError, match="nowhere"):
        campaign_report(table, models, unseen=["nowhere"])


def test_a_table_without_measurements_is_refused(table):
    with pytest.raises(ObservationError, match="measured observations, got none"):
        campaign_report(ObservationTable(frame=table.frame.clear()))


def test_files_make_a_page(table, models, tmp_path):
    table.write(tmp_path / "plate.csv")
    save_model(tmp_path / "e.exposight-model", models[2])
    report, path = write_campaign_report(
        tmp_path / "plate.csv", [tmp_path / "e.exposight-model"], tmp_path / "out"
    )
    assert path == tmp_path / "out" / "report.html"
    assert path.read_text(encoding="utf-8") == report.html()


def test_an_output_that_is_a_file_is_refused(table, tmp_path):
    table.write(tmp_path / "plate.csv")
    with pytest.raises(FileError, match="cannot be used for output"):
        write_campaign_report(tmp_path / "plate.csv", output=tmp_path / "plate.csv")


def test_a_mesh_needs_a_campaign(table, tmp_path):
    table.write(tmp_path / "plate.csv")
    mesh = tmp_path / "part.obj"
    mesh.write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    assert len(read_part_mesh(mesh).faces) == 1
    with pytest.raises(InputError, match="a mesh needs a campaign"):
        write_campaign_report(tmp_path / "plate.csv", output=tmp_path / "out", mesh=mesh)
    mesh.write_text("nothing")
    with pytest.raises(FormatError, match=r"part\.obj"):
        read_part_mesh(mesh)
