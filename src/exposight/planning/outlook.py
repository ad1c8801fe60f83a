"""What becomes of each feature if some captures of a view are taken, and why one fails."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from exposight.planning.capture_chances import CaptureChances
from exposight.planning.exposure_limits import ExposureLimits
from exposight.tables import number

FloatArray: TypeAlias = NDArray[np.float64]

Status = Literal["planned", "best effort", "not planned"]

WORTH_TRYING = 0.5
"""A feature that cannot reach the confidence is tried where it is more likely than not."""

MOST_CAPTURES = 12
"""Captures of a view, where its sensor sets no limit."""


@dataclass(frozen=True, kw_only=True)
class PlannedExposure:
    """One capture of a view.

    Parameters
    ----------
    exposure_ms : float, ms
        Exposure time.
    set_value, set_unit : float, str
        The same as the sensor is set to it.
    order : int
        Which of the view's captures it is, from 1.
    covers : tuple of str
        Features that this capture serves best.
    """

    exposure_ms: float
    set_value: float
    set_unit: str
    order: int
    covers: tuple[str, ...]


@dataclass(frozen=True, kw_only=True)
class FeatureOutlook:
    """What is planned for a feature, and how sure it is.

    Parameters
    ----------
    feature : str
    status : {"planned", "best effort", "not planned"}
        Whether it reaches the confidence; is tried though it does not; or cannot be had.
    chance : float
        That at least one of the captures serves it.
    view : str or None
        The view whose captures serve it.
    exposure_ms : float or None, ms
        The capture that serves it best.
    window_ms : (float, float) or None, ms
        Exposure times between which it is expected to reach the quality.
    reason : str
        Why it fails, or is not to be relied on; empty for one that is to succeed.
    """

    feature: str
    status: Status
    chance: float
    view: str | None = None
    exposure_ms: float | None = None
    window_ms: tuple[float, float] | None = None
    reason: str = ""


def targets_of(chances: CaptureChances, confidence: float) -> FloatArray:
    """Return the chance to plan for each feature, (n,): 0 where it is not worth trying.

    The confidence where all settings together reach it; otherwise 95 % of what the best single
    capture gives, if that is more likely than not.
    """
    best = chances.chance.max(axis=1)
    possible = np.maximum(chances.any_of(range(len(chances.settings_ms))), best)
    second_best = np.where(best >= WORTH_TRYING, 0.95 * best, 0.0)
    return np.where(possible >= confidence, confidence, np.minimum(second_best, confidence))


def planned_exposures(
    chances: CaptureChances, places: Sequence[int], limits: ExposureLimits
) -> tuple[PlannedExposure, ...]:
    """Return captures in the order in which they are taken.

    Ascending; where a sensor keeps the lowest-numbered one that sees a point, the surest first.
    """
    if not places:
        return ()
    chosen = chances.chance[:, list(places)]
    best = chosen.argmax(axis=1)
    serves = [
        tuple(
            name
            for name, place, chance in zip(chances.features, best, chosen, strict=True)
            if place == i and chance[i] >= WORTH_TRYING
        )
        for i in range(len(places))
    ]
    order = list(range(len(places)))
    if limits.lowest_wins:
        order.sort(key=lambda i: -float(chosen[:, i].sum()))
    times = [float(chances.settings_ms[places[i]]) for i in order]
    return tuple(
        PlannedExposure(
            exposure_ms=exposure_ms,
            set_value=limits.set_value(exposure_ms),
            set_unit=limits.unit,
            order=number,
            covers=serves[i],
        )
        for number, (i, exposure_ms) in enumerate(zip(order, times, strict=True), start=1)
    )


def outlook_of(
    chances: CaptureChances,
    places: Sequence[int],
    targets: FloatArray,
    confidence: float,
    limits: ExposureLimits,
) -> tuple[FeatureOutlook, ...]:
    """Return what becomes of each feature if these captures are taken."""
    total = chances.any_of(places)
    out = []
    for i, name in enumerate(chances.features):
        reached = bool(total[i] >= confidence - 1e-9)
        least = targets[i] if 0.0 < targets[i] < WORTH_TRYING else WORTH_TRYING
        tried = len(places) > 0 and bool(total[i] >= least - 1e-9)
        status: Status = "planned" if reached else "best effort" if tried else "not planned"
        single = chances.chance[i, list(places)]
        low, high = chances.windows_ms[i].tolist()
        served = status != "not planned"
        out.append(
            FeatureOutlook(
                feature=name,
                status=status,
                chance=float(total[i]),
                view=chances.view if served else None,
                exposure_ms=float(chances.settings_ms[places[int(single.argmax())]])
                if served
                else None,
                window_ms=(low, high) if np.isfinite([low, high]).all() else None,
                reason=chances.reasons[i]
                or ("" if reached else why_not(chances, i, limits, targets[i] >= confidence)),
            )
        )
    return tuple(out)


def why_not(chances: CaptureChances, i: int, limits: ExposureLimits, possible: bool) -> str:
    """Return why a feature does not reach the confidence.

    Parameters
    ----------
    chances : CaptureChances
        Of its view.
    i : int
        Its place.
    limits : ExposureLimits
        What the sensor can be set to.
    possible : bool
        Whether more captures would help.
    """
    if possible:
        most = limits.most_per_view or MOST_CAPTURES
        return f"needs more captures than the {most} that a view may have"
    low, high = chances.windows_ms[i].tolist()
    best = float(chances.chance[i].max())
    at = f"at best {100 * best:.0f} %, at {number(_best_ms(chances, i), 3)} ms"
    if not np.isfinite([low, high]).all():
        if chances.never and chances.never[i]:
            return chances.never[i]
        return f"not sure enough at any exposure time: {at}"
    if low > limits.max_ms:
        return (
            f"too dark: needs {number(low, 3)} ms or more, the sensor's longest is "
            f"{number(limits.max_ms)} ms"
        )
    if high < limits.min_ms:
        return (
            f"too bright: clips from {number(high, 3)} ms on, the sensor's shortest is "
            f"{number(limits.min_ms)} ms"
        )
    window = f"{number(low, 3)}–{number(high, 3)} ms"
    return limits.why_none(low, high) or f"its window of {window} is too narrow to be sure: {at}"


def _best_ms(chances: CaptureChances, i: int) -> float:
    """Return the middle of the settings that serve a feature best."""
    best = np.flatnonzero(chances.chance[i] >= chances.chance[i].max() - 1e-6)
    return float(chances.settings_ms[best[len(best) // 2]])
