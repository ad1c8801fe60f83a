"""How a sensor's two limits are learnt from the p_norm of rings whose radiance is known."""

from __future__ import annotations

import math
from typing import TypeAlias

import numpy as np
import polars as pl
from numpy.typing import NDArray
from scipy.optimize import minimize
from scipy.special import ndtr

from exposight.cell import GREY_MAX
from exposight.compiled import njit
from exposight.errors import ObservationError
from exposight.models.log_radiance import LogRadiance
from exposight.models.ring_data import FEW_CLIPPED, RingData, clipped_share
from exposight.models.ring_light import Rings
from exposight.models.window import Window, place_and_size, quadratic, ring_shape

FloatArray: TypeAlias = NDArray[np.float64]

_MODULATED = 10.0
"""Grey levels of modulation above which noise hardly adds to it."""

_EDGE = (0.1, 0.03)
"""Prior medians of an edge's width w and of its shift s, in ln of brightness."""

_EDGE_STD = 1.0
"""Standard deviation of their logarithms' priors."""

_LOW_PRIOR = (math.log(10.0), 1.0)
"""Mean and standard deviation of ln b_low: decoders want some grey levels of modulation."""

_HIGH_STD, _HIGH_STD_UNSURE = 0.04, 0.6
"""Standard deviation of ln b_high round full scale above black; without the brightest frames' own
brightness it is the mean's, and may be half of that."""

_KEPT_STD = 0.02
"""Standard deviation of ln of limits that are taken from another finish's model."""

_NOTHING = 0.01
"""p_norm that is nothing: expected beyond the window."""

_MANY = 20
"""So many rings tell the best p_norm by themselves."""

_SPREAD = 3.29
"""Normal standard deviations between the 5th and the 95th percentile."""

_OUTLIER = 4.0
"""Residuals beyond so many standard deviations count linearly, as Huber's."""

_ROOT_2PI = math.sqrt(2.0 * math.pi)


