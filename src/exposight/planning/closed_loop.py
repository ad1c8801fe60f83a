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

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np
import polars as pl
from numpy.typing import NDArray

from exposight.cell import ActiveSensor, Part
from exposight.compiled import njit
from exposight.errors import InputError, ObservationError
from exposight.geometry import RigidTransform
from exposight.observing import ObservationTable, View
from exposight.planning.beliefs import Belief, belief_of
from exposight.planning.capture_chances import CaptureChances
from exposight.planning.exposure_limits import ExposureLimits
from exposight.planning.sensor_models import SensorModels
from exposight.tables import Column, Table, counted, number

FloatArray: TypeAlias = NDArray[np.float64]
BoolArray: TypeAlias = NDArray[np.bool_]

OutcomeStatus = Literal["had", "open", "given up", "not seen"]

WORTH_A_CAPTURE = 0.05
"""Least chance for which another capture is taken."""

MOST_TRIES = 5
"""Captures of a view that a feature may miss while its window is looked for."""

_DRAWS = 256
_SCENARIOS = 64
_FEWEST_DRAWS = 8
"""So many draws must agree with what a feature missed; otherwise its window lies elsewhere."""

_ELSEWHERE = 0.6
"""Standard deviation of ln exposure time about a window that was not where it was expected."""

_SETTINGS = 96


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


@dataclass(kw_only=True)
class _Feature:
    """What is known of a feature while measuring."""

    views: list[str]
    """Views that see it, the planned one first."""
    had: bool = False
    p_norm: float | None = None
    best: tuple[str, float] | None = None
    tries: int = 0
    promised: float | None = None
    reason: str = ""


