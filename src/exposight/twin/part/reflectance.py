"""How a surface reflects: microfacets and a diffuse part, with grain fixed to the part.

The radiance that a surface sends to a camera, for unit irradiance, is

    f_r = (ρ_d/π + D·G₂·F / (4·cosθ_i·cosθ_o)) · (1 + c·g)

with the anisotropic GGX distribution D and its height-correlated masking G₂ (Heitz, *Understanding
the masking-shadowing function*, JCGT 2014), Schlick's Fresnel term F, and the grain g. A second
lobe takes a share of the first one's place. Under a clear coat all this is dimmed by the coat's
Fresnel reflectance F_c for light and eye, (1 − F_c(θ_i)) · (1 − F_c(θ_o)), and the coat's own
reflection comes on top (KHR_materials_clearcoat of glTF, made reciprocal; Walter et al.,
*Microfacet models for refraction*, EGSR 2007, eq. 22, for F_c).

GGX stands for roughness finer than a pixel; the grain for what a camera resolves. It is value noise
in part coordinates, so that two views of one spot see the same grain: several octaves, as the
lattice of a single one would show. The same lattice carries two more values that tilt the surface's
normal.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from exposight.compiled import njit
from exposight.twin.random_numbers import mix_bits, stream_key

# Columns of `surface_table`.
DIFFUSE, FIRST, SECOND = 0, 1, 5  # a lobe is F₀, α along, α across; before the second its share
COAT_INDEX, COAT_ALPHA = 8, 9
EVEN, EVEN_COAT = 10, 11  # reflectance of even light; below and at the top of the coat
CONTRAST, NOISE, LENGTH, WIDTH = 12, 13, 14, 15  # of the grain
AXES = 16  # along, across and off the brushing direction

Vector = tuple[float, float, float]


@njit(inline="always", error_model="numpy")
def row(a: NDArray[np.float32], i: int) -> Vector:
    """Return row i of an (n, 3) array."""
    return np.float64(a[i, 0]), np.float64(a[i, 1]), np.float64(a[i, 2])


@njit(inline="always", error_model="numpy")
def dot(a: Vector, b: Vector) -> float:
    """Return the scalar product."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@njit(inline="always", error_model="numpy")
def unit(a: Vector) -> Vector:
    """Return a vector of length 1 in the same direction."""
    scale = 1.0 / math.sqrt(dot(a, a))
    return a[0] * scale, a[1] * scale, a[2] * scale


@njit(inline="always", error_model="numpy")
def axis(surface: NDArray[np.float64], i: int) -> Vector:
    """Return the brushing direction of a row of `surface_table`, or an axis square to it."""
    return surface[AXES + 3 * i], surface[AXES + 3 * i + 1], surface[AXES + 3 * i + 2]


@njit(error_model="numpy")
def tangents(normal: Vector, first: Vector, second: Vector) -> tuple[Vector, Vector]:
    """Return unit vectors along and across a direction in the surface with this normal.

    Parameters
    ----------
    normal, first, second : (float, float, float)
        Unit vectors; the second takes the place of the first where that is close to the normal.
    """
    x, y, z = normal
    d = dot(normal, first)
    if not abs(d) < 0.9:
        first, d = second, dot(normal, second)
    along = unit((first[0] - d * x, first[1] - d * y, first[2] - d * z))
    across = (
        y * along[2] - z * along[1],
        z * along[0] - x * along[2],
        x * along[1] - y * along[0],
    )
    return along, across


# -- reflectance ------------------------------------------------------------------------------


@njit(inline="always", error_model="numpy")
def _fresnel(cosine: float, index: float) -> float:
    """Return the reflectance of a clear layer for unpolarised light; 0 for an index of 1."""
    g = math.sqrt(index * index - 1.0 + cosine * cosine)
    a = (g - cosine) / (g + cosine)
    b = (cosine * (g + cosine) - 1.0) / (cosine * (g - cosine) + 1.0)
    return 0.5 * a * a * (1.0 + b * b)


@njit(inline="always", error_model="numpy")
def _facets(ax: float, ay: float, half: Vector, light: Vector, eye: Vector) -> float:
    """Return D·G₂ / (4·cosθ_i·cosθ_o) of unit vectors along, across and off the surface."""
    hx, hy, hz = half[0] / ax, half[1] / ay, half[2]
    square = hx * hx + hy * hy + hz * hz
    distribution = 1.0 / (math.pi * ax * ay * square * square)
    # Heitz 2014, with the denominator 4·cosθ_i·cosθ_o already divided out.
    ix, iy = ax * light[0], ay * light[1]
    ox, oy = ax * eye[0], ay * eye[1]
    shadowed = eye[2] * math.sqrt(ix * ix + iy * iy + light[2] * light[2])
    masked = light[2] * math.sqrt(ox * ox + oy * oy + eye[2] * eye[2])
    return distribution * (0.5 / (shadowed + masked))


