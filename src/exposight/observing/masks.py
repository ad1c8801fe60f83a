"""Where a view looks for a feature: the 2D mask of its ring, and its points in the cloud.

Sect. 3.1.1 of the paper: the hollow cylinder's ring, projected at the feature's plane (Eqs. 6, 7),
is both the largest possible number of 3D points and the mask in which brightness is averaged. It
depends on where the sensor stands and not on the exposure, so it is computed once per view.

Points inside the hollow cylinder (Eq. 4) are counted without touching most of the cloud. Those of
an organised cloud that lie where their pixels look are found by those pixels: only the ones onto
which the cylinder projects need be looked at. All other points are sorted once along their longest
side, so that a cylinder needs only the slice beside it. Together they give the very count that
testing every point would.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from functools import cached_property
from typing import Any

import numba
import numpy as np
import polars as pl
from numpy.typing import NDArray

from exposight.cell import PAPER_TOLERANCE, ActiveSensor, Cloud, Feature, Part, RingTolerance
from exposight.compiled import njit
from exposight.geometry import (
    HollowCylinder,
    PinholeCamera,
    PixelBox,
    RigidTransform,
    count_points_inside,
    grid_camera,
    grid_ratio,
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


_NO_SIGMA = np.empty((1, 0), dtype=np.float32)

_STRAY_PX = 1.0
"""How far beside its pixel a point may lie to be found by it; less than a search box's margin."""


