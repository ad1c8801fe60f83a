"""What a folder says of the measurement that fills it, so that only the same one continues in it.

Beside a campaign's own files lie the plan, to be read or carried out again, and a description of
whatever else decides the captures' bytes.
"""

import json
import socket
from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

from exposight.cell import Driver
from exposight.errors import FileError, InputError
from exposight.files import Checksum, DocumentFormat, sha256_of, write_durably
from exposight.planning import ExposurePlan, SensorModels, write_exposure_plan
from exposight.plans import MeasuringPlan, plan_to_toml, read_plan, write_plan

PLAN_FILE, RECORD_FILE = "plan.toml", "measurement.json"
EXPOSURE_PLAN_FILE, LOOP_FILE = "exposure-plan.json", "closed-loop.json"

_SIMULATION_FILE = "simulation.json"
"""Record of versions before 0.2, in which only simulations were recorded."""


@dataclass(frozen=True, kw_only=True)
class _Record:
    """What ``measurement.json`` says."""

    plan_sha256: Checksum
    driver: dict[str, Any]
    clouds: bool


_FORMAT = DocumentFormat("exposight measurement", 1, _Record)


@dataclass(frozen=True, kw_only=True)
class _LoopRecord:
    """What ``closed-loop.json`` says."""

    plan_sha256: Checksum
    models: dict[str, Checksum] | None
    driver: dict[str, Any]
    clouds: bool


_LOOP_FORMAT = DocumentFormat("exposight closed loop", 1, _LoopRecord)


def describe(driver: Driver) -> dict[str, Any]:
    """Return what decides a driver's captures beyond sensor, part and plan, as JSON has it."""
    description = getattr(driver, "description", None)
    facts = description() if description else {"driver": type(driver).__name__}
    return dict(json.loads(json.dumps(facts)))


def differing(one: Mapping[str, Any], other: Mapping[str, Any]) -> str:
    """Return the names of the facts in which two descriptions differ, or an empty text."""
    keys = {**one, **other}
    return ", ".join(key for key in keys if one.get(key) != other.get(key))


def keep_record(
    folder: Path,
    *,
    plan: MeasuringPlan,
    description: dict[str, Any],
    clouds: bool,
    n_captures: int,
) -> str:
    """Record a measurement in the folder that it fills, or check that it is the one on record.

    Parameters
    ----------
    folder : Path
        Locked by this process.
    plan : MeasuringPlan
        From where and for how long is measured.
    description : dict
        Of the driver (`describe`).
    clouds : bool
        Whether clouds are kept.
    n_captures : int
        How many captures are there already; the first of them makes the record binding.

    Returns
    -------
    str
        Checksum of the record, for `check_record`.

    Raises
    ------
    InputError
        If the captures there come from another plan or driver, others are kept of them, or they
        were not measured by a plan.
    FileError
        If the record is damaged, or the disk refuses.
    """
    record = _Record(plan_sha256=_plan_sha256(plan), driver=description, clouds=clouds)
    path = folder / RECORD_FILE
    if n_captures == 0:
        write_plan(folder / PLAN_FILE, plan)
        write_durably(path, _FORMAT.seal(record))
        return sha256_of(path.read_bytes())
    if not path.is_file():
        msg = f"the campaign in {folder} has {n_captures} captures and no {RECORD_FILE}: "
        if (folder / _SIMULATION_FILE).is_file():
            msg += (
                "an earlier version of exposight simulated them, and this one cannot continue "
                "there; the captures can be read and observed as they are. Choose another folder"
            )
        else:
            msg += "they were not measured by a plan; choose another folder"
        raise InputError(msg)
    content = path.read_bytes()
    known = _FORMAT.unseal(content, str(path))
    difference = _difference(known, record, folder, plan)
    if difference:
        msg = (
            f"the campaign in {folder} was measured with {difference}; go on with that, or choose "
            "another folder"
        )
        raise InputError(msg)
    return sha256_of(content)


