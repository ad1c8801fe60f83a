"""Where a view looks for a feature: the 2D mask of its ring, and the pixels round it.

Sect. 3.1.1 of the paper: the hollow cylinder's ring, projected at the feature's plane (Eqs. 6, 7),
is both the largest possible number of 3D points and the mask in which brightness is averaged. It
depends on where the sensor stands and not on the exposure, so it is computed once per view.
"""

from __future__ import annotations

import math
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
    StackedPoses,
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

    Masks are computed when the first feature of a view is asked for its own: a forecast needs none.

    Parameters
    ----------
    feature : Feature
    region : HollowCylinder
        Its measured region in its own frame.
    visibility : Visibility
        Why it cannot be measured, where it cannot.
    rings : PlacedRings
        Those of all features of the view.
    place : int
        The feature's among them.
    """

    feature: Feature
    region: HollowCylinder
    visibility: Visibility
    rings: PlacedRings
    place: int

    @cached_property
    def camera_from_feature(self) -> RigidTransform:
        """Where it is, seen from the first camera."""
        return self.rings.in_camera.at(self.place)

    @cached_property
    def tcp_from_feature(self) -> RigidTransform:
        """Where it is in the TCP frame."""
        return self.rings.in_tcp.at(self.place)

    @property
    def rows(self) -> NDArray[np.int64]:
        """Rows of the mask's pixels, (n,); none where it cannot be measured."""
        return self._pixels[0]

    @property
    def columns(self) -> NDArray[np.int64]:
        """Columns of the mask's pixels, (n,)."""
        return self._pixels[1]

    @property
    def _pixels(self) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        measurable = self.visibility is Visibility.VISIBLE
        return self.rings.pixels.get(self.place, _NO_PIXELS) if measurable else _NO_PIXELS

    @property
    def n_pixels(self) -> int:
        """The paper's n_max,2D: pixels whose centre lies in the ring (Eq. 6)."""
        return int(self.rows.size)

    @property
    def search_box(self) -> PixelBox:
        """Pixels whose points can lie in the hollow cylinder."""
        return self.rings.search_boxes[self.place]

    @property
    def pose(self) -> dict[str, Any]:
        """The columns of an observation table that the pose decides.

        Position in mm and orientation (`orientation_deg`) in the TCP frame, ``radius_mm``, and
        ``incidence_deg``.
        """
        return dict(zip(_POSE_COLUMNS, self.pose_values, strict=True))

    @cached_property
    def pose_values(self) -> tuple[float, ...]:
        """The values of `pose`."""
        return (
            *self.rings.in_tcp.translations_mm[self.place].tolist(),
            *orientation_deg(self.feature, self.tcp_from_feature),
            self.feature.radius_mm,
            float(self.rings.incidence_deg[self.place]),
        )


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

    @cached_property
    def visible(self) -> tuple[FeatureView, ...]:
        """The features that can be measured from here."""
        return tuple(each for each in self.features if each.visibility is Visibility.VISIBLE)

    @property
    def frame(self) -> pl.DataFrame:
        """Columns of an observation table for each visible feature: all that need no capture."""
        pixels = pl.Series("n_pixels", [each.n_pixels for each in self.visible], dtype=pl.Int64)
        return self.poses.clone().insert_column(3, pixels)

    @cached_property
    def poses(self) -> pl.DataFrame:
        """`frame` without ``n_pixels``, which takes the masks: what forecasts read."""
        visible = self.visible
        same = {"view": self.name, **self.shared}
        types = {str: pl.String, float: pl.Float64}
        return pl.DataFrame(
            _pose_series(visible)
            + [
                pl.Series(name, [value] * len(visible), dtype=types.get(type(value)))
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
    pixels = pl.Series("n_pixels", [each.n_pixels for each in features], dtype=pl.Int64)
    return pl.DataFrame(_pose_series(features)).insert_column(3, pixels)


def _pose_series(features: Sequence[FeatureView]) -> list[pl.Series]:
    """Return the columns of `pose_columns` but for ``n_pixels``."""
    names = {
        "feature": [each.feature.name for each in features],
        "finish": [each.feature.finish or None for each in features],
        "kind": [each.feature.kind for each in features],
    }
    poses = np.array([each.pose_values for each in features]).reshape(-1, len(_POSE_COLUMNS))
    return [
        *(pl.Series(name, values, dtype=pl.String) for name, values in names.items()),
        *map(pl.Series, _POSE_COLUMNS, np.ascontiguousarray(poses.T)),
    ]


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
    x, y, z = tcp_from_feature.z_axis.tolist()
    # z axis of Ry(p)·Rx(w) = (sin p · cos w, −sin w, cos p · cos w)
    w = math.asin(min(max(-y, -1.0), 1.0))
    return math.degrees(w), math.degrees(math.atan2(x, z)), 0.0


def incidence_deg(camera_from_feature: RigidTransform) -> float:
    """Return the angle between the camera's ray to a feature and the feature's normal, degrees."""
    pose = camera_from_feature
    return float(_incidence_deg(pose.translation_mm[None], pose.z_axis[None])[0])


def _incidence_deg(
    places_mm: NDArray[np.float64], normals: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the angles of incidence of n features, (n,); 90° where one is at the camera."""
    distance = np.sqrt((places_mm * places_mm).sum(axis=1))
    cosine = (places_mm * normals).sum(axis=1) / np.where(distance == 0.0, 1.0, distance)
    out: NDArray[np.float64] = np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0)))
    return out


class PlacedRings:
    """The measured regions of a part's features where a view has them.

    Parameters
    ----------
    part : Part
        Whose n features are looked for.
    sensor : ActiveSensor
        Its first camera takes the image; its TCP is the frame of the poses.
    camera_from_part : RigidTransform
        Where the part stands.
    tolerance : RingTolerance
        Height and radii of the hollow cylinders.
    """

    def __init__(
        self,
        part: Part,
        sensor: ActiveSensor,
        camera_from_part: RigidTransform,
        tolerance: RingTolerance,
    ) -> None:
        self.camera = sensor.camera
        self.regions = part.measured_regions(tolerance)
        self.in_camera = part.feature_poses.moved(camera_from_part)
        self._tcp_from_camera = sensor.camera_from_tcp.inverse()
        self.incidence_deg = _incidence_deg(
            self.in_camera.translations_mm, self.in_camera.rotations[:, :, 2]
        )
        self._outlines = outlines_in_camera(self.regions, self.in_camera)
        self._depths_mm = np.ascontiguousarray(self._outlines[:, :, 2])
        behind = self._depths_mm.min(axis=1) <= 0.0
        self._facing = np.flatnonzero(~behind & (self.incidence_deg < 90.0))
        self._hidden = [
            Visibility.BEHIND_CAMERA if each else Visibility.FACING_AWAY for each in behind.tolist()
        ]

    @cached_property
    def in_tcp(self) -> StackedPoses:
        """Poses of the features in the TCP frame."""
        return self.in_camera.moved(self._tcp_from_camera)

    @cached_property
    def pixels(self) -> dict[int, tuple[NDArray[np.int64], NDArray[np.int64]]]:
        """Rows and columns of the mask of each feature that faces the camera, by its place."""
        places = self._facing.tolist()
        regions = [self.regions[place] for place in places]
        poses = [self.in_camera.at(place) for place in places]
        return dict(zip(places, ring_pixels(regions, self.camera, poses), strict=True))

    @cached_property
    def search_boxes(self) -> list[PixelBox]:
        """Pixels whose points can lie in each hollow cylinder."""
        ends = [outlines_in_camera(self.regions, self.in_camera, end) for end in (-1.0, 1.0)]
        return pixel_boxes(np.concatenate(ends, axis=1), self.camera, _MARGIN_PX)

    def visibilities(self) -> list[Visibility]:
        """Return whether each feature can be measured, and if not, why."""
        out, facing = list(self._hidden), self._facing
        pixels = self.camera.project(self._outlines[facing])
        shares = self.camera.in_frame(pixels).mean(axis=1).tolist()
        across = np.ascontiguousarray(pixels.transpose(0, 2, 1))
        size = (self.camera.width, self.camera.height)
        # false where a point cannot be projected: NaN fails both
        beside = ((across.max(axis=2) < -1.0) | (across.min(axis=2) > size)).any(axis=1).tolist()
        for place, *where in zip(facing.tolist(), shares, beside, strict=True):
            out[place] = self._in_frame(place, *where)
        return out

    def _in_frame(self, place: int, share: float, beside: bool) -> Visibility:
        """Return whether a feature can be measured of whose outline the frame has a share."""
        if share == 1.0:
            wide = self._width_px[place] > _SURELY_PX or self._has_pixels(place)
            return Visibility.VISIBLE if wide else Visibility.BELOW_ONE_PIXEL
        partly = share > 0.0 or (not beside and self._has_pixels(place))
        return Visibility.PARTLY_OUT_OF_FRAME if partly else Visibility.OUT_OF_FRAME

    def _has_pixels(self, place: int) -> bool:
        region, pose = self.regions[place], self.in_camera.at(place)
        return bool(ring_pixels([region], self.camera, [pose])[0][0].size)

    @cached_property
    def _width_px(self) -> NDArray[np.float64]:
        """Width of each ring where it is narrowest, lens aside, (n,) px."""
        width_mm = np.array([each.outer_mm - each.inner_mm for each in self.regions])
        width_px = min(self.camera.fx, self.camera.fy) * width_mm / self._depths_mm.max(axis=1)
        out: NDArray[np.float64] = width_px * np.cos(np.radians(self.incidence_deg))
        return out


_SURELY_PX = 3.0
"""A ring √2 px wide holds a pixel's centre. The rest is for lenses, which shrink what is at the
image's border, and for what a ring's far side is turned away more than its centre."""


def view_features(
    part: Part,
    sensor: ActiveSensor,
    camera_from_part: RigidTransform,
    tolerance: RingTolerance = PAPER_TOLERANCE,
) -> tuple[FeatureView, ...]:
    """Find where a view sees a part's features, or the reasons why it does not.

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
    rings = PlacedRings(part, sensor, camera_from_part, tolerance)
    return tuple(
        FeatureView(
            feature=feature,
            region=rings.regions[place],
            visibility=visibility,
            rings=rings,
            place=place,
        )
        for place, (feature, visibility) in enumerate(
            zip(part.features, rings.visibilities(), strict=True)
        )
    )
