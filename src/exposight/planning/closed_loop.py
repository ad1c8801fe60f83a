"""The closed loop: which capture comes next, and what was learnt from the last one.

A state machine without a disk or a clock: it is told what each capture gave, and says which one to
take next, until nothing is left that can be had. Told the same captures again in the same order it
says the same, so a loop that was interrupted goes on from its captures alone.

After each capture features that reached the quality leave; brightness that was measured corrects
the forecast of the others, in this view, in other views and in the whole cell
(`exposight.models.correction`); the next exposure time is that after which fewest are to be
expected: the mean over jointly drawn windows of one more capture and the fewest that what it leaves
needs.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from typing import TypeAlias

import numpy as np
import polars as pl
from numpy.typing import NDArray

from exposight.cell import ActiveSensor, Part
from exposight.errors import InputError
from exposight.geometry import RigidTransform
from exposight.observing import ObservationTable, View
from exposight.planning.beliefs import Belief, belief_of
from exposight.planning.capture_chances import CaptureChances
from exposight.planning.exposure_limits import CaptureCosts, ExposureLimits
from exposight.planning.exposure_plan import Goal
from exposight.planning.lookahead import (
    DRAWS,
    after_misses,
    best_place,
    served_between,
    served_in_draws,
)
from exposight.planning.loop_report import (
    LoopReport,
    Outcome,
    OutcomeStatus,
    Request,
    brightness_of,
    feature_states,
    one_capture,
    what_was_seen,
)
from exposight.planning.outlook import why_not
from exposight.planning.sensor_models import SensorModels
from exposight.tables import counted, number

FloatArray: TypeAlias = NDArray[np.float64]

WORTH_A_CAPTURE = 0.05
"""Least chance for which another capture is taken."""

MOST_TRIES = 5
"""Captures of a view that a feature may miss while its window is looked for."""

_MOST_UNOBSERVED = 2
"""Captures of a view that may not show a feature at all before it is given up there."""

_SETTINGS = 96


class ClosedLoop:
    """Decides capture after capture (`next`), and learns from each (`took`).

    Parameters
    ----------
    models : SensorModels
        What forecasts. Only the default models are corrected by captures jointly.
    rings : polars.DataFrame
        What each view sees: `View.poses` of all views, in the order in which they are visited.
    limits : ExposureLimits
        What the sensor can be set to.
    need : float
        Quality that is asked for, p_norm.
    views_of : mapping of str to str, optional
        The view in which each feature is planned; any that sees it by default.
    poses : mapping of str to RigidTransform, optional
        camera_from_part of the views.
    not_seen : mapping of str to str, optional
        Features that no view sees, and why.
    carried : ObservationTable, optional
        Captures of other views that the same cell has just taken, which correct it from the start.

    costs : CaptureCosts, optional
        What captures take; exposure time alone by default.
    goal : {"count", "time"}
        What there shall be least of.

    Raises
    ------
    InputError
        If no view sees a feature, or one is planned in a view that does not see it.
    """

    def __init__(
        self,
        models: SensorModels,
        rings: pl.DataFrame,
        limits: ExposureLimits,
        *,
        need: float,
        views_of: Mapping[str, str] | None = None,
        poses: Mapping[str, RigidTransform] | None = None,
        not_seen: Mapping[str, str] | None = None,
        carried: ObservationTable | None = None,
        costs: CaptureCosts | None = None,
        goal: Goal = "count",
    ) -> None:
        if rings.height == 0:
            msg = "no view sees a feature: there is nothing to measure"
            raise InputError(msg)
        self.need, self.limits = need, limits
        self._costs, self._goal = costs or CaptureCosts(), goal
        self._poses, self._not_seen = dict(poses or {}), dict(not_seen or {})
        self._order: list[str] = rings["view"].unique(maintain_order=True).to_list()
        self._features = feature_states(rings, self._order, views_of or {})
        self._belief: Belief = belief_of(models, rings, need, limits, carried)
        self._taken: dict[str, list[float]] = {name: [] for name in self._order}
        self._missed: dict[tuple[str, str], list[float]] = {}
        self._lit: dict[tuple[str, str], list[tuple[float, str]]] = {}
        self._unobserved: dict[tuple[str, str], int] = {}
        self._closed: set[tuple[str, str]] = set()
        self._view: str | None = None
        self._captures = 0
        self._request: Request | None = None
        self.log: list[str] = []

    @classmethod
    def of_views(
        cls,
        models: SensorModels,
        part: Part,
        sensor: ActiveSensor,
        poses: Mapping[str, RigidTransform],
        limits: ExposureLimits,
        *,
        need: float,
        features: Iterable[str] | None = None,
        views_of: Mapping[str, str] | None = None,
        costs: CaptureCosts | None = None,
        goal: Goal = "count",
    ) -> ClosedLoop:
        """Return the loop over the views of a part from some poses.

        Parameters
        ----------
        models, limits, need, views_of, costs, goal
            As for the class.
        part : Part
            What is measured.
        sensor : ActiveSensor
            Which measures it.
        poses : mapping of str to RigidTransform
            camera_from_part of each view, in the order in which they are visited.
        features : iterable of str, optional
            Those that are wanted; all by default.

        Raises
        ------
        InputError
            If no view sees a feature that is wanted.
        """
        wanted = list(features) if features is not None else [each.name for each in part.features]
        views = [View.of(part, sensor, pose, name=name) for name, pose in poses.items()]
        rings = pl.concat([view.poses for view in views], how="vertical_relaxed")
        rings = rings.filter(pl.col("feature").is_in(wanted))
        seen = set(rings["feature"])
        not_seen = {}
        for name in wanted:
            if name not in seen:
                states = [
                    each.visibility.value
                    for view in views
                    for each in view.features
                    if each.feature.name == name
                ]
                not_seen[name] = ", ".join(dict.fromkeys(states)) or "not a feature of the part"
        return cls(
            models,
            rings,
            limits,
            need=need,
            views_of=views_of,
            poses=poses,
            not_seen=not_seen,
            costs=costs,
            goal=goal,
        )

    # -- deciding -------------------------------------------------------------------------------

    def next(self) -> Request | None:
        """Return the capture to take next; None when nothing is left that can be had."""
        if self._request is None:
            self._request = self._decide()
        return self._request

    def _decide(self) -> Request | None:
        while (view := self._current_view()) is not None:
            request = self._best_capture(view)
            if request is not None:
                return request
            for name in self._wanted(view):
                self._closed.add((name, view))
        return None

    def _open(self, name: str) -> list[str]:
        """Return the views in which a feature may yet be had, the planned one first."""
        return [view for view in self._features[name].views if (name, view) not in self._closed]

    def _wanted(self, view: str) -> list[str]:
        """Return the features that are to be had in a view now."""
        return [
            name
            for name, each in self._features.items()
            if not each.had and (views := self._open(name)) and views[0] == view
        ]

    def _current_view(self) -> str | None:
        """Stay while there is something to be had; otherwise go to the next planned view."""
        if self._view is not None and self._wanted(self._view):
            return self._view
        for view in self._order:
            if self._wanted(view):
                self._view = view
                return view
        return None

    def _best_capture(self, view: str) -> Request | None:
        limits, taken = self.limits, self._taken[view]
        if limits.most_per_view is not None and len(taken) >= limits.most_per_view:
            self._explain(view, f"{counted(len(taken), 'capture')} a view is the sensor's most")
            return None
        wanted = self._wanted(view)
        others = [
            name
            for name, each in self._features.items()
            if not each.had and name not in wanted and view in self._open(name)
        ]
        chances = self._belief.chances(view, [*wanted, *others], _SETTINGS)
        near = np.isclose(chances.settings_ms[:, None], np.array(taken), rtol=1e-6)
        fresh = ~np.asarray(near.any(axis=1))
        missed = [self._missed.get((name, view), []) for name in chances.features]
        rng = np.random.default_rng(self._captures)
        windows = self._belief.windows(view, chances.features, DRAWS, rng)
        served = None
        if windows is None:
            chance = after_misses(chances.chance, chances.settings_ms, missed)
        else:
            served = served_in_draws(windows, chances.settings_ms, missed, rng)
            for i in np.flatnonzero(served.mean(axis=0).max(axis=1) < WORTH_A_CAPTURE):
                tries = self._lit.get((chances.features[i], view), [])
                between = served_between(windows[:, i], chances.settings_ms, tries, rng)
                if between is not None:
                    served[:, i] = between
            chance = served.mean(axis=0)
        n = len(wanted)
        worth = chance[:n, fresh].max(axis=1, initial=0.0) >= WORTH_A_CAPTURE
        tired = np.array([len(self._missed.get((name, view), ())) >= MOST_TRIES for name in wanted])
        for i in np.flatnonzero(~worth | tired):
            self._close(wanted[i], view, chances, int(i), tired=bool(tired[i]))
        keep = np.flatnonzero(worth & ~tired)
        if not len(keep):
            return None
        costs = np.array([self._costs.capture_ms(ms) for ms in chances.settings_ms])
        place = best_place(
            chance[keep],
            None if served is None else served[:, keep],
            fresh,
            costs if self._goal == "time" else None,
            chance[n:].sum(axis=0),
        )
        return self._request_of(view, chances, chance, place, [int(i) for i in keep])

    def _request_of(
        self,
        view: str,
        chances: CaptureChances,
        chance: FloatArray,
        place: int,
        keep: list[int],
    ) -> Request:
        exposure_ms = float(chances.settings_ms[place])
        keep = sorted(keep, key=lambda i: -float(chance[i, place]))
        for i in keep:
            feature = self._features[chances.features[i]]
            if feature.promised is None and chance[i, place] >= 0.5:
                feature.promised = float(chance[i, place])
        likely = [chances.features[i] for i in keep if chance[i, place] >= 0.5]
        expected = float(chance[keep, place].sum())
        left = f"{counted(len(keep), 'feature')} left in this view"
        first = "first capture" if not self._taken[view] else "next capture"
        why = f"{view}, {first}: {number(exposure_ms)} ms, expected to get {expected:.1f} of {left}"
        if likely:
            least = min(float(chance[i, place]) for i in keep if chance[i, place] >= 0.5)
            why += f" ({len(likely)} of them likely, each with {100 * least:.0f} % or more)"
        return Request(
            view=view,
            exposure_ms=exposure_ms,
            set_value=self.limits.set_value(exposure_ms),
            set_unit=self.limits.unit,
            camera_from_part=self._poses.get(view),
            features=tuple(chances.features[i] for i in keep),
            expected=expected,
            why=why,
        )

    def _close(self, name: str, view: str, chances: CaptureChances, i: int, *, tired: bool) -> None:
        self._closed.add((name, view))
        missed = self._missed.get((name, view), [])
        low, high = chances.windows_ms[i].tolist()
        if tired or any(low <= each <= high for each in missed):
            reason = what_was_seen(self._lit[name, view])
        else:
            reason = chances.reasons[i] or why_not(chances, i, self.limits, possible=False)
        self._features[name].reason = f"{view}: {reason}"

    def _close_unobserved(self, view: str, rows: ObservationTable, asked: Collection[str]) -> None:
        """Give up features that captures of a view do not show, however often they are asked."""
        states = dict(rows.frame.select("feature", "visibility").iter_rows())
        shown = {*rows.measured().frame["feature"]}
        for name in (each for each in asked if each not in shown):
            key = (name, view)
            self._unobserved[key] = self._unobserved.get(key, 0) + 1
            if self._unobserved[key] >= _MOST_UNOBSERVED:
                self._closed.add(key)
                state = states.get(name, "not among its observations")
                state = "without a value" if state == "visible" else state
                self._features[name].reason = f"{view}: captures do not show it: {state}"

    def _explain(self, view: str, reason: str) -> None:
        for name in self._wanted(view):
            self._features[name].reason = f"{view}: {reason}"

    # -- learning -------------------------------------------------------------------------------

    def took(self, rows: ObservationTable) -> str:
        """Learn from one capture, and return what it gave in a line.

        Parameters
        ----------
        rows : ObservationTable
            What the capture showed of its view, exposure time as read back. Rows of features that
            are not wanted are ignored.

        Raises
        ------
        ObservationError
            If it is of no view, or of several captures.
        """
        view, exposure_ms = one_capture(rows, self._order)
        asked = self._request if self._request is not None and self._request.view == view else None
        self._captures += 1
        self._taken[view].append(exposure_ms)
        if asked is not None:  # a sensor that takes another exposure time is not asked again
            self._taken[view].append(asked.exposure_ms)
        self._request, self._view = None, view
        got, missed = [], []
        measured = rows.measured()
        self._close_unobserved(view, rows, () if asked is None else asked.features)
        lit = brightness_of(measured.frame)
        for name, p_norm in measured.frame.select("feature", "p_norm").iter_rows():
            feature = self._features.get(name)
            if feature is None or view not in feature.views:
                continue
            if feature.p_norm is None or p_norm > feature.p_norm:
                feature.p_norm, feature.best = float(p_norm), (view, exposure_ms)
            if feature.had:
                continue
            feature.tries += 1
            if p_norm >= self.need:
                feature.had, feature.reason = True, ""
                got.append(name)
            else:
                missed.append(name)
                self._missed.setdefault((name, view), []).append(exposure_ms)
                self._lit.setdefault((name, view), []).append((exposure_ms, lit[name]))
        note = self._belief.took(measured)
        left = sum(not each.had and bool(self._open(n)) for n, each in self._features.items())
        line = f"{view}, {number(exposure_ms)} ms: got {len(got)}"
        line += f" ({', '.join(got)})" if 0 < len(got) <= 6 else ""
        line += f", missed {', '.join(missed)}" if 0 < len(missed) <= 6 else ""
        line += f"; {counted(left, 'feature')} left" + (f"; {note}" if note else "")
        self.log.append(line)
        return line

    # -- reporting ------------------------------------------------------------------------------

    @property
    def outcomes(self) -> tuple[Outcome, ...]:
        """What became of each feature so far."""
        done = self.next() is None
        out = []
        for name, each in self._features.items():
            status: OutcomeStatus = "had" if each.had else "given up"
            if not each.had and not done and self._open(name):
                status = "open"
            view, exposure_ms = each.best or (None, None)
            reason = "" if each.had or status == "open" else each.reason
            out.append(
                Outcome(
                    feature=name,
                    status=status,
                    p_norm=each.p_norm,
                    view=view,
                    exposure_ms=exposure_ms,
                    tries=each.tries,
                    promised=each.promised,
                    reason=reason,
                )
            )
        out += [
            Outcome(feature=name, status="not seen", reason=reason)
            for name, reason in self._not_seen.items()
        ]
        return tuple(out)

    @property
    def n_captures(self) -> int:
        """Captures that were taken."""
        return self._captures

    @property
    def report(self) -> LoopReport:
        """What was had so far, and what was learnt on the way."""
        return LoopReport(outcomes=self.outcomes, n_captures=self._captures, log=tuple(self.log))
