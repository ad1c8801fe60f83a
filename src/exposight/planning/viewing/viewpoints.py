"""Candidate viewpoints of a part: poses from which a sensor sees and lights many features at once.

Features that lie together and face alike are looked at together, from several distances and tilts:
tilts move the glare. Of many such poses, what each sees is found by casting rays
(`RingVisibility`), and a few are kept greedily: each next one is that which shows most features in
a light in which no other shows them. How good the light is, only a model can say; so the choice
leaves each feature several, and the planner decides among them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from exposight.cell import ActiveSensor, Part
from exposight.cell.placement import check_placement
from exposight.errors import FeatureError, InputError
from exposight.geometry import RigidTransform
from exposight.geometry.meshes.triangle_meshes import Mesh
from exposight.observing import View
from exposight.planning.viewing.ring_visibility import RingVisibility, Sight, ViewingLimits
from exposight.planning.viewing.sensor_poses import ReachBox, sample_poses
from exposight.tables import Column, Table, counted
from exposight.workers import Progress, ignore_progress

FloatArray: TypeAlias = NDArray[np.float64]

_POOL, _PAIRS = 24, 200_000
"""Poses looked from for each that is kept; but not more pairs of pose and feature than this, which
cost some two seconds."""

Reach: TypeAlias = ReachBox | Mapping[str, RigidTransform] | Sequence[RigidTransform]
"""A box, or poses (camera_from_part) with or without names."""

_ALIKE_DEG, _ALIKE_RATIO = 10.0, 1.3
"""Half vectors by which, or distances at whose ratio, two views of a feature are two lights: a lobe
is a few degrees wide, and light falls by the square of distance (assumed)."""

_SMALL_MM, _HUGE = 50.0, 300.0
"""A mesh so many times as large as its features, these taken to be no smaller than this, is in
another unit."""

_FIRST = 3.0
"""How much more it counts to see a feature at all than to see it in another light."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Viewpoint:
    """A pose, and the features that it sees.

    Parameters
    ----------
    name : str
    camera_from_part : RigidTransform
        Where the part stands, seen from the sensor's first camera.
    features : tuple of str
        What can be measured from there, in the part's order.
    shares : tuple of float
        Share of each one's ring that is seen and lit.
    """

    name: str
    camera_from_part: RigidTransform
    features: tuple[str, ...]
    shares: tuple[float, ...]

    def view(self, part: Part, sensor: ActiveSensor) -> View:
        """Return what the sensor sees from here, features that are hidden left out."""
        seen = np.array([feature.name in self.features for feature in part.features])
        return View.of(_part_of(part, seen), sensor, self.camera_from_part, name=self.name)


@dataclass(frozen=True, kw_only=True, eq=False)
class CandidateViewpoints:
    """Poses to choose from.

    Parameters
    ----------
    views : tuple of Viewpoint
        Those that show most first.
    unreachable : mapping of str to str
        Features that none of them sees, and why.
    notes : tuple of str
        What was not considered.
    """

    views: tuple[Viewpoint, ...]
    unreachable: Mapping[str, str]
    notes: tuple[str, ...] = ()

    @property
    def poses(self) -> dict[str, RigidTransform]:
        """camera_from_part of each view by its name."""
        return {each.name: each.camera_from_part for each in self.views}

    @property
    def table(self) -> Table:
        """How many features each view sees, and which."""
        rows = [
            {"view": each.name, "n_features": len(each.features), "seen": ", ".join(each.features)}
            for each in self.views
        ]
        columns = (
            Column(name="view"),
            Column(name="n_features", label="features"),
            Column(name="seen", label="sees", wraps=True),
        )
        n_views = counted(len(self.views), "candidate view")
        return Table.of("candidate_views", rows, columns, title=n_views)


