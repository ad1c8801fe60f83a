"""A structured-light sensor: frames that are decoded and triangulated like recorded ones.

Frames go through `exposight.imaging`, the code that decodes recordings; a pixel has no point where
a sample clipped, where the stripes modulate it by too little, or where coarse and fine phases
disagree.

The capture's image, in which brightness is averaged, is the mean of the finest pattern's images.
The paper averages brightness in a stripe pattern and does not say which; Table 9's largest
brightness at p_norm ≥ 0.75, 125 to 133, is that of their mean (in one image of 64 periods it would
be 155 to 162).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, cast

import numpy as np

from exposight.cell import (
    GREY_MAX,
    ActiveSensor,
    Capture,
    Cloud,
    Image,
    Part,
    StackImages,
    full_scale,
)
from exposight.errors import ImageError, SensorError
from exposight.geometry import PixelBox, ProjectorCamera, RigidTransform
from exposight.imaging import (
    DecodedMap,
    DecodingLimits,
    FrameStack,
    GreyNoise,
    PatternSequence,
    decode,
    sequence_to_toml,
    stack_images,
    triangulate,
    why_no_sigma,
    with_sigma_z,
)
from exposight.observing import Visibility, view_features
from exposight.twin.light import (
    LightModel,
    SceneTracer,
    projector_of,
    trace_view,
)
from exposight.twin.random_numbers import stream_key
from exposight.twin.sensors.exposure import CameraElectronics, expose, frame_files
from exposight.twin.sensors.patterns import (
    STRIPES,
    Patterns,
    projected,
)
from exposight.twin.sensors.settings import STRIPE_LIMITS, BrightnessImage
from exposight.twin.sensors.stripe_light import StripeLight, stripe_light

_NOISE = 0x4E4F495345  # the purpose of a stream of random numbers


@dataclass(frozen=True, kw_only=True)
class StripeSensor:
    """A structured-light sensor with its light, electronics and decoding.

    Parameters
    ----------
    sensor : ActiveSensor
        With a projector as wide and high as the sequence's.
    light : LightModel
        Lenses and lighting.
    electronics : CameraElectronics
        Of the first camera.
    sequence : PatternSequence, optional
        What is projected; `STRIPES` over the projector's columns by default.
    image : {'mean', 'first'}
        A capture's image: the mean of `PatternSequence.finest_frames`, or the first of them.
    limits : DecodingLimits
        When a pixel counts as decoded.
    max_depth_noise_mm : float, mm, optional
        Points of which more is predicted are dropped; None keeps them.

    Raises
    ------
    SensorError
        If there is no projector, or it is not of the sequence's size, or the depth noise of a
        sequence is limited of which none follows.
    ImageError
        If camera and sequence have different bit depths.
    """

    sensor: ActiveSensor
    light: LightModel = field(default_factory=LightModel)
    electronics: CameraElectronics = field(default_factory=CameraElectronics)
    sequence: PatternSequence = STRIPES
    image: BrightnessImage = "mean"
    limits: DecodingLimits = STRIPE_LIMITS
    max_depth_noise_mm: float | None = None

    def __post_init__(self) -> None:
        projector, sequence = projector_of(self.sensor), self.sequence
        expected = (sequence.projector_width, sequence.projector_height)
        if (projector.width, projector.height) != expected:
            msg = (
                f"sensor {self.sensor.name!r}: its projector has {projector.width} × "
                f"{projector.height} px, the stripes {expected[0]} × {expected[1]}; use stripes of "
                "the projector's size"
            )
            raise SensorError(msg)
        if sequence.bit_depth != self.electronics.bit_depth:
            msg = (
                f"sensor {self.sensor.name!r}: its camera has {self.electronics.bit_depth} bits, "
                f"sequence {sequence.name!r} {sequence.bit_depth}; say the same in both"
            )
            raise ImageError(msg)
        if (
            sequence.response() is not None
            or sequence.projector_gamma != 1.0
            or sequence.saturation_level is not None
        ):
            msg = (
                f"sensor {self.sensor.name!r}: its camera and projector are linear up to full "
                f"scale; leave the response, gamma and saturation level out of sequence "
                f"{sequence.name!r}"
            )
            raise SensorError(msg)
        if self.max_depth_noise_mm is not None and why_no_sigma(sequence):
            msg = (
                f"sensor {self.sensor.name!r}: depth noise is predicted from fringes, sequence "
                f"{sequence.name!r} has an axis without; leave out max_depth_noise_mm"
            )
            raise SensorError(msg)
        self.patterns  # noqa: B018  raises where they cannot be shown

    @cached_property
    def patterns(self) -> Patterns:
        """What the projector shows."""
        return projected(self.sequence, self.light.projector.contrast)

    @property
    def needs_whole_frames(self) -> bool:
        """True where decoding a pixel takes more than its neighbourhood: runs of a Gray code."""
        return any(coding.gray_code is not None for _, coding, _ in self.sequence.axes())

    def meaning_of_frames(self) -> dict[str, bytes]:
        """Return what the frames mean, as files that ``exposight decode`` reads, by name."""
        header = (
            "# The clouds were decoded with at least "
            f"{self.limits.min_modulation:g} grey levels of modulation and at most "
            f"{self.limits.max_residual:g}\n# periods between coarse and fine phases.\n"
        )
        text = header + sequence_to_toml(replace(self.sequence, file_pattern="frame-*.png"))
        projector = projector_of(self.sensor)
        rig = ProjectorCamera(
            camera=self.sensor.camera,
            projector=projector.camera,
            projector_from_camera=projector.camera_from_projector.inverse(),
        )
        return {"sequence.toml": text.encode(), "calibration.yml": rig.to_slstudio().encode()}

    def look(
        self,
        tracer: SceneTracer,
        camera_from_part: RigidTransform,
        boxes: Sequence[PixelBox] | None = None,
    ) -> StripeLight:
        """Trace a view once, for all its exposures.

        Parameters
        ----------
        tracer : SceneTracer
            The scene.
        camera_from_part : RigidTransform
            Where the part stands.
        boxes : sequence of PixelBox, optional
            Pixels to trace (`ring_boxes`); the whole frame by default.

        Raises
        ------
        InputError
            If the view sees nothing of the scene.
        """
        view = trace_view(tracer, self.sensor, camera_from_part, model=self.light, boxes=boxes)
        return stripe_light(view, self.patterns)

    def frames(
        self, light: StripeLight, exposure_ms: float, seed: Sequence[int]
    ) -> tuple[FrameStack, ...]:
        """Take all stripe images at one exposure time, one stack for every tile.

        Parameters
        ----------
        light : StripeLight
            The view's light.
        exposure_ms : float, ms
            In the sensor's range.
        seed : sequence of int
            Whole numbers from 0 that no other exposure shares, as (campaign's seed, view,
            exposure): the noise follows from them and the pixel, whatever else is computed.

        Raises
        ------
        SensorError
            If the sensor cannot take this exposure time.
        """
        self.sensor.check_exposure(exposure_ms)
        key = stream_key(*seed, _NOISE)
        camera, shown = self.sensor.camera, (self.patterns.planes, self.patterns.weights)
        stacks = []
        for tile in light.tiles:
            planes = (tile.even, tile.cosine, tile.sine)
            place = (tile.box.top, tile.box.left, camera.height, camera.width)
            grey = expose(planes, shown, exposure_ms, self.electronics, noise_key=key, place=place)
            depth = self.electronics.bit_depth
            stacks.append(FrameStack(frames=grey, bit_depth=depth, exposure_ms=exposure_ms))
        return tuple(stacks)

    def recording(self, light: StripeLight, exposure_ms: float, seed: Sequence[int]) -> FrameStack:
        """Take all stripe images at one exposure time in the camera's size.

        As `frames`, put together; 0 where only boxes were traced.
        """
        stacks = self.frames(light, exposure_ms, seed)
        whole = [
            self._whole_frame(light, [stack.frames[i] for stack in stacks])
            for i in range(self.sequence.n_frames)
        ]
        return FrameStack(
            frames=cast("Image", np.stack(whole)),
            bit_depth=self.electronics.bit_depth,
            exposure_ms=exposure_ms,
        )

    def capture(
        self,
        light: StripeLight,
        exposure_ms: float,
        *,
        view: str,
        seed: Sequence[int],
        raw_frames: bool = False,
    ) -> Capture:
        """Take all frames at one exposure time, decode them and triangulate.

        Parameters
        ----------
        light : StripeLight
            The view's light.
        exposure_ms : float, ms
            In the sensor's range.
        view : str
            The view's name.
        seed : sequence of int
            As for `frames`.
        raw_frames : bool
            Attach every frame.

        Returns
        -------
        Capture
            Of a whole frame with an organised cloud; where only boxes were traced, the image is 0
            outside them and the cloud is the plain list of their points, in the camera's frame.
            Points have their standard deviations as in `points`.
            Its stack images are those of `exposight.imaging.stack_images`.

        Raises
        ------
        SensorError
            If the sensor cannot take this exposure time.
        """
        stacks = self.frames(light, exposure_ms, seed)
        clouds, pieces = [], []
        for tile, stack in zip(light.tiles, stacks, strict=True):
            decoded = self.decode(stack)
            clouds.append(self.points(stack, decoded, tile.box))
            pieces.append(stack_images(stack, self.sequence, decoded, self.limits))
        cloud = clouds[0] if light.is_whole else _listed(clouds)
        whole = {
            name: self._whole_frame(light, [piece.images()[name] for piece in pieces])
            for name in ("mean", "maximum", "modulation")
        }
        image = mean = whole.pop("mean")
        is_mean = self.image == "mean"
        if not is_mean:
            first = self.sequence.finest_frames[0]
            image = self._whole_frame(light, [stack.frames[first] for stack in stacks])
        frames = range(self.sequence.n_frames) if raw_frames else ()
        return Capture(
            view=view,
            exposure_ms=exposure_ms,
            image=image,
            brightness_source="stripes-mean" if is_mean else "stripe",
            stack=StackImages(
                mean=None if is_mean else mean,
                maximum=whole["maximum"],
                modulation=whole["modulation"],
                min_modulation=self.limits.min_modulation,
            ),
            bit_depth=self.electronics.bit_depth,
            cloud=cloud,
            camera_from_part=light.camera_from_part,
            notes="" if light.is_whole else "only the neighbourhoods of the rings were taken",
            attachments=frame_files(
                self._whole_frame(light, [stack.frames[i] for stack in stacks]) for i in frames
            ),
        )

    def decode(self, stack: FrameStack) -> DecodedMap:
        """Decode frames as `frames` took them."""
        return decode(stack, self.sequence, self.limits, checked=False)

    def points(self, stack: FrameStack, decoded: DecodedMap, box: PixelBox) -> Cloud:
        """Triangulate a rectangle of pixels.

        Where the sequence has fringes, each point has its standard deviation, of the camera's noise
        at its own brightness (`exposight.imaging.with_sigma_z`).

        Parameters
        ----------
        stack : FrameStack
            Its frames.
        decoded : DecodedMap
            What came of them (`decode`).
        box : PixelBox
            The pixels.

        Returns
        -------
        Cloud
            Organised like the rectangle, without points beyond ``max_depth_noise_mm``.
        """
        projector = projector_of(self.sensor)
        poses: dict[str, Any] = {
            "projector": projector.camera,
            "projector_from_camera": projector.camera_from_projector.inverse(),
        }
        cloud = triangulate(decoded, camera=self.sensor.camera, window=box, **poses)
        if self.max_depth_noise_mm is not None:
            grey_noise = self._grey_per_electron * self.half_full_noise_e
            noise = GreyNoise(dark=grey_noise**2)
            sigma = with_sigma_z(cloud, stack, self.sequence, noise, **poses).sigma_z_mm
            noisy = np.asarray(sigma, dtype=np.float64)[..., None] > self.max_depth_noise_mm
            cloud = Cloud(points=np.where(noisy, np.float32(np.nan), cloud.points))
        if why_no_sigma(self.sequence):
            return cloud
        return with_sigma_z(cloud, stack, self.sequence, self.grey_noise, **poses)

    @property
    def _grey_per_electron(self) -> float:
        """Grey levels 0–255 per electron."""
        camera = self.electronics
        return camera.gain * GREY_MAX / full_scale(camera.bit_depth)

    @property
    def grey_noise(self) -> GreyNoise:
        """The camera's noise as its electronics say: read-out, rounding and photons."""
        camera, per_electron = self.electronics, self._grey_per_electron
        read = GreyNoise.given(per_electron * camera.read_noise_e, camera.bit_depth)
        dark = read.dark - per_electron * camera.black_level
        return GreyNoise(dark=dark, gain=per_electron)

    @property
    def half_full_noise_e(self) -> float:
        """Noise of a half full pixel: a filter knows its camera's noise, not each sample's."""
        return math.sqrt(self.electronics.read_noise_e**2 + self.electronics.full_well_e / 2)

    def _whole_frame(self, light: StripeLight, pieces: Sequence[Image]) -> Image:
        """Put the tiles' images together in the camera's size; 0 where no tile is.

        What comes back is read-only: a capture keeps it without a copy.
        """
        if light.is_whole:
            pieces[0].setflags(write=False)
            return pieces[0]
        size = (self.sensor.camera.height, self.sensor.camera.width)
        image: Image = np.zeros(
            size, dtype=np.uint8 if self.electronics.bit_depth == 8 else np.uint16
        )
        for tile, piece in zip(light.tiles, pieces, strict=True):
            box = tile.box
            image[box.top : box.bottom, box.left : box.right] = piece
        image.setflags(write=False)
        return image


def _listed(clouds: Sequence[Cloud]) -> Cloud:
    """Return the valid points of clouds as one list."""
    points = [np.empty((0, 3), dtype=np.float32), *(each.valid_points for each in clouds)]
    cloud = Cloud(points=np.concatenate(points))
    sigma = [each.sigma_z_mm[each.valid] for each in clouds if each.sigma_z_mm is not None]
    return cloud.with_sigma(np.concatenate(sigma)) if sigma else cloud


def ring_boxes(
    part: Part,
    sensor: ActiveSensor,
    camera_from_part: RigidTransform,
) -> list[PixelBox]:
    """Return boxes of pixels outside which nothing adds to any visible feature's observation.

    Parameters
    ----------
    part : Part
        Whose features are looked for.
    sensor : ActiveSensor
        Its first camera looks.
    camera_from_part : RigidTransform
        Where the part will be said to stand.
    """
    views = view_features(part, sensor, camera_from_part)
    return [view.search_box for view in views if view.visibility is Visibility.VISIBLE]
