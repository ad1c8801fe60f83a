"""Standard deviation of each point's depth, from the noise of the frames that it was decoded from.

Noise of σ_I grey levels in N equal steps of a fringe of amplitude B gives its phase the standard
deviation √(2/N)·σ_I/B (Surrel, *Additive noise effect in digital phase detection*, Applied Optics
1997). Here each sample has its own σ_I, since light is counted in photons, and shifts may be any:
the phase's derivatives by the samples follow from the pseudo-inverse that decodes them. Of several
fringes only the finest says where the point is; the others say in which of its periods.

Two projector coordinates are least squares along the ray (`triangulate`), so
σ_z² = Σ (∂u/∂z)²·σ_u² / (Σ (∂u/∂z)²)².
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Literal

import numba
import numpy as np
from numpy.typing import NDArray

from exposight.cell import GREY_MAX, Cloud, Image, full_scale
from exposight.compiled import njit
from exposight.errors import ImageError
from exposight.geometry import PinholeCamera, RigidTransform
from exposight.geometry.cameras import distort_point
from exposight.imaging.codings import Fringe
from exposight.imaging.decoded import DecodedMap
from exposight.imaging.frames import FrameStack, Levels
from exposight.imaging.sequences import PatternSequence

FloatArray = NDArray[np.float64]

_MOST_PIXELS, _FEWEST_PIXELS = 100_000, 1000
"""Pixels that the noise is found from: more say nothing new, fewer leave it uncertain by 3 %."""
_BINS, _LEAST_IN_BIN = 16, 1000
"""Levels of brightness between which the variance is compared, and pixels of each."""
_HARMONICS = 4
_ROUNDED = 1.0 / 12.0
"""Variance of rounding, in squared grey levels of the frames: no sample has less."""
_TRIMMED = 4.0
"""Residuals beyond so many standard deviations are of edges and moving things, not noise."""


@dataclass(frozen=True, kw_only=True)
class GreyNoise:
    """How far one sample of a pixel strays: its variance is dark + gain·I at grey level I.

    Parameters
    ----------
    dark : float, (grey levels 0–255)²
        Variance at grey level 0, that of rounding included; below 0 where a black level lies under
        all that light adds.
    gain : float, grey levels 0–255
        Variance for each grey level: photon noise.
    source : {'recording', 'given'}
        Whether it was found from frames (`noise_of_frames`), in proportion to light, or is that of
        recorded grey levels; with a response of the camera these differ.
    systematic : float, grey levels 0–255
        Root mean square of what the frames have beside a sine and noise: harmonics of a gamma,
        flicker, motion.
    """

    dark: float
    gain: float = 0.0
    source: Literal["recording", "given"] = "given"
    systematic: float = 0.0

    @classmethod
    def given(cls, grey_noise: float, bit_depth: int) -> GreyNoise:
        """Return the noise of a camera that is known, the same at all grey levels.

        Parameters
        ----------
        grey_noise : float, grey levels 0–255
            Standard deviation of a sample before it is rounded.
        bit_depth : int
            To which it is rounded: 1/12 of a step's square is added.

        Raises
        ------
        ImageError
            If the noise is not above 0.
        """
        if not 0.0 < grey_noise < GREY_MAX:
            msg = (
                "grey_noise must be the standard deviation of a pixel's grey level, above 0 and "
                f"on a scale of 255 (1 is usual), got {grey_noise:g}"
            )
            raise ImageError(msg)
        return cls(dark=grey_noise**2 + _rounding(bit_depth))

    def at(self, grey_levels: float) -> float:
        """Return the standard deviation at a grey level, both 0–255."""
        return math.sqrt(max(self.dark + self.gain * grey_levels, 0.0))

    @property
    def remark(self) -> str:
        """What else than noise there is in the frames, where it is more; else empty."""
        middle = self.at(GREY_MAX / 3)
        if self.systematic <= middle:
            return ""
        return (
            f"the fringes are no pure sines: beside noise of {middle:.2g} grey levels they have "
            f"{self.systematic:.2g} that noise does not explain (a gamma, flicker or motion); "
            "sigma_z is of the noise alone"
        )


def why_no_sigma(sequence: PatternSequence) -> str:
    """Return why no standard deviation follows from a sequence; empty where it does."""
    axes = [name for name, coding, _ in sequence.axes() if not coding.fringes]
    if not axes:
        return ""
    return (
        f"no sigma_z: the {' and '.join(axes)} are coded by Gray code alone, which has no phase "
        "whose noise could be told"
    )


def noise_of_frames(
    stack: FrameStack, sequence: PatternSequence, decoded: DecodedMap
) -> GreyNoise | None:
    """Find the noise of a sample from what sines leave of the frames.

    N ≥ 4 steps of a fringe leave N − 3 residuals. Those of noise follow no rule; those of
    harmonics, flicker and motion follow phase and amplitude, and are taken out by regression.

    Parameters
    ----------
    stack : FrameStack
        The recording.
    sequence : PatternSequence
        What its frames mean.
    decoded : DecodedMap
        Tells which pixels show the patterns.

    Returns
    -------
    GreyNoise or None
        None where no fringe has four steps, or too few pixels were decoded.
    """
    fringes = [
        (fringe, decoded.column if name == "columns" else decoded.row, size, coding.fringes[-1])
        for name, coding, size in sequence.axes()
        for fringe in coding.fringes
        if len(fringe.frames) > 3
    ]
    pixels = np.flatnonzero(decoded.valid)
    if not fringes or pixels.size < _FEWEST_PIXELS:
        return None
    pixels = pixels[:: -(-pixels.size // _MOST_PIXELS)]
    light = stack.light()
    frames, scale = light.frames.reshape(stack.n_frames, -1), light.scale
    found = []
    for fringe, coordinate, size, finest in fringes:
        samples = scale * frames[np.array(fringe.frames)[:, None], pixels]
        turns = np.asarray(coordinate).ravel()[pixels] * (fringe.periods / size)
        # Its own noise is in the finest fringe's phase, and must be little against its spread.
        spread = np.inf if fringe is not finest else float(np.ptp(turns))
        found.append(_variances(samples, fringe, turns if spread >= 1.0 else np.zeros_like(turns)))
    level, variance, weight, systematic = np.concatenate(found, axis=1)
    dark, gain = _line(level, variance, weight)
    return GreyNoise(
        dark=dark,
        gain=gain,
        source="recording",
        systematic=float(np.sqrt(np.average(systematic, weights=weight))),
    )


def _variances(samples: FloatArray, fringe: Fringe, turns: FloatArray) -> FloatArray:
    """Return (4, m): grey level, variance, pixels and systematic square, by brightness.

    Whatever follows mean and phase is taken for systematic. The samples' own amplitude tells
    nothing beside them, and its noise is not independent of the residuals': photons come in
    brighter samples more unevenly. The mean's is, and that of the phase of another fringe.
    """
    mean = fringe.solver()[0] @ samples
    shifts = np.radians(fringe.steps_deg)
    design = np.column_stack([np.ones_like(shifts), np.cos(shifts), np.sin(shifts)])
    left = np.linalg.svd(design)[0][:, 3:].T  # (N − 3, N): orthonormal, blind to sines
    residuals, levels = left @ samples, left**2 @ samples
    harmonics = 2.0 * np.pi * np.arange(_HARMONICS + 1)[:, None] * turns
    known = np.concatenate([np.cos(harmonics), np.sin(harmonics[1:])])
    known = np.concatenate([known, known * mean / GREY_MAX])
    rows = []
    bins = int(np.clip(mean.size // _LEAST_IN_BIN, 1, _BINS))
    for places in np.array_split(np.argsort(mean), bins):
        of_bin = known[:, places]
        for residual, level in zip(residuals[:, places], levels[:, places], strict=True):
            kept = np.ones(places.size, dtype=np.bool_)
            for _ in range(3):
                fitted = np.linalg.lstsq(of_bin[:, kept].T, residual[kept], rcond=1e-10)
                rule = fitted[0] @ of_bin
                noise = residual - rule
                rank = int(fitted[2])
                freedom = max(int(np.count_nonzero(kept)) - rank, 1)
                variance = float((noise[kept] ** 2).sum()) / freedom
                kept = np.abs(noise) <= _TRIMMED * np.sqrt(variance)
            systematic = max(float((rule**2).mean()) - variance * rank / places.size, 0.0)
            rows.append((level.mean(), variance, float(kept.sum()), systematic))
    return np.array(rows).T


def _line(level: FloatArray, variance: FloatArray, weight: FloatArray) -> tuple[float, float]:
    """Return dark and gain of a variance that rises with the level, robustly."""
    trust, model = np.ones_like(level), np.maximum(variance, 1e-12)
    for _ in range(5):
        root = np.sqrt(weight * trust) / model
        design = np.column_stack([root, root * level])
        (dark, gain), *_ = np.linalg.lstsq(design, root * variance, rcond=1e-10)
        if gain < 0.0:
            dark, gain = np.average(variance, weights=root**2), 0.0
        model = np.maximum(dark + gain * level, 1e-12)
        off = np.abs(variance / model - 1.0) * np.sqrt(weight / 2.0)
        usual = max(1.4826 * float(np.median(off)), 1.0)
        trust = np.minimum(1.0, 2.0 * usual / np.maximum(off, 1e-12))
    return float(dark), float(gain)


def _rounding(bit_depth: int) -> float:
    """Return the variance of rounding to whole grey levels, in (grey levels 0–255)²."""
    return float((GREY_MAX / full_scale(bit_depth)) ** 2 * _ROUNDED)


def with_sigma_z(
    cloud: Cloud,
    stack: FrameStack,
    sequence: PatternSequence,
    noise: GreyNoise,
    *,
    projector: PinholeCamera,
    projector_from_camera: RigidTransform,
) -> Cloud:
    """Return a cloud with the standard deviation of each point's z along its camera's ray.

    Parameters
    ----------
    cloud : Cloud
        Triangulated from the frames, organised like them.
    stack : FrameStack
        The frames.
    sequence : PatternSequence
        What they mean; each coded axis has fringes (`why_no_sigma`).
    noise : GreyNoise
        Of a sample.
    projector : PinholeCamera
        Lens of the projector, distortion included.
    projector_from_camera : RigidTransform
        Its pose, mm.

    Raises
    ------
    ImageError
        If an axis has no fringe, or the cloud is not organised like the frames.
    """
    fault = why_no_sigma(sequence)
    if not fault and cloud.valid.shape != stack.image_shape:
        fault = (
            f"the cloud is not organised like the frames: expected {stack.image_shape} rows and "
            f"columns, got {cloud.valid.shape}"
        )
    if fault:
        raise ImageError(fault)
    finest = [(name, coding.fringes[-1], size) for name, coding, size in sequence.axes()]
    solvers = [fringe.solver() for _, fringe, _ in finest]
    sigma = np.empty(stack.image_shape, dtype=np.float32)
    _propagate(
        cloud.points,
        stack.light().frames,
        stack.frames,
        np.concatenate([fringe.frames for _, fringe, _ in finest]).astype(np.uint64),
        np.cumsum([0, *(len(fringe.frames) for _, fringe, _ in finest)]),
        np.concatenate([solver[1] for solver in solvers]),
        np.concatenate([solver[2] for solver in solvers]),
        np.array([size / (2.0 * np.pi * fringe.periods) for _, fringe, size in finest]),
        np.array([name == "rows" for name, _, _ in finest], dtype=np.int64),
        _variance_of_levels(stack, noise),
        np.ascontiguousarray(projector_from_camera.rotation),
        np.ascontiguousarray(projector_from_camera.translation_mm),
        projector.image_from_distorted,
        projector.coefficients,
        sigma,
    )
    return cloud.with_sigma(sigma)


def _variance_of_levels(stack: FrameStack, noise: GreyNoise) -> FloatArray:
    """Return the variance of a sample's light at each recorded grey level, in frames' units."""
    levels = np.arange(stack.full_scale + 1.0)
    light = levels if stack.response is None else stack.response
    slope = np.gradient(light)
    scale = GREY_MAX / stack.full_scale
    dark, gain = noise.dark / scale**2, noise.gain / scale
    if noise.source == "given":
        return np.asarray(slope**2 * np.maximum(dark + gain * levels, _ROUNDED))
    return np.asarray(np.maximum(dark + gain * light, slope**2 * _ROUNDED))


def recorded_sigma_z(
    cloud: Cloud,
    stack: FrameStack,
    sequence: PatternSequence,
    decoded: DecodedMap,
    *,
    projector: PinholeCamera,
    projector_from_camera: RigidTransform,
    grey_noise: float | None = None,
) -> tuple[Cloud, str]:
    """Give a recording's cloud its standard deviations, as far as its noise is known.

    Parameters
    ----------
    cloud, stack, sequence, projector, projector_from_camera
        As for `with_sigma_z`.
    decoded : DecodedMap
        What the cloud was triangulated from.
    grey_noise : float, grey levels 0–255, optional
        Standard deviation of a sample, in place of the sequence's and of what frames tell.

    Returns
    -------
    Cloud
        As it was where nothing is known.
    str
        Why nothing is, or what else than noise there is; empty otherwise.
    """
    why = why_no_sigma(sequence)
    if why:
        return cloud, why
    given = sequence.grey_noise if grey_noise is None else grey_noise
    if given is not None:
        noise: GreyNoise | None = GreyNoise.given(given, stack.bit_depth)
    else:
        noise = noise_of_frames(stack, sequence, decoded)
    if noise is None:
        return cloud, (
            "no sigma_z: fringes of three steps, or a few pixels, do not tell the camera's noise; "
            "give its standard deviation, in grey levels of 255, as grey_noise of the sequence or "
            "by --grey-noise"
        )
    poses: dict[str, Any] = {
        "projector": projector,
        "projector_from_camera": projector_from_camera,
    }
    return with_sigma_z(cloud, stack, sequence, noise, **poses), noise.remark


@njit(parallel=True, error_model="numpy", fastmath={"arcp", "contract"})
def _propagate(
    points: NDArray[np.float32],
    frames: Levels,
    recorded: Image,
    frame: NDArray[np.uint64],
    first: NDArray[np.int64],
    to_cosine: FloatArray,
    to_sine: FloatArray,
    px_per_radian: FloatArray,
    axes: NDArray[np.int64],
    variance_of: FloatArray,
    rotation: FloatArray,
    translation: FloatArray,
    h: FloatArray,
    k: FloatArray,
    sigma: NDArray[np.float32],
) -> None:
    """Fill sigma; fringe i is of axis axes[i] and has the steps first[i] … first[i + 1] − 1."""
    for r in numba.prange(points.shape[0]):
        slope = np.empty(2)
        for c in range(points.shape[1]):
            sigma[r, c] = np.nan
            if np.isnan(points[r, c, 2]):
                continue
            _slopes(points[r, c], rotation, translation, h, k, slope)
            normal, total = 0.0, 0.0
            for i in range(axes.size):
                cosine, sine, of_cosine, of_sine, of_both = 0.0, 0.0, 0.0, 0.0, 0.0
                for j in range(first[i], first[i + 1]):
                    by_cosine, by_sine = to_cosine[j], to_sine[j]
                    sample = float(frames[frame[j], r, c])
                    variance = variance_of[recorded[frame[j], r, c]]
                    cosine += by_cosine * sample
                    sine += by_sine * sample
                    of_cosine += by_cosine * by_cosine * variance
                    of_sine += by_sine * by_sine * variance
                    of_both += by_cosine * by_sine * variance
                scale = px_per_radian[i] / (cosine * cosine + sine * sine)
                variance = cosine * cosine * of_sine + sine * sine * of_cosine
                variance = (variance - 2.0 * cosine * sine * of_both) * scale * scale
                along = slope[axes[i]] * slope[axes[i]]
                normal += along
                total += along * variance
            sigma[r, c] = points[r, c, 2] * np.sqrt(total) / normal


@njit(inline="always", error_model="numpy")
def _slopes(
    point: NDArray[np.float32],
    rotation: FloatArray,
    t: FloatArray,
    h: FloatArray,
    k: FloatArray,
    slope: FloatArray,
) -> None:
    """Fill z·∂u/∂z and z·∂v/∂z of the projector's image along the camera's ray, px.

    Divisions are few: they take most of the time.
    """
    p, q, s = float(point[0]), float(point[1]), float(point[2])
    a = rotation[0, 0] * p + rotation[0, 1] * q + rotation[0, 2] * s
    b = rotation[1, 0] * p + rotation[1, 1] * q + rotation[1, 2] * s
    c = rotation[2, 0] * p + rotation[2, 1] * q + rotation[2, 2] * s
    per_depth = 1.0 / (c + t[2])
    x, y = (a + t[0]) * per_depth, (b + t[1]) * per_depth
    slope_x, slope_y = (a - x * c) * per_depth, (b - y * c) * per_depth
    dx, dy, j_xx, j_xy, j_yx, j_yy = distort_point(x, y, k)
    slope_dx, slope_dy = j_xx * slope_x + j_xy * slope_y, j_yx * slope_x + j_yy * slope_y
    per_weight = 1.0 / (h[2, 0] * dx + h[2, 1] * dy + h[2, 2])
    slope_weight = (h[2, 0] * slope_dx + h[2, 1] * slope_dy) * per_weight
    for axis in range(2):
        image = h[axis, 0] * dx + h[axis, 1] * dy + h[axis, 2]
        along = h[axis, 0] * slope_dx + h[axis, 1] * slope_dy
        slope[axis] = (along - image * slope_weight) * per_weight
