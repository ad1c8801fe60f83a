"""Which captures would tell most: those that leave least uncertain of the rings to be measured.

A capture measures the radiance of its view's rings, as far as they neither clip nor stay dark at
its exposure time. What it would leave uncertain of all target rings follows from the joint
covariance alone, before anything is captured (Cohn, Ghahramani and Jordan 1996, Sect. 4: the
expected variance of the learner, minimised), and so does what captures after it would.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, TypeAlias

import numpy as np
import polars as pl
from numpy.typing import NDArray
from scipy.special import ndtr

from exposight.cell import GREY_MAX
from exposight.errors import InputError
from exposight.models.ring_data import DARK, FEW_CLIPPED, measurement_variance
from exposight.models.ring_light import Rings
from exposight.models.window import Points, Response, Window
from exposight.models.window_model import WindowModel
from exposight.tables import count

FloatArray: TypeAlias = NDArray[np.float64]

_HEADROOM = 0.55
"""Mean brightness over the brightest frame's, in sinusoidal fringes: above that share of full scale
something clips. Used where the model does not know the sensor's limit."""

_LIT = 0.5
"""Share of a ring's points that must be lit and seen."""

_LEAST_CHANCE = 1e-3
_LEAST_SPREAD = 0.02
"""Of ln brightness at which a ring begins to clip: no limit is known better (assumed)."""

_MOST_RINGS = 4000
"""Their covariance and what becomes of it take half a gigabyte."""

_SCHEMA = {
    "view": pl.String,
    "exposure_ms": pl.Float64,
    "rings": pl.Float64,
    "error_before": pl.Float64,
    "error_after": pl.Float64,
}


