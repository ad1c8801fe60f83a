"""Chances that captures of a view serve its features: each by itself, and several together.

A feature's window of exposure times is uncertain because its radiance is, which all its exposures
share: failures of two exposures are not independent, and taking the same one twice gains nothing.
With ln lo = a − δ + d and ln hi = b − δ − e, where δ is the error of ln radiance and d, e those of
the edges, the chance of two exposures s < t together is

    P(lo ≤ s, hi ≥ t) = ∫ Φ((ln s − a + δ)/σ_d) Φ((b − ln t − δ)/σ_e) N(δ; 0, σ²) dδ,

and as a window is an interval, that of at least one of t₁ < t₂ < … is exactly

    Σ_i [P(t_i) − P(t_{i−1} ∧ t_i)].
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from exposight.compiled import njit
from exposight.errors import InputError
from exposight.models import RingForecast
from exposight.models.window import normal_at
from exposight.planning.exposure_limits import ExposureLimits

FloatArray: TypeAlias = NDArray[np.float64]

_STEPS = (0.1, 1.0)
"""Least and largest distance of the integral's nodes, standard deviations."""

_FINE = 0.6
"""Distance of nodes over an edge's width, where an edge is wide enough to smooth between them."""

SETTINGS = 72
"""Settings among which exposures are chosen."""

_NOT_EXCLUDED = 0.02
"""Chance from which on an exposure time is looked at."""

_SHARP = 1e-4
"""Least width of an edge, ln: a known window's."""


