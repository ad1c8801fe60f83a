"""Carry out an exposure plan in a closed loop: look, act, assess.

What to capture next is decided by a pure state machine (`exposight.planning.ClosedLoop`). Each
capture is written together with its observations before anything is decided by it, and decisions
follow from the captures alone: after a kill at any instant the captures that are there are fed
again, in their order, and the loop goes on where it was.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import polars as pl

from exposight.cell import (
    ActiveSensor,
    CampaignFolder,
    CampaignWriter,
    Capture,
    Driver,
    Part,
)
from exposight.contradictions import Contradiction
from exposight.errors import ContradictionError, ExposightError, InputError, SensorError
from exposight.files import csv_of, write_durably
from exposight.geometry import RigidTransform
from exposight.measuring.decisions import (
    HAD,
    Decision,
    Loop,
    feed,
    outcomes_frame,
    outcomes_table,
    pose_remark,
    verdict,
    write_decisions,
    write_outcomes,
)
from exposight.measuring.open_loop import OpenLoop
from exposight.measuring.record import describe, keep_loop_record
from exposight.measuring.view_work import (
    OBSERVATIONS_FILE,
    stored_observations,
    take_capture,
    write_table,
)
from exposight.observing import ObservationTable, Observer, parse_observations
from exposight.planning import ExposurePlan, SensorModels
from exposight.planning.closed_loop import ClosedLoop
from exposight.planning.loop_report import Outcome, Request
from exposight.tables import Table
from exposight.workers import Progress, ignore_progress

REPEATED_FOLDER = "repeated"
"""Campaign, inside the loop's, of captures whose exposure time read back had been taken before."""

CONTRADICTED_FOLDER = "contradicted"
"""Campaign, inside the loop's, of captures that contradict themselves."""


@dataclass(frozen=True, kw_only=True, eq=False)
class LoopResult:
    """What a loop captured, decided and achieved.

    Parameters
    ----------
    campaign : CampaignFolder
        The captures.
    plan : ExposurePlan
        What was promised.
    decisions : tuple of Decision
        One for each capture.
    outcomes : tuple of Outcome
        What became of each feature.
    contradictions : tuple of Contradiction
        What did not agree in the captures taken now, where the outcomes may still be right.
    """

    campaign: CampaignFolder
    plan: ExposurePlan
    decisions: tuple[Decision, ...]
    outcomes: tuple[Outcome, ...]
    contradictions: tuple[Contradiction, ...] = ()

    @property
    def succeeded(self) -> tuple[str, ...]:
        """Features whose quality reached what is needed."""
        return tuple(each.feature for each in self.outcomes if each.status == HAD)

    @property
    def failed(self) -> dict[str, str]:
        """Features that did not, and why."""
        return {each.feature: each.reason for each in self.outcomes if each.status != HAD}

    @property
    def verdict(self) -> str:
        """How many features succeeded of how many that were promised, and which failed."""
        return verdict(self.outcomes, len(self.decisions), self.plan)

    @property
    def frame(self) -> pl.DataFrame:
        """A row for each feature: those of `Outcome`, and the chance in the plan."""
        return outcomes_frame(self.outcomes, self.plan)

    @property
    def table(self) -> Table:
        """What became of each feature, beside what was promised."""
        return outcomes_table(self.outcomes, self.plan)

    def __str__(self) -> str:
        return "\n".join((*map(str, self.decisions), self.verdict, str(self.table)))

    def _repr_html_(self) -> str:
        return f"<p>{self.verdict}</p>{self.table._repr_html_()}"


