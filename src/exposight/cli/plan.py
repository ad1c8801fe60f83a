"""``exposight plan``: which exposures to take in which views of a part."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated

from cyclopts import Group, Parameter
from cyclopts.validators import Number

from exposight.cell import Part, read_features, sensor_named_or_read
from exposight.cli.app import UsageError
from exposight.cli.auto_views import AUTO, AutoViewOptions, auto_candidate_views
from exposight.cli.candidate_views import CandidateViews, candidate_views, is_plan
from exposight.cli.exposure_options import ExposureOptions
from exposight.cli.result import Fact, Result, Written, fact
from exposight.cli.terminal import progress_bars
from exposight.files import spelled
from exposight.models import P_NORM_MIN
from exposight.planning import (
    CONFIDENCE,
    ExposurePlan,
    Goal,
    Prefer,
    SensorModels,
    check_confidence,
    plan_exposures,
    trade_off,
    write_exposure_plan,
)
from exposight.planning.covering.cover_wishes import check_goal, check_misses
from exposight.planning.outlook_table import who_fails
from exposight.planning.part_plan import check_same_sensor, model_references, view_chances
from exposight.plans import write_plan
from exposight.tables import Table, counted, number
from exposight.workers import Progress


@Parameter("*", group=Group("Views and features", sort_key=2))
@dataclass(frozen=True, kw_only=True)
class PlannedViewOptions:
    """From where the part may be looked at.

    Parameters
    ----------
    views
        Views to choose from: a measuring plan (a name or a file), a campaign with its plan, an
        observation table; or auto, which finds views from --features and --sensor.
    features
        The part's features, CSV (docs/formats.md); with a plan in place of those of its scene.
    sensor
        With --views auto the sensor, a preset's name or a JSON file; the models' by default.
    """

    views: Annotated[str, Parameter(metavar="PLAN|CAMPAIGN|TABLE|auto")]
    features: Path | None = None
    sensor: Annotated[str | None, Parameter(metavar="NAME|FILE")] = None

    def read(
        self, models: SensorModels, auto: AutoViewOptions, progress: Progress
    ) -> tuple[CandidateViews, Sequence[str]]:
        """Return the views, and remarks on them.

        Raises
        ------
        UsageError
            If options are missing or do not go together.
        ExposightError
            If a file cannot be used, or no view sees a feature.
        """
        if self.views != AUTO:
            if auto != AutoViewOptions():
                msg = f"--mesh, --reach, --count and the like go with --views {AUTO}"
                raise UsageError(msg)
            if self.sensor is not None:
                msg = f"--sensor goes with --views auto; {self.views} names its sensor itself"
                raise UsageError(msg)
            if self.features is not None and not is_plan(self.views):
                msg = f"--features goes with a measuring plan; {self.views} names its own"
                raise UsageError(msg)
            return candidate_views(self.views, self.features), ()
        if self.features is None:
            msg = "--views auto needs the part's features: give --features"
            raise UsageError(msg)
        sensor = models.sensor if self.sensor is None else sensor_named_or_read(self.sensor)
        if sensor is None:
            msg = "the models name no sensor: give --sensor"
            raise UsageError(msg)
        part = Part(name=spelled(self.features.stem), features=read_features(self.features))
        return auto_candidate_views(part, sensor, auto, progress)


_USUAL, _AUTO = ExposureOptions(), AutoViewOptions()


def plan_command(
    *models: Path,
    goal: Goal = "count",
    confidence: float = CONFIDENCE,
    need: Annotated[float, Parameter(validator=Number(gt=0, lte=1))] = P_NORM_MIN,
    budget: int | None = None,
    budget_s: Annotated[float | None, Parameter(metavar="S", validator=Number(gt=0))] = None,
    expected_misses: float | None = None,
    prefer: Prefer = "margin",
    move: Annotated[float, Parameter(metavar="MS", validator=Number(gte=0))] = 0.0,
    show_trade_off: Annotated[bool, Parameter("--trade-off")] = False,
    time_limit: Annotated[float, Parameter(metavar="S", validator=Number(gt=0))] = 20.0,
    output: Annotated[Path | None, Parameter(alias="-o", metavar="PLAN.json")] = None,
    measuring_plan: Annotated[Path | None, Parameter(metavar="PLAN.toml")] = None,
    where: PlannedViewOptions,
    exposures: ExposureOptions = _USUAL,
    auto: AutoViewOptions = _AUTO,
) -> Result:
    r"""Plan which exposures to take in which views of a part.

    The fewest captures, or the least time, that bring every feature to the quality that is needed,
    with the confidence asked; or the most features within a budget. What cannot be brought there is
    served as well as may be, and named with the reason. The plan is proven best, or comes with a
    bound of all others.

    For example:

        exposight plan models/ --views door --goal time --frames 12 --overhead 500 --move 3000

        exposight plan models/ --views auto --features features.csv --mesh part.stl --flicker 50 \
          -o plan.json

        exposight plan models/ --views door --budget 8 --trade-off

    Parameters
    ----------
    models
        quality.exposight-model, two model files, one for quality and one for exposure time, or the
        folder that holds them.
    goal
        Fewest captures, or least time.
    confidence
        Chance with which each feature shall have the quality, between 0 and 1.
    need
        Quality that is asked for, p_norm.
    budget
        Serve most features with at most so many captures.
    budget_s
        Serve most features in at most so many seconds.
    expected_misses
        So many features at most shall be expected to fail, in place of --confidence.
    prefer
        Among the fewest captures those that leave most margin, or those that take least time.
    move
        What the robot takes to a view, ms.
    show_trade_off
        Show how many features can be had for how many captures, or how much time.
    time_limit
        Seconds after which the best plan until then is given, with its gap.
    output
        Write the plan to this JSON file, for measure and next.
    measuring_plan
        Write its views and exposure times as a measuring plan, .toml.
    """
    check_confidence(confidence)
    goal, limit = _budget(goal, budget, budget_s)
    check_goal(goal, limit, time_limit)
    files = _files(models, output, measuring_plan)
    sensor_models = SensorModels.load(*models)
    with progress_bars() as progress:
        candidates, remarks = where.read(sensor_models, auto, progress)
        check_same_sensor(sensor_models, candidates.sensor, candidates.source)
        if measuring_plan is not None and not candidates.poses:
            msg = (
                f"--measuring-plan needs to know where views are, which {where.views} does not tell"
            )
            raise UsageError(msg)
        limits = exposures.exposure_limits(candidates.sensor or sensor_models.sensor)
        costs = replace(exposures.costs, move_ms=move)
        rings = candidates.frame
        if expected_misses is not None:
            check_misses(expected_misses, rings["feature"].n_unique())
        progress("forecasting", 0, 1)
        chances = view_chances(sensor_models, rings, limits, need=need)
        progress("forecasting", 1, 1)
        sensor = candidates.sensor or sensor_models.sensor
        parts = rings["part"].drop_nulls().unique().to_list() if "part" in rings.columns else []
        plan = plan_exposures(
            chances,
            limits,
            costs,
            goal=goal,
            confidence=confidence,
            expected_misses=expected_misses,
            budget=limit,
            prefer=prefer,
            poses={name: pose for name, (_, pose) in candidates.poses.items()},
            not_seen=candidates.hidden,
            sensor="" if sensor is None else sensor.name,
            part=str(parts[0]) if len(parts) == 1 else "",
            models=model_references(sensor_models),
            remarks=remarks,
            time_limit_s=time_limit,
            progress=progress,
        )
        curve: tuple[Table, ...] = ()
        if show_trade_off:
            curve = (
                trade_off(
                    chances,
                    limits,
                    costs,
                    goal=goal,
                    confidence=plan.confidence,
                    plan=plan,
                    time_limit_s=time_limit,
                    progress=progress,
                ),
            )
    if output is not None:
        write_exposure_plan(output, plan)
    if measuring_plan is not None and sensor is not None:
        write_plan(measuring_plan, plan.measuring_plan(sensor, name=measuring_plan.stem))
    return Result(
        title=_answer(plan),
        facts=_facts(plan, candidates),
        tables=(plan.view_table, plan.table, *curve),
        notes=(*plan.notes, *exposures.notes(limits, sensor), *_without_poses(plan, output)),
        files=files,
    )


def _budget(goal: Goal, budget: int | None, budget_s: float | None) -> tuple[Goal, float | None]:
    """Return the goal that goes with a budget, and the budget in captures or ms."""
    if budget is not None and budget_s is not None:
        msg = "give --budget or --budget-s, not both"
        raise UsageError(msg)
    if budget is not None and goal == "time":
        msg = "--budget counts captures; with --goal time give seconds: --budget-s"
        raise UsageError(msg)
    if budget_s is not None:
        return "time", 1000.0 * budget_s
    return goal, None if budget is None else float(budget)


def _files(
    models: Sequence[Path], output: Path | None, measuring_plan: Path | None
) -> tuple[Written, ...]:
    """Return what is to be written, checked before anything that takes time."""
    files = []
    for path, kind, suffix in (
        (output, "exposure plan", ".json"),
        (measuring_plan, "measuring plan", ".toml"),
    ):
        if path is not None:
            if path.suffix.lower() != suffix:
                msg = f"the {kind} is a {suffix} file; got the name {path.name}"
                raise UsageError(msg)
            files.append(Written.at(path, kind, inputs=models))
    return tuple(files)


def _answer(plan: ExposurePlan) -> str:
    """Return what to take and who fails, in a line."""
    failing = who_fails(plan.features) if plan.views else ""
    return "; ".join(filter(None, (plan.verdict, failing)))


def _without_poses(plan: ExposurePlan, output: Path | None) -> tuple[str, ...]:
    unknown = [view.name for view in plan.views if view.camera_from_part is None]
    if output is None or not unknown:
        return ()
    return (
        f"{output} does not tell where {counted(len(unknown), 'view')} are: plan with the views "
        "of a measuring plan or a campaign for measure and next",
    )


def _facts(plan: ExposurePlan, candidates: CandidateViews) -> tuple[Fact, ...]:
    promise, limits = plan.promise, plan.limits
    n_views = candidates.frame["view"].n_unique()
    tried = len(plan.features) - len(plan.with_status("not planned"))
    time_s = plan.time_ms / 1000.0
    return (
        fact(
            "captures", plan.n_captures, f"{plan.n_captures}, {plan.proof}" if plan.views else "0"
        ),
        fact("time_s", time_s, number(time_s)),
        fact(
            "views_to_choose_from", n_views, f"{counted(n_views, 'view')}, from {candidates.source}"
        ),
        fact(
            "expected",
            promise.expected_covered,
            f"{number(promise.expected_covered, 4)} of {counted(tried, 'feature')} tried, "
            f"{number(promise.expected_misses, 2)} to be missed; the chance that none is: "
            f"{math.floor(1000.0 * promise.chance_of_all) / 10.0:g} % or more"
            if plan.views
            else "",
        ),
        fact("promise", promise, ""),
        fact("certificate", plan.certificate, ""),
        fact("goal", plan.goal, ""),
        fact("confidence", plan.confidence, ""),
        fact("need", plan.target_p_norm, ""),
        fact("budget", plan.budget, ""),
        fact("limits", limits.name, f"{limits.name}, {limits.source}" if limits.source else None),
    )
