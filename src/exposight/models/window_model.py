"""The default quality model: p_norm over exposure time from a ring's pose; and its training."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Annotated, Any, ClassVar, TypeAlias

import numpy as np
import polars as pl
from numpy.typing import NDArray
from pydantic import Field

from exposight.errors import InputError, ObservationError
from exposight.files import validate
from exposight.models.abstaining import CURVED, curved, far_away
from exposight.models.correction import corrected
from exposight.models.evaluation import check_exposures
from exposight.models.prediction import Prediction
from exposight.models.predictor import (
    Hyperparameter,
    Predictor,
    input_array,
    register_predictor,
)
from exposight.models.radiance_model import CHUNK, RadianceModel
from exposight.models.response_curve import ResponseCurve
from exposight.models.ring_forecast import RingForecast
from exposight.models.ring_light import Rings
from exposight.models.specification import P_NORM_MIN
from exposight.models.trial import with_trial
from exposight.models.window import Window
from exposight.observing import ObservationTable
from exposight.workers import Progress, ignore_progress

FloatArray: TypeAlias = NDArray[np.float64]


@register_predictor
@dataclass(frozen=True, kw_only=True, eq=False)
class WindowModel(Predictor):
    """Predicts a quality over exposure time, from a ring's pose: p_norm, or any other.

    Parameters
    ----------
    name, title, target, inputs, provenance, sensor
        As in `Predictor`.
    radiance : RadianceModel
        How bright rings are.
    window : Window or ResponseCurve
        Between which limits a sensor gives points; of another quality, its curve over brightness.
    n_rows : int
        Captures of rings that it was learnt from.
    """

    kind: ClassVar[str] = "window"
    optional_inputs: ClassVar[tuple[str, ...]] = RadianceModel.optional_inputs

    radiance: RadianceModel
    window: Window | ResponseCurve
    n_rows: int

    @property
    def limits(self) -> tuple[float, float]:
        """The sensor's two limits: grey levels of modulation, and grey levels above black.

        Of a quality other than p_norm the brightnesses, above black, between which it was learnt.
        """
        if isinstance(self.window, Window):
            return self.window.limits
        low, high = np.exp(self.window.span).tolist()
        return low, high

    def predict_frame(self, frame: pl.DataFrame) -> Prediction:
        """Predict for a frame with `inputs` and perhaps `optional_inputs`."""
        return self.predict_in_steps(frame, ignore_progress)

    def predict_in_steps(self, frame: pl.DataFrame, progress: Progress) -> Prediction:
        """As `predict_frame`; tells the rings that are done."""
        mean, low, high, known = self._by_row(
            frame,
            lambda forecast: (
                forecast.p_norm,
                forecast.low,
                forecast.high,
                np.broadcast_to(forecast.knows[:, None], forecast.p_norm.shape),
            ),
            progress,
        )
        return WindowPrediction(
            mean=mean,
            std=np.maximum((high - low) / 4.0, self.window.scatter),
            inside=known > 0.5,
            low=low,
            high=high,
            model=self,
            frame=frame,
        )

    def quantiles(
        self, data: ObservationTable | pl.DataFrame, levels: Sequence[float]
    ) -> FloatArray:
        """Return quantiles of p_norm, (len(levels), n)."""
        frame = self._inputs(data, {})
        return np.stack(self._by_row(frame, lambda forecast: tuple(map(forecast.quantile, levels))))

    def chance(self, data: ObservationTable | pl.DataFrame, need: float = P_NORM_MIN) -> FloatArray:
        """Return the chance that p_norm reaches a value, (n,)."""
        frame = self._inputs(data, {})
        return self._by_row(frame, lambda forecast: (forecast.chance_of(need),))[0]

    def unknown(self, data: ObservationTable | pl.DataFrame) -> tuple[str, ...]:
        """Say for each row why its prediction should not be relied on; empty where it may be."""
        frame = self._inputs(data, {})
        rings, ring = self.radiance.rings(frame)
        reasons: list[str] = []
        for start in range(0, len(rings), CHUNK):
            some = rings.take(range(start, min(start + CHUNK, len(rings))))
            reasons += self._forecast(some, np.ones(1), P_NORM_MIN, frame).unknown
        return tuple(reasons[place] for place in ring)

    def _by_row(
        self, frame: pl.DataFrame, read: Any, progress: Progress = ignore_progress
    ) -> list[FloatArray]:
        rings, ring = self.radiance.rings(frame)
        exposure_ms = input_array(self.name, frame.select("exposure_ms"))[:, 0]
        if not (exposure_ms > 0.0).all():
            row = int(np.argmin(exposure_ms))
            got = f"got {exposure_ms[row]:g} in row {row + 1}"
            msg = f"{self.name}: exposure_ms must be above 0, {got}"
            raise ObservationError(msg)
        out: list[FloatArray] = []
        for start in range(0, len(rings), CHUNK):
            some = range(start, min(start + CHUNK, len(rings)))
            rows = np.flatnonzero((ring >= start) & (ring < start + CHUNK))
            times, place = np.unique(exposure_ms[rows], return_inverse=True)
            forecast = self._forecast(rings.take(some), times, P_NORM_MIN, frame)
            for i, values in enumerate(read(forecast)):
                if start == 0:
                    out.append(np.empty(len(exposure_ms)))
                out[i][rows] = values[ring[rows] - start, place]
            progress("predicting", some.stop, len(rings))
        return out

    def forecast(
        self,
        rings: pl.DataFrame,
        exposures_ms: Sequence[float] | FloatArray,
        *,
        trial: ObservationTable | None = None,
        need: float | None = None,
        correct: bool = False,
    ) -> RingForecast:
        """Forecast rings over exposure time.

        Parameters
        ----------
        rings : polars.DataFrame
            ``feature``, ``view``, `POSE_COLUMNS`, and of `optional_inputs` what there is; a row for
            each ring.
        exposures_ms : sequence of float, ms
            Exposure times to look at.
        trial : ObservationTable, optional
            Captures of these views, at any exposure times.
        need : float, optional
            Quality that is asked for; of p_norm `P_NORM_MIN` by default.
        correct : bool
            Let captures correct rings that they do not show (`exposight.models.trial.with_trial`),
            as while measuring.

        Raises
        ------
        ObservationError
            If rings are of another sensor or TCP, or the trial has no row of them.
        InputError
            If there is no ring or exposure time, or the trial was taken from another pose.
        """
        times = np.asarray(exposures_ms, dtype=np.float64)
        if rings.height == 0 or times.size == 0 or not (times > 0).all():
            msg = (
                "a forecast needs at least one ring and exposure times above 0 ms, got "
                f"{rings.height} rings and {times.tolist()[:5]}"
            )
            raise InputError(msg)
        if need is None and self.target != "p_norm":
            msg = f"say which {self.target} is needed, in {self.unit}"
            raise InputError(msg)
        need = P_NORM_MIN if need is None else need
        unique, _ = self.radiance.rings(rings)
        if len(unique) != rings.height:
            msg = f"the same ring twice among {rings.height}; give each feature and view once"
            raise InputError(msg)
        forecast = self._forecast(unique, times, need, rings)
        if trial is None:
            other = correct and any(forecast.other_finish)
            return corrected(forecast, *_NOTHING_MEASURED) if other else forecast
        check_exposures(trial.measured(), self.sensor)
        contradictions = self.radiance.origin.contradictions(trial.measured().frame)
        for name in ("sensor", "tcp"):
            if name in contradictions:
                msg = f"{self.name}: the trial is of {contradictions[name]}"
                raise ObservationError(msg)
        forecast = replace(forecast, features=tuple(rings["feature"]), views=tuple(rings["view"]))
        return with_trial(
            forecast,
            unique.positions,
            trial,
            other_surface=contradictions.get("finish", ""),
            correct=correct,
        )

    def _forecast(
        self, rings: Rings, times: FloatArray, need: float, frame: pl.DataFrame
    ) -> RingForecast:
        learnt = self.radiance.learnt
        prediction = learnt.predict(rings)
        points = self.window.points(learnt, rings, prediction.light)
        finishes, learnt_on = (
            self.radiance.origin.other_finishes(frame),
            self.radiance.origin.finish,
        )
        dark = points.weight.sum(axis=1) < 0.5
        # where a capture would show the ring well, as far as is known
        telling_ms = _WELL_LIT * np.exp(-prediction.mean)
        domed = curved(frame)
        covariance = prediction.covariance.copy()
        for i, name in enumerate(rings.features):
            if name in domed:
                covariance[i, i] += _CURVED_STD**2
        unknown = tuple(
            (
                f"another finish: {finishes[name]!r}, learnt on {learnt_on!r}"
                if name in finishes
                else ""
            )
            or (CURVED if name in domed else "")
            or ("outside the light of the projector, or out of a camera's frame" if unlit else "")
            or far_away(far, time)
            for name, far, unlit, time in zip(
                rings.features,
                prediction.distance.tolist(),
                dark.tolist(),
                telling_ms.tolist(),
                strict=True,
            )
        )
        return RingForecast(
            features=rings.features,
            views=rings.views,
            exposures_ms=times,
            mean=prediction.mean,
            covariance=covariance,
            points=points,
            window=self.window,
            black_level=self.radiance.black_level,
            need=need,
            distance=prediction.distance,
            source=("pose",) * len(rings),
            unknown=unknown,
            half=None if prediction.light is None else prediction.light.half.mean(axis=1),
            other_finish=tuple(finishes.get(name, "") for name in rings.features),
        )

    def has_learnt(self, frame: pl.DataFrame) -> NDArray[np.bool_]:
        """Return whether the ring of each row was learnt from: feature and pose are the same."""
        rings, ring = self.radiance.rings(frame)
        return self.radiance.learnt.holds(rings)[ring]

    @property
    def notes(self) -> tuple[str, ...]:
        """Say what weakens the model, and what would help."""
        return self.radiance.notes

    @property
    def n_observations(self) -> int:
        """Number of rows that the limits were learnt from."""
        return self.n_rows

    @property
    def features(self) -> tuple[str, ...]:
        """Names of the features that it has learnt from."""
        return self.radiance.features

    @property
    def training_range(self) -> dict[str, tuple[float, float]]:
        """Smallest and largest position and angle that were learnt from."""
        return self.radiance.training_range

    def remarks(self, frame: pl.DataFrame) -> tuple[str, ...]:
        """Say which rows are not of the finish that was learnt."""
        learnt = self.radiance
        return tuple(each.replace(learnt.name, self.name, 1) for each in learnt.remarks(frame))

    def with_observations(self, table: ObservationTable) -> WindowModel:
        """Learn from more captures, as a cell does after each; the limits stay."""
        radiance = self.radiance.with_observations(table)
        return replace(self, radiance=radiance, provenance=radiance.provenance)

    def hyperparameters(self) -> tuple[Hyperparameter, ...]:
        """Return the limits, widths and shifts of the window."""
        window = self.window
        if isinstance(window, ResponseCurve):
            scatter = Hyperparameter(
                name="scatter",
                quantity="parameter",
                inputs=(),
                value=window.scatter,
                unit=self.unit,
            )
            return (scatter,)
        low, high = window.limits
        items = (
            ("limit of modulation", low, "grey levels"),
            ("limit above black", high, "grey levels"),
            ("width of the dark edge", window.width_low, "ln"),
            ("width of the bright edge", window.width_high, "ln"),
            ("shift of the dark edge", window.shift_low, "ln"),
            ("shift of the bright edge", window.shift_high, "ln"),
            ("scatter", window.scatter, ""),
            ("best p_norm", float(window.best[0]), ""),
        )
        return tuple(
            Hyperparameter(name=name, quantity="parameter", inputs=(), value=value, unit=unit)
            for name, value, unit in items
        )

    def to_document(self) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
        """Return the limits, and the radiance model's document."""
        content, arrays = self.radiance.to_document()
        kept = vars(self.window)
        numbers = {name: value for name, value in kept.items() if isinstance(value, float | str)}
        further = {f"window_{n}": v for n, v in kept.items() if isinstance(v, np.ndarray)}
        radiance = {
            "name": self.radiance.name,
            "title": self.radiance.title,
            "inputs": list(self.radiance.inputs),
            **content,
        }
        return (
            {"radiance": radiance, "window": numbers, "n_rows": self.n_rows},
            {**arrays, **further},
        )

    @classmethod
    def from_document(
        cls, common: Mapping[str, Any], content: dict[str, Any], arrays: Mapping[str, NDArray[Any]]
    ) -> WindowModel:
        """Rebuild a model and the radiance model in it."""
        kept = validate(_Content, content, "model.json")
        inner = validate(_Radiance, {k: kept.radiance.pop(k, None) for k in _NAMED}, "model.json")
        of_radiance = {**common, "target": "exposure_ms", **vars(inner)}
        further: dict[str, Any] = {
            name.removeprefix("window_"): array
            for name, array in arrays.items()
            if name.startswith("window_")
        }
        kind = ResponseCurve if "better" in kept.window else Window
        window = kind(**kept.window, **further)  # type: ignore[arg-type]
        radiance = RadianceModel.from_document(of_radiance, kept.radiance, arrays)
        return cls(**common, radiance=radiance, window=window, n_rows=kept.n_rows)


