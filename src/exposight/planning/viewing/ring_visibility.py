"""Which features' rings a sensor sees and lights from a pose: by frame, facing, and casting rays.

What `exposight.observing.View` says of a pose, and what the part itself does to it: a ring's point
gives a 3D point only where every camera sees it and the projector lights it, so rays go from points
on the ring to each of them. What stands in a camera's way hides, what stands in the projector's
way shadows.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import IntEnum
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from exposight.cell import ActiveSensor, Part
from exposight.errors import InputError
from exposight.geometry import HollowCylinder, PinholeCamera, RigidTransform
from exposight.geometry.meshes.triangle_meshes import Mesh
from exposight.geometry.ray_casting import RayCaster

FloatArray: TypeAlias = NDArray[np.float64]

_RING_POINTS = 24
"""Points on a ring: its share is known to a 24th."""

_EVERY = 8
"""Of an outline's 256 points one in so many is looked for in the frame."""

_LIFT_MM = 0.2
"""How far ring points are held before the surface, so that it does not hide them: more than a
mesh's facets stray from the surface (assumed)."""


class Sight(IntEnum):
    """What keeps a feature from being measured from a pose; the last ones come nearest to it."""

    OUT_OF_RANGE = 0
    FACING_AWAY = 1
    OUT_OF_FRAME = 2
    OFF_MESH = 3
    UNLIT = 4
    HIDDEN = 5
    SHADOWED = 6
    SEEN = 7


@dataclass(frozen=True, kw_only=True)
class ViewingLimits:
    """From which angles, and to which share, a ring must be seen.

    Parameters
    ----------
    incidence_deg : float, degrees
        Largest angle between a feature's normal and the rays to the cameras (assumed: triangulating
        sensors lose points on steeper surfaces).
    light_incidence_deg : float, degrees
        The same to the projector, whose light only gets weaker (assumed).
    least_share : float
        Least share of the ring's points that is seen and lit: a p_norm of 0.75 and a margin for
        points that are lost otherwise.

    Raises
    ------
    InputError
        If an angle is not between 0 and 90°, or the share not in (0, 1].
    """

    incidence_deg: float = 60.0
    light_incidence_deg: float = 75.0
    least_share: float = 0.85

    def __post_init__(self) -> None:
        angles = (self.incidence_deg, self.light_incidence_deg)
        if not all(0.0 < angle < 90.0 for angle in angles) or not 0.0 < self.least_share <= 1.0:
            msg = (
                "viewing limits need angles between 0 and 90° and a share above 0 and up to 1, got "
                f"{angles[0]:g}°, {angles[1]:g}° and {self.least_share:g}"
            )
            raise InputError(msg)


