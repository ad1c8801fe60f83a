"""Carry out a measuring plan on a driver; continue where an earlier run stopped.

Views are independent: several are captured at the same time, in processes of their own, where the
driver allows it. A driver whose captures depend on pose, exposure time and the view's name alone
then gives the same bytes for any number of workers, here or on a cluster, and any interruption.
"""

import json
import logging
import shutil
from collections.abc import Callable, Collection, Iterator, Mapping
from contextlib import closing, contextmanager
from functools import partial
from pathlib import Path
from typing import overload

import polars as pl

from exposight.cell import (
    CampaignFolder,
    CampaignWriter,
    CaptureKey,
    Driver,
    Part,
    exposure_share,
    same_exposure,
)
from exposight.contradictions import Contradiction
from exposight.errors import FileError, FormatError, InputError, MissingFileError, SensorError
from exposight.files import (
    KeptFiles,
    alike,
    csv_of,
    hold_writer_lock,
    sweep_unfinished,
    write_durably,
)
from exposight.measuring import view_work
from exposight.measuring.adaptive import LoopResult, measure_adaptively
from exposight.measuring.record import describe, keep_record
from exposight.observing import ObservationTable, read_observations
from exposight.planning import ExposurePlan, SensorModels
from exposight.plans import MeasuringPlan, plan_to_toml
from exposight.workers import (
    DaskCluster,
    LocalProcesses,
    Progress,
    Workers,
    choose_workers,
    ignore_progress,
)

logger = logging.getLogger(__name__)

_VIEWS = "[0-9]*.csv"
"""Kept views in the folder beside a table."""


def _log(found: Contradiction) -> None:
    logger.warning("contradiction: %s", found)


@overload
def measure(
    plan: MeasuringPlan,
    driver: Driver,
    folder: str | Path,
    *,
    part: Part | None = None,
    clouds: bool = True,
    workers: int = 1,
    cluster: str | DaskCluster | None = None,
    progress: Progress = ignore_progress,
    tell: Callable[[Contradiction], None] = ...,
) -> CampaignFolder: ...
@overload
def measure(
    plan: ExposurePlan,
    driver: Driver,
    folder: str | Path,
    *,
    models: SensorModels | None,
    part: Part | None = None,
    clouds: bool = True,
    progress: Progress = ignore_progress,
) -> LoopResult: ...
def measure(
    plan: MeasuringPlan | ExposurePlan,
    driver: Driver,
    folder: str | Path,
    *,
    part: Part | None = None,
    clouds: bool = True,
    workers: int = 1,
    cluster: str | DaskCluster | None = None,
    progress: Progress = ignore_progress,
    tell: Callable[[Contradiction], None] = _log,
    **closed_loop: SensorModels | None,
) -> CampaignFolder | LoopResult:
    """Carry out a plan and write its campaign; continue where an earlier run stopped.

    A measuring plan is taken as it is; an exposure plan in a closed loop that `models` decide,
    which has to be named (`measure_adaptively`).

    More than one worker means processes that are begun afresh: a script then needs
    ``if __name__ == "__main__":`` around what it does, as Python's `multiprocessing` explains.

    Parameters
    ----------
    plan : MeasuringPlan or ExposurePlan
        From where and for how long to measure.
    driver : Driver
        That takes the captures, with the plan's sensor.
    folder : path
        The campaign's folder, as in ``docs/formats.md``. Captures that are there are kept, those
        that are missing are taken.
    part : Part, optional
        What is measured, where the driver does not know it.
    clouds : bool
        Keep the clouds. Without them every capture is observed when it is taken, and the campaign
        holds its observations (``observations.csv``), which cannot be repeated from it.
    workers : int
        Processes on this machine that capture at the same time, where the driver allows it
        (`exposight.cell.driver`); 1 stays in this one.
    cluster : str or DaskCluster, optional
        Address of a Dask scheduler whose workers capture instead, as ``tcp://host:8786``. All of
        them must reach the folder at the same path.
    progress : Progress
        Called with the captures that are there and those in all, first before any is taken.
    tell : callable
        Called with what does not agree in captures that are observed because their clouds are not
        kept; logged by default.
    **closed_loop
        ``models`` of an exposure plan: `SensorModels`, or None to take it as it is.

    Returns
    -------
    CampaignFolder or LoopResult
        Of an exposure plan what became of its features, too.

    Raises
    ------
    InputError
        If the plan cannot be carried out, the folder holds another plan's or driver's captures, or
        there is no such cluster.
    SensorError
        If the driver has another sensor than the plan, fails, or takes other exposure times than it
        is asked for. What was captured stays valid, as for the errors below.
    FileError
        If the disk is full or refuses.
    NumericalError
        If a worker process here died, or a cluster gave up.
    """
    if isinstance(plan, ExposurePlan):
        if closed_loop.keys() != {"models"} or workers != 1 or cluster is not None:
            msg = (
                "an exposure plan is carried out in a closed loop, one capture after the other: "
                "give the `models` that decide, or models=None to take it as it is, and no workers"
            )
            raise InputError(msg)
        return measure_adaptively(
            plan,
            driver,
            folder,
            models=closed_loop["models"],
            part=part,
            clouds=clouds,
            progress=progress,
        )
    if closed_loop:
        msg = f"a measuring plan is taken as it is; leave out {', '.join(closed_loop)}"
        raise InputError(msg)
    folder = Path(folder).resolve()  # workers may be elsewhere
    job = _Job(plan, driver, part, clouds, workers, cluster, progress)
    numbers = job.numbers
    with CampaignWriter.open_or_create(
        folder, name=plan.name, sensor=plan.sensor, part=job.part
    ) as writer:
        n_there = len(writer.keys)
        record_sha256 = keep_record(
            folder,
            plan=plan,
            description=job.description,
            clouds=clouds,
            n_captures=n_there,
        )
        if n_there == 0:
            files: Mapping[str, bytes] = getattr(driver, "campaign_files", dict)()
            for name, content in files.items():
                write_durably(folder / name, content)
        there = _captures_there(writer, numbers, folder, driver)
        tasks = job.tasks(numbers.keys() - there, writer.keys.values())
        done = len(there)
        progress("measuring", done, len(numbers))
        work = partial(view_work.write_view, folder, record_sha256)
        # Closed before the writer is, whatever happens: no process here may outlive the lock.
        with closing(job.workers.run(work, tasks)) as results:
            for task, found in results:
                for each in found:
                    tell(each)
                done += len(task.captures)
                progress("measuring", done, len(numbers))
        writer.sweep()  # a cluster's worker may have died over a capture that another took
        campaign = CampaignFolder(folder)
        if not clouds:
            view_work.write_table(campaign)
    return campaign


