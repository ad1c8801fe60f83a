"""What a trial capture of a view adds to a forecast from poses, and whether it contradicts it.

An image at any exposure tells a ring's radiance; a capture's frame stack tells how it spreads over
the ring, too, whatever the finish. Poses and trial are weighed by what each leaves uncertain. What
clips is never scaled to other exposure times.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any, NamedTuple, TypeAlias

import numpy as np
import polars as pl
from numpy.typing import NDArray
from scipy.special import ndtri
from scipy.stats import chi2

from exposight.cell import GREY_MAX
from exposight.errors import InputError, ObservationError
from exposight.models.correction import corrected, with_limit
from exposight.models.log_radiance import SURPRISE
from exposight.models.ring_data import FEW_CLIPPED, clipped_share, ring_data
from exposight.models.ring_forecast import RingForecast
from exposight.observing import ObservationTable

FloatArray: TypeAlias = NDArray[np.float64]

_PERCENTS = (5, 25, 50, 75, 95)
_NORMAL = ndtri(np.array(_PERCENTS) / 100.0)

_ONE_STRIPE_IMAGE = 0.15
"""Standard deviation of ln radiance read from one stripe image: where the stripes happen to lie
(measured on the simulated cell, 0.152)."""

_HALF_CLIPPED = 0.04
"""The same, read from the median of the brightest frames where less than half of a ring clips."""

_JITTER = 0.015
"""From one capture to the next: noise, rounding, quantiles of few pixels; ln of brightness."""

_WIDTH = 0.02
"""Scatter of pixels that five quantiles do not show."""

_ROUNDED = {"max": 8.0, "mod": 3.0}
"""Grey levels above black, and of modulation, from which quantiles are more than rounding."""

_BETTER = {"max": 40.0, "mod": 12.0}
"""The same, from which they say more than a learnt surface does."""

_FEWEST = 3
"""Quantiles that must be neither dark nor clipped."""

_FAR_OFF, _BEYOND = 0.3, 0.5
"""ln radiance by which a limit contradicts a forecast; and how far beyond the limit a ring is then
taken to be, give or take as much (assumed)."""

_SAME_PLACE_MM = 2.0


def with_trial(
    forecast: RingForecast,
    places: FloatArray,
    trial: ObservationTable,
    *,
    other_surface: str = "",
    correct: bool = False,
) -> RingForecast:
    """Refine a forecast by captures of its views.

    Parameters
    ----------
    forecast : RingForecast
        From poses.
    places : (n, 3) ndarray, mm
        Where its rings are in the TCP frame.
    trial : ObservationTable
        Measured rows of these rings, at any exposure times; others are ignored.
    other_surface : str
        Why the surface is known to be another than the learnt one; empty where it is not.
    correct : bool
        Let captures correct the rings that they do not show, too, where the cell's light or its
        part's surface is not the learnt one (`corrected`). Otherwise a contradiction is said, and
        only what captures show is forecast.

    Raises
    ------
    ObservationError
        If no row is of these rings, or one was taken from another place.
    """
    shown = _readings(forecast, places, trial)
    known = shown.limit == 0
    measured = shown.rings[known], shown.value[known], shown.variance[known]
    if correct:
        # a limit far from what was forecast says that the cell is otherwise
        sign, limit = shown.limit[~known], shown.value[~known]
        off = sign * (limit - forecast.mean[shown.rings[~known]]) > _FAR_OFF
        further = (
            shown.rings[~known][off],
            (limit + sign * _BEYOND)[off],
            np.full(off.sum(), _BEYOND**2),
        )
        refined = corrected(forecast, *map(np.concatenate, zip(measured, further, strict=True)))
        refined = with_limit(refined, shown.rings[~known], shown.value[~known], shown.limit[~known])
    else:
        refined = _weighed(forecast, *measured, other_surface)
    rows = {int(ring): row for ring, row in zip(shown.rings, shown.rows, strict=True)}
    return _with_quantiles(refined, rows)


class _Readings(NamedTuple):
    """What captures tell of rings' ln radiance; `limit` as in `RingData`."""

    rings: NDArray[np.int64]
    value: FloatArray
    variance: FloatArray
    limit: NDArray[np.int64]
    rows: list[Mapping[str, Any]]


def _readings(forecast: RingForecast, places: FloatArray, trial: ObservationTable) -> _Readings:
    ring_of = {key: i for i, key in enumerate(zip(forecast.features, forecast.views, strict=True))}
    measured = trial.measured()
    keys = list(measured.frame.select("feature", "view").iter_rows())
    measured = measured.where(np.array([key in ring_of for key in keys], dtype=np.bool_))
    if len(measured) == 0:
        msg = (
            f"the trial has no measured row of {', '.join(dict.fromkeys(forecast.features))} in "
            f"{', '.join(dict.fromkeys(forecast.views))}; its features and views must have the "
            "names of the forecast's"
        )
        raise ObservationError(msg)
    data = ring_data(measured, black_level=forecast.black_level)
    rings = np.array([ring_of[key] for key in data.rings.keys])
    apart = np.linalg.norm(data.rings.positions - places[rings], axis=1)
    if apart.max() > _SAME_PLACE_MM:
        worst = int(apart.argmax())
        msg = (
            f"the trial shows {forecast.features[rings[worst]]} {apart[worst]:.1f} mm away from "
            "where the forecast has it: it was taken from another pose; forecast that one"
        )
        raise InputError(msg)
    value, variance = data.log_radiance.copy(), data.variance + _JITTER**2
    limit = data.limit.copy()
    best = [_best_row(measured, *key) for key in data.rings.keys]
    for i, row in enumerate(best):
        if limit[i] == 0 and data.source == "i_avg" and row.get("brightness_source") == "stripe":
            variance[i] += _ONE_STRIPE_IMAGE**2
        elif limit[i] > 0:
            median = row.get("i_max_p50")
            if median is not None and median < 0.98 * GREY_MAX:
                log_max = math.log(median - forecast.black_level) - math.log(row["exposure_ms"])
                value[i] = log_max - float(np.median(forecast.points.high[rings[i]]))
                variance[i], limit[i] = _HALF_CLIPPED**2, 0
    return _Readings(rings, value, variance, limit, best)


