"""Which exposures to take of one view, and which features will fail.

The fewest settings of the sensor that bring every feature that can be brought there to the
confidence asked; among the fewest the most robust, or the shortest. What cannot reach the
confidence is not dropped: it is served as well as may be, and its chance is said.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from numbers import Real
from typing import TypeAlias

import numpy as np
import polars as pl
from numpy.typing import NDArray

from exposight.errors import InputError
from exposight.planning.capture_chances import CaptureChances
from exposight.planning.exposure_limits import CaptureCosts, ExposureLimits
from exposight.planning.outlook import (
    MOST_CAPTURES,
    FeatureOutlook,
    PlannedExposure,
    outlook_of,
    planned_exposures,
    targets_of,
)
from exposight.planning.outlook_table import failures, outlook_frame, outlook_table
from exposight.planning.path_search import Path, Prefer, fewest_captures, most_served
from exposight.quantities import quantity
from exposight.tables import Table, counted, number

FloatArray: TypeAlias = NDArray[np.float64]

CONFIDENCE = 0.9
"""Chance that every feature shall have, unless another is asked for."""

_AS_GOOD = 1e-3
"""Chances that differ by less are taken as alike."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Recommendation:
    """The exposures to take of one view.

    Parameters
    ----------
    view : str
        The view's name.
    need, confidence : float
        Quality that is asked for, and the chance with which.
    limits : ExposureLimits
        What the sensor can be set to.
    costs : CaptureCosts
        What captures take.
    prefer : {"margin", "time"}
        Which of the fewest were chosen.
    exposures : tuple of PlannedExposure
        What to take, in order.
    features : tuple of FeatureOutlook
        What becomes of each feature that the view sees.
    hidden : mapping of str to str
        Features that it does not see, and why.
    proven : bool
        Whether it is proven that fewer captures do not bring as many features to the confidence.
    remarks : tuple of str
        What is odd about all of it.
    chances : CaptureChances
        What it was chosen by.
    target : str
        Column of the quality that is asked for.
    at_most : bool
        Whether lower is better, so that `need` is a limit.
    """

    view: str
    need: float
    confidence: float
    limits: ExposureLimits
    costs: CaptureCosts
    prefer: Prefer
    exposures: tuple[PlannedExposure, ...]
    features: tuple[FeatureOutlook, ...]
    proven: bool
    hidden: Mapping[str, str] = field(default_factory=dict)
    remarks: tuple[str, ...] = ()
    chances: CaptureChances = field(repr=False)
    target: str = "p_norm"
    at_most: bool = False

    @property
    def exposures_ms(self) -> tuple[float, ...]:
        """The exposure times, ms, in order."""
        return tuple(each.exposure_ms for each in self.exposures)

    @property
    def time_ms(self) -> float:
        """What the captures take, ms."""
        return float(sum(self.costs.capture_ms(each) for each in self.exposures_ms))

    @property
    def expected(self) -> float:
        """Number of features to expect."""
        return float(sum(each.chance for each in self.features))

    @property
    def expected_misses(self) -> float:
        """Number of features that are to be expected to fail."""
        return len(self.features) - self.expected

    @property
    def planned(self) -> tuple[FeatureOutlook, ...]:
        """Features that reach the confidence."""
        return tuple(each for each in self.features if each.status == "planned")

    @property
    def failing(self) -> tuple[FeatureOutlook, ...]:
        """Features that do not reach it."""
        return tuple(each for each in self.features if each.status != "planned")

    @property
    def verdict(self) -> str:
        """The answer in a sentence."""
        n = len(self.features)
        if not self.exposures:
            return f"take none: no exposure time serves any of {counted(n, 'feature')}"
        times = ", ".join(number(each) for each in self.exposures_ms)
        verb = "reach" if self.target == "p_norm" else "have"
        share = f"{len(self.planned)} of {counted(n, 'feature')} will {verb} {self.wish}"
        return (
            f"take {counted(len(self.exposures), 'exposure')}, {times} ms: {share} with a chance "
            f"of {100 * self.confidence:g} % or more"
        )

    @property
    def wish(self) -> str:
        """What is asked for, with its unit; of p_norm the number alone."""
        if self.target == "p_norm":
            return f"{self.need:g}"
        value = f"{number(self.need, 3)} {quantity(self.target).suffix}".strip()
        return f"{self.target} of {'at most' if self.at_most else 'at least'} {value}"

    @property
    def notes(self) -> tuple[str, ...]:
        """Who fails and why, reasons that are alike together; and remarks."""
        return (*failures(self.features, self.hidden), *self.remarks)

    @property
    def frame(self) -> pl.DataFrame:
        """A row for each feature: columns as in `FeatureOutlook`, the window's ends apart."""
        return outlook_frame(self.features)

    @property
    def table(self) -> Table:
        """The features, those that fail first."""
        return outlook_table(self.features, of_one_view=True)

    def __str__(self) -> str:
        return "\n".join((self.verdict, str(self.table), *self.notes))

    def _repr_html_(self) -> str:
        return f"<p>{self.verdict}</p>{self.table._repr_html_()}"


