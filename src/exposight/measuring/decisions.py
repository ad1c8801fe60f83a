"""What a closed loop decided, a line for each capture, and what became of the features.

Decisions follow from the captures alone: a loop that is fed the same captures in the same order
says the same again.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Protocol

import numpy as np
import polars as pl

from exposight.cell import Part, same_exposure
from exposight.files import DocumentFormat, csv_of, write_durably
from exposight.geometry import RigidTransform
from exposight.observing import ObservationTable
from exposight.planning import ExposurePlan
from exposight.planning.loop_report import LoopReport, Outcome, Request
from exposight.tables import Column, Table, counted, number

HAD, OPEN = "had", "open"
"""Of `Outcome.status`: the quality that is needed was measured; it may still be."""

MISPLACED_MM = 6.0
"""A pose read back that moves a feature farther than this is remarked upon: the paper notes errors
of up to 5 mm of a robot's kinematics (end of Sect. 3.2.2), and a turn adds a little."""


class Loop(Protocol):
    """What decides: a state machine that knows no disk, sensor or clock (`ClosedLoop`)."""

    def next(self) -> Request | None:
        """Return what to capture next; None where nothing is left that can be had."""
        ...

    def took(self, rows: ObservationTable) -> str:
        """Take note of what one capture gave, exposure time as read back; say so in a line."""
        ...

    @property
    def outcomes(self) -> tuple[Outcome, ...]:
        """What has become of each feature so far."""
        ...


@dataclass(frozen=True, kw_only=True)
class Decision:
    """A capture of a closed loop: what was asked for and why, what was taken, what came of it.

    Parameters
    ----------
    number : int
        The capture's number, from 0 up.
    view : str
        The view that was captured.
    asked_ms : float or None, ms
        Exposure time that was asked for; None where a capture came that was not asked for.
    exposure_ms : float, ms
        Exposure time as read back.
    features : tuple of str
        Features that it was aimed at.
    why : str
        Why it was taken.
    gave : str
        What it gave, and what was learnt from it.
    succeeded : tuple of str
        Features whose quality this capture was the first to reach.
    left : int
        How many features are still open.
    remark : str
        What is odd about it.
    """

    number: int
    view: str
    asked_ms: float | None
    exposure_ms: float
    features: tuple[str, ...]
    why: str
    gave: str
    succeeded: tuple[str, ...]
    left: int
    remark: str = ""

    def __str__(self) -> str:
        remark = f" ({self.remark})" if self.remark else ""
        return f"{self.number + 1}. {self.why} → {self.gave}{remark}"


def feed(
    loop: Loop,
    number: int,
    rows: ObservationTable,
    request: Request | None,
    remark: str = "",
) -> Decision:
    """Let a loop take note of a capture, and return what was decided.

    Parameters
    ----------
    loop : Loop
    number : int
        The capture's.
    rows : ObservationTable
        What its observation gave.
    request : Request or None
        What the loop asked for (`Loop.next`).
    remark : str
        What is odd about the capture.
    """
    view, exposure_ms = str(rows.frame["view"][0]), float(rows.frame["exposure_ms"][0])
    had = {each.feature for each in loop.outcomes if each.status == HAD}
    asked = request if request is not None and request.view == view else None
    gave = loop.took(rows)
    after = loop.outcomes
    return Decision(
        number=number,
        view=view,
        asked_ms=asked.exposure_ms if asked else None,
        exposure_ms=exposure_ms,
        features=asked.features if asked else (),
        why=asked.why if asked else _not_asked_for(view, exposure_ms, request),
        gave=gave,
        succeeded=tuple(e.feature for e in after if e.status == HAD and e.feature not in had),
        left=sum(each.status == OPEN for each in after),
        remark=remark,
    )


def _not_asked_for(view: str, exposure_ms: float, request: Request | None) -> str:
    wanted = "nothing" if request is None else f"{request.view}, {number(request.exposure_ms)} ms"
    return f"{view}, {number(exposure_ms)} ms: not asked for, {wanted} was"