def keep_loop_record(
    folder: Path,
    *,
    plan: ExposurePlan,
    models: SensorModels | None,
    description: dict[str, Any],
    clouds: bool,
    n_captures: int,
) -> None:
    """Record a closed loop in the folder that it fills, or check that it is the one on record.

    Parameters
    ----------
    folder : Path
        Locked by this process.
    plan : ExposurePlan
        Where the loop begins.
    models : SensorModels, optional
        That decide; None where the plan is taken as it is.
    description : dict
        Of the driver (`describe`).
    clouds : bool
        Whether clouds are kept.
    n_captures : int
        How many captures are there already; the first of them makes the record binding.

    Raises
    ------
    InputError
        If the captures there come from another plan, other models or another driver.
    FileError
        If the record is damaged, or the disk refuses.
    """
    path = folder / LOOP_FILE
    if n_captures == 0:
        write_exposure_plan(folder / EXPOSURE_PLAN_FILE, plan)
    record = _LoopRecord(
        plan_sha256=sha256_of(plan.to_json().encode()),
        models=models.checksums if models else None,
        driver=description,
        clouds=clouds,
    )
    if n_captures == 0:
        write_durably(path, _LOOP_FORMAT.seal(record))
        return
    if not path.is_file():
        by_what = "a measuring plan" if (folder / RECORD_FILE).is_file() else "something else"
        msg = (
            f"the campaign in {folder} has {n_captures} captures that {by_what} measured, not an "
            "exposure plan; choose another folder"
        )
        raise InputError(msg)
    difference = _loop_difference(_LOOP_FORMAT.unseal(path.read_bytes(), str(path)), record)
    if difference:
        msg = (
            f"the campaign in {folder} was measured with {difference}; go on with that, or choose "
            "another folder"
        )
        raise InputError(msg)


def check_record(folder: Path, sha256: str) -> None:
    """Check, in a worker process, that a folder is the one where the measurement is on record.

    Parameters
    ----------
    folder : Path
        The campaign's folder, as the process that began the measurement names it.
    sha256 : str
        What `keep_record` returned there.

    Raises
    ------
    FileError
        If there is no such folder here, or the one here is another.
    """
    path = folder / RECORD_FILE
    try:
        same = sha256_of(path.read_bytes()) == sha256
        fault = "another one is there"
    except OSError as error:
        same, fault = False, error.strerror or str(error)
    if not same:
        msg = (
            f"the campaign's folder {folder} is not the same on {socket.gethostname()}, where a "
            f"worker is ({RECORD_FILE}: {fault}); choose a folder that all workers reach at the "
            "same path, or observe at once, which needs none"
        )
        raise FileError(msg)


def recorded_driver(campaign: Path) -> str | None:
    """Return the name of the driver that measured a campaign, or None where none is on record.

    Raises
    ------
    FileError
        If the record is damaged.
    """
    path = Path(campaign) / LOOP_FILE
    if path.is_file():
        return str(
            _LOOP_FORMAT.unseal(path.read_bytes(), str(path)).driver.get("driver", "unnamed")
        )
    path = path.with_name(RECORD_FILE)
    if path.is_file():
        return str(_FORMAT.unseal(path.read_bytes(), str(path)).driver.get("driver", "unnamed"))
    return "simulated cell" if path.with_name(_SIMULATION_FILE).is_file() else None


def _difference(known: _Record, wanted: _Record, folder: Path, plan: MeasuringPlan) -> str:
    if known.plan_sha256 != wanted.plan_sha256:
        other = read_plan(folder / PLAN_FILE)
        names = [
            entry.name
            for entry in fields(plan)
            if entry.name != "simulated" and getattr(plan, entry.name) != getattr(other, entry.name)
        ]
        return f"another plan, differing in {', '.join(names) or 'a file changed by hand'}"
    facts = differing(known.driver, wanted.driver)
    if facts:
        return f"another driver or other settings of it, differing in {facts}"
    if known.clouds != wanted.clouds:
        return "clouds kept, not without" if known.clouds else "no clouds kept, not with them"
    return ""


def _plan_sha256(plan: MeasuringPlan) -> str:
    # Without what only the simulated cell reads: its description says what came of it.
    return sha256_of(plan_to_toml(replace(plan, simulated={})).encode())


def _loop_difference(known: _LoopRecord, wanted: _LoopRecord) -> str:
    if known.plan_sha256 != wanted.plan_sha256:
        return "another exposure plan"
    if known.models != wanted.models:
        if known.models is None or wanted.models is None:
            return "corrections by models" if known.models else "the plan as it is"
        return "other models"
    facts = differing(known.driver, wanted.driver)
    if facts:
        return f"another driver or other settings of it, differing in {facts}"
    if known.clouds != wanted.clouds:
        return "clouds kept, not without" if known.clouds else "no clouds kept, not with them"
    return ""
