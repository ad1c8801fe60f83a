"""Measuring plans: from where and for how long a sensor measures a part."""

import logging
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import lru_cache
from itertools import islice
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from exposight.cell import ActiveSensor, Feature, Part
from exposight.errors import FeatureError, InputError, SensorError
from exposight.files import check_plain
from exposight.geometry import RigidTransform
from exposight.observing import Visibility, view_features
from exposight.plans import positions
from exposight.plans.pose_lists import PoseList

logger = logging.getLogger(__name__)

Side = Literal["inside", "outside"]
"""The side of the part before which the sensor stands."""

BlindViews = Literal["refuse", "skip"]
"""What becomes of a planned position from which no feature of the plan can be seen."""

_MOST_CAPTURES = 1_000_000
"""Captures take seconds each; more is a slip of the pen, and would eat the memory."""

_MAX_DRAWS = 100
"""Where one position in ten sees a feature, one view in forty thousand still fails."""

_ORIENTATION: Mapping[Side, NDArray[np.float64]] = {
    "inside": np.eye(3),
    "outside": np.diag([-1.0, 1.0, -1.0]),
}
"""tcp_from_part's rotation for each side: parallel axes, or turned by 180° about y."""


@dataclass(frozen=True, kw_only=True)
class PlannedView:
    """One position of the sensor, as commanded.

    Parameters
    ----------
    name : str
        Unique in its plan.
    group : str
        The plane, random positions or list of poses that it belongs to.
    camera_from_part : RigidTransform
        Where the part shall stand, seen from the sensor's first camera.
    tcp_from_part : RigidTransform
        The same in the TCP frame.
    exposures_ms : tuple of float, ms
        Exposure times to take.
    visible : tuple of str
        The plan's features that can be observed from here.
    """

    name: str
    group: str
    camera_from_part: RigidTransform
    tcp_from_part: RigidTransform
    exposures_ms: tuple[float, ...]
    visible: tuple[str, ...]


