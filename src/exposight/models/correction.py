"""What captures teach of rings that they do not show: the view's, and the whole cell's.

A lamp ages, a part comes with another finish: then all rings are brighter or darker than learnt, by
the same factor, or by one that depends on the half vector of light and sight. A few measured rings
tell which.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray
from scipy.special import log_ndtr

from exposight.models.ring_forecast import RingForecast

FloatArray: TypeAlias = NDArray[np.float64]


def corrected(
    forecast: RingForecast, rings: NDArray[np.int64], value: FloatArray, variance: FloatArray
) -> RingForecast:
    """Correct all rings by those that were measured: the ring, its view, the whole cell.

    What is common to the cell, such as its lamp's power, and what depends on the half vector, such
    as another finish, are normal deviations beside what is learnt; how large they are is decided by
    the likelihood of what was measured, with the learnt cell as the first guess. Rings that are
    known to be on another finish deviate by themselves.

    Parameters
    ----------
    forecast : RingForecast
        From poses.
    rings : (k,) ndarray of int
        The rings that were measured.
    value, variance : (k,) ndarray
        Their ln radiance.
    """
    n = len(forecast.mean)
    alike: FloatArray = np.ones((n, n), dtype=np.float64)
    if forecast.half is not None:
        apart = forecast.half[:, None, :] - forecast.half[None, :, :]
        alike[:] = np.exp(-0.5 * (apart**2).sum(axis=2) / _LOBE**2)
    covariance, shape = forecast.covariance.copy(), np.zeros(n)
    finishes = np.array(forecast.other_finish or ("",) * n)
    error = value - forecast.mean[rings]
    remarks = list(forecast.remarks)
    for finish in dict.fromkeys(finishes.tolist()):
        members = np.flatnonzero(finishes == finish)
        shown = finishes[rings] == finish
        place = np.ix_(rings[shown], rings[shown])
        guess = _likeliest(
            _OTHER_SURFACE if finish else _GUESSES,
            covariance[place] + np.diag(variance[shown]),
            alike[place],
            error[shown],
        )
        block = np.ix_(members, members)
        covariance[block] += guess.cell**2 + guess.surface**2 * alike[block]
        shape[members] = _SHAPE if guess.surface else 0.0
        if shown.any() and (guess.cell > _GUESSES[0].cell or guess.surface):
            what = f"{finish!r}, which was not learnt: features" if finish else "features"
            remarks.append(
                f"{what} are {math.exp(float(np.median(error[shown]))):.2g} times as bright as "
                "forecast"
            )
    within = covariance[np.ix_(rings, rings)] + np.diag(variance)
    gain = np.linalg.solve(within, covariance[rings]).T
    mean = forecast.mean + gain @ error
    covariance = covariance - gain @ covariance[rings]
    measured = {*rings.tolist()}
    points = forecast.points._replace(
        shift_low=np.hypot(forecast.points.shift_low, shape),
        shift_high=np.hypot(forecast.points.shift_high, shape),
    )
    return replace(
        forecast,
        mean=mean,
        covariance=0.5 * (covariance + covariance.T),
        points=points,
        source=tuple(
            "pose and image" if i in measured else each for i, each in enumerate(forecast.source)
        ),
        unknown=tuple("" if i in measured else reason for i, reason in enumerate(forecast.unknown)),
        remarks=tuple(dict.fromkeys(remarks)),
    )


def _likeliest(
    guesses: tuple[_Guess, ...], within: FloatArray, alike: FloatArray, error: FloatArray
) -> _Guess:
    """Return the guess under which what was measured is likeliest; the last without anything."""
    if not len(error):
        return guesses[-1] if guesses is _OTHER_SURFACE else guesses[0]

    def evidence(guess: _Guess) -> float:
        factor = np.linalg.cholesky(within + guess.cell**2 + guess.surface**2 * alike)
        white = np.linalg.solve(factor, error)
        spread = float(np.log(np.diag(factor)).sum())
        return guess.log_weight - 0.5 * float(white @ white) - spread

    return max(guesses, key=evidence)


class _Guess(NamedTuple):
    """Standard deviations of ln radiance beside what is learnt, and the guess's ln weight."""

    cell: float
    surface: float
    log_weight: float


_GUESSES = (
    _Guess(0.03, 0.0, 0.0),
    _Guess(0.15, 0.0, -1.5),
    _Guess(0.6, 0.0, -2.5),
    _Guess(0.6, 0.2, -4.0),
    _Guess(0.6, 0.7, -5.0),
)
"""A learnt cell; a lamp that drifts, or was exchanged; another finish. Assumed."""

_OTHER_SURFACE = (_Guess(0.6, 0.2, 0.0), _Guess(0.6, 0.7, 0.0))

_LOBE = 0.2
"""Difference of half vectors, in slopes, over which finishes differ alike (assumed)."""

_SHAPE = 0.08
"""How much less sure the window's edges are on another finish, ln (assumed)."""

_LIMIT_STD = 0.1
"""How uncertain a limit is: clipped pixels pull a mean down by some percent."""


def with_limit(
    forecast: RingForecast, rings: NDArray[np.int64], limits: FloatArray, signs: NDArray[np.int64]
) -> RingForecast:
    """Condition on rings that are brighter (1) or darker (−1) than a limit, by moments.

    Parameters
    ----------
    forecast : RingForecast
    rings : (k,) ndarray of int
        Rings of which a limit is known.
    limits : (k,) ndarray
        ln radiance.
    signs : (k,) ndarray of int
    """
    mean, covariance = forecast.mean.copy(), forecast.covariance.copy()
    for ring, limit, sign in zip(rings, limits, signs, strict=True):
        variance = float(covariance[ring, ring])
        spread = math.hypot(math.sqrt(variance), _LIMIT_STD)
        z = float(sign) * float(mean[ring] - limit) / spread
        ratio = math.exp(-0.5 * z * z - float(log_ndtr(z))) / math.sqrt(2.0 * math.pi)
        along = covariance[:, ring] / variance
        mean += along * (float(sign) * variance * ratio / spread)
        shrunk = variance**2 * ratio * (ratio + z) / spread**2
        covariance -= np.outer(along, along) * shrunk
    return replace(forecast, mean=mean, covariance=covariance)
