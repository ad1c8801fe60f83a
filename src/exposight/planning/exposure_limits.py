"""Which exposure times a sensor can be set to, and what a capture costs.

A window of exposure times is of use only where the sensor has a setting in it: settings are always
chosen inside a window, never rounded to the nearest one, which may lie outside.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import cache, cached_property
from importlib.resources import files
from pathlib import Path
from typing import Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from exposight.cell import ActiveSensor, preset_name
from exposight.errors import FormatError, InputError, SensorError, did_you_mean
from exposight.files import check_plain, parse_toml, read_text, validate
from exposight.tables import number

FloatArray: TypeAlias = NDArray[np.float64]

_PER_MS: Mapping[str, float] = {"us": 1e3, "ms": 1.0, "s": 1e-3}

_SAME = 1e-6
"""Share of an increment within which two times are the same setting: dust of binary sums."""

_DECIMALS = 6
"""Of settings in ms: nanoseconds are finer than any camera, and rounding drops the sum's dust."""

_LONGEST_MS = 3.6e6
"""No exposure is longer than an hour; more is another unit."""

_LONGEST_TEXT = 10_000
"""Characters of a source."""

_RIPPLE = 0.01
"""Share of the mains' half period by which an exposure time may miss a multiple of it.

At most 1 % of a lamp's ripple is left then; assumed to vanish beside noise.
"""


