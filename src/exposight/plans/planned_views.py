"""From a measuring plan to poses: where the sensor truly stands, and where it says it stands."""

from __future__ import annotations

import logging
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from exposight.errors import InputError, SensorError
from exposight.geometry import RigidTransform
from exposight.observing import Visibility, view_features
from exposight.plans.alignment import Alignment, draw_alignment, view_seed

if TYPE_CHECKING:
    from collections.abc import Iterator

    from exposight.cell import ActiveSensor, Feature, Part
    from exposight.plans.alignment import AlignedBy
    from exposight.plans.plan import DepthPlane, MeasuringPlan, RandomPositions


logger = logging.getLogger(__name__)

_POSITION = 0x504F53  # the purpose of a stream of random numbers

_MAX_DRAWS = 100
"""Where one position in ten sees a feature, one view in forty thousand still fails."""

_ORIENTATION = {"inside": np.eye(3), "outside": np.diag([-1.0, 1.0, -1.0])}
"""tcp_from_part's rotation for each side: parallel axes, or turned by 180° about y."""


@dataclass(frozen=True, kw_only=True)
class PlannedView:
    """One position of the sensor.

    Parameters
    ----------
    name : str
        Unique in its plan.
    true_camera_from_part : RigidTransform
        Where the part stands: what the light sees.
    reported_camera_from_part : RigidTransform
        Where the part is said to stand: what a capture records and observations rest on.
    alignment : Alignment
        How the view was aligned, and the error between the two poses.
    exposures_ms : tuple of float, ms
        Exposure times to take.
    visible : tuple of str
        The plan's features that can be observed from here, by the reported pose.
    seed : (int, int)
        Everything random in this view follows from these numbers (`view_seed`).
    """

    name: str
    true_camera_from_part: RigidTransform
    reported_camera_from_part: RigidTransform
    alignment: Alignment
    exposures_ms: tuple[float, ...]
    visible: tuple[str, ...]
    seed: tuple[int, int]

    @property
    def aligned_by(self) -> AlignedBy:
        """How the view was aligned."""
        return self.alignment.aligned_by

    @property
    def notes(self) -> str:
        """The alignment in words, for a capture's notes."""
        return (
            f"aligned by {self.aligned_by}, wrong by {self.alignment.error_mm:.3f} mm and "
            f"{self.alignment.error_deg:.4f}°"
        )


def views(plan: MeasuringPlan, part: Part, sensor: ActiveSensor) -> tuple[PlannedView, ...]:
    """Work out the views of a plan.

    Parameters
    ----------
    plan : MeasuringPlan
        The plan.
    part : Part
        Has the plan's features and its reference.
    sensor : ActiveSensor
        Usually ``sensor_preset(plan.sensor)``.

    Returns
    -------
    tuple of PlannedView
        Grids plane by plane, y by y, then random positions. The same for the same arguments; a
        view depends on the plan's seed and its own name, not on the other views.

    Raises
    ------
    FeatureError
        If the part lacks a feature that the plan names.
    SensorError
        If the sensor cannot take an exposure time.
    InputError
        If a view sees none of the plan's features, or stands outside the working distance.
    """
    observed, reference = plan.observed_part(part), plan.reference_feature(part)
    station = _Station(plan=plan, observed=observed, reference=reference, sensor=sensor)
    _check_exposures(plan, sensor)
    planned = [view for plane in plan.planes for view in station.on_grid(plane)]
    planned += [view for box in plan.random for view in station.at_random(box)]
    if not planned:
        msg = (
            f"plan {plan.name!r}: none of its views sees any of {', '.join(plan.features)}; check "
            "side, reference and positions"
        )
        raise InputError(msg)
    return tuple(planned)


def _check_exposures(plan: MeasuringPlan, sensor: ActiveSensor) -> None:
    for group in plan.groups:
        for exposure_ms in group.exposures_ms:
            try:
                sensor.check_exposure(exposure_ms)
            except SensorError as error:
                msg = f"plan {plan.name!r}, views {group.name!r}: {error}"
                raise SensorError(msg) from error


