"""The window of exposure times in which a ring gives points: between a sensor's two limits.

A pixel gives a point unless its brightest frame clips or the patterns modulate it too little. With
x_k = ln L_k + ln t the brightness at k points of a ring, phase-averaged,

    p_norm(t) = q · mean_k v_k · [Φ((ln b_high − x_k − o_max)/w_high)
                                  − Φ((ln b_low − x_k − o_mod)/w_low)]

o_max and o_mod say how much brighter the brightest frame, and how much weaker the modulation, is
than the mean; both are quadratics in position. v_k is 1 where a point is lit and seen, q the share
that a ring gives at best. w is the scatter from pixel to pixel; both edges also shift from ring to
ring, by N(0, s²). b, w and s are found by maximum likelihood with the shape that the radiance model
predicts, so that what it misses widens the edges.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from exposight.compiled import njit
from exposight.models.log_radiance import LogRadiance
from exposight.models.ring_light import RingLight, Rings, log_mean

FloatArray: TypeAlias = NDArray[np.float64]

_SPAN_MM = 200.0
"""Scale of positions in the quadratics."""


class Points(NamedTuple):
    """The points of n rings, k each.

    Parameters
    ----------
    high, low : (n, k) ndarray
        ln of a point's brightest frame, and of its modulation, over the ring's radiance times t.
    weight : (n, k) ndarray
        v_k/k: 0 where a point is not lit or not seen.
    width_high, width_low, shift_high, shift_low : (n,) ndarray
        w and s of each ring.
    best, best_std : (n,) ndarray
        q, and its standard deviation.
    """

    high: FloatArray
    low: FloatArray
    weight: FloatArray
    width_high: FloatArray
    width_low: FloatArray
    shift_high: FloatArray
    shift_low: FloatArray
    best: FloatArray
    best_std: FloatArray


@dataclass(frozen=True, kw_only=True, eq=False)
class Window:
    """A sensor's two limits, learnt.

    Parameters
    ----------
    log_low, log_high : float
        ln of b_low, grey levels of modulation, and b_high, grey levels above black.
    width_low, width_high, shift_low, shift_high : float
        w and s, in ln of brightness.
    offset_max, offset_mod : (10,) ndarray
        Coefficients of o_max and o_mod.
    scatter : float
        Standard deviation of p_norm beside all that, where a ring is at its best.
    best : (10,) ndarray
        Coefficients of q.
    best_std : float
        Standard deviation of q from ring to ring.
    """

    log_low: float
    log_high: float
    width_low: float
    width_high: float
    shift_low: float
    shift_high: float
    offset_max: FloatArray
    offset_mod: FloatArray
    scatter: float
    best: FloatArray
    best_std: float

    @property
    def limits(self) -> tuple[float, float]:
        """b_low, grey levels of modulation, and b_high, grey levels above black."""
        return math.exp(self.log_low), math.exp(self.log_high)

    def points(self, model: LogRadiance, rings: Rings, light: RingLight | None) -> Points:
        """Return the points of n rings as the radiance model sees them, lit as `light` says."""
        relative, lit = ring_shape(model, rings, light)
        place = quadratic(rings.positions)
        n, k = relative.shape
        return Points(
            high=relative + (place @ self.offset_max)[:, None],
            low=relative + (place @ self.offset_mod)[:, None],
            weight=lit / k,
            width_high=np.full(n, self.width_high),
            width_low=np.full(n, self.width_low),
            shift_high=np.full(n, self.shift_high),
            shift_low=np.full(n, self.shift_low),
            best=place @ self.best,
            best_std=np.full(n, self.best_std),
        )


def ring_shape(
    model: LogRadiance, rings: Rings, light: RingLight | None
) -> tuple[FloatArray, FloatArray]:
    """Return ln L_k less ln L at the points of rings, and whether each is lit and seen (0 or 1).

    Each (n, k).
    """
    values = np.maximum(model.spread(rings, light), -60.0)
    lit = np.ones(values.shape) if light is None else light.lit.astype(np.float64)
    return values - log_mean(values)[:, None], lit


def quadratic(positions_mm: FloatArray) -> FloatArray:
    """Return 1, x, y, z and their products, scaled, (n, 10)."""
    x, y, z = (positions_mm / _SPAN_MM).T
    return np.stack([np.ones(len(x)), x, y, z, x * x, y * y, z * z, x * y, x * z, y * z], axis=1)


_NORMAL_STEP = 1.0 / 128.0
_NORMAL = ndtr(np.arange(-5.0, 5.0 + 2 * _NORMAL_STEP, _NORMAL_STEP))
"""Φ at steps fine enough to be linear between: within 2e-6."""


@njit(fastmath=True)
def _tabulate(
    grid: FloatArray, at: FloatArray, weight: FloatArray, width: FloatArray
) -> FloatArray:  # pragma: no cover - compiled
    """Return Σ_k weight Φ((at − grid)/width) of each ring, (n, g)."""
    n, k = at.shape
    g = len(grid)
    step = grid[1] - grid[0]
    out = np.zeros((n, g))
    for i in range(n):
        whole = np.zeros(g + 1)
        for j in range(k):
            first = int(np.ceil((at[i, j] - 5.0 * width[i] - grid[0]) / step))
            last = int(np.floor((at[i, j] + 5.0 * width[i] - grid[0]) / step)) + 1
            first, last = max(0, min(first, g)), max(0, min(last, g))
            whole[first] += weight[i, j]
            z = (at[i, j] - grid[0] - first * step) / width[i] + 5.0
            for m in range(first, last):
                place = z / _NORMAL_STEP
                cell = int(place)
                share = _NORMAL[cell] + (place - cell) * (_NORMAL[cell + 1] - _NORMAL[cell])
                out[i, m] += weight[i, j] * share
                z -= step / width[i]
        total = 0.0
        for m in range(g, 0, -1):
            total += whole[m]
            out[i, m - 1] += total
    return out


GRID_STEP = 0.02
"""Step of ln brightness in tables."""


def response_table(
    window: Window, points: Points, low: float, high: float, variance: FloatArray | None = None
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Tabulate the shares of points that are unclipped, and too weak, over ln(L·t).

    Parameters
    ----------
    window : Window
    points : Points
        Of n rings.
    low, high : float
        Range of ln(L·t).
    variance : (n,) ndarray, optional
        Of ln L: the mean over it and over the edges' shifts is tabulated, and not at one value.

    Returns
    -------
    grid : (g,) ndarray
    unclipped, weak : (n, g) ndarray
    """
    steps = max(2, math.ceil((high - low) / GRID_STEP) + 1)
    grid: FloatArray = np.linspace(low, high, steps, dtype=np.float64)
    wide_high, wide_low = points.width_high, points.width_low
    if variance is not None:
        wide_high = np.sqrt(wide_high**2 + points.shift_high**2 + variance)
        wide_low = np.sqrt(wide_low**2 + points.shift_low**2 + variance)
    weight = np.ascontiguousarray(points.weight)
    return (
        grid,
        _tabulate(grid, window.log_high - points.high, weight, wide_high),
        _tabulate(grid, window.log_low - points.low, weight, wide_low),
    )
