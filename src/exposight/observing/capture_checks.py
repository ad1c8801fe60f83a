"""Captures against themselves: cloud, camera, features and pose say the same thing more than once.

What does not agree is named (`exposight.contradictions`).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from exposight.cell import GREY_MAX, ActiveSensor, Capture
from exposight.contradictions import Contradiction, clouds, part_views, places, rings
from exposight.contradictions.greys import check_greys
from exposight.geometry import grid_camera, grid_ratio
from exposight.observing import masks
from exposight.observing.point_search import PointSearch
from exposight.observing.schema import Observation

CAPTURE_CHECKS = (
    *("saturation-spike", "grey-levels", "mosaic"),
    *(clouds.OWN_PIXELS, clouds.BEHIND, clouds.THINNER),
    *(rings.TOO_MANY, rings.ELSEWHERE),
    *(part_views.OUT_OF_VIEW, part_views.OUT_OF_REACH),
    *(places.NO_HOLE, places.SMALL, places.OFF_PLANE, places.OUTSIDE, places.DARK),
)
"""Names of the checks of captures; see ``docs/contradictions.md``."""

_SAMPLE = 4096
"""Points of a cloud that are held against their pixels: a median of so many is good to a few %."""
_RING_SAMPLE = 200
_MOST_FEATURES = 40
_INNER = 0.8
"""Of a hole's radius: its rim may be chamfered, and lie a pixel beside."""
_FEWEST_PIXELS = 12
_BOX_SAMPLE = 900
"""Points round a feature that are looked at: a tenth of them lies in a small hole."""
_DENSE = 0.5
_SURFACE_MM = 1.0
"""Points of a hole's ground or wall lie deeper."""


