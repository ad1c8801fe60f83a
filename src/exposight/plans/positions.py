"""Where a plan places the sensor: grids and random positions about a feature, poses written out.

After Sect. 3.2.1 of the paper: the sensor keeps its orientation and moves so that a reference
feature comes to lie on a grid over x and y of the TCP frame, in planes of constant z; each plane
has its own exposure times. ``z_tcp_mm`` below 0 is nearer to the sensor.
"""

import hashlib
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np

from exposight.cell import ActiveSensor, StoredPose
from exposight.errors import InputError

_Value = TypeVar("_Value", str, float)


def view_seed(seed: int, view: str) -> tuple[int, int]:
    """Return the whole numbers from which everything random in a view follows.

    They depend on the seed and the view's name alone, so that views can be added to a plan, left
    out and computed in any order without changing the others.

    Parameters
    ----------
    seed : int, 0 or more
        The plan's seed.
    view : str
        The view's name.
    """
    return seed, int.from_bytes(hashlib.sha256(view.encode()).digest()[:8], "big")


def even_positions(first_mm: float, last_mm: float, count: int) -> tuple[float, ...]:
    """Return positions at equal distances, both ends included, rounded to 0.001 mm.

    Parameters
    ----------
    first_mm, last_mm : float, mm
        The ends.
    count : int, 2 or more
        How many.
    """
    return tuple(np.linspace(first_mm, last_mm, count).round(3).tolist())


def logarithmic_exposures(
    first_ms: float, last_ms: float, count: int, sensor: ActiveSensor
) -> tuple[float, ...]:
    """Return exposure times at equal ratios, as the sensor can be set (Sect. 3.2.1 of the paper).

    Parameters
    ----------
    first_ms, last_ms : float, ms
        The ends, above 0.
    count : int, 2 or more
        How many.
    sensor : ActiveSensor
        Whose settings they are rounded to.

    Raises
    ------
    SensorError
        If one of them is outside the sensor's range.
    """
    exposures = np.geomspace(first_ms, last_ms, count).tolist()
    # The ends come back exactly: rounding must not push them over the sensor's limits.
    exposures[0], exposures[-1] = float(first_ms), float(last_ms)
    return tuple(map(sensor.nearest_exposure, exposures))


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

    Raises
    ------
    InputError
        If a list is empty, a number appears twice or is not finite, or an exposure time is not
        above 0. The message names the plane.
    """

    name: str
    z_tcp_mm: float
    x_mm: tuple[float, ...]
    y_mm: tuple[float, ...]
    exposures_ms: tuple[float, ...]

    def __post_init__(self) -> None:
        check_name(self.name)
        place = f"plane {self.name!r}"
        (z_tcp_mm,) = _numbers([self.z_tcp_mm], f"{place}: z_tcp_mm")
        object.__setattr__(self, "z_tcp_mm", z_tcp_mm)
        for axis in ("x_mm", "y_mm"):
            object.__setattr__(self, axis, _numbers(getattr(self, axis), f"{place}: {axis}"))
        object.__setattr__(self, "exposures_ms", _exposures(self.exposures_ms, place))

    @property
    def n_views(self) -> int:
        """Number of positions."""
        return len(self.x_mm) * len(self.y_mm)

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

    def __post_init__(self) -> None:
        check_name(self.name)
        place = f"random positions {self.name!r}"
        if not 1 <= self.count <= 9999:
            msg = f"{place}: count must be from 1 to 9999, got {self.count}"
            raise InputError(msg)
        for axis in ("x_mm", "y_mm", "z_tcp_mm"):
            limits = _numbers(getattr(self, axis), f"{place}: {axis}")
            if len(limits) != 2 or limits[0] >= limits[1]:
                msg = (
                    f"{place}: {axis} needs two numbers, the lower one first, got {_listed(limits)}"
                )
                raise InputError(msg)
            object.__setattr__(self, axis, limits)
        object.__setattr__(self, "exposures_ms", _exposures(self.exposures_ms, place))

    @property
    def n_views(self) -> int:
        """Number of positions."""
        return self.count

    def names(self) -> tuple[str, ...]:
        """Return the views' names."""
        digits = max(2, len(str(self.count)))
        return tuple(f"{self.name}-{i:0{digits}d}" for i in range(1, self.count + 1))


@dataclass(frozen=True, kw_only=True)
class FixedView:
    """One pose, written out.

    Parameters
    ----------
    name : str
        The view's name.
    camera_from_part : RigidTransform
        Where the part shall stand, seen from the sensor's first camera.
    exposures_ms : sequence of float, ms
        Exposure times there.

    Raises
    ------
    InputError
        As for `DepthPlane`.
    """

    name: str
    camera_from_part: StoredPose
    exposures_ms: tuple[float, ...]

    def __post_init__(self) -> None:
        check_name(self.name)
        exposures_ms = _exposures(self.exposures_ms, f"view {self.name!r}")
        object.__setattr__(self, "exposures_ms", exposures_ms)

    @property
    def n_views(self) -> int:
        """One."""
        return 1


def check_name(name: str) -> None:
    """Check the name of a plan or a group of views, after which views, folders and cells are named.

    Raises
    ------
    InputError
        If it is empty, has blanks at its ends, or cannot be printed.
    """
    if not name.strip() or name != name.strip() or not name.isprintable():
        msg = f"plans and planes need printable names without blanks at their ends, got {name!r}"
        raise InputError(msg)


def first_twice(values: Sequence[_Value]) -> _Value | None:
    """Return the first value that appeared before in a sequence, or None."""
    known: set[_Value] = set()
    for value in values:
        if value in known:
            return value
        known.add(value)
    return None


def _numbers(values: Sequence[float], place: str) -> tuple[float, ...]:
    numbers = tuple(map(float, values))
    if not numbers:
        msg = f"{place} is empty; give at least one number"
        raise InputError(msg)
    if not all(map(math.isfinite, numbers)):
        msg = f"{place} must hold finite numbers, got {_listed(numbers)}"
        raise InputError(msg)
    twice = first_twice(numbers)
    if twice is not None:
        msg = f"{place} holds {twice:g} twice; give every number once"
        raise InputError(msg)
    return numbers


def _exposures(values: Sequence[float], place: str) -> tuple[float, ...]:
    exposures = _numbers(values, f"{place}: exposures_ms")
    if min(exposures) <= 0:
        msg = f"{place}: exposures_ms must all be above 0 ms, got {min(exposures):g}"
        raise InputError(msg)
    return exposures


def _listed(numbers: Sequence[float]) -> str:
    return "[" + ", ".join(f"{number:g}" for number in numbers) + "]"
