"""One view of a plan, captured at its exposure times: the work of one process."""

import socket
from collections.abc import Collection, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import polars as pl

from exposight.cell import (
    ActiveSensor,
    CampaignFolder,
    Capture,
    Driver,
    Part,
    exposure_share,
    same_exposure,
    write_numbered_capture,
)
from exposight.cell.capture import CaptureDescription
from exposight.contradictions import Contradiction
from exposight.errors import ExposightError, FormatError, InputError, SensorError
from exposight.files import csv_of, write_durably
from exposight.geometry import RigidTransform
from exposight.measuring.record import check_record, describe, differing
from exposight.observing import ObservationTable, Observer, parse_observations
from exposight.plans import MeasuringPlan, PlannedView

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
    driver : Driver
        That takes them.
    description : dict
        What the driver says of itself where the measurement began.
    part : Part
        The features to observe.
    clouds : bool
        Whether clouds are kept.
    taken_ms : tuple of float, ms
        Exposure times, as read back, of the view's captures that are there.
    """

    plan: MeasuringPlan
    view: PlannedView
    captures: tuple[tuple[int, float], ...]
    driver: Driver
    description: dict[str, Any]
    part: Part
    clouds: bool = True
    taken_ms: tuple[float, ...] = ()

    def capture(self, exposure_ms: float, before_ms: Collection[float]) -> Capture:
        """Take a capture that has another exposure time than those before it."""
        view = self.view
        capture = take_capture(
            self.driver, self.plan.sensor, exposure_ms, view.camera_from_part, view=view.name
        )
        if capture.exposure_ms in before_ms:
            msg = (
                f"the sensor was set to {exposure_ms:g} ms and took {capture.exposure_ms:g} ms, "
                "which it had taken before; plan with the exposure times that it really has"
            )
            raise SensorError(msg)
        return capture


def write_view(folder: Path, record_sha256: str, task: ViewTask) -> tuple[Contradiction, ...]:
    """Take a view's captures and write each as soon as it is taken.

    Parameters
    ----------
    folder : Path
        The campaign's folder, whose writer another process holds.
    record_sha256 : str
        Checksum of the measurement's record in it.
    task : ViewTask
        What to take.

    Returns
    -------
    tuple of Contradiction
        What did not agree in captures that were observed because their clouds are not kept.

    Raises
    ------
    ExposightError
        What went wrong, naming plan, view and exposure.
    """
    with _naming(task):
        check_record(folder, record_sha256)  # before the work, for whom it would be in vain
        _check_driver(task)
    observer = Observer(task.part, task.plan.sensor)
    before_ms = {*task.taken_ms}
    for number, exposure_ms in task.captures:
        with _naming(task, exposure_ms):
            capture = task.capture(exposure_ms, before_ms)
            before_ms.add(capture.exposure_ms)
            if not task.clouds:
                table = ObservationTable.from_observations(observer.observe(capture))
                rows = csv_of(table.frame)
                capture = replace(
                    capture,
                    cloud=None,
                    attachments={**capture.attachments, OBSERVATIONS_FILE: rows},
                )
            check_record(folder, record_sha256)  # by now the folder may be another measurement's
            write_numbered_capture(folder, number, capture)
    return observer.contradictions


def observe_view(task: ViewTask) -> ObservationTable:
    """Take a view's captures and observe each, keeping none.

    Raises
    ------
    ExposightError
        What went wrong, naming plan, view and exposure.
    """
    with _naming(task):
        _check_driver(task)
    observer = Observer(task.part, task.plan.sensor)
    rows, before_ms = [], set[float]()
    for _, exposure_ms in task.captures:
        with _naming(task, exposure_ms):
            capture = task.capture(exposure_ms, before_ms)
            before_ms.add(capture.exposure_ms)
            rows += observer.observe(capture)
    table = ObservationTable.from_observations(rows)
    return replace(table, contradictions=observer.contradictions)


def stored_observations(
    campaign: CampaignFolder, number: int, capture: CaptureDescription
) -> ObservationTable:
    """Return the observations that lie beside a capture, and are of that one.

    Raises
    ------
    FormatError
        If they are not there, or of another capture.
    FileError
        If they cannot be read.
    """
    source = f"{campaign.path}, capture {number}"
    table = parse_observations(_stored(campaign, number), source)
    named = set(zip(table.frame["view"], table.frame["exposure_ms"], strict=True))
    twice = table.frame["feature"].is_duplicated().any()
    if named != {(capture.view, capture.exposure_ms)} or twice:
        msg = (
            f"{source}: {OBSERVATIONS_FILE} holds rows of another capture than view "
            f"{capture.view!r} at {capture.exposure_ms:g} ms, or a feature twice; take it again"
        )
        raise FormatError(msg)
    return table


def _stored(campaign: CampaignFolder, number: int) -> bytes:
    attachments = campaign.attachments(number)
    if OBSERVATIONS_FILE not in attachments:
        msg = f"{campaign.path}, capture {number}: it was kept without {OBSERVATIONS_FILE}"
        raise FormatError(msg)
    return attachments[OBSERVATIONS_FILE]


def write_table(campaign: CampaignFolder) -> None:
    """Write the observations of a campaign's captures, which lie beside them, as one table."""
    write_durably(campaign.path / OBSERVATIONS_FILE, campaign_rows(campaign))


