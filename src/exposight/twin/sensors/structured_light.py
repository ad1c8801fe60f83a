"""A structured-light sensor: frames that are decoded and triangulated like recorded ones.

Frames go through `exposight.imaging`, the code that decodes recordings; a pixel has no point where
a sample clipped, where the stripes modulate it by less than 18 grey levels, or where coarse and
fine phases disagree.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from exposight.cell import PAPER_TOLERANCE, ActiveSensor, Capture, Cloud
from exposight.errors import SensorError
from exposight.geometry import PixelBox
from exposight.imaging import (
    DecodingLimits,
    FrameStack,
    PatternSequence,
    decode,
    triangulate,
)
from exposight.observing import Visibility, view_features
from exposight.twin.light import LightModel, trace_view
from exposight.twin.random_numbers import stream_key
from exposight.twin.sensors.exposure import CameraElectronics
from exposight.twin.sensors.patterns import (
    STRIPES,
    Patterns,
    image_frame,
    projected,
    projector_of,
)
from exposight.twin.sensors.raw_frames import frame_files
from exposight.twin.sensors.stripes import StripeLight, expose_stripes, stripe_light

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from exposight.cell import Part, RingTolerance
    from exposight.geometry import RigidTransform
    from exposight.twin.light import SceneTracer


LIMITS = DecodingLimits(min_modulation=18.0, max_residual=0.2)
"""At 18 grey levels p_norm rises up to a brightness of 25, as in the paper's Fig. 10; at 8 it would
have risen between 5 and 15."""

_NOISE = 0x4E4F495345  # the purpose of a stream of random numbers


@dataclass(frozen=True, kw_only=True)
class StripeSensor:
    """A structured-light sensor with its light, electronics and decoding.

    Parameters
    ----------
    sensor : ActiveSensor
        With a projector as wide and high as the sequence's.
    light : LightModel
        Lenses, lighting, surfaces.
    electronics : CameraElectronics
        Of the first camera.
    sequence : PatternSequence, optional
        What is projected; `STRIPES` over the projector's columns by default.
    limits : DecodingLimits
        When a pixel counts as decoded.

    Raises
    ------
    SensorError
        If there is no projector, or it is not of the sequence's size, or there are more cameras.
    ImageError
        If the sequence is not of 8 bits.
    """

    sensor: ActiveSensor
    light: LightModel = field(default_factory=LightModel)
    electronics: CameraElectronics = field(default_factory=CameraElectronics)
    sequence: PatternSequence = STRIPES
    limits: DecodingLimits = LIMITS

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
        self.patterns  # noqa: B018  raises where they cannot be shown

    @cached_property
    def patterns(self) -> Patterns:
        """What the projector shows."""
        return projected(self.sequence, self.light.projector.contrast)

    @property
    def needs_whole_frames(self) -> bool:
        """True where decoding a pixel takes more than its neighbourhood: runs of a Gray code."""
        return any(coding.gray_code is not None for _, coding, _ in self.sequence.axes())

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
        images = expose_stripes(light, self.patterns, self.electronics, exposure_ms, key)
        return tuple(FrameStack(frames=grey, exposure_ms=exposure_ms) for grey in images)

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

        Raises
        ------
        SensorError
            If the sensor cannot take this exposure time.
        """
        stacks = self.frames(light, exposure_ms, seed)
        projector = projector_of(self.sensor)
        clouds = []
        for tile, stack in zip(light.tiles, stacks, strict=True):
            cloud = triangulate(
                decode(stack, self.sequence, self.limits),
                camera=self.sensor.camera,
                projector=projector.camera,
                projector_from_camera=projector.camera_from_projector.inverse(),
                window=tile.box,
            )
            clouds.append(cloud)
        if light.is_whole:
            cloud = clouds[0]
        else:
            points = [np.empty((0, 3), dtype=np.float32), *(c.valid_points for c in clouds)]
            cloud = Cloud(points=np.concatenate(points))
        frames = range(self.sequence.n_frames) if raw_frames else ()
        return Capture(
            view=view,
            exposure_ms=exposure_ms,
            image=self.whole_frame(light, stacks, image_frame(self.sequence)),
            cloud=cloud,
            camera_from_part=light.camera_from_part,
            notes="" if light.is_whole else "only the neighbourhoods of the rings were taken",
            attachments=frame_files(self.whole_frame(light, stacks, i) for i in frames),
        )

    def whole_frame(
        self, light: StripeLight, stacks: Sequence[FrameStack], frame: int
    ) -> NDArray[np.uint8]:
        """Return one of the frames in the camera's size, 0 where no tile is.

        Parameters
        ----------
        light : StripeLight
            The view's light.
        stacks : sequence of FrameStack
            As `frames` took them.
        frame : int
            Which one, from 0.
        """
        image = np.zeros((self.sensor.camera.height, self.sensor.camera.width), dtype=np.uint8)
        for tile, stack in zip(light.tiles, stacks, strict=True):
            box = tile.box
            image[box.top : box.bottom, box.left : box.right] = stack.frames[frame]
        return image


def ring_boxes(
    part: Part,
    sensor: ActiveSensor,
    camera_from_part: RigidTransform,
    tolerance: RingTolerance = PAPER_TOLERANCE,
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
    tolerance : RingTolerance
        Height and radii of the hollow cylinders.
    """
    views = view_features(part, sensor, camera_from_part, tolerance)
    return [view.search_box for view in views if view.visibility is Visibility.VISIBLE]
