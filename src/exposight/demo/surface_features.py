"""Ring features placed on a scanned surface, for objects that have no drawing.

The skull has no holes whose pose anybody knows. So patches of its surface play their part: the pose
is a plane fitted to the decoded points, and the ring about the centre is measured as about a hole.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from exposight.cell import PAPER_TOLERANCE, ActiveSensor, Cloud, Feature, Part, RingTolerance
from exposight.errors import CloudError
from exposight.geometry import RigidTransform, rotation_facing
from exposight.observing import Visibility, point_search, view_features

if TYPE_CHECKING:
    from numpy.typing import NDArray

_MIN_POINTS = 50
"""Fewer points make no plane worth the name."""


@dataclass(frozen=True, kw_only=True)
class PlacementRules:
    """Which patches of a surface may carry a feature.

    Parameters
    ----------
    radius_mm : (float, float), mm
        Range of radii, drawn uniformly.
    max_rms_mm : float, mm
        How far the patch may deviate from its plane, root mean square.
    max_incidence_deg : float, degrees
        How steeply the camera may see it.
    p_norm : (float, float)
        The ring's p_norm in the cloud it is placed on: the surface must be there all round.
    min_distance_mm : float, mm
        Between the centres of two features: nearer ones would be near copies of each other.
    tolerance : RingTolerance
        Of the ring.
    """

    radius_mm: tuple[float, float] = (2.0, 6.0)
    max_rms_mm: float = 1.0
    max_incidence_deg: float = 50.0
    p_norm: tuple[float, float] = (0.9, 1.1)
    min_distance_mm: float = 3.0
    tolerance: RingTolerance = PAPER_TOLERANCE


def place_features(
    cloud: Cloud,
    sensor: ActiveSensor,
    *,
    count: int,
    rng: np.random.Generator,
    rules: PlacementRules | None = None,
) -> tuple[Feature, ...]:
    """Place ring features at random on a scanned surface.

    Parameters
    ----------
    cloud : Cloud
        Organised, in the frame of the sensor's first camera, which is also the part's frame.
    sensor : ActiveSensor
        Took the cloud.
    count : int
        How many.
    rng : numpy.random.Generator
        Draws places and radii.
    rules : PlacementRules, optional
        Which places are good.

    Returns
    -------
    tuple of Feature
        Of kind "hole", named s001, s002, …

    Raises
    ------
    CloudError
        If the cloud has no point, or the surface has not that many good places.
    """
    rules = rules or PlacementRules()
    cloud.require_points()
    features: list[Feature] = []
    search = point_search(cloud, sensor.camera)
    for row, column in rng.permutation(np.argwhere(cloud.valid)):
        if _crowded(cloud.points[row, column], features, rules.min_distance_mm):
            continue
        feature = Feature(
            name=f"s{len(features) + 1:03d}",
            kind="hole",
            part_from_feature=RigidTransform(),
            radius_mm=round(float(rng.uniform(*rules.radius_mm)), 2),
        )
        pose = _fit_pose(cloud, sensor, (int(row), int(column)), feature, rules)
        if pose is None:
            continue
        feature = replace(feature, part_from_feature=pose)
        patch = Part(name="patch", features=(feature,))
        (view,) = view_features(patch, sensor, RigidTransform(), rules.tolerance)
        if view.visibility is not Visibility.VISIBLE:
            continue
        low, high = rules.p_norm
        if view.incidence_deg <= rules.max_incidence_deg and (
            low <= search.count([view])[0] / view.n_pixels <= high
        ):
            features.append(feature)
        if len(features) == count:
            return tuple(features)
    msg = (
        f"the surface has good places for {len(features)} features, not for {count}; ask for "
        "fewer, or loosen the placement rules"
    )
    raise CloudError(msg)


def _crowded(point: NDArray[np.float32], features: list[Feature], min_distance_mm: float) -> bool:
    centres = [feature.part_from_feature.translation_mm for feature in features]
    return any(np.linalg.norm(point - centre) < min_distance_mm for centre in centres)


def _fit_pose(
    cloud: Cloud,
    sensor: ActiveSensor,
    pixel: tuple[int, int],
    feature: Feature,
    rules: PlacementRules,
) -> RigidTransform | None:
    """Fit a plane to the patch about a pixel's point; None where the surface is too uneven."""
    centre = cloud.points[pixel].astype(np.float64)
    reach_mm = feature.measured_region(rules.tolerance).outer_mm
    half = int(np.ceil(reach_mm * sensor.camera.fx / centre[2]))
    row, column = pixel
    window = cloud.points[
        max(row - half, 0) : row + half + 1, max(column - half, 0) : column + half + 1
    ]
    offsets = window.reshape(-1, 3).astype(np.float64) - centre
    offsets = offsets[np.einsum("ij,ij->i", offsets, offsets) <= reach_mm**2]  # NaN fails
    if len(offsets) < _MIN_POINTS:
        return None
    mean = offsets.mean(axis=0)
    variances, axes = np.linalg.eigh(np.cov(offsets, rowvar=False))
    if variances[0] > rules.max_rms_mm**2:
        return None
    normal = axes[:, 0] if axes[:, 0] @ centre > 0 else -axes[:, 0]  # into the material
    return RigidTransform(
        rotation=rotation_facing(normal), translation_mm=centre + (mean @ normal) * normal
    )
