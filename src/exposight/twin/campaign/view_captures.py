"""One view of a plan, taken at its exposure times: the work of one process.

What a view gives depends on the plan and the view's name alone, whoever takes it and when.
"""

from __future__ import annotations

import socket
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import lru_cache, partial
from pathlib import Path
from typing import TYPE_CHECKING

from exposight.cell import Capture, sensor_preset, write_numbered_capture
from exposight.errors import ExposightError, InputError
from exposight.observing import (
    Observation,
    ObservationTable,
    observe_capture,
    point_search,
    view_features,
)
from exposight.twin.campaign.raw_frames import frame_files
from exposight.twin.campaign.record import check_record, scene_checksum
from exposight.twin.light import LightModel, SceneTracer
from exposight.twin.part import door, read_scene
from exposight.twin.sensors import DOT_LIGHT, DotSensor, StripeSensor, ring_boxes

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Sequence

    import numpy as np
    from numpy.typing import NDArray

    from exposight.cell import ActiveSensor, Part
    from exposight.plans import MeasuringPlan, PlannedView
    from exposight.twin.campaign.settings import CellSettings
    from exposight.twin.light import Lighting
    from exposight.twin.part import Scene
    from exposight.twin.sensors import DotLight, StripeLight


OBSERVATIONS_FILE = "observations.csv"
"""Rows of a capture that is kept without its cloud, and of its whole campaign."""


@dataclass(frozen=True, kw_only=True)
class ViewTask:
    """One view of a plan, all that a worker process has to know.

    Parameters
    ----------
    plan : MeasuringPlan
        The plan.
    view : PlannedView
        The view.
    captures : tuple of (int, float)
        Numbers in the campaign, and exposure times in ms, of the captures to take.
    settings : CellSettings
        What is taken and kept.
    scene_sha256 : str
        Checksum of the scene.
    """

    plan: MeasuringPlan
    view: PlannedView
    captures: tuple[tuple[int, float], ...]
    settings: CellSettings
    scene_sha256: str

    @property
    def observed_part(self) -> Part:
        """The part with the plan's features."""
        return self.plan.observed_part(scene_at(self.settings.scene).part)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Taken:
    """A capture, and the frames that its cloud was computed from, made when asked for."""

    capture: Capture
    frames: Iterable[NDArray[np.uint8]]


def write_view(folder: Path, record_sha256: str, task: ViewTask) -> None:
    """Take a view's captures and write each as soon as it is taken.

    Parameters
    ----------
    folder : Path
        The campaign's folder, whose writer another process holds.
    record_sha256 : str
        Checksum of the simulation's record in it.
    task : ViewTask
        What to take.

    Raises
    ------
    ExposightError
        What went wrong, naming plan, view and exposure.
    """
    with _naming(task):
        check_record(folder, record_sha256)  # before the work, for whom it would be in vain
        take = _look(task)
        observe = None if task.settings.clouds else _observer(task)
    for number, exposure_ms in task.captures:
        with _naming(task, exposure_ms):
            taken = take(exposure_ms)
            capture = taken.capture
            attachments = frame_files(taken.frames) if task.settings.raw_frames else {}
            if observe is not None:
                attachments[OBSERVATIONS_FILE] = observations_csv(observe(capture))
                capture = replace(capture, cloud=None)
            check_record(folder, record_sha256)  # by now the folder may be another simulation's
            write_numbered_capture(folder, number, replace(capture, attachments=attachments))


def observe_view(task: ViewTask) -> list[Observation]:
    """Take a view's captures and observe each, keeping none.

    Raises
    ------
    ExposightError
        What went wrong, naming plan, view and exposure.
    """
    with _naming(task):
        take, observe = _look(task), _observer(task)
    rows = []
    for _, exposure_ms in task.captures:
        with _naming(task, exposure_ms):
            rows += observe(take(exposure_ms).capture)
    return rows


def observations_csv(rows: Sequence[Observation]) -> bytes:
    """Return rows of an observation table as the content of a CSV file."""
    return ObservationTable.from_observations(rows).frame.write_csv().encode()


@contextmanager
def _naming(task: ViewTask, exposure_ms: float | None = None) -> Iterator[None]:
    """Name plan, view and exposure in the messages of errors."""
    try:
        yield
    except ExposightError as error:
        when = "" if exposure_ms is None else f" at {exposure_ms:g} ms"
        msg = f"plan {task.plan.name!r}, view {task.view.name!r}{when}: {error}"
        raise type(error)(msg) from error