def fit_window(
    model: LogRadiance, data: RingData, frame: pl.DataFrame, *, start_from: Window | None = None
) -> Window:
    """Learn a sensor's limits from the p_norm of rings whose radiance was measured.

    Parameters
    ----------
    model : LogRadiance
        Says how radiance spreads over a ring.
    data : RingData
        The rings.
    frame : polars.DataFrame
        Their captures: measured rows of a table.
    start_from : Window, optional
        Of the same sensor on another finish: its limits are kept, but for a few percent, and so
        is all that few captures cannot tell.

    Raises
    ------
    ObservationError
        If no capture reaches an edge of the window.
    """
    if start_from is None:
        offset_max, offset_mod = _offsets(frame, data.black_level)
    else:
        offset_max, offset_mod = start_from.offset_max, start_from.offset_mod
    ring = _ring_of_rows(data.rings, frame)
    measured = data.limit[ring] == 0
    frame, ring = frame.filter(pl.Series(measured)), ring[measured]
    p = frame["p_norm"].to_numpy()
    light = model.formula.light(data.rings, model.sensor)
    relative, lit = ring_shape(model, data.rings, light)
    place, where = quadratic(data.rings.positions), place_and_size(data.rings)
    base = data.log_radiance[ring] + np.log(frame["exposure_ms"].to_numpy())
    high = base[:, None] + (relative + (place @ offset_max)[:, None])[ring]
    low = base[:, None] + (relative + (place @ offset_mod)[:, None])[ring]
    weight = lit[ring] / relative.shape[1]
    reached = np.zeros(len(data))
    np.maximum.at(reached, ring, p)
    best = np.where(reached > 0.5, reached, 1.0)
    widths = _widths(frame, data.black_level, relative[ring])
    if start_from is None:
        full = math.log(GREY_MAX - data.black_level)
        sure = bool(offset_max.any())
        bright = (full, _HIGH_STD) if sure else (full - 0.4, _HIGH_STD_UNSURE)
        usual = (math.log(_EDGE[0]), _EDGE_STD)
        shifts = [(math.log(_EDGE[1]), _EDGE_STD)] * 2
        prior = np.array([_LOW_PRIOR, bright, *(each or usual for each in widths), *shifts])
        theta = _start(p / best[ring], np.median(high, axis=1), np.median(low, axis=1), prior)
    else:
        known = start_from
        limits = [(known.log_low, _KEPT_STD), (known.log_high, _KEPT_STD)]
        kept = [(math.log(each), 0.3) for each in (known.width_low, known.width_high)]
        shifts = [(math.log(each), 0.5) for each in (known.shift_low, known.shift_high)]
        prior = np.array(
            [*limits, *(each or old for each, old in zip(widths, kept, strict=True)), *shifts]
        )
        theta = np.append(prior[:, 0], math.log(known.scatter))
        best = where @ known.best
    for _ in range(2):
        theta, unsure = _climb(theta, np.minimum(p / best[ring], 1.0), high, low, weight, prior)
        quality = _best(theta, p, ring, high, low, weight, where)
        if start_from is not None and quality[3] < _MANY:
            quality = start_from.best, start_from.best_std, start_from.scatter, quality[3]
        coefficients, best_std, scatter, _ = quality
        best = where @ coefficients
    nothing = p[_response(theta, high, low, weight) < _NOTHING]
    tail = float(np.quantile(nothing, 0.977)) if len(nothing) else 0.0
    return Window(
        log_low=float(theta[0]),
        log_high=float(theta[1]),
        width_low=float(np.exp(theta[2])),
        width_high=float(np.exp(theta[3])),
        # where few captures reach an edge, its place is uncertain, too
        shift_low=math.hypot(np.exp(theta[4]), unsure[0]),
        shift_high=math.hypot(np.exp(theta[5]), unsure[1]),
        offset_max=offset_max,
        offset_mod=offset_mod,
        scatter=max(scatter, float(np.exp(theta[6]))),
        tail=max(tail, start_from.tail if start_from else 0.0),
        best=coefficients,
        best_std=best_std,
    )


def _ring_of_rows(rings: Rings, rows: pl.DataFrame) -> NDArray[np.int64]:
    """Return the place of each row's ring among the rings, by feature and view."""
    place = {key: i for i, key in enumerate(rings.keys)}
    keys = zip(rows["feature"].to_list(), rows["view"].to_list(), strict=True)
    return np.array([place[key] for key in keys], dtype=np.int64)


def _best(
    theta: FloatArray,
    p: FloatArray,
    ring: NDArray[np.int64],
    high: FloatArray,
    low: FloatArray,
    weight: FloatArray,
    place: FloatArray,
) -> tuple[FloatArray, float, float, int]:
    """Return the coefficients of q, its scatter over rings and over captures, and their number.

    From rings with captures well within their windows.
    """
    lit = weight.sum(axis=1)
    within = (_response(theta, high, low, weight) > 0.995 * lit) & (lit > 0.5)
    count = np.bincount(ring[within], minlength=len(place))
    rings = count > 0
    coefficients: FloatArray = np.zeros(place.shape[1])
    coefficients[0] = 1.0
    if not rings.any():
        return coefficients, 0.01, 0.01, 0
    total = np.bincount(ring[within], p[within] / lit[within], minlength=len(place))
    value = total[rings] / count[rings]
    coefficients = _ridge(place[rings], value)
    std = float(np.std(value - place[rings] @ coefficients))
    error = p[within] / lit[within] - (place @ coefficients)[ring[within]]
    least = 0.01 / math.sqrt(len(value))
    return coefficients, max(std, least), max(float(error.std()), least), len(value)


def _ridge(place: FloatArray, value: FloatArray) -> FloatArray:
    """Fit a quadratic in position; few values leave it constant."""
    penalty = np.eye(place.shape[1])
    penalty[0, 0] = 1e-9
    middle = float(np.median(value))
    out = np.linalg.solve(place.T @ place + penalty, place.T @ (value - middle))
    out[0] += middle
    return np.asarray(out, dtype=np.float64)


