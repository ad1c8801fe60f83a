"""Triangulation: a camera's ray meets what a projector's column (or row) lights up.

A projector with lens distortion lights a curved surface with each of its columns. So the depth is
solved for along the camera's ray: the point at depth z, projected through the projector's lens,
must have the decoded coordinate. Newton's method, from the solution without distortion, needs two
or three steps. Where column and row are both coded, depth is the least-squares fit to both, and a
pixel of which one was not read has no point: whatever spoilt that one may have spoilt the other.
"""

import numba
import numpy as np
from numpy.typing import NDArray

from exposight.cell import Cloud
from exposight.compiled import njit
from exposight.errors import ImageError
from exposight.geometry import PinholeCamera, PixelBox, RigidTransform
from exposight.geometry.cameras import distort_point
from exposight.imaging.decoded import DecodedMap

_MAX_STEPS = 20
_CONVERGED = 1e-12
"""Of the depth, relative: far below float32, in which clouds are kept."""
_SMALLEST_SLOPE_PX = 1e-3
"""A ray along which the coordinate moves by less than this, over a change of depth by 100 %, runs
towards the projector's centre: it has no depth."""


def triangulate(
    decoded: DecodedMap,
    *,
    camera: PinholeCamera,
    projector: PinholeCamera,
    projector_from_camera: RigidTransform,
    depth_limits_mm: tuple[float, float] = (0.0, np.inf),
    max_residual_px: float = np.inf,
    window: PixelBox | None = None,
) -> Cloud:
    """Intersect every decoded pixel's ray with its projector column, row, or both.

    Parameters
    ----------
    decoded : DecodedMap
        Projector coordinates seen by the camera's pixels.
    camera, projector : PinholeCamera
        Intrinsic parameters, lens distortion included, of both.
    projector_from_camera : RigidTransform
        Extrinsic parameters, mm.
    depth_limits_mm : (float, float), mm
        Points with Z in the camera frame outside (near, far) are left out.
    max_residual_px : float, projector px
        Where column and row are both known, the largest distance between the decoded coordinate and
        the point's projection; beyond it there is no point.
    window : PixelBox, optional
        The part of the camera's image that the map covers; all of it by default.

    Returns
    -------
    Cloud
        Organised like the map, in the camera frame; NaN where a coded axis was not read, where the
        ray runs towards the projector's centre, or where the intersection is behind either lens.

    Raises
    ------
    ImageError
        If the map is not of the camera's (or the window's) or the projector's size, the window is
        not within the camera's image, or a limit makes no sense.
    """
    window = window or PixelBox(top=0, bottom=camera.height, left=0, right=camera.width)
    _check_sizes(decoded, camera, projector, window)
    near_mm, far_mm = depth_limits_mm
    _check_limits(near_mm, far_mm, max_residual_px)
    none = np.empty((0, 0))
    points = np.empty((*decoded.image_shape, 3), dtype=np.float32)
    _intersect(
        camera.rays()[window.top : window.bottom, window.left : window.right],
        none if decoded.column is None else decoded.column,
        none if decoded.row is None else decoded.row,
        np.ascontiguousarray(projector_from_camera.rotation),
        np.ascontiguousarray(projector_from_camera.translation_mm),
        projector.matrix,
        projector.image_from_distorted,
        projector.coefficients,
        projector.radius_limit,
        near_mm,
        far_mm,
        max_residual_px,
        points,
    )
    return Cloud(points=points)


def _check_limits(near_mm: float, far_mm: float, max_residual_px: float) -> None:
    if not 0 <= near_mm < far_mm:
        msg = (
            f"the limits of depth must be 0 ≤ near < far in mm, got near {near_mm:g} and far "
            f"{far_mm:g}"
        )
        raise ImageError(msg)
    if not max_residual_px > 0:
        msg = f"the largest residual must be above 0 px, got {max_residual_px:g}"
        raise ImageError(msg)


def _check_sizes(
    decoded: DecodedMap, camera: PinholeCamera, projector: PinholeCamera, window: PixelBox
) -> None:
    rows, columns = decoded.image_shape
    whole = (
        window.bottom - window.top == camera.height and window.right - window.left == camera.width
    )
    if decoded.image_shape != (window.bottom - window.top, window.right - window.left):
        size = f"{window.right - window.left} × {window.bottom - window.top}"
        msg = (
            f"the frames have {columns} × {rows} px, the {'camera' if whole else 'window'} {size}; "
            "use the calibration of the camera that took them, at the same resolution"
        )
        raise ImageError(msg)
    if min(window.top, window.left) < 0 or (
        window.bottom > camera.height or window.right > camera.width
    ):
        msg = f"the window must lie within {camera.width} × {camera.height} px, got {window}"
        raise ImageError(msg)
    expected = (decoded.projector_width, decoded.projector_height)
    if expected != (projector.width, projector.height):
        msg = (
            f"the patterns are {expected[0]} × {expected[1]} px, the projector {projector.width} × "
            f"{projector.height}; use the calibration of the projector that showed them"
        )
        raise ImageError(msg)


