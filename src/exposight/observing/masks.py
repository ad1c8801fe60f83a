"""Where a view looks for a feature: the 2D mask of its ring, and the pixels round it.

Sect. 3.1.1 of the paper: the hollow cylinder's ring, projected at the feature's plane (Eqs. 6, 7),
is both the largest possible number of 3D points and the mask in which brightness is averaged. It
depends on where the sensor stands and not on the exposure, so it is computed once per view.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from functools import cached_property
from typing import Any

import numpy as np
import polars as pl
from numpy.typing import NDArray

from exposight.cell import PAPER_TOLERANCE, ActiveSensor, Feature, Part, RingTolerance
from exposight.geometry import (
    HollowCylinder,
    PixelBox,
    RigidTransform,
    outlines_in_camera,
    pixel_boxes,
    ring_pixels,
)
from exposight.tables import Column, Table

_MARGIN_PX = 3
"""Slack round the pixels searched for points: decoded points stray a little from their pixel."""

_NO_PIXELS = (np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64))

_POSE_COLUMNS = (
    "x_mm", "y_mm", "z_mm", "w_deg", "p_deg", "r_deg", "radius_mm", "incidence_deg",
)  # fmt: skip

_SYMMETRIC_KINDS = frozenset({"hole", "sphere", "surface_point"})


class Visibility(StrEnum):
    """Whether a feature can be measured from a view, and if not, why."""

    VISIBLE = "visible"
    BEHIND_CAMERA = "behind the camera"
    FACING_AWAY = "facing away"
    OUT_OF_FRAME = "out of frame"
    PARTLY_OUT_OF_FRAME = "partly out of frame"
    BELOW_ONE_PIXEL = "smaller than one pixel"


@dataclass(frozen=True, kw_only=True, eq=False)
class FeatureView:
    """A feature as one view sees it, whatever the exposure.

    Parameters
    ----------
    feature : Feature
    region : HollowCylinder
        Its measured region in its own frame.
    camera_from_feature, tcp_from_feature : RigidTransform
        Where it is.
    visibility : Visibility
        Why it cannot be measured, where it cannot.
    rows, columns : (n,) ndarray of int
        Pixels of the mask; empty where it cannot be measured.
    search_box : PixelBox
        Pixels whose points can lie in the hollow cylinder.
    """

    feature: Feature
    region: HollowCylinder
    camera_from_feature: RigidTransform
    tcp_from_feature: RigidTransform
    visibility: Visibility
    rows: NDArray[np.int64]
    columns: NDArray[np.int64]
    search_box: PixelBox

    @property
    def n_pixels(self) -> int:
        """The paper's n_max,2D: pixels whose centre lies in the ring (Eq. 6)."""
        return int(self.rows.size)

    @cached_property
    def pose(self) -> dict[str, Any]:
        """The columns of an observation table that the pose decides.

        Position in mm and orientation (`orientation_deg`) in the TCP frame, ``radius_mm``, and
        ``incidence_deg``.
        """
        values = (
            *self.tcp_from_feature.translation_mm.tolist(),
            *orientation_deg(self.feature, self.tcp_from_feature),
            self.feature.radius_mm,
            incidence_deg(self.camera_from_feature),
        )
        return dict(zip(_POSE_COLUMNS, values, strict=True))


@dataclass(frozen=True, kw_only=True, eq=False)
class View:
    """What a pose sees of a part: each of its features, also those that cannot be measured.

    Parameters
    ----------
    features : tuple of FeatureView
    name : str
        The view's; empty where it has none yet.
    shared : mapping of str to object
        Columns of an observation table that sensor, part and pose decide for all features
        (`shared_columns`).
    """

    features: tuple[FeatureView, ...]
    name: str = ""
    shared: Mapping[str, Any] = field(default_factory=dict)

    @classmethod
    def of(
        cls, part: Part, sensor: ActiveSensor, camera_from_part: RigidTransform, *, name: str = ""
    ) -> View:
        """Return what a sensor sees of a part that stands at `camera_from_part`."""
        return cls(
            features=view_features(part, sensor, camera_from_part),
            name=name,
            shared=shared_columns(part, sensor, camera_from_part),
        )

    @property
    def visible(self) -> tuple[FeatureView, ...]:
        """The features that can be measured from here."""
        return tuple(each for each in self.features if each.visibility is Visibility.VISIBLE)

    @property
    def frame(self) -> pl.DataFrame:
        """Columns of an observation table for each visible feature: all that need no capture."""
        frame = pose_columns(self.visible)
        same = {"view": self.name, **self.shared}
        types = {str: pl.String, float: pl.Float64}
        return frame.hstack(
            [
                pl.Series(name, [value] * frame.height, dtype=types.get(type(value)))
                for name, value in same.items()
            ]
        )

    def _repr_html_(self) -> str:
        reasons = pl.Series("visibility", [each.visibility.value for each in self.features])
        frame = pose_columns(self.features).with_columns(reasons)
        columns = ("feature", "visibility", "n_pixels", "incidence_deg", "z_mm")
        shown = tuple(Column(name=name, digits=3) for name in columns)
        return Table(name="view", frame=frame, columns=shown)._repr_html_()


