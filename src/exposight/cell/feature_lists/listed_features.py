"""What all readers of lists of features share: a feature from its row, faults all at once."""

import math
from collections import defaultdict
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import cast

import numpy as np
from numpy.typing import NDArray

from exposight.cell.part import RULES, Feature, FeatureKind
from exposight.errors import ExposightError, FeatureError
from exposight.files.text_tables.written_numbers import stand_ins
from exposight.geometry import RigidTransform, rotation_facing

_NORMAL_TOLERANCE = 0.05
"""How far a normal's length may be from 1: normals printed with one decimal are off by up to 4 %,
while positions taken for normals are off by far more."""

_DIRECTION_TOLERANCE_DEG = 5.0
"""How far the direction of the length may leave the feature's plane; what leaves it is dropped."""

_SHOWN = 10
"""Faults of a list that are told one by one."""


def listed_feature(
    *,
    name: str,
    kind: str,
    place_mm: NDArray[np.float64],
    normal: NDArray[np.float64],
    direction: NDArray[np.float64] | None,
    radius_mm: float,
    length_mm: float | None,
    width_mm: float | None,
    finish: str = "",
) -> Feature:
    """Return the feature that an entry of a list describes.

    Parameters
    ----------
    name, kind, radius_mm, length_mm, width_mm, finish
        As of `Feature`.
    place_mm : (3,) ndarray
    normal : (3,) ndarray
        Outward surface normal.
    direction : (3,) ndarray or None
        Of the length, in the surface.

    Raises
    ------
    FeatureError
        If there is no such kind, the normal is not of length 1, the direction is missing or leaves
        the surface, or sizes make no sense.
    """
    known = cast("FeatureKind", kind)
    if known not in RULES:
        msg = f"the kind must be one of {', '.join(RULES)}, or a word for it, got {kind!r}"
        raise FeatureError(msg)
    rotation = _rotation(normal, direction, needed_by=kind if RULES[known].has_length else "")
    return Feature(
        name=name,
        kind=known,
        part_from_feature=RigidTransform(rotation=rotation, translation_mm=place_mm),
        radius_mm=radius_mm,
        length_mm=length_mm,
        width_mm=width_mm,
        finish=finish,
    )


def _rotation(
    normal: NDArray[np.float64], direction: NDArray[np.float64] | None, *, needed_by: str
) -> NDArray[np.float64]:
    """Return the (3, 3) orientation of a feature, part_from_feature."""
    length = float(np.linalg.norm(normal))
    if not abs(length - 1) <= _NORMAL_TOLERANCE:
        msg = f"the outward normal (nx, ny, nz) must have length 1, got {length:g}"
        raise FeatureError(msg)
    if direction is None:
        if needed_by:
            msg = f"a {needed_by} needs the direction of its length in the columns tx, ty, tz"
            raise FeatureError(msg)
        return rotation_facing(-normal)
    span = float(np.linalg.norm(direction))
    out_of_plane = abs(float(direction @ normal)) / length
    if not span > 0 or out_of_plane > span * math.sin(math.radians(_DIRECTION_TOLERANCE_DEG)):
        msg = (
            "the direction (tx, ty, tz) must lie in the surface, at right angles to the normal, "
            f"got {direction.tolist()} for normal {normal.tolist()}"
        )
        raise FeatureError(msg)
    return rotation_facing(-normal, direction)


def left_out(counts: Mapping[str, int]) -> str:
    """Return how many entries of which kinds were not read."""
    return ", ".join(f"{n} {what}" for what, n in counts.items())


class ListFaults:
    """What is wrong with a list's features, told all at once.

    Parameters
    ----------
    path : Path
        The list, for messages.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._faults: list[tuple[str, type[ExposightError]]] = []

    def add(self, where: str, error: ExposightError) -> None:
        """Keep the fault of a row."""
        self._faults.append((f"{where}: {error}", type(error)))

    def add_stand_ins(
        self, columns: Mapping[str, NDArray[np.float64]], where: Sequence[str]
    ) -> None:
        """Keep numbers such as -999 that stand for a missing one, of rows called as in `where`."""
        for name, values in columns.items():
            for row in np.flatnonzero(stand_ins(values)):
                text = (
                    f"{where[row]}: {name} {values[row]:g} seems to stand for a missing value; "
                    "give the value, or leave the row out"
                )
                self._faults.append((text, FeatureError))

    def add_repeated(self, names: Sequence[str], rows: Sequence[int]) -> None:
        """Keep the names that several rows share."""
        places = defaultdict(list)
        for name, row in zip(names, rows, strict=True):
            places[name].append(row)
        for name, found in places.items():
            if len(found) > 1 and name:
                times = "twice" if len(found) == 2 else f"{len(found)} times"
                listed = f"{', '.join(map(str, found[:-1]))} and {found[-1]}"
                text = (
                    f"feature {name!r} is there {times}, in the rows {listed}; give every feature "
                    "a unique name"
                )
                self._faults.append((text, FeatureError))

    def settle(self) -> None:
        """Raise an error with the first ten faults and their number, if there are any."""
        if not self._faults:
            return
        more = len(self._faults) - _SHOWN
        mark = "," if self._faults[0][0].startswith("row") else ":"
        msg = f"{self._path}{mark} {'; '.join(text for text, _ in self._faults[:_SHOWN])}"
        if more > 0:
            msg += f"; and {more} more faults, {len(self._faults)} in all"
        raise self._faults[0][1](msg)
