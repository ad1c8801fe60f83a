"""``exposight next``: one step of the closed loop over files, for programs that capture."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any

from cyclopts import Group, Parameter

from exposight.cell import ActiveSensor, CampaignFolder, Part, read_features, sensor_named_or_read
from exposight.cli.app import UsageError
from exposight.cli.result import Result, fact
from exposight.errors import FileError, MissingFileError
from exposight.files import spelled
from exposight.geometry import RigidTransform
from exposight.measuring import LoopState, LoopStep, loop_step
from exposight.measuring.adaptive import models_remark
from exposight.measuring.decisions import HAD, OPEN, outcomes_table
from exposight.planning import read_exposure_plan
from exposight.planning.loop_report import Request
from exposight.tables import count, counted, number


@Parameter("*", group=Group("To begin", sort_key=2))
@dataclass(frozen=True, kw_only=True)
class BeginOptions:
    """What a new loop begins with.

    Parameters
    ----------
    plan
        Exposure plan that exposight plan wrote, .json.
    models
        quality.exposight-model, two model files, one for quality and one for exposure time, or the
        folder that holds them. They stay where they are.
    campaign
        Campaign whose sensor and part are meant.
    sensor
        Or the sensor: a preset's name or a JSON file.
    features
        And the part's features, CSV (docs/formats.md).
    """

    plan: Path | None = None
    models: Annotated[tuple[Path, ...], Parameter(consume_multiple=True)] = ()
    campaign: Path | None = None
    sensor: Annotated[str | None, Parameter(metavar="NAME|FILE")] = None
    features: Path | None = None

    def state(self) -> LoopState:
        """Return the state of a loop that has no capture yet.

        Raises
        ------
        UsageError
            If something is missing, or said twice.
        ExposightError
            If one of them cannot be used.
        """
        if self.plan is None or not self.models:
            msg = "a new loop begins with --plan and --models"
            raise UsageError(msg)
        plan = read_exposure_plan(self.plan)
        part, sensor = self._part_and_sensor(plan.part)
        return LoopState.begin(plan, self.models, part=part, sensor=sensor)

    def _part_and_sensor(self, name: str) -> tuple[Part, ActiveSensor]:
        if self.campaign is not None and self.sensor is None and self.features is None:
            campaign = CampaignFolder(self.campaign)
            return campaign.part, campaign.sensor
        if self.campaign is not None or self.sensor is None or self.features is None:
            msg = "a new loop needs either --campaign, or both --sensor and --features"
            raise UsageError(msg)
        part = Part(name=name or spelled(self.features.stem), features=read_features(self.features))
        return part, sensor_named_or_read(self.sensor)


_GOES_ON = BeginOptions()


def next_command(
    state: Path,
    /,
    *,
    capture: Annotated[
        tuple[Path, ...], Parameter(metavar="FOLDER|TABLE...", consume_multiple=True)
    ] = (),
    begin: BeginOptions = _GOES_ON,
) -> Result:
    r"""Say what to capture next, one step of the closed loop.

    For programs that move a robot and a sensor themselves: take the capture that is asked for, and
    call again with it. Each call takes note of the captures named, with the exposure time read
    back, and keeps all it knows in the state's file, which is replaced as a whole: a call that is
    interrupted is repeated. A capture fed before is known already, and said to be.

    For example:

        exposight next loop.json --plan plan.json --models models --campaign door --json

        exposight next loop.json --capture captures/000000 --json

    Parameters
    ----------
    state
        File that holds where the loop is; made by the first call.
    capture
        Captures that were taken since: a campaign's or a capture's folder, or observation tables,
        .csv or .parquet (exposight observe).
    """
    with loop_step(state) as there:
        step = _begun(state, there, begin)
        before = len(step.decisions)
        for path in capture:
            step.feed(path)
        request = step.request()
        step.save()
    return _result(step, request, before)


def _begun(path: Path, there: LoopStep | None, begin: BeginOptions) -> LoopStep:
    """Return the loop at its state, or a new one."""
    if there is None:
        if begin == _GOES_ON:
            msg = f"no state of a loop at {path}; begin one with --plan and --models"
            raise MissingFileError(msg)
        return LoopStep(path, begin.state())
    if begin != _GOES_ON and begin.state() != there.state.begun:
        msg = (
            f"{path} is the state of another loop; leave out --plan and what belongs to it to go "
            "on with that, or name another file"
        )
        raise FileError(msg)
    return there


def _result(step: LoopStep, request: Request | None, before: int) -> Result:
    outcomes, n, fed = step.loop.outcomes, len(step.decisions), step.decisions[before:]
    statuses: list[str] = [each.status for each in outcomes]
    left = f"{counted(statuses.count(OPEN), 'feature')} left"
    if request is None:
        left = f"the loop has ended with {statuses.count(HAD)} of {len(statuses)} features had"
    remarks = (f"capture {each.number + 1}: {each.remark}" for each in fed if each.remark)
    other_models = "" if n else models_remark(step.plan, step.state.models_sha256)
    notes = (*filter(None, (other_models,)), *step.known, *remarks)
    document = None if request is None else _document(request)
    facts = (
        fact("done", request is None, ""),
        fact("request", document, "" if request is None else _in_words(request)),
        fact("captures", n, f"{count(n)}; {left}"),
        fact("fed", fed, "\n".join(map(str, fed))),
    )
    table = outcomes_table(outcomes, step.plan)
    if document is None:
        return Result(
            title=step.verdict,
            facts=facts,
            tables=(table,),
            notes=notes,
            contradictions=step.contradictions,
        )
    title = (
        f"capture {document['view']} at {number(document['exposure_ms'])} ms: set "
        f"{document['set_value']:.9g} {document['set_unit']}"
    )
    tables = (replace(table, shown_rows=0),)
    return Result(
        title=title,
        facts=facts,
        tables=tables,
        notes=notes,
        contradictions=step.contradictions,
    )


def _in_words(request: Request) -> str:
    """Return what people read of a request beside its title."""
    pose = f"part in the camera's frame: fanuc {_fanuc(request)}"
    return "\n".join((request.why, f"for {', '.join(request.features)}", pose))


def _fanuc(request: Request) -> str:
    pose = _pose(request)
    numbers = (*pose.translation_mm.tolist(), *pose.to_fanuc_wpr())
    return ",".join(f"{round(each, 4) + 0.0:.9g}" for each in numbers)


def _pose(request: Request) -> RigidTransform:
    assert request.camera_from_part is not None  # the plan has it of each view
    return request.camera_from_part


def _document(request: Request) -> dict[str, Any]:
    return {
        "view": request.view,
        "camera_from_part": _pose(request).to_matrix().tolist(),
        "fanuc": _fanuc(request),
        "exposure_ms": request.exposure_ms,
        "set_value": request.set_value,
        "set_unit": request.set_unit,
        "features": request.features,
        "why": request.why,
    }
