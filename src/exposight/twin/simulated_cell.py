"""The simulated cell as a driver: a pose and an exposure time become a capture.

What a view gives depends on the cell's settings and seed, the view's pose and its name alone,
whatever else is captured, by whichever process.
"""

from __future__ import annotations

import hashlib
import logging
from collections.abc import Iterable, Mapping
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from exposight.cell import ActiveSensor, Capture, Image, Part
from exposight.errors import InputError, SensorError, did_you_mean
from exposight.geometry import RigidTransform
from exposight.imaging import FrameStack
from exposight.plans import MeasuringPlan, PlannedView, view_seed
from exposight.twin import sensors
from exposight.twin.cell_settings import Alignment, SimulatedCellSettings, draw_alignment
from exposight.twin.light import LightModel, SceneTracer
from exposight.twin.part import Finishes, Scene, door, read_scene

logger = logging.getLogger(__name__)

_ROUNDING = 1e-9
"""How far a planned pose may be from the one commanded, mm: it went from one frame to another."""


class SimulatedCell:
    """A measuring cell made of physics (`exposight.cell.Driver`).

    Parameters
    ----------
    sensor : ActiveSensor
        Any with a projector: one camera takes patterns and decodes them, two match dots.
    settings : SimulatedCellSettings, optional
        Light, alignment, patterns, scene, what is taken and attached.
    seed : int, 0 or more
        Noise and alignment errors follow from it and the views' names.
    features : sequence of str, optional
        Features of the part round which is traced with `rings_only`; all by default.
    planned : iterable of PlannedView
        Views whose groups, and poses in the TCP frame, are known exactly.

    Raises
    ------
    SensorError
        If the sensor has no projector, or more than two cameras.
    ImageError
        If the sensor cannot show the sequence.
    InputError
        If rings only are wanted of a sensor that needs whole frames.
    FileError
        If the scene cannot be read.
    """

    concurrent = True

    def __init__(
        self,
        sensor: ActiveSensor,
        settings: SimulatedCellSettings | None = None,
        *,
        seed: int = 0,
        features: Iterable[str] | None = None,
        planned: Iterable[PlannedView] = (),
    ) -> None:
        self.sensor = sensor
        self.settings = settings or SimulatedCellSettings()
        self.seed = seed
        self._features = None if features is None else tuple(features)
        self._planned = _by_name(planned)
        self._traced: tuple[object, object] | None = None
        model = self._model
        if self.settings.rings_only and (
            isinstance(model, sensors.DotSensor) or model.needs_whole_frames
        ):
            method = "matches" if isinstance(model, sensors.DotSensor) else "decodes Gray code in"
            msg = (
                f"sensor {sensor.name!r} {method} whole images, so it cannot take rings only; take "
                "whole frames"
            )
            raise InputError(msg)

    @classmethod
    def for_plan(
        cls, plan: MeasuringPlan, *, folder: Path | None = None, **changes: Any
    ) -> SimulatedCell:
        """Return the cell that a plan describes.

        Parameters
        ----------
        plan : MeasuringPlan
            Its sensor, seed, features, and the settings that it carries; its views are worked out.
        folder : Path, optional
            The plan's folder (`SimulatedCellSettings.of_plan`).
        **changes
            Settings by name, in place of those that the plan carries.

        Raises
        ------
        ExposightError
            As for `SimulatedCell`, `SimulatedCellSettings.of_plan` and `MeasuringPlan.views`.
        """
        settings = replace(SimulatedCellSettings.of_plan(plan, folder), **changes)
        cell = cls(plan.sensor, settings, seed=plan.seed, features=plan.features)
        cell._planned = _by_name(plan.views(cell.part))
        names = {group.name for group in plan.groups} | cell._planned.keys()
        for name in settings.kinematic_share.keys() - names:
            logger.warning(
                "simulated cell: kinematic_share names %r, which is neither a view nor a group of "
                "plan %r%s: it aligns nothing",
                name,
                plan.name,
                did_you_mean(name, names),
            )
        return cell

    @property
    def part(self) -> Part:
        """The part with all its features, which name the finish that they are on."""
        return _part(self.settings.scene, self.settings.finishes)

    @property
    def scene(self) -> Scene:
        """What light falls on."""
        return scene_at(self.settings.scene, self.settings.finishes)

    def description(self) -> dict[str, object]:
        """Return what decides the captures beyond sensor, part and plan, JSON-able."""
        settings = self.settings.table()
        settings.pop("scene", None)  # by its content, wherever it lies
        checksum = _scene_sha256(self.settings.scene, self.settings.finishes)
        return {"driver": "simulated cell", "scene_sha256": checksum, "seed": self.seed, **settings}

    def campaign_files(self) -> Mapping[str, bytes]:
        """Return what the raw frames of structured light mean, as files by name."""
        model = self._model
        if self.settings.raw_frames and isinstance(model, sensors.StripeSensor):
            return model.meaning_of_frames()
        return {}

    def alignment(self, view: str) -> Alignment:
        """Return how a view is aligned, and the error of the pose that is reported.

        Parameters
        ----------
        view : str
            The view's name.
        """
        shares = self.settings.kinematic_share
        group, _ = self._planned.get(view, (view, None))
        share = shares.get(view, shares.get(group, 0.0))
        return draw_alignment(self.settings.alignment, share, self.seed, view)

    def reported_pose(self, camera_from_part: RigidTransform, view: str) -> RigidTransform:
        """Return where the part is said to stand when it truly stands somewhere.

        Parameters
        ----------
        camera_from_part : RigidTransform
            Where it truly stands.
        view : str
            The view's name.
        """
        camera_from_tcp = self.sensor.camera_from_tcp
        _, tcp_from_part = self._planned.get(view, (view, None))
        if tcp_from_part is None or not _alike(camera_from_tcp @ tcp_from_part, camera_from_part):
            tcp_from_part = camera_from_tcp.inverse() @ camera_from_part
        return camera_from_tcp @ self.alignment(view).reported_from_true @ tcp_from_part

    def capture(
        self, exposure_ms: float, camera_from_part: RigidTransform, *, view: str
    ) -> Capture:
        """Take a capture; a view is traced once for all its exposure times.

        Parameters
        ----------
        exposure_ms : float, ms
            In the sensor's range.
        camera_from_part : RigidTransform
            Where the part truly stands. The capture records it with the alignment's error.
        view : str
            The view's name.

        Raises
        ------
        SensorError
            If the sensor cannot take this exposure time.
        InputError
            If the view sees nothing of the scene.
        """
        alignment = self.alignment(view)
        reported = self.reported_pose(camera_from_part, view)
        seed = self._noise_seed(view, exposure_ms)
        pose = (camera_from_part, reported)
        light: Any = self._light_of(*pose)
        capture = self._model.capture(
            light, exposure_ms, view=view, seed=seed, raw_frames=self.settings.raw_frames
        )
        return replace(
            capture,
            camera_from_part=reported,
            notes="; ".join(filter(None, (alignment.notes, capture.notes))),
        )

    def frames(
        self, exposure_ms: float, camera_from_part: RigidTransform, *, view: str
    ) -> FrameStack:
        """Take the frames from which `capture` computes its cloud, and nothing else.

        Parameters
        ----------
        exposure_ms, camera_from_part, view
            As for `capture`.

        Raises
        ------
        SensorError
            If the sensor takes no patterns, or not this exposure time.
        InputError
            If the view sees nothing of the scene.
        """
        model = self._model
        if isinstance(model, sensors.DotSensor):
            msg = (
                f"sensor {self.sensor.name!r} has two cameras and takes no patterns; frames are "
                "those of a sensor with one camera"
            )
            raise SensorError(msg)
        light: Any = self._light_of(camera_from_part, self.reported_pose(camera_from_part, view))
        return model.recording(light, exposure_ms, self._noise_seed(view, exposure_ms))

    def stereo_images(
        self, exposure_ms: float, camera_from_part: RigidTransform, *, view: str
    ) -> tuple[Image, Image]:
        """Take the two images from which `capture` computes its cloud, and nothing else.

        Parameters
        ----------
        exposure_ms, camera_from_part, view
            As for `capture`.

        Raises
        ------
        SensorError
            If the sensor has not two cameras, or cannot take this exposure time.
        InputError
            If the view sees nothing of the scene.
        """
        model = self._model
        if not isinstance(model, sensors.DotSensor):
            msg = f"sensor {self.sensor.name!r} has one camera; a pair of images takes two"
            raise SensorError(msg)
        light: Any = self._light_of(camera_from_part, self.reported_pose(camera_from_part, view))
        return model.images(light, exposure_ms, self._noise_seed(view, exposure_ms))

    def _noise_seed(self, view: str, exposure_ms: float) -> tuple[int, ...]:
        return (*view_seed(self.seed, view), round(1000 * exposure_ms))

    def _light_of(self, true: RigidTransform, reported: RigidTransform) -> object:
        """Return a view's light, traced once for all its exposures."""
        pose = (true, reported)
        if self._traced is None or self._traced[0] != pose:
            self._traced = None  # lets go of its memory
            self._traced = (pose, self._look(*pose))
        return self._traced[1]

    def _look(self, true: RigidTransform, reported: RigidTransform) -> object:
        """Trace a view."""
        model = self._model
        tracer = _tracer(self.settings.scene, self.settings.finishes)
        if isinstance(model, sensors.DotSensor):
            return model.look(tracer, true)
        boxes = None
        if self.settings.rings_only:
            part = self.part
            if self._features is not None:
                part = replace(part, features=tuple(map(part.feature, self._features)))
            boxes = sensors.ring_boxes(part, self.sensor, reported)
        return model.look(tracer, true, boxes)

    @property
    def _model(self) -> sensors.StripeSensor | sensors.DotSensor:
        return sensor_model(self.sensor, self.settings)

    def __getstate__(self) -> dict[str, object]:
        return {**self.__dict__, "_traced": None}  # other processes trace for themselves


