"""Poses of a sensor before groups of features, spread over distance, tilt and turn.

Everything is built from where features are, not from the axes of the part's frame: a part that
stands elsewhere, with what stands round it, has the same poses.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from exposight.cell import ActiveSensor
from exposight.errors import InputError
from exposight.geometry import RigidTransform
from exposight.planning.viewing.ring_visibility import RingVisibility, ViewingLimits

FloatArray: TypeAlias = NDArray[np.float64]

_LEAST_TILT_DEG = 10.0
"""Tilts reach so far at least, so that glare can be avoided."""

_RANGE_MARGIN = 0.05
"""Share of the working distance at both ends at which no group is looked at: parts of it would lie
outside."""

_LEAST_SAMPLES = 8
"""Poses for each group of features."""

_ROUND = 1.1
"""Ratio of the extents of a group below which it has no long side."""


@dataclass(frozen=True, kw_only=True)
class ReachBox:
    """Where a robot can bring its sensor: a box for a point of it.

    Parameters
    ----------
    low_mm, high_mm : (float, float, float), mm
        Two opposite corners, in the box's frame.
    point : {"camera", "tcp"}
        What of the sensor must be in the box: the first camera's centre, or the TCP.
    part_from_box : RigidTransform
        The box's frame; the part's by default.

    Raises
    ------
    InputError
        If the box is empty or not finite.
    """

    low_mm: tuple[float, float, float]
    high_mm: tuple[float, float, float]
    point: Literal["camera", "tcp"] = "camera"
    part_from_box: RigidTransform = field(default_factory=RigidTransform)

    def __post_init__(self) -> None:
        if self.point not in ("camera", "tcp"):
            msg = f"a reach is that of the camera or the tcp, got {self.point!r}"
            raise InputError(msg)
        corners = np.array([self.low_mm, self.high_mm], dtype=np.float64)
        if (
            corners.shape != (2, 3)
            or not np.isfinite(corners).all()
            or (np.diff(corners, axis=0) <= 0).any()
        ):
            msg = (
                "a box of reach needs two corners x, y, z in mm, the first below the second in "
                f"each, got {self.low_mm} and {self.high_mm}: no pose is in it"
            )
            raise InputError(msg)

    def nearest(self, point: FloatArray) -> FloatArray:
        """Return the point of the box nearest to a point, both in the part's frame."""
        inside = np.clip(self.part_from_box.inverse().apply(point), self.low_mm, self.high_mm)
        return self.part_from_box.apply(inside)

    def at(self, shares: FloatArray) -> FloatArray:
        """Return the point at shares (3,) of the box's sides, in the part's frame."""
        low, high = np.array(self.low_mm), np.array(self.high_mm)
        return self.part_from_box.apply(low + shares * (high - low))


@dataclass(frozen=True, kw_only=True, eq=False)
class _Group:
    """Features that one view may see.

    Parameters
    ----------
    target, axis, along : (3,) ndarray, mm
        Where to look, the mean normal out of the material, and the group's long side.
    distance_mm : float, mm
        At which its features fill the field of view.
    """

    target: FloatArray
    axis: FloatArray
    along: FloatArray
    distance_mm: float

    def look(self, tilt: float, azimuth: float) -> FloatArray:
        """Return the way to look, tilted from the normal towards an azimuth, radians."""
        aside = _turned(self.along, self.axis, azimuth)
        way: FloatArray = -math.cos(tilt) * self.axis - math.sin(tilt) * aside
        return way