def measure_adaptively(
    plan: ExposurePlan,
    driver: Driver,
    folder: str | Path,
    *,
    models: SensorModels | None,
    part: Part | None = None,
    clouds: bool = True,
    progress: Progress = ignore_progress,
    tell: Callable[[Decision], None] = lambda _decision: None,
    ask: Callable[[Request, Sequence[Outcome]], None] = lambda _request, _outcomes: None,
) -> LoopResult:
    """Carry out an exposure plan, and correct it by what each capture shows.

    Features whose quality is measured to suffice leave, brightness that was measured corrects the
    others' chances, and what is left is planned again; until nothing is left that can be had.

    Parameters
    ----------
    plan : ExposurePlan
        Where the loop begins.
    driver : Driver
        That takes the captures, one after the other.
    folder : path
        The campaign's folder, as in ``docs/formats.md``. Captures that are there are taken note of
        first, so an interrupted loop goes on.
    models : SensorModels or None
        That decide; None takes the plan's captures as they are, without any correction.
    part : Part, optional
        What is measured, where the driver does not know it.
    clouds : bool
        Keep the clouds; observations are kept in any case.
    progress : Progress
        Called with the features that are done and those in all.
    tell : callable
        Called with each decision as soon as its capture is written, those of an earlier run first.
    ask : callable
        Called before each capture with what is to be taken and what became of the features so far.
        It may wait; what it raises ends the loop, and the same call goes on.

    Raises
    ------
    InputError
        If the folder holds what another plan, other models or another driver captured, or the part
        is another than the plan's or lacks a feature.
    SensorError
        If the driver has another sensor than the plan, fails, or takes other exposure times than it
        is asked for. What was captured stays, and the same call goes on with it.
    FileError
        If the disk is full or refuses.
    """
    if driver.sensor.name != plan.sensor:
        msg = (
            f"the plan is for sensor {plan.sensor!r}, the driver has {driver.sensor.name!r}; plan "
            "for the driver's sensor"
        )
        raise SensorError(msg)
    view_poses(plan)
    part = observed_part(plan, part or getattr(driver, "part", None))
    loop: Loop = OpenLoop(plan)
    if models is not None:
        loop = planned_loop(plan, models, part, driver.sensor)
    return _LoopRun(plan, loop, driver, part, clouds, progress, tell, ask).carry_out(
        Path(folder).resolve(), models
    )


def planned_loop(
    plan: ExposurePlan, models: SensorModels, part: Part, sensor: ActiveSensor
) -> ClosedLoop:
    """Return the loop that begins where a plan does."""
    return ClosedLoop.of_views(
        models,
        part,
        sensor,
        view_poses(plan),
        plan.limits,
        need=plan.target_p_norm,
        features=[each.feature for each in plan.features],
        views_of={each.feature: each.view for each in plan.features if each.view is not None},
        costs=plan.costs,
        goal=plan.goal,
    )


def view_poses(plan: ExposurePlan) -> dict[str, RigidTransform]:
    """Return camera_from_part of a plan's views, in their order.

    Raises
    ------
    InputError
        If there is no view, or the plan does not know where one is.
    """
    poses = {v.name: v.camera_from_part for v in plan.views if v.camera_from_part is not None}
    unknown = [view.name for view in plan.views if view.name not in poses]
    if unknown or not poses:
        got = f"the poses of {', '.join(unknown)} are not known" if unknown else "it has no view"
        msg = f"this exposure plan cannot be carried out: {got}; plan with views that have poses"
        raise InputError(msg)
    return poses


def observed_part(plan: ExposurePlan, part: Part | None) -> Part:
    """Return a part with the plan's features alone.

    Raises
    ------
    InputError
        If the part is not known, is called otherwise than the plan's, or lacks one of them.
    """
    if part is None:
        msg = "the driver does not know the part that it measures; give it as `part`"
        raise InputError(msg)
    if plan.part and part.name and plan.part != part.name:
        msg = f"the plan is for part {plan.part!r}, got {part.name!r}; plan for the part measured"
        raise InputError(msg)
    return Part(
        name=part.name, features=tuple(part.feature(each.feature) for each in plan.features)
    )


def models_remark(plan: ExposurePlan, checksums: Mapping[str, str]) -> str:
    """Return a remark where models are not those that a plan was made with.

    Parameters
    ----------
    plan : ExposurePlan
    checksums : mapping of str to str
        SHA-256 of each model that decides, by its name.
    """
    planned = {each.name: each.sha256 for each in plan.models}
    others = [
        name
        for name, sha256 in checksums.items()
        if planned and planned.get(name, "") not in {None, sha256}
    ]
    if not others:
        return ""
    return f"the plan was made with other models than these: {', '.join(others)}"


