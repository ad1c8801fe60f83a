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
from typing import Any, NamedTuple, Protocol, TypeAlias

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from exposight.compiled import njit
from exposight.errors import InputError
from exposight.models.log_radiance import LogRadiance
from exposight.models.ring_light import RingLight, Rings, log_mean

FloatArray: TypeAlias = NDArray[np.float64]

_SPAN_MM = 200.0
"""Scale of positions in the quadratics."""


_CUT = 4.5
"""Standard deviations beyond which a normal edge is over."""

_NODES = ((-2.1, 0.05), (-1.28, 0.15), (-0.5, 0.3), (0.5, 0.3), (1.28, 0.15), (2.1, 0.05))
"""A normal scatter by six values and their weights."""


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


class Tables(NamedTuple):
    """A quality over ln(L·t), more being better.

    Parameters
    ----------
    grid : (g,) ndarray
        Equally spaced ln(L·t).
    sharp : (n, g) ndarray
        The quality of each ring there.
    mean : (n, g) ndarray
        Its mean over an uncertain ln L and uncertain edges.
    """

    grid: FloatArray
    sharp: FloatArray
    mean: FloatArray


class Response(Protocol):
    """How a quality of a ring depends on its brightness: what forecasts are made of."""

    @property
    def sign(self) -> float:
        """1 where more of the quality is better, −1 where less is."""

    @property
    def span(self) -> tuple[float, float]:
        """Range of ln(L·t) in which it changes."""

    @property
    def scatter(self) -> float:
        """Standard deviation of the quality from capture to capture."""

    def points(self, model: LogRadiance, rings: Rings, light: RingLight | None) -> Points:
        """Return the points of n rings as the radiance model sees them, lit as `light` says."""

    def tables(self, points: Points, variance: FloatArray) -> Tables:
        """Tabulate the quality wherever it changes; `variance` is that of ln L, (n,)."""

    def widened(self, values: FloatArray, points: Points, z: float) -> FloatArray:
        """Add z standard deviations of the scatter to values, (n, m)."""

    def needs(self, points: Points, need: float) -> list[tuple[float, FloatArray]]:
        """Return what tables must reach for a quality to be reached, (n,), with their chances."""


def check_numbers(response: Any) -> None:
    """Check that all that was learnt of a response is finite numbers.

    Raises
    ------
    InputError
        If something is not.
    """
    for name, value in vars(response).items():
        number = value if isinstance(value, np.ndarray) else np.asarray(value)
        if name != "better" and (number.dtype.kind not in "fiu" or not np.isfinite(number).all()):
            msg = f"{name} must be finite numbers, got {value!r:.80}"
            raise InputError(msg)


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
    tail : float
        p_norm below which rings stay, but for 2.3 %, where none of their points should be had: of
        misaligned rings some pixels look elsewhere.
    best : (11,) ndarray
        Coefficients of q: in position, and in ln of the radius, which says how much of a ring a
        misaligned view misses.
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
    tail: float
    best: FloatArray
    best_std: float

    def __post_init__(self) -> None:
        check_numbers(self)
        widths = (self.width_low, self.width_high)
        scatters = (self.shift_low, self.shift_high, self.scatter, self.best_std)
        shapes = tuple(each.shape for each in (self.offset_max, self.offset_mod, self.best))
        if min(widths) <= 0.0 or min(scatters) < 0.0 or shapes != ((10,), (10,), (11,)):
            msg = (
                f"a window needs widths above 0 and scatters of 0 or more, got {widths} and "
                f"{scatters}, and coefficients of shape (10,), (10,) and (11,), got {shapes}"
            )
            raise InputError(msg)

    @property
    def limits(self) -> tuple[float, float]:
        """b_low, grey levels of modulation, and b_high, grey levels above black."""
        return math.exp(self.log_low), math.exp(self.log_high)

    @property
    def sign(self) -> float:
        """More of p_norm is better."""
        return 1.0

    @property
    def span(self) -> tuple[float, float]:
        """The two edges, ln."""
        return self.log_low, self.log_high

    def tables(self, points: Points, variance: FloatArray) -> Tables:
        """Tabulate p_norm of n rings (`Response.tables`)."""
        weight, best = np.ascontiguousarray(points.weight), points.best[:, None]
        at = self.log_high - points.high, self.log_low - points.low
        width = points.width_high, points.width_low
        wide = [
            np.sqrt(each**2 + shift**2 + variance)
            for each, shift in zip(width, (points.shift_high, points.shift_low), strict=True)
        ]
        lit = weight > 0.0
        low = (at[1] - _CUT * wide[1][:, None]).min(initial=1.0, where=lit)
        high = (at[0] + _CUT * wide[0][:, None]).max(initial=2.0, where=lit)
        grid = regular_grid(float(low), float(high))
        sharp = [_tabulate(grid, *each) for each in zip(at, (weight,) * 2, width, strict=True)]
        mean = [_tabulate(grid, *each) for each in zip(at, (weight,) * 2, wide, strict=True)]
        return Tables(
            grid=grid,
            sharp=np.maximum(sharp[0] - sharp[1], 0.0) * best,
            mean=np.maximum(mean[0] - mean[1], 0.0) * best,
        )

    def widened(self, values: FloatArray, points: Points, z: float) -> FloatArray:
        """Add z standard deviations of the scatter; above, by p_norm's share of q, and the tail."""
        scatter = z * np.maximum(self.scatter, points.best_std)[:, None]
        if z < 0.0:
            return np.maximum(values + scatter, 0.0)
        share = np.minimum(values / np.maximum(points.best[:, None], 1e-9), 1.0)
        out: FloatArray = values + scatter * share + 0.5 * z * self.tail * (1.0 - share)
        return out

    def needs(self, points: Points, need: float) -> list[tuple[float, FloatArray]]:
        """Return what p_norm must reach, the scatter of q from ring to ring considered."""
        std = np.maximum(points.best_std, self.scatter)
        if (need < points.best - _CUT * std).all():
            return [(1.0, np.full(len(points.best), need))]
        return [
            (weight, need * points.best / np.maximum(points.best + node * std, 1e-9))
            for node, weight in _NODES
        ]

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
            best=place_and_size(rings) @ self.best,
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


