"""Pinhole cameras with OpenCV's lens distortion: project, back-project, rays.

A projector is the same thing with light running the other way, and is described by the same class.
Camera frame: x right, y down, z forward along the optical axis, mm. Pixel centres are integers,
u is the column and v the row (``docs/conventions.md``). Eq. 7 of the paper.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING

import numba
import numpy as np

from exposight.compiled import njit
from exposight.errors import ImageError, SensorError
from exposight.geometry.distortion import (
    N_COEFFICIENTS,
    distort_points,
    radius_limit,
    tilt_matrix,
    undistort_point,
    undistort_points,
)
from exposight.geometry.poses import check_points

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

_DISTORTION_LENGTHS = (0, 4, 5, 8, 12, 14)  # the lengths OpenCV knows


@dataclass(frozen=True, kw_only=True)
class PinholeCamera:
    """A camera or projector: image size, intrinsic parameters, lens distortion.

    Parameters
    ----------
    width, height : int, px
        Image size.
    fx, fy : float, px
        Focal lengths.
    cx, cy : float, px
        Principal point; integer values are pixel centres.
    skew : float, px
        Entry (0, 1) of the camera matrix.
    distortion : tuple of float
        OpenCV's coefficients k1, k2, p1, p2[, k3[, k4, k5, k6[, s1, s2, s3, s4[, τx, τy]]]].

    Raises
    ------
    SensorError
        If a size or focal length is not positive, or a number is not finite, or OpenCV knows no
        distortion of this length.
    """

    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float
    skew: float = 0.0
    distortion: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        object.__setattr__(self, "distortion", tuple(float(k) for k in self.distortion))
        size = (self.width, self.height)
        if not all(np.isfinite(n) and n == int(n) and n >= 1 for n in size):
            msg = f"an image size must be whole and positive, got {size[0]} × {size[1]} px"
            raise SensorError(msg)
        numbers = (self.fx, self.fy, self.cx, self.cy, self.skew, *self.distortion)
        if not np.isfinite(numbers).all():
            msg = f"intrinsic parameters must be finite, got {numbers}"
            raise SensorError(msg)
        if self.fx <= 0 or self.fy <= 0:
            msg = f"focal lengths must be positive, got fx = {self.fx} px, fy = {self.fy} px"
            raise SensorError(msg)
        if len(self.distortion) not in _DISTORTION_LENGTHS:
            msg = (
                f"lens distortion needs {', '.join(map(str, _DISTORTION_LENGTHS))} coefficients "
                f"in OpenCV's order, got {len(self.distortion)}"
            )
            raise SensorError(msg)

    @classmethod
    def from_matrix(
        cls, matrix: ArrayLike, *, width: int, height: int, distortion: ArrayLike = ()
    ) -> PinholeCamera:
        """Build a camera from a 3×3 camera matrix in px and OpenCV's distortion coefficients.

        Raises
        ------
        SensorError
            If the matrix is not a camera matrix ``[[fx, s, cx], [0, fy, cy], [0, 0, 1]]``.
        """
        array = np.asarray(matrix, dtype=np.float64)
        if array.shape != (3, 3):
            msg = f"a camera matrix must be 3×3, got shape {array.shape}"
            raise SensorError(msg)
        lower = (array[1, 0], array[2, 0], array[2, 1], array[2, 2] - 1.0)
        if not np.allclose(lower, 0.0, atol=1e-9):
            msg = (
                "a camera matrix must read [[fx, s, cx], [0, fy, cy], [0, 0, 1]], "
                f"got {array.tolist()}; is it transposed, or of an uncalibrated camera?"
            )
            raise SensorError(msg)
        return cls(
            width=width,
            height=height,
            fx=float(array[0, 0]),
            fy=float(array[1, 1]),
            cx=float(array[0, 2]),
            cy=float(array[1, 2]),
            skew=float(array[0, 1]),
            distortion=tuple(np.asarray(distortion, dtype=np.float64).reshape(-1).tolist()),
        )

    @property
    def matrix(self) -> NDArray[np.float64]:
        """(3, 3) camera matrix in px."""
        return np.array([[self.fx, self.skew, self.cx], [0.0, self.fy, self.cy], [0.0, 0.0, 1.0]])

    @property
    def coefficients(self) -> NDArray[np.float64]:
        """(14,) distortion coefficients, missing ones 0."""
        coefficients = np.zeros(N_COEFFICIENTS)
        coefficients[: len(self.distortion)] = self.distortion
        return coefficients

    @property
    def _image_from_distorted(self) -> NDArray[np.float64]:
        """(3, 3) homography from distorted normalised coordinates to pixels, tilt included."""
        return np.asarray(self.matrix @ tilt_matrix(self.coefficients))

    def project(self, points: ArrayLike) -> NDArray[np.float64]:
        """Project points to pixels (Eq. 7), lens distortion included.

        Parameters
        ----------
        points : (..., 3) array_like, mm
            Points in the camera frame.

        Returns
        -------
        (..., 2) ndarray, px
            u (column) and v (row), also outside the frame; NaN for points that are missing, not in
            front of the camera, or so far off the axis that the distortion model folds over.

        Raises
        ------
        CloudError
            If the points are not (..., 3).
        """
        xyz = check_points(points)
        z = xyz[..., 2]
        depth = np.where(z > 0, z, np.nan)
        normalised = (xyz[..., :2] / depth[..., None]).reshape(-1, 2)
        if not any(self.distortion):
            return _homography(self.matrix, normalised).reshape(*z.shape, 2)
        k = self.coefficients
        distorted = distort_points(np.ascontiguousarray(normalised), k, _radius_limit(self))
        return _homography(self._image_from_distorted, distorted).reshape(*z.shape, 2)

    def undistort(self, pixels: ArrayLike) -> NDArray[np.float64]:
        """Return the normalised coordinates X/Z, Y/Z seen by pixels, lens distortion undone.

        Parameters
        ----------
        pixels : (..., 2) array_like, px
            u (column) and v (row); need not be integers.

        Returns
        -------
        (..., 2) ndarray
            X/Z and Y/Z; NaN where the distortion model reaches no such pixel.

        Raises
        ------
        ImageError
            If the pixels are not (..., 2).
        """
        uv = _check_pixels(pixels)
        inverse = np.asarray(np.linalg.inv(self._image_from_distorted), dtype=np.float64)
        distorted = _homography(inverse, uv.reshape(-1, 2))
        if not any(self.distortion):
            return distorted.reshape(uv.shape)
        undistorted = undistort_points(distorted, self.coefficients, _radius_limit(self))
        return np.asarray(undistorted).reshape(uv.shape)

    def back_project(self, pixels: ArrayLike, depth_mm: ArrayLike) -> NDArray[np.float64]:
        """Return the points at given depths behind pixels.

        Parameters
        ----------
        pixels : (..., 2) array_like, px
            u (column) and v (row).
        depth_mm : (...) array_like, mm
            Z in the camera frame.

        Returns
        -------
        (..., 3) ndarray, mm
            Points in the camera frame.
        """
        normalised = self.undistort(pixels)
        z = np.broadcast_to(np.asarray(depth_mm, dtype=np.float64), normalised.shape[:-1])
        return np.concatenate([normalised * z[..., None], z[..., None]], axis=-1)

    def rays(self) -> NDArray[np.float64]:
        """Return X/Z and Y/Z of every pixel centre, computed once per camera and kept.

        Returns
        -------
        (height, width, 2) ndarray
            Read-only; NaN where the distortion model reaches no such pixel.
        """
        return _rays(self)

    def in_frame(self, pixels: ArrayLike) -> NDArray[np.bool_]:
        """Decide which (..., 2) pixel positions fall on the image's pixels."""
        uv = _check_pixels(pixels)
        u, v = uv[..., 0], uv[..., 1]
        inside = (u >= -0.5) & (u < self.width - 0.5) & (v >= -0.5) & (v < self.height - 0.5)
        return np.asarray(inside)