def capture_contradictions(
    capture: Capture,
    sensor: ActiveSensor,
    views: Sequence[masks.FeatureView],
    rows: Sequence[Observation],
    search: PointSearch,
) -> Iterator[Contradiction | None]:
    """Yield what of a capture does not agree with the rest of it.

    Parameters
    ----------
    capture : Capture
        With its cloud.
    sensor : ActiveSensor
        That took it.
    views : sequence of FeatureView
        The features as the capture's pose has them.
    rows : sequence of Observation
        What was observed of them.
    search : PointSearch
        The capture's cloud (`point_search`).
    """
    computed = capture.emulated or capture.brightness_source == "merged"
    yield from check_greys(capture.image, capture.full_scale, scaled=computed, what="the image")
    cloud = capture.require_cloud()
    looked_at = slice(None, None, max(1, len(views) // _MOST_FEATURES))
    some_views, some_rows = views[looked_at], rows[looked_at]
    if cloud.organised:
        elsewhere = _on_own_pixels(cloud.points, sensor)
        yield elsewhere
        if elsewhere is not None and elsewhere.is_error:
            return  # whatever else is wrong follows from it
        yield _on_every_pixel(cloud.points)
        yield _where_features_are(cloud.points, sensor, some_views, some_rows)
    else:
        behind = clouds.behind_camera(cloud.points[:: max(1, len(cloud.points) // _SAMPLE)])
        yield behind
        if behind is not None:
            return
        pixels = _pixels_seen(cloud.valid_points, sensor)
        outside = places.outside_image(len(pixels), cloud.n_valid)
        yield outside
        if outside is not None and outside.is_error:
            return
        column, row = np.rint(pixels).astype(np.int64).T
        brightest = capture.image if capture.stack is None else capture.stack.maximum
        scale = GREY_MAX / capture.full_scale
        yield clouds.thinner_than_image(pixels, scale * brightest[row, column])
    # Windows that are matched smear the surface into its holes.
    sees_holes = len(sensor.cameras) == 1
    yield from _at_features(some_views, some_rows, search, sees_holes=sees_holes)
    p_norm = np.array([np.nan if row.p_norm is None else row.p_norm for row in rows])
    if not computed:
        i_avg = np.array([np.nan if row.i_avg is None else row.i_avg for row in rows])
        yield places.points_in_the_dark(i_avg, p_norm)
    yield rings.too_many_points(
        p_norm,
        np.array([np.nan if row.n_pixels is None else row.n_pixels for row in rows]),
        [row.feature for row in rows],
        matched=len(sensor.cameras) > 1,
    )


def _on_own_pixels(points: NDArray[np.float32], sensor: ActiveSensor) -> Contradiction | None:
    camera = sensor.camera
    rows, columns = points.shape[:2]
    if grid_ratio((rows, columns), (camera.height, camera.width)) is None:
        return None
    camera = grid_camera(camera, (rows, columns), points)
    step = max(1, int(np.sqrt(points.shape[0] * points.shape[1] / _SAMPLE)))
    sampled = points[step // 2 :: step, step // 2 :: step]
    valid = np.isfinite(sampled[..., 0])
    row, column = np.nonzero(valid)
    return clouds.own_pixels(
        np.asarray(sampled[valid], dtype=np.float64),
        np.column_stack([column, row]).astype(np.float64) * step + step // 2,
        camera.rays()[step // 2 :: step, step // 2 :: step][valid],
        clouds.Lens(
            fx=camera.fx,
            fy=camera.fy,
            cx=camera.cx,
            cy=camera.cy,
            width=camera.width,
            height=camera.height,
            is_distorted=any(camera.distortion),
        ),
    )


_STEP = 997
"""Prime, so that every k-th row and column has its share of the pixels that are looked at."""


def _on_every_pixel(points: NDArray[np.float32]) -> Contradiction | None:
    rows, columns = points.shape[:2]
    row, column = np.divmod(np.arange(0, rows * columns, _STEP), columns)
    valid = np.isfinite(points[row, column, 0])
    pixels = np.column_stack([column[valid], row[valid]]).astype(np.float64)
    return clouds.coarser_than_image(pixels)


def _where_features_are(
    points: NDArray[np.float32],
    sensor: ActiveSensor,
    views: Sequence[masks.FeatureView],
    rows: Sequence[Observation],
) -> Contradiction | None:
    """Compare the points seen in rings' pixels with the features' planes."""
    # A cloud at a fraction of the image's resolution has a point for several of its pixels.
    ratio = grid_ratio(points.shape[:2], (sensor.camera.height, sensor.camera.width))
    if ratio is None:
        return None
    last_row, last_column = points.shape[0] - 1, points.shape[1] - 1
    seen, p_norm, off = [], [], []
    for view, row in zip(views, rows, strict=True):
        if row.p_norm is None or view.rows.size == 0:
            continue
        step = max(1, view.rows.size // _RING_SAMPLE)
        there = points[
            np.minimum(view.rows[::step] // ratio, last_row),
            np.minimum(view.columns[::step] // ratio, last_column),
        ]
        valid = np.isfinite(there[:, 0])
        seen.append(float(valid.mean()))
        p_norm.append(row.p_norm)
        pose = view.camera_from_feature
        height = (there[valid].astype(np.float64) - pose.translation_mm) @ pose.rotation[:, 2]
        off.append(view.region.plane_z_mm - float(np.median(height)) if valid.any() else np.nan)
    if not seen:
        return None
    return rings.points_elsewhere(np.array(seen), np.array(p_norm), np.array(off))


def _at_features(
    views: Sequence[masks.FeatureView],
    rows: Sequence[Observation],
    search: PointSearch,
    *,
    sees_holes: bool,
) -> Iterator[Contradiction | None]:
    """Compare points with the planes of features, and with the holes in them."""
    filled, half, names, off = at_features(views, rows, search, sees_holes=sees_holes)
    yield places.holes(np.array(filled), np.array(half), names)
    yield places.small_features(np.array([view.feature.radius_mm for view in views]))
    yield places.off_plane(np.array(off))


def at_features(
    views: Sequence[masks.FeatureView],
    rows: Sequence[Observation],
    search: PointSearch,
    *,
    sees_holes: bool,
) -> tuple[list[float], list[float], list[str], list[float]]:
    """Return what the points at dense rings tell.

    Returns
    -------
    filled, half : list of float
        Share of each hole that is filled with the surface, and of one half as large.
    names : list of str
        Of these holes.
    off : list of float, mm
        By how much the points of each ring lie off its feature's plane.
    """
    filled, half, names, off = [], [], [], []
    for view, row in zip(views, rows, strict=True):
        if row.p_norm is None or row.n_pixels is None or row.p_norm < _DENSE:
            continue
        points, _ = search.raster(view)
        step = max(1, int(np.sqrt(points.shape[0] * points.shape[1] / _BOX_SAMPLE)))
        down = step if points.shape[0] > 1 else 1
        points, of_all = points[::down, ::step], down * step
        there = points[np.isfinite(points[..., 0])].astype(np.float64)
        x, y, z = view.camera_from_feature.inverse().apply(there).T
        region, radius_mm = view.region, view.feature.radius_mm
        r = np.hypot(x, y)
        height = z - region.plane_z_mm
        in_ring = (np.abs(height) <= region.height_mm / 2) & (r > radius_mm)
        in_ring &= (r >= region.inner_mm) & (r <= region.outer_mm)
        if any(region.core_half_size_mm) or in_ring.sum() < _FEWEST_PIXELS:
            continue
        plane_mm = float(np.median(height[in_ring]))
        off.append(-plane_mm)
        share = (_INNER * radius_mm) ** 2 / (region.outer_mm**2 - region.inner_mm**2)
        n_inner = row.n_pixels * share / of_all
        if sees_holes and view.feature.kind == "hole" and n_inner >= _FEWEST_PIXELS:
            within = r[np.abs(height - plane_mm) <= _SURFACE_MM]
            filled.append(float((within <= _INNER * radius_mm).sum()) / n_inner)
            half.append(4.0 * float((within <= _INNER * radius_mm / 2).sum()) / n_inner)
            names.append(row.feature)
    return filled, half, names, off


def _pixels_seen(points: NDArray[np.float32], sensor: ActiveSensor) -> NDArray[np.float64]:
    camera = sensor.camera
    pixels = camera.project(points[points[:, 2] > 0].astype(np.float64))
    return np.asarray(pixels[camera.in_frame(pixels)])
