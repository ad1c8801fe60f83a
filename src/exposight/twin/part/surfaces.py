"""What finishes are made of: a diffuse part, microfacets, a clear coat, and grain.

How they reflect is in `exposight.twin.part.reflectance`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from exposight.errors import InputError

Finish = Literal["bare", "primer", "paint", "brushed"]
FINISHES: tuple[Finish, ...] = get_args(Finish)
"""The finishes in `SURFACES`, in its order."""

_POLAR_DEG = (0.0, 30.0, 50.0, 60.0, 70.0, 75.0, 80.0, 85.0, 88.0, 89.5)  # where energy is checked


@dataclass(frozen=True, kw_only=True)
class SecondLobe:
    """Microfacets beside a surface's first ones, such as a haze about a gloss.

    Parameters
    ----------
    share : float
        Share of the surface that they cover; the first ones cover the rest.
    mirror_reflectance, alpha_along, alpha_across : float
        As in `Surface`.
    """

    share: float
    mirror_reflectance: float
    alpha_along: float
    alpha_across: float


@dataclass(frozen=True, kw_only=True)
class ClearCoat:
    """A clear layer that reflects at its top and lets the rest through to the surface below.

    Parameters
    ----------
    alpha : float
        GGX roughness of its top.
    refractive_index : float
        1.5, F₀ = 0.04, is what glTF's KHR_materials_clearcoat takes for every lacquer.
    """

    alpha: float
    refractive_index: float = 1.5


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
        GGX roughness along and across the brushing direction.
    grain_contrast : float
        c: the reflectance varies between (1 − c) and (1 + c) times its mean.
    normal_noise_rad : float, rad
        Root mean square of the tilt that the grain gives the surface's normal, about each axis.
    grain_stretch : float
        How much longer than wide the grain is, along the brushing direction.
    grain_size_mm : float, mm
        Width of the finest grain that is resolved; anything finer is in α. By default 2.5 pixels
        of the structured-light sensor on its far plane, so that every view resolves the same.
    brushed_along : (float, float, float)
        Brushing direction in the part's frame, of any length; it is projected onto the surface.
    second_lobe : SecondLobe, optional
        More microfacets.
    coat : ClearCoat, optional
        What lies over all this. The grain tilts it and leaves its reflectance as it is.

    Raises
    ------
    InputError
        If it would reflect more light than it receives, or a number makes no sense.
    """

    diffuse_albedo: float
    mirror_reflectance: float
    alpha_along: float
    alpha_across: float
    grain_contrast: float = 0.0
    normal_noise_rad: float = 0.0
    grain_stretch: float = 1.0
    grain_size_mm: float = 0.8
    brushed_along: tuple[float, float, float] = (1.0, 0.0, 0.0)
    second_lobe: SecondLobe | None = None
    coat: ClearCoat | None = None

    def __post_init__(self) -> None:
        lobes = self._lobes
        coat = self.coat or ClearCoat(alpha=1.0)
        shares = [
            self.diffuse_albedo,
            self.grain_contrast,
            *(x for s, f, *_ in lobes for x in (s, f)),
        ]
        alphas = [coat.alpha, *(alpha for lobe in lobes for alpha in lobe[2:])]
        if not (
            all(0 <= share <= 1 for share in shares)
            and all(0 < alpha <= 1 for alpha in alphas)
            and 1 <= coat.refractive_index <= 4
            and 0 <= self.normal_noise_rad < 0.2
            and 1 <= self.grain_stretch < math.inf
            and 0.01 <= self.grain_size_mm < math.inf
            and 0 < math.hypot(*self.brushed_along) < math.inf
        ):
            msg = (
                "a surface needs shares from 0 to 1, GGX roughness above 0 and up to 1, normal "
                "noise below 0.2 rad, a grain stretch of 1 or more and size of 0.01 mm or more, a "
                "brushing direction other than 0, and a coat's refractive index from 1 to 4, got "
                f"{self}"
            )
            raise InputError(msg)
        even = all(along == across for _, _, along, across in lobes)
        for polar, azimuth in ((p, a) for p in _POLAR_DEG for a in ((0,) if even else (0, 45, 90))):
            albedo = self.albedo(polar, azimuth)
            if albedo > 1 + 1e-6:
                msg = (
                    "a surface must not reflect more than comes in, got "
                    f"{100 * albedo:.4g} % at {polar:g}° off the normal from {self}; lower "
                    "diffuse_albedo or mirror_reflectance, or give it its gloss by a coat, which "
                    "shades what is below"
                )
                raise InputError(msg)

    @property
    def _lobes(self) -> list[tuple[float, float, float, float]]:
        """Share, F₀ and roughness along and across of the microfacets."""
        first = (self.mirror_reflectance, self.alpha_along, self.alpha_across)
        second = self.second_lobe
        if second is None:
            return [(1.0, *first)]
        more = (second.mirror_reflectance, second.alpha_along, second.alpha_across)
        return [(1.0 - second.share, *first), (second.share, *more)]

    def albedo(self, polar_deg: float, azimuth_deg: float = 0.0) -> float:
        """Return the share of a beam that is reflected in any direction, without grain.

        A mean over the normals that the beam meets (Heitz, *Sampling the GGX distribution of
        visible normals*, JCGT 2018), good to 0.01.

        Parameters
        ----------
        polar_deg, azimuth_deg : float, degrees
            Where the beam comes from: angle off the normal, and from the brushing direction.
        """
        t, a = math.radians(polar_deg), math.radians(azimuth_deg)
        beam = np.array([math.sin(t) * math.cos(a), math.sin(t) * math.sin(a), math.cos(t)])
        index = 1.0 if self.coat is None else self.coat.refractive_index

        def passed(cosine: NDArray[np.float64]) -> NDArray[np.float64]:
            return 1.0 - _dielectric(cosine, index)

        below = self.diffuse_albedo * passed(np.sqrt((np.arange(64) + 0.5) / 64)).mean()
        for share, f0, along, across in self._lobes:
            out, cosine, weight = _mirrored(beam, along, across)
            schlick = f0 + (1.0 - f0) * (1.0 - cosine) ** 5
            below += share * (weight * schlick * passed(out)).mean()
        albedo = passed(beam[2:])[0] * below
        if self.coat is not None:
            _, cosine, weight = _mirrored(beam, self.coat.alpha, self.coat.alpha)
            albedo += (weight * _dielectric(cosine, index)).mean()
        return float(albedo)