@dataclass(frozen=True, kw_only=True)
class ExposureLimits:
    """What a sensor lets one set.

    Parameters
    ----------
    name : str
        Of the sensor.
    min_ms, max_ms : float, ms
        Shortest and longest exposure time.
    increment_ms : float, ms
        Settings are the minimum plus whole increments.
    allowed_ms : tuple of float, ms
        The only settings, where a sensor has a list of them, in place of increments.
    least_per_view, most_per_view : int
        A view that is captured is captured so many times; `most_per_view` is None without a limit.
    flicker_hz : float, optional
        Mains frequency of lamps that flicker: exposure times are then multiples of half its period,
        10 ms at 50 Hz.
    unit : {"ms", "us", "s"}
        What the sensor is set in.
    lowest_wins : bool
        Where several exposures of a view see a point, the first one's is kept: the surest exposure
        goes first.
    source : str
        Where these figures are from.

    Raises
    ------
    SensorError
        If they contradict each other or leave no exposure time.
    """

    name: str
    min_ms: float
    max_ms: float
    increment_ms: float
    allowed_ms: tuple[float, ...] = ()
    least_per_view: int = 1
    most_per_view: int | None = None
    flicker_hz: float | None = None
    unit: Literal["us", "ms", "s"] = "ms"
    lowest_wins: bool = False
    source: str = field(default="", compare=False)

    def __post_init__(self) -> None:
        check_plain(self.name, "the sensor", SensorError)
        check_plain(self.source, f"the source of {self.name!r}", SensorError, longest=_LONGEST_TEXT)
        fault = self._fault()
        if fault:
            msg = f"exposure limits of {self.name!r}: {fault}"
            raise SensorError(msg)
        object.__setattr__(self, "allowed_ms", tuple(sorted(set(map(float, self.allowed_ms)))))
        if self._settings_in(self.min_ms, self.max_ms) == (0, -1):
            msg = (
                f"exposure limits of {self.name!r} allow no exposure time: "
                f"{self._rule(self.min_ms, self.max_ms)}"
            )
            raise SensorError(msg)

    def _fault(self) -> str:
        low, high, step = self.min_ms, self.max_ms, self.increment_ms
        if not (0 < low <= high < math.inf and 0 < step < math.inf):
            return (
                "they need 0 < min_ms ≤ max_ms and increment_ms above 0, got "
                f"{low:g}, {high:g} and {step:g}"
            )
        if high > _LONGEST_MS or step < 10.0**-_DECIMALS:
            return (
                f"max_ms is an hour or less, {_LONGEST_MS:g}, and increment_ms a nanosecond or "
                f"more, {10.0**-_DECIMALS:g}; got {high:g} and {step:g}: check the unit"
            )
        if outside := [each for each in self.allowed_ms if not low <= each <= high]:
            return (
                f"allowed_ms lie from min_ms, {low:g}, to max_ms, {high:g}, got "
                f"{', '.join(map(number, outside))}; check the unit"
            )
        most = math.inf if self.most_per_view is None else self.most_per_view
        if not 1 <= self.least_per_view <= most:
            return (
                "least_per_view is 1 or more and not above most_per_view, got "
                f"{self.least_per_view} and {self.most_per_view}"
            )
        if self.flicker_hz is not None and not 10.0 <= self.flicker_hz <= 1000.0:
            return f"mains have 50 or 60 Hz, got {self.flicker_hz:g} as the flicker"
        if self.unit not in _PER_MS:
            return f"they are set in {', '.join(_PER_MS)}, got {self.unit!r}"
        return ""

    @classmethod
    def of(cls, sensor: ActiveSensor) -> ExposureLimits:
        """Return the limits in a sensor's description; of a preset those of its profile."""
        preset = preset_name(sensor)
        if preset is not None and preset in PROFILES:
            return PROFILES[preset]
        return cls(
            name=sensor.name,
            min_ms=sensor.exposure.min_ms,
            max_ms=sensor.exposure.max_ms,
            increment_ms=sensor.exposure.increment_ms,
            source="the sensor's description",
        )

    def under_mains(self, mains_hz: float | None) -> ExposureLimits:
        """Return the limits under lamps on such mains, in Hz; None where lamps do not flicker."""
        return replace(self, flicker_hz=mains_hz)

    # -- settings -------------------------------------------------------------------------------

    @cached_property
    def _listed_ms(self) -> FloatArray | None:
        """All settings where they are few: a list, or multiples of half the mains' period."""
        if self.flicker_hz is None:
            return np.array(self.allowed_ms) if self.allowed_ms else None
        half_ms = 500.0 / self.flicker_hz
        if self.allowed_ms:
            settable = np.array(self.allowed_ms, dtype=np.float64)
            multiples = np.rint(settable / half_ms)
        else:
            multiples = np.arange(1.0, self.max_ms / half_ms + 1.0)
            settable = self._at(np.rint((half_ms * multiples - self.min_ms) / self.increment_ms))
        wanted = half_ms * multiples
        even = (np.abs(settable - wanted) <= _RIPPLE * half_ms) & (wanted > 0.0)
        inside = (settable >= self.min_ms) & (settable <= self.max_ms)
        listed: FloatArray = np.unique(settable[even & inside])
        return listed

    def _at(self, steps: NDArray[np.int64] | FloatArray) -> FloatArray:
        times_ms: FloatArray = np.round(self.min_ms + steps * self.increment_ms, _DECIMALS)
        return times_ms

    def _settings_in(self, low_ms: float, high_ms: float) -> tuple[int, int]:
        """Return the first and last place of a setting in a window; (0, −1) if there is none."""
        low, high = max(low_ms, self.min_ms), min(high_ms, self.max_ms)
        if self._listed_ms is not None:
            slack = _SAME * self.increment_ms
            first = int(np.searchsorted(self._listed_ms, low - slack))
            last = int(np.searchsorted(self._listed_ms, high + slack, side="right")) - 1
        else:
            first = math.ceil((low - self.min_ms) / self.increment_ms - _SAME)
            last = math.floor((high - self.min_ms) / self.increment_ms + _SAME)
        return (first, last) if low <= high and first <= last else (0, -1)

    def settings(self, low_ms: float, high_ms: float, count: int = 60) -> FloatArray:
        """Return settings inside a window, ascending, at about equal ratios.

        Parameters
        ----------
        low_ms, high_ms : float, ms
            The window, its ends included.
        count : int
            At most so many; the first and the last setting in the window are among two or more.

        Returns
        -------
        (m,) ndarray, ms
            Empty where the window holds no setting (`why_none`).
        """
        first, last = self._settings_in(low_ms, high_ms)
        if last - first < count:
            return self._placed(np.arange(first, last + 1))
        time_at, last_until = self._lookups
        end, places = time_at(last), [first]
        for left in range(count - 1, 1, -1):  # the rest of the window in `left` equal ratios
            here = time_at(places[-1])
            place = last_until(here * (end / here) ** (1.0 / left))
            places.append(max(place, places[-1] + 1))
        places.append(max(last, places[-1] + 1))
        return self._placed(np.array(places))

    @cached_property
    def _lookups(self) -> tuple[Callable[[int], float], Callable[[float], int]]:
        """Return what gives the time at a place, and the last place up to a time."""
        step, slack = self.increment_ms, _SAME * self.increment_ms
        if self._listed_ms is None:
            low, lower = self.min_ms, self.min_ms - slack
            return lambda place: low + place * step, lambda ms: math.floor((ms - lower) / step)
        listed = self._listed_ms.tolist()
        return listed.__getitem__, lambda ms: bisect_right(listed, ms + slack) - 1

    def _placed(self, places: NDArray[np.int64]) -> FloatArray:
        return self._at(places) if self._listed_ms is None else self._listed_ms[places]

    def allows(self, exposure_ms: float) -> bool:
        """Return whether the sensor can be set to an exposure time."""
        slack = _SAME * self.increment_ms + 10.0**-_DECIMALS
        return self._settings_in(exposure_ms - slack, exposure_ms + slack) != (0, -1)

    def check_within(self, sensor: ActiveSensor) -> None:
        """Check that a sensor can take these settings: that they are not another's.

        Raises
        ------
        SensorError
            If its range, or its increment, does not hold them.
        """
        able = ExposureLimits.of(sensor)
        beyond = [
            each
            for each in self.settings(self.min_ms, self.max_ms).tolist()
            if not able.allows(each)
        ]
        if beyond:
            msg = (
                f"limits of {self.name!r} allow {number(beyond[0], 6)} ms, which {sensor.name!r} "
                f"cannot take: {number(able.min_ms)}–{number(able.max_ms)} ms in steps of "
                f"{number(able.increment_ms)} ms; give limits of that sensor, or none"
            )
            raise SensorError(msg)

    def set_value(self, exposure_ms: float) -> float:
        """Return an exposure time as the sensor is set to it, in `unit`."""
        return float(f"{exposure_ms * _PER_MS[self.unit]:.12g}")

    def exposure_ms(self, set_value: float) -> float:
        """Return the exposure time of what the sensor is set to, in ms."""
        return float(f"{set_value / _PER_MS[self.unit]:.12g}")

    def why_none(self, low_ms: float, high_ms: float) -> str:
        """Return why a window holds no setting, and what leaves none; empty if it holds one."""
        if self._settings_in(low_ms, high_ms) != (0, -1):
            return ""
        window = f"{number(low_ms, 3)}–{number(high_ms, 3)} ms"
        return f"no allowed exposure time in {window} ({self._rule(low_ms, high_ms)})"

    def _rule(self, low_ms: float, high_ms: float) -> str:
        if not low_ms <= high_ms:
            return "the window is empty"
        if low_ms > self.max_ms or high_ms < self.min_ms:
            return f"range {number(self.min_ms)}–{number(self.max_ms)} ms"
        if self.flicker_hz is not None:
            free = replace(self, flicker_hz=None)
            if free._settings_in(low_ms, high_ms) != (0, -1):
                return f"flicker {self.flicker_hz:g} Hz"
        if self.allowed_ms:
            return f"list {', '.join(map(number, self.allowed_ms))} ms"
        return f"increment {number(self.increment_ms)} ms"


