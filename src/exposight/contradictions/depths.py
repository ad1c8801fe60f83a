"""Depth against the distances at which a sensor measures."""

import numpy as np
from numpy.typing import NDArray

from exposight.contradictions.contradiction import Contradiction

DEPTH_SCALE = "depth-scale"

DEPTH_SCALES_MM: tuple[float, ...] = (1.0, 0.1, 0.25, 0.125, 0.05, 0.01, 0.001, 10.0, 1000.0)
"""mm a step that depth cameras use: 1 mm is the most frequent, 1000 is a file in m."""

_SLACK = 1.25
"""Sensors measure a little outside what their data sheets say."""


def depth_scale(
    depth: NDArray[np.floating],
    scale_mm: float,
    working_distance_mm: tuple[float, float],
) -> Contradiction | None:
    """Check that some depth lies where the sensor measures.

    Parameters
    ----------
    depth : (n,) ndarray
        Steps as the file has them, of the pixels that have a depth.
    scale_mm : float, mm
        Of a step.
    working_distance_mm : (float, float), mm
        Nearest and farthest distance of the sensor.
    """
    if not depth.size or _share_within(depth, scale_mm, working_distance_mm) > 0.0:
        return None
    low, high = (float(each) * scale_mm for each in np.percentile(depth, [5, 95]))
    near_mm, far_mm = working_distance_mm
    fitting = fitting_scales(depth, working_distance_mm)
    return Contradiction(
        check=DEPTH_SCALE,
        compared="depth against the sensor's working distance",
        found=(
            f"at {scale_mm:g} mm a step depths are {low:.4g} to {high:.4g} mm, none of them within "
            f"{near_mm:g} to {far_mm:g} mm"
        ),
        explanation=f"{_scales_text(fitting)} mm a step would fit"
        if fitting
        else "check the scale and the sensor",
    )


def fitting_scales(
    depth: NDArray[np.floating], working_distance_mm: tuple[float, float]
) -> tuple[float, ...]:
    """Return the scales, of those that depth cameras use, that put most depths in the distance.

    Parameters
    ----------
    depth : (n,) ndarray
        Steps as the file has them, of the pixels that have a depth.
    working_distance_mm : (float, float), mm
        Nearest and farthest distance of the sensor.
    """
    return tuple(
        scale
        for scale in DEPTH_SCALES_MM
        if depth.size and _share_within(depth, scale, working_distance_mm, slack=1.0) > 0.5
    )


def _share_within(
    depth: NDArray[np.floating],
    scale_mm: float,
    working_distance_mm: tuple[float, float],
    slack: float = _SLACK,
) -> float:
    near_mm, far_mm = working_distance_mm
    mm = depth * scale_mm
    return float(np.mean((mm >= near_mm / slack) & (mm <= far_mm * slack)))


def _scales_text(scales: tuple[float, ...]) -> str:
    return " or ".join(f"{scale:g}" for scale in scales)
