"""Where on a part which finish is: by name, by the colour of triangles, and in boxes and balls."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, fields, is_dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from exposight.compiled import njit
from exposight.errors import InputError, did_you_mean
from exposight.files import check_plain
from exposight.twin.part.surfaces import SURFACES, Surface

Point = tuple[float, float, float]


@dataclass(frozen=True, kw_only=True)
class Zone:
    """A box or a ball in which the part has another finish: a spot of oil, tape, spray.

    It ends where it says, also in the middle of a triangle.

    Parameters
    ----------
    finish : str
        The finish of all that lies in it.
    box_mm : ((float, float, float), (float, float, float)), optional
        Least and greatest x, y and z in the part's frame.
    centre_mm, radius_mm : (float, float, float) and float, optional
        In place of a box: a ball.

    Raises
    ------
    InputError
        If it is not one of both, or holds nothing.
    """

    finish: str
    box_mm: tuple[Point, Point] | None = None
    centre_mm: Point | None = None
    radius_mm: float | None = None

    def __post_init__(self) -> None:
        ball = (self.centre_mm, self.radius_mm)
        if (self.box_mm is None) == (None in ball) or (self.box_mm and ball != (None, None)):
            msg = (
                "a zone needs either box_mm = [[x, y, z], [x, y, z]] or centre_mm and radius_mm, "
                f"got {self}"
            )
            raise InputError(msg)
        numbers = [n for corner in (*(self.box_mm or ()), self.centre_mm or ()) for n in corner]
        least, greatest = self.box_mm or ((0.0,), (1.0,))
        if (
            not all(map(math.isfinite, (*numbers, self.radius_mm or 0.0)))
            or not all(a < b for a, b in zip(least, greatest, strict=True))
            or not (self.radius_mm is None or self.radius_mm > 0)
        ):
            msg = (
                "a zone needs a box from its least to its greatest x, y and z, or a radius above "
                f"0, got {self}"
            )
            raise InputError(msg)


@dataclass(frozen=True, kw_only=True)
class Finishes:
    """What a document says about the finish of a part; what comes later here goes over the rest.

    Parameters
    ----------
    surfaces : mapping of str to Surface
        Further finishes, or others in place of those with the same names.
    finish : str, optional
        Of the whole part, in place of what its mesh says.
    colours : mapping of str to str
        Finish of the triangles that have a colour, as ``{"#1e90ff": "paint"}``.
    zones : tuple of Zone
        The last one counts where several overlap.

    Raises
    ------
    InputError
        If a colour is not written as ``#rrggbb``, or a surface's name has control characters.
    """

    surfaces: Mapping[str, Surface] = field(default_factory=dict, hash=False)
    finish: str | None = None
    colours: Mapping[str, str] = field(default_factory=dict, hash=False)
    zones: tuple[Zone, ...] = ()

    def __post_init__(self) -> None:
        for name in self.surfaces:
            check_plain(name, "the surface", InputError)
        for colour in self.colours:
            if not re.fullmatch("#[0-9a-fA-F]{6}", colour):
                msg = (
                    f"expected a triangle's colour as '#rrggbb', such as '#1e90ff', got {colour!r}"
                )
                raise InputError(msg)

    def check_names(self, surfaces: Mapping[str, Surface] = SURFACES) -> dict[str, Surface]:
        """Return these surfaces and the document's own, in this order.

        Parameters
        ----------
        surfaces : mapping of str to Surface
            Those that are known without the document.

        Raises
        ------
        InputError
            If the document names a finish that none of them is.
        """
        known = {**surfaces, **self.surfaces}
        named = [self.finish, *self.colours.values(), *(zone.finish for zone in self.zones)]
        for name in named:
            if name is not None and name not in known:
                msg = (
                    f"finish {name!r} is not known{did_you_mean(name, known)}; expected one of "
                    f"{', '.join(known)}, or one that the table 'surfaces' describes"
                )
                raise InputError(msg)
        return known

    def of_faces(
        self,
        face_finish: NDArray[np.uint8],
        surfaces: Mapping[str, Surface] = SURFACES,
        face_colours: NDArray[np.uint8] | None = None,
        n_part_faces: int | None = None,
    ) -> tuple[NDArray[np.uint8], dict[str, Surface]]:
        """Return the finish of triangles, and the surfaces whose numbers those are.

        Parameters
        ----------
        face_finish : (m,) ndarray of uint8
            What the mesh says: indices into `surfaces`.
        surfaces : mapping of str to Surface
            Those that are known without the document.
        face_colours : (m, 3 or 4) ndarray of uint8, optional
            Red, green and blue of the triangles.
        n_part_faces : int, optional
            So many triangles from the first on are the part, all by default; the others, which are
            obstacles, keep their finish unless their colour has one.

        Raises
        ------
        InputError
            If a finish is not known, or no triangle has a colour that is named.
        """
        known = self.check_names(surfaces)
        numbers = {name: number for number, name in enumerate(known)}
        result = np.array(face_finish)
        if self.finish is not None:
            result[:n_part_faces] = numbers[self.finish]
        if not self.colours:
            return result, known
        if face_colours is None:
            msg = "colours name finishes, and the triangles of the mesh have no colours"
            raise InputError(msg)
        red, green, blue = np.asarray(face_colours, dtype=np.int64)[:, :3].T
        coded = (red << 16) | (green << 8) | blue
        for colour, name in self.colours.items():
            mask = coded == int(colour[1:], 16)
            if not mask.any():
                there = [f"#{code:06x}" for code in np.unique(coded)]
                more = f" and {len(there) - 8} more" if len(there) > 8 else ""
                msg = (
                    f"no triangle has the colour {colour!r}{did_you_mean(colour, there)}; the "
                    f"mesh has {', '.join(there[:8])}{more}"
                )
                raise InputError(msg)
            result[mask] = numbers[name]
        return result, known

    def table(self) -> dict[str, Any]:
        """Return what differs from the default, as a TOML or JSON document has it."""
        return {key: value for key, value in _plain(self).items() if value}


def _plain(value: Any) -> Any:
    if is_dataclass(value):
        values = {
            entry.name: (getattr(value, entry.name), entry.default) for entry in fields(value)
        }
        return {name: _plain(got) for name, (got, default) in values.items() if got != default}
    if isinstance(value, Mapping):
        return {key: _plain(item) for key, item in value.items()}
    return list(map(_plain, value)) if isinstance(value, tuple) else value


def zone_table(zones: Iterable[Zone], surfaces: Iterable[str]) -> NDArray[np.float64]:
    """Pack zones for compiled loops: finish, squared radius or −1, and two corners or a centre.

    Parameters
    ----------
    zones : iterable of Zone
        In the document's order.
    surfaces : iterable of str
        The scene's finishes in their order.

    Returns
    -------
    (k, 8) ndarray
        The last zone first.
    """
    numbers = {name: number for number, name in enumerate(surfaces)}
    rows = []
    for zone in zones:
        if zone.box_mm is not None:
            rows.append((numbers[zone.finish], -1.0, *zone.box_mm[0], *zone.box_mm[1]))
        elif zone.centre_mm is not None and zone.radius_mm is not None:
            rows.append((numbers[zone.finish], zone.radius_mm**2, *zone.centre_mm, 0.0, 0.0, 0.0))
    return np.array(rows[::-1], dtype=np.float64).reshape(-1, 8)


@njit(error_model="numpy")
def finish_at(zones: NDArray[np.float64], point_mm: Point, otherwise: int) -> int:
    """Return the number of the finish at a point of the part.

    Parameters
    ----------
    zones : (k, 8) ndarray
        `zone_table`.
    point_mm : (float, float, float), mm
        In the part's frame.
    otherwise : int
        The number outside all zones.
    """
    x, y, z = point_mm
    for i in range(len(zones)):
        zone = zones[i]
        if zone[1] < 0.0:
            inside = zone[2] <= x <= zone[5] and zone[3] <= y <= zone[6] and zone[4] <= z <= zone[7]
        else:
            dx, dy, dz = x - zone[2], y - zone[3], z - zone[4]
            inside = dx * dx + dy * dy + dz * dz <= zone[1]
        if inside:
            return int(zone[0])
    return int(otherwise)
