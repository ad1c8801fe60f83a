"""What is believed of the views of a cell while it is measured: forecasts that captures correct."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Protocol, TypeAlias

import numpy as np
import polars as pl
from numpy.typing import NDArray

from exposight.models import RingForecast, WindowModel
from exposight.models.ring_data import DARK, FEW_CLIPPED, clipped_share
from exposight.observing import ObservationTable
from exposight.planning.capture_chances import CaptureChances
from exposight.planning.chain import ChainedQuality, chained_forecast
from exposight.planning.exposure_limits import ExposureLimits
from exposight.planning.sensor_models import SensorModels

FloatArray: TypeAlias = NDArray[np.float64]


class Belief(Protocol):
    """Forecasts of the views of a cell, which captures correct."""

    def chances(self, view: str, features: Sequence[str], count: int) -> CaptureChances:
        """Return the chances of some features of a view at up to `count` settings."""

    def windows(
        self, view: str, features: Sequence[str], draws: int, rng: np.random.Generator
    ) -> FloatArray | None:
        """Draw their windows jointly, (draws, n, 2), ms; None where windows are not known."""

    def took(self, rows: ObservationTable) -> str:
        """Learn from the measured rows of a capture; return what is odd about the cell."""


def belief_of(
    models: SensorModels,
    rings: pl.DataFrame,
    need: float,
    limits: ExposureLimits,
    carried: ObservationTable | None = None,
) -> Belief:
    """Return what models believe of rings (`exposight.planning.closed_loop.ClosedLoop`)."""
    if isinstance(models.quality, WindowModel):
        return RingBelief(models.quality, rings, need, limits, carried)
    return ChainBelief(models, rings, need, limits)


class RingBelief:
    """The default models' belief: one joint forecast of all rings, conditioned on all captures."""

    def __init__(
        self,
        model: WindowModel,
        rings: pl.DataFrame,
        need: float,
        limits: ExposureLimits,
        carried: ObservationTable | None = None,
    ) -> None:
        self._model, self._need, self._limits = model, need, limits
        self._rings, self._captured = rings, None
        if carried is not None and len(measured := carried.measured()):
            self._captured = measured
            keys = ["feature", "view"]
            more = measured.frame.unique(keys, keep="first", maintain_order=True)
            more = more.join(rings, on=keys, how="anti", maintain_order="left")
            shared = [name for name in rings.columns if name in more.columns]
            self._rings = pl.concat([rings, more.select(shared)], how="diagonal_relaxed")
        self._forecast = self._forecast_all()

    def _forecast_all(self) -> RingForecast:
        forecast = self._model.forecast(
            self._rings, (1.0,), trial=self._captured, need=self._need, correct=True
        )
        keys = self._rings.select("feature", "view").iter_rows()
        self._place = {key: i for i, key in enumerate(keys)}
        return forecast

    def _of(self, view: str, features: Sequence[str]) -> RingForecast:
        return self._forecast.take([self._place[name, view] for name in features])

    def chances(self, view: str, features: Sequence[str], count: int) -> CaptureChances:
        """Return the chances of some features of a view (`Belief`)."""
        forecast = self._of(view, features)
        return CaptureChances.within(
            forecast, self._limits, count=count, view=view, features=features
        )

    def windows(
        self, view: str, features: Sequence[str], draws: int, rng: np.random.Generator
    ) -> FloatArray | None:
        """Draw windows jointly (`Belief`)."""
        return self._of(view, features).draw_windows(draws, rng)

    def took(self, rows: ObservationTable) -> str:
        """Condition all rings on one more capture (`Belief`)."""
        known = np.array(
            [key in self._place for key in rows.frame.select("feature", "view").iter_rows()],
            dtype=np.bool_,
        )
        rows = rows.where(known)
        if len(rows) == 0:
            return ""
        self._captured = (
            rows if self._captured is None else ObservationTable.concat([self._captured, rows])
        )
        before = self._forecast.remarks
        self._forecast = self._forecast_all()
        new = [each for each in self._forecast.remarks if each not in before]
        return "; ".join(new)


class ChainBelief:
    """What two models one after the other believe; measured brightness shifts exposure times."""

    def __init__(
        self, models: SensorModels, rings: pl.DataFrame, need: float, limits: ExposureLimits
    ) -> None:
        self._models, self._rings, self._need, self._limits = models, rings, need, limits
        self._shift: dict[tuple[str, str], float] = {}
        """ln of how many times as bright as expected."""
        self._black = ChainedQuality.of(models.quality, models.exposure).black_level
        self._known: dict[str, CaptureChances] = {}
        self._brightness: dict[str, FloatArray] = {}

    def _of(self, view: str) -> CaptureChances:
        if view not in self._known:
            rings = self._rings.filter(pl.col("view") == view)
            settings = self._settings(_FINE)
            forecast = chained_forecast(
                self._models.quality, self._models.exposure, rings, settings.tolist(), self._need
            )
            self._known[view] = forecast.chances(view=view)
            self._brightness[view] = forecast.brightness
        return self._known[view]

    def _settings(self, count: int) -> FloatArray:
        low, high = self._models.exposure.target_range or (
            self._limits.min_ms,
            self._limits.max_ms,
        )
        settings = self._limits.settings(low, high, count)
        if not len(settings):
            settings = self._limits.settings(self._limits.min_ms, self._limits.max_ms, count)
        return settings

    def chances(self, view: str, features: Sequence[str], count: int) -> CaptureChances:
        """Return the chances of some features, at times shifted as was measured (`Belief`)."""
        known = self._of(view).take(features)
        settings = self._settings(count)
        cell = float(np.median([*self._shift.values()])) if self._shift else 0.0
        log_ms = np.log(settings)
        chance = np.stack(
            [
                np.interp(
                    log_ms + self._shift.get((name, view), cell),
                    np.log(known.settings_ms),
                    known.chance[i],
                )
                for i, name in enumerate(features)
            ]
        )
        return CaptureChances.by_themselves(
            chance,
            settings,
            features=features,
            need=self._need,
            view=view,
            reasons=known.reasons,
        )

    def windows(
        self, view: str, features: Sequence[str], draws: int, rng: np.random.Generator
    ) -> FloatArray | None:
        """Return None: these models know no windows (`Belief`)."""
        return None

    def took(self, rows: ObservationTable) -> str:
        """Shift features by their measured brightness (`Belief`)."""
        clipped = clipped_share(rows.frame)
        for place, row in enumerate(rows.frame.iter_rows(named=True)):
            name, view = row["feature"], row["view"]
            known = self._of(view)
            if name not in known.features:
                continue
            i = known.features.index(name)
            expected = float(
                np.interp(
                    math.log(row["exposure_ms"]),
                    np.log(known.settings_ms),
                    self._brightness[view][i],
                )
            )
            above = max(row["i_avg"] - self._black, DARK)
            shift = math.log(above / max(expected - self._black, DARK))
            if clipped[place] > FEW_CLIPPED:
                shift = max(shift, _HALF)
            self._shift[name, view] = shift
        return ""


_FINE = 61
_HALF = math.log(2.0)
"""What clips is taken as twice as bright as expected, at least."""
