"""Measuring plans: from where, for how long and in which light a part is measured.

After Sect. 3.2.1 of the paper: the sensor keeps its orientation and moves so that a reference
feature comes to lie on a grid over x and y of the TCP frame, in planes of constant z; each plane
has its own exposure times. ``z_tcp_mm`` below 0 is nearer to the sensor.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal, TypeVar, get_args

from exposight.cell import PRESETS, Part
from exposight.errors import FeatureError, InputError
from exposight.plans.alignment import AlignmentErrors
from exposight.twin.light import Lighting

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from exposight.cell import Feature

_Value = TypeVar("_Value", str, float)


Side = Literal["inside", "outside"]
"""The side of the part before which the sensor stands."""

BlindViews = Literal["refuse", "skip"]
"""What becomes of a position on a grid from which no feature of the plan can be seen."""


@dataclass(frozen=True, kw_only=True)
class DepthPlane:
    """A grid of positions of the reference feature at one depth.

    Parameters
    ----------
    name : str
        Views are called after it: ``near-x1-y4`` is the first in x and the fourth in y.
    z_tcp_mm : float, mm
        The reference feature's z in the TCP frame; below 0 is nearer to the sensor.
    x_mm, y_mm : sequence of float, mm
        The reference feature's x and y in the TCP frame: every x is combined with every y.
    exposures_ms : sequence of float, ms
        Exposure times at every position.
    kinematic_share : float, 0 to 1
        Probability that a view is aligned by the robot's kinematics alone, not photogrammetry.

    Raises
    ------
    InputError
        If a list is empty, a number appears twice or is not finite, an exposure time is not above
        0, or the share is none. The message names the plane.
    """

    name: str
    z_tcp_mm: float
    x_mm: tuple[float, ...]
    y_mm: tuple[float, ...]
    exposures_ms: tuple[float, ...]
    kinematic_share: float = 0.0

    def __post_init__(self) -> None:
        _check_name(self.name)
        what = f"plane {self.name!r}"
        (z_tcp_mm,) = _numbers([self.z_tcp_mm], f"{what}: z_tcp_mm")
        object.__setattr__(self, "z_tcp_mm", z_tcp_mm)
        for axis in ("x_mm", "y_mm"):
            object.__setattr__(self, axis, _numbers(getattr(self, axis), f"{what}: {axis}"))
        object.__setattr__(self, "exposures_ms", _exposures(self.exposures_ms, what))
        object.__setattr__(self, "kinematic_share", _share(self.kinematic_share, what))

    def positions(self) -> Iterator[tuple[str, tuple[float, float, float]]]:
        """Yield the name of each view and the reference feature's (x, y, z) in mm there."""
        for j, y in enumerate(self.y_mm, start=1):
            for i, x in enumerate(self.x_mm, start=1):
                yield f"{self.name}-x{i}-y{j}", (x, y, self.z_tcp_mm)


@dataclass(frozen=True, kw_only=True)
class RandomPositions:
    """Positions of the reference feature drawn evenly from a box (Sect. 4.3 of the paper).

    A position from which no feature of the plan can be seen is drawn again.

    Parameters
    ----------
    name : str
        Views are called after it and numbered: ``random-01``, ``random-02``, …
    count : int
        How many.
    x_mm, y_mm, z_tcp_mm : (float, float), mm
        Least and greatest value in the TCP frame.
    exposures_ms : sequence of float, ms
        Exposure times at every position.
    kinematic_share : float, 0 to 1
        Probability that a view is aligned by the robot's kinematics alone, not photogrammetry.

    Raises
    ------
    InputError
        If a range does not go up, the count is not from 1 to 9999, or as for `DepthPlane`.
    """

    name: str
    count: int
    x_mm: tuple[float, float]
    y_mm: tuple[float, float]
    z_tcp_mm: tuple[float, float]
    exposures_ms: tuple[float, ...]
    kinematic_share: float = 0.0

    def __post_init__(self) -> None:
        _check_name(self.name)
        what = f"random positions {self.name!r}"
        if not 1 <= self.count <= 9999:
            msg = f"{what}: count must be from 1 to 9999, got {self.count}"
            raise InputError(msg)
        for axis in ("x_mm", "y_mm", "z_tcp_mm"):
            limits = _numbers(getattr(self, axis), f"{what}: {axis}")
            if len(limits) != 2 or limits[0] >= limits[1]:
                msg = (
                    f"{what}: {axis} needs two numbers, the lower one first, got {_listed(limits)}"
                )
                raise InputError(msg)
            object.__setattr__(self, axis, limits)
        object.__setattr__(self, "exposures_ms", _exposures(self.exposures_ms, what))
        object.__setattr__(self, "kinematic_share", _share(self.kinematic_share, what))

    def names(self) -> tuple[str, ...]:
        """Return the views' names."""
        digits = max(2, len(str(self.count)))
        return tuple(f"{self.name}-{i:0{digits}d}" for i in range(1, self.count + 1))


