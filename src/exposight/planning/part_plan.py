"""Plan a part's exposures from models: forecast each view, then choose among all captures."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import polars as pl

from exposight.cell import ActiveSensor, Part
from exposight.errors import InputError, SensorError
from exposight.geometry import RigidTransform
from exposight.models import P_NORM_MIN
from exposight.observing import View
from exposight.planning.beliefs import belief_of
from exposight.planning.capture_chances import CaptureChances
from exposight.planning.covering.cover import plan_exposures
from exposight.planning.covering.cover_wishes import check_goal
from exposight.planning.exposure_limits import CaptureCosts, ExposureLimits, limits_from
from exposight.planning.exposure_plan import ExposurePlan, ModelReference
from exposight.planning.recommendation import CONFIDENCE, check_confidence
from exposight.planning.sensor_models import SensorModels

_SETTINGS = 100
"""Settings of each view to choose from; fewer cost captures, more gain nothing."""


def view_chances(
    models: SensorModels, rings: pl.DataFrame, limits: ExposureLimits, *, need: float = P_NORM_MIN
) -> list[CaptureChances]:
    """Return what captures of each view promise, at settings that the sensor can take.

    Parameters
    ----------
    models : SensorModels
        What forecasts.
    rings : polars.DataFrame
        What the views see: `View.poses` of all of them.
    limits : ExposureLimits
        What the sensor can be set to.
    need : float
        Quality that is asked for.
    """
    belief = belief_of(models, rings, need, limits)
    return [
        belief.chances(str(view), frame["feature"].to_list(), _SETTINGS)
        for (view,), frame in rings.group_by("view", maintain_order=True)
    ]


def check_same_sensor(models: SensorModels, sensor: ActiveSensor | None, source: str) -> None:
    """Check that models were trained on the sensor that is to measure.

    Raises
    ------
    SensorError
        If they were trained on another one; `source` says what is of the sensor.
    """
    if sensor is None or models.sensor is None or sensor.name == models.sensor.name:
        return
    msg = (
        f"{source} is of sensor {sensor.name!r}, the models were trained on "
        f"{models.sensor.name!r}: there is no model for this sensor; train one, or give views of "
        "the other"
    )
    raise SensorError(msg)


def plan(
    models: SensorModels,
    part: Part,
    views: Mapping[str, RigidTransform],
    *,
    sensor: ActiveSensor | None = None,
    limits: ExposureLimits | str | None = None,
    costs: CaptureCosts | None = None,
    at_least: float = P_NORM_MIN,
    confidence: float = CONFIDENCE,
    **wishes: Any,
) -> ExposurePlan:
    """Plan which exposures to take in which views of a part.

    Parameters
    ----------
    models : SensorModels
        What forecasts.
    part : Part
        Its features are to be measured.
    views : mapping of str to RigidTransform
        camera_from_part of the views to choose from, by name.
    sensor : ActiveSensor, optional
        What measures; the models' by default.
    limits : ExposureLimits or str, optional
        What the sensor can be set to, or a profile's name; as its description says by default.
    costs : CaptureCosts, optional
        What captures and moves take.
    at_least : float
        Quality that is asked for, p_norm.
    confidence : float
        Chance that each feature shall have.
    **wishes
        Goal, budget and the like, as for `plan_exposures`.

    Raises
    ------
    InputError
        If no view sees a feature, the sensor is not known, or as `plan_exposures`.
    SensorError
        If the models were trained on another sensor.
    """
    check_confidence(confidence)
    check_goal(wishes.get("goal", "count"), wishes.get("budget"), wishes.get("time_limit_s", 1.0))
    _check_part(part, views)
    sensor = sensor or models.sensor
    if sensor is None:
        msg = "the models do not know their sensor: give the sensor that measures"
        raise InputError(msg)
    check_same_sensor(models, sensor, "the part")
    seen = [View.of(part, sensor, pose, name=name) for name, pose in views.items()]
    reasons = {
        each.feature.name: each.visibility.value
        for view in seen
        for each in view.features
        if each not in view.visible
    }
    frames = [view.poses for view in seen if view.visible]
    if not frames:
        why = ", ".join(sorted(set(reasons.values()))) or "there is no view"
        msg = f"no view sees a feature of {part.name!r} ({why}): check poses and features' normals"
        raise InputError(msg)
    rings = pl.concat(frames, how="diagonal_relaxed")
    limits = limits_from(limits) or ExposureLimits.of(sensor)
    visible = set(rings["feature"])
    return plan_exposures(
        view_chances(models, rings, limits, need=at_least),
        limits,
        costs,
        confidence=confidence,
        poses=dict(views),
        not_seen={name: why for name, why in reasons.items() if name not in visible},
        sensor=sensor.name,
        part=part.name,
        models=model_references(models),
        **wishes,
    )


def _check_part(part: Part, views: Mapping[str, RigidTransform]) -> None:
    """Check that views are poses by name, which a list or names of views are not."""
    if not isinstance(part, Part):
        msg = f"expected a Part, got {part!r}; a campaign's is campaign.part"
        raise InputError(msg)
    wrong = (
        [each for each in views.values() if not isinstance(each, RigidTransform)]
        if isinstance(views, Mapping)
        else [views]
    )
    if wrong:
        msg = (
            f"expected views' camera_from_part by name, {{name: RigidTransform}}, got {wrong[0]!r}"
        )
        raise InputError(msg)


def model_references(models: SensorModels) -> tuple[ModelReference, ...]:
    """Return names and checksums of models, as plans keep them."""
    return tuple(
        ModelReference(name=name, sha256=sha256) for name, sha256 in models.checksums.items()
    )
