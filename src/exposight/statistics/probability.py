"""How well predicted distributions and chances match observations: proper scores, calibration.

A distribution is given by its quantiles at levels that are the same for all observations. Between
them it is normal: the quantiles are interpolated over the standard normal score of their level, and
go on as the last two do. A normal distribution is thus given back as it is.

Gneiting and Raftery, Strictly proper scoring rules, prediction, and estimation, Journal of the
American Statistical Association 102 (2007), 359–378.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import ndtr, ndtri

from exposight.errors import InputError, ObservationError
from exposight.statistics.vectors import FloatArray, check_vector

LEVELS: tuple[float, ...] = tuple(ndtr(np.linspace(-5.0, 5.0, 81)).tolist())
"""Levels at which quantiles describe a distribution well: eighths of a standard deviation."""

_HALF_LN_2PI = 0.5 * float(np.log(2.0 * np.pi))
_LEAST = 1e-12


def crps(observed: ArrayLike, quantiles: ArrayLike, levels: ArrayLike = LEVELS) -> float:
    """Continuous ranked probability score, the mean over observations.

    ∫ (F(x) − 1{x ≥ y})² dx, the mean absolute error where the distribution is a point (Gneiting and
    Raftery 2007, Eq. 20), as twice the integral of the quantiles' loss over their level (Laio and
    Tamea, Hydrology and Earth System Sciences 11 (2007), 1267–1277).

    Parameters
    ----------
    observed : (n,) array
    quantiles : (k, n) array
        In the same unit, ascending with the level.
    levels : (k,) array
        Strictly between 0 and 1, ascending.

    Returns
    -------
    float
        In the unit of the observations, 0 at best.

    Raises
    ------
    ObservationError, InputError
        If arrays are empty, do not match, hold a NaN, or levels or quantiles do not ascend.
    """
    y, q, a = _check_quantiles(observed, quantiles, levels)
    loss = (y - q) * (a[:, None] - (y < q))
    inner = 0.5 * (loss[1:] + loss[:-1]) * np.diff(a)[:, None]
    # beyond the first and the last level the quantile is taken to stay
    below, above = y - q[0], y - q[-1]
    first = np.where(below < 0.0, a[0] * (0.5 * a[0] - 1.0), 0.5 * a[0] ** 2) * below
    rest = 1.0 - a[-1]
    last = np.where(above < 0.0, -0.5 * rest**2, rest * (1.0 - 0.5 * rest)) * above
    return float(2.0 * np.mean(inner.sum(axis=0) + first + last))


def log_score(
    observed: ArrayLike, quantiles: ArrayLike, levels: ArrayLike = LEVELS, *, width: float = 0.0
) -> float:
    """Logarithmic score: minus the logarithm of the density at the observation, the mean, in nats.

    Gneiting and Raftery 2007, Sect. 4.1, with the sign of a loss.

    Parameters
    ----------
    observed, quantiles, levels
        As for `crps`.
    width : float
        Standard deviation of a normal error by which every distribution is widened, in the unit of
        the observations: of quantities with a limit much mass may lie on one point, where there is
        no density.

    Returns
    -------
    float
        Of the density in 1 over the unit of the observations; the lower the better.

    Raises
    ------
    ObservationError, InputError
        As for `crps`.
    """
    z, slope = _score_at(*_check_quantiles(observed, quantiles, levels), width)
    return float(np.mean(0.5 * z**2 + _HALF_LN_2PI - np.log(slope)))


def brier(happened: ArrayLike, chance: ArrayLike) -> float:
    """Brier score: the mean square of chance minus what happened, 1 or 0 (Brier 1950).

    Parameters
    ----------
    happened : (n,) array of bool
    chance : (n,) array
        From 0 to 1.

    Returns
    -------
    float
        0 at best; 0.25 for saying one half always.

    Raises
    ------
    ObservationError
        If arrays are empty, do not match, or a chance is none.
    """
    came_true, said = _check_chance(happened, chance)
    return float(np.mean((said - came_true) ** 2))


@dataclass(frozen=True, kw_only=True)
class ChanceBin:
    """Predicted chances from `low` to `high`, and what came of them.

    Parameters
    ----------
    low, high : float
        Chances of this bin.
    n : int
        Predictions in it.
    said : float
        Their mean chance.
    came_true : float
        Share that happened.
    """

    low: float
    high: float
    n: int
    said: float
    came_true: float


def reliability(happened: ArrayLike, chance: ArrayLike, *, bins: int = 10) -> tuple[ChanceBin, ...]:
    """Group predictions by their chance, and return what came of each group that is not empty.

    Parameters
    ----------
    happened, chance
        As for `brier`.
    bins : int
        Groups of equal width.

    Raises
    ------
    ObservationError
        As for `brier`.
    """
    came_true, said = _check_chance(happened, chance)
    place = np.minimum((said * bins).astype(np.int64), bins - 1)
    return tuple(
        ChanceBin(
            low=each / bins,
            high=(each + 1) / bins,
            n=int(np.count_nonzero(place == each)),
            said=float(said[place == each].mean()),
            came_true=float(came_true[place == each].mean()),
        )
        for each in range(bins)
        if (place == each).any()
    )


def _score_at(
    y: FloatArray, q: FloatArray, a: FloatArray, width: float
) -> tuple[FloatArray, FloatArray]:
    """Return the standard normal score of each observation, and the score's slope there, (n,)."""
    z = ndtri(a)
    q = q + width * z[:, None]
    cell = np.clip(np.sum(q <= y, axis=0) - 1, 0, len(a) - 2)
    columns = np.arange(len(y))
    step = np.maximum(q[cell + 1, columns] - q[cell, columns], _LEAST)
    slope = (z[cell + 1] - z[cell]) / step
    return z[cell] + (y - q[cell, columns]) * slope, slope


def _check_quantiles(
    observed: ArrayLike, quantiles: ArrayLike, levels: ArrayLike
) -> tuple[FloatArray, FloatArray, FloatArray]:
    y, a = check_vector(observed, "observed"), check_vector(levels, "levels")
    q = np.asarray(quantiles, dtype=np.float64)
    if q.shape != (len(a), len(y)):
        msg = f"quantiles must be of shape ({len(a)}, {len(y)}), level by row, got {q.shape}"
        raise ObservationError(msg)
    if len(a) < 2 or a[0] <= 0.0 or a[-1] >= 1.0 or (np.diff(a) <= 0.0).any():
        msg = f"levels must ascend between 0 and 1, at least two, got {a.tolist()[:5]}"
        raise InputError(msg)
    if not np.isfinite(q).all() or (np.diff(q, axis=0) < -1e-9 * (1.0 + np.abs(q[1:]))).any():
        msg = "quantiles must be finite and ascend with their level"
        raise ObservationError(msg)
    return y, q, a


def _check_chance(happened: ArrayLike, chance: ArrayLike) -> tuple[FloatArray, FloatArray]:
    came_true = check_vector(np.asarray(happened, dtype=np.float64), "happened")
    said = check_vector(chance, "chance")
    if said.shape != came_true.shape:
        msg = f"chance must match the {len(came_true)} observations, got {len(said)}"
        raise ObservationError(msg)
    if ((said < 0.0) | (said > 1.0)).any():
        msg = f"chances must be from 0 to 1, got {said.min():g} to {said.max():g}"
        raise ObservationError(msg)
    return came_true, said
