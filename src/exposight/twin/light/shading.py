"""Light that a projector sends to a surface and on to an eye: radiance, and where in the pattern.

A digital projector sends the same flux through every pixel. Pixels off the axis see a smaller solid
angle, by cos³θ_p, so the fully lit projector has the intensity 1/cos³θ_p (1 on the axis), and a
surface at distance r sends the radiance

    D = f_r · cosθ_i · V / (r² · cos³θ_p)      (per mm², V: 1 where the projector is seen, else 0)

to the eye. What the pattern adds follows from the projector coordinates (u, v) of the point and
from the pattern's blur there; both are kept.
"""

import math
from dataclasses import dataclass

import numba
import numpy as np
from numpy.typing import NDArray

from exposight.cell import ActiveSensor
from exposight.compiled import njit
from exposight.errors import SensorError
from exposight.geometry import RigidTransform
from exposight.geometry.cameras import distort_point
from exposight.geometry.ray_casting import MISS_MM
from exposight.twin.light.optics import ProjectorLens, SceneTracer, projector_of
from exposight.twin.part.finishes import finish_at
from exposight.twin.part.reflectance import (
    CONTRAST,
    EVEN,
    EVEN_COAT,
    GRAIN_RMS,
    NOISE,
    Vector,
    axis,
    dot,
    grain,
    reflectance,
    row,
    tangents,
    unit,
)

