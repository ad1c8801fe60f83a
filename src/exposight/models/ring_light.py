"""How light reaches a feature's ring and its camera: what geometry alone says about radiance.

A projector lights a surface by the inverse square of its distance and the cosine of incidence, its
own falloff is 1/cos³θ_p (the same flux through every pixel), the camera's cos⁴θ_c. The surface
reflects evenly and, round the mirror direction, in one lobe:

    R = (1/π + e^s · D_α(n·h) · V_α(n·l, n·v)) · n·l · cos⁴θ_c / (d² · cos³θ_p)

with GGX's D (Walter et al. 2007) and the height-correlated Smith V (Heitz 2014). The half vector's
part along the surface says how far a point is from the mirror direction, in the part's frame, to
which brushing is fixed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import polars as pl
from numpy.typing import NDArray

from exposight.cell import ActiveSensor
from exposight.compiled import njit
from exposight.errors import ObservationError
from exposight.geometry import RigidTransform

POSE_COLUMNS = ("x_mm", "y_mm", "z_mm", "w_deg", "p_deg", "radius_mm")
"""What a ring's place and size are read from."""

TURN_COLUMNS = ("part_w_deg", "part_p_deg", "part_r_deg")
"""How the part is turned in the TCP frame."""

_RING_MM = (3.3, 4.7)
"""Circles of points on the ring, beyond the feature's radius: near both edges of the paper's ring,
which reaches from 3 to 5 mm (Sect. 3.1.3)."""

_POINTS = 12
"""Points on each circle."""

_GRAZING = 1e-3
"""Least cosine of incidence: beyond it a point is unlit."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Rings:
    """Where n rings are, each of a feature in a view.

    Parameters
    ----------
    features, views : tuple of str
        Their names.
    poses : (n, 6) ndarray
        `POSE_COLUMNS`.
    turns : (n, 3) ndarray, degrees
        `TURN_COLUMNS`; 0 where the part's turn is not known, which takes the TCP's axes for its.
    """

    features: tuple[str, ...]
    views: tuple[str, ...]
    poses: NDArray[np.float64]
    turns: NDArray[np.float64]

    def __len__(self) -> int:
        return len(self.features)

    @property
    def positions(self) -> NDArray[np.float64]:
        """Positions in the TCP frame, (n, 3) mm."""
        return self.poses[:, :3]

    @property
    def keys(self) -> list[tuple[str, str]]:
        """Feature and view of each ring."""
        return list(zip(self.features, self.views, strict=True))

    @classmethod
    def of(cls, frame: pl.DataFrame) -> Rings:
        """Return the rings of a frame's rows, all of which must have names and poses."""
        turns = np.zeros((frame.height, 3))
        for column, name in enumerate(TURN_COLUMNS):
            if name in frame.columns:
                turns[:, column] = np.nan_to_num(frame[name].cast(pl.Float64).to_numpy())
        return cls(
            features=tuple(frame["feature"].to_list()),
            views=tuple(frame["view"].to_list()),
            poses=np.stack([frame[name].to_numpy() for name in POSE_COLUMNS], axis=1),
            turns=turns,
        )

    def points(self) -> NDArray[np.float64]:
        """Return where the rings' points are in the TCP frame, (n, k, 3) mm."""
        w, p = np.radians(self.poses[:, 3:5]).T
        right = np.stack([np.cos(p), np.zeros(len(p)), -np.sin(p)], axis=1)
        down = np.stack([np.sin(p) * np.sin(w), np.cos(w), np.cos(p) * np.sin(w)], axis=1)
        angle = 2.0 * np.pi * np.arange(_POINTS) / _POINTS
        reach = self.poses[:, 5, None, None] + np.array(_RING_MM)[:, None]
        a, b = reach * np.cos(angle), reach * np.sin(angle)
        n = len(self)
        out: NDArray[np.float64] = (
            self.positions[:, None]
            + a.reshape(n, -1, 1) * right[:, None]
            + b.reshape(n, -1, 1) * down[:, None]
        )
        return out

    def take(self, places: Sequence[int] | NDArray[np.int64]) -> Rings:
        """Return some of the rings, in the order of `places`."""
        return Rings(
            features=tuple(self.features[place] for place in places),
            views=tuple(self.views[place] for place in places),
            poses=self.poses[places],
            turns=self.turns[places],
        )


