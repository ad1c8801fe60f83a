"""One of the paper's statements, judged."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

if TYPE_CHECKING:
    from exposight.paper.result.settings import SensorKind


@dataclass(frozen=True, kw_only=True)
class Finding:
    """One of the paper's statements, judged on this cell.

    Statement, measure, threshold and reason are data (``paper/data/findings.toml``), fixed before
    anything was evaluated.

    Parameters
    ----------
    name : str
        Short and unique, for instance ``light-alone-exposure``.
    sensor : str
        Which sensor's.
    statement : str
        What the paper says.
    source : str
        Where: section, table, figure.
    measure : str
        What the figure is, in words.
    figure : float or None
        What came out; None where it cannot be said (its rows were not measured).
    comparison : {'≥', '≤'}
        How the figure must stand to the threshold for the statement to be true.
    threshold : float
        In `unit`.
    unit : str
        Of figure and threshold; empty for a pure number.
    reason : str
        Why this threshold.
    paper_figure : float or None
        The same figure from the paper's numbers; None where they do not give it.
    holds : bool or None
        Whether it is true here; None where the figure is.
    explanation : str
        What was found to be the cause where it does not hold on the simulated cell; else empty.
    """

    name: str
    sensor: SensorKind
    statement: str
    source: str
    measure: str
    figure: float | None
    comparison: Literal["≥", "≤"]
    threshold: float
    unit: str
    reason: str
    paper_figure: float | None
    holds: bool | None
    explanation: str
