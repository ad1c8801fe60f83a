"""The closed loop over HTTP: send what was captured, get what to capture next."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

import polars as pl
from pydantic import BeforeValidator, ConfigDict, Field
from pydantic_core import PydanticCustomError

from exposight import cell
from exposight.cell.capture import write_capture
from exposight.errors import InputError, LockedError, MissingFileError
from exposight.files import csv_of
from exposight.geometry import RigidTransform
from exposight.measuring import LoopState, LoopStep, loop_step
from exposight.planning import ExposurePlan
from exposight.planning.loop_report import Request
from exposight.service.bodies import PartAndSensor, Unit
from exposight.service.faults import RequestError
from exposight.service.folder import ServedFolder
from exposight.service.guard import Limits
from exposight.service.uploads import (
    CaptureAbout,
    Upload,
    exposure_of,
    read_upload,
    upload_folder,
)

LOOPS = "loops"
"""Folder in the served one that holds the states of loops."""

_MOST_COLUMNS = 200


def _few_columns(row: Any) -> Any:
    """Refuse a row with many columns, before each of them is looked at."""
    if isinstance(row, dict) and len(row) > _MOST_COLUMNS:
        kind, words = "too_many_columns", "a row has up to {most} columns"
        raise PydanticCustomError(kind, words, {"most": _MOST_COLUMNS})
    return row


_Row = Annotated[dict[str, str | float | bool | None], BeforeValidator(_few_columns)]

_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9._ -]{0,99}\Z")


_OF_CAPTURES = set(CaptureAbout.model_fields)
"""Keys that tell of an uploaded capture."""


class NextQuestion(PartAndSensor, CaptureAbout):
    """One step of a closed loop."""

    model_config = ConfigDict(
        json_schema_extra={
            "examples": [
                {"loop": "door", "plan": "plan.json", "models": "models", "campaign": "campaign"},
                {"loop": "door", "captures": ["new-view"], "unit": "us"},
            ]
        }
    )

    loop: str = Field(description="Name of the loop, whose state is kept.", examples=["door"])
    plan: str | None = Field(
        default=None, max_length=255, description="To begin: exposure plan in the folder."
    )
    models: str | None = Field(
        default=None, max_length=255, description="To begin: models in the folder."
    )
    captures: list[str] = Field(
        default=[],
        max_length=1000,
        description="Campaigns, captures' folders or observation tables in the served folder that "
        "were taken since.",
    )
    observations: list[_Row] | None = Field(
        default=None,
        min_length=1,
        max_length=10_000,
        fail_fast=True,
        description="Rows of an observation table, as /v1/observe returns them.",
    )
    unit: Unit | None = Field(default=None, description="Unit of set_value; the plan's by default.")

    def answer(self, upload: Upload | None, folder: ServedFolder, limits: Limits) -> dict[str, Any]:
        """Take note of captures, and return what to capture next."""
        if not _NAME.match(self.loop):
            msg = f"a loop's name has letters, digits, . _ - and blanks, got {self.loop[:110]!r}"
            raise InputError(msg)
        if upload is None and (extra := sorted(_OF_CAPTURES & self.model_fields_set)):
            msg = (
                f"{', '.join(extra)} is of a capture, whose image and cloud are missing: send them "
                "as files of a multipart request"
            )
            raise InputError(msg)
        path = folder.new(f"{LOOPS}/{self.loop}.json", "loop")
        state = self._first_state(path, folder, limits)
        folder.make_parent(path)  # only now, so that what cannot be leaves no lock
        try:
            with loop_step(path) as there, upload_folder() as place:
                step = self._begun(path, there, state)
                before = len(step.decisions)
                for name in self.captures:
                    step.feed(folder.captures(name))
                if self.observations is not None:
                    step.feed(_as_table(self.observations, place))
                if upload is not None:
                    step.feed(self._as_capture(upload, step, place, limits))
                request = step.request()
                step.save()
        except LockedError as error:
            msg = f"another client steps the loop {self.loop!r} just now; ask again"
            raise RequestError(409, msg) from error
        return _document(step, request, before, self.unit)

    def _first_state(self, path: Path, folder: ServedFolder, limits: Limits) -> LoopState | None:
        """Return the state that the request begins a loop with; None where it goes on with one."""
        begins = (self.plan, self.campaign, self.features, self.sensor)
        if any(each is not None for each in begins):
            return self._state(folder, limits)
        if not path.is_file():
            raise self._unknown()
        return None

    def _unknown(self) -> MissingFileError:
        msg = f"no loop {self.loop!r} yet; begin it with plan, models and campaign"
        return MissingFileError(msg)

    def _begun(self, path: Path, there: LoopStep | None, state: LoopState | None) -> LoopStep:
        """Return the loop at its state, or a new one."""
        if there is None:
            if state is None:  # it was removed just now
                raise self._unknown()
            return LoopStep(path, state)
        if state is not None and state != there.state.begun:
            msg = (
                f"{self.loop!r} is another loop; leave out plan and what belongs to it to go on "
                "with that, or give another name"
            )
            raise RequestError(409, msg)
        return there

    def _state(self, folder: ServedFolder, limits: Limits) -> LoopState:
        if self.plan is None or self.models is None:
            msg = "a new loop begins with plan and models"
            raise InputError(msg)
        plan = folder.exposure_plan(self.plan)
        part, sensor = self.part_and_sensor(folder, limits)
        if self.features is not None:
            part = replace(part, name=plan.part or part.name)
        folder.models(self.models)
        models = [folder.inside(self.models, "models")]
        return LoopState.begin(plan, models, part=part, sensor=sensor)

    def _as_capture(self, upload: Upload, step: LoopStep, place: Path, limits: Limits) -> Path:
        """Write an upload as a capture's folder; view and pose are by default those asked for."""
        request = step.request()
        view = self.view or (None if request is None else request.view)
        if view is None:
            msg = "the loop has ended; name the view of this capture"
            raise InputError(msg)
        pose = self.pose() if self.has_pose else _planned_pose(step.plan, view)
        capture = cell.Capture(
            view=view,
            exposure_ms=exposure_of(self),
            camera_from_part=pose,
            **read_upload(upload, self, step.sensor, place, limits),
        )
        write_capture(place / "capture", capture)
        return place / "capture"