def _offsets(frame: pl.DataFrame, black_level: float) -> tuple[FloatArray, FloatArray]:
    """Return the coefficients of o_max and o_mod from the medians over rings; zeros without."""
    frame = frame.filter(
        pl.Series(clipped_share(frame) <= FEW_CLIPPED),
        pl.col("i_mean_p50") > black_level + _MODULATED,
    )
    found: list[FloatArray] = []
    for name, black, least in (("i_max_p50", black_level, 0.0), ("i_mod_p50", 0.0, _MODULATED)):
        rows = frame.filter(pl.col(name) > black + least)
        if rows.height == 0:
            found.append(np.zeros(10))
            continue
        place = quadratic(rows.select("x_mm", "y_mm", "z_mm").to_numpy())
        mean = np.log(rows["i_mean_p50"].to_numpy() - black_level)
        found.append(_ridge(place, np.log(rows[name].to_numpy() - black) - mean))
    return found[0], found[1]


def _widths(
    frame: pl.DataFrame, black_level: float, relative: FloatArray
) -> list[tuple[float, float] | None]:
    """Return priors of the logarithms of w_low and w_high; None where the table tells nothing.

    Of the spread that quantiles show beyond that of the predicted shape.
    """
    priors: list[tuple[float, float] | None] = []
    clear = clipped_share(frame) <= FEW_CLIPPED
    for stem, black in (("mod", 0.0), ("max", black_level)):
        names = [f"i_{stem}_p05", f"i_{stem}_p95"]
        prior = None
        if set(names) <= set(frame.columns):
            low, high = (frame[name].fill_null(0.0).to_numpy() - black for name in names)
            told = clear & (low > _MODULATED)
            if np.count_nonzero(told) > 4:
                spread = np.log(high[told] / low[told]) / _SPREAD
                beyond = float(np.median(spread**2 - relative[told].var(axis=1)))
                prior = (0.5 * math.log(max(beyond, 0.02**2)), 0.3)
        priors.append(prior)
    return priors


def _start(p: FloatArray, high: FloatArray, low: FloatArray, prior: FloatArray) -> FloatArray:
    """Return a first guess: where p_norm is half at either edge."""
    half = (p > 0.15) & (p < 0.85)
    good = p > 0.9
    if not half.any() and not good.any():
        msg = (
            "no capture gives points, or all do in full: nothing tells between which brightnesses "
            "this sensor measures; add shorter and longer exposure times"
        )
        raise ObservationError(msg)
    middle = float(np.median(high[good])) if good.any() else float(np.median(high[half]))
    dark, bright = half & (high < middle), half & (high >= middle)
    lowest = low[dark] if dark.any() else min(prior[0, 0], low[p > 0.5].min(initial=9.0))
    highest = high[bright] if bright.any() else max(prior[1, 0], high[p > 0.5].max(initial=0.0))
    return np.array([np.median(lowest), np.median(highest), *prior[2:, 0], math.log(0.01)])


def _response(
    theta: FloatArray, high: FloatArray, low: FloatArray, weight: FloatArray
) -> FloatArray:
    inside = ndtr((theta[1] - high) / np.exp(theta[3])) - ndtr((theta[0] - low) / np.exp(theta[2]))
    out: FloatArray = np.einsum("ij,ij->i", weight, inside)
    return out


