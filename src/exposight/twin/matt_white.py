"""How bright matt white is before a simulated sensor; and flat plates to stand there."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from exposight.cell import GREY_MAX, ActiveSensor, Feature, Part, full_scale
from exposight.errors import SensorError
from exposight.geometry import PinholeCamera, PixelBox, RigidTransform
from exposight.twin import sensors
from exposight.twin.light import SceneTracer
from exposight.twin.part import Scene, Surface

_MATT = Surface(diffuse_albedo=0.9, mirror_reflectance=0.0, alpha_along=1.0, alpha_across=1.0)
_CLIPPED_SHARE = 0.01
_MEAN_OF_FRINGES = 0.5
BOX_PX = 64
"""Side of the squares of pixels that are judged."""


@dataclass(frozen=True, kw_only=True)
class MattWhiteBrightness:
    """Brightness of matt white at the TCP, facing the camera, in the patterns' light alone.

    Parameters
    ----------
    grey_levels_per_ms : float, grey levels 0–255 per ms
        Above the black level; NaN where the shortest exposure time clips it.
    expected_per_ms : float, grey levels 0–255 per ms
        What sensitivity, lenses and poses stand for, on paper.
    clips_at_ms : float, ms
        Exposure time from which 1 % of its pixels are clipped in some image; NaN where the longest
        one is too short, the shortest one where that is too long.
    """

    grey_levels_per_ms: float
    expected_per_ms: float
    clips_at_ms: float


def measure_matt_white(
    model: sensors.StripeSensor | sensors.DotSensor, settings: sensors.SensorSettings
) -> MattWhiteBrightness:
    """Measure the brightness of matt white at the TCP, facing the camera.

    Parameters
    ----------
    model : StripeSensor or DotSensor
        The sensor.
    settings : SensorSettings
        What it was made of.

    Raises
    ------
    SensorError
        If the TCP is not in the camera's image, or lit from behind.
    """
    camera, exposure = model.electronics, model.sensor.exposure
    passed = model.mean_light if isinstance(model, sensors.DotSensor) else _MEAN_OF_FRINGES
    radiance = sensors.matt_white_radiance(model.sensor, settings, passed)
    electrons_per_ms = camera.electrons_per_ms * radiance + camera.dark_current_e_per_s / 1000
    white = _WhitePlate(model)
    quarter_full_ms = camera.full_well_e / 4 / electrons_per_ms
    exposure_ms = float(np.clip(quarter_full_ms, exposure.min_ms, exposure.max_ms))
    mean, clipped = white.image(exposure_ms)
    per_ms = (mean - camera.black) / exposure_ms if clipped < _CLIPPED_SHARE else math.nan
    shown = GREY_MAX / full_scale(camera.bit_depth)
    return MattWhiteBrightness(
        grey_levels_per_ms=per_ms * shown,
        expected_per_ms=electrons_per_ms * camera.gain * shown,
        clips_at_ms=white.clips_at_ms(),
    )


class _WhitePlate:
    """A plate of albedo 1 at the TCP, facing the camera, in the patterns' light alone."""

    def __init__(self, model: sensors.StripeSensor | sensors.DotSensor) -> None:
        # No surface may reflect all light and have gloss; what it lacks the camera gains.
        brighter = model.electronics.electrons_per_ms / _MATT.diffuse_albedo
        self._model = replace(
            model,
            electronics=replace(model.electronics, electrons_per_ms=brighter),
            light=replace(model.light, lighting=0.0),
        )
        sensor, tcp = model.sensor, model.sensor.camera_from_tcp
        ((u, v),) = sensor.camera.project(tcp.translation_mm[None])
        if not bool(sensor.camera.in_frame([(u, v)])[0]):
            msg = (
                f"sensor {sensor.name!r}: its TCP is not in its camera's image; check "
                "camera_from_tcp"
            )
            raise SensorError(msg)
        self._box = box_about(sensor.camera, round(v), round(u))
        tracer = SceneTracer(flat_plate(sensor, _MATT))
        self._light: Any
        if isinstance(self._model, sensors.DotSensor):
            self._light = self._model.look(tracer, tcp)
        else:
            self._light = self._model.look(tracer, tcp, [self._box])

    def image(self, exposure_ms: float) -> tuple[float, float]:
        """Return the mean of the image, in DN, and the share of pixels clipped in some frame."""
        model, seed = self._model, (3, round(1000 * exposure_ms))
        if isinstance(model, sensors.DotSensor):
            frames = cut_out(model.images(self._light, exposure_ms, seed)[0], self._box)[None]
            shown = [0]
        else:
            (stack,) = model.frames(self._light, exposure_ms, seed)
            frames, shown = stack.frames, list(model.sequence.finest_frames)
        top = full_scale(model.electronics.bit_depth)
        return float(frames[shown].mean()), float((frames == top).any(axis=0).mean())

    def clips_at_ms(self) -> float:
        """Return the shortest exposure time at which 1 % of the pixels are clipped, within 1 %."""
        exposure = self._model.sensor.exposure
        low, high = exposure.min_ms, exposure.max_ms
        if self.image(low)[1] >= _CLIPPED_SHARE:
            return low
        if self.image(high)[1] < _CLIPPED_SHARE:
            return math.nan
        while high > 1.01 * low:
            middle = math.sqrt(low * high)
            if self.image(middle)[1] < _CLIPPED_SHARE:
                low = middle
            else:
                high = middle
        return high


def flat_plate(sensor: ActiveSensor, surface: Surface) -> Scene:
    """Return a plate in the plane z = 0, larger than what a sensor sees of its far plane.

    Parameters
    ----------
    sensor : ActiveSensor
        Its first camera's field and its working distance count.
    surface : Surface
        How the plate reflects.
    """
    reach = 1.0 + float(np.nanmax(np.abs(sensor.camera.rays())))
    corners = np.array([[-1, -1, 0], [-1, 1, 0], [1, 1, 0], [1, -1, 0]])
    centre = Feature(
        name="centre", kind="surface_point", part_from_feature=RigidTransform(), radius_mm=1.0
    )
    return Scene(
        vertices=1.5 * reach * sensor.working_distance_mm[1] * corners,
        faces=np.array([[0, 1, 2], [0, 2, 3]], dtype=np.int32),
        face_finish=np.zeros(2, dtype=np.uint8),
        part=Part(name="plate", features=(centre,)),
        surfaces={"plate": surface},
    )


def box_about(camera: PinholeCamera, row: int, column: int) -> PixelBox:
    """Return a square about a pixel, cut at the frame's border.

    Parameters
    ----------
    camera : PinholeCamera
        Whose frame it is.
    row, column : int, px
        The middle.
    """
    half = BOX_PX // 2
    return PixelBox(
        top=max(row - half, 0),
        bottom=min(row + half, camera.height),
        left=max(column - half, 0),
        right=min(column + half, camera.width),
    )


def cut_out(image: NDArray[Any], box: PixelBox) -> NDArray[Any]:
    """Return a box of an image's pixels."""
    return image[box.top : box.bottom, box.left : box.right]
