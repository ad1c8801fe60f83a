"""The page of the demonstration on the simulated cell."""

from __future__ import annotations

from typing import TYPE_CHECKING

from exposight.demo import EXPOSURE_MODEL, QUALITY_MODEL, DoorSettings
from exposight.errors import InputError
from exposight.report.cards import Card, Key, cards, count_key, model_cards
from exposight.report.door.images import close_figure, frame_figure
from exposight.report.door.scene import door_figure
from exposight.report.door.view import choice_figure, forecast_figure, forecast_table
from exposight.report.markup import escape, exact, model_name, number
from exposight.report.page import Section, facts, html_page, versions
from exposight.report.prediction_figure import prediction_figure
from exposight.report.quality_figure import quality_figure
from exposight.report.selection import exposures_ms, named_result
from exposight.report.tables import hyperparameter_table, score_tables

if TYPE_CHECKING:
    from collections.abc import Iterator

    from exposight.demo import DoorResult


_TITLE = "A simulated car door: point-cloud quality and exposure time, predicted"
_LEAD = "Demonstration of exposight on a car door in a simulated measuring cell."
_CHOSEN = 1


def door_report(result: DoorResult) -> str:
    """Return the report of the demonstration on the door as one self-contained HTML page.

    It only formats and draws what the result holds: the same result gives the same page.

    Parameters
    ----------
    result : DoorResult
        What `exposight.demo.run_door` found.

    Raises
    ------
    InputError
        If the result has no model.
    """
    if not result.results:
        msg = "a report needs at least one trained model, got none; name models to train"
        raise InputError(msg)
    sections = (
        Section(title="Summary", body=cards(_cards(result)) + _sentences(result)),
        Section(title="The door in 3D", body=door_figure(1, result)),
        Section(title="A new view", body=frame_figure(2, result) + close_figure(3, result)),
        Section(
            title="Forecast and measurement",
            body=choice_figure(4, result) + forecast_figure(5, result) + forecast_table(result),
        ),
        Section(title="Quality over brightness", body=quality_figure(6, result)),
        Section(
            title="Predictions for unseen features",
            body=f'<div class="pair">{prediction_figure(7, result, "p_norm")}'
            f"{prediction_figure(8, result, 'exposure_ms')}</div>",
        ),
        Section(title="Numbers", body=score_tables(result) + hyperparameter_table(result)),
        Section(title="Settings, versions, how to repeat", body=_settings(result)),
    )
    return html_page(_TITLE, _LEAD, sections)


def _cards(result: DoorResult) -> Iterator[Card]:
    view = result.new_view
    yield Card(
        title="Measured in the campaign",
        keys=(
            count_key(result.n_captures, f"captures from {result.n_views} views"),
            count_key(len(result.table.measured()), "observations"),
        ),
    )
    yield from model_cards(result)
    yield Card(
        title="A new view: mean <i>p</i><sub>norm</sub>",
        keys=tuple(
            Key(value=exact(value, number(value)), unit="", meaning=meaning)
            for value, meaning in (
                (float(view.p_norm[:, _CHOSEN].mean()), f"measured at {number(view.chosen_ms)} ms"),
                (float(view.taken.p_norm[:, _CHOSEN].mean()), "predicted"),
            )
        ),
    )
    coverage = view.score.coverage_2sigma or 0.0
    yield Card(
        title="A new view: forecast per feature",
        keys=(
            Key(
                value=exact(coverage, number(100 * coverage)),
                unit="%",
                meaning=f"of {view.score.n} values in the predicted 2σ band",
            ),
            Key(
                value=exact(view.score.rmse, number(100 * view.score.rmse)),
                unit="%",
                meaning="RMSE of predicted <i>p</i><sub>norm</sub>",
            ),
        ),
    )


