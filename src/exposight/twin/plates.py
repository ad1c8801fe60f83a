"""A simulated sensor before flat plates, whose place is known: depth, and p_norm over brightness.

Plates go through the cell's own chain: light, lenses, electronics, decoding or matching. Depth is
compared with the plane itself, not with the mesh that was traced.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from exposight.cell import GREY_MAX, PAPER_TOLERANCE, Feature, Part, RingTolerance, full_scale
from exposight.geometry import RigidTransform
from exposight.observing import Observer
from exposight.twin import sensors
from exposight.twin.light import SceneTracer, projector_of
from exposight.twin.matt_white import BOX_PX, box_about, cut_out, flat_plate
from exposight.twin.part import SURFACES

_TILT_DEG = (3.0, -5.0)  # about the camera's x and y
_BOXES = 5
"""Depth is judged in 5 × 5 squares spread over the frame, where decoding needs no whole frames."""
_TARGETS = (0.08, 0.14, 0.24, 0.4)
"""Shares of the grey levels at which the plate's mean brightness is tried; patterns double it."""
_ALIKE = 0.002
"""Shares of points that differ by no more are alike; the brighter capture is then the better."""
_ROBUST = 1.4826  # standard deviations in a median deviation of the normal distribution
_MEASURED = (
    "exposure_ms", "grey_levels", "median_error_mm", "bias_mm", "noise_mm", "repeat_noise_mm",
    "predicted_noise_mm",
)  # fmt: skip
_RING_MM = 6.0
_RING_SHARES = np.geomspace(0.005, 3.0, 10)
"""Mean brightness of the plate, as shares of the grey levels, at which the ring is observed."""
_HALVINGS = 3  # of the steps in which p_norm rises and falls


@dataclass(frozen=True, kw_only=True)
class PlateDepth:
    """What a sensor measures of a tilted plate in primer at one distance, at its best exposure.

    Errors are along the camera's axis, measured less true; NaN where nothing was measured.

    Parameters
    ----------
    distance_mm : float, mm
        Of the plate on the line through the TCP along the camera's axis.
    exposure_ms, grey_levels : float, ms and grey levels 0–255
        The exposure time with the most points, and the plate's median brightness at it.
    covered_share, points_share : float
        Of the pixels: whose place on the plate the fields of the projector and all cameras cover;
        with a point.
    median_error_mm, bias_mm : float, mm
        Median of the errors' sizes, and of the errors.
    noise_mm : float, mm
        Robust standard deviation of the errors about the bias: 1.4826 × median deviation.
    repeat_noise_mm : float, mm
        Robust standard deviation of a pixel's depth between captures; that of a pixel of median
        predicted noise, where noise is predicted.
    predicted_noise_mm : float, mm
        Median of what the modulation predicts (`exposight.imaging.with_sigma_z`); NaN without
        fringes on each coded axis.
    """

    distance_mm: float
    exposure_ms: float
    grey_levels: float
    covered_share: float
    points_share: float
    median_error_mm: float
    bias_mm: float
    noise_mm: float
    repeat_noise_mm: float
    predicted_noise_mm: float


@dataclass(frozen=True, kw_only=True, eq=False)
class RingBrightness:
    """p_norm of a hole's ring on the plate at the TCP, over exposure time.

    Parameters
    ----------
    exposure_ms, i_avg, p_norm : (n,) ndarray, ms, grey levels 0–255 and 1
        Of every capture, from short to long; empty where the ring is not in the frame.
    """

    exposure_ms: NDArray[np.float64]
    i_avg: NDArray[np.float64]
    p_norm: NDArray[np.float64]

    def crossings(self, level: float) -> tuple[float, float]:
        """Return the grey levels at which p_norm rises above a level and falls below it for good.

        NaN where it does not within the exposure times.
        """
        above = np.flatnonzero(self.p_norm >= level)
        if not above.size:
            return math.nan, math.nan
        return self._between(above[0] - 1, level), self._between(above[-1], level)

    def plateau(self, level: float) -> float:
        """Return the median p_norm of captures that reach a level; NaN where none does."""
        above = self.p_norm >= level
        return float(np.median(self.p_norm[above])) if above.any() else math.nan

    def _between(self, first: int, level: float) -> float:
        """Return the brightness at which a level lies between two captures, linearly."""
        if not 0 <= first < self.p_norm.size - 1:
            return math.nan
        (p, q), (a, b) = self.p_norm[first : first + 2], self.i_avg[first : first + 2]
        return float(a + (level - p) / (q - p) * (b - a))