@njit(error_model="numpy")
def reflectance(
    surface: NDArray[np.float64],
    normal: Vector,
    to_light: Vector,
    to_eye: Vector,
    grain_factor: float = 1.0,
) -> float:
    """Return f_r in 1/sr; 0 where light or eye is behind the surface.

    Parameters
    ----------
    surface : (25,) ndarray
        A row of `surface_table`.
    normal, to_light, to_eye : (float, float, float)
        Unit vectors in the part's frame, away from the surface.
    grain_factor : float
        1 + c·g.
    """
    cos_i, cos_o = dot(normal, to_light), dot(normal, to_eye)
    if cos_i <= 0.0 or cos_o <= 0.0:
        return 0.0
    half = unit((to_light[0] + to_eye[0], to_light[1] + to_eye[1], to_light[2] + to_eye[2]))
    along, across = tangents(normal, axis(surface, 0), axis(surface, 1))
    light = (dot(to_light, along), dot(to_light, across), cos_i)
    eye = (dot(to_eye, along), dot(to_eye, across), cos_o)
    facet = (dot(half, along), dot(half, across), dot(half, normal))
    c = 1.0 - dot(half, to_eye)
    fresnel = surface[FIRST] + (1.0 - surface[FIRST]) * c * c * c * c * c
    mirrored = _facets(surface[FIRST + 1], surface[FIRST + 2], facet, light, eye) * fresnel
    share = surface[SECOND - 1]
    if share > 0.0:
        fresnel = surface[SECOND] + (1.0 - surface[SECOND]) * c * c * c * c * c
        second = _facets(surface[SECOND + 1], surface[SECOND + 2], facet, light, eye) * fresnel
        mirrored += share * (second - mirrored)
    f_r = (surface[DIFFUSE] / math.pi + mirrored) * grain_factor
    index = surface[COAT_INDEX]
    if index > 1.0:
        f_r *= (1.0 - _fresnel(cos_i, index)) * (1.0 - _fresnel(cos_o, index))
        alpha = surface[COAT_ALPHA]
        f_r += _facets(alpha, alpha, facet, light, eye) * _fresnel(1.0 - c, index)
    return float(f_r)


# -- grain ------------------------------------------------------------------------------------

GRAIN_OCTAVES = 4
"""Each twice as coarse as the one before: 0.8, 1.6, 3.2 and 6.4 mm on sheet metal."""
GRAIN_RMS = 0.185
"""Root mean square of `grain`'s values on a surface: √(⅓ · 0.743³ / 4), 0.743 being the mean of the
squared weights of smooth interpolation along an axis and ⅓ the variance of a lattice value."""

_KEY = stream_key(0x6772A1)  # any other number gives another sheet of the same kind
_ROW, _PLANE, _OCTAVE = np.uint64(1 << 20), np.uint64(1 << 40), np.uint64(1 << 60)
_MASK20, _MASK21 = np.uint64((1 << 20) - 1), np.uint64((1 << 21) - 1)
_21, _42 = np.uint64(21), np.uint64(42)


@njit(inline="always", error_model="numpy")
def _smooth(t: float) -> float:
    return t * t * (3.0 - 2.0 * t)


@njit(error_model="numpy")
def grain(surface: NDArray[np.float64], point_mm: Vector) -> Vector:
    """Return three independent noises at a point of the part, each between −1 and 1, mean 0.

    Parameters
    ----------
    surface : (25,) ndarray
        A row of `surface_table`.
    point_mm : (float, float, float), mm
        In the part's frame.
    """
    p0 = dot(point_mm, axis(surface, 0))
    p1 = dot(point_mm, axis(surface, 1))
    p2 = dot(point_mm, axis(surface, 2))
    g0, g1, g2 = 0.0, 0.0, 0.0
    length, width = surface[LENGTH], surface[WIDTH]
    for octave in range(GRAIN_OCTAVES):
        # An offset by octave keeps the lattices' planes from falling together.
        x = p0 / length + 0.37 * octave
        y = p1 / width + 0.71 * octave
        z = p2 / width + 0.13 * octave
        fx, fy, fz = math.floor(x), math.floor(y), math.floor(z)
        tx, ty, tz = _smooth(x - fx), _smooth(y - fy), _smooth(z - fz)
        ix, iy, iz = np.int64(fx), np.int64(fy), np.int64(fz)
        for corner in range(8):
            dx, dy, dz = corner & 1, (corner >> 1) & 1, corner >> 2
            weight = (tx if dx else 1.0 - tx) * (ty if dy else 1.0 - ty) * (tz if dz else 1.0 - tz)
            cell = (
                (np.uint64(ix + dx) & _MASK20)
                + (np.uint64(iy + dy) & _MASK20) * _ROW
                + (np.uint64(iz + dz) & _MASK20) * _PLANE
                + np.uint64(octave) * _OCTAVE
            )
            bits = mix_bits(_KEY, cell)
            g0 += weight * np.float64(np.int64(bits & _MASK21))
            g1 += weight * np.float64(np.int64((bits >> _21) & _MASK21))
            g2 += weight * np.float64(np.int64((bits >> _42) & _MASK21))
        length *= 2.0
        width *= 2.0
    scale = 2.0 / (GRAIN_OCTAVES * np.float64((1 << 21) - 1))
    return g0 * scale - 1.0, g1 * scale - 1.0, g2 * scale - 1.0
