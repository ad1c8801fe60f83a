"""What a strategy is: a function that measures one view at a time, and what it is given to do so.

A method of one's own takes a few lines (``docs/benchmark.md``):

    @strategy("middle", "one exposure at the middle of the range")
    def middle(trial):
        trial.take(trial.nearest(float(np.sqrt(trial.settings_ms[0] * trial.settings_ms[-1]))))
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from typing import Final, Literal, TypeAlias

import numpy as np
import polars as pl
from numpy.typing import NDArray

from exposight.cell import ActiveSensor
from exposight.errors import InputError, did_you_mean
from exposight.observing import ObservationTable
from exposight.planning.comparing.sweeps import Sweep, SweepView
from exposight.planning.exposure_limits import CaptureCosts, ExposureLimits
from exposight.planning.sensor_models import SensorModels
from exposight.tables import counted, number

FloatArray: TypeAlias = NDArray[np.float64]

_SAME = 1e-6
"""Relative difference up to which two exposure times are one setting."""


@dataclass(frozen=True, kw_only=True)
class MeasuringCosts:
    """What captures and trial images cost.

    Parameters
    ----------
    capture, trial_image : CaptureCosts
        The defaults are a capture of 12 frames with 500 ms beside, and a single image with 100 ms
        (assumed).
    """

    capture: CaptureCosts = field(
        default_factory=lambda: CaptureCosts(frames=12, overhead_ms=500.0)
    )
    trial_image: CaptureCosts = field(
        default_factory=lambda: CaptureCosts(frames=1, overhead_ms=100.0)
    )


@dataclass(kw_only=True, eq=False)
class Trial:
    """One view that a strategy measures; it counts what the strategy takes.

    Parameters
    ----------
    sweep : Sweep
        Where the view is from.
    of : SweepView
        The view.
    limits : ExposureLimits or None
        How many captures a view may have.
    """

    sweep: Sweep = field(repr=False)
    of: SweepView = field(repr=False)
    limits: ExposureLimits | None = None
    _taken: list[int] = field(default_factory=list)
    _images: list[int] = field(default_factory=list)
    _promises: dict[str, float] = field(default_factory=dict)
    _chances: FloatArray | None = None

    @property
    def view(self) -> str:
        """The view's name."""
        return self.of.name

    @property
    def features(self) -> tuple[str, ...]:
        """The n features to measure."""
        return self.of.features

    @property
    def settings_ms(self) -> FloatArray:
        """Exposure times that may be taken, ascending, (m,), ms."""
        return self.of.settings_ms

    @property
    def poses(self) -> pl.DataFrame:
        """What is known of the features before a capture is taken, a row for each."""
        return self.of.poses

    @property
    def need(self) -> float:
        """p_norm that each feature is to reach in one capture."""
        return self.sweep.need

    @property
    def sensor(self) -> ActiveSensor | None:
        """The sensor, where it is known."""
        return self.sweep.sensor

    @property
    def black_level(self) -> float:
        """Brightness without light, grey levels."""
        return self.sweep.black_level

    @property
    def left(self) -> int:
        """How many more captures the limits allow in this view."""
        most = None if self.limits is None else self.limits.most_per_view
        return len(self.settings_ms) if most is None else most - len(self._taken)

    def nearest(self, exposure_ms: float) -> float:
        """Return the allowed exposure time nearest in ratio, ms."""
        wish = np.log(max(exposure_ms, 1e-9))
        return float(self.settings_ms[np.abs(np.log(self.settings_ms) - wish).argmin()])

    def take(self, exposure_ms: float) -> ObservationTable:
        """Take a capture, which counts, and return what it shows: a row for each feature.

        Raises
        ------
        InputError
            If the exposure time is none of `settings_ms`, or the view has all captures that it may
            have.
        """
        place = self._place(exposure_ms)
        if self.left < 1:
            msg = (
                f"view {self.view}: the limits allow {counted(len(self._taken), 'capture')} a "
                "view; look at Trial.left before another one is taken"
            )
            raise InputError(msg)
        self._taken.append(place)
        return self.of.rows[place]

    def take_all(self, exposures_ms: Iterable[float]) -> None:
        """Take captures at the nearest allowed exposure times, each once, as many as limits let."""
        for exposure_ms in list(dict.fromkeys(map(self.nearest, exposures_ms)))[: self.left]:
            self.take(exposure_ms)

    def trial(self, exposure_ms: float) -> ObservationTable:
        """Take a trial image, which counts as an exposure, and return each feature's brightness.

        Raises
        ------
        InputError
            If the exposure time is none of `settings_ms`.
        """
        place = self._place(exposure_ms)
        self._images.append(place)
        return self.of.images[place]

    @property
    def had(self) -> frozenset[str]:
        """The features that some capture has brought to `need`."""
        reached = self.outcomes
        return frozenset(name for i, name in enumerate(self.features) if reached[i].any())

    @property
    def outcomes(self) -> NDArray[np.bool_]:
        """Which features each capture taken so far has brought to `need`, (n, captures)."""
        out: NDArray[np.bool_] = self.of.p_norm[:, self._taken] >= self.need
        return out

    @property
    def captures_ms(self) -> tuple[float, ...]:
        """Exposure times of the captures taken so far, ms."""
        return tuple(self.settings_ms[self._taken].tolist())

    @property
    def trial_images_ms(self) -> tuple[float, ...]:
        """Exposure times of the trial images taken so far, ms."""
        return tuple(self.settings_ms[self._images].tolist())

    def promise(self, chances: Mapping[str, float]) -> None:
        """Say with which chance each feature will be had; scores hold it against what came.

        Raises
        ------
        InputError
            If a feature is none of the view's, or a chance is not between 0 and 1.
        """
        for name, chance in chances.items():
            if name not in self.features or not 0.0 <= chance <= 1.0:
                msg = (
                    f"a promise is a chance from 0 to 1 for a feature of view {self.view}, got "
                    f"{chance:g} for {name!r}{did_you_mean(name, self.features)}"
                )
                raise InputError(msg)
            self._promises[name] = float(chance)

    @property
    def promises(self) -> dict[str, float]:
        """Chances by feature that were promised."""
        return dict(self._promises)

    def say_chances(self, chances: FloatArray) -> None:
        """Say the chance that one capture serves, for all features and settings, (n, m)."""
        if chances.shape != self.of.p_norm.shape:
            msg = f"chances need the shape {self.of.p_norm.shape}, got {chances.shape}"
            raise InputError(msg)
        self._chances = chances

    @property
    def chances(self) -> FloatArray | None:
        """The chances that were said, (n, m)."""
        return self._chances

    def _place(self, exposure_ms: float) -> int:
        near = np.flatnonzero(np.abs(self.settings_ms / exposure_ms - 1.0) < _SAME)
        if len(near):
            return int(near[0])
        settings = ", ".join(number(each) for each in self.settings_ms.tolist())
        msg = (
            f"view {self.view} has no exposure time of {number(exposure_ms)} ms; allowed are "
            f"{settings} ms: Trial.nearest returns the nearest one"
        )
        raise InputError(msg)


