"""A sensor's two models: how good a point cloud will be, and which exposure time that takes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TypeVar

import numpy as np
import polars as pl

from exposight.cell import GREY_MAX, ActiveSensor
from exposight.errors import InputError, SensorError
from exposight.files import make_folder
from exposight.models import (
    EXPOSURE,
    MODEL_SUFFIX,
    P_NORM_MIN,
    QUALITY,
    ModelSpecification,
    Predictor,
    RadianceModel,
    RingForecast,
    WindowModel,
    evaluate,
    load_model,
    model_sha256,
    save_model,
)
from exposight.observing import ObservationTable, View, Visibility
from exposight.planning.capture_chances import CaptureChances
from exposight.planning.chain import ChainedQuality, chained_forecast
from exposight.planning.exposure_limits import CaptureCosts, ExposureLimits, limits_from
from exposight.planning.forecasts import Forecast, check_forecast
from exposight.planning.model_scores import ModelScores
from exposight.planning.path_search import Prefer
from exposight.planning.recommendation import (
    CONFIDENCE,
    Recommendation,
    check_confidence,
    recommend,
)
from exposight.quantities import quantity
from exposight.tables import Column, Table, counted

DEFAULT_MODELS = (QUALITY, EXPOSURE)
"""What `train` and ``exposight train`` train, and reports forecast with where they are at hand."""

_EXPOSURES = 61
"""Exposure times of a forecast, unless they are given."""

_DARK, _BEYOND_FULL = 4.0, 2.0
"""They reach from so many grey levels above black to so many times full scale."""


@dataclass(frozen=True, kw_only=True, eq=False)
class SensorModels:
    """A quality model and an exposure-time model of one sensor.

    Parameters
    ----------
    quality : Predictor
        Predicts `target`.
    exposure : Predictor, optional
        Predicts the exposure time in ms that yields a wanted brightness; a `WindowModel` brings
        its own.
    target : str
        What the quality model predicts: p_norm, or a column that `train_response` has learnt.

    Raises
    ------
    InputError
        If one of them predicts something else, is missing, or is not the quality model's own.
    """

    quality: Predictor
    exposure: Predictor = None  # type: ignore[assignment]  # `__post_init__` replaces it
    target: str = "p_norm"

    def __post_init__(self) -> None:
        if isinstance(self.quality, WindowModel):
            radiance = self.quality.radiance
            given: Predictor = self.exposure or radiance
            if not isinstance(given, RadianceModel) or given.provenance != radiance.provenance:
                msg = (
                    f"{self.quality.name} was trained together with its exposure-time model and "
                    f"forecasts with that one; got {given.name} beside it, trained on "
                    f"{given.provenance.observations}: leave it out"
                )
                raise InputError(msg)
            object.__setattr__(self, "exposure", radiance)
        for model, target in ((self.quality, self.target), (self.exposure, "exposure_ms")):
            if model is None or model.target != target:
                got = "none" if model is None else f"{model.name} ({model.target})"
                msg = f"expected a model that predicts {target}, got {got}"
                raise InputError(msg)

    @property
    def sensor(self) -> ActiveSensor | None:
        """The sensor that they were trained on, where they know it."""
        return self.exposure.sensor or self.quality.sensor

    @property
    def checksums(self) -> dict[str, str]:
        """SHA-256 of each model's file, as `save` writes it, by the model's name."""
        return {model.name: model_sha256(model) for model in (self.quality, self.exposure)}

    def evaluate(self, table: ObservationTable) -> ModelScores:
        """Evaluate both models on held-out observations.

        Where the quality model reads the measured brightness, so is what both together say before
        there is one (`ChainedQuality`).

        Raises
        ------
        ObservationError
            If a model finds no row that it can be evaluated on.
        """
        models = [self.quality, self.exposure]
        if not isinstance(self.quality, WindowModel):
            models.append(ChainedQuality.of(self.quality, self.exposure))
        return ModelScores(evaluations=tuple(evaluate(model, table) for model in models))

    def forecast(
        self,
        view: View,
        exposures_ms: Sequence[float] | None = None,
        *,
        trial: ObservationTable | None = None,
        need: float = P_NORM_MIN,
        correct: bool = False,
    ) -> Forecast:
        """Predict the quality of the features that a view sees, over exposure time.

        Parameters
        ----------
        view : View
            `Campaign.view` returns what a pose sees.
        exposures_ms : sequence of float, optional, ms
            Exposure times to look at; settings of the sensor from too short to too long for all
            features by default, and for the paper's models over the range that was trained on.
        trial : ObservationTable, optional
            What one image or capture of this view shows, at any exposure time; it refines the
            default models' forecast. A view without a name takes that of the trial.
        need : float
            Quality that is asked for.
        correct : bool
            Consider that the cell may not be as it was learnt: another finish makes the default
            models' forecast unsure, and a trial corrects also what it does not show.

        Raises
        ------
        InputError
            If no feature is visible, an exposure time is not above 0, the trial is of another pose,
            or the models cannot use one.
        SensorError
            If the sensor cannot take an exposure time.
        ObservationError
            If the view is of another sensor or TCP than was learnt, or the trial has no row of it.
        """
        if isinstance(self.quality, WindowModel):
            rings = self._rings(self.quality, view, exposures_ms, trial, need, correct)
            return Forecast.of(rings, view.poses["feature"].to_list(), self.limits, self.target)
        poses, exposures_ms = view.poses, self._checked(view, exposures_ms)
        if trial is not None:
            msg = (
                f"{self.quality.name} and {self.exposure.name} cannot learn from a trial capture; "
                f"the default models, {' and '.join(DEFAULT_MODELS)}, can"
            )
            raise InputError(msg)
        shown_by = view.shared.get("sensor")
        if self.sensor is not None and shown_by not in {None, self.sensor.name}:
            msg = (
                f"the view is of sensor {shown_by!r}, the models were trained on "
                f"{self.sensor.name!r}; train models for that sensor"
            )
            raise SensorError(msg)
        times_ms = self._usual_exposures_ms() if exposures_ms is None else exposures_ms
        return chained_forecast(self.quality, self.exposure, poses, times_ms, need)

    def _checked(
        self, view: View, exposures_ms: Sequence[float] | None
    ) -> tuple[float, ...] | None:
        """Return the exposure times to look at, each once, that the sensor can take."""
        check_forecast(view.poses, exposures_ms)
        if exposures_ms is None:
            return None
        times_ms = tuple(dict.fromkeys(map(float, exposures_ms)))
        return times_ms if self.sensor is None else tuple(map(self.sensor.check_exposure, times_ms))

    def _rings(
        self,
        quality: WindowModel,
        view: View,
        exposures_ms: Sequence[float] | None,
        trial: ObservationTable | None,
        need: float,
        correct: bool,
    ) -> RingForecast:
        """Return what the default models say of a view's rings (`forecast`)."""
        poses, checked_ms = view.poses, self._checked(view, exposures_ms)
        if trial is not None and not view.name:
            poses = poses.with_columns(pl.lit(_only_view(trial)).alias("view"))
        times_ms = checked_ms or (1.0,)  # until rings are known
        rings = quality.forecast(poses, times_ms, trial=trial, need=need, correct=correct)
        return rings if checked_ms is not None else rings.at(self._times_of(rings))

    @cached_property
    def limits(self) -> ExposureLimits | None:
        """What the sensor that they were trained on can be set to."""
        return None if self.sensor is None else ExposureLimits.of(self.sensor)

    def recommend(
        self,
        view: View,
        limits: ExposureLimits | str | None = None,
        costs: CaptureCosts | None = None,
        *,
        need: float | None = None,
        confidence: float = CONFIDENCE,
        prefer: Prefer = "margin",
        trial: ObservationTable | None = None,
    ) -> Recommendation:
        """Recommend the fewest exposures of a view, and say which features will fail and why.

        Parameters
        ----------
        view, trial
            As for `forecast`.
        need : float, optional
            Quality that is asked for: at least, or at most where lower is better. By default
            `P_NORM_MIN`, and of other targets the strictest that is attained as surely as any
            (`Forecast.attainable`).
        limits : ExposureLimits or str, optional
            What the sensor can be set to, or a profile's name; as the models know it by default.
        costs, confidence, prefer
            As for `Forecast.recommend`.

        Raises
        ------
        ExposightError
            As for `forecast` and `Forecast.recommend`.
        """
        limits = limits_from(limits) or self.limits
        check_confidence(confidence)
        if need is None and self.target == "p_norm":
            need = P_NORM_MIN
        elif need is None:
            need = self.forecast(view, trial=trial, need=0.0, correct=True).attainable(confidence)
        hidden = {
            each.feature.name: each.visibility.value
            for each in view.features
            if each.visibility is not Visibility.VISIBLE
        }
        if limits is not None and isinstance(self.quality, WindowModel):
            first = (min(max(1.0, limits.min_ms), limits.max_ms),)  # windows say which are of use
            rings = self._rings(self.quality, view, first, trial, need, correct=True)
            features = view.poses["feature"].to_list()
            return recommend(
                CaptureChances.within(rings, limits, view=view.name, features=features),
                limits,
                costs,
                confidence=confidence,
                prefer=prefer,
                hidden=hidden,
                remarks=rings.remarks,
                target=self.target,
                at_most=rings.window.sign < 0.0,
            )
        times: Sequence[float] | None = None
        if limits is not None:
            usual = self._usual_exposures_ms()
            times = limits.settings(min(usual), max(usual), _EXPOSURES).tolist()
            if not times:
                msg = f"limits leave nothing: {limits.why_none(min(usual), max(usual))}"
                raise InputError(msg)
        forecast = self.forecast(view, times, trial=trial, need=need, correct=True)
        return forecast.recommend(
            limits, costs, confidence=confidence, prefer=prefer, view=view.name, hidden=hidden
        )

    def _times_of(self, rings: RingForecast) -> tuple[float, ...]:
        """Return settings from where the brightest feature is dark to where the darkest clips."""
        low, high = (
            rings.exposure_ms(grey, (0.5,))
            for grey in (rings.black_level + _DARK, _BEYOND_FULL * GREY_MAX)
        )
        return self._settings(float(low.min()), float(high.max()))

    def _usual_exposures_ms(self) -> tuple[float, ...]:
        limits = self.exposure.target_range
        if limits is None:
            msg = f"{self.exposure.name} does not know its training range: give exposures_ms"
            raise InputError(msg)
        return self._settings(*limits)

    def _settings(self, low_ms: float, high_ms: float) -> tuple[float, ...]:
        """Return exposure times between two in even steps of their logarithm."""
        if self.sensor is None:
            return tuple(np.geomspace(low_ms, high_ms, _EXPOSURES).tolist())
        possible = self.sensor.exposure
        low, high = np.clip((low_ms, high_ms), possible.min_ms, possible.max_ms)
        times_ms = np.clip(np.geomspace(low, high, _EXPOSURES), low, high).tolist()
        return tuple(dict.fromkeys(map(self.sensor.nearest_exposure, times_ms)))

    def with_observations(self, table: ObservationTable) -> SensorModels:
        """Learn from more observations, as after a capture, without a new fit.

        The hyperparameters stay; where the new observations lie far from the old ones, train anew.

        Raises
        ------
        InputError
            If a model is of a kind that cannot, such as a committee.
        NotPositiveDefiniteError
            If the observations leave a covariance matrix without a Cholesky factor.
        """
        quality = self.quality.with_observations(table)
        if isinstance(quality, WindowModel):
            return SensorModels(quality=quality, target=self.target)
        return SensorModels(quality=quality, exposure=self.exposure.with_observations(table))

    def save(self, folder: str | Path) -> tuple[Path, Path]:
        """Write both models into a folder, made if it is not there, and return their files.

        Raises
        ------
        FileError
            If they cannot be written.
        """
        folder = make_folder(Path(folder), "the models")
        quality, exposure = (
            folder / f"{model.name}{MODEL_SUFFIX}" for model in (self.quality, self.exposure)
        )
        save_model(quality, self.quality)
        save_model(exposure, self.exposure)
        return quality, exposure

    @classmethod
    def load(cls, *paths: str | Path, target: str = "p_norm") -> SensorModels:
        """Read two model files, that of a window model alone, or the folder that holds them.

        In a folder the default quality model of the target goes before others.

        Parameters
        ----------
        *paths : str or Path
            Files or folders.
        target : str
            What the quality model shall predict.

        Raises
        ------
        InputError
            If they are not one for quality and one for exposure time.
        FileError
            If a file cannot be read.
        """
        files: list[Path] = []
        for path in map(Path, paths):
            name = QUALITY if target == "p_norm" else f"{QUALITY}_{target}"
            default = path / f"{name}{MODEL_SUFFIX}"
            of_folder = [default] if default.is_file() else sorted(path.glob(f"*{MODEL_SUFFIX}"))
            files += of_folder if path.is_dir() else [path]
        models = [load_model(file) for file in files]
        if len(models) == 1 and isinstance(models[0], WindowModel):
            return cls(quality=models[0], target=target)
        quality, exposure = one_of_each(models)
        return cls(quality=quality, exposure=exposure, target=target)

    @property
    def table(self) -> Table:
        """What the two models read and predict, and how much they learnt from."""
        rows = [
            {
                "model": model.name,
                "predicts": quantity(model.target).name,
                "from": model.inputs,
                "rows": model.n_observations,
            }
            for model in (self.quality, self.exposure)
        ]
        columns = tuple(Column(name=name) for name in ("model", "predicts", "from", "rows"))
        return Table.of("models", rows, columns)

    def __str__(self) -> str:
        return str(self.table)

    def _repr_html_(self) -> str:
        return self.table._repr_html_()


def _only_view(trial: ObservationTable) -> str:
    names = trial.frame["view"].unique().sort().to_list()
    if len(names) != 1:
        msg = (
            f"the trial is of {counted(len(names), 'view')} ({', '.join(names)}), and the view to "
            "forecast has no name; name it, or give rows of one view"
        )
        raise InputError(msg)
    return str(names[0])


_Model = TypeVar("_Model", "Predictor", "ModelSpecification")


def one_of_each(models: Sequence[_Model]) -> tuple[_Model, _Model]:
    """Return the quality model and the exposure-time model of two."""
    by_target = {each.target: each for each in models}
    if len(models) != 2 or set(by_target) != {"p_norm", "exposure_ms"}:
        got = ", ".join(f"{each.name} ({each.target})" for each in models) or "none"
        msg = (
            "expected one model that predicts p_norm and one that predicts exposure_ms, got "
            f"{got}; give the two that are wanted"
        )
        raise InputError(msg)
    return by_target["p_norm"], by_target["exposure_ms"]
