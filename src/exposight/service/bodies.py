"""What requests hold: the part, the sensor and the pose meant, limits of exposure times, costs."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, model_validator
from pydantic_core import PydanticCustomError

from exposight.cell import ActiveSensor, Part
from exposight.contradictions import settle
from exposight.errors import InputError, MissingFileError, PoseError, did_you_mean
from exposight.geometry import PoseNotation, RigidTransform, parse_pose
from exposight.observing import View, pose_contradictions, why_not_visible
from exposight.planning import PROFILES, CaptureCosts, ExposureLimits
from exposight.service.faults import RequestError
from exposight.service.folder import ServedFolder
from exposight.service.guard import Limits

Unit = Literal["us", "ms", "s"]

POSE: list[Any] = [
    [1.0, 0.0, 0.0, 12.5],
    [0.0, 1.0, 0.0, -3.0],
    [0.0, 0.0, 1.0, 600.0],
    [0.0, 0.0, 0.0, 1.0],
]
"""A pose for examples."""

_Row = Annotated[list[float], Field(max_length=16)]
"""Of a matrix; one that is far too long is refused before its numbers are looked at."""

_LONGEST_NAME = 255
_FARTHEST_MM = 1e6
"""A kilometre: no sensor looks so far."""


class Body(BaseModel):
    """A JSON object of a request: unknown keys, other types and infinite numbers are refused."""

    model_config = ConfigDict(extra="forbid", strict=True, allow_inf_nan=False)

    @model_validator(mode="before")
    @classmethod
    def _known_keys(cls, given: Any) -> Any:
        if isinstance(given, dict) and (unknown := given.keys() - cls.model_fields.keys()):
            key = min(unknown)
            hint = did_you_mean(key, cls.model_fields)
            kind, words = "unknown_key", "key '{key}' is unknown{hint}"
            raise PydanticCustomError(kind, words, {"key": key[:60], "hint": hint})
        return given


class RobotPose(Body):
    """A pose as a robot writes it."""

    notation: Literal[PoseNotation, "printed"] = Field(
        description="Whose notation: fanuc and kuka in mm and degrees, abb in mm with the scalar "
        "part first, ur in m and rad, …; printed for text that tells it itself.",
        examples=["fanuc"],
    )
    text: str = Field(max_length=2000, description="The numbers.", examples=["12.5,-3,600,0,0,90"])


class Posed(Body):
    """Where the part stands."""

    camera_from_part: list[_Row] | None = Field(
        default=None,
        description="Pose of the part in the camera's frame, a 4×4 matrix in mm.",
        min_length=3,
        max_length=4,
        examples=[POSE],
    )
    robot_pose: RobotPose | None = Field(
        default=None, description="The same as a robot writes it, in place of the matrix."
    )

    @property
    def has_pose(self) -> bool:
        """Whether a pose was given."""
        return self.camera_from_part is not None or self.robot_pose is not None

    def pose(self) -> RigidTransform:
        """Return camera_from_part.

        Raises
        ------
        PoseError, AmbiguousError, InputError
            If it is no pose, or not given once.
        """
        if (self.camera_from_part is None) == (self.robot_pose is None):
            msg = "give the pose once, as camera_from_part or as robot_pose"
            raise InputError(msg)
        if self.robot_pose is not None:
            notation = None if self.robot_pose.notation == "printed" else self.robot_pose.notation
            return _near(parse_pose(notation, self.robot_pose.text))
        lengths = {len(row) for row in self.camera_from_part or []}
        if lengths != {4}:
            msg = f"camera_from_part is a 4×4 matrix, got rows of {sorted(lengths)} numbers"
            raise InputError(msg)
        return _near(RigidTransform.from_matrix(self.camera_from_part or []))


def _near(pose: RigidTransform) -> RigidTransform:
    """Return a pose, unless it is farther away than any part."""
    if abs(pose.translation_mm).max() > _FARTHEST_MM:
        msg = f"the part is {abs(pose.translation_mm).max():.3g} mm away; check the pose's unit"
        raise PoseError(msg)
    return pose


class PartAndSensor(Body):
    """Which part is measured by which sensor."""

    campaign: str | None = Field(
        default=None,
        max_length=_LONGEST_NAME,
        description="Campaign in the served folder whose part and sensor are meant.",
        examples=["campaign"],
    )
    features: str | None = Field(
        default=None,
        max_length=_LONGEST_NAME,
        description="Or a list of features in the folder, CSV, DMIS or QIF, …",
    )
    sensor: str | None = Field(
        default=None,
        max_length=_LONGEST_NAME,
        description="… and a sensor: a preset's name, or a JSON file in the folder.",
    )

    def part_and_sensor(self, folder: ServedFolder, limits: Limits) -> tuple[Part, ActiveSensor]:
        """Return the part and the sensor.

        Raises
        ------
        InputError
            If they are not given, or given twice.
        ExposightError
            If they are not there, or the part has more features than are taken.
        """
        if self.campaign is not None and self.features is None and self.sensor is None:
            campaign = folder.campaign(self.campaign)
            part, sensor = campaign.part, campaign.sensor
        elif self.campaign is None and self.features is not None and self.sensor is not None:
            part, sensor = folder.features(self.features), folder.sensor(self.sensor)
        else:
            msg = "give either campaign, or both features and sensor"
            raise InputError(msg)
        if len(part.features) > limits.features:
            n = len(part.features)
            msg = f"the part has {n} features; up to {limits.features} are taken at once"
            raise RequestError(413, msg)
        return part, sensor


class Viewed(PartAndSensor, Posed):
    """What is seen, by which sensor, from where."""

    view: str | None = Field(
        default=None,
        max_length=_LONGEST_NAME,
        description="Name of one of the campaign's views, in place of a pose.",
    )

    def seen(self, folder: ServedFolder, limits: Limits) -> View:
        """Return what the sensor sees of the part.

        Raises
        ------
        InputError
            If something is missing or said twice, or no feature is visible.
        ContradictionError
            If the pose is out of the sensor's reach, and another reading of it is not.
        """
        part, sensor = self.part_and_sensor(folder, limits)
        pose = self.pose() if self.view is None else self._pose_of_view(self.view, folder)
        view = View.of(part, sensor, pose, name=self.view or "")
        if not view.visible:
            reasons = ", ".join(sorted({each.visibility.value for each in view.features}))
            hint = why_not_visible(part, sensor, pose)
            words = "; ".join(filter(None, (reasons, hint)))
            msg = f"no feature is visible from this pose: {words}"
            raise InputError(msg)
        if self.view is None:
            settle(pose_contradictions(view.features, part, sensor, pose))
        if self.campaign is None:  # such a file does not tell the part's name, by which models know
            return replace(view, shared={**view.shared, "part": None})
        return view

    def _pose_of_view(self, name: str, folder: ServedFolder) -> RigidTransform:
        if self.campaign is None or self.has_pose:
            msg = "view names a view of a campaign, in place of a pose"
            raise InputError(msg)
        poses = folder.view_poses(self.campaign)
        if name not in poses:
            msg = f"{self.campaign}: no view {name!r}{did_you_mean(name, poses)}"
            raise MissingFileError(msg)
        return poses[name]


class SettableExposures(Body):
    """Exposure times that a sensor can be set to, in place of what the models' sensor says."""

    min_ms: float = Field(gt=0, description="Shortest exposure time, ms.", examples=[1.0])
    max_ms: float = Field(gt=0, description="Longest exposure time, ms.", examples=[99.0])
    increment_ms: float = Field(
        gt=0, description="Settings are the minimum plus whole increments, ms.", examples=[0.1]
    )
    allowed_ms: list[float] = Field(
        default=[], max_length=1000, description="The only settings, where there is a list, ms."
    )
    lowest_wins: bool = Field(
        default=False,
        description="Whether, of several exposures that see a point, the first one's is kept.",
    )


