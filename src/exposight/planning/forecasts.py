"""What to expect of a view before anything is taken there, whichever models say it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TypeAlias

import numpy as np
import polars as pl
from numpy.typing import NDArray

from exposight.cell import GREY_MAX
from exposight.errors import InputError
from exposight.files import csv_of, write_durably
from exposight.models import RingForecast, best_exposure
from exposight.planning.capture_chances import SETTINGS, CaptureChances
from exposight.planning.exposure_limits import CaptureCosts, ExposureLimits, limits_from
from exposight.planning.path_search import Prefer
from exposight.planning.recommendation import (
    CONFIDENCE,
    Recommendation,
    check_confidence,
    recommend,
)
from exposight.tables import Column, Table, counted, number

WANTED_BRIGHTNESS = 80.0
"""Grey level, on the plateau of the paper's Fig. 10, which reaches from about 30 to about 120."""

LIKELY = 0.9
"""Chance from which a feature counts as one that reaches the quality that is needed."""

BAND = (0.023, 0.5, 0.977)
"""Levels of a median and its 2σ band."""

_COLUMNS = (
    Column(name="feature"),
    Column(name="p_norm", decimals=2),
    Column(name="p_norm_low", label="−2σ", decimals=2),
    Column(name="p_norm_high", label="+2σ", decimals=2),
    Column(name="chance", label="chance\n%", decimals=0, scale=100.0),
    Column(name="brightness", label="grey\nlevel", decimals=0),
    Column(name="wanted_ms", label=f"{WANTED_BRIGHTNESS:g} at\nms", digits=3),
    Column(name="wanted_ms_low", label="−2σ", digits=3),
    Column(name="wanted_ms_high", label="+2σ", digits=3),
    Column(name="known"),
)

