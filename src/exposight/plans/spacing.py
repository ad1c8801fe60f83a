"""The spacing of a design of experiments: positions evenly, exposure times by equal ratios."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from exposight.cell import ActiveSensor


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
