"""Units of written poses: what their notation has, and what a reading says instead."""

import math
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from exposight.errors import AmbiguousError, PoseError
from exposight.files import current_reading

UNIT_MM: Mapping[str, float] = {"mm": 1.0, "cm": 10.0, "m": 1000.0, "inch": 25.4}

_MOST_M = 10.0
"""No robot's arm reaches farther: such a position is in mm."""


def checked_metres(position_m: Sequence[float], what: str) -> NDArray[np.float64]:
    """Return a position in m, within a robot's reach.

    Raises
    ------
    AmbiguousError
        If it is not, and can only be in mm.
    """
    position = np.asarray(position_m, dtype=np.float64)
    if float(np.abs(position).max()) > _MOST_M:
        msg = (
            f"{what} has its position in m, and {float(np.abs(position).max()):g} m is out of any "
            "robot's reach: if it is in mm, say so: --read-as unit=mm"
        )
        raise AmbiguousError(msg, ("unit=mm",))
    return position


def metres_of(position: Sequence[float]) -> list[float]:
    """Return a position that is in m unless `Reading.unit` says that it is in mm."""
    scale = 0.001 if current_reading().unit == "mm" else 1.0
    return [scale * number for number in position]


def radians_of(angles: Sequence[float]) -> list[float]:
    """Return angles that are in rad unless `Reading.angle` says otherwise."""
    turn = math.pi / 180.0 if current_reading().angle == "deg" else 1.0
    return [turn * angle for angle in angles]


def degrees_of(angles: Sequence[float]) -> list[float]:
    """Return angles that are in degrees unless `Reading.angle` says otherwise."""
    turn = 180.0 / math.pi if current_reading().angle == "rad" else 1.0
    return [turn * angle for angle in angles]


def angle_remark(angles: Sequence[float]) -> str:
    """Return `radians_remark` of angles whose unit nobody said."""
    return "" if current_reading().angle is not None else radians_remark(angles)


def radians_remark(angles_deg: Sequence[float]) -> str:
    """Return what to check where angles in degrees look like radians; empty where they do not."""
    whole = all(float(angle).is_integer() for angle in angles_deg)
    if whole or max(map(abs, angles_deg)) > 2 * math.pi:
        return ""
    return "no angle is beyond ±2π, yet they are read as degrees (radians: --read-as angle=rad)"


def vector_radians(vector: Sequence[float]) -> NDArray[np.float64]:
    """Return a rotation vector that turns by one full turn at most, rad.

    Raises
    ------
    PoseError
        If it turns by more.
    """
    checked = np.asarray(vector, dtype=np.float64)
    turn = float(np.linalg.norm(checked))
    if turn > 2.0 * math.pi + 1e-6:
        msg = (
            f"a rotation vector of length {turn:g} turns by more than 2π; it is in radians: "
            "multiply degrees by π/180 (--read-as angle=deg)"
        )
        raise PoseError(msg)
    return checked