@dataclass(frozen=True, kw_only=True)
class MeasuringPlan:
    """Views × exposure times of a sensor before a part.

    Parameters
    ----------
    name : str
        What people call it.
    sensor : ActiveSensor
        The sensor that measures.
    features : sequence of str
        The part's features that are observed; others are not looked at.
    reference : str
        The feature about which planes and random positions are planned; need not be observed, and
        may be left out where all views are lists of poses.
    side : {'inside', 'outside'}
        Before the inside the sensor's axes are parallel to the part's; before the outside it is
        turned by 180° about y. Turns of planes and random positions follow that. Lists of poses
        have their own orientation.
    planes : sequence of DepthPlane
        Grids of positions.
    random : sequence of RandomPositions
        Random positions, measured after the grids.
    poses : sequence of PoseList
        Poses written out, measured last.
    blind_views : {'refuse', 'skip'}
        Whether a position on a grid, or a pose of a list, that sees no feature of the plan is an
        error or left out.
    seed : int, 0 or more
        All randomness of the campaign follows from it and the views' names.
    simulated : mapping of str to object
        Settings for the simulated cell, as a plan's file carries them (`exposight.twin` reads
        them). Other cells do not look at them.

    Raises
    ------
    InputError
        If something is missing, unknown or there twice. The message names it.
    """

    name: str
    sensor: ActiveSensor
    features: tuple[str, ...]
    reference: str = ""
    side: Side = "inside"
    planes: tuple[positions.DepthPlane, ...] = ()
    random: tuple[positions.RandomPositions, ...] = ()
    poses: tuple[PoseList, ...] = ()
    blind_views: BlindViews = "refuse"
    seed: int = 0
    simulated: Mapping[str, Any] = field(default_factory=dict, hash=False)

    def __post_init__(self) -> None:
        for name in ("features", "planes", "random", "poses"):
            object.__setattr__(self, name, tuple(getattr(self, name)))
        positions.check_name(self.name)
        fault = self._fault()
        if fault:
            msg = f"plan {self.name!r}: {fault}"
            raise InputError(msg)

    def _fault(self) -> str:
        for key, value, known in (
            ("side", self.side, get_args(Side)),
            ("blind_views", self.blind_views, get_args(BlindViews)),
        ):
            if value not in known:
                return f"{key} must be one of {', '.join(known)}, got {value!r}"
        if not self.features:
            return "features is empty; name at least one feature that shall be observed"
        for feature in self.features:
            check_plain(feature, "the feature", InputError)
        twice = positions.first_twice(self.features)
        if twice is not None:
            return f"feature {twice!r} is there twice"
        if not self.reference and (self.planes or self.random):
            return "reference is empty; name the feature about which positions are planned"
        names = [group.name for group in self.groups]
        if not names:
            return "it has neither planes nor random positions nor poses; add at least one"
        twice = positions.first_twice(names)
        if twice is not None:
            return f"two planes are called {twice!r}; give each a name of its own"
        if self.n_captures > _MOST_CAPTURES:
            return f"it has {self.n_captures} captures, and may have {_MOST_CAPTURES}"
        if self.seed < 0:
            return f"seed must be a whole number from 0 up, got {self.seed}"
        return ""

    @property
    def groups(self) -> tuple[positions.DepthPlane | positions.RandomPositions | PoseList, ...]:
        """Planes, random positions, lists of poses: name, exposure times and `n_views` of each."""
        return (*self.planes, *self.random, *self.poses)

    @property
    def n_captures(self) -> int:
        """Views times exposure times, with views that see nothing."""
        each = sum(len(times_ms) for poses in self.poses for times_ms in poses.exposures_each_ms)
        every = (
            group.n_views * len(group.exposures_ms)
            for group in self.groups
            if not (isinstance(group, PoseList) and group.exposures_each_ms)
        )
        return each + sum(every)

    def observed_part(self, part: Part) -> Part:
        """Return a part that has only the features this plan observes.

        Raises
        ------
        FeatureError
            If the part lacks one of them.
        """
        features = tuple(self._feature(part, name) for name in self.features)
        return Part(name=part.name, features=features)

    def _feature(self, part: Part, name: str) -> Feature:
        try:
            return part.feature(name)
        except FeatureError as error:
            msg = f"plan {self.name!r}: {error}"
            raise FeatureError(msg) from error

    def views(self, part: Part) -> tuple[PlannedView, ...]:
        """Work out the views before a part.

        Parameters
        ----------
        part : Part
            Has the plan's features and its reference.

        Returns
        -------
        tuple of PlannedView
            Grids plane by plane, y by y, then random positions, then lists of poses. The same for
            the same part; a view depends on the plan's seed and its own name, not on the others.

        Raises
        ------
        FeatureError
            If the part lacks a feature that the plan names.
        SensorError
            If the sensor cannot take an exposure time.
        InputError
            If a view sees none of the plan's features, or stands outside the working distance, or
            two views have one name.
        """
        return _views(self, part)

    def check_exposures(self) -> None:
        """Check that the sensor can take every exposure time.

        Raises
        ------
        SensorError
            If it cannot; the message names the views.
        """
        for group in self.groups:
            for exposure_ms in group.exposures_ms:
                try:
                    self.sensor.check_exposure(exposure_ms)
                except SensorError as error:
                    msg = f"plan {self.name!r}, views {group.name!r}: {error}"
                    raise SensorError(msg) from error


@lru_cache(maxsize=2)
def _views(plan: MeasuringPlan, part: Part) -> tuple[PlannedView, ...]:
    station = _Station(
        plan=plan,
        observed=plan.observed_part(part),
        reference=plan._feature(part, plan.reference) if plan.reference else None,
    )
    plan.check_exposures()
    planned = [view for plane in plan.planes for view in station.on_grid(plane)]
    planned += [view for box in plan.random for view in station.at_random(box)]
    planned += [view for poses in plan.poses for view in station.at_poses(poses)]
    fault = ""
    if not planned:
        fault = (
            f"none of its views sees any of {', '.join(plan.features)}; check side, reference "
            "and positions"
        )
    twice = positions.first_twice([view.name for view in planned])
    if twice is not None:
        fault = f"two views are called {twice!r}; give each a name of its own"
    if fault:
        msg = f"plan {plan.name!r}: {fault}"
        raise InputError(msg)
    return tuple(planned)