@dataclass(frozen=True, kw_only=True, eq=False)
class CaptureChances:
    """What captures of one view at m exposure times promise for n features.

    `Forecast.chances` makes it.

    Parameters
    ----------
    view : str
        The view's name.
    features : tuple of str
        The n features.
    settings_ms : (m,) ndarray, ms
        Exposure times that may be taken, ascending.
    need : float
        Quality that is asked for.
    windows_ms : (n, 2) ndarray, ms
        Median exposure times between which each feature reaches `need`; NaN where none does, or
        where a model knows no window.
    reasons : tuple of str
        Why a feature's chances should not be relied on; empty where they may be.
    weights : (q,) ndarray
        Weights of q cases between which windows are independent; none where only chances by
        themselves are known: then several captures are no surer than the best of them, which is the
        least that their joint chance can be, whatever their dependence (Fréchet).
    begun, lasting : (n, q, m) ndarray
        In each case the chances that the window has begun at an exposure time, and that it lasts.
    chance : (n, m) ndarray
        Chance that one capture serves.
    never : tuple of str
        Why a feature without a window has none, where a model knows it.
    """

    view: str
    features: tuple[str, ...]
    settings_ms: FloatArray
    need: float
    windows_ms: FloatArray
    reasons: tuple[str, ...]
    weights: FloatArray
    begun: FloatArray
    lasting: FloatArray
    chance: FloatArray
    never: tuple[str, ...] = ()

    @classmethod
    def by_themselves(
        cls,
        chance: ArrayLike,
        settings_ms: ArrayLike,
        *,
        features: Sequence[str],
        need: float,
        view: str = "",
        reasons: Sequence[str] = (),
    ) -> CaptureChances:
        """Return chances of a model that knows no windows: several captures are as the best one.

        Parameters
        ----------
        chance : (n, m) array_like
            Of n features at m settings.
        settings_ms, features, need, view, reasons
            As for the class.
        """
        values, settings = np.asarray(chance, dtype=np.float64), _checked(settings_ms)
        n = len(features)
        return cls(
            view=view,
            features=tuple(features),
            settings_ms=settings,
            need=need,
            windows_ms=np.full((n, 2), np.nan),
            reasons=tuple(reasons) or ("",) * n,
            weights=np.zeros(0),
            begun=np.zeros((n, 0, len(settings))),
            lasting=np.zeros((n, 0, len(settings))),
            chance=values,
        )

    @classmethod
    def of_rings(
        cls,
        rings: RingForecast,
        settings_ms: ArrayLike,
        *,
        view: str = "",
        features: Sequence[str] | None = None,
    ) -> CaptureChances:
        """Return the chances of the rings of one view.

        Parameters
        ----------
        rings : RingForecast
            What to expect of them.
        settings_ms : (m,) array_like, ms
            Exposure times that may be taken, ascending.
        view : str
            The view's name.
        features : sequence of str, optional
            Names of the features; the forecast's by default.

        Raises
        ------
        InputError
            If there is no setting, or they do not ascend.
        """
        settings = _checked(settings_ms)
        cases = [
            (weight, first - rings.mean, last - rings.mean)
            for weight, first, last in rings.window_ends()
        ]
        low_ms, high_ms = rings.window_ms()
        return cls._of_cases(
            cases,
            rings.std,
            (rings.points.shift_low, rings.points.shift_high),
            view=view,
            features=tuple(rings.features if features is None else features),
            settings_ms=settings,
            need=rings.need,
            windows_ms=np.column_stack([low_ms, high_ms]),
            reasons=rings.unknown,
            never=rings.why_never(),
        )

    @classmethod
    def within(
        cls,
        rings: RingForecast,
        limits: ExposureLimits,
        *,
        count: int = SETTINGS,
        view: str = "",
        features: Sequence[str] | None = None,
    ) -> CaptureChances:
        """Return the chances of the rings of one view at settings that may serve any of them.

        Parameters
        ----------
        rings, view, features
            As for `of_rings`.
        limits : ExposureLimits
            What the sensor can be set to.
        count : int
            Settings to look at, at most, at about equal ratios.
        """
        low, high = rings.window_ms(_NOT_EXCLUDED)
        settings: FloatArray = np.zeros(0, dtype=np.float64)
        if np.isfinite(low).any():
            first, last = float(np.nanmin(low)), float(np.nanmax(high))
            settings = limits.settings(first, last, count)
        if not len(settings):  # those that there are show why none serves
            settings = limits.settings(limits.min_ms, limits.max_ms, count)
        return cls.of_rings(rings, settings, view=view, features=features)

    @classmethod
    def of_windows(
        cls,
        windows_ms: ArrayLike,
        settings_ms: ArrayLike,
        *,
        features: Sequence[str],
        std: ArrayLike = 0.0,
        edge_std: ArrayLike = 0.0,
        view: str = "",
        need: float = 0.75,
    ) -> CaptureChances:
        """Return the chances of windows that are given.

        Parameters
        ----------
        windows_ms : (n, 2) array_like, ms
            Median ends of each feature's window; NaN for none.
        settings_ms : (m,) array_like, ms
            Exposure times that may be taken, ascending.
        features : sequence of str
            Names of the n features.
        std, edge_std : float or (n,) array_like
            Standard deviations of ln exposure time: of the whole window, and of either end beside.
        view, need
            As for the class.
        """
        ends = np.asarray(windows_ms, dtype=np.float64).reshape(-1, 2)
        each = np.broadcast_to(np.asarray(edge_std, dtype=np.float64), len(ends))
        with np.errstate(divide="ignore"):
            first, last = np.log(ends).T
        return cls._of_cases(
            [(1.0, first, last)],
            np.broadcast_to(np.asarray(std, dtype=np.float64), len(ends)),
            (each, each),
            view=view,
            features=tuple(features),
            settings_ms=_checked(settings_ms),
            need=need,
            windows_ms=ends,
            reasons=("",) * len(ends),
        )

    @classmethod
    def _of_cases(
        cls,
        cases: Sequence[tuple[float, FloatArray, FloatArray]],
        std: FloatArray,
        edges: tuple[FloatArray, FloatArray],
        **fields: object,
    ) -> CaptureChances:
        """Return the chances of weighed cases of windows' ends, in ln ms."""
        log_ms = np.log(np.asarray(fields["settings_ms"]))
        edge = min(float((each / np.maximum(std, _SHARP)).min(initial=1.0)) for each in edges)
        step = float(np.clip(_FINE * edge, *_STEPS))
        nodes = np.arange(-4.0, 4.0 + step / 2, step)
        share = np.exp(-0.5 * nodes**2) / np.exp(-0.5 * nodes**2).sum()
        # Errors are spread about each node, so that sharp edges give no steps: half a step leaves
        # ripples of 0.7 % in the distribution's density.
        spread = std * step / 2.0
        shift = (std * np.sqrt(1.0 - step**2 / 4.0))[:, None] * nodes
        low, high = (np.maximum(np.hypot(each, spread), _SHARP) for each in edges)
        weights = np.concatenate([weight * share for weight, _, _ in cases])
        tables = [_edges(log_ms, shift, first, last, low, high) for _, first, last in cases]
        begun, lasting = (np.concatenate(each, axis=1) for each in zip(*tables, strict=True))
        return cls(
            weights=weights,
            begun=begun,
            lasting=lasting,
            chance=np.einsum("q,nqm,nqm->nm", weights, begun, lasting),
            **fields,  # type: ignore[arg-type]
        )

    @cached_property
    def gain(self) -> FloatArray:
        """Chance that a capture at t serves and one at s < t does not, (n, m, m) by s and t."""
        if not len(self.weights):
            return np.maximum(self.chance[:, None, :] - self.chance[:, :, None], 0.0)
        both = np.swapaxes(self.begun, 1, 2) @ (self.weights[:, None] * self.lasting)
        out: FloatArray = np.maximum(self.chance[:, None, :] - both, 0.0)
        return out

    @cached_property
    def begins(self) -> FloatArray:
        """Chance that some capture up to each exposure time can serve, at most, (n, m)."""
        if len(self.weights):
            out: FloatArray = np.einsum("q,nqm->nm", self.weights, self.begun)
            return out
        return np.maximum.accumulate(self.chance, axis=1)

    @cached_property
    def lasts(self) -> FloatArray:
        """Chance that some capture from each exposure time on can serve, at most, (n, m)."""
        if len(self.weights):
            out: FloatArray = np.einsum("q,nqm->nm", self.weights, self.lasting)
            return out
        return np.maximum.accumulate(self.chance[:, ::-1], axis=1)[:, ::-1]

    @property
    def later(self) -> FloatArray:
        """At most so much chance do captures after each exposure time add to one there, (n, m).

        What serves later and not now has a window that has not begun.
        """
        return np.maximum(self.lasts - self.chance, 0.0)

    def any_of(self, places: Sequence[int]) -> FloatArray:
        """Return the chance that at least one of some captures serves, (n,).

        Parameters
        ----------
        places : sequence of int
            Their places among `settings_ms`, in any order.
        """
        ordered = sorted(set(map(int, places)))
        if not ordered:
            return np.zeros(len(self.features))
        if not len(self.weights):
            best: FloatArray = self.chance[:, ordered].max(axis=1)
            return best
        out: FloatArray = _any_of(self.weights, self.begun, self.lasting, np.array(ordered))
        return out

    def take(self, features: Sequence[str]) -> CaptureChances:
        """Return the chances of some of the features."""
        place = {name: i for i, name in enumerate(self.features)}
        rows = [place[name] for name in features]
        return CaptureChances(
            view=self.view,
            features=tuple(features),
            settings_ms=self.settings_ms,
            need=self.need,
            windows_ms=self.windows_ms[rows],
            reasons=tuple(self.reasons[i] for i in rows),
            weights=self.weights,
            begun=self.begun[rows],
            lasting=self.lasting[rows],
            chance=self.chance[rows],
            never=tuple(self.never[i] for i in rows) if self.never else (),
        )