def _best_row(table: ObservationTable, feature: str, view: str) -> Mapping[str, Any]:
    """Return the ring's brightest capture without clipping, or else its darkest."""
    frame = table.frame
    frame = frame.filter((frame["feature"] == feature) & (frame["view"] == view))
    frame = frame.with_columns(pl.Series("_clipped", clipped_share(frame))).sort("exposure_ms")
    clear = frame.filter(frame["_clipped"] <= FEW_CLIPPED)
    return clear.row(-1, named=True) if clear.height else frame.row(0, named=True)


def _weighed(
    forecast: RingForecast,
    rings: NDArray[np.int64],
    value: FloatArray,
    variance: FloatArray,
    other_surface: str,
) -> RingForecast:
    """Weigh poses and measured radiance, jointly for all rings; notice contradictions."""
    if len(rings) == 0:
        return forecast
    within = forecast.covariance[np.ix_(rings, rings)] + np.diag(variance)
    error = value - forecast.mean[rings]
    squared = float(error @ np.linalg.solve(within, error))
    surprise = not other_surface and float(chi2.sf(squared, len(rings))) < SURPRISE
    if surprise or other_surface:
        factor = math.exp(float(np.median(error)))
        reason = other_surface or (
            "this is not the surface that was learnt: the trial is "
            f"{factor:.3g} times as bright as expected"
        )
        mean, covariance = forecast.mean.copy(), forecast.covariance.copy()
        covariance[rings, :] = covariance[:, rings] = 0.0
        mean[rings], covariance[rings, rings] = value, variance
        measured = set(rings.tolist())
        return replace(
            forecast,
            mean=mean,
            covariance=covariance,
            source=tuple(
                "capture" if i in measured else source for i, source in enumerate(forecast.source)
            ),
            unknown=tuple("" if i in measured else reason for i in range(len(forecast.features))),
            remarks=(*forecast.remarks, reason),
        )
    gain = np.linalg.solve(within, forecast.covariance[rings]).T
    covariance = forecast.covariance - gain @ forecast.covariance[rings]
    source = list(forecast.source)
    for ring in rings:
        source[ring] = "pose and image"
    unknown = list(forecast.unknown)
    for ring in rings:
        unknown[ring] = ""
    return replace(
        forecast,
        mean=forecast.mean + gain @ error,
        covariance=0.5 * (covariance + covariance.T),
        source=tuple(source),
        unknown=tuple(unknown),
    )


def _with_quantiles(forecast: RingForecast, rows: Mapping[int, Mapping[str, Any]]) -> RingForecast:
    """Take how radiance spreads over rings from a capture's stack where it shows it."""
    points = forecast.points
    k = max(points.high.shape[1], 24)
    repeat = k // points.high.shape[1]
    arrays = {
        name: np.repeat(getattr(points, name), repeat, axis=1) for name in ("high", "low", "weight")
    }
    arrays["weight"] = arrays["weight"] / repeat
    for name in ("width_high", "width_low", "shift_high", "shift_low"):
        arrays[name] = getattr(points, name).copy()
    source = list(forecast.source)
    for ring, row in rows.items():
        alone = source[ring] == "capture"
        if row.get("i_max_p50") is None or (row["_clipped"] > FEW_CLIPPED and not alone):
            continue
        exposure = math.log(row["exposure_ms"])
        for stem, side, black in (("max", "high", forecast.black_level), ("mod", "low", 0.0)):
            grey = np.array([row[f"i_{stem}_p{percent:02d}"] for percent in _PERCENTS])
            shown = grey - black > (_ROUNDED if alone else _BETTER)[stem]
            if stem == "max":
                shown &= grey < 0.995 * GREY_MAX
            if np.count_nonzero(shown) < (_FEWEST if alone else len(_PERCENTS)):
                continue
            values = np.log(grey[shown] - black)
            spread = _quantile_function(_NORMAL[shown], values, k) - exposure
            arrays[side][ring] = spread - forecast.mean[ring]
            arrays["weight"][ring] = arrays["weight"][ring].sum() / k
            arrays[f"width_{side}"][ring], arrays[f"shift_{side}"][ring] = _WIDTH, _JITTER
            if side == "high":
                source[ring] = "capture" if source[ring] == "capture" else "pose and capture"
    return replace(forecast, points=points._replace(**arrays), source=tuple(source))


def _quantile_function(scores: FloatArray, values: FloatArray, k: int) -> FloatArray:
    """Return k equally likely values of a distribution known by its values at normal scores.

    Linear in the normal score, so that a normal distribution is given back; the ends go on as
    their last pieces do.
    """
    score = ndtri((np.arange(k) + 0.5) / k)
    inner: FloatArray = np.interp(score, scores, values)
    first = (values[1] - values[0]) / (scores[1] - scores[0])
    last = (values[-1] - values[-2]) / (scores[-1] - scores[-2])
    below, above = score < scores[0], score > scores[-1]
    inner[below] = values[0] + first * (score[below] - scores[0])
    inner[above] = values[-1] + last * (score[above] - scores[-1])
    return inner