@dataclass(frozen=True, kw_only=True, eq=False)
class PlateView:
    """A plate before the sensor, traced.

    Parameters
    ----------
    distance_mm : float, mm
        Along the camera's axis, at the TCP's place across it.
    camera_from_plate : RigidTransform
        The plate is the plane z = 0.
    light : StripeLight or DotLight
        For any exposure time.
    depth_mm : (n,) ndarray, mm
        True depth of the pixels that are judged.
    is_covered : (n,) ndarray of bool
        Whether the fields of the projector and all cameras cover them.
    """

    distance_mm: float
    camera_from_plate: RigidTransform
    light: Any
    depth_mm: NDArray[np.float64]
    is_covered: NDArray[np.bool_]


class PlateBench:
    """A sensor with plates that stand before it.

    Parameters
    ----------
    model : StripeSensor or DotSensor
        With its light, cameras and decoding (`exposight.twin.simulated_cell.sensor_model`).
    """

    def __init__(self, model: sensors.StripeSensor | sensors.DotSensor) -> None:
        self.model, self.sensor = model, model.sensor
        camera = self.sensor.camera
        small = camera.width * camera.height <= (2 * _BOXES * BOX_PX) ** 2
        self._is_whole = isinstance(model, sensors.DotSensor) or model.needs_whole_frames or small
        self._top = full_scale(model.electronics.bit_depth)
        self._primer = SceneTracer(flat_plate(self.sensor, SURFACES["primer"]))
        # A ring of the paper's size, or smaller where the field is small.
        half_mm = self.sensor.camera_from_tcp.translation_mm[2] * camera.height / camera.fy / 2
        scale = min(1.0, float(half_mm) / 3 / (_RING_MM + PAPER_TOLERANCE.outer_mm))
        ring = Feature(
            name="ring",
            kind="hole",
            part_from_feature=RigidTransform(),
            radius_mm=scale * _RING_MM,
        )
        tolerance = RingTolerance(
            height_mm=PAPER_TOLERANCE.height_mm,
            inner_mm=scale * PAPER_TOLERANCE.inner_mm,
            outer_mm=scale * PAPER_TOLERANCE.outer_mm,
        )
        self._part = Part(name="plate", features=(ring,))
        self._observer = Observer(self._part, self.sensor, tolerance)

    def distances_mm(self) -> tuple[float, float, float]:
        """Return distances near, at the TCP and far, so that matched depths hold whole plates."""
        near_mm, far_mm = self.sensor.working_distance_mm
        tcp_mm = float(self.sensor.camera_from_tcp.translation_mm[2])
        if isinstance(self.model, sensors.DotSensor):
            normal = RigidTransform.from_fanuc_wpr((0, 0, 0), *_TILT_DEG, 0.0).z_axis
            rays = self.sensor.camera.rays().reshape(-1, 2)
            depths = normal[2] / (rays @ normal[:2] + normal[2])
            limits_mm = self.model.matched_mm
            near_mm = max(near_mm, limits_mm[0] / float(np.nanmin(depths)))
            far_mm = min(far_mm, limits_mm[1] / float(np.nanmax(depths)))
        return near_mm, tcp_mm, far_mm

    def look(self, distance_mm: float) -> PlateView:
        """Trace a plate in primer, a little tilted.

        Parameters
        ----------
        distance_mm : float, mm
            Along the camera's axis.
        """
        x, y, _ = self.sensor.camera_from_tcp.translation_mm
        pose = RigidTransform.from_fanuc_wpr((x, y, distance_mm), *_TILT_DEG, 0.0)
        camera = self.sensor.camera
        boxes = None
        if not self._is_whole:
            rows, columns = (
                (np.arange(_BOXES) + 0.5) / _BOXES * size for size in (camera.height, camera.width)
            )
            boxes = [
                box_about(camera, round(row), round(column)) for row in rows for column in columns
            ]
            boxes += sensors.ring_boxes(self._part, self.sensor, pose)
        light: Any
        if isinstance(self.model, sensors.DotSensor):
            light = self.model.look(self._primer, pose)
            rays = camera.rays().reshape(-1, 2)
        else:
            light = self.model.look(self._primer, pose, boxes)
            rays = np.concatenate(
                [cut_out(camera.rays(), tile.box).reshape(-1, 2) for tile in light.tiles]
            )
        directions = np.column_stack([rays, np.ones(len(rays))])
        normal, centre = pose.z_axis, pose.translation_mm
        depth_mm = (normal @ centre) / (directions @ normal)
        depth_mm[depth_mm <= 0] = np.nan
        return PlateView(
            distance_mm=distance_mm,
            camera_from_plate=pose,
            light=light,
            depth_mm=depth_mm,
            is_covered=self._covered(directions * depth_mm[:, None], pose),
        )

    def _covered(self, points_mm: NDArray[np.float64], pose: RigidTransform) -> NDArray[np.bool_]:
        """Tell which points (n, 3) of the plate lie in the projector's and all cameras' fields."""
        projector = projector_of(self.sensor)
        eyes = [(projector.camera, projector.camera_from_projector)]
        eyes += zip(self.sensor.cameras, self.sensor.first_from_camera, strict=True)
        covered: NDArray[np.bool_] = np.all(np.isfinite(points_mm), axis=1)
        for camera, first_from_camera in eyes:
            before = first_from_camera.translation_mm - pose.translation_mm
            if pose.z_axis @ before >= 0:  # behind the plate
                return np.zeros_like(covered)
            pixels = camera.project(first_from_camera.inverse().apply(points_mm[covered]))
            covered[covered] = camera.in_frame(pixels)
        return covered

    def depth(self, view: PlateView, number: int) -> PlateDepth:
        """Measure a plate at its best exposure time, twice.

        Parameters
        ----------
        view : PlateView
            The plate.
        number : int
            Tells its noise from other plates'.
        """
        covered_share = float(view.is_covered.mean())
        best: tuple[float, _Pixels] | None = None
        share = 0.0
        for exposure_ms in self._exposures_ms(view, _TARGETS):  # from short to long
            pixels = self._pixels(view, exposure_ms, number)
            measured = float(np.isfinite(pixels.depth_mm).mean())
            if measured >= share - _ALIKE:
                best = exposure_ms, pixels
            share = max(share, measured)
        if best is None:
            nothing = dict.fromkeys(_MEASURED, math.nan)
            return PlateDepth(
                distance_mm=view.distance_mm,
                covered_share=covered_share,
                points_share=0.0,
                **nothing,
            )
        exposure_ms, pixels = best
        error = pixels.depth_mm - view.depth_mm
        again = self._pixels(view, exposure_ms, number + 1000).depth_mm - pixels.depth_mm
        bias_mm = _median(error)
        predicted_mm = _median(pixels.noise_mm)
        if not math.isnan(predicted_mm):  # pixels differ in noise: each in its own unit
            again *= predicted_mm / pixels.noise_mm
        return PlateDepth(
            distance_mm=view.distance_mm,
            exposure_ms=exposure_ms,
            grey_levels=_median(pixels.grey[view.is_covered]),
            covered_share=covered_share,
            points_share=float(np.isfinite(pixels.depth_mm).mean()),
            median_error_mm=_median(np.abs(error)),
            bias_mm=bias_mm,
            noise_mm=_ROBUST * _median(np.abs(error - bias_mm)),
            repeat_noise_mm=_ROBUST * _median(np.abs(again)) / math.sqrt(2.0),
            predicted_noise_mm=predicted_mm,
        )

    def _exposures_ms(self, view: PlateView, shares: ArrayLike) -> list[float]:
        """Return settable exposure times at which the covered plate's mean has shares of 255."""
        light = view.light
        planes = (
            [light.radiance[0]]
            if isinstance(self.model, sensors.DotSensor)
            else [tile.even for tile in light.tiles]
        )
        radiance = np.concatenate([plane.ravel() for plane in planes])[view.is_covered]
        if not radiance.size:
            return []
        camera, exposure = self.model.electronics, self.sensor.exposure
        per_ms = float(np.median(radiance)) * camera.electrons_per_ms * camera.gain / self._top
        wanted = np.clip(np.asarray(shares) / per_ms, exposure.min_ms, exposure.max_ms)
        return sorted({self.sensor.nearest_exposure(float(t)) for t in wanted})

    def _pixels(self, view: PlateView, exposure_ms: float, number: int) -> _Pixels:
        """Take a capture of a plate."""
        model, seed = self.model, (1, number, round(1000 * exposure_ms))
        shown = GREY_MAX / self._top
        if isinstance(model, sensors.DotSensor):
            capture = model.capture(view.light, exposure_ms, view="plate", seed=seed)
            depth = capture.require_cloud().points[..., 2].ravel().astype(np.float64)
            return _Pixels(
                depth, np.full(depth.size, np.nan), np.float64(shown) * capture.image.ravel()
            )
        frames = list(model.sequence.finest_frames)
        parts = []
        stacks = model.frames(view.light, exposure_ms, seed)
        for tile, stack in zip(view.light.tiles, stacks, strict=True):
            decoded, unlimited = model.decode(stack), replace(model, max_depth_noise_mm=None)
            cloud = model.points(stack, decoded, tile.box)
            sigma_mm = unlimited.points(stack, decoded, tile.box).sigma_z_mm
            grey = stack.frames[frames].mean(axis=0)
            noise_mm = np.full(grey.size, np.nan) if sigma_mm is None else sigma_mm.ravel()
            parts.append((cloud.points[..., 2].ravel(), noise_mm, shown * grey.ravel()))
        return _Pixels(
            *(np.concatenate(arrays).astype(np.float64) for arrays in zip(*parts, strict=True))
        )

    def ring(self, view: PlateView, level: float) -> RingBrightness:
        """Observe a hole's ring on a plate from the darkest to the brightest exposure time.

        Parameters
        ----------
        view : PlateView
            The plate.
        level : float
            p_norm whose crossings are looked for more finely.
        """
        rows: dict[float, tuple[float, float]] = {}
        wanted = self._exposures_ms(view, _RING_SHARES)
        for _ in range(1 + _HALVINGS):
            rows |= {t: self._ring_at(view, t) for t in wanted if t not in rows}
            steps = [(t, rows[t][1] >= level) for t in sorted(rows)]
            wanted = [
                self.sensor.nearest_exposure(math.sqrt(low * high))
                for (low, before), (high, after) in pairwise(steps)
                if before != after
            ]
        measured = [(t, *rows[t]) for t in sorted(rows) if not math.isnan(rows[t][0])]
        exposures_ms, i_avg, p_norm = np.array(measured).reshape(-1, 3).T
        return RingBrightness(exposure_ms=exposures_ms, i_avg=i_avg, p_norm=p_norm)

    def _ring_at(self, view: PlateView, exposure_ms: float) -> tuple[float, float]:
        """Return i_avg and p_norm; NaN where the ring is not in the frame."""
        seed = (2, round(1000 * exposure_ms))
        capture = self.model.capture(view.light, exposure_ms, view="plate", seed=seed)
        (row,) = self._observer.observe(capture)
        if row.i_avg is None or row.p_norm is None:
            return math.nan, math.nan
        return row.i_avg, row.p_norm


class _Pixels(NamedTuple):
    """What a capture of a plate says of the pixels (n,) that are judged."""

    depth_mm: NDArray[np.float64]
    noise_mm: NDArray[np.float64]
    grey: NDArray[np.float64]


def _median(values: NDArray[np.float64]) -> float:
    """Return the median of what is not missing; NaN where all is."""
    there = values[np.isfinite(values)]
    return float(np.median(there)) if there.size else math.nan
