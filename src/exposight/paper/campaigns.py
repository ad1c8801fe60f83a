"""The study's campaigns, and the plans by which they are simulated, in full or quickly."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final

from exposight.paper.datasets import DATASETS, TEST, TRAINING
from exposight.plans import plan_preset

if TYPE_CHECKING:
    from exposight.paper.result import SensorKind
    from exposight.plans import DepthPlane, MeasuringPlan, RandomPositions


@dataclass(frozen=True, kw_only=True)
class Campaign:
    """A campaign that the study needs.

    Parameters
    ----------
    name : str
        What the study calls it.
    sensor : {'structured-light', 'stereo'}
        Which sensor's.
    required : bool
        Whether a study of this sensor is impossible without it.
    """

    name: str
    sensor: SensorKind
    required: bool = False

    def features(self) -> tuple[str, ...]:
        """Return the features that the datasets take from it."""
        used = (name for own in DATASETS if self.name in own.campaigns for name in own.features)
        return tuple(dict.fromkeys(used))


CAMPAIGNS: Final = (
    Campaign(name="inside", sensor="structured-light", required=True),
    Campaign(name="finer", sensor="structured-light"),
    Campaign(name="lighting-1", sensor="structured-light"),
    Campaign(name="lighting-2", sensor="structured-light"),
    Campaign(name="lighting-3", sensor="structured-light"),
    Campaign(name="outside", sensor="structured-light"),
    Campaign(name="stereo-inside", sensor="stereo", required=True),
    Campaign(name="stereo-outside", sensor="stereo"),
)
"""All campaigns, in the order in which they are measured."""


def campaign_plan(campaign: Campaign, *, quick: bool) -> MeasuringPlan:
    """Return the measuring plan by which a campaign is simulated.

    Parameters
    ----------
    campaign : Campaign
        Which one.
    quick : bool
        Measure a share of the positions and exposure times: of ``finer`` every second x and y (9 of
        25 views), of ``stereo-inside`` every third x and y (30 of 240 views), of ``stereo-outside``
        three of six views, which together see all five features; of both every third exposure
        time. The other campaigns are measured in full.
    """
    plan = _full_plan(campaign.name)
    if not quick:
        return plan
    match campaign.name:
        case "finer":
            return _thinned(plan, x=slice(0, None, 2), y=slice(0, None, 2), exposures=slice(None))
        case "stereo-inside":
            return _thinned(plan, x=_THIRD, y=_THIRD, exposures=_THIRD_EXPOSURE)
        case "stereo-outside":
            (positions,) = plan.random
            exposures_ms = positions.exposures_ms[_THIRD_EXPOSURE]
            return replace(plan, random=(replace(positions, count=3, exposures_ms=exposures_ms),))
    return plan


_THIRD = slice(1, None, 3)
"""Of eight x the second, fifth and eighth; of six y the second and fifth."""

_THIRD_EXPOSURE = slice(2, None, 3)
"""Of the stereo sensor's sixteen: in nine of ten places where a feature reaches p_norm 0.75, it
does so at three or more of them in a row, so that such a place keeps a row."""


def _full_plan(name: str) -> MeasuringPlan:
    match name:
        case "finer":  # eX⁺⁺ less what `inside` has already
            plan = plan_preset("ex-plusplus")
            return replace(plan, name=name, planes=plan.planes[-1:])
        case "outside":
            return replace(plan_preset("x-out"), name=name)
        case "stereo-inside":  # X and X test see the same views
            return replace(plan_preset("stereo-x"), name=name, features=TRAINING + TEST)
        case "stereo-outside":
            return replace(plan_preset("stereo-x-out"), name=name)
    return plan_preset(name)


def _thinned(plan: MeasuringPlan, *, x: slice, y: slice, exposures: slice) -> MeasuringPlan:
    planes = (
        replace(
            plane,
            x_mm=plane.x_mm[x],
            y_mm=plane.y_mm[y],
            exposures_ms=plane.exposures_ms[exposures],
        )
        for plane in plan.planes
    )
    return replace(plan, planes=tuple(planes))


def plan_size(plan: MeasuringPlan) -> tuple[int, int]:
    """Return how many views and captures a plan has."""
    views = [_n_positions(group) for group in plan.groups]
    counts = zip(views, plan.groups, strict=True)
    return sum(views), sum(n * len(group.exposures_ms) for n, group in counts)


def _n_positions(group: DepthPlane | RandomPositions) -> int:
    return len(tuple(group.names() if hasattr(group, "names") else group.positions()))