def _look(task: ViewTask) -> Callable[[float], _Taken]:
    """Trace a view; what is returned takes it at an exposure time in ms."""
    _check_scene(task)
    plan, view = task.plan, task.view
    tracer = _tracer(task.settings.scene)
    simulated = _simulated_sensor(plan.sensor, plan.lighting)
    if isinstance(simulated, DotSensor):
        return partial(
            _take_dots, view, simulated, simulated.look(tracer, view.true_camera_from_part)
        )
    boxes = None
    if task.settings.rings_only:
        boxes = ring_boxes(task.observed_part, simulated.sensor, view.reported_camera_from_part)
    light = simulated.look(tracer, view.true_camera_from_part, boxes)
    return partial(_take_stripes, view, simulated, light)


def _take_dots(view: PlannedView, sensor: DotSensor, light: DotLight, exposure_ms: float) -> _Taken:
    images = sensor.images(light, exposure_ms, _seed(view, exposure_ms))
    capture = sensor.matched(light, images, exposure_ms, view=view.name)
    return _reported(view, sensor.sensor, capture, images)


def _take_stripes(
    view: PlannedView, sensor: StripeSensor, light: StripeLight, exposure_ms: float
) -> _Taken:
    stacks = sensor.frames(light, exposure_ms, _seed(view, exposure_ms))
    capture = sensor.decoded(light, stacks, exposure_ms, view=view.name)
    frames = (sensor.whole_frame(light, stacks, i) for i in range(sensor.sequence.n_frames))
    return _reported(view, sensor.sensor, capture, frames)


def _seed(view: PlannedView, exposure_ms: float) -> tuple[int, ...]:
    return (*view.seed, round(1000 * exposure_ms))


def _reported(
    view: PlannedView, sensor: ActiveSensor, capture: Capture, frames: Iterable[NDArray[np.uint8]]
) -> _Taken:
    """Say of a capture what is known of it: the pose that the alignment gave, and its notes."""
    capture = replace(
        capture,
        camera_from_part=view.reported_camera_from_part,
        notes="; ".join(filter(None, (view.notes, capture.notes))),
    )
    capture.check_fits(sensor)
    return _Taken(capture=capture, frames=frames)


def _observer(task: ViewTask) -> Callable[[Capture], list[Observation]]:
    """Make ready what all exposures of a view share; what is returned observes one of them."""
    sensor = sensor_preset(task.plan.sensor)
    seen = view_features(task.observed_part, sensor, task.view.reported_camera_from_part)

    def observe(capture: Capture) -> list[Observation]:
        search = point_search(capture.require_cloud(), sensor.camera)
        return observe_capture(capture, seen, search)

    return observe


def _check_scene(task: ViewTask) -> None:
    """Refuse to mix what different processes see."""
    if _scene_sha256(task.settings.scene) != task.scene_sha256:
        where = "the built-in door" if task.settings.scene is None else str(task.settings.scene)
        msg = (
            f"{where} is another scene on {socket.gethostname()}, where a worker is; give all "
            "workers the same scene and the same versions of Python's packages"
        )
        raise InputError(msg)


def scene_at(folder: Path | None) -> Scene:
    """Return the scene in a folder, or the door; read once.

    Raises
    ------
    FileError, InputError
        As for `read_scene`.
    """
    return _scene(None if folder is None else Path(folder).resolve())


def is_stereo(preset: str) -> bool:
    """Tell whether a sensor matches the images of two cameras."""
    return len(sensor_preset(preset).cameras) > 1


@lru_cache(maxsize=2)
def _scene(folder: Path | None) -> Scene:
    return door() if folder is None else read_scene(folder)


@lru_cache(maxsize=2)
def _scene_sha256(folder: Path | None) -> str:
    return scene_checksum(scene_at(folder))


@lru_cache(maxsize=2)
def _tracer(folder: Path | None) -> SceneTracer:
    return SceneTracer(scene_at(folder))


@lru_cache(maxsize=4)
def _simulated_sensor(preset: str, lighting: Lighting) -> StripeSensor | DotSensor:
    sensor = sensor_preset(preset)
    if is_stereo(preset):
        return DotSensor(sensor=sensor, light=replace(DOT_LIGHT, lighting=lighting))
    return StripeSensor(sensor=sensor, light=LightModel(lighting=lighting))