@dataclass(frozen=True, kw_only=True)
class _Station:
    """A sensor before a part, following a plan."""

    plan: MeasuringPlan
    observed: Part
    reference: Feature
    sensor: ActiveSensor

    def on_grid(self, plane: DepthPlane) -> Iterator[PlannedView]:
        for name, position in plane.positions():
            self._check_distance(name, position)
            view = self._view(name, position, plane)
            if view.visible:
                yield view
            elif self.plan.blind_views == "refuse":
                msg = (
                    f"plan {self.plan.name!r}: view {name!r} sees none of its features "
                    f"({self._reasons(view)}); move the view, name other features, or say "
                    "blind_views = 'skip' to leave such views out"
                )
                raise InputError(msg)
            else:
                logger.info("view %s sees no feature of plan %s: skipped", name, self.plan.name)

    def at_random(self, box: RandomPositions) -> Iterator[PlannedView]:
        low, high = np.array([box.x_mm, box.y_mm, box.z_tcp_mm]).T
        for name in box.names():
            generator = np.random.default_rng([*view_seed(self.plan.seed, name), _POSITION])
            for _ in range(_MAX_DRAWS):
                x, y, z = generator.uniform(low, high).tolist()
                self._check_distance(name, (x, y, z))
                view = self._view(name, (x, y, z), box)
                if view.visible:
                    yield view
                    break
            else:
                msg = (
                    f"plan {self.plan.name!r}: view {name!r} sees none of its features from "
                    f"{_MAX_DRAWS} random positions ({self._reasons(view)}, the last time); check "
                    "the side and the ranges"
                )
                raise InputError(msg)

    def _view(
        self,
        name: str,
        position_mm: tuple[float, float, float],
        group: DepthPlane | RandomPositions,
    ) -> PlannedView:
        plan = self.plan
        alignment = draw_alignment(plan.alignment, group.kinematic_share, plan.seed, name)
        tcp_from_part = self._tcp_from_part(position_mm)
        reported = self.sensor.camera_from_tcp @ alignment.reported_from_true @ tcp_from_part
        features = view_features(self.observed, self.sensor, reported)
        return PlannedView(
            name=name,
            true_camera_from_part=self.sensor.camera_from_tcp @ tcp_from_part,
            reported_camera_from_part=reported,
            alignment=alignment,
            exposures_ms=group.exposures_ms,
            visible=tuple(
                seen.feature.name for seen in features if seen.visibility is Visibility.VISIBLE
            ),
            seed=view_seed(plan.seed, name),
        )

    def _tcp_from_part(self, position_mm: tuple[float, float, float]) -> RigidTransform:
        """Bring the reference feature to a position in the TCP frame."""
        rotation = _ORIENTATION[self.plan.side]
        reference_mm = self.reference.part_from_feature.translation_mm
        return RigidTransform(
            rotation=rotation, translation_mm=np.array(position_mm) - rotation @ reference_mm
        )

    def _check_distance(self, name: str, position_mm: tuple[float, float, float]) -> None:
        distance = float(self.sensor.camera_from_tcp.apply(position_mm)[2])
        near, far = self.sensor.working_distance_mm
        if not near <= distance <= far:
            msg = (
                f"plan {self.plan.name!r}: in view {name!r} feature {self.plan.reference!r} lies "
                f"{distance:.0f} mm before the camera (z_tcp {position_mm[2]:g} mm), but sensor "
                f"{self.sensor.name!r} measures from {near:g} to {far:g} mm; change z_tcp_mm"
            )
            raise InputError(msg)

    def _reasons(self, view: PlannedView) -> str:
        seen = view_features(self.observed, self.sensor, view.reported_camera_from_part)
        return ", ".join(f"{each.feature.name} {each.visibility.value}" for each in seen)
