"""A flat plate seen by a sensor, with a perfect organised cloud: ground truth for p_norm = 1."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import trimesh
from numpy.typing import NDArray

from exposight.cell import ActiveSensor, Capture, Cloud, Feature, Part
from exposight.geometry import RigidTransform
from exposight.observing import FeatureView, PointSearch

RADII_MM = (3.0, 4.0, 5.0, 6.0, 8.0, 10.0, 12.0, 15.0, 20.0, 25.0, 30.0)


@dataclass(frozen=True, kw_only=True)
class Plate:
    """A plate's pose and the cloud that a perfect sensor would return of it."""

    camera_from_part: RigidTransform
    cloud: Cloud


def flat_plate(sensor: ActiveSensor, w_deg: float, p_deg: float) -> Plate:
    """Return a plate through the TCP, tilted, with a point on it for every pixel."""
    tilt = RigidTransform.from_fanuc_wpr([0, 0, 0], w_deg, p_deg, 0.0)
    pose = sensor.camera_from_tcp @ tilt
    rays = sensor.camera.rays()
    normal = pose.z_axis
    depth = (normal @ pose.translation_mm) / (rays @ normal[:2] + normal[2])
    points = np.concatenate([rays * depth[..., None], depth[..., None]], axis=2)
    return Plate(camera_from_part=pose, cloud=Cloud(points=points.astype(np.float32)))


def plate_capture(sensor: ActiveSensor, plate: Plate) -> Capture:
    """Return a capture of the plate, evenly grey."""
    image = np.full((sensor.camera.height, sensor.camera.width), 100, dtype=np.uint8)
    return Capture(
        view="plate",
        exposure_ms=10.0,
        image=image,
        cloud=plate.cloud,
        camera_from_part=plate.camera_from_part,
    )


def holes_side_by_side() -> Part:
    """Return a part with holes of 3 to 30 mm radius, at three places each, off the pixel grid."""
    features = [
        _hole(f"r{radius:g}_{place}", radius, 70.0 * place + 0.37 * radius, 3.3 * (radius % 5))
        for place in (-1, 0, 1)
        for radius in RADII_MM
    ]
    return Part(name="plate", features=tuple(features))


def many_holes(count: int) -> Part:
    """Return a part with holes of 3 to 30 mm radius, scattered from a fixed seed."""
    rng = np.random.default_rng(0)
    features = [
        _hole(f"h{i:03d}", rng.uniform(3, 30), rng.uniform(-240, 240), rng.uniform(-150, 150))
        for i in range(count)
    ]
    return Part(name="plate", features=tuple(features))


def _hole(name: str, radius_mm: float, x_mm: float, y_mm: float) -> Feature:
    pose = RigidTransform(translation_mm=np.array([x_mm, y_mm, 0.0]))
    return Feature(name=name, kind="hole", part_from_feature=pose, radius_mm=float(radius_mm))


_SECTIONS = 128  # facets: the mesh's chords lie within 0.01 mm of the cylinder at 30 mm radius


class TrimeshSearch(PointSearch):
    """Counts the points of the same pixels that our search looks at (Sect. 3.1.3 of the paper).

    Parameters
    ----------
    points : (rows, columns, 3) ndarray of float32, mm
        Organised cloud.
    """

    def __init__(self, points: NDArray[np.float32]) -> None:
        super().__init__(None, None)
        self._points = points

    def count(self, views: Sequence[FeatureView]) -> NDArray[np.int64]:
        """Return n_points of each view."""
        return np.array([self._count(view) for view in views], dtype=np.int64)

    def _count(self, view: FeatureView) -> int:
        box, region = view.search_box, view.region
        near = self._points[box.top : box.bottom, box.left : box.right].reshape(-1, 3)
        mesh = trimesh.creation.annulus(
            r_min=region.inner_mm,
            r_max=region.outer_mm,
            height=region.height_mm,
            sections=_SECTIONS,
            transform=view.camera_from_feature.to_matrix(),
        )
        return int(np.count_nonzero(mesh.contains(near[np.isfinite(near[:, 0])])))