@dataclass(frozen=True, kw_only=True)
class CaptureCosts:
    """What a capture and a robot's move take.

    Parameters
    ----------
    frames : int
        Images of a capture, each exposed for the exposure time.
    overhead_ms : float, ms
        Of each capture beside its exposures.
    move_ms : float, ms
        Of the robot to each view.

    Raises
    ------
    SensorError
        If there is no frame, or a time is below 0.
    """

    frames: int = 1
    overhead_ms: float = 0.0
    move_ms: float = 0.0

    def __post_init__(self) -> None:
        if not (
            self.frames >= 1
            and 0.0 <= self.overhead_ms < math.inf
            and 0.0 <= self.move_ms < math.inf
        ):
            msg = (
                "a capture takes at least 1 frame, and overhead and move 0 ms or more, got "
                f"{self.frames}, {self.overhead_ms:g} ms and {self.move_ms:g} ms"
            )
            raise SensorError(msg)

    def capture_ms(self, exposure_ms: float) -> float:
        """Return the time of a capture: its frames and the overhead, ms."""
        return self.frames * exposure_ms + self.overhead_ms


# -- profiles -----------------------------------------------------------------------------------


def _read(text: str, source: str) -> Mapping[str, ExposureLimits]:
    raw = parse_toml(text, source, "file of exposure limits in TOML")
    out = {}
    for key, table in raw.items():
        if not isinstance(table, dict):
            msg = f"{source}: expected a table [{key}] of limits, got the value {table!r}"
            raise FormatError(msg)
        out[key] = validate(ExposureLimits, {"name": key, **table}, f"{source}, [{key}]")
    return out


@cache
def _profiles() -> Mapping[str, ExposureLimits]:
    path = files("exposight.planning") / "data" / "sensor_limits.toml"
    return _read(path.read_text(encoding="utf-8"), "sensor_limits.toml")


PROFILES: Mapping[str, ExposureLimits] = _profiles()
"""Limits of some sensors, by name; each figure's source is in ``data/sensor_limits.toml``."""


def limits_from(given: ExposureLimits | str | None) -> ExposureLimits | None:
    """Return limits that are given, or named (`limits_named`); None where none are.

    Raises
    ------
    InputError
        If they are neither.
    ExposightError
        As `limits_named`.
    """
    if given is None or isinstance(given, ExposureLimits):
        return given
    if not isinstance(given, str):
        msg = f"expected ExposureLimits or the name of some, such as 'zivid-2', got {given!r}"
        raise InputError(msg)
    return limits_named(given)


def limits_named(name: str) -> ExposureLimits:
    """Return the limits of a profile, or those that a TOML file holds.

    Parameters
    ----------
    name : str
        A key of `PROFILES`; or the path of a TOML file with one table, whose keys are the fields of
        `ExposureLimits`.

    Raises
    ------
    SensorError
        If there is no such profile, or limits contradict each other.
    FileError
        If the file cannot be read, or is not of this form.
    """
    if name in PROFILES:
        return PROFILES[name]
    path = Path(name)
    if path.suffix.lower() == ".toml":
        read = _read(read_text(path, "file of exposure limits"), name)
        if len(read) == 1:
            return next(iter(read.values()))
        msg = f"{name}: expected one table with the limits of one sensor, got {len(read)}"
        raise FormatError(msg)
    msg = (
        f"no exposure limits are called {name!r}; there are {', '.join(PROFILES)}, or give a TOML "
        "file of your own"
    )
    raise SensorError(msg + did_you_mean(name, PROFILES))