@dataclass(frozen=True, kw_only=True, eq=False)
class CaptureProposer:
    """Knows how much a capture would tell of target rings; build it with `of`.

    Parameters
    ----------
    rings : Rings
        All n rings, of views that could be captured and targets.
    views : mapping of str to (r,) ndarray of int
        Places of the rings that each view sees.
    targets : (g,) ndarray of int
        Places of the rings that are to be known.
    exposures_ms : (m,) ndarray, ms
        Exposure times that could be set.
    covariance : (n, n) ndarray
        Of ln radiance, without the scatter from ring to ring.
    scatter : float
        Variance of that scatter.
    widening : (n,) ndarray
        Factors of the standard deviation (`LogRadiance`).
    usable : (n, m) ndarray
        Chance that a ring neither clips nor stays dark.
    noise : (n, m) ndarray
        Variance of ln radiance, measured at an exposure time where the ring is usable.
    """

    rings: Rings
    views: Mapping[str, NDArray[np.int64]]
    targets: NDArray[np.int64]
    exposures_ms: FloatArray
    covariance: FloatArray
    scatter: float
    widening: FloatArray
    usable: FloatArray
    noise: FloatArray

    @classmethod
    def of(
        cls,
        model: WindowModel,
        candidates: pl.DataFrame,
        exposures_ms: Sequence[float] | FloatArray,
        *,
        targets: pl.DataFrame | None = None,
    ) -> CaptureProposer:
        """Work out what a model knows of rings, and what captures could measure of them.

        Parameters
        ----------
        model : WindowModel
            What is known so far.
        candidates : polars.DataFrame
            Rings of views that could be captured: ``feature``, ``view`` and poses, as
            `WindowModel.forecast` takes them.
        exposures_ms : sequence of float, ms
            Exposure times that could be set.
        targets : polars.DataFrame, optional
            Rings that are to be known; the candidates by default.

        Raises
        ------
        InputError
            If there is no candidate, target or exposure time above 0, or there are too many rings.
        ObservationError
            If rings are of another sensor or TCP, or poses are missing.
        """
        times = np.asarray(exposures_ms, dtype=np.float64)
        wanted = candidates if targets is None else targets
        if not (candidates.height and wanted.height and times.size and (times > 0.0).all()):
            msg = (
                "a proposal needs at least one view that could be captured, one ring to be known "
                f"and exposure times above 0 ms, got {candidates.height} and {wanted.height} rings "
                f"and exposure times {times.tolist()[:5]}"
            )
            raise InputError(msg)
        rings, place = model.radiance.rings(pl.concat([candidates, wanted], how="diagonal_relaxed"))
        if len(rings) > _MOST_RINGS:
            msg = (
                f"{count(len(rings))} rings are too many to be weighed together, the most is "
                f"{count(_MOST_RINGS)}; give fewer views or fewer targets"
            )
            raise InputError(msg)
        process = model.radiance.learnt.process
        prediction = model.radiance.learnt.predict(rings)
        points = model.window.points(model.radiance.learnt, rings, prediction.light)
        covariance = prediction.covariance / np.outer(prediction.widening, prediction.widening)
        covariance[np.diag_indices(len(rings))] -= process.noise_variance
        logs = prediction.mean[:, None] + np.log(times)
        std = np.sqrt(np.diagonal(prediction.covariance))
        ceiling = _unclipped_to(model.window, points, model.radiance.black_level)
        spread = np.maximum(np.hypot(std, points.shift_high), _LEAST_SPREAD)[:, None]
        bright = ndtr((ceiling[:, None] - logs) / spread)
        dark = ndtr((np.log(DARK) - logs) / np.maximum(std, _LEAST_SPREAD)[:, None])
        lit = points.weight.sum(axis=1) >= _LIT
        ring_of_candidate, names = place[: candidates.height], candidates["view"].to_numpy()
        return cls(
            rings=rings,
            views={
                view: np.unique(ring_of_candidate[names == view])
                for view in candidates["view"].unique(maintain_order=True)
            },
            targets=np.unique(place[candidates.height :]),
            exposures_ms=times,
            covariance=covariance,
            scatter=process.noise_variance,
            widening=prediction.widening,
            usable=np.maximum(bright - dark, 0.0) * lit[:, None],
            noise=measurement_variance(np.exp(np.minimum(logs, np.log(GREY_MAX)))),
        )

    @property
    def target_std(self) -> FloatArray:
        """Standard deviation of each target's ln radiance, (g,), as forecasts have it."""
        variance = np.maximum(np.diagonal(self.covariance)[self.targets], 0.0) + self.scatter
        out: FloatArray = self.widening[self.targets] * np.sqrt(variance)
        return out

    @cached_property
    def error(self) -> float:
        """Root mean square of the targets' standard deviations."""
        return float(np.sqrt(np.mean(self.target_std**2)))

    def ranking(self) -> pl.DataFrame:
        """Return the best capture of each view, the most telling first; as `propose_captures`."""
        rows = [self._row(view, *self._best(view)) for view in self.views]
        return pl.DataFrame(rows, schema=_SCHEMA, orient="row").sort(
            "error_after", maintain_order=True
        )

    def sequence(self, n: int, *, again: bool = False) -> pl.DataFrame:
        """Return captures one after the other, each the most telling after those before it.

        What a capture leaves uncertain does not depend on what it shows, so nothing need be
        captured between.

        Parameters
        ----------
        n : int
            How many; fewer where views run out.
        again : bool
            Whether a view may be captured more than once.

        Returns
        -------
        polars.DataFrame
            Columns as `propose_captures`, a row for each capture.
        """
        return pl.DataFrame(list(self._steps(n, again)), schema=_SCHEMA, orient="row")

    def _steps(self, n: int, again: bool) -> Iterator[tuple[Any, ...]]:
        state = self
        for _ in range(n):
            if not state.views:
                return
            best = {view: state._best(view) for view in state.views}
            view = min(best, key=lambda each: best[each][1])
            yield state._row(view, *best[view])
            state = state.after(view, best[view][0])
            if not again:
                left = {name: rings for name, rings in state.views.items() if name != view}
                state = replace(state, views=left)

    def after(self, view: str, exposure: int) -> CaptureProposer:
        """Return what would be known after a capture.

        Parameters
        ----------
        view : str
            One of `views`.
        exposure : int
            Place of its exposure time in `exposures_ms`.
        """
        within, _ = self._system(view)
        across = self.covariance[:, self.views[view]]
        explained = across @ np.linalg.solve(within[exposure], across.T)
        return replace(self, covariance=self.covariance - explained)

    def _best(self, view: str) -> tuple[int, float]:
        """Return a view's most telling exposure time, by its place, and the error it leaves."""
        within, shared = self._system(view)
        gain = np.einsum("tii->t", np.linalg.solve(within, shared)) / len(self.targets)
        place = int(np.argmax(gain))
        return place, float(np.sqrt(max(self.error**2 - gain[place], 0.0)))

    def _system(self, view: str) -> tuple[FloatArray, FloatArray]:
        """Return the covariance of what a view's rings would show, (m, r, r), and K Kᵀ of targets.

        A ring that is usable with a chance p is taken as one that surely is, with so much more
        noise that it tells p times as much.
        """
        rings = self.views[view]
        within = self.covariance[np.ix_(rings, rings)]
        share = np.maximum(self.usable[rings], _LEAST_CHANCE).T
        prior = np.diagonal(within)
        alone = (prior + self.scatter + self.noise[rings].T) / share - prior
        across = self.covariance[np.ix_(self.targets, rings)] * self.widening[self.targets, None]
        return within + alone[:, :, None] * np.eye(len(rings)), across.T @ across

    def _row(self, view: str, exposure: int, after: float) -> tuple[Any, ...]:
        rings = float(self.usable[self.views[view], exposure].sum())
        return view, float(self.exposures_ms[exposure]), rings, self.error, after


def propose_captures(
    model: WindowModel,
    candidates: pl.DataFrame,
    exposures_ms: Sequence[float] | FloatArray,
    *,
    targets: pl.DataFrame | None = None,
) -> pl.DataFrame:
    """Rank captures by what they would tell of the rings that are to be measured.

    Parameters and errors are those of `CaptureProposer.of`, which proposes sequences, too.

    Returns
    -------
    polars.DataFrame
        A row for each view, the most telling first: ``view``, ``exposure_ms``, ``rings`` (expected
        number of rings that it measures), ``error_before`` and ``error_after``, the root mean
        square of the standard deviation of the targets' ln radiance.
    """
    return CaptureProposer.of(model, candidates, exposures_ms, targets=targets).ranking()


def _unclipped_to(window: Response, points: Points, black_level: float) -> FloatArray:
    """Return ln(L·t) up to which so little of each ring clips that its radiance counts, (n,)."""
    if not isinstance(window, Window):
        return np.full(len(points.best), np.log(_HEADROOM * (GREY_MAX - black_level)))
    above = points.high - window.log_high
    width = points.width_high[:, None]
    low: FloatArray = -above.max(axis=1) - 6.0 * width[:, 0]
    high = low + 12.0 * width[:, 0] + np.ptp(above, axis=1)
    for _ in range(40):
        middle = 0.5 * (low + high)
        clipped = (points.weight * ndtr((above + middle[:, None]) / width)).sum(axis=1)
        few = clipped <= FEW_CLIPPED
        low, high = np.where(few, middle, low), np.where(few, high, middle)
    return low
