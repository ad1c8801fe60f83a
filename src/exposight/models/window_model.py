"""The default quality model: p_norm over exposure time from a ring's pose; and its training."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar, TypeAlias

import numpy as np
import polars as pl
from numpy.typing import NDArray

from exposight.cell import PRESETS, ActiveSensor
from exposight.errors import InputError, ObservationError
from exposight.models.evaluation import check_exposures, check_rows
from exposight.models.log_radiance import LogRadiance
from exposight.models.prediction import Prediction
from exposight.models.predictor import (
    Hyperparameter,
    Predictor,
    Provenance,
    input_array,
    register_predictor,
)
from exposight.models.radiance_model import (
    CHUNK,
    EXPOSURE,
    P_NORM_NEED,
    QUALITY,
    Origin,
    RadianceModel,
    far_away,
)
from exposight.models.radiance_search import MeanKind
from exposight.models.response_curve import Better, ResponseCurve, rows_of_quality
from exposight.models.ring_data import ring_data
from exposight.models.ring_forecast import RingForecast
from exposight.models.ring_light import POSE_COLUMNS, Rings, check_places
from exposight.models.trial import with_trial
from exposight.models.window import Window
from exposight.models.window_fit import fit_window
from exposight.observing import ObservationTable
from exposight.tables import counted

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
        mean, low, high, known = self._by_row(
            frame,
            lambda forecast: (
                forecast.p_norm,
                forecast.low,
                forecast.high,
                np.broadcast_to(forecast.knows[:, None], forecast.p_norm.shape),
            ),
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

    def chance(
        self, data: ObservationTable | pl.DataFrame, need: float = P_NORM_NEED
    ) -> FloatArray:
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
            reasons += self._forecast(some, np.ones(1), P_NORM_NEED, frame).unknown
        return tuple(reasons[place] for place in ring)

    def _by_row(self, frame: pl.DataFrame, read: Any) -> list[FloatArray]:
        rings, ring = self.radiance.rings(frame)
        exposure_ms = input_array(self.name, frame.select("exposure_ms"))[:, 0]
        out: list[FloatArray] = []
        for start in range(0, len(rings), CHUNK):
            some = range(start, min(start + CHUNK, len(rings)))
            rows = np.flatnonzero((ring >= start) & (ring < start + CHUNK))
            times, place = np.unique(exposure_ms[rows], return_inverse=True)
            forecast = self._forecast(rings.take(some), times, P_NORM_NEED, frame)
            for i, values in enumerate(read(forecast)):
                if start == 0:
                    out.append(np.empty(len(exposure_ms)))
                out[i][rows] = values[ring[rows] - start, place]
        return out

    def forecast(
        self,
        rings: pl.DataFrame,
        exposures_ms: Sequence[float] | FloatArray,
        *,
        trial: ObservationTable | None = None,
        need: float | None = None,
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
            Quality that is asked for; of p_norm `P_NORM_NEED` by default.

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
        need = P_NORM_NEED if need is None else need
        unique, _ = self.radiance.rings(rings)
        if len(unique) != rings.height:
            msg = f"the same ring twice among {rings.height}; give each feature and view once"
            raise InputError(msg)
        forecast = self._forecast(unique, times, need, rings)
        if trial is None:
            return forecast
        contradictions = self.radiance.origin.contradictions(trial.measured().frame)
        for name in ("sensor", "tcp"):
            if name in contradictions:
                msg = f"{self.name}: the trial is of {contradictions[name]}"
                raise ObservationError(msg)
        forecast = replace(forecast, features=tuple(rings["feature"]), views=tuple(rings["view"]))
        return with_trial(
            forecast, unique.positions, trial, other_surface=contradictions.get("finish", "")
        )

    def _forecast(
        self, rings: Rings, times: FloatArray, need: float, frame: pl.DataFrame
    ) -> RingForecast:
        learnt = self.radiance.learnt
        prediction = learnt.predict(rings)
        points = self.window.points(learnt, rings, prediction.light)
        finish = self.radiance.origin.contradictions(frame).get("finish", "")
        dark = points.weight.sum(axis=1) < 0.5
        # where a capture would show the ring well, as far as is known
        telling_ms = _WELL_LIT * np.exp(-prediction.mean)
        unknown = tuple(
            finish
            or ("outside the light of the projector, or out of a camera's frame" if unlit else "")
            or far_away(far, time)
            for far, unlit, time in zip(
                prediction.distance.tolist(), dark.tolist(), telling_ms.tolist(), strict=True
            )
        )
        return RingForecast(
            features=rings.features,
            views=rings.views,
            exposures_ms=times,
            mean=prediction.mean,
            covariance=prediction.covariance,
            points=points,
            window=self.window,
            black_level=self.radiance.black_level,
            need=need,
            distance=prediction.distance,
            source=("pose",) * len(rings),
            unknown=unknown,
        )

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
        return self.radiance.remarks(frame)

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
        inner = dict(content["radiance"])
        of_radiance = {
            **common,
            "target": "exposure_ms",
            "name": inner.pop("name"),
            "title": inner.pop("title"),
            "inputs": tuple(inner.pop("inputs")),
        }
        further: dict[str, Any] = {
            name.removeprefix("window_"): array
            for name, array in arrays.items()
            if name.startswith("window_")
        }
        kind = ResponseCurve if "better" in content["window"] else Window
        window = kind(**content["window"], **further)
        radiance = RadianceModel.from_document(of_radiance, inner, arrays)
        return cls(**common, radiance=radiance, window=window, n_rows=content["n_rows"])


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


_LEAST_RINGS = 3
"""Fewer rings leave nothing to learn a band from."""


def train_window(
    table: ObservationTable,
    *,
    sensor: ActiveSensor | None = None,
    mean: MeanKind | None = None,
    start_from: WindowModel | None = None,
    source: str = "a table in memory",
    source_sha256: str | None = None,
    seed: int | None = None,
) -> WindowModel:
    """Train the radiance model and the window model on observations.

    Parameters
    ----------
    table : ObservationTable
        Rows that were not measured are left out.
    sensor : ActiveSensor, optional
        The sensor of the observations. Left out, it is that of `start_from`, or the preset that the
        table names.
    mean : {'projector', 'camera', 'none'}, optional
        What the physical mean knows; as much as the sensor allows by default.
    start_from : WindowModel, optional
        A model of the same sensor on another finish: the sensor's limits are kept and the surface
        is learnt anew. Or of the same finish on another sensor: the surface's lobe is kept, and the
        limits are learnt anew. Its hyperparameters are where the search starts.
    source, source_sha256, seed
        Of the table; kept in the model's provenance.

    Raises
    ------
    ObservationError
        If rows are of several finishes or sensors, nothing was measured, or too little of it.
    SensorError
        If the sensor cannot have taken a recorded exposure time.
    """
    measured = table.measured()
    check_rows(QUALITY, "train", measured, table)
    origin = Origin.of(measured)
    if sensor is None and start_from is not None:
        sensor = start_from.sensor
    if sensor is None:
        sensor = next((each for each in PRESETS.values() if each.name == origin.sensor), None)
    if sensor is not None and origin.sensor and origin.sensor != sensor.name:
        msg = f"the observations are of sensor {origin.sensor!r}, the one given is {sensor.name!r}"
        raise ObservationError(msg)
    check_exposures(measured, sensor)
    if mean is None:
        mean = "none" if sensor is None else "projector" if sensor.projector else "camera"
    if (sensor is None and mean != "none") or (
        sensor is not None and sensor.projector is None and mean == "projector"
    ):
        lacking = "a sensor" if sensor is None else f"a projector's pose of {sensor.name!r}"
        msg = f"mean {mean!r} needs {lacking}, which is not known; give it, or another mean"
        raise InputError(msg)
    previous = start_from.radiance if start_from is not None else None
    same_sensor = start_from is not None and start_from.sensor == sensor
    kept = previous if same_sensor else None
    data = ring_data(measured, black_level=kept.black_level if kept else None)
    if len(data) < _LEAST_RINGS:
        msg = (
            f"{counted(len(data), 'ring')} (of a feature in a view) is too little to learn from; "
            f"at least {_LEAST_RINGS} are needed, and ten from several views for useful bands"
        )
        raise ObservationError(msg)
    check_places(data.rings, data.incidence_deg, sensor)
    learnt = LogRadiance.fit(
        data,
        sensor,
        kind=mean,
        start_from=previous.learnt if previous else None,
        same_surface=previous is not None
        and not same_sensor
        and previous.origin.finish == origin.finish,
    )
    provenance = Provenance.of(measured, source=source, sha256=source_sha256, seed=seed)
    radiance = RadianceModel(
        name=EXPOSURE,
        title="exposure time, radiance",
        target="exposure_ms",
        inputs=(data.source, *POSE_COLUMNS),
        provenance=provenance,
        sensor=sensor,
        learnt=learnt,
        black_level=data.black_level,
        black_level_known=data.black_level_known,
        origin=origin,
    )
    known = start_from.window if start_from and same_sensor else None
    if isinstance(known, ResponseCurve):
        msg = f"{QUALITY} starts from a model of p_norm, which knows the sensor's limits"
        raise InputError(msg)
    window = fit_window(learnt, data, measured.frame, start_from=known)
    return WindowModel(
        name=QUALITY,
        title="quality, window",
        target="p_norm",
        inputs=(*POSE_COLUMNS, "exposure_ms"),
        provenance=provenance,
        sensor=sensor,
        radiance=radiance,
        window=window,
        n_rows=len(measured),
    )


def train_response(
    table: ObservationTable, target: str, *, model: WindowModel, better: Better
) -> WindowModel:
    """Learn how another quality of rings depends on their brightness.

    Parameters
    ----------
    table : ObservationTable
        Rows that have a value in column `target`; those that clip or stay dark included.
    target : str
        A numeric column: noise, form or diameter error, or anything else.
    model : WindowModel
        Of the same sensor and finish; its radiance model says how bright rings are.
    better : {'higher', 'lower'}
        Which quality is better.

    Returns
    -------
    WindowModel
        Predicts `target`, with the same forecasts as for p_norm.

    Raises
    ------
    ObservationError
        If there is no such column, or it has too few values.
    """
    radiance = model.radiance
    frame = rows_of_quality(table.measured().frame, target)
    rings, ring = radiance.rings(frame)
    log_radiance, _, _ = radiance.radiance(rings)
    exposure_ms = frame["exposure_ms"].to_numpy()
    curve = ResponseCurve.fit(
        log_radiance[ring] + np.log(exposure_ms),
        frame[target].cast(pl.Float64).to_numpy(),
        better,
    )
    return replace(
        model,
        name=f"{QUALITY}_{target}",
        title=f"{target}, curve over brightness",
        target=target,
        window=curve,
        n_rows=frame.height,
    )