def _check_pixels(pixels: ArrayLike) -> NDArray[np.float64]:
    uv = np.asarray(pixels, dtype=np.float64)
    if uv.ndim == 0 or uv.shape[-1] != 2:
        msg = f"pixels must be an array (..., 2) of u and v, got shape {uv.shape}"
        raise ImageError(msg)
    return uv


def _homography(matrix: NDArray[np.float64], points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Map (n, 2) points by a (3, 3) homography."""
    mapped = points @ matrix[:2, :2].T + matrix[:2, 2]
    if matrix[2, 0] == 0.0 and matrix[2, 1] == 0.0:
        return np.asarray(mapped / matrix[2, 2])
    weight = points @ matrix[2, :2] + matrix[2, 2]
    return np.asarray(mapped / weight[:, None])


@lru_cache(maxsize=32)
def _radius_limit(camera: PinholeCamera) -> float:
    return radius_limit(camera.coefficients)


@lru_cache(maxsize=4)  # 64 MB each at 4 megapixels
def _rays(camera: PinholeCamera) -> NDArray[np.float64]:
    inverse = np.asarray(np.linalg.inv(camera._image_from_distorted), dtype=np.float64)
    rays = np.empty((camera.height, camera.width, 2))
    limit = _radius_limit(camera)
    _fill_rays(rays, inverse, camera.coefficients, limit, any(camera.distortion))
    rays.setflags(write=False)
    return rays


@njit(parallel=True, error_model="numpy")
def _fill_rays(
    rays: NDArray[np.float64],
    distorted_from_image: NDArray[np.float64],
    k: NDArray[np.float64],
    radius_limit: float,
    has_distortion: bool,
) -> None:
    h = distorted_from_image
    for v in numba.prange(rays.shape[0]):
        offset_x = 0.0
        offset_y = 0.0
        for u in range(rays.shape[1]):
            weight = h[2, 0] * u + h[2, 1] * v + h[2, 2]
            x = (h[0, 0] * u + h[0, 1] * v + h[0, 2]) / weight
            y = (h[1, 0] * u + h[1, 1] * v + h[1, 2]) / weight
            if has_distortion:
                # The neighbour's displacement is a guess so near that one or two steps suffice.
                ray_x, ray_y = undistort_point(x, y, x + offset_x, y + offset_y, k, radius_limit)
                offset_x = 0.0 if np.isnan(ray_x) else ray_x - x
                offset_y = 0.0 if np.isnan(ray_x) else ray_y - y
                x, y = ray_x, ray_y
            rays[v, u, 0] = x
            rays[v, u, 1] = y
