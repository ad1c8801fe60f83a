"""Where a plan places the sensor about a feature: grids and random positions.

After Sect. 3.2.1 of the paper: the sensor moves so that a reference feature comes to lie on a grid
over x and y of the TCP frame, in planes of constant z; each plane has its own exposure times.
``z_tcp_mm`` below 0 is nearer to the sensor. In the paper the sensor keeps its orientation; here it
may also turn about the reference feature, which stays where it is. A turn (w, p, r) is that of the
part in the TCP frame, about its fixed x, y and z axes.
"""

import hashlib
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np

from exposight.cell import ActiveSensor
from exposight.errors import InputError
from exposight.files import check_plain
from exposight.geometry import RigidTransform

_Value = TypeVar("_Value", str, float, tuple[float, ...])

_POSITION, _TURN = 0x504F53, 0x5452
"""The purposes of streams of random numbers."""

_SHORTEST_MS = 1e-9
_LONGEST_MS = 3.6e6
"""No exposure is longer than an hour; more is another unit."""

TURN_AXES = ("w_deg", "p_deg", "r_deg")
"""Keys of a turn: about x, y and z of the TCP frame."""

_NO_TURNS = ((0.0, 0.0, 0.0),)


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
        Views are called after it: ``near-x1-y4`` is the first in x and the fourth in y. With
        several turns their number follows: ``near-x1-y4-t2``.
    z_tcp_mm : float, mm
        The reference feature's z in the TCP frame; below 0 is nearer to the sensor.
    x_mm, y_mm : sequence of float, mm
        The reference feature's x and y in the TCP frame: every x is combined with every y.
    exposures_ms : sequence of float, ms
        Exposure times at every position.
    turns_deg : sequence of (float, float, float), degrees
        Turns (w, p, r) about the reference feature, each combined with every position; none by
        default.

    Raises
    ------
    InputError
        If a list is empty, a number or turn appears twice or is not finite, or an exposure time is
        not above 0. The message names the plane.
    """

    name: str
    z_tcp_mm: float
    x_mm: tuple[float, ...]
    y_mm: tuple[float, ...]
    exposures_ms: tuple[float, ...]
    turns_deg: tuple[tuple[float, float, float], ...] = ()

    def __post_init__(self) -> None:
        check_name(self.name)
        place = f"plane {self.name!r}"
        (z_tcp_mm,) = _numbers([self.z_tcp_mm], f"{place}: z_tcp_mm")
        object.__setattr__(self, "z_tcp_mm", z_tcp_mm)
        for axis in ("x_mm", "y_mm"):
            object.__setattr__(self, axis, _numbers(getattr(self, axis), f"{place}: {axis}"))
        object.__setattr__(self, "exposures_ms", check_exposures(self.exposures_ms, place))
        turns = tuple(tuple(map(float, turn)) for turn in self.turns_deg)
        for turn in turns:
            if len(turn) != 3 or not all(map(math.isfinite, turn)):
                msg = f"{place}: a turn needs w, p and r in degrees, got {_listed(turn)}"
                raise InputError(msg)
        twice = first_twice(turns)
        if twice is not None:
            msg = f"{place}: turns_deg holds {_listed(twice)} twice; give every turn once"
            raise InputError(msg)
        object.__setattr__(self, "turns_deg", turns)

    @property
    def n_views(self) -> int:
        """Number of positions times turns."""
        return len(self.x_mm) * len(self.y_mm) * max(1, len(self.turns_deg))

    @property
    def turn_ranges_deg(self) -> tuple[tuple[float, float], ...]:
        """Least and greatest w, p and r of the turns, degrees."""
        w, p, r = zip(*(self.turns_deg or _NO_TURNS), strict=True)
        return (min(w), max(w)), (min(p), max(p)), (min(r), max(r))

    def placements(self) -> Iterator[tuple[str, RigidTransform]]:
        """Yield each view's name, and the reference feature's position and turn there."""
        turns = self.turns_deg or _NO_TURNS
        numbered = [(f"-t{k}" if len(turns) > 1 else "", turn) for k, turn in enumerate(turns, 1)]
        for j, y in enumerate(self.y_mm, start=1):
            for i, x in enumerate(self.x_mm, start=1):
                for suffix, turn in numbered:
                    placement = RigidTransform.from_fanuc_wpr((x, y, self.z_tcp_mm), *turn)
                    yield f"{self.name}-x{i}-y{j}{suffix}", placement


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
    w_deg, p_deg, r_deg : (float, float), degrees
        Least and greatest turn about the reference feature, drawn evenly too; none by default.

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
    w_deg: tuple[float, float] = (0.0, 0.0)
    p_deg: tuple[float, float] = (0.0, 0.0)
    r_deg: tuple[float, float] = (0.0, 0.0)

    def __post_init__(self) -> None:
        check_name(self.name)
        place = f"random positions {self.name!r}"
        if not 1 <= self.count <= 9999:
            msg = f"{place}: count must be from 1 to 9999, got {self.count}"
            raise InputError(msg)
        for axis in ("x_mm", "y_mm", "z_tcp_mm", *TURN_AXES):
            limits = tuple(map(float, getattr(self, axis)))
            if axis not in TURN_AXES or len(set(limits)) > 1:  # one angle is a range, too
                limits = _numbers(limits, f"{place}: {axis}")
            if len(limits) != 2 or not -math.inf < limits[0] <= limits[1] < math.inf:
                msg = (
                    f"{place}: {axis} needs two numbers, the lower one first, got {_listed(limits)}"
                )
                raise InputError(msg)
            object.__setattr__(self, axis, limits)
        object.__setattr__(self, "exposures_ms", check_exposures(self.exposures_ms, place))

    @property
    def n_views(self) -> int:
        """Number of positions."""
        return self.count

    @property
    def turn_ranges_deg(self) -> tuple[tuple[float, float], ...]:
        """Least and greatest w, p and r of the turns, degrees."""
        return self.w_deg, self.p_deg, self.r_deg

    def names(self) -> tuple[str, ...]:
        """Return the views' names."""
        return numbered_names(self.name, self.count)

    def draws(self, view: str, seed: int) -> Iterator[RigidTransform]:
        """Yield one position and turn of the reference feature after the other, without end.

        Parameters
        ----------
        view : str
            One of the names.
        seed : int, 0 or more
            The plan's seed.
        """
        positions, turns = (
            np.random.default_rng([*view_seed(seed, view), purpose])
            for purpose in (_POSITION, _TURN)
        )
        boxes = [
            np.array([getattr(self, axis) for axis in axes]).T
            for axes in (("x_mm", "y_mm", "z_tcp_mm"), TURN_AXES)
        ]
        while True:
            position_mm = positions.uniform(*boxes[0])
            yield RigidTransform.from_fanuc_wpr(position_mm, *turns.uniform(*boxes[1]))


