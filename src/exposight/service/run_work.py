"""What a run works with, loaded from the served folder: plan, models, driver."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from exposight.cell import PRESETS, Driver
from exposight.drivers import DEVICES, ReplayDriver
from exposight.errors import InputError, SensorError
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
    plan = plan_of(request, folder)
    models = None if request.models is None else SensorModels.load(folder.inside(request.models))
    driver = driver_of(request, folder, plan, models)
    return RunWork(plan=plan, models=models, driver=driver, clouds=request.clouds)


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


def _simulated_cell(
    request: RunRequest,
    wanted: SimulatedDriver,
    folder: ServedFolder,
    plan: ExposurePlan | MeasuringPlan,
    models: SensorModels | None,
) -> SimulatedCell:
    given: dict[str, Any] = {"lamp": wanted.lamp_power, "finish": wanted.finish}
    if isinstance(plan, MeasuringPlan):
        changes = {name: value for name, value in given.items() if value is not None}
        if wanted.rings_only:
            changes["rings_only"] = True
        return SimulatedCell.for_plan(plan, folder=folder.inside(request.plan).parent, **changes)
    known = [*PRESETS.values(), *([models.sensor] if models and models.sensor else [])]
    sensor = {each.name: each for each in known}.get(plan.sensor)
    if sensor is None:
        msg = (
            f"the plan's sensor {plan.sensor!r} is not described: give models that were trained "
            "on it (exposight train --sensor)"
        )
        raise SensorError(msg)
    settings = SimulatedCellSettings(**given, rings_only=wanted.rings_only)
    features = [each.feature for each in plan.features]
    return SimulatedCell(sensor, settings, seed=wanted.seed or 0, features=features)