@dataclass(frozen=True)
class _LoopRun:
    """A loop and the driver that does what it asks."""

    plan: ExposurePlan
    loop: Loop
    driver: Driver
    part: Part
    clouds: bool
    progress: Progress
    tell: Callable[[Decision], None]
    ask: Callable[[Request, Sequence[Outcome]], None]

    def carry_out(self, folder: Path, models: SensorModels | None) -> LoopResult:
        decisions: list[Decision] = []
        with CampaignWriter.open_or_create(
            folder, name=self.part.name, sensor=self.driver.sensor, part=self.part
        ) as writer:
            there = CampaignFolder(folder)
            keep_loop_record(
                folder,
                plan=self.plan,
                models=models,
                description=describe(self.driver),
                clouds=self.clouds,
                n_captures=len(there),
            )
            if len(there) == 0:
                files: Mapping[str, bytes] = getattr(self.driver, "campaign_files", dict)()
                for name, content in files.items():
                    write_durably(folder / name, content)
            total = len(self.loop.outcomes)
            self.progress("measuring", 0, total)
            for number, description in zip(there.numbers, there.descriptions(), strict=True):
                rows = stored_observations(there, number, description)
                request = self.loop.next()
                pose = description.camera_from_part
                remark = pose_remark(self.part, request, description.view, pose)
                self._note(decisions, feed(self.loop, number, rows, request, remark))
            write_decisions(folder, decisions)
            observer = Observer(self.part, self.driver.sensor)
            while (request := self.loop.next()) is not None:
                self.ask(request, self.loop.outcomes)
                self._note(decisions, self._capture(folder, writer, observer, request))
                write_decisions(folder, decisions)
            campaign = CampaignFolder(folder)
            write_table(campaign)
            outcomes = tuple(self.loop.outcomes)
            write_outcomes(folder, outcomes, len(decisions), self.plan)
        return LoopResult(
            campaign=campaign,
            plan=self.plan,
            decisions=tuple(decisions),
            outcomes=outcomes,
            contradictions=observer.contradictions,
        )

    def _note(self, decisions: list[Decision], decision: Decision) -> None:
        decisions.append(decision)
        self.tell(decision)
        total = len(self.loop.outcomes)
        self.progress("measuring", total - decision.left, total)

    def _keep_aside(self, aside: Path, capture: Capture) -> Path:
        """Keep a capture that the loop cannot use in a campaign of its own."""
        with CampaignWriter.open_or_create(
            aside, name=self.part.name, sensor=self.driver.sensor, part=self.part
        ) as writer:
            if not writer.has(capture.view, capture.exposure_ms):
                writer.add(capture)
        return aside

    def _capture(
        self, folder: Path, writer: CampaignWriter, observer: Observer, request: Request
    ) -> Decision:
        """Take what was asked for, write it with its observations, and take note of it."""
        view, asked_ms = request.view, request.exposure_ms
        pose = request.camera_from_part
        assert pose is not None  # the plan has it of each view
        try:
            capture = take_capture(self.driver, self.driver.sensor, asked_ms, pose, view=view)
            if writer.has(view, capture.exposure_ms):
                aside = self._keep_aside(folder / REPEATED_FOLDER, capture)
                msg = (
                    f"the sensor was set to {asked_ms:g} ms and took {capture.exposure_ms:g} ms, "
                    "which it had taken before; a campaign holds one capture of a view and "
                    f"exposure time, so the repeated one is kept in {aside} and the loop stops; "
                    "plan with the increment that the sensor really has"
                )
                raise SensorError(msg)
        except ExposightError as error:
            msg = f"view {view!r} at {asked_ms:g} ms: {error}"
            raise type(error)(msg) from error
        try:
            table = ObservationTable.from_observations(observer.observe(capture))
        except ContradictionError as error:
            aside = self._keep_aside(folder / CONTRADICTED_FOLDER, capture)
            msg = f"{error}; the capture is kept in {aside}, and the loop goes on when run again"
            raise error.named(msg) from error
        data = csv_of(table.frame)
        # Fed as it is kept, so that a loop that goes on is fed the same.
        rows = parse_observations(data, f"view {view!r} at {capture.exposure_ms:g} ms")
        number = 1 + max(writer.keys, default=-1)
        writer.add(
            replace(
                capture,
                cloud=capture.cloud if self.clouds else None,
                attachments={**capture.attachments, OBSERVATIONS_FILE: data},
            )
        )
        remark = pose_remark(self.part, request, view, capture.camera_from_part)
        return feed(self.loop, number, rows, request, remark)
