"""How sheet metal reflects light: microfacets and a diffuse part, with grain fixed to the part.

The radiance that a surface sends to a camera, for unit irradiance, is

    f_r = (ρ_d/π + D·G₂·F / (4·cosθ_i·cosθ_o)) · (1 + c·g)

with the anisotropic GGX distribution D and its height-correlated masking G₂ (Heitz, *Understanding
the masking-shadowing function*, JCGT 2014), Schlick's Fresnel term F, and the grain g. GGX stands
for roughness finer than a pixel; the grain for what a camera resolves. It is value noise in part
coordinates, so that two views of one spot see the same grain: several octaves, as the lattice of a
single one would show. The same lattice carries two more values that tilt the surface's normal.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import astuple, dataclass
from types import MappingProxyType
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from exposight.compiled import njit
from exposight.errors import InputError
from exposight.twin.random_numbers import mix_bits, stream_key

Finish = Literal["bare", "primer", "paint", "brushed"]
FINISHES: tuple[Finish, ...] = ("bare", "primer", "paint", "brushed")
"""Finishes in the order of a scene's `face_finish`."""


@dataclass(frozen=True, kw_only=True)
class Surface:
    """How one finish reflects.

    Parameters
    ----------
    diffuse_albedo : float
        ρ_d: share of the light that is scattered evenly.
    mirror_reflectance : float
        F₀: Fresnel reflectance at normal incidence.
    alpha_along, alpha_across : float
        GGX roughness along and across the part's x axis (the brushing direction).
    grain_contrast : float
        c: the reflectance varies between (1 − c) and (1 + c) times its mean.
    normal_noise_rad : float, rad
        Root mean square of the tilt that the grain gives the surface's normal, about each axis.
    grain_stretch : float
        How much longer than wide the grain is, along the part's x axis.

    Raises
    ------
    InputError
        If it would reflect more light than it receives, or a number makes no sense.
    """

    diffuse_albedo: float
    mirror_reflectance: float
    alpha_along: float
    alpha_across: float
    grain_contrast: float
    normal_noise_rad: float
    grain_stretch: float = 1.0

    def __post_init__(self) -> None:
        shares = (self.diffuse_albedo, self.mirror_reflectance, self.grain_contrast)
        alphas = (self.alpha_along, self.alpha_across)
        if not (
            all(0 <= share < 1 for share in shares)
            and self.diffuse_albedo + self.mirror_reflectance <= 1
            and all(0 < alpha <= 1 for alpha in alphas)
            and 0 <= self.normal_noise_rad < 0.2
            and 1 <= self.grain_stretch < math.inf
        ):
            msg = (
                "a surface needs shares from 0 to 1 that do not reflect more than comes in, GGX "
                f"roughness above 0 and up to 1, and small normal noise, got {self}"
            )
            raise InputError(msg)


SURFACES: Mapping[Finish, Surface] = MappingProxyType(
    {
        # Bare, primer and paint: the values with which the twin's first prototype reproduced the
        # paper's Fig. 10 (rise to 25 grey levels, plateau, fall from 120 to 150).
        "bare": Surface(
            diffuse_albedo=0.04,
            mirror_reflectance=0.60,
            alpha_along=0.26,
            alpha_across=0.26,
            grain_contrast=0.45,
            normal_noise_rad=0.006,
        ),
        "primer": Surface(
            diffuse_albedo=0.33,
            mirror_reflectance=0.04,
            alpha_along=0.50,
            alpha_across=0.50,
            grain_contrast=0.15,
            normal_noise_rad=0.004,
        ),
        "paint": Surface(
            diffuse_albedo=0.06,
            mirror_reflectance=0.04,
            alpha_along=0.10,
            alpha_across=0.10,
            grain_contrast=0.08,
            normal_noise_rad=0.005,
        ),
        # Assumed throughout: reflectances and grain as bare sheet's; brushing smooths along its
        # lines (half the bare sheet's slopes) and roughens across them (one and a half times); the
        # lines are ten times longer than wide.
        "brushed": Surface(
            diffuse_albedo=0.04,
            mirror_reflectance=0.60,
            alpha_along=0.13,
            alpha_across=0.39,
            grain_contrast=0.45,
            normal_noise_rad=0.006,
            grain_stretch=10.0,
        ),
    }
)
"""What each finish is made of, the only place with these numbers."""


