"""The paper's qualitative statements, judged on this cell.

Statements, measures and thresholds stand in ``data/findings.toml`` and were written there before
any was evaluated. Most are a score of Tables 2 to 6, or a ratio or difference of two; what no table
holds is computed in `exposight.paper.special_findings`.
"""

from __future__ import annotations

import operator
import tomllib
from functools import cache
from importlib.resources import files
from typing import TYPE_CHECKING, Annotated, Final, Literal

from pydantic import BaseModel, ConfigDict, Field

from exposight.errors import FormatError
from exposight.paper.results import Finding, SensorKind
from exposight.paper.special_findings import SPECIAL_FIGURES
from exposight.paper.tables import published_scores

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping

    from exposight.paper.results import ScoreRow
    from exposight.paper.special_findings import Evidence


_COMPARISONS: Final[Mapping[str, Callable[[float, float], bool]]] = {
    "≥": operator.ge,
    "≤": operator.le,
}


class Statement(BaseModel):
    """One entry of ``data/findings.toml``; fields as in `Finding` but for these.

    Parameters
    ----------
    first, second : tuple of str
        Scores, as "variant dataset features figure".
    combine : {'value', 'ratio', 'difference'}
        Of each of `first` with its counterpart in `second`.
    pick : {'max', 'min'}
        Which of several counts.
    special : str
        Name in `SPECIAL_FIGURES`, instead of `first` and `second`.
    """

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True)

    name: str
    sensor: SensorKind
    statement: str
    source: str
    measure: str
    comparison: Literal["≥", "≤"]
    threshold: float
    unit: str = ""
    reason: str
    explanation: str = ""
    paper_figure: float | None = None
    first: Annotated[tuple[str, ...], Field(strict=False)] = ()
    second: Annotated[tuple[str, ...], Field(strict=False)] = ()
    combine: Literal["value", "ratio", "difference"] = "value"
    pick: Literal["max", "min"] = "max"
    special: str = ""

    def figure(self, lookup: Callable[[str], float | None]) -> float | None:
        """Return the figure from scores, or None where one is missing."""
        values = []
        for number, name in enumerate(self.first):
            one = lookup(name)
            other = lookup(self.second[number]) if self.second else None
            if one is None or (self.second and other is None):
                return None
            values.append(_combined(self.combine, one, other))
        return (max if self.pick == "max" else min)(values) if values else None


def _combined(combine: str, one: float, other: float | None) -> float:
    if combine == "value" or other is None:
        return one
    return one / other if combine == "ratio" else one - other


_FIGURES: Final = ("r2", "rmse", "coverage_2sigma")

_RULES: Final[Mapping[str, str]] = {
    "half": "at least half of the effect that the paper's figures show",
    "twice": "at most twice the deviation that the paper's figures show",
    "order": "the statement orders two things and gives no size, so the sign decides",
}
"""What the words for a threshold's reason stand for."""


def _spelled(reason: str) -> str:
    word, mark, rest = reason.partition(";")
    return _RULES.get(word, word) + mark + rest


@cache
def statements() -> tuple[Statement, ...]:
    """Return all statements, in the paper's order.

    Raises
    ------
    FormatError
        If the data do not fit together: an unknown score or function, or a name twice.
    """
    text = files("exposight.paper").joinpath("data", "findings.toml").read_text(encoding="utf-8")
    entries = tuple(Statement.model_validate(entry) for entry in tomllib.loads(text)["findings"])
    names = [entry.name for entry in entries]
    for entry in entries:
        fault = _fault(entry)
        if fault or names.count(entry.name) > 1:
            msg = f"findings.toml: {entry.name}: {fault or 'there twice'}"
            raise FormatError(msg)
    return entries


def _fault(entry: Statement) -> str:
    if bool(entry.special) == bool(entry.first):
        return "expected either scores in first, or a function in special"
    if entry.special and entry.special not in SPECIAL_FIGURES:
        return f"no function {entry.special!r}; there are {', '.join(SPECIAL_FIGURES)}"
    if entry.second and len(entry.second) != len(entry.first):
        return "first and second must have the same length"
    if bool(entry.second) == (entry.combine == "value"):
        return "a ratio or difference needs second, a value does not"
    unknown = [name for name in (*entry.first, *entry.second) if not _is_published(name)]
    return f"no such score in the paper's tables: {', '.join(unknown)}" if unknown else ""


def _is_published(name: str) -> bool:
    *line, figure = name.split()
    return tuple(line) in published_scores() and figure in _FIGURES


def judge(
    rows: Iterable[ScoreRow], evidence: Evidence, sensors: Iterable[SensorKind], *, simulated: bool
) -> tuple[Finding, ...]:
    """Say of each of the paper's statements whether it is true on this cell.

    Parameters
    ----------
    rows : iterable of ScoreRow
        Tables 2 to 6.
    evidence : Evidence
        Whatever else the measures need.
    sensors : iterable of {'structured-light', 'stereo'}
        Statements about others are left out.
    simulated : bool
        Whether the data come from the simulated cell, for which explanations are known.

    Returns
    -------
    tuple of Finding
        In the paper's order.
    """
    ours = {(row.variant, row.dataset, row.features): row for row in rows}

    def lookup(name: str) -> float | None:
        variant, dataset, features, figure = name.split()
        row = ours.get((variant, dataset, features))
        return None if row is None else _of_row(row, figure)

    asked = set(sensors)
    return tuple(
        _judged(entry, lookup, evidence, simulated=simulated)
        for entry in statements()
        if entry.sensor in asked
    )


def _judged(
    entry: Statement,
    lookup: Callable[[str], float | None],
    evidence: Evidence,
    *,
    simulated: bool,
) -> Finding:
    special = SPECIAL_FIGURES.get(entry.special)
    figure = special(evidence, entry.sensor) if special else entry.figure(lookup)
    holds = None if figure is None else _COMPARISONS[entry.comparison](figure, entry.threshold)
    paper = entry.paper_figure
    return Finding(
        name=entry.name,
        sensor=entry.sensor,
        statement=entry.statement,
        source=entry.source,
        measure=entry.measure,
        figure=figure,
        comparison=entry.comparison,
        threshold=entry.threshold,
        unit=entry.unit,
        reason=_spelled(entry.reason),
        paper_figure=entry.figure(_paper_figure) if paper is None else paper,
        holds=holds,
        explanation=entry.explanation if simulated and holds is False else "",
    )


def _of_row(row: ScoreRow, figure: str) -> float | None:
    match figure:
        case "r2":
            return row.r2_percent
        case "rmse":
            return row.rmse
    return row.coverage_2sigma_percent


def _paper_figure(name: str) -> float | None:
    """Return the paper's own figure; None where it does not print it."""
    variant, dataset, features, figure = name.split()
    score = published_scores().get((variant, dataset, features))
    if score is None:
        return None
    match figure:
        case "r2":
            return score.r2_percent
        case "rmse":
            return score.rmse
    return None
