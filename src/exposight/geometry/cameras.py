"""Pinhole cameras with OpenCV's lens distortion: project, back-project, rays.

A projector is the same thing with light running the other way, and is described by the same class.
Camera frame: x right, y down, z forward along the optical axis, mm. Pixel centres are integers,
u is the column and v the row (``docs/conventions.md``). Eq. 7 of the paper.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numba
import numpy as np
from numpy.typing import ArrayLike, NDArray

from exposight.compiled import njit
from exposight.errors import ImageError, SensorError
from exposight.geometry.poses import check_points

_MOST_PX = 65_535
_DISTORTION_LENGTHS = (0, 4, 5, 8, 12, 14)  # the lengths OpenCV knows
_MOST_PIXELS = 100_000
_LARGEST = 1e9
"""Of focal lengths and coefficients, and 1 by it the shortest focal length, px."""


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
        if max(size) > _MOST_PX:
            msg = f"images have up to {_MOST_PX} px on a side, got {size[0]} × {size[1]} px"
            raise SensorError(msg)
        numbers = (self.fx, self.fy, self.cx, self.cy, self.skew, *self.distortion)
        if max(size) > _MOST_PIXELS:
            msg = f"an image has at most {_MOST_PIXELS} px a side, got {size[0]:g} × {size[1]:g} px"
            raise SensorError(msg)
        if not np.isfinite(numbers).all() or max(map(abs, numbers)) > _LARGEST:
            msg = f"intrinsic parameters must be finite, and at most {_LARGEST:g}, got {numbers}"
            raise SensorError(msg)
        if min(self.fx, self.fy) < 1.0 / _LARGEST:
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
        return np.array(self.distortion + (0.0,) * (14 - len(self.distortion)))

    @property
    def radius_limit(self) -> float:
        """Radius X/Z beyond which nothing is projected, as the radial model folds over there."""
        return _radius_limit(self)

    @property
    def image_from_distorted(self) -> NDArray[np.float64]:
        """(3, 3) homography from distorted normalised coordinates to pixels, tilt included."""
        return np.asarray(self.matrix @ _tilt_matrix(self.coefficients))

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
        distorted = distort_points(np.ascontiguousarray(normalised), k, self.radius_limit)
        return _homography(self.image_from_distorted, distorted).reshape(*z.shape, 2)

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
        inverse = np.asarray(np.linalg.inv(self.image_from_distorted), dtype=np.float64)
        distorted = _homography(inverse, uv.reshape(-1, 2))
        if not any(self.distortion):
            return distorted.reshape(uv.shape)
        undistorted = undistort_points(distorted, self.coefficients, self.radius_limit)
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
    """Search the radius; exact to a step, on the far side, within which the Jacobian decides."""
    k = camera.coefficients
    radius = np.linspace(0.0, _RADIUS_SEARCHED, 4001)
    r2 = radius**2
    numerator = 1 + r2 * (k[0] + r2 * (k[1] + r2 * k[4]))
    denominator = 1 + r2 * (k[5] + r2 * (k[6] + r2 * k[7]))
    good = denominator > 0
    distorted = radius * numerator / np.where(good, denominator, 1.0)
    folded = np.flatnonzero(~good[1:] | (np.diff(distorted) <= 0)) + 1
    return float(radius[folded[0]]) if folded.size else np.inf


@lru_cache(maxsize=4)  # 64 MB each at 4 megapixels
def _rays(camera: PinholeCamera) -> NDArray[np.float64]:
    inverse = np.asarray(np.linalg.inv(camera.image_from_distorted), dtype=np.float64)
    rays = np.empty((camera.height, camera.width, 2))
    _fill_rays(rays, inverse, camera.coefficients, camera.radius_limit, any(camera.distortion))
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


# OpenCV inverts its lens distortion by a fixed-point iteration that needs dozens of steps where the
# distortion is strong; here it is Newton's method with the analytic Jacobian, so that one call
# reaches rounding error. A polynomial fitted inside the image bends back outside it, where several
# points share a pixel. Only the part where it does not is used: up to `PinholeCamera.radius_limit`
# and while the Jacobian's determinant is positive.

_NEWTON_STEPS = 40
_CONVERGED = 1e-13  # of a normalised coordinate: far below a thousandth of a pixel
_RADIUS_SEARCHED = 4.0  # tangent of 76° off the axis: beyond any pinhole lens


@njit(inline="always", error_model="numpy")
def distort_point(
    x: float, y: float, k: NDArray[np.float64]
) -> tuple[float, float, float, float, float, float]:
    """Distort one normalised point; also return the Jacobian.

    Parameters
    ----------
    x, y : float
        Normalised coordinates X/Z, Y/Z.
    k : (14,) ndarray
        `PinholeCamera.coefficients`; the tilt (τx, τy) is left to the caller.

    Returns
    -------
    tuple of float
        x', y', ∂x'/∂x, ∂x'/∂y, ∂y'/∂x, ∂y'/∂y.
    """
    r2 = x * x + y * y
    numerator = 1.0 + r2 * (k[0] + r2 * (k[1] + r2 * k[4]))
    denominator = 1.0 + r2 * (k[5] + r2 * (k[6] + r2 * k[7]))
    radial = numerator / denominator
    numerator_d = k[0] + r2 * (2.0 * k[1] + 3.0 * r2 * k[4])
    denominator_d = k[5] + r2 * (2.0 * k[6] + 3.0 * r2 * k[7])
    radial_d = (numerator_d - radial * denominator_d) / denominator  # d radial / d r²
    distorted_x = (
        x * radial + 2.0 * k[2] * x * y + k[3] * (r2 + 2.0 * x * x) + r2 * (k[8] + r2 * k[9])
    )
    distorted_y = (
        y * radial + k[2] * (r2 + 2.0 * y * y) + 2.0 * k[3] * x * y + r2 * (k[10] + r2 * k[11])
    )
    prism_x = 2.0 * (k[8] + 2.0 * r2 * k[9])
    prism_y = 2.0 * (k[10] + 2.0 * r2 * k[11])
    j_xx = radial + 2.0 * x * x * radial_d + 2.0 * k[2] * y + 6.0 * k[3] * x + prism_x * x
    j_xy = 2.0 * x * y * radial_d + 2.0 * k[2] * x + 2.0 * k[3] * y + prism_x * y
    j_yx = 2.0 * x * y * radial_d + 2.0 * k[2] * x + 2.0 * k[3] * y + prism_y * x
    j_yy = radial + 2.0 * y * y * radial_d + 6.0 * k[2] * y + 2.0 * k[3] * x + prism_y * y
    return distorted_x, distorted_y, j_xx, j_xy, j_yx, j_yy


@njit(inline="always", error_model="numpy")
def undistort_point(
    distorted_x: float,
    distorted_y: float,
    x: float,
    y: float,
    k: NDArray[np.float64],
    radius_limit: float,
) -> tuple[float, float]:
    """Invert `distort_point` from the guess (x, y) by Newton's method; NaN where it fails.

    A step that leaves the part of the model in use, or gains nothing, is halved; a guess that lies
    outside is drawn towards the optical axis.
    """
    last_x, last_y, last_error = 0.0, 0.0, np.inf
    for _ in range(_NEWTON_STEPS):
        fx, fy, j_xx, j_xy, j_yx, j_yy = distort_point(x, y, k)
        fx -= distorted_x
        fy -= distorted_y
        determinant = j_xx * j_yy - j_xy * j_yx
        error = fx * fx + fy * fy
        inside = x * x + y * y <= radius_limit * radius_limit and determinant > 0.0
        if inside and error < last_error:
            step_x = (j_yy * fx - j_xy * fy) / determinant
            step_y = (j_xx * fy - j_yx * fx) / determinant
            last_x, last_y, last_error = x, y, error
            x -= step_x
            y -= step_y
            if abs(step_x) + abs(step_y) < _CONVERGED:
                return x, y
        else:
            x = 0.5 * (x + last_x)
            y = 0.5 * (y + last_y)
    return np.nan, np.nan


@njit(error_model="numpy")
def distort_points(
    points: NDArray[np.float64], k: NDArray[np.float64], radius_limit: float
) -> NDArray[np.float64]:
    """Distort (n, 2) normalised points; NaN where the model folds over."""
    result = np.full_like(points, np.nan)
    for i in range(points.shape[0]):
        x, y = points[i, 0], points[i, 1]
        if x * x + y * y <= radius_limit * radius_limit:
            distorted_x, distorted_y, j_xx, j_xy, j_yx, j_yy = distort_point(x, y, k)
            if j_xx * j_yy - j_xy * j_yx > 0.0:
                result[i, 0], result[i, 1] = distorted_x, distorted_y
    return result


@njit(error_model="numpy")
def undistort_points(
    points: NDArray[np.float64], k: NDArray[np.float64], radius_limit: float
) -> NDArray[np.float64]:
    """Undistort (n, 2) distorted normalised points; NaN where no point distorts to them."""
    result = np.empty_like(points)
    for i in range(points.shape[0]):
        x, y = points[i, 0], points[i, 1]
        result[i, 0], result[i, 1] = undistort_point(x, y, x, y, k, radius_limit)
    return result


def _tilt_matrix(k: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return OpenCV's (3, 3) homography of a tilted image sensor, τx and τy in radians."""
    cos_x, sin_x = np.cos(k[12]), np.sin(k[12])
    cos_y, sin_y = np.cos(k[13]), np.sin(k[13])
    rotation_x = np.array([[1, 0, 0], [0, cos_x, sin_x], [0, -sin_x, cos_x]])
    rotation_y = np.array([[cos_y, 0, -sin_y], [0, 1, 0], [sin_y, 0, cos_y]])
    rotation = rotation_y @ rotation_x
    projection = np.array(
        [
            [rotation[2, 2], 0, -rotation[0, 2]],
            [0, rotation[2, 2], -rotation[1, 2]],
            [0, 0, 1],
        ]
    )
    return np.asarray(projection @ rotation)