_NAMED = ("name", "title", "inputs")


@dataclass(frozen=True, kw_only=True)
class _Radiance:
    name: str
    title: str
    inputs: tuple[str, ...]


@dataclass(frozen=True, kw_only=True)
class _Content:
    radiance: dict[str, Any]
    window: dict[str, float | str]
    n_rows: Annotated[int, Field(ge=1)]


_NOTHING_MEASURED = (np.zeros(0, dtype=np.int64), np.zeros(0), np.zeros(0))

_CURVED_STD = 1.5
"""Uncertainty of ln radiance where a feature's surface is not flat: the formula does not hold."""

_WELL_LIT = 60.0
"""Grey levels above black at which a ring neither clips nor is dark."""


@dataclass(frozen=True, kw_only=True, eq=False)
class WindowPrediction(Prediction):
    """What a window model predicts of rows, whose distribution is none by a formula.

    Parameters
    ----------
    mean, std, inside, low, high
        As in `Prediction`.
    model, frame
        What was asked of which model.
    """

    model: WindowModel
    frame: pl.DataFrame

    def quantiles(self, levels: Sequence[float]) -> FloatArray:
        """Return quantiles of new observations, (len(levels), n)."""
        return self.model.quantiles(self.frame, levels)

    def chance(self, need: float) -> FloatArray:
        """Return the chance that new observations are at least `need`, (n,)."""
        return self.model.chance(self.frame, need)