class ClosedLoop:
    """Decides capture after capture (`next`), and learns from each (`took`).

    Parameters
    ----------
    models : SensorModels
        What forecasts. Only the default models are corrected by captures jointly.
    rings : polars.DataFrame
        What each view sees: `View.frame` of all views, in the order in which they are visited.
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
    ) -> None:
        if rings.height == 0:
            msg = "no view sees a feature: there is nothing to measure"
            raise InputError(msg)
        self.need, self.limits = need, limits
        self._poses, self._not_seen = dict(poses or {}), dict(not_seen or {})
        self._order: list[str] = rings["view"].unique(maintain_order=True).to_list()
        self._features = _features_of(rings, self._order, views_of or {})
        self._belief: Belief = belief_of(models, rings, need, limits, carried)
        self._taken: dict[str, list[float]] = {name: [] for name in self._order}
        self._missed: dict[tuple[str, str], list[float]] = {}
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
    ) -> ClosedLoop:
        """Return the loop over the views of a part from some poses.

        Parameters
        ----------
        models, limits, need, views_of
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
        rings = pl.concat([view.frame for view in views], how="vertical_relaxed")
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
        fresh = ~np.isclose(chances.settings_ms[:, None], taken, rtol=1e-6).any(axis=1)
        served = self._draws(view, chances)
        if served is None:
            chance = self._after_misses(view, chances)
            scenarios = None
        else:
            chance = served.mean(axis=0)
            scenarios = served[:_SCENARIOS]
        n = len(wanted)
        worth = chance[:n, fresh].max(axis=1, initial=0.0) >= WORTH_A_CAPTURE
        tired = np.array([len(self._missed.get((name, view), ())) >= MOST_TRIES for name in wanted])
        for i in np.flatnonzero(~worth | tired):
            self._close(wanted[i], view, chances, int(i), tired=bool(tired[i]))
        keep = np.flatnonzero(worth & ~tired)
        if not len(keep):
            return None
        expected = chance[keep].sum(axis=0)
        if scenarios is None:
            cost = -expected
        else:
            cost = 1.0 + _captures_left(np.ascontiguousarray(scenarios[:, keep]))
        cost = np.where(fresh & (expected >= WORTH_A_CAPTURE), cost, np.inf)
        near = cost <= cost.min() + 1e-9
        extra = chance[n:].sum(axis=0)
        score = np.where(near, expected + 1e-2 * extra, -np.inf)
        alike = np.flatnonzero(score >= score.max() - 1e-3)
        place = int(alike[len(alike) // 2])
        return self._request_of(view, chances, chance, place, [int(i) for i in keep])

    def _draws(self, view: str, chances: CaptureChances) -> BoolArray | None:
        """Return in which of jointly drawn cells each setting serves each feature, (d, n, m).

        Draws that contradict what a feature missed are replaced; None of models without windows.
        """
        rng = np.random.default_rng(self._captures)
        windows = self._belief.windows(view, chances.features, _DRAWS, rng)
        if windows is None:
            return None
        settings = chances.settings_ms
        served = _within(windows, settings)
        for i, name in enumerate(chances.features):
            missed = self._missed.get((name, view), [])
            if not missed:
                continue
            agrees = ~_within(windows[:, i : i + 1], np.array(missed)).any(axis=(1, 2))
            agrees &= np.isfinite(windows[:, i, 0])
            kept = np.flatnonzero(agrees)
            if len(kept) < _FEWEST_DRAWS:
                moved = windows[:, i] * np.exp(_ELSEWHERE * rng.standard_normal((_DRAWS, 1)))
                elsewhere = ~_within(moved[:, None], np.array(missed)).any(axis=(1, 2))
                share = 0.5 ** len(missed)  # that it can be had at all
                again = _within(moved[:, None], settings)[:, 0]
                served[:, i] = again & (elsewhere & (rng.random(_DRAWS) < share))[:, None]
            else:
                chosen = np.where(agrees, np.arange(_DRAWS), rng.choice(kept, _DRAWS))
                served[:, i] = served[chosen, i]
        return served

    def _after_misses(self, view: str, chances: CaptureChances) -> FloatArray:
        """Return each capture's chance, less what was missed already, (n, m)."""
        out = chances.chance.copy()
        for i, name in enumerate(chances.features):
            for missed in self._missed.get((name, view), ()):
                far = np.abs(np.log(chances.settings_ms / missed))
                out[i] *= np.clip(far / _ELSEWHERE, 0.0, 1.0)
        return out

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
        feature = self._features[name]
        missed = self._missed.get((name, view), [])
        low, high = chances.windows_ms[i].tolist()
        limits = self.limits
        window = f"{number(low, 3)}–{number(high, 3)} ms"
        if tired or (missed and any(low <= each <= high for each in missed)):
            times = ", ".join(number(each) for each in missed)
            reason = (
                f"missed at {times} ms although its brightness was right: hidden, out of place, or "
                "not as the pose says"
            )
        elif chances.reasons[i]:
            reason = chances.reasons[i]
        elif chances.never and chances.never[i]:
            reason = chances.never[i]
        elif low > limits.max_ms:
            reason = f"too dark: needs {window}, the longest is {number(limits.max_ms)} ms"
        elif high < limits.min_ms:
            reason = f"too bright: needs {window}, the shortest is {number(limits.min_ms)} ms"
        else:
            reason = limits.why_none(low, high) or f"not at {window}"
        feature.reason = f"{view}: {reason}"

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
        view, exposure_ms = _one_capture(rows, self._order)
        self._captures += 1
        self._taken[view].append(exposure_ms)
        self._request, self._view = None, view
        got, missed = [], []
        measured = rows.measured()
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
    def verdict(self) -> str:
        """What was had, in a sentence."""
        outcomes = self.outcomes
        had = sum(each.status == "had" for each in outcomes)
        return (
            f"{had} of {counted(len(outcomes), 'feature')} had with "
            f"{counted(self._captures, 'capture')}"
        )

    @property
    def frame(self) -> pl.DataFrame:
        """A row for each feature, columns as in `Outcome`."""
        schema = {
            "feature": pl.String,
            "status": pl.String,
            "p_norm": pl.Float64,
            "view": pl.String,
            "exposure_ms": pl.Float64,
            "tries": pl.Int64,
            "promised": pl.Float64,
            "reason": pl.String,
        }
        rows = [vars(each) for each in self.outcomes]
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
            Column(name="promised", label="promised\n%", decimals=0, scale=100.0),
            Column(name="reason", wraps=True),
        )
        some = frame["reason"].str.len_chars().sum() > 0
        return Table(
            name="outcomes",
            frame=frame.sort("_had", maintain_order=True).drop("_had"),
            columns=columns if some else columns[:-1],
        )


def _features_of(
    rings: pl.DataFrame, order: list[str], planned: Mapping[str, str]
) -> dict[str, _Feature]:
    views: dict[str, list[str]] = {}
    for name, view in rings.select("feature", "view").iter_rows():
        views.setdefault(name, []).append(view)
    place = {view: i for i, view in enumerate(order)}
    for name, view in planned.items():
        if name in views and view not in views[name]:
            msg = f"feature {name!r} is planned in view {view!r}, which does not see it"
            raise InputError(msg)
    return {
        name: _Feature(views=sorted(each, key=lambda v: (v != planned.get(name), place[v])))
        for name, each in views.items()
    }


def _one_capture(rows: ObservationTable, views: list[str]) -> tuple[str, float]:
    captures = rows.frame.select("view", "exposure_ms").unique()
    if captures.height != 1:
        msg = f"expected the rows of one capture, got {captures.height} captures"
        raise ObservationError(msg)
    view, exposure_ms = captures.row(0)
    if view not in views:
        msg = f"the capture is of view {view!r}, which the plan does not have: {', '.join(views)}"
        raise ObservationError(msg)
    return str(view), float(exposure_ms)


def _within(windows_ms: FloatArray, settings_ms: FloatArray) -> BoolArray:
    """Return which settings lie in which windows, (d, n, m); none in a window that is NaN."""
    low, high = windows_ms[..., 0, None], windows_ms[..., 1, None]
    out: BoolArray = (low <= settings_ms) & (settings_ms <= high)
    return out


@njit()
def _captures_left(served: BoolArray) -> FloatArray:  # pragma: no cover - compiled
    """Return the mean number of captures that are needed after one at each setting, (m,).

    Features that no setting serves do not count. Windows are intervals, so the sweep from the left
    that takes the last setting of the first window to end needs fewest.
    """
    draws, n, m = served.shape
    total = np.zeros(m)
    first, last = np.empty(n, np.int64), np.empty(n, np.int64)
    for d in range(draws):
        for i in range(n):
            first[i], last[i] = m, -1
            for j in range(m):
                if served[d, i, j]:
                    first[i] = min(first[i], j)
                    last[i] = j
        order = np.argsort(last)
        for t in range(m):
            at, needed = -1, 0
            for k in range(n):
                i = order[k]
                if last[i] < 0 or served[d, i, t] or first[i] <= at:
                    continue
                at = last[i]
                needed += 1
            total[t] += needed
    return total / draws
