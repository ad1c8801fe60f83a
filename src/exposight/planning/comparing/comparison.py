"""Strategies compared on views whose every outcome is known: what each gets, and what it takes.

Trial images count as exposures, and all strategies choose from the same exposure times. Confidence
intervals are those of other views: by bootstrap over the views.
"""

from __future__ import annotations

import platform
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, TypeAlias

import numpy as np
import polars as pl
import scipy
from numpy.typing import NDArray

from exposight import __version__
from exposight.errors import InputError
from exposight.models import WindowModel
from exposight.planning.comparing.strategies import (
    MeasuringCosts,
    Setup,
    Strategy,
    strategies_named,
)
from exposight.planning.comparing.strategies.rehearsal import measured
from exposight.planning.comparing.sweeps import Sweep
from exposight.planning.comparing.view_outcomes import ViewOutcome, frame_of
from exposight.planning.exposure_limits import ExposureLimits
from exposight.planning.sensor_models import SensorModels
from exposight.tables import Column, Table, number
from exposight.workers import Progress, ignore_progress

FloatArray: TypeAlias = NDArray[np.float64]

ORACLE = "oracle"
"""The strategy by whose captures those of others are counted."""

_DRAWS = 2000
_BAND = (0.025, 0.975)


@dataclass(frozen=True, kw_only=True, eq=False)
class Comparison:
    """What strategies had and took in each view of a sweep.

    Parameters
    ----------
    outcomes : tuple of ViewOutcome
        One for each strategy and view, views in the same order.
    sweep, sweep_sha256 : str
        Name and checksum of the views and what came of each exposure.
    about : dict of str to object
        Versions, seed, views and what was asked for.
    """

    outcomes: tuple[ViewOutcome, ...]
    sweep: str
    sweep_sha256: str
    about: dict[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        keys = Counter((each.strategy, each.view) for each in self.outcomes)
        if keys and keys.most_common(1)[0][1] > 1:
            strategy, view = keys.most_common(1)[0][0]
            msg = f"strategy {strategy!r} has two outcomes in view {view!r}"
            raise InputError(msg)
        views = list(dict.fromkeys(each.view for each in self.outcomes))
        for name in {ORACLE, *self.strategies} if self.outcomes else ():
            if [each.view for each in self.outcomes if each.strategy == name] != views:
                msg = (
                    f"a comparison needs an outcome of strategy {name!r} in each of its "
                    f"{len(views)} views, in their order"
                )
                raise InputError(msg)

    @property
    def scores(self) -> pl.DataFrame:
        """A row for each strategy, in their order.

        ``covered_share`` of the pairs of feature and view that some exposure time serves,
        ``exposures`` and ``trial_images`` a view, ``exposures_over_oracle`` with trial images among
        them, ``time_s`` a view, ``all_had_share`` of views, ``promised`` and ``achieved`` chance,
        ``promise_brier`` and ``chance_brier``; ``…_low`` and ``…_high`` are ends of 95 % intervals.
        """
        rows = [self._score(name) for name in self.strategies]
        return pl.DataFrame(rows, infer_schema_length=None)

    @property
    def strategies(self) -> tuple[str, ...]:
        """The strategies, in their order."""
        return tuple(dict.fromkeys(each.strategy for each in self.outcomes))

    @property
    def frame(self) -> pl.DataFrame:
        """The outcomes, a row for each strategy and view."""
        return frame_of(self.outcomes)

    def _score(self, name: str) -> dict[str, Any]:
        rows = [each for each in self.outcomes if each.strategy == name]
        oracle = [len(each.captures_ms) for each in self.outcomes if each.strategy == ORACLE]
        totals = np.array(
            [
                (each.coverable, each.had, len(each.captures_ms), len(each.trial_images_ms),
                 each.time_s, best, each.had == each.coverable, 1.0)
                for each, best in zip(rows, oracle, strict=True)
            ]
        )  # fmt: skip
        draws = np.random.default_rng(1).integers(0, len(totals), (_DRAWS, len(totals)))
        value, drawn = _figures(totals.sum(axis=0)), _figures(totals[draws].sum(axis=1))
        low_high = {
            f"{figure}_{end}": float(np.quantile(drawn[figure], level))
            for figure in ("covered_share", "exposures_over_oracle")
            for end, level in zip(("low", "high"), _BAND, strict=True)
        }
        sums = {
            each: float(sum(getattr(row, each) for row in rows))
            for each in (
                "promises", "promised", "kept", "promise_loss", "chances", "chance_loss",
            )
        }  # fmt: skip
        return {
            "strategy": name,
            "kind": rows[0].kind,
            "title": rows[0].title,
            "covered_share": float(value["covered_share"]),
            "exposures": float(value["exposures"]),
            "trial_images": float(value["trial_images"]),
            "exposures_over_oracle": float(value["exposures_over_oracle"]),
            "time_s": float(value["time_s"]),
            "all_had_share": float(value["all_had_share"]),
            **low_high,
            "promised": _ratio(sums["promised"], sums["promises"]),
            "achieved": _ratio(sums["kept"], sums["promises"]),
            "promise_brier": _ratio(sums["promise_loss"], sums["promises"]),
            "chance_brier": _ratio(sums["chance_loss"], sums["chances"]),
        }

    @property
    def table(self) -> Table:
        """The scores, as people read them."""
        return Table(
            name="scores",
            frame=self.scores,
            columns=(
                Column(name="strategy"),
                Column(name="covered_share", label="covered\n%", scale=100.0, decimals=1),
                Column(name="exposures", label="captures\na view", decimals=2),
                Column(name="trial_images", label="trial\nimages", decimals=2),
                Column(name="exposures_over_oracle", label="both over\nthe oracle's", decimals=2),
                Column(name="time_s", label="time\ns", decimals=2),
                Column(name="all_had_share", label="views with\nall, %", scale=100.0, decimals=0),
                Column(name="promised", label="promised\n%", scale=100.0, decimals=1),
                Column(name="achieved", label="achieved\n%", scale=100.0, decimals=1),
                Column(name="promise_brier", label="Brier of\npromises", decimals=3),
                Column(name="chance_brier", label="Brier of\nchances", decimals=3),
            ),
        )

    def best(self, least: float = 0.99, kinds: Sequence[str] = ("rival", "model")) -> str | None:
        """Return the strategy with the fewest exposures, trial images among them.

        Parameters
        ----------
        least : float
            Share of the features that it has to cover; where none does, that which covers most.
        kinds : sequence of str
            Kinds of strategies that are looked at.

        Returns
        -------
        str or None
            None where no strategy is of these kinds.
        """
        frame = self.scores.filter(pl.col("kind").is_in(list(kinds)))
        if frame.is_empty():
            return None
        good = frame.filter(pl.col("covered_share") >= least)
        if good.is_empty():
            good = frame.filter(pl.col("covered_share") == frame["covered_share"].max())
        looks = pl.col("exposures") + pl.col("trial_images")
        return str(good.sort(looks, "time_s", maintain_order=True)["strategy"][0])

    @property
    def verdict(self) -> str:
        """Which strategy is best, and by how much."""
        scores = {row["strategy"]: row for row in self.scores.iter_rows(named=True)}
        name, others = self.best(), self.best(kinds=("rival",))
        if name is None:
            return "nothing but the oracle was compared"
        best = scores[name]
        text = f"{name}: {_in_words(best)}"
        if others is None or others == name:
            return text
        other = scores[others]
        saved = 1.0 - (best["exposures"] + best["trial_images"]) / (
            other["exposures"] + other["trial_images"]
        )
        return f"{text}; {100 * saved:.0f} % fewer than {others}: {_in_words(other)}"

    def with_others(self, other: Comparison) -> Comparison:
        """Return both results together; of a strategy that both have, this one's.

        Raises
        ------
        InputError
            If they are of other views, outcomes or needs.
        """
        if other.sweep_sha256 != self.sweep_sha256:
            msg = (
                f"results of {other.sweep} ({other.sweep_sha256[:12]}) are not of the views and "
                f"outcomes of {self.sweep} ({self.sweep_sha256[:12]}); compare on the same sweep, "
                "quality needed and limits"
            )
            raise InputError(msg)
        new = tuple(each for each in other.outcomes if each.strategy not in self.strategies)
        return replace(self, outcomes=self.outcomes + new)

    def __str__(self) -> str:
        return f"{self.verdict}\n{self.table}"

    def _repr_html_(self) -> str:
        return f"<p>{self.verdict}</p>{self.table._repr_html_()}"


def _in_words(score: dict[str, Any]) -> str:
    looks = score["exposures"] + score["trial_images"]
    return (
        f"{100 * score['covered_share']:.1f} % of the features with {number(looks, 3)} exposures "
        "a view"
    )


def _figures(totals: FloatArray) -> dict[str, FloatArray]:
    """Return the scores that follow from sums over views, (…, 8)."""
    coverable, had, captures, trials, time_s, oracle, all_had, views = np.moveaxis(totals, -1, 0)
    with np.errstate(divide="ignore", invalid="ignore"):
        return {
            "covered_share": np.where(coverable > 0, had / coverable, np.nan),
            "exposures": captures / views,
            "trial_images": trials / views,
            "exposures_over_oracle": np.where(oracle > 0, (captures + trials) / oracle, np.nan),
            "time_s": time_s / views,
            "all_had_share": all_had / views,
        }


def _ratio(part: float, whole: float) -> float | None:
    return part / whole if whole else None


def compare(
    sweep: Sweep,
    strategies: Iterable[str],
    *,
    models: Sequence[SensorModels] = (),
    rehearsal: Sweep | None = None,
    limits: ExposureLimits | None = None,
    costs: MeasuringCosts | None = None,
    confidence: float = 0.9,
    progress: Progress = ignore_progress,
) -> Comparison:
    """Measure a sweep's views by each strategy and score what it got and took.

    Parameters
    ----------
    sweep : Sweep
        Views whose every outcome is known.
    strategies : iterable of str
        Their names (`STRATEGIES`); the oracle, by which others are counted, is added. Those that
        forecast run once for each of `models`.
    models : sequence of SensorModels
        None of them may have learnt from the views.
    rehearsal : Sweep, optional
        Views on which strategies choose their constants, such as those that models were trained on;
        by default the sweep itself, in hindsight, which is generous to them.
    limits : ExposureLimits, optional
        How many captures a view may have; the sweep keeps the exposure times within them.
    costs : MeasuringCosts, optional
        What captures and trial images cost.
    confidence : float
        Chance with which forecasting strategies plan to have each feature.
    progress : Progress
        Receives the strategies that are done.

    Raises
    ------
    InputError
        If there is no strategy of a name, none to compare, a confidence is not between 0 and 1, or
        a strategy takes what it may not.
    """
    chosen = strategies_named([ORACLE, *strategies])
    if not 0.0 < confidence < 1.0:
        msg = f"a confidence lies between 0 and 1, got {confidence:g}"
        raise InputError(msg)
    runs: list[tuple[str, Strategy, SensorModels | None]] = []
    for each in chosen:
        if each.kind == "model":
            labels = (each.name + suffix for suffix in _suffixes(models))
            runs += [(label, each, pair) for label, pair in zip(labels, models, strict=True)]
        else:
            runs.append((each.name, each, None))
    outcomes: list[ViewOutcome] = []
    costs = costs or MeasuringCosts()
    for done, (label, each, pair) in enumerate(runs):
        progress("comparing", done, len(runs))
        setup = Setup(
            sweep=sweep,
            rehearsal=rehearsal or sweep,
            costs=costs,
            limits=limits,
            confidence=confidence,
            models=pair,
        )
        facts = {"strategy": label, "kind": each.kind, "title": each.title}
        for trial in measured(each.start(setup), sweep, setup):
            outcomes.append(ViewOutcome.of(trial, costs, **facts))
    progress("comparing", len(runs), len(runs))
    return Comparison(
        outcomes=tuple(outcomes),
        sweep=sweep.name,
        sweep_sha256=sweep.sha256,
        about={
            "versions": {
                "exposight": __version__,
                "numpy": np.__version__,
                "scipy": scipy.__version__,
                "python": platform.python_version(),
            },
            "need": sweep.need,
            "confidence": confidence,
            "views": [view.name for view in sweep.views],
            "pairs": sweep.pairs,
            "constants": "in hindsight" if rehearsal is None else f"chosen on {rehearsal.name}",
            "limits": None if limits is None else limits.name,
            "capture": f"{costs.capture.frames} × t + {costs.capture.overhead_ms:g} ms",
            "trial_image": f"{costs.trial_image.frames} × t + {costs.trial_image.overhead_ms:g} ms",
        },
    )


def _suffixes(models: Sequence[SensorModels]) -> list[str]:
    """Return what tells a strategy with one pair of models from the same one with another."""
    names = [
        (f"{pair.quality.name} + {pair.exposure.name}",)
        if not isinstance(pair.quality, WindowModel)
        else ()
        for pair in models
    ]
    parts = [
        (*name, str(names[: i + 1].count(name))) if names.count(name) > 1 else name
        for i, name in enumerate(names)
    ]
    return [f" ({', '.join(each)})" if each else "" for each in parts]
