"""The page of the paper's study."""

from __future__ import annotations

from importlib.resources import files
from typing import TYPE_CHECKING

from exposight.models import P_NORM_MIN
from exposight.report.markup import escape, number
from exposight.report.page import Section, facts, html_page, versions
from exposight.report.study.figures import figure_html
from exposight.report.study.findings import findings_html
from exposight.report.study.summary import summary_html
from exposight.report.study.tables import dataset_table, hyperparameter_table, score_tables

if TYPE_CHECKING:
    from exposight.paper import StudyFigure, StudyResult
    from exposight.report.study.figures import DrawnFigure


_TITLE = "The paper’s study: point-cloud quality and exposure time, predicted"


def study_report(
    result: StudyResult,
    figures: tuple[DrawnFigure, ...],
    wanted: tuple[StudyFigure, ...] = (),
) -> str:
    """Return the study's report as one self-contained HTML page.

    It only formats and draws what it is given: the same study gives the same page.

    Parameters
    ----------
    result : StudyResult
        The study.
    figures : tuple of DrawnFigure
        Its figures, in their order.
    wanted : tuple of StudyFigure
        All that were asked for; of those without data the page says why.
    """
    style = files("exposight.report.study").joinpath("study.css").read_text(encoding="utf-8")
    sections = (
        Section(title="Summary", body=f"<style>\n{style}</style>\n{summary_html(result)}"),
        Section(title="Findings", body=findings_html(result)),
        Section(title="Tables 2 to 6: scores", body=score_tables(result)),
        Section(
            title="Tables 8 and 9: hyperparameters and datasets",
            body=hyperparameter_table(result) + dataset_table(result),
        ),
        Section(title="Figures", body=_figures(figures, wanted)),
        Section(title="Settings, versions, seeds", body=_settings(result)),
    )
    return html_page(_TITLE, _lead(result), sections)


def _figures(figures: tuple[DrawnFigure, ...], wanted: tuple[StudyFigure, ...]) -> str:
    left_out = "".join(
        f"<li>Figure {own.number} is left out: {escape(own.reason)}.</li>"
        for own in wanted
        if own.data is None
    )
    told = f'<ul class="notes">{left_out}</ul>\n' if left_out else ""
    return "".join(figure_html(own) for own in figures) + told


def _lead(result: StudyResult) -> str:
    where = "in a simulated measuring cell"
    if result.settings.campaigns is not None:
        where = "on recorded campaigns"
    return (
        "“Exposure time and point cloud quality prediction for active 3D imaging sensors using "
        f"Gaussian process regression”, the paper’s study {where}. Tables and figures have the "
        "paper’s numbers."
    )


def _settings(result: StudyResult) -> str:
    settings = result.settings
    campaigns = "".join(f"<li>{escape(own)}</li>" for own in result.campaigns)
    origin = "simulated"
    if settings.campaigns is not None:
        origin = f"recorded, read from the folder {escape(settings.campaigns.name)}"
    items = (
        ("sensors", ", ".join(settings.sensors)),
        ("study", "quick" if settings.quick else "whole"),
        ("seed", f"{settings.seed} (splits, starts of the optimiser, learning curves)"),
        ("campaigns", origin),
        ("exposure-time models", f"learn from observations of p_norm ≥ {number(P_NORM_MIN)}"),
        versions(),
    )
    return (
        facts(items)
        + f"<h3>What was measured</h3>\n<ul>{campaigns}</ul>\n"
        + "<h3>How to repeat it</h3>\n"
        + f"<pre>{escape(_command(result))}</pre>\n"
        + "<p>The output folder holds every table as CSV (<code>tables</code>), every figure as "
        "PNG and SVG (<code>figures</code>), the observations and the trained models. The docs’ "
        "page <code>the-paper.md</code> names the function behind each section, equation, table "
        "and figure of the paper, and what differs from it.</p>\n"
    )


def _command(result: StudyResult) -> str:
    settings = result.settings
    words = ["exposight reproduce -o FOLDER"]
    if len(settings.sensors) == 1:
        words.append(f"--sensor {settings.sensors[0]}")
    if settings.quick:
        words.append("--quick")
    if settings.campaigns is not None:
        words.append("--campaigns CAMPAIGNS")
    words.append(f"--seed {settings.seed}")
    return " ".join(words)