def exposure_remark(
    request: Request | None, view: str, exposure_ms: float, increment_ms: float
) -> str:
    """Return a remark where an exposure time read back is not the one asked for.

    Parameters
    ----------
    request : Request or None
        What was asked for; of another view it is no matter.
    view, exposure_ms : str, float in ms
        What was captured.
    increment_ms : float, ms
        The sensor's, by which they may differ.
    """
    asked = None if request is None or request.view != view else request.exposure_ms
    if asked is None or same_exposure(asked, exposure_ms, increment_ms):
        return ""
    return (
        f"the sensor took {number(exposure_ms)} ms where {number(asked)} ms was asked for: check "
        "its setting and the unit"
    )


def pose_remark(
    part: Part, request: Request | None, view: str, camera_from_part: RigidTransform
) -> str:
    """Return a remark where a pose read back is another one than the pose asked for."""
    asked = None if request is None or request.view != view else request.camera_from_part
    if asked is None:
        return ""
    places_mm = np.array([each.part_from_feature.translation_mm for each in part.features])
    shift_mm = asked.apply(places_mm) - camera_from_part.apply(places_mm)
    farthest_mm = float(np.linalg.norm(shift_mm, axis=1).max())
    if farthest_mm <= MISPLACED_MM:
        return ""
    return f"by the pose read back, features lie up to {farthest_mm:.0f} mm elsewhere than asked"


# -- outcomes -----------------------------------------------------------------------------------

_COLUMNS = (
    Column(name="feature"),
    Column(name="status"),
    Column(name="p_norm", decimals=2),
    Column(name="view"),
    Column(name="exposure_ms"),
    Column(name="tries"),
    Column(name="planned_chance", label="planned\nchance %", decimals=0, scale=100.0),
    Column(name="reason", wraps=True),
)


def outcomes_frame(outcomes: Sequence[Outcome], plan: ExposurePlan) -> pl.DataFrame:
    """Return a row for each feature: fields of `Outcome`, and the plan's chance."""
    report = LoopReport(outcomes=tuple(outcomes), n_captures=0, log=())
    planned = {each.feature: each.chance for each in plan.features}
    chances = [planned[each.feature] for each in outcomes]
    return report.frame.with_columns(pl.Series("planned_chance", chances, dtype=pl.Float64))


def outcomes_table(outcomes: Sequence[Outcome], plan: ExposurePlan) -> Table:
    """Return what became of each feature, beside what the plan promised."""
    frame = outcomes_frame(outcomes, plan)
    failed = any(each.reason for each in outcomes)
    columns = _COLUMNS if failed else _COLUMNS[:-1]
    return Table(name="outcomes", frame=frame, columns=columns)


def verdict(outcomes: Sequence[Outcome], captures: int, plan: ExposurePlan) -> str:
    """Return how many features succeeded of how many that were promised, and which failed."""
    had = sum(each.status == HAD for each in outcomes)
    text = (
        f"{counted(captures, 'capture')}: {had} of {len(outcomes)} features succeeded, "
        f"{number(plan.promise.expected_covered, 3)} were promised"
    )
    failed = (f"{e.feature} failed because {e.reason}" for e in outcomes if e.status != HAD)
    return "; ".join((text, *failed))


# -- on disk ------------------------------------------------------------------------------------

DECISIONS_FILE, OUTCOMES_FILE, RESULT_FILE = "decisions.jsonl", "outcomes.csv", "result.json"


@dataclass(frozen=True, kw_only=True)
class _Result:
    """What ``result.json`` says."""

    captures: int
    features: int
    promised: float
    achieved: int
    outcomes: tuple[dict[str, Any], ...]


_RESULT = DocumentFormat("exposight measuring result", 1, _Result)


def write_decisions(folder: Path, decisions: Sequence[Decision]) -> None:
    """Write all decisions so far, durably, as JSON lines."""
    lines = (json.dumps(asdict(each), ensure_ascii=False) for each in decisions)
    write_durably(folder / DECISIONS_FILE, "".join(f"{line}\n" for line in lines).encode())


def write_outcomes(
    folder: Path, outcomes: Sequence[Outcome], captures: int, plan: ExposurePlan
) -> None:
    """Write what became of each feature, as a table and as a document, durably."""
    frame = outcomes_frame(outcomes, plan)
    write_durably(folder / OUTCOMES_FILE, csv_of(frame))
    result = _Result(
        captures=captures,
        features=len(outcomes),
        promised=plan.promise.expected_covered,
        achieved=sum(each.status == HAD for each in outcomes),
        outcomes=tuple(frame.iter_rows(named=True)),
    )
    write_durably(folder / RESULT_FILE, _RESULT.to_json(result).encode())