@dataclass(frozen=True, kw_only=True)
class _Station:
    """The plan's sensor before a part."""

    plan: MeasuringPlan
    observed: Part
    reference: Feature | None

    def on_grid(self, plane: positions.DepthPlane) -> Iterator[PlannedView]:
        for name, placement in plane.placements():
            yield from self._unless_blind(self._at_placement(name, placement, plane))

    def at_random(self, box: positions.RandomPositions) -> Iterator[PlannedView]:
        for name in box.names():
            for placement in islice(box.draws(name, self.plan.seed), _MAX_DRAWS):
                view = self._at_placement(name, placement, box)
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

    def at_poses(self, poses: PoseList) -> Iterator[PlannedView]:
        for name, camera_from_part, tcp_from_part, exposures_ms in poses.views(
            self.plan.sensor.camera_from_tcp
        ):
            view = PlannedView(
                name=name,
                group=poses.name,
                camera_from_part=camera_from_part,
                tcp_from_part=tcp_from_part,
                exposures_ms=exposures_ms,
                visible=self._visible(camera_from_part),
            )
            yield from self._unless_blind(view)

    def _unless_blind(self, view: PlannedView) -> Iterator[PlannedView]:
        if view.visible:
            yield view
        elif self.plan.blind_views == "refuse":
            msg = (
                f"plan {self.plan.name!r}: view {view.name!r} sees none of its features "
                f"({self._reasons(view)}); move the view, name other features, or say "
                "blind_views = 'skip' to leave such views out"
            )
            raise InputError(msg)
        else:
            logger.info("view %s sees no feature of plan %s: skipped", view.name, self.plan.name)

    def _at_placement(
        self,
        name: str,
        placement: RigidTransform,
        group: positions.DepthPlane | positions.RandomPositions,
    ) -> PlannedView:
        self._check_distance(name, placement.translation_mm)
        tcp_from_part = self._tcp_from_part(placement)
        camera_from_part = self.plan.sensor.camera_from_tcp @ tcp_from_part
        return PlannedView(
            name=name,
            group=group.name,
            camera_from_part=camera_from_part,
            tcp_from_part=tcp_from_part,
            exposures_ms=group.exposures_ms,
            visible=self._visible(camera_from_part),
        )

    def _tcp_from_part(self, placement: RigidTransform) -> RigidTransform:
        """Bring the reference feature to its place in the TCP frame, the part turned about it."""
        assert self.reference is not None  # the plan has one where it has positions
        rotation = placement.rotation @ _ORIENTATION[self.plan.side]
        reference_mm = self.reference.part_from_feature.translation_mm
        return RigidTransform(
            rotation=rotation, translation_mm=placement.translation_mm - rotation @ reference_mm
        )

    def _visible(self, camera_from_part: RigidTransform) -> tuple[str, ...]:
        views = view_features(self.observed, self.plan.sensor, camera_from_part)
        return tuple(v.feature.name for v in views if v.visibility is Visibility.VISIBLE)

    def _check_distance(self, name: str, position_mm: NDArray[np.float64]) -> None:
        sensor = self.plan.sensor
        distance = float(sensor.camera_from_tcp.apply(position_mm)[2])
        near, far = sensor.working_distance_mm
        if not near <= distance <= far:
            msg = (
                f"plan {self.plan.name!r}: in view {name!r} feature {self.plan.reference!r} lies "
                f"{distance:.0f} mm before the camera (z_tcp {position_mm[2]:g} mm), but sensor "
                f"{sensor.name!r} measures from {near:g} to {far:g} mm; change z_tcp_mm"
            )
            raise InputError(msg)

    def _reasons(self, view: PlannedView) -> str:
        views = view_features(self.observed, self.plan.sensor, view.camera_from_part)
        return ", ".join(f"{each.feature.name} {each.visibility.value}" for each in views)
