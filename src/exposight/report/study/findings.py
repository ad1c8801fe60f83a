"""The paper's statements, each true or false here, with its figure and its threshold."""

from __future__ import annotations

from typing import TYPE_CHECKING

from exposight.report.markup import Heading, exact, number, table, with_unit
from exposight.report.study.words import SENSOR_TITLES, prose

if TYPE_CHECKING:
    from exposight.paper import Finding, SensorKind, StudyResult


_HEADINGS = (
    Heading(text="holds", is_text=True),
    Heading(text="statement and where the paper makes it", is_text=True),
    Heading(text="judged by", is_text=True),
    Heading(text="here"),
    Heading(text="paper"),
    Heading(text="threshold, and why", is_text=True),
)


def findings_told(result: StudyResult) -> tuple[int, int, int]:
    """Return how many statements are true, false, and not decided."""
    judged = [own.holds for own in result.findings]
    return judged.count(True), judged.count(False), judged.count(None)


def findings_html(result: StudyResult) -> str:
    """Return the findings, a table for each sensor."""
    return _INTRODUCTION + "".join(_sensor_table(result, own) for own in result.settings.sensors)


_INTRODUCTION = (
    "<p>Statements, measures and thresholds were written down before any of them was evaluated. A "
    "threshold asks for half of the effect that the paper’s own numbers show, for at most twice "
    "the deviation that they show, or lies midway between the two that a statement contrasts; "
    "where a statement only orders two things, the sign decides. Other reasons stand beside it."
    "</p>\n"
)


def _sensor_table(result: StudyResult, sensor: SensorKind) -> str:
    own = [finding for finding in result.findings if finding.sensor == sensor]
    if not own:
        return ""
    true = sum(finding.holds is True for finding in own)
    open_ = sum(finding.holds is None for finding in own)
    left = f", {open_} cannot be said" if open_ else ""
    caption = f"<b>The {SENSOR_TITLES[sensor]}.</b> {true} of {len(own)} statements hold{left}."
    body = table(
        _HEADINGS, [_row(finding) for finding in own], name=f"findings-{sensor}", caption=caption
    )
    return f'<div class="findings">{body}</div>\n'


def _row(own: Finding) -> list[str]:
    return [
        _verdict(own),
        prose(own.statement) + _under(own.source) + _under(own.explanation),
        prose(own.measure),
        _figure(own.figure, own.unit),
        _figure(own.paper_figure, own.unit),
        f"{own.comparison} {_figure(own.threshold, own.unit)}{_under(own.reason)}",
    ]


def _verdict(own: Finding) -> str:
    kind, word = {True: ("yes", "✓ true"), False: ("no", "✗ false"), None: ("open", "– open")}[
        own.holds
    ]
    return f'<span class="verdict {kind}">{word}</span>'


def _figure(value: float | None, unit: str) -> str:
    if value is None:
        return exact(None)
    return with_unit(exact(value, number(value)), unit)


def _under(text: str) -> str:
    return f'<span class="under">{prose(text)}</span>' if text else ""
