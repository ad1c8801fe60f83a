"""What to expect of rings over exposure time: quality, its band, its chance, its window; jointly.

A forecast holds what is known of each ring's radiance and of its edges. Pose alone says some of
it, one image at any exposure more, one capture with its frame stack nearly all; each refines the
same forecast.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TypeAlias

import numpy as np
import polars as pl
from numpy.typing import ArrayLike, NDArray
from scipy.special import ndtr, ndtri

from exposight.compiled import njit
from exposight.errors import InputError
from exposight.models.window import Points, Response, Tables, Window, normal_between

FloatArray: TypeAlias = NDArray[np.float64]

_TWO_SIGMA = 2.0


@dataclass(frozen=True, kw_only=True, eq=False)
class RingForecast:
    """What to expect of n rings at m exposure times.

    Parameters
    ----------
    features, views : tuple of str
        The n rings.
    exposures_ms : (m,) ndarray, ms
        Exposure times.
    mean : (n,) ndarray
        Of ln radiance, grey levels per ms.
    covariance : (n, n) ndarray
        Of ln radiance: rings of one view, and of one feature, err together.
    points : Points
        How radiance spreads over each ring.
    window : Response
        How the quality depends on brightness: between the sensor's limits for p_norm.
    black_level : float, grey levels
        Brightness without light.
    need : float
        Quality that is asked for.
    distance : (n,) ndarray
        From what was learnt, in learnt length scales.
    source : tuple of str
        What each ring's forecast rests on: "pose", "pose and image", "pose and capture" or
        "capture".
    unknown : tuple of str
        Why a ring's forecast should not be relied on; empty where it may be.
    remarks : tuple of str
        What is odd about all of it.
    half : (n, 2) ndarray or None
        Slopes of the half vectors of light and sight at the rings, where the projector is known.
    other_finish : tuple of str
        The finish that each ring is on, where that is not the learnt one; empty elsewhere.
    """

    features: tuple[str, ...]
    views: tuple[str, ...]
    exposures_ms: FloatArray
    mean: FloatArray
    covariance: FloatArray
    points: Points
    window: Response
    black_level: float
    need: float
    distance: FloatArray
    source: tuple[str, ...]
    unknown: tuple[str, ...]
    remarks: tuple[str, ...] = ()
    half: FloatArray | None = None
    other_finish: tuple[str, ...] = ()

    @property
    def knows(self) -> NDArray[np.bool_]:
        """Which rings' forecasts may be relied on, (n,)."""
        return np.array([not reason for reason in self.unknown], dtype=np.bool_)

    @cached_property
    def std(self) -> FloatArray:
        """Standard deviation of ln radiance, (n,)."""
        return np.sqrt(np.diagonal(self.covariance))

    @cached_property
    def _tables(self) -> Tables:
        return self.window.tables(self.points, np.diagonal(self.covariance))

    @cached_property
    def _top(self) -> NDArray[np.int64]:
        """Where each ring is at its best, on the grid of ln(L·t)."""
        top: NDArray[np.int64] = self._tables.sharp.argmax(axis=1)
        return top

    def _at(self, table: FloatArray, brightness: FloatArray) -> FloatArray:
        """Interpolate a table at ln(L·t), (n, m) each."""
        grid = self._tables.grid
        return _interpolated(table, grid[0], grid[1] - grid[0], np.ascontiguousarray(brightness))

    @cached_property
    def _brightness(self) -> FloatArray:
        out: FloatArray = self.mean[:, None] + np.log(self.exposures_ms)
        return out

    @cached_property
    def quality(self) -> FloatArray:
        """Mean of the quality to expect, (n, m)."""
        return self.window.sign * self._at(self._tables.mean, self._brightness)

    @property
    def p_norm(self) -> FloatArray:
        """`quality`, where that is p_norm."""
        return self.quality

    def quantile(self, level: float) -> FloatArray:
        """Return the quality below which it stays with a chance, (n, m).

        Quality gets better with brightness up to its best, and worse again. A bad quantile is the
        worse of too dark and too bright; a good one the best in between.
        """
        sign = self.window.sign
        z = sign * float(ndtri(level))
        dark = (abs(z) * np.hypot(self.std, self.points.shift_low))[:, None]
        bright = (abs(z) * np.hypot(self.std, self.points.shift_high))[:, None]
        sharp = self._tables.sharp
        if z < 0.0:
            values = np.minimum(
                self._at(sharp, self._brightness - dark), self._at(sharp, self._brightness + bright)
            )
        else:
            best_at = self._tables.grid[self._top][:, None]
            nearest = np.clip(best_at, self._brightness - bright, self._brightness + dark)
            values = self._at(sharp, nearest)
        return sign * self.window.widened(values, self.points, z)

    @cached_property
    def low(self) -> FloatArray:
        """Lower end of the 2σ band, (n, m): the quality is below with a chance of 2.3 %."""
        return self.quantile(float(ndtr(-_TWO_SIGMA)))

    @cached_property
    def high(self) -> FloatArray:
        """Upper end of the 2σ band, (n, m)."""
        return self.quantile(float(ndtr(_TWO_SIGMA)))

    @cached_property
    def chance(self) -> FloatArray:
        """Chance that the quality reaches `need`, (n, m)."""
        return self.chance_of(self.need)

    def chance_of(self, need: float) -> FloatArray:
        """Return the chance that the quality reaches another value, (n, m)."""
        total = np.zeros_like(self._brightness)
        dark = np.maximum(np.hypot(self.std, self.points.shift_low), 1e-6)
        bright = np.maximum(np.hypot(self.std, self.points.shift_high), 1e-6)
        for weight, first, last in self.window_ends(need):
            total += weight * normal_between(self._brightness, first, dark, last, bright)
        return total

    def window_ends(self, need: float | None = None) -> list[tuple[float, FloatArray, FloatArray]]:
        """Return the ln(L·t) between which the quality reaches a value, in weighed cases.

        Cases are of how good a ring gets at its best. The ends, (n,) each, are NaN where a ring
        never reaches it.
        """
        levels = self.window.needs(self.points, self.need if need is None else need)
        return [(weight, *self._ends(level)) for weight, level in levels]

    def _ends(self, need: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the ln(L·t) between which the quality reaches a value, (n,) each; NaN if none."""
        grid, sharp, _ = self._tables
        return _crossings(sharp, self._top, grid[0], grid[1] - grid[0], need)

    def window_ms(self, confidence: float = 0.5) -> tuple[FloatArray, FloatArray]:
        """Return the two ends of each ring's window of exposure times, ms, (n,) each.

        Between them the quality reaches `need`, each end by itself with the confidence asked; NaN
        where no exposure time does.
        """
        first, last = self._ends(np.full(len(self.mean), self.window.sign * self.need))
        z = float(ndtri(confidence))
        low = np.exp(first - self.mean + z * np.hypot(self.std, self.points.shift_low))
        high = np.exp(last - self.mean - z * np.hypot(self.std, self.points.shift_high))
        nothing = low > high
        return np.where(nothing, np.nan, low), np.where(nothing, np.nan, high)

    def why_never(self) -> tuple[str, ...]:
        """Say of each ring that reaches `need` at no exposure time why, and what it reaches."""
        low, _ = self.window_ms()
        peak = self.window.sign * self._tables.sharp.max(axis=1)
        at_ms = np.exp(self._tables.grid[self._top] - self.mean)
        lit, best = self.points.weight.sum(axis=1), self.points.best
        if self.window.sign < 0.0 or not isinstance(self.window, Window):  # a curve, no limits
            return tuple(
                ""
                if np.isfinite(low[i])
                else f"reaches {peak[i]:.3g} at best, at {at_ms[i]:.3g} ms"
                for i in range(len(self.mean))
            )
        return tuple(
            ""
            if np.isfinite(low[i])
            else f"reaches {peak[i]:.2f} at best, at {at_ms[i]:.3g} ms: "
            + (
                f"only {100 * lit[i]:.0f} % of it is lit and in the frame"
                if lit[i] < self.need
                else "rings that were learnt from gave no more at their best (misaligned views?)"
                if best[i] < self.need
                else "parts of it clip before others are bright enough (glare)"
            )
            for i in range(len(self.mean))
        )

    def draw_windows(self, draws: int, rng: np.random.Generator) -> FloatArray:
        """Draw both ends of all windows together.

        Parameters
        ----------
        draws : int
            How many.
        rng : numpy.random.Generator

        Returns
        -------
        (draws, n, 2) ndarray, ms
            Exposure times between which each ring reaches `need`; NaN where none does. Rings of a
            view share what is uncertain of its light.
        """
        n = len(self.mean)
        radiance = rng.multivariate_normal(
            self.mean, self.covariance, draws, method="eigh", check_valid="ignore"
        )
        first, last = self._ends(np.full(n, self.window.sign * self.need))
        dark = rng.standard_normal((draws, n)) * self.points.shift_low
        bright = rng.standard_normal((draws, n)) * self.points.shift_high
        ends = np.stack([first - radiance + dark, last - radiance - bright], axis=-1)
        empty = ends[..., 0] > ends[..., 1]
        ends[empty] = np.nan
        out: FloatArray = np.exp(ends)
        return out

    def exposure_ms(
        self, i_mean: float, levels: Sequence[float] = (0.023, 0.5, 0.977)
    ) -> FloatArray:
        """Return quantiles of the exposure time with a wanted brightness, (n, len(levels)), ms.

        Parameters
        ----------
        i_mean : float, grey levels
            Phase-averaged brightness of the ring, above the black level.
        levels : sequence of float
            Chances.

        Raises
        ------
        InputError
            If the brightness is not above the black level.
        """
        if not i_mean > self.black_level:
            msg = (
                f"a brightness of {i_mean:g} is reached by no exposure time: without light it is "
                f"{self.black_level:.1f} grey levels already"
            )
            raise InputError(msg)
        logs = math.log(i_mean - self.black_level) - self.mean[:, None]
        out: FloatArray = np.exp(logs + self.std[:, None] * ndtri(np.asarray(levels)))
        return out

    def i_mean(self, levels: ArrayLike = 0.5) -> FloatArray:
        """Return a quantile of the brightness at each exposure time, (n, m), grey levels.

        What the ring would have if nothing clipped.
        """
        z = ndtri(np.asarray(levels))
        out: FloatArray = self.black_level + np.exp(self._brightness + z * self.std[:, None])
        return out

    @property
    def frame(self) -> pl.DataFrame:
        """One row for each ring and exposure time.

        Columns ``feature``, ``view``, ``exposure_ms``, ``i_mean``, ``p_norm``, ``p_norm_low``,
        ``p_norm_high`` (2σ band), ``chance``, ``known``.
        """
        n, m = self.p_norm.shape
        return pl.DataFrame(
            {
                "feature": [name for name in self.features for _ in range(m)],
                "view": [name for name in self.views for _ in range(m)],
                "exposure_ms": np.tile(self.exposures_ms, n),
                "i_mean": np.minimum(self.i_mean(), 255.0).ravel(),
                "p_norm": self.p_norm.ravel(),
                "p_norm_low": self.low.ravel(),
                "p_norm_high": self.high.ravel(),
                "chance": self.chance.ravel(),
                "known": np.repeat(self.knows, m),
            }
        )

    def take(self, rings: Sequence[int]) -> RingForecast:
        """Return the forecast of some of the rings."""
        places = list(rings)

        def some(values: tuple[str, ...]) -> tuple[str, ...]:
            return tuple(values[i] for i in places)

        return replace(
            self,
            features=some(self.features),
            views=some(self.views),
            source=some(self.source),
            unknown=some(self.unknown),
            other_finish=some(self.other_finish) if self.other_finish else (),
            mean=self.mean[places],
            covariance=self.covariance[np.ix_(places, places)],
            points=Points(*(values[places] for values in self.points)),
            distance=self.distance[places],
            half=None if self.half is None else self.half[places],
        )

    def at(self, exposures_ms: ArrayLike, need: float | None = None) -> RingForecast:
        """Return the same forecast at other exposure times, or for another quality."""
        times = np.atleast_1d(np.asarray(exposures_ms, dtype=np.float64))
        return replace(self, exposures_ms=times, need=self.need if need is None else need)


@njit()
def _interpolated(
    table: FloatArray, start: float, step: float, at: FloatArray
) -> FloatArray:  # pragma: no cover - compiled
    """Return each row of a table over a regular grid at the same row of `at`, (n, m)."""
    out = np.empty(at.shape)
    last = table.shape[1] - 1.000001
    for i in range(at.shape[0]):
        for j in range(at.shape[1]):
            place = min(max((at[i, j] - start) / step, 0.0), last)
            cell = int(place)
            out[i, j] = table[i, cell] + (place - cell) * (table[i, cell + 1] - table[i, cell])
    return out


@njit()
def _crossings(
    table: FloatArray, top: NDArray[np.int64], start: float, step: float, need: FloatArray
) -> tuple[FloatArray, FloatArray]:  # pragma: no cover - compiled
    """Return where each row rises to and falls from a value about its highest place."""
    n, g = table.shape
    first, last = np.full(n, np.nan), np.full(n, np.nan)
    for i in range(n):
        row, j = table[i], top[i]
        if row[j] < need[i]:
            continue
        while j > 0 and row[j - 1] >= need[i]:
            j -= 1
        first[i] = start + step * j
        if j > 0:
            first[i] -= step * (row[j] - need[i]) / (row[j] - row[j - 1])
        j = top[i]
        while j < g - 1 and row[j + 1] >= need[i]:
            j += 1
        last[i] = start + step * j
        if j < g - 1:
            last[i] += step * (row[j] - need[i]) / (row[j] - row[j + 1])
    return first, last


def best_exposure(chance: FloatArray, knows: NDArray[np.bool_]) -> int:
    """Return the place of the exposure time with most rings expected to reach what is asked.

    Of equally good ones the middle one.

    Parameters
    ----------
    chance : (n, m) ndarray
        Of n rings at m exposure times.
    knows : (n,) ndarray of bool
        Rings that count; all where none does.
    """
    total = (chance[knows] if knows.any() else chance).sum(axis=0)
    best = np.flatnonzero(total >= total.max() - 1e-6)
    return int(best[len(best) // 2])
