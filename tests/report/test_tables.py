import re

import pytest

MODELS = {"q_k1": "p_norm", "q_k4": "p_norm", "e_k1": "exposure_ms"}


def _values(cells):
    return [cell["value"] for cell in cells]


def _score(score):
    return [score.n, score.r2_percent, score.mse, score.rmse, score.mae, score.coverage_2sigma]


def _result_of(result, model):
    return next(own for own in result.results if own.model.name == model)


@pytest.mark.parametrize("model", MODELS)
def test_unseen_scores_are_the_results(result, read_page, model):
    own = _result_of(result, model)
    row = read_page.model_row(f"unseen-{MODELS[model]}", model)
    assert _values(row[3:10]) == [own.model.n_observations, *_score(own.unseen.score)]


@pytest.mark.parametrize("model", MODELS)
def test_known_scores_are_the_results(result, read_page, model):
    row = read_page.model_row(f"known-{MODELS[model]}", model)
    assert _values(row[1:]) == _score(_result_of(result, model).known.score)


def test_scores_inside_the_training_range_are_the_results(result, read_page):
    inside = _result_of(result, "e_k1").unseen.score_inside
    row = read_page.model_row("unseen-exposure_ms", "e_k1")
    assert _values(row[10:]) == [inside.n, inside.r2_percent, inside.rmse]


def test_no_row_inside_the_training_range_is_a_dash(result, read_page):
    assert _result_of(result, "q_k4").unseen.score_inside is None
    row = read_page.model_row("unseen-p_norm", "q_k4")
    assert [cell["text"] for cell in row[10:]] == ["0", "–", "–"]


def test_p_norm_errors_are_shown_in_percent_of_full_scale(result, read_page):
    row = read_page.model_row("unseen-p_norm", "q_k1")
    shown = float(row[7]["text"])
    assert shown == pytest.approx(100 * _result_of(result, "q_k1").unseen.score.rmse, abs=0.05)


def test_exposure_errors_are_shown_in_ms(result, read_page):
    row = read_page.model_row("unseen-exposure_ms", "e_k1")
    shown = float(row[7]["text"])
    assert shown == pytest.approx(_result_of(result, "e_k1").unseen.score.rmse, abs=0.005)


def test_decoding_is_the_results(result, read_page):
    for check, row in zip(result.checks, read_page.rows["decoding"][2:], strict=True):
        counts, agreement = check.counts, check.agreement
        assert row[0]["text"] == check.title
        assert _values(row[1:]) == [
            counts.decoded,
            counts.low_modulation,
            counts.clipped,
            counts.ambiguous,
            counts.pixels,
            agreement.common_points,
            agreement.median_mm,
            agreement.p90_mm,
            check.seconds,
        ]


@pytest.mark.parametrize("model", MODELS)
def test_hyperparameters_are_the_models(result, page, model):
    parameters = _result_of(result, model).model.hyperparameters()
    table = page[page.index('<table id="hyperparameters"') :]
    row = table[table.index(f"<code>{model}</code>") :].partition("</tr>")[0]
    shown = [float(value) for value in re.findall(r'<data value="([^"]+)"', row)]
    expected = [each.value for each in parameters if each.remark != "fixed"]
    assert shown[: len(expected)] == expected


@pytest.mark.parametrize("model", MODELS)
def test_hyperparameters_at_a_limit_are_marked(result, read_page, model):
    summary = _result_of(result, model).model.summary
    row = read_page.model_row("hyperparameters", model)
    assert row[1]["text"].count("†") == len(summary.parameters_at_bound)


def test_the_cards_hold_the_results_numbers(result, page):
    cards = page[page.index('<div class="cards">') : page.index('<ul class="notes">')]
    shown = [float(value) for value in re.findall(r'<data value="([^"]+)"', cards)]
    assert shown == [
        result.checks[0].agreement.median_mm,
        result.checks[1].agreement.median_mm,
        _result_of(result, "q_k1").unseen.score.rmse,
        _result_of(result, "q_k4").unseen.score.rmse,
        _result_of(result, "e_k1").unseen.score.rmse,
        len(result.views),
        len(result.table.measured()),
        result.overlap,
    ]
