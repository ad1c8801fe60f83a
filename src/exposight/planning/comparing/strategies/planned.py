"""Exposures from forecasts: recommended before anything is taken, or one after the other."""

from __future__ import annotations

from collections import deque

from exposight.models import WindowModel
from exposight.observing import ObservationTable
from exposight.planning.chain import chained_forecast
from exposight.planning.closed_loop import ClosedLoop
from exposight.planning.comparing.strategies.contract import Method, Setup, Trial, register
from exposight.planning.exposure_limits import ExposureLimits
from exposight.planning.forecasts import Forecast
from exposight.planning.recommendation import recommend
from exposight.planning.sensor_models import SensorModels

_CARRIED = 6
"""Views whose captures correct the next one's forecast; more tell nothing new of the cell."""


def forecast_of(models: SensorModels, trial: Trial) -> Forecast:
    """Return what models expect of a view's features at all its settings, from their poses."""
    times_ms = trial.settings_ms.tolist()
    if isinstance(models.quality, WindowModel):
        rings = models.quality.forecast(trial.poses, times_ms, need=trial.need, correct=True)
        return Forecast.of(rings, trial.features)
    return chained_forecast(models.quality, models.exposure, trial.poses, times_ms, trial.need)


def limits_of(trial: Trial) -> ExposureLimits:
    """Return limits that allow the view's settings and no others."""
    settings = trial.settings_ms.tolist()
    return ExposureLimits(
        name="sweep",
        min_ms=settings[0],
        max_ms=settings[-1],
        increment_ms=settings[0],
        allowed_ms=tuple(settings),
        most_per_view=None if trial.limits is None else trial.limits.most_per_view,
    )


def _open_loop(setup: Setup) -> Method:
    models = setup.required_models

    def measure(trial: Trial) -> None:
        chances = forecast_of(models, trial).chances(view=trial.view)
        recommended = recommend(
            chances, limits_of(trial), setup.costs.capture, confidence=setup.confidence
        )
        for exposure_ms in recommended.exposures_ms:
            trial.take(exposure_ms)
        trial.promise({each.feature: each.chance for each in recommended.features})
        trial.say_chances(chances.chance)

    return measure


def _closed_loop(setup: Setup) -> Method:
    models = setup.required_models
    before: deque[ObservationTable] = deque(maxlen=_CARRIED)

    def measure(trial: Trial) -> None:
        captured = []
        loop = ClosedLoop(
            models,
            trial.poses,
            limits_of(trial),
            need=trial.need,
            carried=ObservationTable.concat(list(before)) if before else None,
        )
        while (request := loop.next()) is not None:
            rows = trial.take(request.exposure_ms)
            captured.append(rows)
            loop.took(rows)
        if captured:
            before.append(ObservationTable.concat(captured))

    return measure


register(
    "open_loop",
    "a forecast; the exposures that it recommends, all of them",
    _open_loop,
    kind="model",
)
register(
    "closed_loop",
    "a forecast; each capture corrects it for this view and the views after it",
    _closed_loop,
    kind="model",
)