def check_confidence(confidence: float) -> float:
    """Return a confidence that lies between 0 and 1.

    Raises
    ------
    InputError
        If it does not.
    """
    if not (isinstance(confidence, Real) and 0.0 < confidence < 1.0):
        msg = f"confidence is a chance above 0 and below 1, such as 0.9, got {confidence!r}"
        raise InputError(msg)
    return float(confidence)


def recommend(
    chances: CaptureChances,
    limits: ExposureLimits,
    costs: CaptureCosts | None = None,
    *,
    confidence: float = CONFIDENCE,
    prefer: Prefer = "margin",
    hidden: Mapping[str, str] | None = None,
    remarks: Sequence[str] = (),
    target: str = "p_norm",
    at_most: bool = False,
) -> Recommendation:
    """Recommend the exposures of one view.

    Parameters
    ----------
    chances : CaptureChances
        At settings that `limits` allow.
    limits : ExposureLimits
        What the sensor can be set to.
    costs : CaptureCosts, optional
        What captures take; exposure time alone by default.
    confidence : float
        Chance that each feature shall have.
    prefer : {"margin", "time"}
        Among the fewest captures: those with the greatest least chance, or those that take least.
    hidden : mapping of str to str, optional
        Features that the view does not see, and why.
    remarks : sequence of str
        Of the forecast.
    target : str
        Column of the quality.
    at_most : bool
        Whether lower is better.

    Raises
    ------
    InputError
        If the confidence is not between 0 and 1, or there is no feature.
    """
    check_confidence(confidence)
    costs = costs or CaptureCosts()
    if not chances.features:
        msg = "there is no feature to recommend exposures for"
        raise InputError(msg)
    targets = targets_of(chances, confidence)
    path = chosen_path(chances, targets, limits, costs, prefer)
    outlook = outlook_of(chances, path.places, targets, confidence, limits)
    return Recommendation(
        view=chances.view,
        need=chances.need,
        confidence=confidence,
        limits=limits,
        costs=costs,
        prefer=prefer,
        exposures=planned_exposures(chances, path.places, limits),
        features=outlook,
        hidden=dict(hidden or {}),
        proven=path.proven,
        remarks=tuple(remarks),
        chances=chances,
        target=target,
        at_most=at_most,
    )


def chosen_path(
    chances: CaptureChances,
    targets: FloatArray,
    limits: ExposureLimits,
    costs: CaptureCosts,
    prefer: Prefer,
) -> Path:
    """Return the fewest captures that reach all targets; as good as may be where limits forbid."""
    if not (targets > 0.0).any():
        return Path((), proven=True)
    m = len(chances.settings_ms)
    least = min(limits.least_per_view, m)
    most = min(limits.most_per_view or MOST_CAPTURES, m)
    times = np.array([costs.capture_ms(each) for each in chances.settings_ms])
    path = fewest_captures(chances, targets, times, prefer=prefer, least=least, most=most)
    if path is None:
        return most_served(chances, targets, times, count=most)
    return path if prefer == "time" else Path(_centred(chances, path.places, targets), path.proven)


def _centred(
    chances: CaptureChances, places: tuple[int, ...], targets: FloatArray
) -> tuple[int, ...]:
    """Move settings to the middle of the windows that they serve, where chances are as good there.

    Far from the edges chances differ by less than a model can tell.
    """
    log_ms, least = np.log(chances.settings_ms), _least(chances, places, targets)
    best = chances.chance[:, list(places)].argmax(axis=1)
    for i in range(len(places)):
        ends = np.log(chances.windows_ms[(best == i) & (targets > 0.0)])
        ends = ends[np.isfinite(ends).all(axis=1)]
        if not len(ends):
            continue
        middle = 0.5 * (ends[:, 0].max() + ends[:, 1].min())
        moved = (*places[:i], int(np.abs(log_ms - middle).argmin()), *places[i + 1 :])
        if len({*moved}) == len(places) and _least(chances, moved, targets) >= least - _AS_GOOD:
            places = moved
    return tuple(sorted(places))


def _least(chances: CaptureChances, places: Sequence[int], targets: FloatArray) -> float:
    """Return the least chance of the features to be served; 0 where a target is missed."""
    total, asked = chances.any_of(places), targets > 0.0
    reached = bool((total[asked] >= targets[asked] - 1e-9).all())
    return float(total[asked].min()) if reached else 0.0