def _by_name(planned: Iterable[PlannedView]) -> dict[str, tuple[str, RigidTransform]]:
    return {view.name: (view.group, view.tcp_from_part) for view in planned}


def scene_at(folder: Path | None, finishes: Finishes | None = None) -> Scene:
    """Return the scene at a path, or the door; read once.

    Parameters
    ----------
    folder : Path or None
        As for `exposight.twin.part.read_scene`; None for the door.
    finishes : Finishes, optional
        In place of its own.

    Raises
    ------
    FileError, InputError
        As for `read_scene`.
    """
    return _scene(None if folder is None else folder.resolve(), finishes or Finishes())


@lru_cache(maxsize=2)
def _scene(folder: Path | None, finishes: Finishes) -> Scene:
    if finishes != Finishes():
        return _scene(folder, Finishes()).with_finishes(finishes)
    return door() if folder is None else read_scene(folder)


@lru_cache(maxsize=2)
def _part(folder: Path | None, finishes: Finishes) -> Part:
    return scene_at(folder, finishes).part_with_finishes()


@lru_cache(maxsize=2)
def _scene_sha256(folder: Path | None, finishes: Finishes) -> str:
    return scene_checksum(scene_at(folder, finishes))


@lru_cache(maxsize=2)
def _tracer(folder: Path | None, finishes: Finishes) -> SceneTracer:
    return SceneTracer(scene_at(folder, finishes))