class PointSearch:
    """Counts a cloud's points inside features' hollow cylinders; `point_search` makes one.

    Parameters
    ----------
    by_pixel : (h, w, 3) ndarray of float32 or None
        Points that lie where their pixels look; others are NaN.
    by_slice : (n, 3) ndarray of float32 or None
        All other points.
    camera : PinholeCamera, optional
        Whose pixels they are; the camera of the cloud's own grid, where that is coarser.
    ratio : int
        Of the image's grid to the cloud's.
    sigma : (h, w) ndarray and (n,) ndarray of float32, optional
        Standard deviations of z of both, mm; empty where not known.
    """

    def __init__(
        self,
        by_pixel: NDArray[np.float32] | None,
        by_slice: NDArray[np.float32] | None,
        camera: PinholeCamera | None = None,
        ratio: int = 1,
        sigma: tuple[NDArray[np.float32], NDArray[np.float32]] = (_NO_SIGMA, _NO_SIGMA[0]),
    ) -> None:
        self.by_pixel, self.by_slice, self.camera, self._ratio = by_pixel, by_slice, camera, ratio
        self.sigma_by_pixel, self._sigma_by_slice = sigma
        if by_slice is not None:
            self._axis = int(np.argmax(np.ptp(by_slice, axis=0))) if len(by_slice) else 0
            order = np.argsort(by_slice[:, self._axis], kind="stable")
            self.by_slice = by_slice[order]
            if self._sigma_by_slice.size:
                self._sigma_by_slice = self._sigma_by_slice[order]
            self._coordinate = np.ascontiguousarray(self.by_slice[:, self._axis])

    def count(self, views: Sequence[FeatureView]) -> NDArray[np.int64]:
        """Return the paper's n_points (Eq. 4) of each feature."""
        counts = np.zeros(len(views), dtype=np.int64)
        if self.by_pixel is not None:
            counts += _count(views, self.by_pixel, [view.search_box for view in views])
        if self.by_slice is not None:
            counts += _count(views, self.by_slice, [self._slice(view) for view in views])
        return counts

    def pixels(self, views: Sequence[FeatureView]) -> NDArray[np.int64]:
        """Return the paper's n_max,2D (Eq. 6) of each feature: pixels of the cloud's own grid."""
        if self.camera is None or self._ratio == 1:
            return np.array([view.n_pixels for view in views], dtype=np.int64)
        poses = [view.camera_from_feature for view in views]
        rings = ring_pixels([view.region for view in views], self.camera, poses) if views else ()
        return np.array([rows.size for rows, _ in rings], dtype=np.int64)

    def box(self, view: FeatureView) -> PixelBox:
        """Return a feature's search box in pixels of the cloud's grid."""
        box, ratio = view.search_box, self._ratio
        if ratio == 1 or self.camera is None:
            return box
        return PixelBox(
            top=box.top // ratio,
            bottom=min(-(-box.bottom // ratio), self.camera.height),
            left=box.left // ratio,
            right=min(-(-box.right // ratio), self.camera.width),
        )

    def raster(self, view: FeatureView) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Return the points that the pixels of a feature's search box see, and their sigma.

        Points that lie elsewhere than where their pixels look are projected; of several in a pixel
        one remains.

        Returns
        -------
        (h, w, 3) ndarray of float32, mm
            NaN where there is none.
        (h, w) ndarray of float32, mm
            Empty where not known.
        """
        box, camera = self.box(view), self.camera
        shape = (box.bottom - box.top, box.right - box.left)
        rows, columns = slice(box.top, box.bottom), slice(box.left, box.right)
        points = np.full((*shape, 3), np.nan, dtype=np.float32)
        known = self._sigma_by_slice.size or self.sigma_by_pixel.size
        sigma = np.full(shape, np.nan, dtype=np.float32) if known else _NO_SIGMA
        if self.by_pixel is not None:
            points[:] = self.by_pixel[rows, columns]
            if self.sigma_by_pixel.size:
                sigma[:] = self.sigma_by_pixel[rows, columns]
        if self.by_slice is None or camera is None:
            return points, sigma
        part = self._slice(view)
        near = self.by_slice[part.left : part.right]
        with np.errstate(invalid="ignore"):
            pixels = np.rint(camera.project(near)) - (box.left, box.top)
            inside = ((pixels >= 0) & (pixels < shape[::-1])).all(axis=1)
        u, v = pixels[inside].astype(np.int64).T
        points[v, u] = near[inside]
        if self._sigma_by_slice.size:
            sigma[v, u] = self._sigma_by_slice[part.left : part.right][inside]
        return points, sigma

    def _slice(self, view: FeatureView) -> PixelBox:
        centre = view.camera_from_feature.translation_mm[self._axis]
        reach = view.region.bounding_radius_mm
        # float32 neighbours of the bounds: searching float32 values must not lose a border point
        low = np.nextafter(np.float32(centre - reach), np.float32(-np.inf))
        high = np.nextafter(np.float32(centre + reach), np.float32(np.inf))
        start = int(np.searchsorted(self._coordinate, low, side="left"))
        stop = int(np.searchsorted(self._coordinate, high, side="right"))
        return PixelBox(top=0, bottom=1, left=start, right=stop)


def point_search(cloud: Cloud, camera: PinholeCamera) -> PointSearch:
    """Choose the quickest exact way to search a cloud.

    Parameters
    ----------
    cloud : Cloud
        Points in the camera's frame, mm.
    camera : PinholeCamera
        The camera whose pixels an organised cloud has, or a whole fraction of them (`grid_ratio`).
    """
    sigma = _NO_SIGMA if cloud.sigma_z_mm is None else cloud.sigma_z_mm
    listed = (_NO_SIGMA, sigma[cloud.valid] if sigma.size else _NO_SIGMA[0])
    ratio = grid_ratio(cloud.valid.shape, (camera.height, camera.width))
    if ratio is None:
        return PointSearch(None, cloud.valid_points, camera, sigma=listed)
    if ratio > 1:
        rows, columns = cloud.valid.shape
        grid = grid_camera(camera, (rows, columns), cloud.points)
        return PointSearch(None, cloud.valid_points, grid, ratio, listed)
    allowed_x, allowed_y = _STRAY_PX / camera.fx, _STRAY_PX / camera.fy
    stray, n_stray = _find_strays(cloud.points, camera.rays(), allowed_x, allowed_y)
    if n_stray == 0:
        return PointSearch(cloud.points, None, camera, sigma=(sigma, _NO_SIGMA[0]))
    if n_stray == cloud.n_valid:
        return PointSearch(None, cloud.valid_points, camera, sigma=listed)
    following = cloud.points.copy()
    following[stray] = np.nan
    return PointSearch(
        following,
        cloud.points[stray],
        camera,
        sigma=(sigma, sigma[stray] if sigma.size else sigma[0]),
    )


@njit(parallel=True)
def _find_strays(
    points: NDArray[np.float32], rays: NDArray[np.float64], allowed_x: float, allowed_y: float
) -> tuple[NDArray[np.bool_], int]:
    """Mark the points that do not lie where their pixels look, and count them."""
    stray = np.empty(points.shape[:2], dtype=np.bool_)
    count = 0
    for v in numba.prange(points.shape[0]):
        row, ray, marks = points[v], rays[v], stray[v]
        in_row = 0
        for u in range(row.shape[0]):
            x, y, z = row[u, 0], row[u, 1], row[u, 2]
            # False behind the camera, and where the lens model gives the pixel no ray
            near = (abs(x - ray[u, 0] * z) <= allowed_x * z) & (
                abs(y - ray[u, 1] * z) <= allowed_y * z
            )
            marks[u] = (z == z) & (not near)  # a missing point is NaN, and strays nowhere
            in_row += marks[u]
        count += in_row
    return stray, count


def _count(
    views: Sequence[FeatureView], points: NDArray[np.float32], boxes: Sequence[PixelBox]
) -> NDArray[np.int64]:
    return count_points_inside(
        [view.region for view in views],
        points,
        [view.camera_from_feature for view in views],
        boxes,
    )