def _planned_pose(plan: ExposurePlan, view: str) -> RigidTransform:
    pose = plan.view(view).camera_from_part
    if pose is None:
        msg = f"nobody says where view {view!r} is: give camera_from_part"
        raise InputError(msg)
    return pose


def _as_table(rows: list[dict[str, Any]], place: Path) -> Path:
    """Write rows as an observation table, which is then checked as every one is."""
    path = place / "observations.csv"
    try:
        frame = pl.DataFrame(rows, infer_schema_length=None)
    except (pl.exceptions.PolarsError, TypeError, ValueError, OverflowError) as error:
        msg = f"observations are no table: {str(error).splitlines()[0]}"
        raise InputError(msg) from error
    path.write_bytes(csv_of(frame))
    return path


def _document(
    step: LoopStep, request: Request | None, before: int, unit: Unit | None
) -> dict[str, Any]:
    return {
        "done": request is None,
        "request": None if request is None else _request(step, request, unit),
        "n_captures": len(step.decisions),
        "decisions": [vars(each) for each in step.decisions[before:]],
        "outcomes": [vars(each) for each in step.loop.outcomes],
        "verdict": step.verdict if request is None else "",
        "known": step.known,
        "contradictions": [vars(each) for each in step.contradictions],
    }


def _request(step: LoopStep, request: Request, unit: Unit | None) -> dict[str, Any]:
    pose = request.camera_from_part
    limits = step.plan.limits if unit is None else replace(step.plan.limits, unit=unit)
    return {
        "view": request.view,
        "camera_from_part": None if pose is None else pose.to_matrix().tolist(),
        "exposure_ms": request.exposure_ms,
        "set_value": limits.set_value(request.exposure_ms),
        "set_unit": limits.unit,
        "features": request.features,
        "why": request.why,
    }
