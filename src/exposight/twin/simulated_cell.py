"""The simulated cell at work: a measuring plan becomes a campaign, or a table of observations.

Views are independent: each is traced once and then exposed at all its times, several views at the
same time in processes of their own. What one view gives depends on the plan and the view's name
alone, so the result is the same for any number of workers and any interruption.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass, replace
from functools import lru_cache, partial
from pathlib import Path
from typing import TYPE_CHECKING

from exposight.cell import (
    CampaignFolder,
    CampaignWriter,
    Capture,
    CaptureKey,
    sensor_preset,
    write_numbered_capture,
)
from exposight.errors import ExposightError, InputError
from exposight.observing import (
    Observation,
    ObservationTable,
    observe_capture,
    point_search,
    view_features,
)
from exposight.twin.active_stereo import DOT_LIGHT, DotSensor
from exposight.twin.door import door
from exposight.twin.light import LightModel
from exposight.twin.planned_views import PlannedView, views
from exposight.twin.scene_files import read_scene
from exposight.twin.simulation_record import keep_record
from exposight.twin.structured_light import StripeSensor, ring_boxes
from exposight.twin.tracing import SceneTracer
from exposight.twin.workers import run_tasks

if TYPE_CHECKING:
    from exposight.twin.optics import Lighting
    from exposight.twin.plan import MeasuringPlan
    from exposight.twin.scene import Scene

__all__ = ["CellSettings", "scene_at", "simulate", "simulate_observations"]

Progress = Callable[[int, int], None]


@dataclass(frozen=True, kw_only=True)
class CellSettings:
    """How a plan is carried out; none of it changes what is measured, but `rings_only` the files.

    Parameters
    ----------
    rings_only : bool
        Trace and decode only the neighbourhoods of the features' rings: p_norm and i_avg are the
        same as from whole frames, images are black and clouds empty elsewhere. Not for stereo
        sensors, whose matching weighs whole rows.
    workers : int
        Processes that work at the same time; 1 stays in this one.
    scene : Path or None
        Folder of an exported scene (`exposight.twin.scene_files`); None for the door.

    Raises
    ------
    InputError
        If there is no worker.
    """

    rings_only: bool = False
    workers: int = 1
    scene: Path | None = None

    def __post_init__(self) -> None:
        if self.workers < 1:
            msg = f"a simulation needs at least 1 worker, got {self.workers}"
            raise InputError(msg)


@dataclass(frozen=True, kw_only=True)
class _ViewTask:
    """One view of a plan, all that a worker process has to know."""

    plan: MeasuringPlan
    view: PlannedView
    exposures_ms: tuple[float, ...]
    settings: CellSettings


def simulate(
    plan: MeasuringPlan,
    folder: str | Path,
    settings: CellSettings | None = None,
    progress: Progress | None = None,
) -> CampaignFolder:
    """Carry out a measuring plan and write its campaign; go on where an earlier run stopped.

    Parameters
    ----------
    plan : MeasuringPlan
        From where and for how long to measure.
    folder : path
        The campaign's folder, as in ``docs/formats.md``. Captures that are there are kept, those
        that are missing are taken: the result is the same as of one uninterrupted run.
    settings : CellSettings, optional
        Workers, whole frames or rings only, scene.
    progress : callable, optional
        Called with (captures there, captures in all).

    Returns
    -------
    CampaignFolder

    Raises
    ------
    InputError
        If the plan cannot be carried out, or the folder holds another plan's captures.
    FileError
        If the disk is full or refuses. What was captured stays valid.
    NumericalError
        If a worker process died. What was captured stays valid.
    """
    settings = settings or CellSettings()
    folder = Path(folder)
    _check_rings(plan, settings)
    scene, sensor = scene_at(settings.scene), sensor_preset(plan.sensor)
    planned = views(plan, scene.part, sensor)
    numbers = _numbers(planned)
    with CampaignWriter.open_or_create(
        folder, name=plan.name, sensor=sensor, part=plan.observed_part(scene.part)
    ) as writer:
        keep_record(
            folder,
            plan=plan,
            scene=scene,
            rings_only=settings.rings_only,
            n_captures=len(writer.keys),
        )
        there = _captures_there(writer, numbers, folder)
        tasks = _tasks(plan, planned, settings, there)
        done = len(there)
        _tell(progress, done, len(numbers))
        work = partial(_write_view, folder, numbers)
        # Closed before the writer is, whatever happens: no worker may outlive the lock.
        with closing(run_tasks(work, tasks, settings.workers)) as results:
            for task, _ in results:
                done += len(task.exposures_ms)
                _tell(progress, done, len(numbers))
    return CampaignFolder(folder)


def simulate_observations(
    plan: MeasuringPlan,
    settings: CellSettings | None = None,
    progress: Progress | None = None,
) -> ObservationTable:
    """Carry out a measuring plan and observe every capture at once, without writing any.

    Parameters
    ----------
    plan : MeasuringPlan
        From where and for how long to measure.
    settings : CellSettings, optional
        Workers, whole frames or rings only, scene.
    progress : callable, optional
        Called with (captures done, captures in all).

    Returns
    -------
    ObservationTable
        As `observe_campaign` makes it of the campaign that `simulate` would write.

    Raises
    ------
    InputError
        If the plan cannot be carried out.
    NumericalError
        If a worker process died.
    """
    settings = settings or CellSettings()
    _check_rings(plan, settings)
    planned = views(plan, scene_at(settings.scene).part, sensor_preset(plan.sensor))
    tasks = _tasks(plan, planned, settings, there=frozenset())
    rows: dict[str, list[Observation]] = {}
    total, done = sum(len(task.exposures_ms) for task in tasks), 0
    _tell(progress, done, total)
    with closing(run_tasks(_observe_view, tasks, settings.workers)) as results:
        for task, observed in results:
            rows[task.view.name] = observed
            done += len(task.exposures_ms)
            _tell(progress, done, total)
    ordered = [row for view in planned for row in rows[view.name]]
    return ObservationTable.from_observations(ordered)


def scene_at(folder: Path | None) -> Scene:
    """Return the scene in a folder, or the door; read once.

    Raises
    ------
    FileError, InputError
        As for `read_scene`.
    """
    return _scene(None if folder is None else Path(folder).resolve())


def _check_rings(plan: MeasuringPlan, settings: CellSettings) -> None:
    if settings.rings_only and _is_stereo(plan.sensor):
        msg = (
            f"plan {plan.name!r}: sensor {plan.sensor!r} matches whole images, so it cannot take "
            "rings only; take whole frames"
        )
        raise InputError(msg)


def _tell(progress: Progress | None, done: int, total: int) -> None:
    if progress is not None:
        progress(done, total)


def _numbers(planned: tuple[PlannedView, ...]) -> dict[CaptureKey, int]:
    """Return the number of every capture of a plan, whoever takes it and when."""
    keys = [CaptureKey(view.name, t) for view in planned for t in view.exposures_ms]
    return {key: number for number, key in enumerate(keys)}


def _captures_there(
    writer: CampaignWriter, numbers: dict[CaptureKey, int], folder: Path
) -> frozenset[CaptureKey]:
    """Return the plan's captures that an earlier run took."""
    there = writer.numbered_keys
    for number, key in there.items():
        if numbers.get(key) != number:
            msg = (
                f"the campaign in {folder} holds view {key.view!r} at {key.exposure_ms:g} ms as "
                f"capture {number}, which this plan does not: it was taken by another plan; "
                "choose another folder"
            )
            raise InputError(msg)
    return frozenset(there.values())


