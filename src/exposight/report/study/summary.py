"""The study's summary: its key figures beside the paper's, and what they mean."""

from __future__ import annotations

from types import SimpleNamespace as Row
from typing import TYPE_CHECKING

from exposight.report.cards import Card, Key, cards
from exposight.report.markup import exact, fixed, model_name, number
from exposight.report.study.findings import findings_told
from exposight.report.study.words import prose

if TYPE_CHECKING:
    from collections.abc import Iterator

    from exposight.paper import EvaluationRole, StudyResult


def summary_html(result: StudyResult) -> str:
    """Return cards of key figures, and sentences about them."""
    sentences = "".join(f"<li>{own}</li>\n" for own in _sentences(result))
    return cards(_cards(result)) + f'<ul class="notes">\n{sentences}</ul>\n'


def _cards(result: StudyResult) -> Iterator[Card]:
    true, false, _ = findings_told(result)
    yield Card(
        title="The paper’s statements that hold here",
        keys=(
            Key(
                value=exact(true, str(true)),
                unit=f"of {true + false}",
                meaning="each with its figure and threshold below",
            ),
        )
        if true + false
        else (),
    )
    for title, variants, role in (
        ("Quality RMSE on unseen features", ("q_k1", "q_k4"), "test"),
        (
            "Exposure-time RMSE on unseen features inside the trained range",
            ("e_k6",),
            "test_inside",
        ),
        ("Quality RMSE, stereo, inside", ("q_k4_s2",), "test_inside"),
        ("Exposure-time RMSE, stereo, inside", ("e_k6_s2",), "test_inside"),
    ):
        keys = [_rmse_key(row) for variant in variants for row in _rows(result, variant, role)]
        yield Card(title=title, keys=tuple(keys))


def _rows(result: StudyResult, variant: str, role: EvaluationRole | str) -> list[Row]:
    """Return the lines of Tables 2, 3 and 5 that have this variant and role, and any rows."""
    return [
        row
        for row in (Row(**cells) for cells in result.tables.scores.iter_rows(named=True))
        if row.variant == variant and row.role == role and row.table in {2, 3, 5} and row.n
    ]


def _rmse_key(row: Row) -> Key:
    paper = ""
    if row.paper_rmse is not None:
        paper = f", the paper {exact(row.paper_rmse, number(row.paper_rmse))} {row.unit}"
    return Key(
        value=exact(row.rmse, number(row.rmse)),
        unit=row.unit,
        meaning=f"{model_name(row.variant)}{paper}",
    )


def _sentences(result: StudyResult) -> Iterator[str]:
    if result.settings.campaigns is None:
        yield (
            "The paper’s study on another cell: its datasets, models, tables and figures, measured "
            "in a <strong>simulated measuring cell</strong> (a car door of bare sheet metal, two "
            "sensors, light and cameras computed from physics). Its numbers are the simulated "
            "cell’s, not those of the authors’ sensors and door; the authors’ recordings are not "
            "public. What to compare is the pattern: which model is better than which, by how "
            "much, and where."
        )
    else:
        yield (
            "The paper’s study on <strong>recorded campaigns</strong>: its datasets, models, "
            "tables and figures. The paper’s numbers stand beside as it printed them; they are of "
            "another part and other sensors."
        )
    if result.settings.quick:
        yield (
            "<strong>The quick study</strong>: some campaigns have only a share of the full "
            "study’s views, and models are trained from fewer starts; what was measured is at the "
            "end of this page."
        )
    yield from _position(result)
    yield from _splits(result)
    yield from _coverage(result)
    yield from _failures(result)


def _position(result: StudyResult) -> Iterator[str]:
    alone, placed = (_rows(result, variant, "test") for variant in ("q_k1", "q_k4"))
    if not alone or not placed:
        return
    first, second = alone[0], placed[0]
    papers = ""
    if first.paper_rmse is not None and second.paper_rmse is not None:
        papers = (
            f"; in the paper it {_change(first.paper_rmse, second.paper_rmse)} it, from "
            f"{exact(first.paper_rmse, number(first.paper_rmse))} to "
            f"{exact(second.paper_rmse, number(second.paper_rmse))} %"
        )
    yield (
        f"Position added to brightness {_change(first.rmse, second.rmse)} the quality model here: "
        "its RMSE on unseen features goes from "
        f"{exact(first.rmse, number(first.rmse))} to {exact(second.rmse, number(second.rmse))} %"
        f"{papers}."
    )


def _change(before: float | None, after: float | None) -> str:
    """Return what an RMSE's change does to a model."""
    if before is None or after is None or before == after:
        return "does not change"
    return "improves" if after < before else "worsens"


def _splits(result: StudyResult) -> Iterator[str]:
    at_random, by_view = (
        _rows(result, "e_k6", role) for role in ("validation", "validation_by_view")
    )
    if at_random and by_view:
        first, second = at_random[0], by_view[0]
        yield (
            "The paper splits training and validation at random over observations, so near copies "
            "of one view fall on both sides. Split by whole views instead, "
            f"{model_name('e_k6')}’s validation RMSE is {exact(second.rmse, number(second.rmse))} "
            f"ms where the random split says {exact(first.rmse, number(first.rmse))} ms: only "
            "unseen features and views tell."
        )


def _coverage(result: StudyResult) -> Iterator[str]:
    said = [
        f"{model_name(variant)} {exact(share, fixed(share, 1))} %"
        for variant, role in (("q_k4", "test"), ("e_k6", "test_inside"))
        for row in _rows(result, variant, role)
        if (share := row.coverage_2sigma_percent) is not None
    ]
    if said:
        yield (
            "Of the unseen observations these shares lie within two predicted standard "
            f"deviations, where 95.4 % is right: {', '.join(said)}."
        )


def _failures(result: StudyResult) -> Iterator[str]:
    failed = [own for own in result.findings if own.holds is False]
    if failed:
        statements = "".join(f"<li>{prose(own.statement)}</li>" for own in failed)
        yield (
            'Statements of the paper that do not hold here (<a href="#s2">Findings</a> has their '
            f'figures, and causes where they were found): <ul class="columns">{statements}</ul>'
        )