NUDGE_MM = 0.02
"""How far a shadow ray starts off the surface: a hundred times Embree's rounding."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Lamp:
    """A projector in the part's frame, packed for compiled loops.

    Parameters
    ----------
    centre_mm : (3,) ndarray, mm
        Its lens.
    rotation, translation_mm : (3, 3) and (3,) ndarray
        ``projector_from_part``.
    image_from_distorted : (3, 3) ndarray
        Homography from distorted normalised coordinates to pattern px.
    coefficients : (14,) ndarray
        Lens distortion.
    numbers : (6,) ndarray
        Radius limit of the lens model; width, height (px); sharp blur (px), defocus (px·mm), focus
        (mm).
    irradiance_at_tcp : float, 1/mm²
        Of the fully lit projector on a surface at the sensor's TCP that faces it.
    """

    centre_mm: NDArray[np.float64]
    rotation: NDArray[np.float64]
    translation_mm: NDArray[np.float64]
    image_from_distorted: NDArray[np.float64]
    coefficients: NDArray[np.float64]
    numbers: NDArray[np.float64]
    irradiance_at_tcp: float


def lamp_of(sensor: ActiveSensor, camera_from_part: RigidTransform, lens: ProjectorLens) -> Lamp:
    """Return a sensor's projector as it stands before the part.

    Parameters
    ----------
    sensor : ActiveSensor
        With a projector.
    camera_from_part : RigidTransform
        Where the part stands, seen from the first camera.
    lens : ProjectorLens
        Its focus defaults to the TCP.

    Raises
    ------
    SensorError
        If the sensor has no projector, or its TCP is behind the projector.
    """
    projector = projector_of(sensor)
    projector_from_camera = projector.camera_from_projector.inverse()
    tcp = (projector_from_camera @ sensor.camera_from_tcp).translation_mm
    if tcp[2] <= 0:
        msg = f"sensor {sensor.name!r}: its TCP must be in front of the projector"
        raise SensorError(msg)
    focus_mm = float(tcp[2]) if lens.focus_mm is None else lens.focus_mm
    projector_from_part = projector_from_camera @ camera_from_part
    camera = projector.camera
    return Lamp(
        centre_mm=projector_from_part.inverse().translation_mm,
        rotation=np.ascontiguousarray(projector_from_part.rotation),
        translation_mm=projector_from_part.translation_mm,
        image_from_distorted=camera.image_from_distorted,
        coefficients=camera.coefficients,
        numbers=np.array(
            [
                camera.radius_limit,
                camera.width,
                camera.height,
                lens.sharp_blur_px,
                lens.defocus_px_mm,
                focus_mm,
            ]
        ),
        irradiance_at_tcp=float(np.linalg.norm(tcp) / tcp[2] ** 3),  # 1 / (r²·cos³θ_p)
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class LitHits:
    """What n rays see of the lit scene; everything 0 where they meet nothing.

    Parameters
    ----------
    distance : (n,) ndarray of float32
        In units of the ray's direction; NaN where nothing is met.
    radiance : (n,) ndarray of float32, 1/mm²
        D of the fully lit projector; 0 in shadow.
    column, row, blur_px : (n,) ndarray of float32, projector px
        Where in the pattern the point lies, and the pattern's blur there.
    reflectance : (n,) ndarray of float32
        Share of even light from all sides that is reflected, grain included.
    position_mm, normal : (n, 3) ndarray of float32
        The point in the part's frame and the normal there, grain included.
    finish : (n,) ndarray of uint8
        Index into the scene's surfaces.
    """

    distance: NDArray[np.float32]
    radiance: NDArray[np.float32]
    column: NDArray[np.float32]
    row: NDArray[np.float32]
    blur_px: NDArray[np.float32]
    reflectance: NDArray[np.float32]
    position_mm: NDArray[np.float32]
    normal: NDArray[np.float32]
    finish: NDArray[np.uint8]


def light_along_rays(
    tracer: SceneTracer,
    lamp: Lamp,
    origins: NDArray[np.float32],
    directions: NDArray[np.float32],
    *,
    with_grain: bool = True,
) -> LitHits:
    """Trace rays to the scene, and from there to the projector.

    Parameters
    ----------
    tracer : SceneTracer
        The scene.
    lamp : Lamp
        The projector.
    origins, directions : (n, 3) ndarray of float32, mm
        Rays in the part's frame.
    with_grain : bool
        False for the smooth mean of every surface.
    """
    n = len(origins)
    distance, face, u, v, normal = tracer.first_hits(origins, directions)
    numbers = np.empty((5, n), dtype=np.float32)
    lit = LitHits(
        distance=distance,
        radiance=numbers[0],
        column=numbers[1],
        row=numbers[2],
        blur_px=numbers[3],
        reflectance=numbers[4],
        position_mm=np.empty((n, 3), dtype=np.float32),
        normal=np.empty((n, 3), dtype=np.float32),
        finish=np.zeros(n, dtype=np.uint8),
    )
    shadow_origins = np.empty((n, 3), dtype=np.float32)
    _light(
        origins,
        directions,
        distance,
        (face, u, v, normal),
        (tracer.corner_normals, tracer.face_finish),
        (tracer.surfaces, tracer.zones),
        with_grain,
        (lamp.centre_mm, lamp.rotation, lamp.translation_mm),
        (lamp.image_from_distorted, lamp.coefficients, lamp.numbers),
        numbers,
        lit.position_mm,
        lit.normal,
        lit.finish,
        shadow_origins,
    )
    ask = np.flatnonzero(lit.radiance)
    start = shadow_origins[ask]
    to_lamp = lamp.centre_mm.astype(np.float32) - start
    lit.radiance[ask[tracer.blocked(start, to_lamp)]] = 0.0
    return lit


@njit(inline="always", error_model="numpy")
def _normals(
    face: int,
    u: float,
    v: float,
    facet: Vector,
    to_eye: Vector,
    corner_normals: NDArray[np.float32],
) -> tuple[Vector, Vector]:
    """Return the triangle's and the smooth unit normal, both towards the eye."""
    a = row(corner_normals, 3 * face)
    b = row(corner_normals, 3 * face + 1)
    c = row(corner_normals, 3 * face + 2)
    w = 1.0 - u - v
    smooth = (
        w * a[0] + u * b[0] + v * c[0],
        w * a[1] + u * b[1] + v * c[1],
        w * a[2] + u * b[2] + v * c[2],
    )
    if dot(facet, to_eye) < 0.0:
        facet = (-facet[0], -facet[1], -facet[2])
    facet = unit(facet)
    length = math.copysign(math.sqrt(dot(smooth, smooth)), dot(smooth, facet))
    smooth = (smooth[0] / length, smooth[1] / length, smooth[2] / length)
    if not dot(smooth, to_eye) > 0.0:  # turned away, or NaN: a triangle without area
        return facet, facet
    return facet, smooth


@njit(inline="always", error_model="numpy")
def _pattern_place(
    p: Vector,
    rotation: NDArray[np.float64],
    translation: NDArray[np.float64],
    h: NDArray[np.float64],
    k: NDArray[np.float64],
    limit: float,
) -> tuple[float, float, float, float]:
    """Return u, v in px, depth in mm and cosθ_p of a point; u is NaN where it is not lit."""
    x = rotation[0, 0] * p[0] + rotation[0, 1] * p[1] + rotation[0, 2] * p[2] + translation[0]
    y = rotation[1, 0] * p[0] + rotation[1, 1] * p[1] + rotation[1, 2] * p[2] + translation[1]
    z = rotation[2, 0] * p[0] + rotation[2, 1] * p[1] + rotation[2, 2] * p[2] + translation[2]
    if z <= 0.0:
        return np.nan, np.nan, z, 0.0
    cosine = z / math.sqrt(x * x + y * y + z * z)
    x, y = x / z, y / z
    if x * x + y * y > limit * limit:
        return np.nan, np.nan, z, cosine
    dx, dy, j_xx, j_xy, j_yx, j_yy = distort_point(x, y, k)
    if j_xx * j_yy - j_xy * j_yx <= 0.0:
        return np.nan, np.nan, z, cosine
    weight = h[2, 0] * dx + h[2, 1] * dy + h[2, 2]
    u = (h[0, 0] * dx + h[0, 1] * dy + h[0, 2]) / weight
    v = (h[1, 0] * dx + h[1, 1] * dy + h[1, 2]) / weight
    return u, v, z, cosine


