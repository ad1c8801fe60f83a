"""Where a sensor's devices stand, against what stands there: lengths in the wrong unit."""

import math

import numpy as np
from numpy.typing import NDArray

from exposight.contradictions.contradiction import Contradiction

BASELINE, CROSSING = "baseline", "axes-crossing"

_CLOSEST_MM = 2.0
"""No lenses stand nearer to each other: the smallest stereo modules have baselines of 10 mm."""
_FARTHEST_MM = 10_000.0
"""A triangulating sensor wider than this would not fit round a machine; buildings are surveyed."""
_LEAST_RATIO = 1.0 / 500.0
"""Of baseline to distance: at 1:500 a disparity of 0.1 px is a depth error of half a percent of the
distance, more than any sensor is sold with."""


def baseline(
    distance_mm: float, what: str, working_distance_mm: tuple[float, float] | None = None
) -> Contradiction | None:
    """Check how far apart two devices stand.

    Parameters
    ----------
    distance_mm : float, mm
        Between their centres of projection.
    what : str
        Which devices: "camera and projector", say, with the file that holds them.
    working_distance_mm : (float, float), mm, optional
        From where to where the sensor measures.
    """
    compared = f"the distance between {what}, against what can be built"
    found = f"{_length(distance_mm)} apart"
    if not distance_mm > 0.0:
        return Contradiction(
            check=BASELINE,
            compared=compared,
            found=f"{found}: no depth can be triangulated",
            explanation="give the translation between them",
        )
    for scale, unit in ((1000.0, "m"), (0.001, "µm")):
        limit = _CLOSEST_MM if scale > 1 else _FARTHEST_MM
        if (distance_mm < limit) == (scale > 1):
            read = distance_mm * scale
            plausible = _CLOSEST_MM <= read <= _FARTHEST_MM
            how = f"multiply it by {scale:g}" if scale > 1 else "divide it by 1000"
            return Contradiction(
                check=BASELINE,
                compared=compared,
                found=f"{found}, which cannot be",
                explanation=f"is the translation in {unit}? {how} ({_length(read)})"
                if plausible
                else "check the translation and its unit, mm",
            )
    if working_distance_mm is not None:
        middle = math.sqrt(working_distance_mm[0] * working_distance_mm[1])
        if distance_mm < _LEAST_RATIO * middle:
            return Contradiction(
                check=BASELINE,
                compared=compared,
                found=f"{found} and measure at {_length(middle)}: too flat a triangle for depth",
                explanation="check the units of the translation and of the working distance, mm",
                is_error=False,
            )
    return None


_LEAST_ANGLE_DEG = 3.0
_BESIDE = 3.0
"""Devices are turned towards each other to measure where their axes cross, within this factor."""


def axes_crossing(
    rotation: NDArray[np.float64],
    translation_mm: NDArray[np.float64],
    what: str,
    working_distance_mm: tuple[float, float],
) -> Contradiction | None:
    """Check that two devices which are turned towards each other look where the sensor measures.

    Parameters
    ----------
    rotation, translation_mm : (3, 3) and (3,) ndarray
        Pose of the second device in the first one's frame, mm.
    what : str
        Which devices.
    working_distance_mm : (float, float), mm
        From where to where the sensor measures.
    """
    axis = rotation[:, 2]
    if np.degrees(np.arccos(np.clip(axis[2], -1.0, 1.0))) < _LEAST_ANGLE_DEG:
        return None
    # The point on the first axis that is nearest to the second one.
    across = np.array([0.0, 0.0, 1.0]) - axis[2] * axis
    crossing_mm = float(across @ translation_mm) / float(across[2])
    near, far = working_distance_mm
    if near / _BESIDE <= crossing_mm <= far * _BESIDE:
        return None
    compared = f"where the axes of {what} cross, against the working distance"
    if crossing_mm <= 0.0:
        return Contradiction(
            check=CROSSING,
            compared=compared,
            found="they cross behind the first",
            explanation="has the translation the wrong sign, or are rotation and translation those "
            "of the inverse pose?",
            is_error=False,
        )
    units = {"cm": 10.0, "inches": 25.4, "m": 1000.0, "µm": 0.001}
    fits = [unit for unit, mm in units.items() if near <= crossing_mm * mm <= far]
    return Contradiction(
        check=CROSSING,
        compared=compared,
        found=f"at {_length(crossing_mm)}, and it measures from {near:g} to {far:g} mm",
        explanation=f"is the translation in {fits[0]}?" if fits else "check the pose and its unit",
        is_error=False,
    )


def _length(mm: float) -> str:
    return f"{mm:.3g} mm" if mm < 1000.0 else f"{mm:,.0f} mm".replace(",", " ")