def candidate_views(
    part: Part,
    sensor: ActiveSensor,
    *,
    mesh: Mesh | None = None,
    reach: Reach | None = None,
    count: int = 48,
    seed: int = 0,
    limits: ViewingLimits | None = None,
    mesh_unit: str = "mm",
    progress: Progress = ignore_progress,
) -> CandidateViewpoints:
    """Find poses from which a sensor sees a part's features.

    Parameters
    ----------
    part : Part
        Its features are to be seen.
    sensor : ActiveSensor
        Its working distance, field of view and projector decide.
    mesh : Mesh, optional
        The part and whatever stands round it, in the part's frame: it hides and shadows. Without,
        nothing does, and the notes say so.
    reach : ReachBox, or mapping or sequence of RigidTransform, optional
        Where the robot can bring the sensor; or the poses (camera_from_part) to choose from.
        Anywhere by default. Whether the robot or the sensor hits the part is not considered.
    count : int
        Views to keep at most.
    seed : int, 0 or more
        All tilts, distances and azimuths follow from it.
    limits : ViewingLimits, optional
        From which angles, and to which share, a ring must be seen.
    mesh_unit : str
        What the mesh's file was taken to be written in, for messages.
    progress : Progress

    Raises
    ------
    FeatureError
        If features do not lie on the mesh, as of a mesh in another unit or frame.
    InputError
        If no pose in reach sees any feature; the message says why, feature by feature. If the count
        is below 1.
    """
    if count < 1:
        msg = f"at least one candidate view must be kept, got a count of {count}"
        raise InputError(msg)
    limits = limits or ViewingLimits()
    if mesh is not None:
        check_placement(part, mesh.vertices, mesh.faces, mesh_unit)
        _check_extent(part, mesh, mesh_unit)
    rings = RingVisibility(part, sensor, mesh, limits)
    names = [feature.name for feature in part.features]
    pool = _pool(rings, sensor, limits, reach, count, seed)
    shares, sights = _look_from_all(rings, list(pool.values()), progress)
    missing = ~(sights == Sight.SEEN).any(axis=0)
    if missing.any() and (reach is None or isinstance(reach, ReachBox)):
        size = max(len(pool) // 2, 1)
        nearer = sample_poses(rings, sensor, limits, reach, size, seed, among=missing)
        pool |= {f"missing-{i}": pose for i, pose in enumerate(nearer)}
        further = _look_from_all(rings, nearer, progress)
        shares = np.concatenate([shares, further[0]])
        sights = np.concatenate([sights, further[1]])
    poses = list(pool.values())
    seen = sights == Sight.SEEN
    unreachable = _unreachable(names, sights, shares)
    if len(unreachable) == len(names):
        where = "" if reach is None else " in reach"
        msg = (
            f"none of {counted(len(pool), 'pose')}{where} sees a feature: {_reasons(unreachable)}; "
            "check on which side features are, the working distance"
            f"{'' if reach is None else ', and the frame and unit of the reach'}"
        )
        raise InputError(msg)
    views = []
    for k in _diverse(seen, _lights(rings, sensor, poses), count):
        visible = View.of(_part_of(part, seen[k]), sensor, poses[k]).visible
        sees = [names.index(each.feature.name) for each in visible]
        if sees:
            view = Viewpoint(
                name=list(pool)[k],
                camera_from_part=poses[k],
                features=tuple(names[i] for i in sees),
                shares=tuple(shares[k, sees].tolist()),
            )
            views.append(view)
    if reach is None or isinstance(reach, ReachBox):
        digits = len(str(len(views)))
        views = [replace(v, name=f"auto-{i:0{digits}d}") for i, v in enumerate(views, start=1)]
    return CandidateViewpoints(
        views=tuple(views), unreachable=unreachable, notes=_notes(sensor, mesh)
    )


def _pool(
    rings: RingVisibility,
    sensor: ActiveSensor,
    limits: ViewingLimits,
    reach: Reach | None,
    count: int,
    seed: int,
) -> dict[str, RigidTransform]:
    """Return the poses that are looked from, by name."""
    if reach is None or isinstance(reach, ReachBox):
        size = min(_POOL * count, max(4 * count, _PAIRS // len(rings.centres)))
        poses = sample_poses(rings, sensor, limits, reach, size, seed)
        return {str(i): pose for i, pose in enumerate(poses)}
    if not len(reach):
        msg = "the reach is a list without a pose; give poses, a box, or none for anywhere"
        raise InputError(msg)
    if isinstance(reach, Mapping):
        return dict(reach)
    return {f"pose-{i:0{len(str(len(reach)))}d}": pose for i, pose in enumerate(reach, start=1)}


def _check_extent(part: Part, mesh: Mesh, unit: str) -> None:
    """Refuse a mesh beside which features are dust: a plane through the origin has them anyhow."""
    places = np.array([feature.part_from_feature.translation_mm for feature in part.features])
    features_mm = max(float(np.linalg.norm(np.ptp(places, axis=0))), _SMALL_MM)
    mesh_mm = float(np.linalg.norm(np.ptp(mesh.vertices, axis=0)))
    if mesh_mm > _HUGE * features_mm:
        msg = (
            f"the mesh reaches over {mesh_mm / 1000:.3g} m and the features of {part.name!r} over "
            f"{features_mm:.3g} mm: is it written in mm instead of {unit}? Say its unit, and give "
            "features in mm"
        )
        raise FeatureError(msg)


def _notes(sensor: ActiveSensor, mesh: Mesh | None) -> tuple[str, ...]:
    notes = []
    if mesh is None:
        notes.append(
            "without a mesh frame, facing and distance decide what a view sees; what the part "
            "hides or shadows is not known"
        )
    if sensor.projector is None:
        notes.append(
            f"where the projector of {sensor.name!r} is, is not known: its shadows are not "
            "considered"
        )
    return tuple(notes)


def _look_from_all(
    rings: RingVisibility, poses: Sequence[RigidTransform], progress: Progress
) -> tuple[FloatArray, NDArray[np.int8]]:
    """Return what each of m poses sees of n features: shares and sights, (m, n) each."""
    n = len(rings.centres)
    shares, sights = np.zeros((len(poses), n)), np.zeros((len(poses), n), dtype=np.int8)
    for k, pose in enumerate(poses):
        shares[k], sights[k] = rings.look(pose)
        progress("casting rays", k + 1, len(poses))
    return shares, sights


def _lights(
    rings: RingVisibility, sensor: ActiveSensor, poses: Sequence[RigidTransform]
) -> FloatArray:
    """Return how m poses light and look at n features, (m, n, 4): alike where less than 1 apart."""
    device = sensor.projector
    camera_from_light = RigidTransform() if device is None else device.camera_from_projector
    lights = np.empty((len(poses), len(rings.centres), 4))
    for k, pose in enumerate(poses):
        part_from_camera = pose.inverse()
        to_eye = part_from_camera.translation_mm - rings.centres
        to_light = part_from_camera.apply(camera_from_light.translation_mm) - rings.centres
        distance = np.linalg.norm(to_eye, axis=1, keepdims=True)
        half = to_eye / distance + to_light / np.linalg.norm(to_light, axis=1, keepdims=True)
        half /= np.maximum(np.linalg.norm(half, axis=1, keepdims=True), 1e-9)
        lights[k, :, :3] = half / np.sin(np.radians(_ALIKE_DEG))
        lights[k, :, 3:] = np.log(distance) / np.log(_ALIKE_RATIO)
    return lights


def _diverse(seen: NDArray[np.bool_], lights: FloatArray, count: int) -> list[int]:
    """Choose poses greedily: each shows most features that none before shows in such a light.

    Features that few of them show count for more.
    """
    newness, shown_by = np.full(seen.shape, _FIRST), np.zeros(seen.shape[1])
    kept: list[int] = []
    while len(kept) < count:
        gain = np.where(seen, newness / (1.0 + shown_by), 0.0).sum(axis=1)
        best = int(np.argmax(gain))
        if gain[best] < 1e-6:
            break
        kept.append(best)
        shown = seen[best]
        shown_by[shown] += 1.0
        apart = ((lights[:, shown] - lights[best, shown]) ** 2).sum(axis=-1)
        newness[:, shown] = np.minimum(newness[:, shown], np.minimum(apart, 1.0))
        newness[best] = 0.0
    return kept


_WHY: Mapping[Sight, str] = {
    Sight.OUT_OF_RANGE: "outside the working distance",
    Sight.FACING_AWAY: "facing away, or too obliquely",
    Sight.OUT_OF_FRAME: "out of a camera's frame",
    Sight.OFF_MESH: "part of its ring is not on the mesh",
    Sight.UNLIT: "outside the projector's light",
    Sight.HIDDEN: "hidden by the part",
    Sight.SHADOWED: "in the projector's shadow",
}


def _unreachable(
    names: Sequence[str], sights: NDArray[np.int8], shares: FloatArray
) -> dict[str, str]:
    """Return the features that no pose sees, and what stopped the pose that came nearest to it."""
    best = np.argmax(sights + shares, axis=0)
    return {
        name: _WHY[Sight(int(sights[k, i]))] + (f" ({most:.0%} of its ring seen)" if most else "")
        for i, (name, k, most) in enumerate(zip(names, best, shares.max(axis=0), strict=True))
        if sights[k, i] != Sight.SEEN
    }


def _reasons(unreachable: Mapping[str, str]) -> str:
    by_reason: dict[str, list[str]] = {}
    for name, why in unreachable.items():
        reason, _, share = why.partition(" (")
        by_reason.setdefault(reason, []).append(f"{name} ({share}" if share else name)
    return "; ".join(f"{', '.join(names)}: {why}" for why, names in by_reason.items())


def _part_of(part: Part, places: NDArray[np.bool_]) -> Part:
    return Part(name=part.name, features=tuple(part.features[i] for i in np.flatnonzero(places)))