def surface_table(
    surfaces: Mapping[Finish, Surface] = SURFACES,
) -> NDArray[np.float64]:
    """Pack surfaces into a (finishes, 7) table in the order of `FINISHES`, for compiled loops."""
    return np.array([astuple(surfaces[finish]) for finish in FINISHES])


# -- reflectance ------------------------------------------------------------------------------


@njit(error_model="numpy")
def reflectance(
    surface: NDArray[np.float64], normal: Vector, to_light: Vector, to_eye: Vector
) -> float:
    """Return f_r in 1/sr, without grain; 0 where light or eye is behind the surface.

    Parameters
    ----------
    surface : (7,) ndarray
        A row of `surface_table`.
    normal, to_light, to_eye : (float, float, float)
        Unit vectors in the part's frame, away from the surface.
    """
    cos_i, cos_o = dot(normal, to_light), dot(normal, to_eye)
    if cos_i <= 0.0 or cos_o <= 0.0:
        return 0.0
    half = unit((to_light[0] + to_eye[0], to_light[1] + to_eye[1], to_light[2] + to_eye[2]))
    along, across = tangents(normal)
    ax, ay = surface[2], surface[3]
    hx, hy, hz = dot(half, along) / ax, dot(half, across) / ay, dot(half, normal)
    square = hx * hx + hy * hy + hz * hz
    distribution = 1.0 / (math.pi * ax * ay * square * square)
    # Heitz 2014, with the denominator 4·cosθ_i·cosθ_o already divided out.
    ix, iy = ax * dot(to_light, along), ay * dot(to_light, across)
    ox, oy = ax * dot(to_eye, along), ay * dot(to_eye, across)
    shadowed = cos_o * math.sqrt(ix * ix + iy * iy + cos_i * cos_i)
    masked = cos_i * math.sqrt(ox * ox + oy * oy + cos_o * cos_o)
    visible = 0.5 / (shadowed + masked)
    c = 1.0 - dot(half, to_eye)
    fresnel = surface[1] + (1.0 - surface[1]) * c * c * c * c * c
    return float(surface[0] / math.pi + distribution * visible * fresnel)


# -- grain ------------------------------------------------------------------------------------

GRAIN_SPACING_MM = 0.8
"""Finest lattice: 2.5 pixels of the structured-light sensor on its far plane, so that every view
resolves the same grain. Anything finer is in GGX's α."""
GRAIN_OCTAVES = 4  # 0.8, 1.6, 3.2 and 6.4 mm
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
def grain(x_mm: float, y_mm: float, z_mm: float, stretch: float) -> Vector:
    """Return three independent noises at a point of the part, each between −1 and 1, mean 0.

    Parameters
    ----------
    x_mm, y_mm, z_mm : float, mm
        The point in the part's frame.
    stretch : float
        How much longer the grain is along x.
    """
    g0, g1, g2 = 0.0, 0.0, 0.0
    spacing = GRAIN_SPACING_MM
    for octave in range(GRAIN_OCTAVES):
        # An offset by octave keeps the lattices' planes from falling together.
        x = x_mm / (spacing * stretch) + 0.37 * octave
        y = y_mm / spacing + 0.71 * octave
        z = z_mm / spacing + 0.13 * octave
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
        spacing *= 2.0
    scale = 2.0 / (GRAIN_OCTAVES * np.float64((1 << 21) - 1))
    return g0 * scale - 1.0, g1 * scale - 1.0, g2 * scale - 1.0


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
def tangents(normal: Vector) -> tuple[Vector, Vector]:
    """Return unit vectors along and across the part's x axis in the surface with this normal."""
    x, y, z = normal
    if abs(x) < 0.9:
        along = unit((1.0 - x * x, -x * y, -x * z))
    else:
        along = unit((-x * y, 1.0 - y * y, -y * z))
    across = (
        y * along[2] - z * along[1],
        z * along[0] - x * along[2],
        x * along[1] - y * along[0],
    )
    return along, across
