"""Rows of an observation table against what can be observed, wherever the table was made."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from exposight.contradictions.contradiction import Contradiction
from exposight.contradictions.rings import too_many_points

EXPOSURE_UNIT = "exposure-unit"

_SHORTEST_MS, _LONGEST_MS = 0.02, 20_000.0
"""Exposure times between which sensors of structured light take all of a sweep."""
_UNITS = (("s", 1e3, "multiply"), ("µs", 1e-3, "divide"))


def row_contradictions(
    p_norm: NDArray[np.float64],
    n_pixels: NDArray[np.float64],
    exposure_ms: NDArray[np.float64],
    names: Sequence[str],
) -> tuple[Contradiction, ...]:
    """Hold the rows of a table against what can be observed.

    Parameters
    ----------
    p_norm, n_pixels, exposure_ms : (n,) ndarray
        Points over pixels, pixels of the ring, exposure time in ms; NaN where not known.
    names : sequence of str
        Of the features.
    """
    found = (too_many_points(p_norm, n_pixels, names), exposure_unit(exposure_ms))
    return tuple(each for each in found if each is not None)


def exposure_unit(
    exposure_ms: NDArray[np.float64], limits_ms: tuple[float, float] | None = None
) -> Contradiction | None:
    """Check that exposure times are in ms.

    Parameters
    ----------
    exposure_ms : (n,) ndarray, ms
        Of a table's rows.
    limits_ms : (float, float), ms, optional
        The sensor's shortest and longest exposure time: where all times lie outside it is an
        error. Without them a warning tells of times that hardly any sensor takes.
    """
    times = exposure_ms[np.isfinite(exposure_ms)]
    if not times.size:
        return None
    low, high = float(times.min()), float(times.max())
    slack = 1e-6
    shortest, longest = limits_ms or (_SHORTEST_MS, _LONGEST_MS)
    outside = (times < shortest * (1 - slack)) | (times > longest * (1 + slack))
    if limits_ms is None and not (high < shortest or low > longest):
        return None
    if not outside.any():
        return None
    meant = next(
        (
            f"are they in {unit}? {verb} them by 1000"
            for unit, scale, verb in _UNITS
            if shortest <= low * scale * (1 + slack) and high * scale <= longest * (1 + slack)
        ),
        "check their unit, and the sensor",
    )
    whose = "those that the sensor takes" if limits_ms else "those that sensors take"
    return Contradiction(
        check=EXPOSURE_UNIT,
        compared=f"the table's exposure times against {whose}",
        found=(
            f"{int(outside.sum())} of {times.size} rows have other times ({low:.4g} to {high:.4g} "
            f"ms) than {shortest:g} to {longest:g} ms"
        ),
        explanation=meant,
        is_error=limits_ms is not None and bool(outside.all()),
    )
