"""The simulated cell at work: a measuring plan becomes a campaign, or a table of observations.

Views are independent: each is traced once and then exposed at all its times, several views at the
same time in processes of their own. What one view gives depends on the plan and the view's name
alone, so the result is the same for any number of workers, here or on a cluster, and any
interruption.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import ExitStack, closing
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import polars as pl

from exposight.cell import CampaignFolder, CampaignWriter, CaptureKey, sensor_preset
from exposight.errors import InputError
from exposight.files.durable import write_durably
from exposight.observing import ObservationTable
from exposight.plans import PlannedView, views
from exposight.twin.campaign.raw_frames import keep_meaning
from exposight.twin.campaign.record import keep_record, scene_checksum
from exposight.twin.campaign.settings import CellSettings
from exposight.twin.campaign.view_captures import (
    OBSERVATIONS_FILE,
    ViewTask,
    is_stereo,
    observe_view,
    scene_at,
    write_view,
)
from exposight.twin.campaign.view_tables import ViewTables, check_table_path
from exposight.workers import DaskCluster, LocalProcesses

if TYPE_CHECKING:
    from collections.abc import Collection

    from exposight.plans import MeasuringPlan
    from exposight.twin.part import Scene
    from exposight.workers import Workers


Progress = Callable[[int, int], None]
Stage = Callable[[str], None]

_FIRST_VIEWS = "taking the first views"


def simulate(
    plan: MeasuringPlan,
    folder: str | Path,
    settings: CellSettings | None = None,
    progress: Progress | None = None,
    *,
    stage: Stage | None = None,
) -> CampaignFolder:
    """Carry out a measuring plan and write its campaign; go on where an earlier run stopped.

    More than one worker means processes that are begun afresh: a script then needs
    ``if __name__ == "__main__":`` around what it does, as Python's `multiprocessing` explains.

    Parameters
    ----------
    plan : MeasuringPlan
        From where and for how long to measure.
    folder : path
        The campaign's folder, as in ``docs/formats.md``. Captures that are there are kept, those
        that are missing are taken: the result is the same as of one uninterrupted run.
    settings : CellSettings, optional
        Whole frames or rings only, what is kept, workers, scene.
    progress : callable, optional
        Called with (captures there, captures in all), first before any is taken.
    stage : callable, optional
        Called with what begins, in a few words, until the first view is being taken: seconds may
        pass before `progress` has something to tell.

    Returns
    -------
    CampaignFolder

    Raises
    ------
    InputError
        If the plan cannot be carried out, the folder holds another plan's captures, or there is no
        such cluster.
    FileError
        If the disk is full or refuses. What was captured stays valid.
    NumericalError
        If a worker process here died, or a cluster gave up. What was captured stays valid.
    """
    settings = settings or CellSettings()
    folder = Path(folder).resolve()  # workers may be elsewhere
    scene, planned = _prepared(plan, settings, stage)
    sensor = sensor_preset(plan.sensor)
    numbers = _numbers(planned)
    with CampaignWriter.open_or_create(
        folder, name=plan.name, sensor=sensor, part=plan.observed_part(scene.part)
    ) as writer:
        n_there = len(writer.keys)
        record_sha256 = keep_record(
            folder, plan=plan, scene=scene, settings=settings, n_captures=n_there, what="campaign"
        )
        if n_there == 0:
            keep_meaning(folder, sensor, wanted=settings.raw_frames)
        there = _captures_there(writer, numbers, folder)
        tasks = _tasks(plan, planned, settings, numbers.keys() - there)
        done = len(there)
        _name(stage, _FIRST_VIEWS)
        _tell(progress, done, len(numbers))
        work = partial(write_view, folder, record_sha256)
        # Closed before the writer is, whatever happens: no process here may outlive the lock.
        with closing(_workers(settings).run(work, tasks)) as results:
            for task, _ in results:
                done += len(task.captures)
                _tell(progress, done, len(numbers))
        writer.sweep()  # a cluster's worker may have died over a capture that another took
        campaign = CampaignFolder(folder)
        if not settings.clouds:
            _write_table(campaign)
    return campaign


def simulate_observations(
    plan: MeasuringPlan,
    settings: CellSettings | None = None,
    progress: Progress | None = None,
    *,
    table_path: str | Path | None = None,
    stage: Stage | None = None,
) -> ObservationTable:
    """Carry out a measuring plan and observe every capture at once, without writing any.

    Parameters
    ----------
    plan : MeasuringPlan
        From where and for how long to measure.
    settings : CellSettings, optional
        Whole frames or rings only, workers, scene; more than one worker as for `simulate`.
    progress : callable, optional
        Called with (captures done, captures in all).
    table_path : path, optional
        Where to write the table, .csv or .parquet. Until it is written, the observations of
        finished views are kept in a folder beside it, and the same call goes on with them after
        any interruption.
    stage : callable, optional
        As for `simulate`.

    Returns
    -------
    ObservationTable
        As `observe_campaign` makes it of the campaign that `simulate` would write.

    Raises
    ------
    InputError
        If the plan cannot be carried out, the folder beside the table holds another one's views,
        or there is no such cluster.
    FileError
        If the table cannot be written.
    NumericalError
        If a worker process here died, or a cluster gave up.
    """
    settings = settings or CellSettings()
    if table_path is not None:
        table_path = Path(table_path)
        check_table_path(table_path)
    scene, planned = _prepared(plan, settings, stage)
    with ExitStack() as stack:
        kept, found = None, {}
        if table_path is not None:
            kept = stack.enter_context(
                ViewTables.open_beside(table_path, plan=plan, scene=scene, settings=settings)
            )
            rows = {view.name: kept.find(number) for number, view in enumerate(planned)}
            found = {name: table for name, table in rows.items() if table is not None}
        _name(stage, _FIRST_VIEWS)
        _observe_others(plan, planned, settings, found, kept, progress)
        table = ObservationTable(frame=pl.concat(found[view.name].frame for view in planned))
        if kept is not None and table_path is not None:
            table.write(table_path)
            kept.remove()
    return table


def _observe_others(
    plan: MeasuringPlan,
    planned: tuple[PlannedView, ...],
    settings: CellSettings,
    found: dict[str, ObservationTable],
    kept: ViewTables | None,
    progress: Progress | None,
) -> None:
    """Observe the views that are not found yet, and add them."""
    numbers = {view.name: number for number, view in enumerate(planned)}
    keys = _numbers(planned)
    tasks = _tasks(plan, planned, settings, {key for key in keys if key.view not in found})
    done = len(keys) - sum(len(task.captures) for task in tasks)
    _tell(progress, done, len(keys))
    with closing(_workers(settings).run(observe_view, tasks)) as results:
        for task, rows in results:
            table = ObservationTable.from_observations(rows)
            if kept is not None:
                kept.keep(numbers[task.view.name], table)
            found[task.view.name] = table
            done += len(task.captures)
            _tell(progress, done, len(keys))


def _workers(settings: CellSettings) -> Workers:
    if settings.cluster is not None:
        return DaskCluster(settings.cluster)
    return LocalProcesses(settings.workers)


def _check_rings(plan: MeasuringPlan, settings: CellSettings) -> None:
    if settings.rings_only and is_stereo(plan.sensor):
        msg = (
            f"plan {plan.name!r}: sensor {plan.sensor!r} matches whole images, so it cannot take "
            "rings only; take whole frames"
        )
        raise InputError(msg)


def _prepared(
    plan: MeasuringPlan, settings: CellSettings, stage: Stage | None
) -> tuple[Scene, tuple[PlannedView, ...]]:
    """Return what is looked at, and from where."""
    _check_rings(plan, settings)
    _name(stage, "preparing the scene")
    scene = scene_at(settings.scene)
    _name(stage, "planning the views")
    return scene, views(plan, scene.part, sensor_preset(plan.sensor))


def _name(stage: Stage | None, words: str) -> None:
    if stage is not None:
        stage(words)


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
    missing: Collection[CaptureKey],
) -> list[ViewTask]:
    """Return a task for each view of which captures are missing."""
    scene_sha256 = scene_checksum(scene_at(settings.scene))
    numbers = _numbers(planned)
    tasks = []
    for view in planned:
        keys = [CaptureKey(view.name, t) for t in view.exposures_ms]
        captures = tuple((numbers[key], key.exposure_ms) for key in keys if key in missing)
        if captures:
            tasks.append(
                ViewTask(
                    plan=plan,
                    view=view,
                    captures=captures,
                    settings=settings,
                    scene_sha256=scene_sha256,
                )
            )
    return tasks


def _write_table(campaign: CampaignFolder) -> None:
    """Write the observations of a campaign's captures, which lie beside them, as one table."""
    header, rows = b"", []
    for number in campaign.numbers:
        header, _, body = campaign.attachments(number)[OBSERVATIONS_FILE].partition(b"\n")
        rows.append(body)
    write_durably(campaign.path / OBSERVATIONS_FILE, header + b"\n" + b"".join(rows))