@dataclass(frozen=True, kw_only=True)
class MeasuringPlan:
    """Everything that decides a campaign on the twin, but the part.

    Parameters
    ----------
    name : str
        What people call it.
    sensor : str
        Name of a sensor's preset (`exposight.cell.PRESETS`).
    features : sequence of str
        The part's features that are observed; others are not looked at.
    reference : str
        The feature about which positions are planned; need not be observed.
    side : {'inside', 'outside'}
        Before the inside the sensor's axes are parallel to the part's; before the outside it is
        turned by 180° about y.
    planes : sequence of DepthPlane
        Grids of positions.
    random : sequence of RandomPositions
        Random positions, measured after the grids.
    lighting : {'I', 'II', 'III'}
        Scenario of Sect. 4.1 of the paper: closed cell, its LED on, open cell.
    blind_views : {'refuse', 'skip'}
        Whether a position on a grid that sees no feature of the plan is an error or left out.
    alignment : AlignmentErrors
        How wrong the recorded poses are.
    seed : int, 0 or more
        All randomness of the campaign follows from it and the views' names.

    Raises
    ------
    InputError
        If something is missing, unknown or there twice. The message names it.
    """

    name: str
    sensor: str
    features: tuple[str, ...]
    reference: str
    side: Side = "inside"
    planes: tuple[DepthPlane, ...] = ()
    random: tuple[RandomPositions, ...] = ()
    lighting: Lighting = "I"
    blind_views: BlindViews = "refuse"
    alignment: AlignmentErrors = field(default_factory=AlignmentErrors)
    seed: int = 0

    def __post_init__(self) -> None:
        for name in ("features", "planes", "random"):
            object.__setattr__(self, name, tuple(getattr(self, name)))
        _check_name(self.name)
        fault = self._fault()
        if fault:
            msg = f"plan {self.name!r}: {fault}"
            raise InputError(msg)

    def _fault(self) -> str:
        for key, value, known in (
            ("sensor", self.sensor, tuple(PRESETS)),
            ("side", self.side, get_args(Side)),
            ("lighting", self.lighting, get_args(Lighting)),
            ("blind_views", self.blind_views, get_args(BlindViews)),
        ):
            if value not in known:
                return f"{key} must be one of {', '.join(known)}, got {value!r}"
        if not self.features:
            return "features is empty; name at least one feature that shall be observed"
        twice = _first_twice(self.features)
        if twice is not None:
            return f"feature {twice!r} is there twice"
        if not self.reference:
            return "reference is empty; name the feature about which positions are planned"
        names = [group.name for group in self.groups]
        if not names:
            return "it has neither planes nor random positions; add at least one"
        twice = _first_twice(names)
        if twice is not None:
            return f"two planes are called {twice!r}; give each a name of its own"
        if self.seed < 0:
            return f"seed must be a whole number from 0 up, got {self.seed}"
        return ""

    @property
    def groups(self) -> tuple[DepthPlane | RandomPositions, ...]:
        """Planes, then random positions: each with its name and exposure times."""
        return (*self.planes, *self.random)

    def observed_part(self, part: Part) -> Part:
        """Return a part that has only the features this plan observes.

        Raises
        ------
        FeatureError
            If the part lacks one of them.
        """
        features = tuple(self._feature(part, name) for name in self.features)
        return Part(name=part.name, features=features)

    def reference_feature(self, part: Part) -> Feature:
        """Return the feature about which positions are planned.

        Raises
        ------
        FeatureError
            If the part has no such feature.
        """
        return self._feature(part, self.reference)

    def _feature(self, part: Part, name: str) -> Feature:
        try:
            return part.feature(name)
        except FeatureError as error:
            msg = f"plan {self.name!r}: {error}"
            raise FeatureError(msg) from error


def _check_name(name: str) -> None:
    # Views are called after these names, and folders and table cells hold them.
    if not name.strip() or name != name.strip() or not name.isprintable():
        msg = f"plans and planes need printable names without blanks at their ends, got {name!r}"
        raise InputError(msg)


def _numbers(values: Sequence[float], what: str) -> tuple[float, ...]:
    numbers = tuple(map(float, values))
    if not numbers:
        msg = f"{what} is empty; give at least one number"
        raise InputError(msg)
    if not all(map(math.isfinite, numbers)):
        msg = f"{what} must hold finite numbers, got {_listed(numbers)}"
        raise InputError(msg)
    twice = _first_twice(numbers)
    if twice is not None:
        msg = f"{what} holds {twice:g} twice; give every number once"
        raise InputError(msg)
    return numbers


def _exposures(values: Sequence[float], what: str) -> tuple[float, ...]:
    exposures = _numbers(values, f"{what}: exposures_ms")
    if min(exposures) <= 0:
        msg = f"{what}: exposures_ms must all be above 0 ms, got {min(exposures):g}"
        raise InputError(msg)
    return exposures


def _share(share: float, what: str) -> float:
    if not 0.0 <= share <= 1.0:
        msg = f"{what}: kinematic_share must be from 0 to 1, got {share}"
        raise InputError(msg)
    return float(share)


def _listed(numbers: Sequence[float]) -> str:
    return "[" + ", ".join(f"{number:g}" for number in numbers) + "]"


def _first_twice(values: Sequence[_Value]) -> _Value | None:
    seen: set[_Value] = set()
    for value in values:
        if value in seen:
            return value
        seen.add(value)
    return None
