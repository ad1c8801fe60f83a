"""What merging exposures gains: promised by a forecast, and measured against single captures.

A pixel gives a point at an exposure time t if ln L_k + ln t lies between its two edges: an interval
of ln L. Merged exposures t₁ < t₂ < … have it wherever one of their intervals does, and of intervals
of equal width in ascending order the union is Σ_i [P(t_i) − P(t_{i−1} ∧ t_i)]: the exposures of a
pixel do not fail independently.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import TypeAlias

import numpy as np
import polars as pl
from numpy.typing import NDArray
from scipy.special import ndtr

from exposight.errors import InputError, ObservationError
from exposight.models import P_NORM_MIN, RingForecast
from exposight.models.window import Window
from exposight.observing import ObservationTable
from exposight.tables import Column, Table, counted, number

FloatArray: TypeAlias = NDArray[np.float64]

TARGETS = (P_NORM_MIN, 0.9, 0.95, 0.98)
"""Qualities at which the gain is told: what the paper asks for, and what demanding users do."""

_NODES = np.polynomial.hermite_e.hermegauss(11), np.polynomial.hermite_e.hermegauss(3)
"""Of ln radiance, and of either edge."""


def merged_p_norm(rings: RingForecast, exposures_ms: Sequence[float]) -> FloatArray:
    """Return the p_norm to expect of merged captures, (n,).

    Parameters
    ----------
    rings : RingForecast
        Of n rings; of a default model, which knows the pixels' edges.
    exposures_ms : sequence of float, ms
        Exposure times that are merged.

    Raises
    ------
    InputError
        If there is no exposure time above 0, or the forecast is of another quality.
    """
    points, variance = rings.points, np.diagonal(rings.covariance)
    wide = (
        np.sqrt(points.width_low**2 + points.shift_low**2 + variance),
        np.sqrt(points.width_high**2 + points.shift_high**2 + variance),
    )
    nothing = np.zeros((1, len(rings.mean)))
    expected: FloatArray = _union(rings, _logs(exposures_ms), wide, nothing, nothing)[0]
    return expected


def merged_chance(
    rings: RingForecast, exposures_ms: Sequence[float], need: float | None = None
) -> FloatArray:
    """Return the chance that the p_norm of merged captures reaches a value, (n,).

    Parameters
    ----------
    rings, exposures_ms
        As for `merged_p_norm`.
    need : float, optional
        That of the forecast by default.
    """
    (x, wx), (e, we) = _NODES
    radiance, dark, bright = (each.ravel() for each in np.meshgrid(x, e, e, indexing="ij"))
    weights = (wx[:, None, None] * we[:, None] * we).ravel()
    points = rings.points
    drawn = radiance[:, None] * rings.std
    sharp = _union(
        rings,
        _logs(exposures_ms),
        (points.width_low, points.width_high),
        drawn + dark[:, None] * points.shift_low,
        drawn + bright[:, None] * points.shift_high,
    )
    chance = np.zeros(len(rings.mean))
    for share, level in rings.window.needs(points, rings.need if need is None else need):
        chance += share * (weights @ (sharp >= level)) / weights.sum()
    return chance


def _union(
    rings: RingForecast,
    logs: FloatArray,
    widths: tuple[FloatArray, FloatArray],
    low: FloatArray,
    high: FloatArray,
) -> FloatArray:
    """Return the share of each ring's points in the union of exposures, (cases, n).

    `low` and `high` (cases, n) are what ln radiance is more than its mean, at either edge.
    """
    window, points = rings.window, rings.points
    if not isinstance(window, Window):
        msg = (
            "what merging promises follows from p_norm's window; got a forecast of another quality"
        )
        raise InputError(msg)
    begin = window.log_low - points.low - rings.mean[:, None]
    end = window.log_high - points.high - rings.mean[:, None]

    def having(shortest: float, longest: float) -> FloatArray:
        """Return the chance of each point to be had at both exposures, (cases, n, k)."""
        ended = ndtr((end - high[..., None] - longest) / widths[1][:, None])
        out: FloatArray = np.maximum(
            ended - ndtr((begin - low[..., None] - shortest) / widths[0][:, None]), 0.0
        )
        return out

    total = having(logs[0], logs[0])
    for before, log in pairwise(logs):
        total += having(log, log) - having(before, log)
    share: FloatArray = (total * points.weight).sum(axis=-1) * points.best
    return share


def _logs(exposures_ms: Sequence[float]) -> FloatArray:
    times = np.unique(np.asarray(exposures_ms, dtype=np.float64))
    if not times.size or not (np.isfinite(times) & (times > 0.0)).all():
        msg = f"exposure times to merge must be above 0 ms, got {list(exposures_ms)}"
        raise InputError(msg)
    logs: FloatArray = np.log(times)
    return logs


@dataclass(frozen=True, kw_only=True, eq=False)
class MergeGain:
    """Merged captures against the single ones that they were made of.

    Parameters
    ----------
    frame : polars.DataFrame
        A row for each feature and view: ``feature``, ``view``, ``best_ms``, the exposure time of
        the best single capture, ``single`` and ``merged``, the p_norm of both, ``gain``, and
        ``promised``, the p_norm that a forecast gave for the merged capture, or null.
    """

    frame: pl.DataFrame

    @classmethod
    def of(
        cls,
        single: ObservationTable,
        merged: ObservationTable,
        promised: pl.DataFrame | None = None,
    ) -> MergeGain:
        """Compare observations.

        Parameters
        ----------
        single, merged : ObservationTable
            Of single captures, and of those that were merged of them.
        promised : polars.DataFrame, optional
            ``feature``, ``view``, ``promised``.

        Raises
        ------
        ObservationError
            If no feature was measured in both.
        """
        keys = ["feature", "view"]
        best = (
            single.measured()
            .frame.sort("p_norm", "exposure_ms", descending=[True, False], maintain_order=True)
            .unique(keys, keep="first", maintain_order=True)
            .select(*keys, best_ms="exposure_ms", single="p_norm")
        )
        both = (
            merged.measured()
            .frame.select(*keys, merged="p_norm")
            .join(best, on=keys, maintain_order="left")
        )
        if both.height == 0:
            msg = "no feature was measured in merged and in single captures: nothing to compare"
            raise ObservationError(msg)
        if promised is None:
            both = both.with_columns(promised=pl.lit(None, pl.Float64))
        else:
            both = both.join(
                promised.select(*keys, "promised"), on=keys, how="left", maintain_order="left"
            )
        gain = (pl.col("merged") - pl.col("single")).alias("gain")
        order = [*keys, "best_ms", "single", "merged", "gain", "promised"]
        return cls(frame=both.with_columns(gain).select(order))

    def reached(self, target: float) -> dict[str, float]:
        """Return how many features reach a quality singly, merged, and by the promise."""
        counts = self.frame.select((pl.col("single", "merged", "promised") >= target).sum())
        found: dict[str, float] = counts.row(0, named=True)
        return found

    @property
    def table(self) -> Table:
        """How many features reach several targets."""
        known = self.frame["promised"].null_count() < self.frame.height
        names = ("single", "merged", *(("promised",) if known else ()))
        rows = [
            {"target": target, **{name: self.reached(target)[name] for name in names}}
            for target in TARGETS
        ]
        labels = {
            "single": "by the best\nsingle capture",
            "merged": "merged",
            "promised": "promised",
        }
        columns = (
            Column(name="target", label="p_norm ≥", decimals=2),
            *(Column(name=name, label=labels[name]) for name in names),
        )
        return Table.of("gain", rows, columns, title="Features that reach a quality")

    @property
    def verdict(self) -> str:
        """What merging gained, in a line; that it gained nothing, where it did not."""
        n = counted(self.frame.height, "feature")
        for target in TARGETS:
            found = self.reached(target)
            if found["merged"] > found["single"]:
                more = int(found["merged"] - found["single"])
                return (
                    f"merging brings {more} more of {n} to p_norm {number(target)} than the best "
                    "single capture of each"
                )
        mean = float(self.frame["gain"].mean() or 0.0)  # type: ignore[arg-type]
        return (
            f"merging gains nothing: of {n} no more reach {', '.join(map(number, TARGETS))} than "
            f"by the best single capture of each (p_norm {mean:+.3f} in the mean)"
        )