FloatArray: TypeAlias = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True, eq=False)
class Forecast:
    """What to expect of n features in a view at m exposure times.

    Parameters
    ----------
    features : tuple of str
        The n features.
    exposures_ms : tuple of float, ms
        The m exposure times.
    wanted_ms : (n, 3) ndarray, ms
        Exposure time at which each feature has the brightness `WANTED_BRIGHTNESS`: its median
        between the lower and the upper end of its 2σ band, none below 0.
    brightness : (n, m) ndarray, grey levels 0–255
        Mean brightness of the ring to expect.
    p_norm : (n, m) ndarray
        Mean of the quality to expect.
    p_norm_low, p_norm_high : (n, m) ndarray
        Its 2σ band, the brightness's uncertainty included.
    chance : (n, m) ndarray
        Chance that the quality reaches `need`.
    need : float
        Quality that is asked for.
    unknown : tuple of str
        Why a feature's forecast should not be relied on, and what would help; empty where it may.
    source : tuple of str
        What each feature's forecast rests on: "pose", or what a trial added to it.
    remarks : tuple of str
        What is odd about all of it.
    rings : RingForecast or None
        The default models' forecast, which knows windows of exposure times and draws them jointly.
    limits : ExposureLimits or None
        What the sensor can be set to, where the models know it.
    target : str
        Column of the quality; `p_norm` and its band hold it, whatever it is.
    """

    features: tuple[str, ...]
    exposures_ms: tuple[float, ...]
    wanted_ms: FloatArray
    brightness: FloatArray
    p_norm: FloatArray
    p_norm_low: FloatArray
    p_norm_high: FloatArray
    chance: FloatArray
    need: float
    unknown: tuple[str, ...]
    source: tuple[str, ...]
    remarks: tuple[str, ...] = ()
    rings: RingForecast | None = None
    limits: ExposureLimits | None = None
    target: str = "p_norm"

    @classmethod
    def of(
        cls,
        rings: RingForecast,
        features: Sequence[str],
        limits: ExposureLimits | None = None,
        target: str = "p_norm",
    ) -> Forecast:
        """Return the forecast of one view's rings, with the names of their features."""
        return cls(
            features=tuple(features),
            exposures_ms=tuple(rings.exposures_ms.tolist()),
            wanted_ms=rings.exposure_ms(WANTED_BRIGHTNESS, BAND),
            brightness=np.minimum(rings.i_mean(), GREY_MAX),
            p_norm=rings.p_norm,
            p_norm_low=rings.low,
            p_norm_high=rings.high,
            chance=rings.chance,
            need=rings.need,
            unknown=rings.unknown,
            source=rings.source,
            remarks=rings.remarks,
            rings=rings,
            limits=limits,
            target=target,
        )

    @property
    def knows(self) -> NDArray[np.bool_]:
        """Which features' forecasts may be relied on, (n,)."""
        return np.array([not reason for reason in self.unknown], dtype=np.bool_)

    @property
    def frame(self) -> pl.DataFrame:
        """One row for each feature and exposure time.

        Columns ``feature``, ``exposure_ms``, ``brightness``, ``p_norm``, ``p_norm_low`` and
        ``p_norm_high`` (2σ band), ``chance``, ``known``, ``unknown`` (why), ``source``; and
        ``wanted_ms``, ``wanted_ms_low``, ``wanted_ms_high``, the same at all times of a feature.
        """
        n, m = self.p_norm.shape
        over_time = ("brightness", "p_norm", "p_norm_low", "p_norm_high", "chance")
        wanted = dict(
            zip(("wanted_ms_low", "wanted_ms", "wanted_ms_high"), self.wanted_ms.T, strict=True)
        )
        return pl.DataFrame(
            {
                "feature": [name for name in self.features for _ in range(m)],
                "exposure_ms": np.tile(self.exposures_ms, n),
                **{name: getattr(self, name).ravel() for name in over_time},
                "known": np.repeat(self.knows, m),
                "unknown": [reason for reason in self.unknown for _ in range(m)],
                "source": [source for source in self.source for _ in range(m)],
                **{name: np.repeat(values, m) for name, values in wanted.items()},
            }
        )

    def best_exposure_ms(self) -> float:
        """Return the exposure time at which most features are expected to reach `need`, in ms.

        Features that are not known do not count, unless none is. Of equally good ones the middle
        one.
        """
        return self.exposures_ms[self._best]

    @property
    def _best(self) -> int:
        return best_exposure(self.chance, self.knows)

    def chances(
        self, limits: ExposureLimits | None = None, *, count: int = SETTINGS, view: str = ""
    ) -> CaptureChances:
        """Return what captures at the sensor's settings promise, each and several together.

        Parameters
        ----------
        limits : ExposureLimits, optional
            What the sensor can be set to; the forecast's own exposure times by default, and always
            of models that know no windows: make the forecast at allowed ones.
        count : int
            Settings to look at, at about equal ratios over all features' windows.
        view : str
            The view's name.

        Raises
        ------
        InputError
            If no setting can serve any feature.
        """
        times = self.exposures_ms
        if self.rings is None:
            return CaptureChances.by_themselves(
                self.chance,
                times,
                features=self.features,
                need=self.need,
                view=view,
                reasons=self.unknown,
            )
        if limits is None:
            return CaptureChances.of_rings(self.rings, times, view=view, features=self.features)
        return CaptureChances.within(
            self.rings, limits, count=count, view=view, features=self.features
        )

    def recommend(
        self,
        limits: ExposureLimits | str | None = None,
        costs: CaptureCosts | None = None,
        *,
        at_least: float | None = None,
        confidence: float = CONFIDENCE,
        prefer: Prefer = "margin",
        view: str = "",
        hidden: Mapping[str, str] | None = None,
    ) -> Recommendation:
        """Recommend the fewest exposures that serve the features, and say which will fail and why.

        Parameters
        ----------
        limits : ExposureLimits or str, optional
            What the sensor can be set to, or a profile's name; the sensor's own by default, where
            the models know it.
        costs : CaptureCosts, optional
            What captures take.
        at_least : float, optional
            Quality that is asked for, in place of `need`; of the default models.
        confidence : float
            Chance that each feature shall have.
        prefer : {"margin", "time"}
            Among the fewest: those with the greatest least chance, or those that take least.
        view : str
            The view's name.
        hidden : mapping of str to str, optional
            Features that the view does not see, and why.

        Raises
        ------
        InputError
            If the confidence is not between 0 and 1, or these models cannot forecast another
            quality.
        """
        check_confidence(confidence)
        limits = limits_from(limits) or self.limits
        asked = self
        if at_least is not None and at_least != self.need:
            if self.rings is None:
                msg = f"this forecast is for {self.need:g}; make another one with need={at_least:g}"
                raise InputError(msg)
            asked = Forecast.of(
                self.rings.at(self.exposures_ms, at_least),
                self.features,
                self.limits,
                self.target,
            )
        times = self.exposures_ms
        return recommend(
            asked.chances(limits, view=view),
            limits
            or ExposureLimits(
                name="the forecast's exposure times",
                min_ms=min(times),
                max_ms=max(times),
                increment_ms=min(times),
                allowed_ms=times,
            ),
            costs,
            confidence=confidence,
            prefer=prefer,
            hidden=hidden,
            remarks=asked.remarks,
            target=self.target,
            at_most=self.rings is not None and self.rings.window.sign < 0.0,
        )

    def attainable(self, confidence: float = CONFIDENCE) -> float:
        """Return the strictest need that one exposure gives as many features as any need.

        Features that are not known do not count, unless none is. To a hundredth of the range of
        what is expected.

        Parameters
        ----------
        confidence : float
            Chance that each of these features shall have.

        Raises
        ------
        InputError
            If the models know no windows.
        """
        if self.rings is None:
            msg = "only the default models' forecasts can be asked what is attainable"
            raise InputError(msg)
        known = self.knows if self.knows.any() else np.ones(len(self.features), dtype=np.bool_)
        expected = self.rings.window.sign * self.rings.quality[known]
        needs = np.linspace(expected.min() - 4.0 * self.rings.window.scatter, expected.max(), 101)
        needs *= self.rings.window.sign  # from lax to strict
        had = [
            int((self.rings.chance_of(float(need))[known] >= confidence).sum(axis=0).max())
            for need in needs
        ]
        return float(needs[np.flatnonzero(np.array(had) == max(had))[-1]])

    def write(self, path: str | Path) -> None:
        """Write `frame` as a CSV file, durably."""
        write_durably(Path(path), csv_of(self.frame))

    @property
    def table(self) -> Table:
        """The features at the best exposure time."""
        best_ms = self.best_exposure_ms()
        return Table(
            name="at_best_exposure",
            frame=self.frame.filter(pl.col("exposure_ms") == best_ms),
            columns=_COLUMNS,
            title=f"best exposure time for {counted(len(self.features), 'feature')}: "
            f"{number(best_ms)} ms, {self.verdict}",
        )

    @property
    def verdict(self) -> str:
        """How many features reach `need` at the best exposure time, and which do not."""
        chance = self.chance[:, self._best]
        likely = int(np.count_nonzero((chance >= LIKELY) & self.knows))
        others = [
            f"{name} ({100 * each:.0f} %)"
            for name, each, known in zip(self.features, chance, self.knows, strict=True)
            if known and each < LIKELY
        ]
        return (
            f"{likely} of {len(self.features)} features reach {self.need:g} with a chance of "
            f"{100 * LIKELY:g} % or more"
        ) + (f"; less likely: {', '.join(others)}" if others else "")

    @property
    def notes(self) -> tuple[str, ...]:
        """Remarks, and which features are not known and why."""
        reasons: dict[str, list[str]] = {}
        for name, reason in zip(self.features, self.unknown, strict=True):
            if reason:
                reasons.setdefault(reason, []).append(name)
        return (
            *self.remarks,
            *(f"not known: {', '.join(names)}: {reason}" for reason, names in reasons.items()),
        )

    def __str__(self) -> str:
        return "\n".join((self.table.title, str(self.table), *self.notes))

    def _repr_html_(self) -> str:
        return f"<p>{self.table.title}</p>{self.table._repr_html_()}"


def check_forecast(poses: pl.DataFrame, exposures_ms: Sequence[float] | None) -> None:
    """Check that there is something to forecast.

    Raises
    ------
    InputError
        If there is no feature or no exposure time above 0.
    """
    times = () if exposures_ms is None else tuple(exposures_ms)
    if poses.height and (exposures_ms is None or (times and min(times) > 0.0)):
        return
    msg = (
        "a forecast needs at least one visible feature and exposure times above 0 ms, got "
        f"{counted(poses.height, 'feature')} and {', '.join(map(number, times)) or 'no time'}"
    )
    raise InputError(msg)
