"""Any quality of a ring over its brightness: a curve learnt from captures, for forecasts.

Noise, form or diameter of a ring depend on how bright it is, as p_norm does, in ways that nobody
needs to write down: one curve over ln brightness, and the scatter round it. A diameter that is
rarely measured may still be good where it is, so the curve ends where fewer than half of the
captures measure it, and beyond its ends no need is met.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, TypeAlias, get_args

import numpy as np
import polars as pl
from numpy.typing import NDArray

from exposight import gp
from exposight.errors import InputError, ObservationError
from exposight.models.log_radiance import LogRadiance
from exposight.models.ring_light import RingLight, Rings
from exposight.models.window import Points, Tables, check_numbers, regular_grid

FloatArray: TypeAlias = NDArray[np.float64]

Better: TypeAlias = Literal["higher", "lower"]

_KNOTS = 120
_MOST_ROWS = 600
"""Rows that the curve is learnt from, evenly chosen over brightness; more say nothing new."""
_FEWEST_ROWS = 12
LEAST_MEASURED = 0.5
"""Share of captures that must measure a quality at a brightness for it to be promised there."""
_BESIDE = 20
"""Captures of about the same brightness between which the share is taken."""
_NEVER = -1e9
"""Worse than any need: the quality where it is not measured."""
_NODES = ((-1.732, 1 / 6), (0.0, 2 / 3), (1.732, 1 / 6))
"""Gauss–Hermite: normal scatter by three values and their weights."""


@dataclass(frozen=True, kw_only=True, eq=False)
class ResponseCurve:
    """A quality over ln(L·t), the same for all rings.

    Parameters
    ----------
    grid : (g,) ndarray
        ln of grey levels above black; beyond, no need is met and the mean stays as it is.
    values : (g,) ndarray
        The quality, negative where lower is better, so that more is better.
    scatter : float
        Standard deviation round the curve, from capture to capture.
    better : {'higher', 'lower'}
        Which quality is better.
    """

    grid: FloatArray
    values: FloatArray
    scatter: float
    better: Better

    def __post_init__(self) -> None:
        check_numbers(self)
        shapes = self.grid.shape, self.values.shape
        if shapes[0] != shapes[1] or len(shapes[0]) != 1 or shapes[0] < (2,):
            msg = f"a curve needs as many values as places on a grid, two or more, got {shapes}"
            raise InputError(msg)
        if (np.diff(self.grid) <= 0.0).any() or self.scatter < 0.0:
            msg = f"a curve needs an ascending grid and a scatter of 0 or more, got {self.scatter}"
            raise InputError(msg)
        if self.better not in get_args(Better):
            msg = f"better must be {' or '.join(get_args(Better))}, got {self.better!r}"
            raise InputError(msg)

    @property
    def sign(self) -> float:
        """−1 where lower is better."""
        return -1.0 if self.better == "lower" else 1.0

    @property
    def span(self) -> tuple[float, float]:
        """Smallest and largest ln(L·t) that it was learnt at."""
        return float(self.grid[0]), float(self.grid[-1])

    @classmethod
    def fit(cls, log_brightness: FloatArray, quality: FloatArray, better: Better) -> ResponseCurve:
        """Learn a curve from captures.

        Parameters
        ----------
        log_brightness : (n,) ndarray
            ln of grey levels above black that a ring would have, did nothing clip.
        quality : (n,) ndarray
            In its unit.
        better : {'higher', 'lower'}
            Which is better.

        Raises
        ------
        ObservationError
            If there are too few captures, or all are equally bright.
        """
        if len(quality) < _FEWEST_ROWS or np.ptp(log_brightness) < 0.1:
            msg = (
                f"a curve of quality over brightness needs at least {_FEWEST_ROWS} captures of "
                f"different brightness, got {len(quality)} over a factor of "
                f"{np.exp(np.ptp(log_brightness)) if len(quality) else 1:.2f}"
            )
            raise ObservationError(msg)
        order = np.argsort(log_brightness)
        order = order[np.linspace(0, len(order) - 1, min(_MOST_ROWS, len(order))).astype(int)]
        x, y = log_brightness[order, None], quality[order]
        middle = float(np.median(y))
        kernel = gp.Matern52(variance=1.0, length_scales=(0.5,), dims=(0,))
        fitted = gp.fit(kernel, x, y - middle, rng=np.random.default_rng(1), restarts=1).process
        grid = np.linspace(x[0, 0], x[-1, 0], _KNOTS)
        values = middle + fitted.predict(grid[:, None]).mean
        sign = -1.0 if better == "lower" else 1.0
        scatter = float(np.sqrt(fitted.noise_variance))
        return cls(grid=grid, values=sign * values, scatter=scatter, better=better)

    def points(self, model: LogRadiance, rings: Rings, light: RingLight | None) -> Points:
        """Return points that spread over nothing: the curve is of whole rings."""
        del model
        n = len(rings)
        lit = np.ones(n) if light is None else light.lit.mean(axis=1)
        zero, one = np.zeros(n), np.ones(n)
        return Points(
            high=np.zeros((n, 1)),
            low=np.zeros((n, 1)),
            weight=lit[:, None],
            width_high=one,
            width_low=one,
            shift_high=zero,
            shift_low=zero,
            best=one,
            best_std=zero,
        )

    def tables(self, points: Points, variance: FloatArray) -> Tables:
        """Tabulate the curve, and its mean over an uncertain ln L, for n rings."""
        margin = 3.0 * float(np.sqrt(variance.max(initial=0.0))) + 0.1
        grid = regular_grid(self.span[0] - margin, self.span[1] + margin)
        curve = np.interp(grid, self.grid, self.values, left=_NEVER, right=_NEVER)
        sharp = np.tile(curve, (len(points.best), 1))
        nodes, weights = np.polynomial.hermite_e.hermegauss(9)
        at = grid + np.sqrt(variance)[:, None, None] * nodes[:, None]
        mean = np.einsum(
            "k,nkg->ng", weights / weights.sum(), np.interp(at, self.grid, self.values)
        )
        return Tables(grid=grid, sharp=sharp, mean=mean)

    def widened(self, values: FloatArray, points: Points, z: float) -> FloatArray:
        """Add z standard deviations of the scatter; beyond its ends the curve is at its worst."""
        del points
        return np.asarray(np.maximum(values, self.values.min()) + z * self.scatter)

    def needs(self, points: Points, need: float) -> list[tuple[float, FloatArray]]:
        """Return what the curve must reach for the quality to be reached, with its chance."""
        n = len(points.best)
        return [
            (weight, np.full(n, self.sign * need - node * self.scatter)) for node, weight in _NODES
        ]


def measured_between(
    log_brightness: FloatArray, measured: NDArray[np.bool_], target: str
) -> tuple[float, float]:
    """Return the brightnesses between which `LEAST_MEASURED` of the captures measure a quality.

    Parameters
    ----------
    log_brightness : (n,) ndarray
        Of all captures of rings of which some capture measures it.
    measured : (n,) ndarray of bool
        Which of them do.
    target : str
        Its name, for the error.

    Raises
    ------
    ObservationError
        If there is no such brightness.
    """
    order = np.argsort(log_brightness)
    x, seen = log_brightness[order], measured[order].astype(np.float64)
    beside = np.ones(min(_BESIDE, len(seen)))
    share = np.convolve(seen, beside, "same") / np.convolve(np.ones_like(seen), beside, "same")
    enough = share >= LEAST_MEASURED
    if not enough.any():
        msg = (
            f"{target} is measured in at most {100 * share.max():.0f} % of the captures at any "
            f"brightness; expected at least {100 * LEAST_MEASURED:.0f} % somewhere"
        )
        raise ObservationError(msg)
    starts = np.flatnonzero(np.diff(enough, prepend=False) & enough)
    ends = np.flatnonzero(np.diff(enough, append=False) & enough)
    most = int(np.argmax([seen[a : b + 1].sum() for a, b in zip(starts, ends, strict=True)]))
    return float(x[starts[most]]), float(x[ends[most]])


def rows_of_quality(frame: pl.DataFrame, target: str) -> pl.DataFrame:
    """Return the rows that have a quality.

    Raises
    ------
    ObservationError
        If there is no such numeric column, or it is empty.
    """
    if target not in frame.columns or not frame[target].dtype.is_numeric():
        numeric = [name for name, dtype in frame.schema.items() if dtype.is_numeric()]
        msg = f"no numeric column {target!r} to learn a quality from; there are {numeric}"
        raise ObservationError(msg)
    rows = frame.filter(pl.col(target).is_not_null() & pl.col(target).is_finite())
    if rows.height == 0:
        msg = f"column {target!r} has no value in any measured row"
        raise ObservationError(msg)
    return rows
