"""Surfaces that no formula of the software describes: the simulated cell, lit again.

A finish of the simulated cell is microfacets after GGX, a diffuse part and a coat. Whether a model
of brightness depends on that can only be seen on surfaces of other families. Here the door is
traced as if it scattered light evenly, and the projector's light at each pixel is then multiplied
by the ratio of another reflectance to that. Shadows, grain, the bounce (of an even scatterer with
the same albedo), lenses, noise and decoding are the cell's: with bare sheet's own formula rings
come out as bright as the cell's bare sheet's to 0.5 %, and p_norm to 0.004. All numbers were chosen
before any model was evaluated on these surfaces.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from functools import lru_cache, partial
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray
from scipy.special import erf

from exposight.cell import Capture
from exposight.files import sha256_of
from exposight.geometry import RigidTransform
from exposight.plans import MeasuringPlan
from exposight.twin import Scene, SimulatedCell
from exposight.twin.light import LightModel, SceneTracer, TileLight, lamp_of, trace_view
from exposight.twin.light.shading import light_along_rays
from exposight.twin.part import SURFACES, Surface
from exposight.twin.sensors import StripeSensor, ring_boxes
from exposight.twin.sensors.stripe_light import stripe_light

Vectors = NDArray[np.float64]
"""Unit vectors, (n, 3)."""


@lru_cache(maxsize=1)
def _tracer(scene: Scene) -> SceneTracer:
    return SceneTracer(scene)


class RelitCell(SimulatedCell):
    """A simulated cell with structured light whose part has a reflectance of another kind.

    Subclasses say `surface_name`, `albedo` and `reflectance`.
    """

    surface_name: ClassVar[str] = ""
    albedo: ClassVar[float] = 1.0
    """Share of light that the surface gives back, at about the sensor's angles: of the bounce."""

    @classmethod
    def for_plan(cls, plan: MeasuringPlan, **changes: Any) -> SimulatedCell:
        """Return the cell for a plan (`SimulatedCell.for_plan`), its part of one even finish."""
        bare = SURFACES["bare"]
        even = Surface(
            diffuse_albedo=cls.albedo,
            mirror_reflectance=0.0,
            alpha_along=1.0,
            alpha_across=1.0,
            grain_contrast=bare.grain_contrast,
            normal_noise_rad=bare.normal_noise_rad,
        )
        name = cls.surface_name
        return super().for_plan(plan, finish=name, surfaces={name: even}, **changes)

    @staticmethod
    def reflectance(normal: Vectors, to_light: Vectors, to_eye: Vectors) -> NDArray[np.float64]:
        """Return f_r in 1/sr, (n,), for unit vectors in the part's frame."""
        raise NotImplementedError

    def description(self) -> dict[str, object]:
        """Return what decides the captures (`SimulatedCell.description`), this file included."""
        return {**super().description(), "relit": sha256_of(Path(__file__).read_bytes())}

    def _look(self, true: RigidTransform, reported: RigidTransform) -> Callable[..., Capture]:
        model = self._model
        if not isinstance(model, StripeSensor):
            msg = f"sensor {self.sensor.name!r} matches dots; only stripes can be lit again"
            raise TypeError(msg)
        part = self.part
        if self._features is not None:
            part = replace(part, features=tuple(map(part.feature, self._features)))
        boxes = ring_boxes(part, self.sensor, reported) if self.settings.rings_only else None
        tracer = _tracer(self.scene)
        view = trace_view(tracer, self.sensor, true, model=model.light, boxes=boxes)
        tiles = tuple(self._lit_again(tile, tracer, true, model.light) for tile in view.tiles)
        return partial(model.capture, stripe_light(replace(view, tiles=tiles), model.patterns))

    def _lit_again(
        self,
        tile: TileLight,
        tracer: SceneTracer,
        camera_from_part: RigidTransform,
        light: LightModel,
    ) -> TileLight:
        box, part_from_camera = tile.traced, camera_from_part.inverse()
        slopes = self.sensor.camera.rays()[box.top : box.bottom, box.left : box.right]
        slopes = slopes.reshape(-1, 2)
        directions = np.column_stack([slopes, np.ones(len(slopes))]) @ part_from_camera.rotation.T
        origins = np.tile(part_from_camera.translation_mm, (len(directions), 1))
        lamp = lamp_of(self.sensor, camera_from_part, light.projector)
        hits = light_along_rays(
            tracer,
            lamp,
            np.ascontiguousarray(origins, dtype=np.float32),
            np.ascontiguousarray(directions, dtype=np.float32),
        )
        lit = np.flatnonzero(hits.radiance)
        to_light = lamp.centre_mm - hits.position_mm[lit].astype(np.float64)
        factor = np.ones(len(directions))
        factor[lit] = (math.pi / self.albedo) * self.reflectance(
            hits.normal[lit].astype(np.float64), _unit(to_light), _unit(-directions[lit])
        )
        relit = tile.direct * factor.reshape(tile.direct.shape)
        return replace(tile, direct=relit.astype(np.float32))


