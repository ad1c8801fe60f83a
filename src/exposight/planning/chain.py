"""The paper's two models one after the other: quality from pose and exposure time alone.

The exposure-time model tells at which exposure time a feature reaches a wanted brightness; a camera
is linear until it clips (EMVA 1288), so the brightness above the black level is in proportion to
the time, and the quality model tells what to expect of it. The paper's models know no black level;
it follows from what the exposure-time model was trained on. That model's uncertainty is carried on:
the quality is averaged over the brightness that it may lead to (Gauss–Hermite quadrature).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np
import polars as pl
from numpy.typing import NDArray

from exposight.cell import GREY_MAX
from exposight.models import (
    GaussianProcessModel,
    Prediction,
    Predictor,
    RadianceModel,
    black_level_of,
)
from exposight.planning.forecasts import BAND, WANTED_BRIGHTNESS, FloatArray, Forecast
from exposight.quantities import QUANTITIES

_BRIGHTNESS = ("i_avg", "i_mean")
_PLACE = ("x_mm", "y_mm", "z_mm")
_NODES, _WEIGHTS = np.polynomial.hermite_e.hermegauss(15)
_WEIGHTS = _WEIGHTS / _WEIGHTS.sum()
_MIDDLE = len(_NODES) // 2


@dataclass(frozen=True, kw_only=True, eq=False)
class ChainedQuality(Predictor):
    """Predicts p_norm from pose and exposure time by two models; make it with `of`.

    It is not kept in a file: its two models are.

    Parameters
    ----------
    name, title, target, inputs, provenance, sensor
        As in `Predictor`.
    quality, exposure : Predictor
        The two models.
    """

    optional_inputs: ClassVar[tuple[str, ...]] = RadianceModel.optional_inputs

    quality: Predictor
    exposure: Predictor

    @classmethod
    def of(cls, quality: Predictor, exposure: Predictor) -> ChainedQuality:
        """Chain a model that predicts p_norm to one that predicts the exposure time in ms."""
        read = (*exposure.inputs, *quality.inputs)
        poses = dict.fromkeys(name for name in read if name not in _BRIGHTNESS)
        return cls(
            name=f"{quality.name}+{exposure.name}",
            title=f"quality by pose, {quality.name} after {exposure.name}",
            target="p_norm",
            inputs=tuple(dict.fromkeys((*poses, "exposure_ms"))),
            provenance=quality.provenance,
            sensor=exposure.sensor or quality.sensor,
            quality=quality,
            exposure=exposure,
        )

    @cached_property
    def black_level(self) -> float:
        """Brightness without light, grey levels; 0 where the exposure-time model cannot tell it."""
        model = self.exposure
        if isinstance(model, RadianceModel):
            return model.black_level
        if not isinstance(model, GaussianProcessModel) or not {"i_avg", *_PLACE} <= {*model.inputs}:
            return 0.0
        data = model.training_data
        poses = np.stack([data[name] for name in model.inputs if name != "i_avg"], axis=1)
        _, ring = np.unique(poses, axis=0, return_inverse=True)
        return black_level_of(ring.ravel(), data["i_avg"], data["exposure_ms"]) or 0.0

    def predict_frame(self, frame: pl.DataFrame) -> Prediction:
        """Predict for a frame with `inputs`."""
        return self._predict(frame)[0]

    def unknown(self, data: pl.DataFrame) -> tuple[str, ...]:  # type: ignore[override]
        """Say for each row why its prediction should not be relied on; empty where it may be."""
        at_wanted = _with_brightness(data, np.full(data.height, WANTED_BRIGHTNESS))
        reasons = (model.unknown(at_wanted) for model in (self.exposure, self.quality))
        return tuple(first or second for first, second in zip(*reasons, strict=True))

    def _predict(self, frame: pl.DataFrame) -> tuple[Prediction, FloatArray]:
        """Return the prediction, and the brightness to expect, (n,)."""
        times_ms = frame["exposure_ms"].cast(pl.Float64).to_numpy()
        wanted = self.exposure.predict(
            _with_brightness(frame, np.full(frame.height, WANTED_BRIGHTNESS))
        )
        # the normal distribution knows no least time
        nodes_ms = np.maximum(
            wanted.mean[:, None] + wanted.std[:, None] * _NODES, times_ms[:, None] / _LONGEST
        )
        black = self.black_level
        above = (WANTED_BRIGHTNESS - black) * times_ms[:, None] / nodes_ms
        brightness = np.minimum(black + above, GREY_MAX)
        repeated = frame[np.repeat(np.arange(frame.height), len(_NODES))]
        predicted = self.quality.predict(_with_brightness(repeated, brightness.ravel()))
        mean, std = (values.reshape(brightness.shape) for values in (predicted.mean, predicted.std))
        p_norm = mean @ _WEIGHTS
        variance = (std**2 + mean**2) @ _WEIGHTS - p_norm**2
        inside = predicted.inside.reshape(brightness.shape)[:, _MIDDLE] & wanted.inside
        prediction = Prediction(mean=p_norm, std=np.sqrt(np.maximum(variance, 0.0)), inside=inside)
        return prediction, brightness @ _WEIGHTS


_LONGEST = 1e3
"""Shares of an exposure time that are no likely time for a wanted brightness any more."""


def _with_brightness(frame: pl.DataFrame, grey: NDArray[np.float64]) -> pl.DataFrame:
    return frame.with_columns(pl.Series(name, grey) for name in _BRIGHTNESS)


def with_chains(models: Sequence[Predictor]) -> list[Predictor]:
    """Add to models what each one that reads brightness says after the exposure-time model.

    Nothing is added where there is not one exposure-time model of its kind; the default models need
    no such chain.
    """
    exposure = [
        each
        for each in models
        if each.target == "exposure_ms" and not isinstance(each, RadianceModel)
    ]
    if len(exposure) != 1:
        return list(models)
    return [
        *models,
        *(
            ChainedQuality.of(each, exposure[0])
            for each in models
            if each.target == "p_norm" and {*_BRIGHTNESS} & {*each.inputs}
        ),
    ]


def chained_forecast(
    quality: Predictor,
    exposure: Predictor,
    poses: pl.DataFrame,
    exposures_ms: Sequence[float],
    need: float,
) -> Forecast:
    """Forecast features over exposure time by two models (`ChainedQuality`).

    Parameters
    ----------
    quality : Predictor
        Predicts p_norm, from brightness or pose or both.
    exposure : Predictor
        Predicts the exposure time in ms, from brightness and perhaps pose.
    poses : polars.DataFrame
        A row for each of n features (`exposight.observing.View.frame`).
    exposures_ms : sequence of float, ms
        Exposure times to look at.
    need : float
        Quality that is asked for; its chance is that of a normal distribution.

    Raises
    ------
    ObservationError
        If a model reads what is only known of captures.
    """
    n, times_ms = poses.height, np.asarray(exposures_ms, dtype=np.float64)
    shape = n, len(times_ms)
    rows = poses[np.repeat(np.arange(n), len(times_ms))]
    chain = ChainedQuality.of(quality, exposure)
    prediction, brightness = chain._predict(
        rows.with_columns(pl.Series("exposure_ms", np.tile(times_ms, n)))
    )
    wanted = exposure.predict(_with_brightness(poses, np.full(n, WANTED_BRIGHTNESS)))
    scale = QUANTITIES["p_norm"]
    low, high = np.clip([prediction.low, prediction.high], scale.low, scale.high)
    return Forecast(
        features=tuple(poses["feature"].to_list()),
        exposures_ms=tuple(times_ms.tolist()),
        wanted_ms=np.maximum(wanted.quantiles(BAND).T, 0.0),
        brightness=brightness.reshape(shape),
        p_norm=prediction.mean.reshape(shape),
        p_norm_low=low.reshape(shape),
        p_norm_high=high.reshape(shape),
        chance=prediction.chance(need).reshape(shape),
        need=need,
        unknown=chain.unknown(poses.with_columns(exposure_ms=pl.Series(wanted.mean))),
        source=("pose",) * n,
    )
