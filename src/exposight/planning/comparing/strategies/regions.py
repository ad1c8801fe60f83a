"""Each feature's exposure scaled from the brightness of its region in a trial image.

Ensenso's ``AdjustExposureAndGain`` scales the exposure from the brightness of an area that the user
measured; Zhang, "Rapid and automatic optimal exposure control for digital fringe projection
technique", Optics and Lasers in Engineering 128 (2020), scales from a single image because
brightness is linear in time. With an interval of grey levels instead of one, the fewest exposures
follow.
"""

from __future__ import annotations

from itertools import product

from exposight.planning.comparing.strategies.contract import Method, Trial, register
from exposight.planning.comparing.strategies.region_light import middles, radiances
from exposight.planning.comparing.strategies.rehearsal import best_of

_FIRST_MS = (10.0, 30.0, 90.0)
_TARGETS = (40.0, 50.0, 60.0, 70.0, 80.0, 95.0)
_LOWEST, _HIGHEST = (16.0, 20.0, 25.0, 30.0), (70.0, 85.0, 100.0, 115.0)
"""Grey levels above black."""


def each_region(first_ms: float, target: float) -> Method:
    """Bring each feature to a grey level by an exposure of its own."""

    def measure(trial: Trial) -> None:
        trial.take_all(sorted(target / radiances(trial, first_ms)))

    return measure


def swept_regions(first_ms: float, low: float, high: float) -> Method:
    """Bring each feature between two grey levels, in the fewest exposures."""

    def measure(trial: Trial) -> None:
        value = radiances(trial, first_ms)
        trial.take_all(middles(trial, low / value, high / value))

    return measure


register(
    "each_region",
    "trial images; each feature's own exposure, scaled to a grey level",
    best_of(each_region, list(product(_FIRST_MS, _TARGETS))),
)
register(
    "swept_regions",
    "trial images; the fewest exposures between two grey levels",
    best_of(swept_regions, list(product(_FIRST_MS, _LOWEST, _HIGHEST))),
)
