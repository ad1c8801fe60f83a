"""How well a cloud agrees with reference points along the same lines of sight."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from exposight.errors import CloudError

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from exposight.cell import Cloud
    from exposight.geometry import PinholeCamera


@dataclass(frozen=True, kw_only=True, eq=False)
class CloudAgreement:
    """Distances between reference points and a cloud at the same lines of sight.

    Parameters
    ----------
    distances_mm : (n,) ndarray, mm
        One per common point.
    """

    distances_mm: NDArray[np.float64]

    @property
    def common_points(self) -> int:
        """Number of reference points where the cloud has a point, too."""
        return int(self.distances_mm.size)

    @property
    def median_mm(self) -> float:
        """Median distance in mm."""
        return float(np.median(self.distances_mm))

    @property
    def p90_mm(self) -> float:
        """90th percentile of the distance in mm."""
        return float(np.percentile(self.distances_mm, 90))


def compare_along_rays(
    cloud: Cloud, reference_points: ArrayLike, camera: PinholeCamera
) -> CloudAgreement:
    """Compare a cloud with reference points in the same frame.

    A reference point need not lie on the line of sight of a pixel (other programs organise their
    clouds by the undistorted image): it is projected into the camera, and the cloud interpolated
    there between its four neighbouring pixels, all of which must have a point.

    Parameters
    ----------
    cloud : Cloud
        Organised like the camera's image, camera frame.
    reference_points : (..., 3) array_like, mm
        Camera frame; NaN where missing.
    camera : PinholeCamera
        The camera, lens distortion included.

    Raises
    ------
    CloudError
        If the cloud is not organised like the camera's image, or no point is common.
    """
    if cloud.points.shape != (camera.height, camera.width, 3):
        msg = (
            f"expected a cloud of {camera.height} rows × {camera.width} columns like the camera's "
            f"image, got shape {cloud.points.shape}"
        )
        raise CloudError(msg)
    given = np.asarray(reference_points, dtype=np.float64).reshape(-1, 3)
    reference: NDArray[np.float64] = given[np.isfinite(given).all(axis=1)]
    pixels = camera.project(reference)
    inside = (pixels >= 0).all(axis=1) & (pixels <= [camera.width - 1, camera.height - 1]).all(1)
    reference, pixels = reference[inside], pixels[inside]
    u = np.clip(np.floor(pixels[:, 0]).astype(np.intp), 0, max(camera.width - 2, 0))
    v = np.clip(np.floor(pixels[:, 1]).astype(np.intp), 0, max(camera.height - 2, 0))
    right, down = (pixels - np.column_stack([u, v])).T[:, :, None]
    u_next, v_next = np.minimum(u + 1, camera.width - 1), np.minimum(v + 1, camera.height - 1)
    points = cloud.points.astype(np.float64)
    upper = (1 - right) * points[v, u] + right * points[v, u_next]
    lower = (1 - right) * points[v_next, u] + right * points[v_next, u_next]
    distances = np.linalg.norm((1 - down) * upper + down * lower - reference, axis=1)
    distances = distances[np.isfinite(distances)]
    if not distances.size:
        msg = (
            "the cloud and the reference have no point in common; check that both are in mm and "
            "in the camera frame"
        )
        raise CloudError(msg)
    return CloudAgreement(distances_mm=distances)