_NEAR, _FAR = 0.6, 1.25
"""Shares of the nearest and the farthest working distance between which features can be."""

_INCIDENCE_DEG = 3.0
"""Difference between recorded and computed incidence that is no rounding."""


def check_places(
    rings: Rings, incidence_deg: NDArray[np.float64], sensor: ActiveSensor | None
) -> None:
    """Check that rings can be where they are said to be, in the TCP frame of their sensor.

    Parameters
    ----------
    rings : Rings
        n of them.
    incidence_deg : (n,) ndarray, degrees
        Between the camera's ray and the normal, as recorded; NaN where it was not.
    sensor : ActiveSensor or None
        Nothing is checked without.

    Raises
    ------
    ObservationError
        If most lie far outside the working distance, face away, or are seen at other angles than
        recorded: they are in another frame or unit.
    """
    if sensor is None:
        return
    expected = (
        "x_mm, y_mm, z_mm must be in mm in its TCP frame (origin "
        f"{sensor.camera_from_tcp.translation_mm[2]:g} mm before the camera), and w_deg, p_deg "
        "those of the normal into the material, in degrees, 0 facing the sensor"
    )
    distance = sensor.camera_from_tcp.apply(rings.positions)[:, 2]
    near, far = sensor.working_distance_mm
    outside = (distance < _NEAR * near) | (distance > _FAR * far)
    w, p = np.radians(rings.poses[:, 3:5]).T
    into = np.stack([np.sin(p) * np.cos(w), -np.sin(w), np.cos(p) * np.cos(w)], axis=1)
    ray = rings.positions - sensor.camera_from_tcp.inverse().translation_mm
    cosine = np.einsum("ij,ij->i", ray, into) / np.maximum(np.linalg.norm(ray, axis=1), 1e-9)
    angle = np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0)))
    apart = np.abs(angle - incidence_deg)
    apart = apart[np.isfinite(apart)]
    fault = ""
    if np.mean(outside) > 0.5:
        fault = (
            f"features lie {np.median(distance):.0f} mm before the camera of {sensor.name!r}, "
            f"which measures at {near:g} to {far:g} mm"
        )
    elif np.mean(cosine <= 0.0) > 0.5:
        fault = f"most features face away from the camera of {sensor.name!r}"
    elif apart.size and np.median(apart) > _INCIDENCE_DEG:
        fault = (
            f"seen from the camera of {sensor.name!r}, the poses give angles of incidence "
            f"{np.median(apart):.0f}° other than those recorded in incidence_deg"
        )
    if fault:
        msg = f"{fault}: {expected}"
        raise ObservationError(msg)


