"""The 2D mask of a feature: which pixels its ring covers, or why it cannot be measured.

Sect. 3.1.1 of the paper: the hollow cylinder's ring, projected at the feature's plane (Eqs. 6, 7),
is both the largest possible number of 3D points and the mask in which brightness is averaged. It
depends on where the sensor stands and not on the exposure, so it is computed once per view.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import TYPE_CHECKING

import numpy as np
import polars as pl

from exposight.cell import PAPER_TOLERANCE
from exposight.geometry import outlines_in_camera, pixel_boxes, ring_pixels
from exposight.tables import Column, Table

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from exposight.cell import ActiveSensor, Feature, Part, RingTolerance
    from exposight.geometry import HollowCylinder, PixelBox, RigidTransform

_MARGIN_PX = 3
"""Slack round the pixels searched for points: decoded points stray a little from their pixel."""

_NO_PIXELS = (np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64))

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
        The feature.
    region : HollowCylinder
        Its measured region in its own frame.
    camera_from_feature, tcp_from_feature : RigidTransform
        Where it is.
    w_deg, p_deg, r_deg : float, degrees
        Its orientation in the TCP frame (`orientation_deg`).
    incidence_deg : float, degrees
        Angle between the camera's ray to the feature and its normal; 0 is square.
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
    w_deg: float
    p_deg: float
    r_deg: float
    incidence_deg: float
    visibility: Visibility
    rows: NDArray[np.int64]
    columns: NDArray[np.int64]
    search_box: PixelBox

    @property
    def n_pixels(self) -> int:
        """The paper's n_max,2D: pixels whose centre lies in the ring (Eq. 6)."""
        return int(self.rows.size)


@dataclass(frozen=True, kw_only=True, eq=False)
class View:
    """What a pose sees of a part.

    Parameters
    ----------
    camera_from_part : RigidTransform
        The pose.
    features : tuple of FeatureView
        Every feature of the part, also those that cannot be measured from here.
    """

    camera_from_part: RigidTransform
    features: tuple[FeatureView, ...]

    @property
    def visible(self) -> tuple[FeatureView, ...]:
        """The features that can be measured from here."""
        return tuple(each for each in self.features if each.visibility is Visibility.VISIBLE)

    def _repr_html_(self) -> str:
        reasons = pl.Series("visibility", [each.visibility.value for each in self.features])
        frame = pose_columns(self.features).with_columns(reasons)
        columns = ("feature", "visibility", "n_pixels", "incidence_deg", "z_mm")
        shown = tuple(Column(name=name, digits=3) for name in columns)
        return Table(name="view", frame=frame, columns=shown)._repr_html_()


def pose_columns(features: Sequence[FeatureView]) -> pl.DataFrame:
    """Return the columns of an observation table that features' poses alone decide.

    Parameters
    ----------
    features : sequence of FeatureView
        As a view sees them.

    Returns
    -------
    polars.DataFrame
        One row for each feature: ``feature``, position in mm and orientation in degrees in the TCP
        frame, ``radius_mm``, ``n_pixels`` and ``incidence_deg``.
    """
    rows = [
        (
            each.feature.name,
            *each.tcp_from_feature.translation_mm.tolist(),
            each.w_deg,
            each.p_deg,
            each.r_deg,
            each.feature.radius_mm,
            each.n_pixels,
            each.incidence_deg,
        )
        for each in features
    ]
    numbers = ("x_mm", "y_mm", "z_mm", "w_deg", "p_deg", "r_deg", "radius_mm")
    schema = {
        "feature": pl.String,
        **dict.fromkeys(numbers, pl.Float64),
        "n_pixels": pl.Int64,
        "incidence_deg": pl.Float64,
    }
    return pl.DataFrame(rows, schema=schema, orient="row")


def orientation_deg(
    feature: Feature, tcp_from_feature: RigidTransform
) -> tuple[float, float, float]:
    """Return a feature's (w, p, r) in the TCP frame (Sect. 3.1.2).

    A hole looks the same however it is turned about its own axis, so its r is nobody's choice but
    the drawing's. For holes, spheres and surface points the turn is therefore taken out: r = 0, as
    in all of the paper's Table 9, and (w, p) depend on the normal alone. Slots and pockets keep
    their turn.

    Parameters
    ----------
    feature : Feature
        The feature.
    tcp_from_feature : RigidTransform
        Where it is.

    Returns
    -------
    w_deg, p_deg, r_deg : float, degrees
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
        Whose features are looked for.
    sensor : ActiveSensor
        Its first camera takes the image; its TCP is the frame of the poses.
    camera_from_part : RigidTransform
        Where the part stands.
    tolerance : RingTolerance
        Height and radii of the hollow cylinders; the paper's by default (Sect. 3.1.3).

    Returns
    -------
    tuple of FeatureView
        In the part's order.
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
        tcp_from_feature = tcp_from_camera @ poses[i]
        w_deg, p_deg, r_deg = orientation_deg(feature, tcp_from_feature)
        views.append(
            FeatureView(
                feature=feature,
                region=regions[i],
                camera_from_feature=poses[i],
                tcp_from_feature=tcp_from_feature,
                w_deg=w_deg,
                p_deg=p_deg,
                r_deg=r_deg,
                incidence_deg=angles[i],
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