def campaign_rows(campaign: CampaignFolder) -> bytes:
    """Return the observations of a campaign's captures, which lie beside them, as one CSV.

    Raises
    ------
    FormatError
        If a capture was kept without them.
    FileError
        If they cannot be read.
    """
    rows: dict[bytes, list[bytes]] = {}
    for number in campaign.numbers:
        header, _, body = _stored(campaign, number).partition(b"\n")
        rows.setdefault(header, []).append(body)
    tables = [header + b"\n" + b"".join(bodies) for header, bodies in rows.items()]
    if len(tables) > 1:  # an earlier version, which knew fewer columns, began it
        frames = [pl.read_csv(table, infer_schema=False) for table in tables]
        # Their texts are as they were written, apostrophes and all.
        tables = [pl.concat(frames, how="diagonal").write_csv().encode()]
    return tables[0] if tables else b"\n"


@contextmanager
def _naming(task: ViewTask, exposure_ms: float | None = None) -> Iterator[None]:
    """Name plan, view and exposure in the messages of errors."""
    when = "" if exposure_ms is None else f" at {exposure_ms:g} ms"
    place = f"plan {task.plan.name!r}, view {task.view.name!r}{when}"
    try:
        yield
    except ExposightError as error:
        msg = f"{place}: {error}"
        raise error.named(msg) from error


def take_capture(
    driver: Driver,
    sensor: ActiveSensor,
    exposure_ms: float,
    camera_from_part: RigidTransform,
    *,
    view: str,
) -> Capture:
    """Take a capture and check that it is the one asked for.

    Raises
    ------
    SensorError
        If the driver fails, or takes another exposure time than the one asked for
        (`exposight.cell.same_exposure`).
    InputError
        If the capture has another view's name.
    ExposightError
        What the driver raises, or if the capture cannot be this sensor's.
    """
    try:
        capture = driver.capture(exposure_ms, camera_from_part, view=view)
    except ExposightError:
        raise
    except Exception as error:  # whatever a driver's own libraries raise
        msg = (
            f"the driver failed ({type(error).__name__}: {error}); captures taken before are kept: "
            "run again to go on"
        )
        raise SensorError(msg) from error
    capture.check_fits(sensor)
    if capture.view != view:
        msg = f"the driver named its capture {capture.view!r}; it must give it the view's name"
        raise InputError(msg)
    increment_ms, share = sensor.exposure.increment_ms, exposure_share(driver)
    if not same_exposure(exposure_ms, capture.exposure_ms, increment_ms, share):
        msg = (
            f"the sensor was set to {exposure_ms:g} ms and took {capture.exposure_ms:g} ms, more "
            f"than its increment of {increment_ms:g} ms and {100 * share:g} % away; plan exposure "
            "times that it can take, and check whether it ignores the setting"
        )
        raise SensorError(msg)
    return capture


def _check_driver(task: ViewTask) -> None:
    """Refuse to mix what different processes capture."""
    facts = differing(task.description, describe(task.driver))
    if facts:
        msg = (
            f"the driver is another on {socket.gethostname()}, where a worker is: it differs in "
            f"{facts}; give all workers the same files and the same versions of Python's packages"
        )
        raise InputError(msg)