@njit(parallel=True, error_model="numpy")
def _intersect(
    rays: NDArray[np.float64],
    columns: NDArray[np.float64],
    rows: NDArray[np.float64],
    rotation: NDArray[np.float64],
    translation: NDArray[np.float64],
    pinhole: NDArray[np.float64],
    image_from_distorted: NDArray[np.float64],
    k: NDArray[np.float64],
    limit: float,
    near: float,
    far: float,
    max_residual: float,
    points: NDArray[np.float32],
) -> None:
    """Fill points (rows, columns, 3); an axis that is not coded comes as an empty array."""
    for r in numba.prange(points.shape[0]):
        a = np.empty(3)
        for c in range(points.shape[1]):
            points[r, c, :] = np.nan
            u = columns[r, c] if columns.size else np.nan
            v = rows[r, c] if rows.size else np.nan
            x, y = rays[r, c, 0], rays[r, c, 1]
            if (columns.size and np.isnan(u)) or (rows.size and np.isnan(v)) or np.isnan(x):
                continue
            for i in range(3):
                a[i] = rotation[i, 0] * x + rotation[i, 1] * y + rotation[i, 2]
            z = _start(a, translation, pinhole, u, v)
            z, residual = _solve(a, translation, image_from_distorted, k, limit, u, v, z)
            if near < z < far and residual <= max_residual:
                points[r, c, 0] = x * z
                points[r, c, 1] = y * z
                points[r, c, 2] = z


@njit(inline="always", error_model="numpy")
def _start(
    a: NDArray[np.float64],
    t: NDArray[np.float64],
    pinhole: NDArray[np.float64],
    u: float,
    v: float,
) -> float:
    """Depth without distortion: from the coordinate that moves more along the ray.

    Points on the ray are z·a + t in the projector frame; (row of the camera matrix − u · third row)
    of it is 0 on the plane of column u.
    """
    best, depth = 0.0, np.nan
    for axis in range(2):
        wanted = u if axis == 0 else v
        if np.isnan(wanted):
            continue
        along, offset = 0.0, 0.0
        for i in range(3):
            normal = pinhole[axis, i] - wanted * pinhole[2, i]
            along += normal * a[i]
            offset += normal * t[i]
        if abs(along) > best:
            best, depth = abs(along), -offset / along
    return depth


@njit(inline="always", error_model="numpy")
def _solve(
    a: NDArray[np.float64],
    t: NDArray[np.float64],
    h: NDArray[np.float64],
    k: NDArray[np.float64],
    limit: float,
    u: float,
    v: float,
    z: float,
) -> tuple[float, float]:
    """Refine the depth through the projector's lens; return it and the residual in px, or NaN."""
    if not z > 0.0:
        return np.nan, np.nan
    for _ in range(_MAX_STEPS):
        depth = z * a[2] + t[2]
        if not depth > 0.0:
            return np.nan, np.nan
        x, y = (z * a[0] + t[0]) / depth, (z * a[1] + t[1]) / depth
        if x * x + y * y > limit * limit:
            return np.nan, np.nan
        dx, dy, j_xx, j_xy, j_yx, j_yy = distort_point(x, y, k)
        slope_x, slope_y = (a[0] - x * a[2]) / depth, (a[1] - y * a[2]) / depth
        slope_dx = j_xx * slope_x + j_xy * slope_y
        slope_dy = j_yx * slope_x + j_yy * slope_y
        weight = h[2, 0] * dx + h[2, 1] * dy + h[2, 2]
        slope_weight = h[2, 0] * slope_dx + h[2, 1] * slope_dy
        normal, gradient, square = 0.0, 0.0, 0.0
        for axis in range(2):
            wanted = u if axis == 0 else v
            if np.isnan(wanted):
                continue
            image = (h[axis, 0] * dx + h[axis, 1] * dy + h[axis, 2]) / weight
            slope = (h[axis, 0] * slope_dx + h[axis, 1] * slope_dy - image * slope_weight) / weight
            error = image - wanted
            normal += slope * slope
            gradient += slope * error
            square += error * error
        if not np.sqrt(normal) * z > _SMALLEST_SLOPE_PX:
            return np.nan, np.nan
        step = gradient / normal
        z -= step
        if abs(step) <= _CONVERGED * abs(z):
            return z, np.sqrt(square)
    return np.nan, np.nan