@dataclass(frozen=True, kw_only=True, eq=False)
class RingLight:
    """Light's way to n rings at k points each.

    Parameters
    ----------
    cosines : (n, k, 3) ndarray
        n·l, n·v and n·h.
    log_falloff : (n, k) ndarray
        ln of n·l · cos⁴θ_c / (d² · cos³θ_p), d in mm; −inf where a point is unlit.
    half : (n, k, 2) ndarray
        The half vector's part along the surface.
    lit : (n, k) ndarray of bool
        Whether the projector lights the point and every camera has it in its frame.
    """

    cosines: NDArray[np.float64]
    log_falloff: NDArray[np.float64]
    half: NDArray[np.float64]
    lit: NDArray[np.bool_]

    @classmethod
    def of(cls, rings: Rings, sensor: ActiveSensor, *, projector: bool = True) -> RingLight:
        """Return the light's way to rings.

        Parameters
        ----------
        rings : Rings
            Half vectors are in the frame of their turned part.
        sensor : ActiveSensor
            Says where its cameras and its projector are.
        projector : bool
            Whether to use the projector's pose; without, light is taken to come from the camera.
        """
        tcp_from_camera = sensor.camera_from_tcp.inverse()
        device = sensor.projector if projector else None
        camera_from_light = RigidTransform() if device is None else device.camera_from_projector
        light = tcp_from_camera @ camera_from_light
        eye = np.concatenate([tcp_from_camera.translation_mm, tcp_from_camera.z_axis])
        lamp = np.concatenate([light.translation_mm, light.z_axis if device else np.zeros(3)])
        cosines, log_falloff, half, points = _trace(
            np.ascontiguousarray(rings.poses), _axes(rings.turns), eye, lamp
        )
        lit = np.isfinite(log_falloff)
        flat = sensor.camera_from_tcp.apply(points.reshape(-1, 3))
        for camera, first_from_camera in zip(
            sensor.cameras[1:], sensor.first_from_camera[1:], strict=True
        ):
            lit &= camera.in_frame(camera.project(first_from_camera.inverse().apply(flat))).reshape(
                lit.shape
            )
        if device is not None:
            seen_by_light = device.camera_from_projector.inverse().apply(flat)
            inside = device.camera.in_frame(device.camera.project(seen_by_light))
            lit &= inside.reshape(lit.shape)
        return cls(cosines=cosines, log_falloff=log_falloff, half=half, lit=lit)

    def log_radiance(
        self, log_ratio: float, roughness: float
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return ln R at each point, and its derivatives.

        Parameters
        ----------
        log_ratio : float
            s, ln of specular over diffuse reflectance; −inf for a surface without lobe.
        roughness : float
            α of the lobe, between 0 and 1.

        Returns
        -------
        (n, k) ndarray
            −inf where a point is unlit.
        (2, n, k) ndarray
            With respect to s and α.
        """
        return _lobe(self.cosines, self.log_falloff, log_ratio, roughness)


def log_mean(log_values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return ln of the mean of exp(values) over the last axis; −inf where all are."""
    top = log_values.max(axis=-1, keepdims=True)
    top = np.where(np.isfinite(top), top, 0.0)
    with np.errstate(divide="ignore"):
        out: NDArray[np.float64] = np.log(np.exp(log_values - top).mean(axis=-1)) + top[..., 0]
    return out


def _axes(turns: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the part's x and y axes in the TCP frame, (n, 6)."""
    w, p, r = np.radians(turns).T
    x_axis = (np.cos(r) * np.cos(p), np.sin(r) * np.cos(p), -np.sin(p))
    y_axis = (
        np.cos(r) * np.sin(p) * np.sin(w) - np.sin(r) * np.cos(w),
        np.sin(r) * np.sin(p) * np.sin(w) + np.cos(r) * np.cos(w),
        np.cos(p) * np.sin(w),
    )
    return np.ascontiguousarray(np.stack([*x_axis, *y_axis], axis=1))


@njit()
def _lobe(
    cosines: NDArray[np.float64], log_falloff: NDArray[np.float64], s: float, alpha: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:  # pragma: no cover - compiled
    """Return ln R and its derivatives by s and α (`RingLight.log_radiance`)."""
    n, k = log_falloff.shape
    values, slopes = np.empty((n, k)), np.empty((2, n, k))
    ratio, alpha2 = np.exp(s), alpha * alpha
    for i in range(n):
        for j in range(k):
            light, view, half = cosines[i, j]
            bracket = half * half * (alpha2 - 1.0) + 1.0
            from_view = np.sqrt(view * view * (1.0 - alpha2) + alpha2)
            from_light = np.sqrt(light * light * (1.0 - alpha2) + alpha2)
            masking = light * from_view + view * from_light
            lobe = ratio * alpha2 / (np.pi * bracket * bracket) * 0.5 / masking
            slope = 2.0 / alpha - 4.0 * alpha * half * half / bracket
            slope -= (
                light * alpha * (1.0 - view * view) / from_view
                + view * alpha * (1.0 - light * light) / from_light
            ) / masking
            total = 1.0 / np.pi + lobe
            values[i, j] = np.log(total) + log_falloff[i, j]
            slopes[0, i, j] = lobe / total
            slopes[1, i, j] = slope * lobe / total
    return values, slopes


@njit(fastmath=True)
def _trace(
    poses: NDArray[np.float64],
    axes: NDArray[np.float64],
    eye: NDArray[np.float64],
    lamp: NDArray[np.float64],
) -> tuple[
    NDArray[np.float64], NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]
]:  # pragma: no cover - compiled
    n, k = len(poses), _POINTS * len(_RING_MM)
    cosines, log_falloff = np.zeros((n, k, 3)), np.full((n, k), -np.inf)
    half, points = np.zeros((n, k, 2)), np.zeros((n, k, 3))
    for i in range(n):
        x, y, z, w, p, radius = poses[i]
        sin_w, cos_w = np.sin(np.radians(w)), np.cos(np.radians(w))
        sin_p, cos_p = np.sin(np.radians(p)), np.cos(np.radians(p))
        # columns of Ry(p)·Rx(w); the feature's z points into the material
        right = (cos_p, 0.0, -sin_p)
        down = (sin_p * sin_w, cos_w, cos_p * sin_w)
        out = (-sin_p * cos_w, sin_w, -cos_p * cos_w)
        # the part's axis that lies more along the surface spans it
        first = axes[i, :3]
        along = first[0] * out[0] + first[1] * out[1] + first[2] * out[2]
        if along * along > 0.8:
            first = axes[i, 3:]
            along = first[0] * out[0] + first[1] * out[1] + first[2] * out[2]
        size = np.sqrt(1.0 - along * along)
        e1 = (
            (first[0] - along * out[0]) / size,
            (first[1] - along * out[1]) / size,
            (first[2] - along * out[2]) / size,
        )
        e2 = (
            out[1] * e1[2] - out[2] * e1[1],
            out[2] * e1[0] - out[0] * e1[2],
            out[0] * e1[1] - out[1] * e1[0],
        )
        for j in range(k):
            angle = 2.0 * np.pi * (j % _POINTS) / _POINTS
            reach = radius + (_RING_MM[0] if j < _POINTS else _RING_MM[1])
            a, b = reach * np.cos(angle), reach * np.sin(angle)
            point = (
                x + a * right[0] + b * down[0],
                y + a * right[1] + b * down[1],
                z + a * right[2] + b * down[2],
            )
            to_eye = (eye[0] - point[0], eye[1] - point[1], eye[2] - point[2])
            to_lamp = (lamp[0] - point[0], lamp[1] - point[1], lamp[2] - point[2])
            eye_mm = np.sqrt(to_eye[0] ** 2 + to_eye[1] ** 2 + to_eye[2] ** 2)
            lamp_mm = np.sqrt(to_lamp[0] ** 2 + to_lamp[1] ** 2 + to_lamp[2] ** 2)
            n_v = (to_eye[0] * out[0] + to_eye[1] * out[1] + to_eye[2] * out[2]) / eye_mm
            n_l = (to_lamp[0] * out[0] + to_lamp[1] * out[1] + to_lamp[2] * out[2]) / lamp_mm
            h0 = to_eye[0] / eye_mm + to_lamp[0] / lamp_mm
            h1 = to_eye[1] / eye_mm + to_lamp[1] / lamp_mm
            h2 = to_eye[2] / eye_mm + to_lamp[2] / lamp_mm
            length = np.sqrt(h0 * h0 + h1 * h1 + h2 * h2)
            n_h = (h0 * out[0] + h1 * out[1] + h2 * out[2]) / length
            half[i, j, 0] = (h0 * e1[0] + h1 * e1[1] + h2 * e1[2]) / length
            half[i, j, 1] = (h0 * e2[0] + h1 * e2[1] + h2 * e2[2]) / length
            points[i, j] = point
            cosines[i, j] = max(n_l, _GRAZING), max(n_v, _GRAZING), n_h
            seen = -(to_eye[0] * eye[3] + to_eye[1] * eye[4] + to_eye[2] * eye[5]) / eye_mm
            sent = -(to_lamp[0] * lamp[3] + to_lamp[1] * lamp[4] + to_lamp[2] * lamp[5]) / lamp_mm
            if lamp[3] == 0.0 and lamp[4] == 0.0 and lamp[5] == 0.0:
                sent = 1.0  # where the projector looks is not known
            if n_l > _GRAZING and n_v > _GRAZING and seen > _GRAZING and sent > _GRAZING:
                log_falloff[i, j] = np.log(n_l * seen**4 / (lamp_mm**2 * sent**3))
    return cosines, log_falloff, half, points
