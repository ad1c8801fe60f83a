"""What few captures are worth: to learn a surface, to refine a forecast, to notice another one.

Each section takes a seed and returns figures by name, as those of `benchmarks.models_learnt`.
A table's captures here are pairs of a view and an exposure time.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import partial
from itertools import islice
from typing import Final

import numpy as np
import polars as pl
from numpy.typing import NDArray

from benchmarks.models_campaigns import COMET
from benchmarks.models_learnt import FINISHES, learnt, observed, unseen_rows
from benchmarks.models_scores import (
    BLACK_LEVEL,
    Figures,
    Measured,
    paper_models,
    quality_figure,
    rms,
)
from exposight.errors import ExposightError
from exposight.models import WindowModel, propose_captures, train_window
from exposight.observing import ObservationTable

Capture = tuple[str, float]

CURVE: Final = (1, 3, 5, 10, 20, 48)
"""Captures of a learning curve, one in each view."""

_DRAWS = 3
_OTHER = {"bare": "primer"}
"""Where the sensor's limits come from: the model of this finish, of bare sheet by default."""


def other_model(finish: str, seed: int) -> WindowModel:
    """Return a model of another finish on the same sensor, whose limits are known so."""
    return learnt(_OTHER.get(finish, "bare"), seed)


def captures_of(table: ObservationTable) -> list[Capture]:
    """Return a table's captures in the plan's order."""
    frame = table.frame.select("view", "exposure_ms").unique(maintain_order=True)
    return list(frame.iter_rows())


def rows_of(table: ObservationTable, captures: Sequence[Capture]) -> ObservationTable:
    """Return the rows of some captures."""
    wanted = set(captures)
    keys = table.frame.select("view", "exposure_ms").iter_rows()
    return table.where(np.array([key in wanted for key in keys], dtype=np.bool_))