def _tasks(
    plan: MeasuringPlan,
    planned: tuple[PlannedView, ...],
    settings: CellSettings,
    there: frozenset[CaptureKey],
) -> list[_ViewTask]:
    tasks = []
    for view in planned:
        missing = tuple(t for t in view.exposures_ms if (view.name, t) not in there)
        if missing:
            tasks.append(_ViewTask(plan=plan, view=view, exposures_ms=missing, settings=settings))
    return tasks


def _write_view(folder: Path, numbers: dict[CaptureKey, int], task: _ViewTask) -> int:
    sensor = sensor_preset(task.plan.sensor)
    with _naming(task):
        for capture in _captures(task):
            capture.check_fits(sensor)
            write_numbered_capture(folder, numbers[capture.key], capture)
    return len(task.exposures_ms)


def _observe_view(task: _ViewTask) -> list[Observation]:
    sensor = sensor_preset(task.plan.sensor)
    part = task.plan.observed_part(scene_at(task.settings.scene).part)
    rows = []
    with _naming(task):
        seen = view_features(part, sensor, task.view.reported_camera_from_part)
        for capture in _captures(task):
            search = point_search(capture.cloud, sensor.camera)
            rows.extend(observe_capture(capture, seen, search))
    return rows


@contextmanager
def _naming(task: _ViewTask) -> Iterator[None]:
    """Name plan and view in the messages of errors."""
    try:
        yield
    except ExposightError as error:
        msg = f"plan {task.plan.name!r}, view {task.view.name!r}: {error}"
        raise type(error)(msg) from error


def _captures(task: _ViewTask) -> Iterator[Capture]:
    """Take a view's captures, one after the other."""
    view = task.view
    take = _look(task.plan, view, task.settings)
    for exposure_ms in task.exposures_ms:
        seed = (*view.seed, round(1000 * exposure_ms))
        taken = take(exposure_ms, view=view.name, seed=seed)
        notes = "; ".join(filter(None, (view.notes, taken.notes)))
        yield replace(taken, camera_from_part=view.reported_camera_from_part, notes=notes)


def _look(plan: MeasuringPlan, view: PlannedView, settings: CellSettings) -> Callable[..., Capture]:
    """Trace a view; what is returned takes it at an exposure time (``StripeSensor.capture``)."""
    tracer = _tracer(settings.scene)
    simulated = _simulated_sensor(plan.sensor, plan.lighting)
    if isinstance(simulated, DotSensor):
        dots = simulated.look(tracer, view.true_camera_from_part)
        return partial(simulated.capture, dots)
    boxes = None
    if settings.rings_only:
        part = plan.observed_part(scene_at(settings.scene).part)
        boxes = ring_boxes(part, simulated.sensor, view.reported_camera_from_part)
    stripes = simulated.look(tracer, view.true_camera_from_part, boxes)
    return partial(simulated.capture, stripes)


@lru_cache(maxsize=2)
def _scene(folder: Path | None) -> Scene:
    return door() if folder is None else read_scene(folder)


@lru_cache(maxsize=2)
def _tracer(folder: Path | None) -> SceneTracer:
    return SceneTracer(scene_at(folder))


def _is_stereo(preset: str) -> bool:
    return len(sensor_preset(preset).cameras) > 1


@lru_cache(maxsize=4)
def _simulated_sensor(preset: str, lighting: Lighting) -> StripeSensor | DotSensor:
    sensor = sensor_preset(preset)
    if _is_stereo(preset):
        return DotSensor(sensor=sensor, light=replace(DOT_LIGHT, lighting=lighting))
    return StripeSensor(sensor=sensor, light=LightModel(lighting=lighting))