def _dielectric(cosine: NDArray[np.float64], index: float) -> NDArray[np.float64]:
    """Return the reflectance of unpolarised light by Fresnel's equations."""
    inside = np.sqrt(index**2 - 1.0 + cosine**2)
    s = (cosine - inside) / (cosine + inside)
    p = (index**2 * cosine - inside) / (index**2 * cosine + inside)
    return np.asarray((s**2 + p**2) / 2.0)


def _mirrored(
    beam: NDArray[np.float64], along: float, across: float
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Return where GGX facets send a beam, evenly over those that it meets.

    The cosine off the surface's normal, that off the facet's, and the share not masked.
    """
    u = (np.arange(16) + 0.5) / 16
    radius, angle = np.meshgrid(np.sqrt(u), 2.0 * np.pi * u)
    x, y = (radius * np.cos(angle)).ravel(), (radius * np.sin(angle)).ravel()
    ax = np.array([along, across, 1.0])
    stretched = ax * beam / np.linalg.norm(ax * beam)
    level = math.hypot(stretched[0], stretched[1])
    first = np.array([-stretched[1], stretched[0], 0.0]) / level if level else np.eye(3)[0]
    s = 0.5 * (1.0 + stretched[2])
    y = (1.0 - s) * np.sqrt(1.0 - x**2) + s * y
    z = np.sqrt(np.maximum(1.0 - x**2 - y**2, 0.0))
    facet = np.outer(x, first) + np.outer(y, np.cross(stretched, first)) + np.outer(z, stretched)
    facet *= ax
    facet /= np.linalg.norm(facet, axis=1, keepdims=True)
    cosine = facet @ beam
    out = 2.0 * cosine[:, None] * facet - beam
    lit = out[:, 2] > 1e-9
    out[~lit] = 0.0, 0.0, 1.0

    def hidden(v: NDArray[np.float64]) -> NDArray[np.float64]:
        slope = ((v[..., :2] * ax[:2]) ** 2).sum(axis=-1) / v[..., 2] ** 2
        return np.asarray((np.sqrt(1.0 + slope) - 1.0) / 2.0)

    at_beam = hidden(beam)
    return out[:, 2], cosine, np.where(lit, (1.0 + at_beam) / (1.0 + at_beam + hidden(out)), 0.0)


SURFACES: Mapping[str, Surface] = MappingProxyType(
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
"""The finishes that every scene knows by name, the only place with these numbers."""


def surface_table(surfaces: Mapping[str, Surface] = SURFACES) -> NDArray[np.float64]:
    """Pack surfaces into a table for compiled loops, a row each, in their order.

    Its columns are named in `exposight.twin.part.reflectance`.
    """
    return np.array([_packed(surface) for surface in surfaces.values()])


def _packed(surface: Surface) -> list[float]:
    first, second = (*surface._lobes, (0.0, 0.0, 1.0, 1.0))[:2]
    along = np.array(surface.brushed_along) / math.hypot(*surface.brushed_along)
    spare = np.eye(3)[1 if abs(along[1]) < 0.9 else 2]
    across = spare - (spare @ along) * along
    across /= np.linalg.norm(across)
    index, coat_alpha = 1.0, 1.0
    if surface.coat is not None:
        index, coat_alpha = surface.coat.refractive_index, surface.coat.alpha
    top = ((index - 1.0) / (index + 1.0)) ** 2
    below = surface.diffuse_albedo + surface.mirror_reflectance
    if second[0]:
        below = surface.diffuse_albedo + first[0] * first[1] + second[0] * second[1]
    return [
        surface.diffuse_albedo,
        *first[1:],
        *second,
        index,
        coat_alpha,
        below * (1.0 - top) ** 2,
        top,
        surface.grain_contrast,
        surface.normal_noise_rad,
        surface.grain_stretch * surface.grain_size_mm,
        surface.grain_size_mm,
        *along,
        *across,
        *np.cross(along, across),
    ]
