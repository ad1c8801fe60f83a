"""OpenCV's lens distortion, forward and backward, compiled.

The model and the order of its coefficients (k1, k2, p1, p2, k3, k4, k5, k6, s1, s2, s3, s4, τx, τy)
are those of OpenCV's ``calib3d`` documentation. OpenCV itself inverts it by a fixed-point iteration
that needs dozens of steps where the distortion is strong; here it is Newton's method with the
analytic Jacobian, so that one call reaches rounding error and whole images stay cheap.

A polynomial fitted inside the image bends back outside it: there the model folds over, and several
points share a pixel. Only the part about the optical axis, where it does not, is used: up to
`radius_limit` and while the Jacobian's determinant is positive.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from exposight.compiled import njit

N_COEFFICIENTS = 14
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
        Coefficients; the tilt (τx, τy) is left to the caller.

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


def tilt_matrix(k: NDArray[np.float64]) -> NDArray[np.float64]:
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


def radius_limit(k: NDArray[np.float64]) -> float:
    """Return the radius X/Z beyond which nothing is projected, as the radial model folds there.

    Exact to a step of the search, on the far side; within that step the Jacobian decides.
    """
    radius = np.linspace(0.0, _RADIUS_SEARCHED, 4001)
    r2 = radius**2
    numerator = 1 + r2 * (k[0] + r2 * (k[1] + r2 * k[4]))
    denominator = 1 + r2 * (k[5] + r2 * (k[6] + r2 * k[7]))
    good = denominator > 0
    distorted = radius * numerator / np.where(good, denominator, 1.0)
    folded = np.flatnonzero(~good[1:] | (np.diff(distorted) <= 0)) + 1
    return float(radius[folded[0]]) if folded.size else np.inf