class ExposureWishes(Body):
    """What the sensor can be set to, and what captures take."""

    profile: str | None = Field(
        default=None,
        max_length=_LONGEST_NAME,
        description="Name of a sensor's known limits.",
        examples=["zivid-2"],
    )
    limits: SettableExposures | None = Field(
        default=None, description="Or the limits themselves; the models' sensor's by default."
    )
    flicker_hz: float | None = Field(
        default=None,
        ge=10,
        le=1000,
        description="Mains frequency of lamps nearby, Hz: multiples of half its period are taken.",
        examples=[50.0],
    )
    most_per_view: int | None = Field(
        default=None, ge=1, le=1000, description="At most so many captures of a view."
    )
    unit: Unit | None = Field(
        default=None,
        description="Unit of set_value in the answer; the sensor's by default.",
        examples=["us"],
    )
    frames: int = Field(
        default=1, ge=1, le=100_000, description="Images of a capture, each exposed so long."
    )
    overhead_ms: float = Field(
        default=0.0, ge=0, le=1e9, description="What a capture takes beside its exposures, ms."
    )

    def exposure_limits(self, sensor: ActiveSensor | None) -> ExposureLimits:
        """Return the limits that hold, in the unit asked for.

        Raises
        ------
        InputError
            If nobody says any, or two are given.
        SensorError
            If they leave no exposure time, or the sensor cannot take them.
        """
        limits = self._given(sensor)
        if self.most_per_view is not None:
            least = min(limits.least_per_view, self.most_per_view)
            limits = replace(limits, least_per_view=least, most_per_view=self.most_per_view)
        if self.unit is not None and self.unit != limits.unit:
            limits = replace(limits, unit=self.unit)
        return limits if self.flicker_hz is None else limits.under_mains(self.flicker_hz)

    def _given(self, sensor: ActiveSensor | None) -> ExposureLimits:
        if self.profile is not None and self.limits is not None:
            msg = "give the limits once, by profile or by limits"
            raise InputError(msg)
        if self.profile is not None and self.profile not in PROFILES:
            hint = did_you_mean(self.profile, PROFILES)
            msg = f"no profile {self.profile!r}; there are {', '.join(PROFILES)}{hint}"
            raise InputError(msg)
        if self.profile is not None:
            given = PROFILES[self.profile]
        elif self.limits is not None:
            about: Mapping[str, Any] = self.limits.model_dump()
            given = ExposureLimits(
                **{**about, "allowed_ms": tuple(about["allowed_ms"])}, name="the request's limits"
            )
        elif sensor is not None:
            return ExposureLimits.of(sensor)
        else:
            msg = "nobody says what the sensor can be set to: give profile or limits"
            raise InputError(msg)
        if sensor is not None:
            given.check_within(sensor)
        return given

    def costs(self, move_ms: float = 0.0) -> CaptureCosts:
        """Return what captures take."""
        return CaptureCosts(frames=self.frames, overhead_ms=self.overhead_ms, move_ms=move_ms)