def spread_captures(table: ObservationTable, count: int, rng: np.random.Generator) -> list[Capture]:
    """Draw views evenly over the plan, and in each one exposure time of the middle half."""
    views: dict[str, list[float]] = {}
    for view, exposure_ms in captures_of(table):
        views.setdefault(view, []).append(exposure_ms)
    names = list(views)
    places = (np.arange(count) + rng.random()) * len(names) / count
    chosen = []
    for place in places.astype(int):
        times = sorted(views[names[place % len(names)]])
        middle = times[len(times) // 4 : len(times) - len(times) // 4]
        chosen.append((names[place % len(names)], float(rng.choice(middle))))
    return chosen


# -- learning from few ------------------------------------------------------------------------


def few_captures(seed: int) -> Figures:
    """Learn surfaces from one exposure in each of a few views, the sensor's limits known."""
    return {
        name: _median(
            _from_captures(finish, seed, count, draw, other_model(finish, seed))
            for draw in range(_DRAWS)
        )
        for name, finish, count in (
            ("five_captures", "bare", 5),
            ("primer_3", "primer", 3),
            ("paint_3", "paint", 3),
            ("brushed_10", "brushed", 10),
        )
    }


def learning_curves(seed: int) -> Figures:
    """Learn bare sheet from more and more captures: with the limits known, alone, as the paper."""
    figures: Figures = {}
    rows = unseen_rows("bare", seed)
    for count in CURVE:
        known = other_model("bare", seed)
        figures[f"curve, limits known, {count}"] = _from_captures("bare", seed, count, 0, known)
        train = _few("bare", seed, count, 0)
        figures[f"curve, from scratch, {count}"] = _if_enough(partial(_alone, train, rows))
        figures[f"curve, paper, {count}"] = _if_enough(partial(_paper_curve, train, rows))
    return figures


def _if_enough(learn: Callable[[], Measured]) -> Measured:
    try:
        return learn()
    except ExposightError:  # too little to learn from
        return Measured(value=float("nan"))


def _alone(train: ObservationTable, rows: ObservationTable) -> Measured:
    return quality_figure(train_window(train, sensor=COMET), rows)


def _paper_curve(train: ObservationTable, rows: ObservationTable) -> Measured:
    result = paper_models(train, COMET).best(rows)
    return Measured(value=result.rmse_percent, coverage=result.coverage)


def _few(finish: str, seed: int, count: int, draw: int) -> ObservationTable:
    train = observed(finish, seed).train
    rng = np.random.default_rng([seed, draw])
    return rows_of(train, spread_captures(train, count, rng))


def _from_captures(
    finish: str, seed: int, count: int, draw: int, start_from: WindowModel
) -> Measured:
    train, rows = _few(finish, seed, count, draw), unseen_rows(finish, seed)
    return _if_enough(
        lambda: quality_figure(train_window(train, sensor=COMET, start_from=start_from), rows)
    )


def _median(figures: Iterable[Measured]) -> Measured:
    many = list(figures)
    coverage = [each.coverage for each in many if each.coverage is not None]
    return Measured(
        value=float(np.median([each.value for each in many])),
        coverage=float(np.median(coverage)) if coverage else None,
    )


# -- which capture next -----------------------------------------------------------------------

_TARGETS: Final = {"bare": 3.0, "brushed": 6.5}
"""Error in percent to which captures are counted: what five of bare sheet, and ten of brushed,
should reach."""

_JUDGED = "bare"
"""Whose ratio stands in the JSON; few captures suffice there in any order, more of brushed."""

_MOST_CAPTURES = 60


def information(seed: int) -> Figures:
    """Count captures until the error on unseen features has fallen, in orders of three kinds.

    From the first capture on: the plan's, at random (the median of several draws), and each as the
    model proposes it, the first by what another finish on this sensor taught. The sensor's limits
    are known.
    """
    figures: Figures = {}
    for finish, target in _TARGETS.items():
        pool = observed(finish, seed).train
        captures = captures_of(pool)
        shuffled = [
            [captures[i] for i in np.random.default_rng([seed, draw]).permutation(len(captures))]
            for draw in range(_DRAWS)
        ]
        orders: dict[str, list[Iterable[Capture]]] = {
            "the plan's": [captures],
            "random": list(shuffled),
            "proposed": [proposed_order(pool, finish, seed)],
        }
        needed = {
            name: float(np.median([captures_needed(finish, seed, each, target) for each in many]))
            for name, many in orders.items()
        }
        for name, count in needed.items():
            figures[f"captures to {target:g} % of {finish}, {name}"] = Measured(value=count)
        if finish == _JUDGED:
            gain = needed["proposed"] / needed["the plan's"]
            figures["information_gain_captures"] = Measured(value=gain)
    return figures


def proposed_order(pool: ObservationTable, finish: str, seed: int) -> Iterator[Capture]:
    """Yield captures of a pool, each as the model of those before proposes it for the test rings.

    Of the view that is proposed, the capture with the nearest exposure time that is still there.
    """
    known, captures = other_model(finish, seed), list[Capture]()
    candidates = pool.frame.unique(["view", "feature"], maintain_order=True)
    targets = unseen_rows(finish, seed).frame.unique(["view", "feature"], maintain_order=True)
    times_ms = sorted(set(pool.frame["exposure_ms"]))
    left = captures_of(pool)
    while left:
        model = (learnt_from(pool, captures, known) if captures else None) or known
        ranking = propose_captures(model, candidates, times_ms, targets=targets)
        for view, wanted_ms in ranking.select("view", "exposure_ms").iter_rows():
            there = [each for each in left if each[0] == view]
            if there:
                chosen = min(there, key=lambda each: abs(math.log(each[1] / wanted_ms)))
                break
        left.remove(chosen)
        captures.append(chosen)
        yield chosen


def captures_needed(finish: str, seed: int, order: Iterable[Capture], target: float) -> int:
    """Return how many captures of an order it takes, at most `_MOST_CAPTURES`."""
    pool, rows = observed(finish, seed).train, unseen_rows(finish, seed)
    captures: list[Capture] = []
    for capture in islice(order, _MOST_CAPTURES):
        captures.append(capture)
        model = learnt_from(pool, captures, other_model(finish, seed))
        if model is not None and quality_figure(model, rows).value <= target:
            break
    return len(captures)


def learnt_from(
    pool: ObservationTable, captures: Sequence[Capture], start_from: WindowModel
) -> WindowModel | None:
    """Return the model of some captures; None where they are too little to learn from."""
    try:
        return train_window(rows_of(pool, captures), sensor=COMET, start_from=start_from)
    except ExposightError:
        return None


# -- trials -----------------------------------------------------------------------------------


Serves = Callable[[pl.DataFrame], pl.Series]


def _good(rows: pl.DataFrame) -> pl.Series:
    return (rows["i_mean"] - BLACK_LEVEL).is_between(12.0, 120.0)


def _dark(rows: pl.DataFrame) -> pl.Series:
    return (rows["i_mean"] - BLACK_LEVEL).is_between(2.0, 10.0)


def _clipped(rows: pl.DataFrame) -> pl.Series:
    return rows["stack_clipped_share"] > 0.5


TRIALS: Final = {"good": _good, "dark": _dark, "clipped": _clipped}
"""Which rings a trial capture serves as what it is called, by its rows."""


def trials(seed: int) -> Figures:
    """Refine forecasts by one trial capture in each new view.

    The trial is the capture that shows most of the view's rings as they should be for its kind;
    these rings count, at all other exposure times. Tables do not name the finish.
    """
    figures: Figures = {}
    worst = -np.inf
    for finish in ("bare", *FINISHES):
        test = without_finish(observed(finish, seed).test)
        stranger = trial_error(other_model(finish, seed), test, _good)
        figures[f"trial, new finish: {finish}"] = Measured(value=stranger[1])
        figures[f"no trial, new finish: {finish}"] = Measured(value=stranger[0])
        for kind, serves in TRIALS.items():
            without, refined = trial_error(learnt(finish, seed), test, serves)
            figures[f"trial {kind} less none, learnt: {finish}"] = Measured(value=refined - without)
            worst = max(worst, refined - without)
    figures["trial_capture_new_finish"] = Measured(
        value=max(figures[f"trial, new finish: {each}"].value for each in ("bare", *FINISHES))
    )
    figures["trial_never_worse"] = Measured(value=float(worst))
    return figures


def without_finish(table: ObservationTable) -> ObservationTable:
    """Return a table that does not say what finish its rows are of."""
    frame = table.frame.with_columns(finish=pl.lit(None, dtype=pl.String))
    return ObservationTable(frame=frame)


def trial_error(model: WindowModel, test: ObservationTable, serves: Serves) -> tuple[float, float]:
    """Return the error of quality in percent, without and with a trial capture in each view."""
    errors: list[list[NDArray[np.float64]]] = [[], []]
    for rows, trial in trial_captures(test, serves):
        times_ms = sorted(set(rows["exposure_ms"]) - set(trial["exposure_ms"]))
        measured = rows.pivot("exposure_ms", index="feature", values="p_norm")
        rings = trial.select(pl.exclude("exposure_ms"))
        names = pl.Series("feature", rings["feature"])
        observed_p = measured.join(names.to_frame(), on="feature", maintain_order="right")
        wanted = serves(trial).to_numpy()
        truth = np.clip(observed_p.select(map(str, times_ms)).to_numpy(), 0.0, 1.0)
        table = ObservationTable(frame=trial, checked=True)
        for place, given in enumerate((None, table)):
            forecast = model.forecast(rings, times_ms, trial=given)
            errors[place].append((forecast.p_norm - truth)[wanted].ravel())
    without, refined = (100.0 * rms(np.concatenate(each)) for each in errors)
    return without, refined


def trial_captures(
    test: ObservationTable, serves: Serves
) -> Iterator[tuple[pl.DataFrame, pl.DataFrame]]:
    """Yield each view's rows, and those of the capture in which most rings serve.

    Of equally good captures the middle one; views in which no ring serves are left out.
    """
    for _, rows in test.frame.group_by("view", maintain_order=True):
        times = (
            rows.with_columns(serves=serves(rows))
            .group_by("exposure_ms")
            .agg(pl.col("serves").sum())
            .filter((pl.col("serves") == pl.col("serves").max()) & (pl.col("serves") > 0))
            .sort("exposure_ms")
        )
        if times.height:
            trial_ms = times["exposure_ms"][times.height // 2]
            yield rows, rows.filter(pl.col("exposure_ms") == trial_ms)


# -- another surface --------------------------------------------------------------------------


def other_surfaces(seed: int) -> Figures:
    """Count first captures of which a model says that the surface is not the one it learnt."""
    noticed, figures = [], Figures()
    for model in ("bare", "primer"):
        for finish in ("bare", *FINISHES):
            share = noticed_share(learnt(model, seed), observed(finish, seed).test)
            figures[f"called another surface by {model}: {finish}"] = Measured(value=share)
            if finish != model:
                noticed.append(share)
    figures["false_surface_noticed"] = Measured(value=float(np.mean(noticed)))
    return figures


def noticed_share(model: WindowModel, test: ObservationTable) -> float:
    """Return in how many views one good capture is called one of another surface."""
    called = []
    for rows, trial in trial_captures(without_finish(test), _good):
        table = ObservationTable(frame=trial, checked=True)
        forecast = model.forecast(trial, sorted(set(rows["exposure_ms"])), trial=table)
        called.append(any("surface" in remark for remark in forecast.remarks))
    return float(np.mean(called))