class TwoLobesCell(RelitCell):
    """Half of the surface has Beckmann facets, half a narrow GGX lobe tilted by 4°.

    Reflectances as bare sheet's. A rough ground with smoother, tilted ridges, as on rolled sheet.
    """

    surface_name = "two-lobes"
    albedo = 0.64

    @staticmethod
    def reflectance(normal: Vectors, to_light: Vectors, to_eye: Vectors) -> NDArray[np.float64]:
        """Return f_r of bare sheet's diffuse part and of the two lobes with its F₀."""
        half = _unit(to_light + to_eye)
        tilt = np.array([math.tan(_TILT_RAD), 0.0, 0.0])
        ridges = _unit(normal + tilt - _dots(normal, tilt[None])[:, None] * normal)
        cosines = _dots(normal, to_light), _dots(normal, to_eye)
        slope = 1.0 / _dots(normal, half) ** 2 - 1.0
        beckmann = np.exp(-slope / _SLOPE**2) / (math.pi * _SLOPE**2) * (1.0 + slope) ** 2
        narrow = _ggx(_dots(ridges, half), _NARROW)
        f_0 = SURFACES["bare"].mirror_reflectance
        fresnel = f_0 + (1.0 - f_0) * (1.0 - _dots(half, to_eye)) ** 5
        hidden = sum(map(_beckmann_hidden, cosines))
        facets = 0.5 * (beckmann + narrow) / (1.0 + hidden)
        mirrored = facets * fresnel / (4.0 * cosines[0] * cosines[1])
        return np.asarray(SURFACES["bare"].diffuse_albedo / math.pi + mirrored)


_SLOPE, _NARROW, _TILT_RAD = 0.35, 0.12, math.radians(4.0)


class ScatterCell(RelitCell):
    """No facets at all: scattering by a smooth surface's spectrum, and retroreflection.

    The lobe is the K-correlation or ABC model of optics (E. L. Church, P. Z. Takacs, T. A. Leonard,
    "The prediction of BRDFs from surface profile measurements", Proc. SPIE 1165, 1989): a function
    of how far the eye is off the mirror's direction in direction cosines, |l_t + e_t|, not of the
    half vector. The other lobe sends light back to where it comes from, as beads in paint do, and
    depends on the angle between light and eye alone.
    """

    surface_name = "scatter"
    albedo = 0.36

    @staticmethod
    def reflectance(normal: Vectors, to_light: Vectors, to_eye: Vectors) -> NDArray[np.float64]:
        """Return f_r of an even part, the ABC lobe and the retroreflection."""
        both = to_light + to_eye
        aside = both - _dots(normal, both)[:, None] * normal
        lobe = _PEAK * (1.0 + _SHARPNESS * _dots(aside, aside)) ** -_FALL
        phase_angle = np.arccos(np.clip(_dots(to_light, to_eye), -1.0, 1.0))
        back = _BACK * np.exp(-((phase_angle / _BACK_RAD) ** 2))
        return np.asarray(_EVEN / math.pi + lobe + back)


_EVEN = 0.05
_PEAK, _SHARPNESS, _FALL = 1.5, 60.0, 1.1  # 1/sr; the peak is twice bare sheet's
_BACK, _BACK_RAD = 0.15, math.radians(20.0)


def _ggx(cosine: NDArray[np.float64], alpha: float) -> NDArray[np.float64]:
    square = 1.0 + (alpha**2 - 1.0) * cosine**2
    return np.asarray(alpha**2 / (math.pi * square**2) * (cosine > 0))


def _beckmann_hidden(cosine: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return Λ of Smith's masking for the rough half; the other is taken to hide as much."""
    a = cosine / (_SLOPE * np.sqrt(np.maximum(1.0 - cosine**2, 1e-12)))
    return np.asarray((erf(a) - 1.0) / 2.0 + np.exp(-(a**2)) / (2.0 * a * math.sqrt(math.pi)))


def _dots(a: Vectors, b: Vectors) -> NDArray[np.float64]:
    return np.asarray((a * b).sum(axis=1))


def _unit(a: Vectors) -> Vectors:
    return np.asarray(a / np.linalg.norm(a, axis=1, keepdims=True))