Method: TypeAlias = Callable[[Trial], None]
"""Measures one view; called with the views in their order."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Setup:
    """What a strategy may prepare itself with before it measures the first view.

    Parameters
    ----------
    sweep : Sweep
        What will be measured. Its views hold all outcomes: who looks at them is an oracle.
    rehearsal : Sweep
        Views on which constants may be chosen: those of the sweep itself, in hindsight, or others.
    costs : MeasuringCosts
    limits : ExposureLimits or None
        None for whatever the sweep has.
    confidence : float
        Chance with which each feature is to be had.
    models : SensorModels or None
        The models to forecast with, where the strategy needs some.
    """

    sweep: Sweep
    rehearsal: Sweep
    costs: MeasuringCosts
    limits: ExposureLimits | None = None
    confidence: float = 0.9
    models: SensorModels | None = None

    @property
    def required_models(self) -> SensorModels:
        """The models.

        Raises
        ------
        InputError
            If there are none.
        """
        if self.models is None:
            msg = "this strategy forecasts: give models to compare with"
            raise InputError(msg)
        return self.models


Kind = Literal["oracle", "rival", "model"]


@dataclass(frozen=True, kw_only=True, eq=False)
class Strategy:
    """A way to choose exposure times.

    Parameters
    ----------
    name : str
        What it is asked for by.
    title : str
        A line about it.
    kind : {"oracle", "rival", "model"}
        An oracle knows all outcomes; a "model" strategy forecasts and runs once for each pair of
        models.
    start : callable
        Makes the method that is called with each view.
    """

    name: str
    title: str
    kind: Kind
    start: Callable[[Setup], Method]


STRATEGIES: Final[dict[str, Strategy]] = {}
"""All strategies by name, in the order in which they were registered."""


def register(
    name: str, title: str, start: Callable[[Setup], Method], *, kind: Kind = "rival"
) -> None:
    """Register a strategy that prepares itself (`Strategy`).

    Raises
    ------
    InputError
        If there is one of that name already.
    """
    if name in STRATEGIES:
        msg = (
            f"there is a strategy {name!r} already ({STRATEGIES[name].title}): choose another name"
        )
        raise InputError(msg)
    STRATEGIES[name] = Strategy(name=name, title=title, kind=kind, start=start)


def strategy(name: str, title: str, *, kind: Kind = "rival") -> Callable[[Method], Method]:
    """Register a function that measures a view (`Trial`) as a strategy; a decorator."""

    def decorate(method: Method) -> Method:
        register(name, title, lambda _: method, kind=kind)
        return method

    return decorate


def strategies_named(names: Iterable[str]) -> tuple[Strategy, ...]:
    """Return strategies by their names.

    Raises
    ------
    InputError
        If there is none of a name.
    """
    names = tuple(names)
    for name in names:
        if name not in STRATEGIES:
            msg = (
                f"no strategy is called {name!r}; there are {', '.join(STRATEGIES)}"
                f"{did_you_mean(name, STRATEGIES)}"
            )
            raise InputError(msg)
    return tuple(STRATEGIES[name] for name in dict.fromkeys(names))