def measure_observations(
    plan: MeasuringPlan,
    driver: Driver,
    *,
    part: Part | None = None,
    table_path: str | Path | None = None,
    workers: int = 1,
    cluster: str | DaskCluster | None = None,
    progress: Progress = ignore_progress,
) -> ObservationTable:
    """Carry out a measuring plan and observe every capture at once, without writing any.

    Parameters
    ----------
    plan, driver, part, workers, cluster, progress
        As for `measure`.
    table_path : path, optional
        Where to write the table, .csv or .parquet. Until it is written, the observations of
        finished views are kept in a folder beside it, and the same call continues with them after
        any interruption; views of another plan or driver are not used.

    Returns
    -------
    ObservationTable
        As `observe_campaign` makes it of the campaign that `measure` would write.

    Raises
    ------
    InputError
        If the plan cannot be carried out, or there is no such cluster.
    SensorError, NumericalError
        As for `measure`. The observations of finished views stay valid.
    FileError
        If the table cannot be written.
    """
    if table_path is None:
        job = _Job(plan, driver, part, False, workers, cluster, progress)
        return job.observe({}, lambda _name, _table: None)
    table_path = Path(table_path)
    check_table_path(table_path)
    job = _Job(plan, driver, part, False, workers, cluster, progress)
    with _folder_beside(table_path) as folder:
        decisive = (plan_to_toml(plan), plan.sensor.to_json(), json.dumps(job.description))
        kept = KeptFiles(folder, *decisive)
        paths = {f"{i:06d}.csv": view.name for i, view in enumerate(job.views)}
        found = {name: path for file, name in paths.items() if (path := kept.find(file))}
        files = {name: file for file, name in paths.items()}
        table = job.observe(
            {name: job.kept_view(name, path) for name, path in found.items()},
            lambda name, rows: kept.keep(files[name], csv_of(rows.frame)),
        )
        table.write(table_path)
        for path in folder.glob(_VIEWS):  # they are in the table
            path.unlink()
    return table


def views_folder(table: Path) -> Path:
    """Return the folder in which a table's finished views lie while it is not written."""
    return table.with_name(f"{table.name}.views")


def check_table_path(table: Path) -> None:
    """Find out before hours of work that a table cannot be written.

    Raises
    ------
    FormatError
        If its suffix is neither .csv nor .parquet.
    MissingFileError
        If its folder is not there.
    """
    if table.suffix.lower() not in {".csv", ".parquet"}:
        msg = f"{table}: an observation table ends in .csv or .parquet, got '{table.suffix}'"
        raise FormatError(msg)
    if not table.parent.is_dir():
        msg = f"{table}: the folder {table.parent} does not exist; make it first"
        raise MissingFileError(msg)


@contextmanager
def _folder_beside(table: Path) -> Iterator[Path]:
    """Open or make the folder for a table's finished views, for one process at a time."""
    folder = views_folder(table)
    try:
        folder.mkdir(exist_ok=True)
    except OSError as error:
        msg = f"the folder {folder} for finished views cannot be made: {error.strerror}"
        raise FileError(msg) from error
    lock = hold_writer_lock(folder, "the unfinished table")
    try:
        sweep_unfinished(folder)
        yield folder
    finally:
        if folder.exists() and not list(folder.glob(_VIEWS)):  # nothing to continue with
            shutil.rmtree(folder, ignore_errors=True)
        lock.release()