def check_name(name: str) -> None:
    """Check the name of a plan or a group of views, after which views, folders and cells are named.

    Raises
    ------
    InputError
        If it is empty, has blanks at its ends or control characters.
    """
    check_plain(name, "the plan or group of views", InputError)
    if not name.strip() or name != name.strip():
        msg = f"plans and planes need names without blanks at their ends, got {name!r}"
        raise InputError(msg)


def numbered_names(name: str, count: int) -> tuple[str, ...]:
    """Return the names of a group's views: its name and numbers of equal width."""
    digits = max(2, len(str(count)))
    return tuple(f"{name}-{i:0{digits}d}" for i in range(1, count + 1))


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


def check_exposures(values: Sequence[float], place: str) -> tuple[float, ...]:
    """Check a list of exposure times in ms, and return it.

    Raises
    ------
    InputError
        If it is empty, one appears twice, or is not above 0 and up to an hour. The message begins
        with the place.
    """
    exposures = _numbers(values, f"{place}: exposures_ms")
    if min(exposures) < _SHORTEST_MS:
        msg = f"{place}: exposures_ms must all be above 0 ms, got {min(exposures):g}"
        raise InputError(msg)
    if max(exposures) > _LONGEST_MS:
        msg = (
            f"{place}: exposures_ms must be up to an hour, {_LONGEST_MS:g}, got {max(exposures):g}"
        )
        raise InputError(msg)
    return exposures


def _listed(numbers: Sequence[float]) -> str:
    return "[" + ", ".join(f"{number:g}" for number in numbers) + "]"
