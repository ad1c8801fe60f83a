"""An active stereo sensor: random dots seen by two cameras, matched like recorded images.

The images go through `exposight.imaging`'s rectification and semi-global matching; a pixel has no
point where either image is clipped or shows too little texture.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from exposight.cell import ActiveSensor, Capture
from exposight.errors import SensorError
from exposight.geometry import RigidTransform
from exposight.imaging.rectification import RectifiedPair, rectify
from exposight.imaging.stacks import window_images
from exposight.imaging.stereo import StereoLimits, match_pair
from exposight.twin.light import LightModel, SceneTracer, projector_of, trace_view
from exposight.twin.random_numbers import stream_key
from exposight.twin.sensors.exposure import CameraElectronics, expose, frame_files, spread_by_lens
from exposight.twin.sensors.patterns import DotPattern, render_dots, slide_radiance
from exposight.twin.sensors.settings import DOT_CAMERA, DOT_PROJECTOR

_NOISE = 0x444F5453  # the purpose of a stream of random numbers


@dataclass(frozen=True, kw_only=True, eq=False)
class DotLight:
    """The light of a view under the dots, in both cameras, ready for exposures.

    Parameters
    ----------
    camera_from_part : RigidTransform
        Where the part stands, seen from the first camera.
    radiance : (ndarray, ndarray), each (rows, columns) of float32, 1/mm²
        Behind the lens of the first and the second camera.
    """

    camera_from_part: RigidTransform
    radiance: tuple[NDArray[np.float32], NDArray[np.float32]]


@dataclass(frozen=True, kw_only=True, eq=False)
class DotSensor:
    """An active stereo sensor with its light, electronics and matching.

    Views are traced and matched as whole frames: semi-global matching weighs whole rows.

    Parameters
    ----------
    sensor : ActiveSensor
        With two cameras, the left one first, and a projector.
    light : LightModel
        Lenses and lighting.
    electronics : CameraElectronics
        Of the first camera; the second has a fixed pattern of its own and is else alike.
    depth_limits_mm : (float, float), mm, optional
        Depths that are matched; the sensor's working distance by default.
    dots : DotPattern
        The slide.
    matching : StereoLimits
        When a match counts.

    Raises
    ------
    SensorError
        If there are not two cameras of 8 bits, the first of them to the left, or there is no
        projector.
    """

    sensor: ActiveSensor
    light: LightModel = field(default_factory=lambda: LightModel(projector=DOT_PROJECTOR))
    electronics: CameraElectronics = DOT_CAMERA
    depth_limits_mm: tuple[float, float] | None = None
    dots: DotPattern = field(default_factory=DotPattern)
    matching: StereoLimits = field(default_factory=StereoLimits)

    def __post_init__(self) -> None:
        if len(self.sensor.cameras) != 2:
            msg = (
                f"sensor {self.sensor.name!r}: active stereo needs two cameras, got "
                f"{len(self.sensor.cameras)}"
            )
            raise SensorError(msg)
        if self.electronics.bit_depth != 8:
            msg = (
                f"sensor {self.sensor.name!r}: matching takes images of 8 bits, its cameras have "
                f"{self.electronics.bit_depth}"
            )
            raise SensorError(msg)
        projector_of(self.sensor)
        self.pair  # noqa: B018  raises where the cameras are no stereo pair

    @cached_property
    def pair(self) -> RectifiedPair:
        """The two cameras, rectified."""
        first, second = self.sensor.cameras
        return rectify(first, second, self.sensor.first_from_camera[1])

    @property
    def matched_mm(self) -> tuple[float, float]:
        """Nearest and farthest depth that are matched, mm."""
        return self.depth_limits_mm or self.sensor.working_distance_mm

    @property
    def mean_light(self) -> float:
        """Share of the projector's light that the slide passes."""
        return float(self._slide[0].mean()) / np.iinfo(np.uint16).max

    @cached_property
    def _slide(self) -> NDArray[np.uint16]:
        projector = projector_of(self.sensor)
        contrast = self.light.projector.contrast
        return render_dots(projector.width, projector.height, contrast, self.dots)

    def look(self, tracer: SceneTracer, camera_from_part: RigidTransform) -> DotLight:
        """Trace a view once, for all its exposures.

        Parameters
        ----------
        tracer : SceneTracer
            The scene.
        camera_from_part : RigidTransform
            Where the part stands, seen from the first camera.

        Raises
        ------
        InputError
            If one of the cameras sees nothing of the scene.
        """
        radiance = []
        for i in range(2):
            view = trace_view(
                tracer, self.sensor, camera_from_part, model=self.light, camera_index=i
            )
            (tile,) = view.tiles  # a whole frame
            plane = slide_radiance(tile, self._slide)[None]
            radiance.append(np.asarray(spread_by_lens(plane, tile, view.model.camera.spread_px)[0]))
        return DotLight(camera_from_part=camera_from_part, radiance=(radiance[0], radiance[1]))

    def images(
        self, light: DotLight, exposure_ms: float, seed: Sequence[int]
    ) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
        """Take both cameras' images at one exposure time.

        Parameters
        ----------
        light : DotLight
            The view's light.
        exposure_ms, seed
            As for `StripeSensor.frames`.

        Returns
        -------
        (ndarray, ndarray), each (rows, columns) of uint8

        Raises
        ------
        SensorError
            If the sensor cannot take this exposure time.
        """
        self.sensor.check_exposure(exposure_ms)
        pattern = self.electronics.pattern_seed
        even = np.zeros((1, 2), dtype=np.int64), np.zeros((1, 2), dtype=np.float32)
        grey: list[NDArray[np.uint8]] = []
        for i, plane in enumerate(light.radiance):
            camera = replace(self.electronics, pattern_seed=pattern + i)
            key = stream_key(*seed, _NOISE, i)
            planes = (plane, plane[None], plane[None])
            frames = expose(planes, even, exposure_ms, camera, noise_key=key)
            grey.append(np.asarray(frames[0], dtype=np.uint8))
        return grey[0], grey[1]

    def capture(
        self,
        light: DotLight,
        exposure_ms: float,
        *,
        view: str,
        seed: Sequence[int],
        raw_frames: bool = False,
    ) -> Capture:
        """Take both images at one exposure time and match them.

        Parameters
        ----------
        light : DotLight
            The view's light.
        exposure_ms, view, seed, raw_frames
            As for `StripeSensor.capture`.

        Returns
        -------
        Capture
            With the first camera's image (Sect. 4.2.1 of the paper), what the matching window
            shows of it round each pixel (`exposight.imaging.window_images`), and a cloud organised
            like it.

        Raises
        ------
        SensorError
            If the sensor cannot take this exposure time.
        """
        images = self.images(light, exposure_ms, seed)
        cloud = match_pair(
            *images, self.pair, depth_limits_mm=self.matched_mm, limits=self.matching
        )
        return Capture(
            view=view,
            exposure_ms=exposure_ms,
            image=images[0],
            brightness_source="dots",
            stack=window_images(images[0], self.matching),
            cloud=cloud,
            camera_from_part=light.camera_from_part,
            attachments=frame_files(images if raw_frames else ()),
        )