def pose_columns(features: Sequence[FeatureView]) -> pl.DataFrame:
    """Return the columns of an observation table that features and their poses alone decide.

    A row for each feature: ``feature``, ``finish``, ``kind``, ``n_pixels``, and what
    `FeatureView.pose` has.
    """
    schema = {
        "feature": pl.String,
        "finish": pl.String,
        "kind": pl.String,
        "n_pixels": pl.Int64,
        **dict.fromkeys(_POSE_COLUMNS, pl.Float64),
    }
    rows = [
        (
            each.feature.name,
            each.feature.finish or None,
            each.feature.kind,
            each.n_pixels,
            *each.pose.values(),
        )
        for each in features
    ]
    return pl.DataFrame(rows, schema=schema, orient="row")


def tcp_text(sensor: ActiveSensor) -> str:
    """Return where a sensor's TCP is, as tables have it: x y z in mm and w p r in degrees."""
    tcp = sensor.camera_from_tcp
    numbers = (*tcp.translation_mm.tolist(), *tcp.to_fanuc_wpr())
    return " ".join(f"{number + 0.0:.6g}" for number in numbers)


def shared_columns(
    part: Part, sensor: ActiveSensor, camera_from_part: RigidTransform
) -> dict[str, Any]:
    """Return the columns of an observation table that say of which sensor and part a view is."""
    turn_deg = (sensor.camera_from_tcp.inverse() @ camera_from_part).to_fanuc_wpr()
    return {
        "sensor": sensor.name,
        "part": part.name,
        "tcp": tcp_text(sensor),
        **dict(zip(("part_w_deg", "part_p_deg", "part_r_deg"), turn_deg, strict=True)),
    }


def orientation_deg(
    feature: Feature, tcp_from_feature: RigidTransform
) -> tuple[float, float, float]:
    """Return a feature's (w, p, r) in the TCP frame (Sect. 3.1.2).

    A hole looks the same however it is turned about its own axis, so its r is nobody's choice but
    the drawing's. For holes, spheres and surface points the turn is therefore taken out: r = 0, as
    in all of the paper's Table 9, and (w, p) depend on the normal alone. Slots and pockets keep
    their turn.

    """
    if feature.kind not in _SYMMETRIC_KINDS:
        return tcp_from_feature.to_fanuc_wpr()
    x, y, z = tcp_from_feature.z_axis
    # z axis of Ry(p)·Rx(w) = (sin p · cos w, −sin w, cos p · cos w)
    w = np.arcsin(np.clip(-y, -1.0, 1.0))
    return float(np.degrees(w)), float(np.degrees(np.arctan2(x, z))), 0.0


def incidence_deg(camera_from_feature: RigidTransform) -> float:
    """Return the angle between the camera's ray to a feature and the feature's normal, degrees."""
    to_feature = camera_from_feature.translation_mm
    distance = float(np.linalg.norm(to_feature))
    if distance == 0.0:
        return 90.0
    cosine = float(to_feature @ camera_from_feature.z_axis) / distance
    return float(np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0))))


def view_features(
    part: Part,
    sensor: ActiveSensor,
    camera_from_part: RigidTransform,
    tolerance: RingTolerance = PAPER_TOLERANCE,
) -> tuple[FeatureView, ...]:
    """Find the masks of a part's features in a view, or the reasons why they have none.

    Parameters
    ----------
    part : Part
        Whose features are looked for, in its order.
    sensor : ActiveSensor
        Its first camera takes the image; its TCP is the frame of the poses.
    camera_from_part : RigidTransform
        Where the part stands.
    tolerance : RingTolerance
        Height and radii of the hollow cylinders; the paper's by default (Sect. 3.1.3).
    """
    regions = [feature.measured_region(tolerance) for feature in part.features]
    poses = [camera_from_part @ feature.part_from_feature for feature in part.features]
    camera = sensor.camera
    angles = [incidence_deg(pose) for pose in poses]
    outlines = outlines_in_camera(regions, poses)
    in_frame = camera.in_frame(camera.project(outlines))
    behind = outlines[:, :, 2].min(axis=1) <= 0
    facing = np.flatnonzero(~behind & (np.array(angles) < 90.0))
    masks = dict(
        zip(
            facing.tolist(),
            ring_pixels([regions[i] for i in facing], camera, [poses[i] for i in facing]),
            strict=True,
        )
    )
    ends = [outlines_in_camera(regions, poses, end) for end in (-1.0, 1.0)]
    boxes = pixel_boxes(np.concatenate(ends, axis=1), camera, _MARGIN_PX)
    tcp_from_camera = sensor.camera_from_tcp.inverse()
    views = []
    for i, feature in enumerate(part.features):
        rows, columns = masks.get(i, _NO_PIXELS)
        visibility = _visibility(bool(behind[i]), angles[i], in_frame[i], rows.size)
        if visibility is not Visibility.VISIBLE:
            rows, columns = _NO_PIXELS
        views.append(
            FeatureView(
                feature=feature,
                region=regions[i],
                camera_from_feature=poses[i],
                tcp_from_feature=tcp_from_camera @ poses[i],
                visibility=visibility,
                rows=rows,
                columns=columns,
                search_box=boxes[i],
            )
        )
    return tuple(views)


def _visibility(
    behind: bool, angle_deg: float, outline_in_frame: NDArray[np.bool_], n_pixels: int
) -> Visibility:
    if behind:
        return Visibility.BEHIND_CAMERA
    if angle_deg >= 90.0:
        return Visibility.FACING_AWAY
    if outline_in_frame.all():
        return Visibility.VISIBLE if n_pixels else Visibility.BELOW_ONE_PIXEL
    partly = outline_in_frame.any() or n_pixels
    return Visibility.PARTLY_OUT_OF_FRAME if partly else Visibility.OUT_OF_FRAME