class RingVisibility:
    """A part's rings made ready to be looked at from many poses.

    Parameters
    ----------
    part : Part
        With n features.
    sensor : ActiveSensor
        Its cameras and projector; a projector that is not known casts no shadow.
    mesh : Mesh, optional
        What hides and shadows; without, frame, facing and distance decide.
    limits : ViewingLimits

    Attributes
    ----------
    centres, normals, in_plane : (n, 3) ndarray, mm
        Of the rings, in the part's frame: normals point out of the material, x axes lie in it.
    """

    def __init__(
        self, part: Part, sensor: ActiveSensor, mesh: Mesh | None, limits: ViewingLimits
    ) -> None:
        self._sensor, self._limits = sensor, limits
        regions = [feature.measured_region() for feature in part.features]
        poses = [feature.part_from_feature for feature in part.features]
        pairs = list(zip(regions, poses, strict=True))
        self.centres = np.array([pose.apply([0.0, 0.0, r.plane_z_mm]) for r, pose in pairs])
        self.normals = np.array([-pose.z_axis for pose in poses])
        self.in_plane = np.array([pose.rotation[:, 0] for pose in poses])
        self._outlines = np.stack([pose.apply(r.outline()[::_EVERY]) for r, pose in pairs])
        points = np.stack([pose.apply(ring_points(r, _RING_POINTS)) for r, pose in pairs])
        self._on_mesh = np.ones(points.shape[:2], dtype=np.bool_)
        self._caster = None
        if mesh is not None:
            self._caster = RayCaster(mesh.vertices, mesh.faces)
            heights_mm = np.array([region.height_mm for region in regions])
            points = self._on_surface(self._caster, points, heights_mm)
        self._points = points + _LIFT_MM * self.normals[:, None]

    def _on_surface(
        self, caster: RayCaster, points: FloatArray, heights_mm: FloatArray
    ) -> FloatArray:
        """Move ring points along their normals to the surface, if their region holds any."""
        ways = np.broadcast_to((-heights_mm[:, None] * self.normals)[:, None], points.shape)
        starts = points - 0.5 * ways
        distance, *_ = caster.first_hits(_rays(starts), _rays(ways))
        share = distance.reshape(points.shape[:2]).astype(np.float64)
        self._on_mesh = share <= 1.0
        moved: FloatArray = starts + np.where(self._on_mesh, share, 0.5)[..., None] * ways
        return moved

    def look(self, camera_from_part: RigidTransform) -> tuple[FloatArray, NDArray[np.int8]]:
        """Return what a pose sees of each feature.

        Parameters
        ----------
        camera_from_part : RigidTransform
            Where the part stands.

        Returns
        -------
        share : (n,) ndarray
            Share of each ring that is seen and lit; 0 where it was not looked for.
        sight : (n,) ndarray of int8
            A `Sight` of each.
        """
        n = len(self.centres)
        share, sight = np.zeros(n), np.full(n, Sight.OUT_OF_RANGE, dtype=np.int8)
        sensor, limits = self._sensor, self._limits
        part_from_camera = camera_from_part.inverse()
        depth = self._outlines @ camera_from_part.rotation[2] + camera_from_part.translation_mm[2]
        near, far = sensor.working_distance_mm
        left = np.flatnonzero((depth.min(axis=1) >= near) & (depth.max(axis=1) <= far))
        sight[left] = Sight.FACING_AWAY
        for first_from_camera in sensor.first_from_camera:
            eye = part_from_camera.apply(first_from_camera.translation_mm)
            left = left[self._cosine(left, eye) >= math.cos(math.radians(limits.incidence_deg))]
        sight[left] = Sight.OUT_OF_FRAME
        eyes = []
        for camera, first_from_camera in zip(sensor.cameras, sensor.first_from_camera, strict=True):
            camera_from = first_from_camera.inverse() @ camera_from_part
            left = left[_in_frame(camera, camera_from, self._outlines[left]).all(axis=1)]
            eyes.append(camera_from.inverse().translation_mm)
        if not left.size:
            return share, sight
        there = self._on_mesh[left]
        lit, light = there, None
        if sensor.projector is not None:
            from_part = sensor.projector.camera_from_projector.inverse() @ camera_from_part
            light = from_part.inverse().translation_mm
            cosine = self._cosine(left, light)
            facing = cosine >= math.cos(math.radians(limits.light_incidence_deg))
            in_light = _in_frame(sensor.projector.camera, from_part, self._points[left])
            lit = there & in_light & facing[:, None]
        visible = lit.copy()
        for eye in eyes:
            visible &= ~self._blocked(left, eye, visible)
        measured = visible.copy()
        if light is not None:
            measured &= ~self._blocked(left, light, measured)
        share[left] = measured.mean(axis=1)
        lost = np.stack([~there, there & ~lit, lit & ~visible, visible & ~measured], axis=-1)
        worst = np.argmax(lost.sum(axis=1), axis=1)
        seen = share[left] >= limits.least_share
        sight[left] = np.where(seen, Sight.SEEN, Sight.OFF_MESH + worst)
        return share, sight

    def _cosine(self, places: NDArray[np.int64], eye: FloatArray) -> FloatArray:
        """Return the cosine between features' normals and the way to an eye."""
        ways = eye - self.centres[places]
        along = np.einsum("ij,ij->i", ways, self.normals[places])
        cosine: FloatArray = along / np.maximum(np.linalg.norm(ways, axis=1), 1e-9)
        return cosine

    def _blocked(
        self, places: NDArray[np.int64], eye: FloatArray, of: NDArray[np.bool_]
    ) -> NDArray[np.bool_]:
        """Tell which of the ring points `of`, (k, 24), something hides from an eye."""
        blocked = np.zeros_like(of)
        if self._caster is not None:
            points = self._points[places][of]
            blocked[of] = self._caster.blocked(_rays(points), _rays(eye - points))
        return blocked


def ring_points(region: HollowCylinder, count: int) -> FloatArray:
    """Return points at equal distances on the line that halves a ring's area, in its frame.

    Parameters
    ----------
    region : HollowCylinder
        The ring; half the area of a full disc lies within 0.71 of its radius.
    count : int
        How many.

    Returns
    -------
    (count, 3) ndarray, mm
    """
    middle = math.sqrt((region.inner_mm**2 + region.outer_mm**2) / 2.0)
    line = region.outline()
    half = np.array([*region.core_half_size_mm, 0.0])
    core = np.clip(line, -half, half)
    core[:, 2] = line[:, 2]
    around = line - core
    around *= middle / np.linalg.norm(around, axis=1, keepdims=True)
    closed = np.concatenate([core + around, (core + around)[:1]])
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(closed, axis=0), axis=1))])
    at = along[-1] * np.arange(count) / count
    return np.stack([np.interp(at, along, closed[:, axis]) for axis in range(3)], axis=1)


def _in_frame(
    camera: PinholeCamera, camera_from_part: RigidTransform, points: FloatArray
) -> NDArray[np.bool_]:
    return camera.in_frame(camera.project(camera_from_part.apply(points)))


def _rays(vectors: FloatArray) -> NDArray[np.float32]:
    return np.ascontiguousarray(vectors.reshape(-1, 3), dtype=np.float32)