def _sentences(result: DoorResult) -> str:
    view = result.new_view
    unseen = len(set(result.table.names("feature"))) - len(result.train_features)
    good = int((view.p_norm[:, _CHOSEN] >= 0.75).sum())
    return (
        '<ul class="notes">\n'
        f"<li>A structured-light sensor looked at a door of bare sheet metal from {result.n_views} "
        f"positions in three depth planes, several exposure times each. Gaussian processes "
        f"learnt from {len(result.train_features)} features; {unseen} others, most of them tilted "
        "further, were kept from them and judge them.</li>\n"
        "<li>Then the sensor stood where it never stood. From pose alone the models forecast "
        f"every feature’s exposure time and quality, and {number(view.chosen_ms)} ms was chosen "
        "because it promised the best mean quality. Only then the view was taken: "
        f"{good} of {len(view.views)} features came out well (<i>p</i><sub>norm</sub> of at "
        f"least 0.75){_at_other_times(result)}.</li>\n"
        f"<li>{_model_sentence(result)}</li>\n"
        "<li><strong>The numbers are the simulated cell’s</strong>, not a real sensor’s: part, "
        "light, camera noise, clipping and decoding are computed from physics. Its parameters "
        "come from data sheets and from the paper’s curve of quality over brightness, never from "
        "a model’s score.</li>\n</ul>\n"
    )


def _at_other_times(result: DoorResult) -> str:
    view = result.new_view
    (shorter, _, longer) = (view.p_norm >= 0.75).sum(axis=0).tolist()
    first, _, last = view.taken.exposures_ms
    return f"; at {number(first)} ms {shorter} did, and at {number(last)} ms {longer}"


def _model_sentence(result: DoorResult) -> str:
    plain, posed = (named_result(result, name) for name in ("e_k1", EXPOSURE_MODEL))
    text = (
        f"On bare metal the pose decides how long to expose: on unseen features "
        f"{model_name(EXPOSURE_MODEL)}, which knows brightness and pose,"
    )
    if posed is None:
        return ""
    text += f" explains {number(posed.unseen.score.r2_percent)} % of the exposure time’s variance"
    if plain is not None:
        text += (
            f", {model_name('e_k1')}, which knows brightness alone, "
            f"{number(plain.unseen.score.r2_percent)} %"
        )
    one, four = (named_result(result, name) for name in ("q_k1", QUALITY_MODEL))
    if one is not None and four is not None:
        text += (
            ". Quality hangs on brightness first: "
            f"{number(one.unseen.score.r2_percent)} % of its variance by {model_name('q_k1')}, "
            f"{number(four.unseen.score.r2_percent)} % with the position added "
            f"({model_name(QUALITY_MODEL)})"
        )
    return f"{text}."


def _settings(result: DoorResult) -> str:
    settings, camera = result.settings, result.sensor.camera
    plan, view = settings.plan, result.new_view
    times = exposures_ms(result)
    x, y, z = view.position_mm
    quick = "" if plan.name == DoorSettings().plan.name else " --quick"
    told = (
        (
            "measuring plan",
            f"{escape(plan.name)}: {result.n_views} views, {result.n_captures} captures, "
            f"{number(times[0])} to {number(times[-1])} ms; only the rings’ neighbourhoods taken",
        ),
        ("features that trained", escape(", ".join(sorted(result.train_features)))),
        (
            "new view",
            f"feature {escape(plan.reference)} at x {number(x)}, y {number(y)}, z {number(z)} mm "
            "in the sensor’s TCP frame; whole frames",
        ),
        ("seed", f"{settings.seed} (noise, alignment errors, restarts)"),
        ("optimiser", f"{settings.restarts} starts for each model"),
        ("sensor", f"{escape(result.sensor.name)}, simulated"),
        ("camera", f"{camera.width} × {camera.height} px"),
        versions(),
    )
    return (
        facts(told) + "<p>To repeat it, the same to the last digit on the same machine:</p>\n"
        f"<pre>exposight demo{quick} --seed {settings.seed}</pre>\n"
        "<p>The demonstration’s output folder holds the captures (<code>campaign</code>, and "
        "<code>new-view</code> with whole frames and clouds), every observation "
        "(<code>observations.csv</code>), the features (<code>features.csv</code>) and the "
        "trained models (<code>models</code>).</p>\n"
        "<p>exposight is under Apache-2.0, the inlined plotly.js under the MIT licence.</p>\n"
    )