def _climb(
    start: FloatArray,
    p: FloatArray,
    high: FloatArray,
    low: FloatArray,
    weight: FloatArray,
    prior: FloatArray,
) -> tuple[FloatArray, list[float]]:
    """Return the limits, logarithms of widths, shifts and scatter of highest posterior.

    And the standard deviations of the limits, from the curvature there.
    """
    centre, std = prior.T

    def loss(theta: FloatArray) -> tuple[float, FloatArray]:
        value, gradient = _edge_loss(theta, p, high, low, weight)
        z = (theta[:6] - centre) / std
        gradient[:6] += z / std
        return value + 0.5 * float(z @ z), gradient

    limits = [(None, None)] * 2 + [(-5.0, 0.5)] * 2 + [(-6.0, 0.5)] * 2 + [(-6.0, -1.5)]
    end = minimize(loss, start, jac=True, method="L-BFGS-B", bounds=limits)
    found: FloatArray = end.x
    unsure = []
    for place in range(2):
        step = np.zeros(len(found))
        step[place] = 0.01
        slopes = [loss(found + sign * step)[1][place] for sign in (1.0, -1.0)]
        curvature = (slopes[0] - slopes[1]) / 0.02
        unsure.append(min(1.0 / math.sqrt(max(curvature, 1e-6)), float(std[place])))
    return found, unsure


@njit(fastmath=True)
def _edge_loss(
    theta: FloatArray, p: FloatArray, high: FloatArray, low: FloatArray, weight: FloatArray
) -> tuple[float, FloatArray]:  # pragma: no cover - compiled
    """Minus log likelihood of p_norm, robust, and its gradient.

    The shifts of the edges enter by linearising: their variance is (dp/dshift)² s².
    """
    width_low, width_high = np.exp(theta[2]), np.exp(theta[3])
    shift_low, shift_high, scatter = np.exp(theta[4]), np.exp(theta[5]), np.exp(theta[6])
    value, gradient = 0.0, np.zeros(7)
    for i in range(len(p)):
        inside = slope_high = slope_low = bend_high = bend_low = wide_high = wide_low = 0.0
        for k in range(high.shape[1]):
            z = (theta[1] - high[i, k]) / width_high
            if z > 6.0:
                inside += weight[i, k]
            elif z > -6.0:
                density = weight[i, k] * math.exp(-0.5 * z * z) / _ROOT_2PI
                inside += weight[i, k] * 0.5 * math.erfc(-z * 0.7071067811865476)
                slope_high += density / width_high
                bend_high -= z * density
                wide_high += density * (z * z - 1.0) / width_high
            z = (theta[0] - low[i, k]) / width_low
            if z > 6.0:
                inside -= weight[i, k]
            elif z > -6.0:
                density = weight[i, k] * math.exp(-0.5 * z * z) / _ROOT_2PI
                inside -= weight[i, k] * 0.5 * math.erfc(-z * 0.7071067811865476)
                slope_low += density / width_low
                bend_low -= z * density
                wide_low += density * (z * z - 1.0) / width_low
        variance = (slope_high * shift_high) ** 2 + (slope_low * shift_low) ** 2 + scatter**2
        error = p[i] - inside
        squared = error * error / variance
        if squared < _OUTLIER**2:
            value += 0.5 * squared
            by_squared = 0.5
        else:
            value += _OUTLIER * math.sqrt(squared) - 0.5 * _OUTLIER**2
            by_squared = 0.5 * _OUTLIER / math.sqrt(squared)
        value += 0.5 * math.log(variance)
        by_inside = by_squared * -2.0 * error / variance
        by_variance = -by_squared * squared / variance + 0.5 / variance
        by_high = by_variance * 2.0 * slope_high * shift_high**2
        by_low = by_variance * 2.0 * slope_low * shift_low**2
        gradient[0] += -by_inside * slope_low + by_low * bend_low / width_low**2
        gradient[1] += by_inside * slope_high + by_high * bend_high / width_high**2
        gradient[2] += -by_inside * bend_low + by_low * wide_low
        gradient[3] += by_inside * bend_high + by_high * wide_high
        gradient[4] += by_variance * 2.0 * (slope_low * shift_low) ** 2
        gradient[5] += by_variance * 2.0 * (slope_high * shift_high) ** 2
        gradient[6] += by_variance * 2.0 * scatter**2
    return value, gradient