def scene_checksum(scene: Scene) -> str:
    """Return the SHA-256 of a scene's triangles and of what they are made of."""
    decisive = (dict(scene.surfaces), scene.zones, scene.crease_deg)
    checksum = hashlib.sha256(repr(decisive).encode())
    for array in (scene.vertices, scene.faces, scene.face_finish):
        checksum.update(str(array.shape).encode())
        checksum.update(array.tobytes())
    return checksum.hexdigest()


@lru_cache(maxsize=4)
def sensor_model(
    sensor: ActiveSensor, cell: SimulatedCellSettings
) -> sensors.StripeSensor | sensors.DotSensor:
    """Return a sensor with the light, the cameras and the decoding of its kind.

    Parameters
    ----------
    sensor : ActiveSensor
        With a projector.
    cell : SimulatedCellSettings
        Lighting, and what is otherwise than in the sensor's document.

    Raises
    ------
    SensorError, ImageError, FormatError
        If the sensor cannot be simulated.
    """
    settings = sensors.sensor_settings(sensor, cell.sensor)
    light = LightModel(
        projector=settings.projector,
        camera=settings.lens,
        lighting=cell.lighting,
        lamp=cell.lamp or 1.0,
    )
    if len(sensor.cameras) > 1:
        dots = sensors.DotSensor(
            sensor=sensor,
            light=light,
            dots=settings.dots,
            matching=settings.matching,
            depth_limits_mm=settings.depth_limits_mm,
        )
        passed = dots.mean_light
        return replace(dots, electronics=sensors.electrons_on_matt_white(sensor, settings, passed))
    return sensors.StripeSensor(
        sensor=sensor,
        light=light,
        electronics=sensors.electrons_on_matt_white(sensor, settings, 0.5),
        sequence=sensors.sequence_of(sensor, settings),
        image=settings.image,
        limits=settings.limits,
        max_depth_noise_mm=settings.max_depth_noise_mm,
    )


def _alike(one: RigidTransform, other: RigidTransform) -> bool:
    return np.allclose(one.to_matrix(), other.to_matrix(), rtol=0.0, atol=_ROUNDING)