def sample_poses(
    rings: RingVisibility,
    sensor: ActiveSensor,
    limits: ViewingLimits,
    reach: ReachBox | None,
    count: int,
    seed: int,
    *,
    among: NDArray[np.bool_] | None = None,
) -> list[RigidTransform]:
    """Return poses (camera_from_part) before groups of features.

    Parameters
    ----------
    rings : RingVisibility
        Whose features are looked at.
    sensor : ActiveSensor
    limits : ViewingLimits
    reach : ReachBox, optional
        Poses are moved into it, every second one to any place in it.
    count : int
        How many.
    seed : int, 0 or more
    among : (n,) ndarray of bool, optional
        Features to look at, and groups of; all by default.
    """
    near, far = sensor.working_distance_mm
    near, far = near * (1.0 + _RANGE_MARGIN), far * (1.0 - _RANGE_MARGIN)
    if near >= far:
        near = far = math.sqrt(near * far)
    most = max(1, count // _LEAST_SAMPLES)
    groups = _groups(rings, sensor, limits, (near, far), most, among)
    each = -(-count // len(groups))
    tilt_deg = max(limits.incidence_deg - _half_diagonal_deg(sensor), _LEAST_TILT_DEG)
    poses = []
    for number, group in enumerate(groups):
        fitting = math.log(group.distance_mm / near) / max(math.log(far / near), 1e-9)
        drawn = _spread(each, np.random.default_rng((seed, number)))
        drawn[0, :4] = (fitting, 0.0, 0.0, 0.0)  # straight on, for all of the group
        for i, (away, tilt, azimuth, roll, *place) in enumerate(drawn):
            distance_mm = near * (far / near) ** np.clip(away, 0.0, 1.0)
            look = group.look(math.radians(tilt_deg * tilt), 2.0 * math.pi * azimuth)
            right = _turned(group.along, look, 0.5 * math.pi * int(4.0 * roll))
            pose = _looking(group.target - distance_mm * look, look, right)
            if reach is not None:
                anywhere = np.array(place) if i % 2 else None
                pose = _into_reach(pose, reach, sensor, group.target, anywhere)
            poses.append(pose.inverse())
    return poses[:count]


def _half_diagonal_deg(sensor: ActiveSensor) -> float:
    """Return how much more obliquely what faces the sensor is seen in the frame's corners."""
    camera = sensor.camera
    slope = math.hypot(camera.width / camera.fx, camera.height / camera.fy) / 2.0
    return math.degrees(math.atan(slope))


def _spread(count: int, rng: np.random.Generator) -> FloatArray:
    """Draw numbers from 0 to 1, (count, 7), each column evenly spread (a Latin hypercube)."""
    strata = np.stack([rng.permutation(count) for _ in range(7)], axis=1)
    drawn: FloatArray = (strata + rng.random(strata.shape)) / count
    return drawn


def _turned(along: FloatArray, look: FloatArray, angle: float) -> FloatArray:
    """Return a direction across `look`, turned about it by an angle, radians, from `along`."""
    first = along - (along @ look) * look
    if np.linalg.norm(first) < 1e-6:
        first = np.cross(look, np.eye(3)[np.argmin(np.abs(look))])
    first /= np.linalg.norm(first)
    turned: FloatArray = math.cos(angle) * first + math.sin(angle) * np.cross(look, first)
    return turned


def _looking(place: FloatArray, look: FloatArray, right: FloatArray) -> RigidTransform:
    """Return part_from_camera of a camera at a place that looks along one way, right another."""
    rotation = np.stack([right, np.cross(look, right), look], axis=1)
    return RigidTransform(rotation=rotation, translation_mm=place)


def _into_reach(
    part_from_camera: RigidTransform,
    reach: ReachBox,
    sensor: ActiveSensor,
    target: FloatArray,
    anywhere: FloatArray | None,
) -> RigidTransform:
    """Move a sensor into reach: to the nearest place, or to that at shares of the box."""
    held = np.zeros(3) if reach.point == "camera" else sensor.camera_from_tcp.translation_mm
    old = part_from_camera.apply(held)
    new = reach.nearest(old) if anywhere is None else reach.at(anywhere)
    place = part_from_camera.translation_mm + new - old
    look = target - place
    if reach.point == "tcp" or np.linalg.norm(look) < 1e-6:
        return RigidTransform(rotation=part_from_camera.rotation, translation_mm=place)
    look /= np.linalg.norm(look)
    return _looking(place, look, _turned(part_from_camera.rotation[:, 0], look, 0.0))


def _groups(
    rings: RingVisibility,
    sensor: ActiveSensor,
    limits: ViewingLimits,
    distances_mm: tuple[float, float],
    count: int,
    among: NDArray[np.bool_] | None,
) -> list[_Group]:
    """Return groups of features of several sizes, those first that show most others yet do not."""
    camera = sensor.camera
    slope = 0.5 * min(camera.width / camera.fx, camera.height / camera.fy)
    near, far = distances_mm
    members: dict[bytes, tuple[NDArray[np.bool_], float]] = {}
    facing = rings.normals @ rings.normals.T >= math.cos(math.radians(0.6 * limits.incidence_deg))
    ways = rings.centres[None] - rings.centres[:, None]
    depth = np.einsum("ijk,ik->ij", ways, rings.normals)
    aside = np.sqrt(np.maximum((ways**2).sum(axis=-1) - depth**2, 0.0))
    for distance in (far, math.sqrt(near * far), near):
        together = facing & (aside <= slope * distance) & (np.abs(depth) <= 0.5 * (far - near))
        together |= np.eye(len(together), dtype=np.bool_)
        if among is not None:
            together = together[among] & among
        for row in together:
            members.setdefault(row.tobytes(), (row, distance))
    rows = np.array([row for row, _ in members.values()])
    fitting = [distance for _, distance in members.values()]
    left, shown = rows.astype(np.float64), np.zeros(rows.shape[1])
    groups = []
    for _ in range(min(count, len(rows))):
        best = int(np.argmax(left @ (1.0 / (1.0 + shown) ** 2)))
        shown += left[best]
        left[best] = 0.0
        groups.append(_group(rings, rows[best], fitting[best]))
    return groups


def _group(rings: RingVisibility, row: NDArray[np.bool_], distance_mm: float) -> _Group:
    centres = rings.centres[row]
    axis = rings.normals[row].mean(axis=0)
    axis /= np.linalg.norm(axis)
    target = centres.mean(axis=0)
    flat = centres - target
    flat -= np.outer(flat @ axis, axis)
    _, extents, sides = np.linalg.svd(flat, full_matrices=False)
    along = rings.in_plane[row][0]
    if len(centres) > 1 and extents[0] > _ROUND * extents[1]:
        along = sides[0] * (1.0 if sides[0] @ flat[0] >= 0.0 else -1.0)
    return _Group(target=target, axis=axis, along=along, distance_mm=distance_mm)
