"""Other readings of a capture's inputs, tried where its points are not where its features are.

Turned axes, other units, the pose's inverse and turned normals are what users meet. The reading
that puts points round the features is the explanation.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from exposight.cell import (
    LENGTH_UNITS_MM,
    PAPER_TOLERANCE,
    ActiveSensor,
    Capture,
    Part,
    RingTolerance,
)
from exposight.contradictions import Contradiction, clouds, part_views
from exposight.geometry import RigidTransform, other_poses
from exposight.observing import masks
from exposight.observing.point_search import PointSearch


@dataclass(frozen=True, kw_only=True)
class Reading:
    """Another reading of a capture's inputs, in words, and the p_norm that it gives (median)."""

    words: str
    p_norm: float

    def __str__(self) -> str:
        return f"{self.words} (then p_norm is about {min(self.p_norm, 1.0):.2f})"


_FITS_P_NORM = 0.25
_TRIED_POINTS = 40_000
_UNITS = {unit: mm for unit, mm in LENGTH_UNITS_MM.items() if unit != "mm"}
_OTHER_UNITS = {"inches": 25.4, "µm": 0.001}


def reading_that_fits(
    capture: Capture,
    part: Part,
    sensor: ActiveSensor,
    tolerance: RingTolerance = PAPER_TOLERANCE,
) -> Reading | None:
    """Return the reading of a cloud, a pose and features that puts points round the features.

    Turned axes, other units, the pose's inverse, and turned normals are tried, each against the
    hollow cylinders of all features that it makes visible.
    """
    cloud = capture.require_cloud()
    points = cloud.valid_points
    step = max(1, len(points) // _TRIED_POINTS)
    points = points[::step]
    best: Reading | None = None
    for words, turned, tried_part, pose in _other_readings(points, part, capture.camera_from_part):
        p_norm = step * _p_norm(turned, tried_part, sensor, pose, tolerance)
        # Later readings are stranger ones: they must fit clearly better.
        if p_norm > max(_FITS_P_NORM, 1.1 * best.p_norm if best else 0.0):
            best = Reading(words=words, p_norm=p_norm)
    return best


def _other_readings(
    points: NDArray[np.float32], part: Part, camera_from_part: RigidTransform
) -> Iterator[tuple[str, NDArray[np.float32], Part, RigidTransform]]:
    for unit, scale in _UNITS.items():
        yield (
            f"the cloud is in {unit}: --cloud-unit {unit}",
            points * np.float32(scale),
            part,
            camera_from_part,
        )
    for unit, scale in _OTHER_UNITS.items():
        yield (
            f"the cloud is in {unit}: convert it to mm",
            points * np.float32(scale),
            part,
            camera_from_part,
        )
    yield (
        "the pose is the inverse one, part_from_camera: give its inverse",
        points,
        part,
        camera_from_part.inverse(),
    )
    yield (
        "the features' normals point into the part: --read-as normals=inward",
        points,
        _with_turned_normals(part),
        camera_from_part,
    )
    for said, pose in other_poses(camera_from_part):
        if not said.startswith("the inverse"):
            yield f"the pose is wrong: {said} would fit", points, part, pose
    for turn in clouds.axis_turns():
        turned = points @ turn.T.astype(np.float32)
        named = clouds.axes_named(turn)
        why = ", as viewers that use OpenGL want it" if named == "x -y -z" else ""
        yield f"its axes are turned{why}: --cloud-axes {named}", turned, part, camera_from_part
    for turn in clouds.axis_turns():
        named = clouds.axes_named(turn)
        for unit, scale in _UNITS.items():
            turned = points @ (scale * turn).T.astype(np.float32)
            yield (
                f"the cloud is in {unit} and its axes are turned: --cloud-unit {unit} "
                f"--cloud-axes {named}",
                turned,
                part,
                camera_from_part,
            )


def _with_turned_normals(part: Part) -> Part:
    turn = RigidTransform(rotation=np.diag([1.0, -1.0, -1.0]))
    features = tuple(
        replace(feature, part_from_feature=feature.part_from_feature @ turn)
        for feature in part.features
    )
    return replace(part, features=features)


def _p_norm(
    points: NDArray[np.float32],
    part: Part,
    sensor: ActiveSensor,
    camera_from_part: RigidTransform,
    tolerance: RingTolerance,
) -> float:
    """Return the median p_norm over the features that are visible; 0 where none is."""
    if np.median(points[:, 2]) <= 0:
        return 0.0
    views = masks.view_features(part, sensor, camera_from_part, tolerance)
    visible = [view for view in views if view.visibility is masks.Visibility.VISIBLE]
    if not visible:
        return 0.0
    counts = PointSearch(None, points).count(visible)
    return float(np.median(counts / [view.n_pixels for view in visible]))


def pose_that_fits(
    capture: Capture,
    part: Part,
    sensor: ActiveSensor,
    others: Iterable[tuple[str, RigidTransform]],
) -> str:
    """Return the reading of a pose that puts points round the features, if its own does not.

    Parameters
    ----------
    capture, part, sensor
        What was captured, of what, by what.
    others : iterable of (str, RigidTransform)
        Readings in words, and the pose they give.

    Returns
    -------
    str
        Empty where points lie round the features of the capture's own pose, or no reading fits.
    """
    points = capture.require_cloud().valid_points
    step = max(1, len(points) // _TRIED_POINTS)
    points = points[::step]
    if not len(points):
        return ""
    own = step * _p_norm(points, part, sensor, capture.camera_from_part, PAPER_TOLERANCE)
    best, words = max(_FITS_P_NORM, 1.5 * own), ""
    for said, pose in others:
        p_norm = step * _p_norm(points, part, sensor, pose, PAPER_TOLERANCE)
        if own < _FITS_P_NORM and p_norm > 1.1 * best:
            best, words = p_norm, said
    return f"{words} would put points round the features (p_norm about {min(best, 1.0):.2f})" * (
        words != ""
    )


def why_not_visible(part: Part, sensor: ActiveSensor, camera_from_part: RigidTransform) -> str:
    """Return what would make a part's features visible from a pose where none is, or ''."""
    words = [
        part_views.would_put(poses_in_view(part, sensor, camera_from_part), "in view"),
        "with their normals turned they would be visible: give the outward normals, or say "
        "--read-as normals=inward"
        if n_visible(_with_turned_normals(part), sensor, camera_from_part)
        else "",
    ]
    return "; ".join(filter(None, words))


def poses_in_view(
    part: Part,
    sensor: ActiveSensor,
    camera_from_part: RigidTransform,
    others: Iterable[tuple[str, RigidTransform]] | None = None,
) -> tuple[str, ...]:
    """Return the readings of a pose that put most features in view, within the sensor's reach.

    Parameters
    ----------
    part, sensor, camera_from_part
        What is seen, by what, from where.
    others : iterable of (str, RigidTransform), optional
        Readings in words, and what the pose would be; those of `other_poses` by default.
    """
    found: dict[str, int] = {}
    near, far = sensor.working_distance_mm
    for words, pose in other_poses(camera_from_part) if others is None else others:
        views = masks.view_features(part, sensor, pose)
        visible = [view for view in views if view.visibility is masks.Visibility.VISIBLE]
        within = [
            view
            for view in visible
            if 0.8 * near <= view.camera_from_feature.translation_mm[2] <= 1.25 * far
        ]
        found[words] = max(found.get(words, 0), len(within))
    most = max(found.values(), default=0)
    return tuple(words for words, count in found.items() if count and count >= 0.8 * most)


def n_visible(part: Part, sensor: ActiveSensor, camera_from_part: RigidTransform) -> int:
    """Return how many features are visible from a pose."""
    views = masks.view_features(part, sensor, camera_from_part)
    return sum(view.visibility is masks.Visibility.VISIBLE for view in views)


def pose_contradictions(
    views: Sequence[masks.FeatureView],
    part: Part,
    sensor: ActiveSensor,
    camera_from_part: RigidTransform,
    *,
    name: str = "",
) -> Iterator[Contradiction | None]:
    """Yield what of a pose does not agree with the sensor's view and working distance.

    Parameters
    ----------
    views : sequence of FeatureView
        The part's features as the pose has them.
    part, sensor, camera_from_part
        What they are of.
    name : str
        Of the view, for people.
    """
    reasons = Counter(view.visibility.value for view in views)
    visible = [view for view in views if view.visibility is masks.Visibility.VISIBLE]
    if not visible:
        readings = poses_in_view(part, sensor, camera_from_part)
        yield part_views.out_of_view(reasons, readings, view=name)
        return
    distance = np.array([view.camera_from_feature.translation_mm[2] for view in visible])
    if part_views.out_of_reach(distance, sensor.working_distance_mm, ()) is not None:
        readings = poses_in_view(part, sensor, camera_from_part)
        yield part_views.out_of_reach(distance, sensor.working_distance_mm, readings)


_DENSE, _WHOLE = 0.5, 0.8
_MOST_FILLED = 0.25
_TRIED_FEATURES = 20
"""So many features tell whether another pose fits; a part may have hundreds."""


def pose_with_holes(
    part: Part,
    sensor: ActiveSensor,
    camera_from_part: RigidTransform,
    tolerance: RingTolerance,
    observed: Callable[[tuple[masks.FeatureView, ...]], tuple[Sequence[float], Sequence[float]]],
) -> str:
    """Return the reading of a pose under which there are holes where holes are said to be, or ''.

    Parameters
    ----------
    part, sensor, camera_from_part, tolerance
        As for `masks.view_features`.
    observed : callable
        Returns p_norm of the visible features and the filled shares of their holes.
    """
    step = -(-len(part.features) // _TRIED_FEATURES)
    some = replace(part, features=part.features[::step])
    for words, pose in other_poses(camera_from_part):
        views = masks.view_features(some, sensor, pose, tolerance)
        p_norm, filled = observed(views)
        if len(filled) < 2 or float(np.median(p_norm)) < _WHOLE:
            continue
        if float(np.mean(np.array(filled) > _DENSE)) <= _MOST_FILLED:
            return f"{words} would put holes there (p_norm about {float(np.median(p_norm)):.2f})"
    return ""
