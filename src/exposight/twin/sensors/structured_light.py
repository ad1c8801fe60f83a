"""The structured-light sensor: stripe images, decoded and triangulated like recorded ones.

Frames go through `exposight.imaging`, the code that decodes recordings; a pixel has no point where
a sample clipped, where the stripes modulate it by less than 18 grey levels, or where coarse and
fine phases disagree.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from exposight.cell import PAPER_TOLERANCE, ActiveSensor, Capture, Cloud
from exposight.errors import ImageError, SensorError
from exposight.geometry import PixelBox
from exposight.imaging import (
    DecodingLimits,
    FrameStack,
    Fringe,
    PatternSequence,
    PhaseShift,
    decode,
    triangulate,
)
from exposight.observing import Visibility, view_features
from exposight.twin.light import LightModel, ViewLight, trace_view
from exposight.twin.random_numbers import stream_key
from exposight.twin.sensors.exposure import CameraElectronics
from exposight.twin.sensors.stripes import StripeLight, expose_stripes, stripe_light

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from exposight.cell import Part, Projector, RingTolerance
    from exposight.geometry import RigidTransform
    from exposight.twin.light import SceneTracer


STRIPES = PatternSequence(
    name="1, 8 and 64 stripes, four steps each",
    projector_width=1920,
    projector_height=1200,
    columns=PhaseShift(
        fringes=(
            Fringe(periods=1, frames=(0, 1, 2, 3)),
            Fringe(periods=8, frames=(4, 5, 6, 7)),
            Fringe(periods=64, frames=(8, 9, 10, 11)),
        )
    ),
)
"""Stripes of the twin's first prototype, over the 1920 columns of the paper's sensor's preset."""

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
    sequence : PatternSequence
        Phase-shifted fringes of the projector's columns, and nothing else. The capture's image is
        the first frame of the finest fringe: many stripes cross every ring, as in the pattern that
        the paper's sensor shows while one sets the exposure (Sect. 3.2.1).
    limits : DecodingLimits
        When a pixel counts as decoded.

    Raises
    ------
    SensorError
        If there is no projector, or it is not of the sequence's size.
    ImageError
        If the sequence has anything else than fringes of the columns.
    """

    sensor: ActiveSensor
    light: LightModel = field(default_factory=LightModel)
    electronics: CameraElectronics = field(default_factory=CameraElectronics)
    sequence: PatternSequence = STRIPES
    limits: DecodingLimits = LIMITS

    def __post_init__(self) -> None:
        projector, sequence = self._projector, self.sequence
        expected = (sequence.projector_width, sequence.projector_height)
        if (projector.width, projector.height) != expected:
            msg = (
                f"sensor {self.sensor.name!r}: its projector has {projector.width} × "
                f"{projector.height} px, the stripes {expected[0]} × {expected[1]}; use stripes of "
                "the projector's size"
            )
            raise SensorError(msg)
        used = {frame for fringe in self._fringes for frame in fringe.frames}
        only_columns = sequence.rows is None and sequence.white_frame is None
        if not only_columns or len(used) != sequence.n_frames:
            msg = (
                f"the twin's stripes are fringes of the projector's columns only, got sequence "
                f"{sequence.name!r} with other frames"
            )
            raise ImageError(msg)

    @property
    def _projector(self) -> Projector:
        if self.sensor.projector is None:
            msg = f"sensor {self.sensor.name!r} has no projector; stripes need one"
            raise SensorError(msg)
        return self.sensor.projector

    @property
    def _fringes(self) -> tuple[Fringe, ...]:
        columns = self.sequence.columns
        if not isinstance(columns, PhaseShift) or columns.gray_code is not None:
            msg = f"the twin's stripes are phase-shifted fringes, got {self.sequence.name!r}"
            raise ImageError(msg)
        return columns.fringes

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
        return self.stripe_light(view)

    def stripe_light(self, view: ViewLight) -> StripeLight:
        """Return what a traced view's light becomes under the stripes and behind the lens."""
        waves = np.array([f.periods / self.sequence.projector_width for f in self._fringes])
        return stripe_light(view, waves)

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
        fringe = np.empty(self.sequence.n_frames, dtype=np.int64)
        shifts_deg = np.empty(self.sequence.n_frames)
        for i, steps in enumerate(self._fringes):
            fringe[list(steps.frames)] = i
            shifts_deg[list(steps.frames)] = steps.shifts_deg
        key = stream_key(*seed, _NOISE)
        images = expose_stripes(light, fringe, shifts_deg, self.electronics, exposure_ms, key)
        return tuple(FrameStack(frames=grey, exposure_ms=exposure_ms) for grey in images)

    def capture(
        self, light: StripeLight, exposure_ms: float, *, view: str, seed: Sequence[int]
    ) -> Capture:
        """Take the stripe images at one exposure time, decode them and triangulate.

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
        return self.decoded(light, stacks, exposure_ms, view=view)

    def decoded(
        self, light: StripeLight, stacks: Sequence[FrameStack], exposure_ms: float, *, view: str
    ) -> Capture:
        """Decode the stripe images of one exposure and triangulate: `capture` of given frames.

        Parameters
        ----------
        light : StripeLight
            The view's light.
        stacks : sequence of FrameStack
            As `frames` took them.
        exposure_ms : float, ms
            At which they were taken.
        view : str
            The view's name.
        """
        camera, projector = self.sensor.camera, self._projector
        clouds = []
        for tile, stack in zip(light.tiles, stacks, strict=True):
            box = tile.box
            cloud = triangulate(
                decode(stack, self.sequence, self.limits),
                camera=camera,
                projector=projector.camera,
                projector_from_camera=projector.camera_from_projector.inverse(),
                window=box,
            )
            clouds.append(cloud)
        if light.is_whole:
            cloud = clouds[0]
        else:
            points = [np.empty((0, 3), dtype=np.float32), *(c.valid_points for c in clouds)]
            cloud = Cloud(points=np.concatenate(points))
        return Capture(
            view=view,
            exposure_ms=exposure_ms,
            image=self.whole_frame(light, stacks, self._fringes[-1].frames[0]),
            cloud=cloud,
            camera_from_part=light.camera_from_part,
            notes="" if light.is_whole else "only the neighbourhoods of the rings were taken",
        )

    def whole_frame(
        self, light: StripeLight, stacks: Sequence[FrameStack], frame: int
    ) -> NDArray[np.uint8]:
        """Return one of the stripe images in the camera's size, 0 where no tile is.

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
