"""What a run works with, loaded from the served folder: plan, models, driver."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

from exposight.cell import PRESETS, Driver
from exposight.drivers import DEVICES, ReplayDriver
from exposight.errors import InputError, SensorError
from exposight.measuring.adaptive import view_poses
from exposight.planning import ExposurePlan, SensorModels, read_exposure_plan
from exposight.plans import PLAN_SUFFIXES, MeasuringPlan, read_plan
from exposight.service.folder import ServedFolder
from exposight.service.run_files import CellDriver, RecordedDriver, RunRequest, SimulatedDriver
from exposight.twin import SimulatedCell, SimulatedCellSettings


@dataclass(frozen=True, kw_only=True)
class RunWork:
    """What a run works with.

    Parameters
    ----------
    plan : ExposurePlan or MeasuringPlan
    models : SensorModels or None
        That decide.
    driver : Driver
        That takes the captures.
    clouds : bool
        Whether clouds are kept.
    """

    plan: ExposurePlan | MeasuringPlan
    models: SensorModels | None
    driver: Driver
    clouds: bool


def run_work(request: RunRequest, folder: ServedFolder) -> RunWork:
    """Load what a run works with.

    Raises
    ------
    ExposightError
        If something is not in the folder, cannot be read, or does not fit the rest.
    """
    plan, models = plan_of(request, folder), _models_of(request, folder)
    check_models(plan, models)
    driver = driver_of(request, folder, plan, models)
    return RunWork(plan=plan, models=models, driver=driver, clouds=request.clouds)


def check_work(request: RunRequest, folder: ServedFolder) -> int:
    """Check what a run works with as far as neither a scene nor a device is needed for that.

    Returns
    -------
    int
        How many features the plan has.

    Raises
    ------
    ExposightError
        As `run_work`; or if a recording lacks a view of the plan.
    """
    plan, models = plan_of(request, folder), _models_of(request, folder)
    check_models(plan, models)
    if isinstance(request.driver, RecordedDriver):
        folder.campaign(request.driver.recording)
    if isinstance(plan, MeasuringPlan):
        if isinstance(request.driver, SimulatedDriver):
            beside = folder.inside(request.plan).parent
            replace(SimulatedCellSettings.of_plan(plan, beside), **_changes(request.driver))
        else:
            driver_of(request, folder, plan, models)
        return len(plan.features)
    driver = driver_of(request, folder, plan, models)
    if driver.sensor.name != plan.sensor:
        msg = f"the plan is for sensor {plan.sensor!r}, the driver has {driver.sensor.name!r}"
        raise SensorError(msg)
    if isinstance(driver, ReplayDriver):
        for pose in view_poses(plan).values():
            driver.view_at(pose)
    return len(plan.features)


def check_models(plan: ExposurePlan | MeasuringPlan, models: SensorModels | None) -> None:
    """Check that models are of an exposure plan's sensor.

    Raises
    ------
    SensorError
        If they are of another.
    """
    if models is None or models.sensor is None or isinstance(plan, MeasuringPlan):
        return
    if models.sensor.name != plan.sensor:
        msg = (
            f"the models are of sensor {models.sensor.name!r}, the plan is for {plan.sensor!r}; "
            "give models of the plan's sensor, or plan with these"
        )
        raise SensorError(msg)


def _models_of(request: RunRequest, folder: ServedFolder) -> SensorModels | None:
    return None if request.models is None else folder.models(request.models)


def plan_of(request: RunRequest, folder: ServedFolder) -> ExposurePlan | MeasuringPlan:
    """Return a run's plan.

    Raises
    ------
    MissingFileError
        If there is none of this name.
    InputError, FormatError
        If it is none, or the models or the driver do not go with it.
    """
    path = folder.inside(request.plan)
    if path.suffix.lower() == ".json":
        return read_exposure_plan(path)
    if path.suffix.lower() not in PLAN_SUFFIXES:
        msg = (
            f"{request.plan} is no plan: expected an exposure plan (.json) or a measuring plan "
            f"({', '.join(PLAN_SUFFIXES)})"
        )
        raise InputError(msg)
    if request.models is not None:
        msg = "a measuring plan is taken as it is; models go with an exposure plan"
        raise InputError(msg)
    if isinstance(request.driver, SimulatedDriver) and request.driver.seed is not None:
        msg = "a measuring plan has its own seed; leave the driver's out"
        raise InputError(msg)
    return read_plan(path)


def driver_of(
    request: RunRequest,
    folder: ServedFolder,
    plan: ExposurePlan | MeasuringPlan,
    models: SensorModels | None,
) -> Driver:
    """Return the driver that a run asks for.

    Raises
    ------
    ExposightError
        If it cannot be made.
    """
    match request.driver:
        case RecordedDriver() as wanted:
            return ReplayDriver(folder.inside(wanted.recording))
        case CellDriver() as wanted:
            return DEVICES[wanted.kind].of_file(folder.inside(wanted.cell))
        case SimulatedDriver() as wanted:
            return _simulated_cell(request, wanted, folder, plan, models)


def _changes(wanted: SimulatedDriver) -> dict[str, Any]:
    """Return the simulated cell's settings that a request gives."""
    given = {
        "lamp": wanted.lamp_power,
        "finish": wanted.finish,
        "rings_only": wanted.rings_only or None,
    }
    return {name: value for name, value in given.items() if value is not None}


def _simulated_cell(
    request: RunRequest,
    wanted: SimulatedDriver,
    folder: ServedFolder,
    plan: ExposurePlan | MeasuringPlan,
    models: SensorModels | None,
) -> SimulatedCell:
    if isinstance(plan, MeasuringPlan):
        beside = folder.inside(request.plan).parent
        return SimulatedCell.for_plan(plan, folder=beside, **_changes(wanted))
    known = [*PRESETS.values(), *([models.sensor] if models and models.sensor else [])]
    sensor = {each.name: each for each in known}.get(plan.sensor)
    if sensor is None:
        msg = (
            f"the plan's sensor {plan.sensor!r} is not described: give models that were trained "
            "on it (exposight train --sensor)"
        )
        raise SensorError(msg)
    settings = SimulatedCellSettings(**_changes(wanted))
    features = [each.feature for each in plan.features]
    return SimulatedCell(sensor, settings, seed=wanted.seed or 0, features=features)
