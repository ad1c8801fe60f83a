"""Where a pose puts the part, against what the sensor sees and measures."""

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from exposight.contradictions.contradiction import Contradiction

OUT_OF_VIEW, OUT_OF_REACH = "part-out-of-view", "part-out-of-reach"

_MOST_READINGS = 3
_BEYOND = 2.0
"""Working distances are given for accuracy; up to half and twice of them sensors still measure."""


def out_of_view(
    reasons: Mapping[str, int], readings: Sequence[str], *, view: str = ""
) -> Contradiction | None:
    """Check that a pose puts a feature in view, where another reading of it does.

    Parameters
    ----------
    reasons : mapping of str to int
        How many features are visible, behind the camera, out of frame, …
    readings : sequence of str
        Readings of the pose that put features in view.
    view : str
        Name of the view, for people.

    Returns
    -------
    Contradiction or None
        None where a feature is visible, or nothing explains that none is: a view from behind sees
        none.
    """
    if reasons.get("visible", 0) or not readings:
        return None
    counts = ", ".join(f"{count} {reason}" for reason, count in reasons.items() if count)
    return Contradiction(
        check=OUT_OF_VIEW,
        compared="where the pose puts the part, against what the sensor sees",
        found=f"{f'in view {view!r} ' if view else ''}no feature is visible ({counts})",
        explanation=would_put(readings, "in view"),
        is_error=False,
    )


def would_put(readings: Sequence[str], where: str) -> str:
    """Return the words of readings that would put the part somewhere; empty without any."""
    if not readings:
        return ""
    return f"{' or '.join(readings[:_MOST_READINGS])} would put the part {where}"


def out_of_reach(
    distance_mm: NDArray[np.float64],
    working_distance_mm: tuple[float, float],
    readings: Sequence[str],
) -> Contradiction | None:
    """Check that features are where the sensor can measure.

    Parameters
    ----------
    distance_mm : (n,) ndarray, mm
        Of the visible features along the camera's axis.
    working_distance_mm : (float, float), mm
        Nearest and farthest of the sensor.
    readings : sequence of str
        Readings of the pose that put them within it.
    """
    near, far = working_distance_mm
    if distance_mm.size == 0:
        return None
    inside = (distance_mm >= near / _BEYOND) & (distance_mm <= far * _BEYOND)
    if inside.any():
        return None
    return Contradiction(
        check=OUT_OF_REACH,
        compared="the distance at which the pose puts the part, against the sensor's",
        found=f"{float(np.median(distance_mm)):.4g} mm, and it measures {near:g} to {far:g} mm",
        explanation=would_put(readings, "there")
        or "is the pose that of the part seen from the camera, in mm?",
        is_error=bool(readings),
    )