@njit(inline="always", error_model="numpy")
def _add_grain(
    p: Vector, normal: Vector, to_eye: Vector, surface: NDArray[np.float64]
) -> tuple[Vector, float]:
    """Return the tilted normal and the factor on the reflectance at a point."""
    value, tilt_along, tilt_across = grain(surface, p)
    along, across = tangents(normal, axis(surface, 0), axis(surface, 1))
    a, b = tilt_along * surface[NOISE] / GRAIN_RMS, tilt_across * surface[NOISE] / GRAIN_RMS
    tilted = unit(
        (
            normal[0] + a * along[0] + b * across[0],
            normal[1] + a * along[1] + b * across[1],
            normal[2] + a * along[2] + b * across[2],
        )
    )
    factor = 1.0 + surface[CONTRAST] * value
    if dot(tilted, to_eye) <= 0.0:
        return normal, factor
    return tilted, factor


@njit(parallel=True, error_model="numpy")
def _light(
    origins: NDArray[np.float32],
    directions: NDArray[np.float32],
    distance: NDArray[np.float32],
    hits: tuple[NDArray[np.int32], NDArray[np.float32], NDArray[np.float32], NDArray[np.float32]],
    mesh: tuple[NDArray[np.float32], NDArray[np.uint8]],
    finishes: tuple[NDArray[np.float64], NDArray[np.float64]],
    with_grain: bool,
    pose: tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]],
    lens: tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]],
    numbers: NDArray[np.float32],
    positions: NDArray[np.float32],
    normals: NDArray[np.float32],
    finish: NDArray[np.uint8],
    shadow_origins: NDArray[np.float32],
) -> None:
    """Fill what `LitHits` holds, before the shadow test, and where its rays start.

    `numbers` are radiance, column, row, blur and even reflectance of every hit. What is written
    to stands on its own: numba loses what a parallel loop writes to an array inside a tuple.
    """
    face, bary_u, bary_v, facets = hits
    corner_normals, face_finish = mesh
    surfaces, zones = finishes
    centre, rotation, translation = pose
    h, k, lamp = lens
    for i in numba.prange(distance.size):
        for j in range(5):
            numbers[j, i] = 0.0
        for j in range(3):
            positions[i, j] = 0.0
            normals[i, j] = 0.0
        if not distance[i] < MISS_MM:
            distance[i] = np.nan
            continue
        direction = row(directions, i)
        t = np.float64(distance[i])
        p = (
            origins[i, 0] + t * direction[0],
            origins[i, 1] + t * direction[1],
            origins[i, 2] + t * direction[2],
        )
        to_eye = unit((-direction[0], -direction[1], -direction[2]))
        facet, normal = _normals(
            face[i], bary_u[i], bary_v[i], row(facets, i), to_eye, corner_normals
        )
        finish[i] = finish_at(zones, p, face_finish[face[i]])
        surface = surfaces[finish[i]]
        factor = 1.0
        if with_grain:
            normal, factor = _add_grain(p, normal, to_eye, surface)
        numbers[4, i] = surface[EVEN] * factor + surface[EVEN_COAT]
        for j in range(3):
            positions[i, j] = p[j]
            normals[i, j] = normal[j]
            shadow_origins[i, j] = p[j] + NUDGE_MM * facet[j]
        u, v, z, cos_p = _pattern_place(p, rotation, translation, h, k, lamp[0])
        # False for NaN
        if not (-0.5 <= u < lamp[1] - 0.5 and -0.5 <= v < lamp[2] - 0.5):
            continue
        to_lamp = (centre[0] - p[0], centre[1] - p[1], centre[2] - p[2])
        r2 = dot(to_lamp, to_lamp)
        to_lamp = unit(to_lamp)
        cos_i = dot(normal, to_lamp)
        if cos_i <= 0.0 or dot(facet, to_lamp) <= 0.0:
            continue
        f_r = reflectance(surface, normal, to_lamp, to_eye, factor)
        numbers[0, i] = f_r * cos_i / (r2 * cos_p * cos_p * cos_p)
        numbers[1, i], numbers[2, i] = u, v
        defocus = lamp[4] * abs(1.0 / z - 1.0 / lamp[5])
        numbers[3, i] = math.sqrt(lamp[3] * lamp[3] + defocus * defocus)
