"""Where a sensor's devices stand, against what stands there: lengths in the wrong unit."""

import math

from exposight.contradictions.contradiction import Contradiction

BASELINE = "baseline"

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


def _length(mm: float) -> str:
    return f"{mm:.3g} mm" if mm < 1000.0 else f"{mm:,.0f} mm".replace(",", " ")
