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

from exposight.cell import PAPER_TOLERANCE
from exposight.geometry import PixelBox, pixel_box, ring_pixels

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from exposight.cell import ActiveSensor, Feature, Part, RingTolerance
    from exposight.geometry import HollowCylinder, PinholeCamera, RigidTransform

_MARGIN_PX = 3
"""Slack round the pixels searched for points: decoded points stray a little from their pixel."""

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


def view_feature(
    feature: Feature,
    sensor: ActiveSensor,
    camera_from_part: RigidTransform,
    tolerance: RingTolerance = PAPER_TOLERANCE,
) -> FeatureView:
    """Find a feature's mask in a view, or the reason why it has none.

    Parameters
    ----------
    feature : Feature
        What to look for.
    sensor : ActiveSensor
        Its first camera takes the image; its TCP is the frame of the pose.
    camera_from_part : RigidTransform
        Where the part stands.
    tolerance : RingTolerance
        Height and radii of the hollow cylinder; the paper's by default (Sect. 3.1.3).

    Returns
    -------
    FeatureView
    """
    region = feature.measured_region(tolerance)
    camera_from_feature = camera_from_part @ feature.part_from_feature
    tcp_from_feature = sensor.camera_from_tcp.inverse() @ camera_from_feature
    w_deg, p_deg, r_deg = orientation_deg(feature, tcp_from_feature)
    angle = incidence_deg(camera_from_feature)
    visibility, rows, columns = _mask(region, sensor.camera, camera_from_feature, angle)
    return FeatureView(
        feature=feature,
        region=region,
        camera_from_feature=camera_from_feature,
        tcp_from_feature=tcp_from_feature,
        w_deg=w_deg,
        p_deg=p_deg,
        r_deg=r_deg,
        incidence_deg=angle,
        visibility=visibility,
        rows=rows,
        columns=columns,
        search_box=_search_box(region, sensor.camera, camera_from_feature),
    )


def view_features(
    part: Part,
    sensor: ActiveSensor,
    camera_from_part: RigidTransform,
    tolerance: RingTolerance = PAPER_TOLERANCE,
) -> tuple[FeatureView, ...]:
    """Do `view_feature` for every feature of a part, in the part's order."""
    return tuple(
        view_feature(feature, sensor, camera_from_part, tolerance) for feature in part.features
    )


def _mask(
    region: HollowCylinder,
    camera: PinholeCamera,
    camera_from_feature: RigidTransform,
    angle_deg: float,
) -> tuple[Visibility, NDArray[np.int64], NDArray[np.int64]]:
    nothing = np.zeros(0, dtype=np.int64)
    outline = camera_from_feature.apply(region.outline())
    if (outline[:, 2] <= 0).any():
        return Visibility.BEHIND_CAMERA, nothing, nothing
    if angle_deg >= 90.0:
        return Visibility.FACING_AWAY, nothing, nothing
    in_frame = camera.in_frame(camera.project(outline))
    rows, columns = ring_pixels(region, camera, camera_from_feature)
    if in_frame.all():
        visibility = Visibility.VISIBLE if rows.size else Visibility.BELOW_ONE_PIXEL
        return visibility, rows, columns
    partly = in_frame.any() or rows.size
    visibility = Visibility.PARTLY_OUT_OF_FRAME if partly else Visibility.OUT_OF_FRAME
    return visibility, nothing, nothing


def _search_box(
    region: HollowCylinder, camera: PinholeCamera, camera_from_feature: RigidTransform
) -> PixelBox:
    """Return the pixels onto which both ends of the hollow cylinder, hence all of it, project."""
    half = region.height_mm / 2
    ends = [region.outline(region.plane_z_mm + side * half) for side in (-1.0, 1.0)]
    pixels = camera.project(camera_from_feature.apply(np.concatenate(ends)))
    if not np.isfinite(pixels).all():
        return PixelBox(top=0, bottom=camera.height, left=0, right=camera.width)
    return pixel_box(pixels, camera, _MARGIN_PX)