def place_and_size(rings: Rings) -> FloatArray:
    """Return `quadratic` of the positions, and ln of the rings' radius, about 0, (n, 11)."""
    size = np.log((rings.poses[:, 5] + 4.0) / 14.0)
    return np.column_stack([quadratic(rings.positions), size])


_NORMAL_STEP = 1.0 / 128.0
_NORMAL = ndtr(np.arange(-_CUT, _CUT + 2 * _NORMAL_STEP, _NORMAL_STEP))
"""Φ at steps fine enough to be linear between: within 2e-6."""


@njit()
def normal_at(score: float) -> float:  # pragma: no cover - compiled
    """Return Φ(score) from a table, within 2e-6."""
    place = (score + _CUT) / _NORMAL_STEP
    place = min(max(place, 0.0), 2.0 * _CUT / _NORMAL_STEP)
    cell = int(place)
    share: float = _NORMAL[cell] + (place - cell) * (_NORMAL[cell + 1] - _NORMAL[cell])
    return share


@njit()  # not fastmath, which takes no NaN for one
def normal_between(
    at: FloatArray, first: FloatArray, dark: FloatArray, last: FloatArray, bright: FloatArray
) -> FloatArray:  # pragma: no cover - compiled
    """Return Φ((at − first)/dark) − Φ((at − last)/bright), at least 0; 0 where an end is NaN.

    `at` is (n, m), the others are (n,).
    """
    out = np.zeros(at.shape)
    for i in range(at.shape[0]):
        if np.isfinite(first[i]) and np.isfinite(last[i]):
            for j in range(at.shape[1]):
                share = normal_at((at[i, j] - first[i]) / dark[i])
                share -= normal_at((at[i, j] - last[i]) / bright[i])
                out[i, j] = max(share, 0.0)
    return out


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
        fall = step / (width[i] * _NORMAL_STEP)
        for j in range(k):
            first = int(np.ceil((at[i, j] - _CUT * width[i] - grid[0]) / step))
            last = int(np.floor((at[i, j] + _CUT * width[i] - grid[0]) / step)) + 1
            first, last = max(0, min(first, g)), max(0, min(last, g))
            whole[first] += weight[i, j]
            place = ((at[i, j] - grid[0] - first * step) / width[i] + _CUT) / _NORMAL_STEP
            for m in range(first, last):
                cell = int(place)
                share = _NORMAL[cell] + (place - cell) * (_NORMAL[cell + 1] - _NORMAL[cell])
                out[i, m] += weight[i, j] * share
                place -= fall
        total = 0.0
        for m in range(g, 0, -1):
            total += whole[m]
            out[i, m - 1] += total
    return out


_GRID_STEP = 0.02
"""Step of ln brightness in tables."""


def regular_grid(low: float, high: float) -> FloatArray:
    """Return equally spaced values of ln(L·t)."""
    steps = max(2, math.ceil((high - low) / _GRID_STEP) + 1)
    grid: FloatArray = np.linspace(low, high, steps, dtype=np.float64)
    return grid