class _Job:
    """A plan, checked, with the driver and the workers that carry it out."""

    def __init__(
        self,
        plan: MeasuringPlan,
        driver: Driver,
        part: Part | None,
        clouds: bool,
        workers: int,
        cluster: str | DaskCluster | None,
        progress: Progress,
    ) -> None:
        _check_sensor(plan, driver)
        self.workers = _workers(driver, workers, cluster)
        progress("preparing the cell", 0, 1)
        part = part or getattr(driver, "part", None)
        if part is None:
            msg = "the driver does not know the part that it measures; give it as `part`"
            raise InputError(msg)
        self._progress = progress
        self.description = describe(driver)
        progress("preparing the cell", 1, 1)
        progress("planning the views", 0, 1)
        self.part = plan.observed_part(part)
        self.views = plan.views(part)
        progress("planning the views", 1, 1)
        task = partial(view_work.ViewTask, plan=plan, driver=driver, part=self.part, clouds=clouds)
        self._task = partial(task, description=self.description)
        keys = [CaptureKey(view.name, t) for view in self.views for t in view.exposures_ms]
        self.numbers = {key: number for number, key in enumerate(keys)}

    def tasks(
        self, missing: Collection[CaptureKey], there: Collection[CaptureKey] = ()
    ) -> list[view_work.ViewTask]:
        """Return a task for each view of which captures are missing; others are there."""
        tasks = []
        for view in self.views:
            keys = [CaptureKey(view.name, t) for t in view.exposures_ms]
            captures = tuple((self.numbers[key], key.exposure_ms) for key in keys if key in missing)
            if captures:
                taken_ms = tuple(key.exposure_ms for key in there if key.view == view.name)
                tasks.append(self._task(view=view, captures=captures, taken_ms=taken_ms))
        return tasks

    def kept_view(self, name: str, path: Path) -> ObservationTable:
        """Read the observations of a view that an earlier run finished.

        Raises
        ------
        FormatError
            If they are of another view, or not of all its features and exposure times.
        """
        table = read_observations(path)
        captures = [len(view.exposures_ms) for view in self.views if view.name == name]
        rows = len(self.part.features) * sum(captures)
        if set(table.frame["view"]) - {name} or len(table) != rows:
            msg = f"{path} is not of view {name!r}, or has not its {rows} rows; remove it"
            raise FormatError(msg)
        return table

    def observe(
        self,
        tables: dict[str, ObservationTable],
        keep: Callable[[str, ObservationTable], None],
    ) -> ObservationTable:
        """Return the observations of all views, of which some are there already.

        Parameters
        ----------
        tables : dict of str to ObservationTable
            Those that are there, by the view's name.
        keep : callable
            Called with the name and the observations of each further view.
        """
        tasks = self.tasks({key for key in self.numbers if key.view not in tables})
        total = len(self.numbers)
        done = total - sum(len(task.captures) for task in tasks)
        self._progress("measuring", done, total)
        with closing(self.workers.run(view_work.observe_view, tasks)) as results:
            for task, table in results:
                tables[task.view.name] = table
                keep(task.view.name, tables[task.view.name])
                done += len(task.captures)
                self._progress("measuring", done, total)
        ordered = [tables[view.name] for view in self.views]
        found = dict.fromkeys(each for table in ordered for each in table.contradictions)
        return ObservationTable(
            frame=pl.concat(table.frame for table in ordered), contradictions=tuple(found)
        )


def _workers(driver: Driver, count: int, cluster: str | DaskCluster | None) -> Workers:
    workers = choose_workers(count, cluster)
    if getattr(driver, "concurrent", False):
        return workers
    if cluster is not None:
        msg = "this driver captures in this process alone, so a cluster cannot do it"
        raise InputError(msg)
    return LocalProcesses(1)


def _check_sensor(plan: MeasuringPlan, driver: Driver) -> None:
    ours, theirs = (json.loads(sensor.to_json()) for sensor in (plan.sensor, driver.sensor))
    keys = [key for key in ours if not alike(ours[key], theirs.get(key))]
    if keys:
        msg = (
            f"plan {plan.name!r} is for sensor {plan.sensor.name!r}, the driver has "
            f"{driver.sensor.name!r}, which differs in {', '.join(keys)}; plan for the driver's "
            "sensor"
        )
        raise SensorError(msg)


def _captures_there(
    writer: CampaignWriter,
    numbers: Mapping[CaptureKey, int],
    folder: Path,
    driver: Driver,
) -> frozenset[CaptureKey]:
    """Return the plan's captures that an earlier run took."""
    increment_ms, share = driver.sensor.exposure.increment_ms, exposure_share(driver)
    planned = {number: key for key, number in numbers.items()}
    there = set()
    for number, key in writer.keys.items():
        wanted = planned.get(number, CaptureKey("", 0.0))
        if wanted.view != key.view or not same_exposure(
            wanted.exposure_ms, key.exposure_ms, increment_ms, share
        ):
            msg = (
                f"the campaign in {folder} holds view {key.view!r} at {key.exposure_ms:g} ms as "
                f"capture {number}, which this plan does not: it was taken by another plan; "
                "choose another folder"
            )
            raise InputError(msg)
        there.add(wanted)
    return frozenset(there)
