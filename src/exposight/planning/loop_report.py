"""What a closed loop asks for next, and what became of each feature."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
import polars as pl

from exposight.errors import InputError, ObservationError
from exposight.geometry import RigidTransform
from exposight.models.ring_data import clipped_share
from exposight.observing import ObservationTable
from exposight.tables import Column, Table, counted, number

OutcomeStatus = Literal["had", "open", "given up", "not seen"]


_HIGHEST = 2.0
"""p_norm beyond which a table holds something else: points number as pixels, but for noise."""

_CLIPS = 0.25
"""Share of a ring that clips, or has too little modulation, from which it is why a ring fails."""


@dataclass(frozen=True, kw_only=True)
class Request:
    """The capture to take next.

    Parameters
    ----------
    view : str
    exposure_ms : float, ms
        Exposure time, a setting of the sensor.
    set_value, set_unit : float, str
        The same as the sensor is set to it.
    camera_from_part : RigidTransform or None
        Where the part shall stand; None where views are known by name alone.
    features : tuple of str
        Features of the view that are still to be had, those likely from this capture first.
    expected : float
        How many of them to expect from it.
    why : str
        The decision in a line.
    """

    view: str
    exposure_ms: float
    set_value: float
    set_unit: str
    camera_from_part: RigidTransform | None
    features: tuple[str, ...]
    expected: float
    why: str


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """What became of a feature.

    Parameters
    ----------
    feature : str
    status : {"had", "open", "given up", "not seen"}
        It reached the quality; is yet to be had; cannot be had; or no view sees it.
    p_norm : float or None
        The best that was measured.
    view, exposure_ms : str or None, float or None
        The capture that gave it.
    tries : int
        Captures that saw it until it was had.
    promised : float or None
        Chance that was forecast for the capture that it was had by, or first tried by.
    reason : str
        Why it is not had; empty where it is.
    """

    feature: str
    status: OutcomeStatus
    p_norm: float | None = None
    view: str | None = None
    exposure_ms: float | None = None
    tries: int = 0
    promised: float | None = None
    reason: str = ""


@dataclass(frozen=True, kw_only=True)
class LoopReport:
    """What was had.

    Parameters
    ----------
    outcomes : tuple of Outcome
        A feature each.
    n_captures : int
        Captures that were taken.
    log : tuple of str
        What each of them gave.
    """

    outcomes: tuple[Outcome, ...]
    n_captures: int
    log: tuple[str, ...]

    @property
    def verdict(self) -> str:
        """What was had, in a sentence."""
        outcomes = self.outcomes
        had = sum(each.status == "had" for each in outcomes)
        return (
            f"{had} of {counted(len(outcomes), 'feature')} had with "
            f"{counted(self.n_captures, 'capture')}"
        )

    @property
    def frame(self) -> pl.DataFrame:
        """A row for each feature, columns as in `Outcome`; ``chance_when_taken`` is `promised`."""
        schema = {
            "feature": pl.String,
            "status": pl.String,
            "p_norm": pl.Float64,
            "view": pl.String,
            "exposure_ms": pl.Float64,
            "tries": pl.Int64,
            "chance_when_taken": pl.Float64,
            "reason": pl.String,
        }
        rows = [{**vars(each), "chance_when_taken": each.promised} for each in self.outcomes]
        return pl.DataFrame(rows, schema=schema, orient="row")

    @property
    def table(self) -> Table:
        """The features, those that are not had first."""
        frame = self.frame.with_columns((pl.col("status") == "had").alias("_had"))
        columns = (
            Column(name="feature"),
            Column(name="status"),
            Column(name="p_norm", decimals=2),
            Column(name="view"),
            Column(name="exposure_ms", digits=4),
            Column(name="tries"),
            Column(
                name="chance_when_taken", label="chance\nwhen\ntaken %", decimals=0, scale=100.0
            ),
            Column(name="reason", wraps=True),
        )
        some = frame["reason"].str.len_chars().sum() > 0
        return Table(
            name="outcomes",
            frame=frame.sort("_had", maintain_order=True).drop("_had"),
            columns=columns if some else columns[:-1],
        )

    def __str__(self) -> str:
        return "\n".join((*self.log, self.verdict, str(self.table)))

    def _repr_html_(self) -> str:
        return f"<p>{self.verdict}</p>{self.table._repr_html_()}"


def one_capture(rows: ObservationTable, views: Collection[str]) -> tuple[str, float]:
    """Return the view and the exposure time in ms of one capture's rows.

    Raises
    ------
    ObservationError
        If they are of several captures, or of none of the views.
    """
    captures = rows.frame.select("view", "exposure_ms").unique()
    if captures.height != 1:
        msg = f"expected the rows of one capture, got {captures.height} captures"
        raise ObservationError(msg)
    view, exposure_ms = captures.row(0)
    if view not in views:
        msg = f"the capture is of view {view!r}, which the plan does not have: {', '.join(views)}"
        raise ObservationError(msg)
    highest = max(rows.frame["p_norm"].drop_nulls().to_list(), default=0.0)
    if highest > _HIGHEST:
        msg = f"a p_norm of {highest:.3g} is no share of a ring's points; check if it is in percent"
        raise ObservationError(msg)
    return str(view), float(exposure_ms)


def brightness_of(frame: pl.DataFrame) -> dict[str, str]:
    """Return of each row's feature whether it "clips", is "dark", or neither, which is empty."""
    clips = clipped_share(frame) > _CLIPS
    weak = np.zeros(frame.height)
    if "low_modulation_share" in frame.columns:
        weak = frame["low_modulation_share"].fill_null(0.0).to_numpy()
    names = frame["feature"].to_list()
    return {
        name: "clips" if clips[i] else "dark" if weak[i] > _CLIPS else ""
        for i, name in enumerate(names)
    }


def what_was_seen(tries: Sequence[tuple[float, str]]) -> str:
    """Say what came of the exposure times, ms, by which a feature was missed."""
    said = {
        "dark": "too dark at {} ms",
        "clips": "clips at {} ms",
        "": "missed at {} ms although neither dark nor clipped: hidden, out of place, or not as "
        "the pose says",
    }
    parts = []
    for kind, text in said.items():
        times = dict.fromkeys(number(each) for each, lit in tries if lit == kind)
        if times:
            parts.append(text.format(", ".join(times)))
    return "; ".join(parts)


@dataclass(kw_only=True)
class FeatureState:
    """What is known of a feature while measuring."""

    views: list[str]
    """Views that see it, the planned one first."""
    had: bool = False
    p_norm: float | None = None
    best: tuple[str, float] | None = None
    tries: int = 0
    promised: float | None = None
    reason: str = ""


def feature_states(
    rings: pl.DataFrame, order: list[str], planned: Mapping[str, str]
) -> dict[str, FeatureState]:
    """Return the features of some rings, each with the views that see it, its planned one first.

    Raises
    ------
    InputError
        If one is planned in a view that does not see it.
    """
    views: dict[str, list[str]] = {}
    for name, view in rings.select("feature", "view").iter_rows():
        views.setdefault(name, []).append(view)
    place = {view: i for i, view in enumerate(order)}
    for name, view in planned.items():
        if name in views and view not in views[name]:
            msg = f"feature {name!r} is planned in view {view!r}, which does not see it"
            raise InputError(msg)
    return {
        name: FeatureState(views=sorted(each, key=lambda v: (v != planned.get(name), place[v])))
        for name, each in views.items()
    }