def _checked(settings_ms: ArrayLike) -> FloatArray:
    settings = np.asarray(settings_ms, dtype=np.float64).reshape(-1)
    if not len(settings) or not (np.diff(settings) > 0.0).all() or not settings[0] > 0.0:
        msg = (
            "settings must be exposure times above 0 ms that ascend, got "
            f"{settings.tolist()[:6] or 'none'}"
        )
        raise InputError(msg)
    return settings


@njit()
def _any_of(
    weights: FloatArray, begun: FloatArray, lasting: FloatArray, places: NDArray[np.int64]
) -> FloatArray:  # pragma: no cover - compiled
    """Return the chance that at least one of the captures at ascending places serves, (n,)."""
    n, q, _ = begun.shape
    out = np.zeros(n)
    for i in range(n):
        for k in range(q):
            before, total = 0.0, 0.0
            for place in places:
                total += lasting[i, k, place] * (begun[i, k, place] - before)
                before = begun[i, k, place]
            out[i] += weights[k] * total
        out[i] = min(max(out[i], 0.0), 1.0)
    return out


@njit()
def _edges(
    log_ms: FloatArray,
    shift: FloatArray,
    first: FloatArray,
    last: FloatArray,
    low: FloatArray,
    high: FloatArray,
) -> tuple[FloatArray, FloatArray]:  # pragma: no cover - compiled
    """Return the chances that windows have begun and last, (n, q, m); 0 without a window."""
    n, q = shift.shape
    begun, lasting = np.zeros((n, q, len(log_ms))), np.zeros((n, q, len(log_ms)))
    for i in range(n):
        if np.isfinite(first[i]) and np.isfinite(last[i]):
            for k in range(q):
                for j in range(len(log_ms)):
                    at = log_ms[j] + shift[i, k]
                    begun[i, k, j] = normal_at((at - first[i]) / low[i])
                    lasting[i, k, j] = normal_at((last[i] - at) / high[i])
    return begun, lasting
