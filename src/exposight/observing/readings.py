"""Other readings of a capture's inputs, tried where its points are not where its features are.

Turned axes, other units, the pose's inverse and turned normals are what users meet. The reading
that puts points round the features is the explanation.
"""

from __future__ import annotations

from collections.abc import Iterator
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
from exposight.contradictions import clouds
from exposight.geometry import RigidTransform
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


def why_not_visible(part: Part, sensor: ActiveSensor, camera_from_part: RigidTransform) -> str:
    """Return what would make a part's features visible from a pose where none is, or ''."""
    for words, tried, pose in (
        (
            "the inverse of the pose would put the part in view: is it part_from_camera?",
            part,
            camera_from_part.inverse(),
        ),
        (
            "with their normals turned they would be visible: give the outward normals, or say "
            "--read-as normals=inward",
            _with_turned_normals(part),
            camera_from_part,
        ),
        (
            "with a translation 1000 times as long the part would be in view: is the pose in m?",
            part,
            replace(camera_from_part, translation_mm=1000.0 * camera_from_part.translation_mm),
        ),
    ):
        views = masks.view_features(tried, sensor, pose)
        if any(view.visibility is masks.Visibility.VISIBLE for view in views):
            return words
    return ""
