"""What models are asked: forecasts, recommendations and plans, as JSON and as the library's calls.

Each question computes what the library does for the same input; its answer holds the same numbers.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, Literal

from pydantic import ConfigDict, Field

from exposight.errors import InputError, LockedError
from exposight.files import hold_writer_lock, write_durably
from exposight.geometry import RigidTransform
from exposight.models import MODEL_SUFFIX, P_NORM_MIN, WindowModel
from exposight.planning import (
    CONFIDENCE,
    ExposureLimits,
    ExposurePlan,
    Forecast,
    Recommendation,
    SensorModels,
    plan,
)
from exposight.planning.outlook_table import who_fails
from exposight.service.bodies import (
    POSE,
    ExposureWishes,
    PartAndSensor,
    Posed,
    Unit,
    Viewed,
)
from exposight.service.faults import RequestError
from exposight.service.folder import ServedFolder
from exposight.service.guard import Limits
from exposight.service.loop_questions import LOOPS
from exposight.service.runs import RUNS

_SPARE_S = 5.0
"""Of a request's time that a plan's search leaves to forecasts."""

_NAMES_TAKEN = frozenset(
    {"campaign.json", "capture.json", "sensor.json", "part.json", "run.json", "state.json"}
)
"""Names, in lower case, by which other things are known; a plan of one would pass for them."""

_MODELS = Field(
    max_length=255,
    description="Folder with models, or a model file, in the served folder.",
    examples=["models"],
)
_CONFIDENCE = Field(
    default=CONFIDENCE,
    gt=0,
    lt=1,
    description="Chance with which each feature shall have the quality.",
    examples=[0.9],
)


class ForecastQuestion(Viewed):
    """What quality to expect of every feature that a pose sees, over exposure time."""

    model_config = ConfigDict(
        json_schema_extra={
            "examples": [{"models": "models", "campaign": "campaign", "camera_from_part": POSE}]
        }
    )

    models: str = _MODELS
    at_least: float = Field(
        default=P_NORM_MIN, gt=0, le=1, description="Quality that is asked for, p_norm."
    )
    confidence: float = _CONFIDENCE
    exposures_ms: list[float] | None = Field(
        default=None,
        min_length=1,
        max_length=10_000,
        description="Exposure times to look at, ms; settings from too short to too long for all "
        "features by default.",
        examples=[[5.0, 10.0, 20.0]],
    )
    unit: Unit | None = Field(default=None, description="Unit of set_values; ms by default.")

    def answer(self, folder: ServedFolder, limits: Limits) -> dict[str, Any]:
        """Return the forecast."""
        if self.exposures_ms is not None and len(self.exposures_ms) > limits.exposures:
            msg = f"{len(self.exposures_ms)} exposure times; up to {limits.exposures} are taken"
            raise RequestError(413, msg)
        models = folder.models(self.models)
        view = self.seen(folder, limits)
        forecast = models.forecast(view, self.exposures_ms, need=self.at_least)
        hidden = {
            each.feature.name: each.visibility.value
            for each in view.features
            if each not in view.visible
        }
        return forecast_document(forecast, self.confidence, hidden, self.unit or "ms")


def forecast_document(
    forecast: Forecast, confidence: float, hidden: dict[str, str], unit: Unit
) -> dict[str, Any]:
    """Return a forecast as JSON has it: a row for each feature, an entry for each exposure time."""
    times = forecast.exposures_ms
    shown = ExposureLimits(
        name="shown", min_ms=min(times), max_ms=max(times), increment_ms=1.0, unit=unit
    )
    over_time = {
        name: getattr(forecast, name).tolist()
        for name in ("p_norm", "p_norm_low", "p_norm_high", "chance", "brightness")
    }
    likely = (forecast.chance >= confidence).sum(axis=0).tolist()
    wanted = forecast.wanted_ms.tolist()
    return {
        "best_exposure_ms": forecast.best_exposure_ms(),
        "verdict": forecast.verdict,
        "at_least": forecast.need,
        "confidence": confidence,
        "exposures_ms": list(times),
        "set_values": [shown.set_value(each) for each in times],
        "set_unit": unit,
        "n_features_with_confidence": likely,
        "features": [
            {
                "feature": name,
                "known": not forecast.unknown[i],
                "unknown": forecast.unknown[i],
                "source": forecast.source[i],
                "wanted_ms": wanted[i],
                **{key: values[i] for key, values in over_time.items()},
            }
            for i, name in enumerate(forecast.features)
        ],
        "hidden": hidden,
        "notes": list(forecast.notes),
    }


class RecommendQuestion(Viewed, ExposureWishes):
    """Which exposures to take of a view, and which features will fail."""

    model_config = ConfigDict(
        json_schema_extra={
            "examples": [
                {
                    "models": "models",
                    "campaign": "campaign",
                    "camera_from_part": POSE,
                    "confidence": 0.9,
                    "unit": "us",
                }
            ]
        }
    )

    models: str = _MODELS
    target: str = Field(
        default="p_norm",
        max_length=100,
        description="Another quality for which there is a model, such as diameter_error_mm.",
    )
    at_least: float | None = Field(
        default=None, gt=0, description="Quality that is asked for; of p_norm 0.75 by default."
    )
    at_most: float | None = Field(
        default=None, gt=0, description="The same where lower is better, in the quality's unit."
    )
    confidence: float = _CONFIDENCE
    prefer: Literal["margin", "time"] = Field(
        default="margin",
        description="Of equally few exposures those that leave most margin, or take least time.",
    )

    def answer(self, folder: ServedFolder, limits: Limits) -> dict[str, Any]:
        """Return the recommendation."""
        models = folder.models(self.models, self.target)
        need = self._need(models)
        settable = self.exposure_limits(models.sensor)
        view = self.seen(folder, limits)
        return recommendation_document(
            models.recommend(
                view,
                settable,
                self.costs(),
                need=need,
                confidence=self.confidence,
                prefer=self.prefer,
            )
        )

    def _need(self, models: SensorModels) -> float | None:
        """Return the quality that is asked for; refuse a limit of the wrong side."""
        lower_is_better = (
            self.target != "p_norm"
            and isinstance(models.quality, WindowModel)
            and models.quality.window.sign < 0.0
        )
        given, other = self.at_least, self.at_most
        allowed = "at_least"
        if lower_is_better:
            given, other, allowed = other, given, "at_most"
        if other is not None:
            msg = f"{self.target} is asked for by {allowed}"
            raise InputError(msg)
        if self.target == "p_norm" and given is not None and given > 1.0:
            msg = f"at_least is a p_norm, above 0 and up to 1, got {given:g}"
            raise InputError(msg)
        return given


def recommendation_document(chosen: Recommendation) -> dict[str, Any]:
    """Return a recommendation as JSON has it."""
    return {
        "verdict": "; ".join(filter(None, (chosen.verdict, who_fails(chosen.features)))),
        "view": chosen.view,
        "exposures_ms": chosen.exposures_ms,
        "exposures": [vars(each) for each in chosen.exposures],
        "features": [vars(each) for each in chosen.features],
        "hidden": dict(chosen.hidden),
        "expected": chosen.expected,
        "expected_misses": chosen.expected_misses,
        "proven": chosen.proven,
        "time_ms": chosen.time_ms,
        "target": chosen.target,
        "need": chosen.need,
        "confidence": chosen.confidence,
        "prefer": chosen.prefer,
        "limits": chosen.limits.name,
        "notes": chosen.notes,
    }


class PlannedView(Posed):
    """A view that may be taken."""

    name: str = Field(min_length=1, max_length=255, description="Its name.", examples=["left"])


class PlanQuestion(PartAndSensor, ExposureWishes):
    """Which exposures to take in which views of a part."""

    model_config = ConfigDict(
        json_schema_extra={
            "examples": [
                {
                    "models": "models",
                    "campaign": "campaign",
                    "views": [{"name": "front", "camera_from_part": POSE}],
                },
                {"models": "models", "campaign": "campaign", "save_as": "plans/new.json"},
            ]
        }
    )

    models: str = _MODELS
    views: list[PlannedView] | None = Field(
        default=None,
        min_length=1,
        description="Views to choose from; those of the campaign by default.",
    )
    goal: Literal["count", "time"] = Field(
        default="count", description="Fewest captures, or least time."
    )
    at_least: float = Field(
        default=P_NORM_MIN, gt=0, le=1, description="Quality that is asked for, p_norm."
    )
    confidence: float = _CONFIDENCE
    budget: int | None = Field(
        default=None, ge=1, le=100_000, description="Most features with at most so many captures."
    )
    budget_s: float | None = Field(
        default=None, gt=0, le=1e6, description="Most features in at most so many seconds."
    )
    expected_misses: float | None = Field(
        default=None,
        gt=0,
        description="So many features at most shall be expected to fail, in place of confidence.",
    )
    prefer: Literal["margin", "time"] = Field(
        default="margin", description="Among the fewest captures most margin, or least time."
    )
    move_ms: float = Field(
        default=0.0, ge=0, le=1e9, description="What the robot takes to a view, ms."
    )
    time_limit_s: float = Field(
        default=20.0,
        gt=0,
        description="Seconds after which the best plan until then is given, with its gap.",
    )
    save_as: str | None = Field(
        default=None,
        max_length=255,
        description="Write the plan to this new file in the served folder, .json.",
        examples=["plans/new.json"],
    )

    def answer(self, folder: ServedFolder, limits: Limits) -> dict[str, Any]:
        """Return the plan, and write it if that is asked for."""
        path = None if self.save_as is None else _new_plan(folder, self.save_as)
        models = folder.models(self.models)
        part, sensor = self.part_and_sensor(folder, limits)
        goal, budget = self._budget()
        planned = plan(
            models,
            part,
            self._views(folder, limits),
            sensor=sensor,
            limits=self.exposure_limits(sensor),
            costs=self.costs(self.move_ms),
            at_least=self.at_least,
            confidence=self.confidence,
            goal=goal,
            budget=budget,
            expected_misses=self.expected_misses,
            prefer=self.prefer,
            time_limit_s=min(self.time_limit_s, max(1.0, limits.request_s - _SPARE_S)),
        )
        if path is not None:
            folder.make_parent(path)
            _write_new(path, planned, self.save_as or "")
        return {
            "verdict": planned.verdict,
            "n_captures": planned.n_captures,
            "plan": json.loads(planned.to_json()),
            "saved_as": self.save_as,
            "notes": planned.notes,
        }

    def _views(self, folder: ServedFolder, limits: Limits) -> dict[str, RigidTransform]:
        if self.views is None:
            if self.campaign is None:
                msg = "give views, or a campaign whose views are meant"
                raise InputError(msg)
            views = dict(folder.view_poses(self.campaign))
        else:
            views = {each.name: each.pose() for each in self.views}
            if len(views) < len(self.views):
                msg = "two views have the same name"
                raise InputError(msg)
        if len(views) > limits.views:
            msg = f"{len(views)} views; up to {limits.views} are taken at once"
            raise RequestError(413, msg)
        return views

    def _budget(self) -> tuple[Literal["count", "time"], float | None]:
        if self.budget is not None and self.budget_s is not None:
            msg = "give budget or budget_s, not both"
            raise InputError(msg)
        if self.budget is not None and self.goal == "time":
            msg = "budget counts captures; with the goal time give budget_s"
            raise InputError(msg)
        if self.budget_s is not None:
            return "time", 1000.0 * self.budget_s
        return self.goal, None if self.budget is None else float(self.budget)


def _new_plan(folder: ServedFolder, name: str) -> Path:
    """Return where a plan is to be written, where nothing is yet."""
    if not name.lower().endswith(".json"):
        msg = f"an exposure plan is a .json file; got the name {name!r}"
        raise InputError(msg)
    path = folder.new(name, "exposure plan")
    if reason := _not_for_plans(folder, path):
        msg = f"{name!r} cannot hold an exposure plan: {reason}; name one such as plans/new.json"
        raise InputError(msg)
    if path.exists():
        raise _taken(name)
    return path


def _not_for_plans(folder: ServedFolder, path: Path) -> str:
    """Return why a place belongs to something else than plans; empty where it does not."""
    steps = folder.name_of(path).lower().split("/")
    if len(steps) > 1 and steps[0] in {LOOPS, RUNS}:
        return f"{steps[0]}/ is the server's"
    if any(each.startswith(".") for each in steps):
        return "what begins with a dot is not listed"
    if steps[-1] in _NAMES_TAKEN:
        return f"{steps[-1]} is the name of something else"
    for parent in path.parents:
        if not parent.is_relative_to(folder.root):
            break
        if (parent / "campaign.json").exists():
            return "it is within a campaign"
        if parent != folder.root and any(parent.glob(f"*{MODEL_SUFFIX}")):
            return "it is among models"
    return ""


def _write_new(path: Path, planned: ExposurePlan, name: str) -> None:
    """Write a plan where nothing is, also where another client has chosen the name meanwhile."""
    try:
        lock = hold_writer_lock(path.parent, f"the plan {name}", f".{path.name}.lock")
    except LockedError as error:
        raise RequestError(409, f"{name!r} is being written by another client") from error
    try:
        if path.exists():
            raise _taken(name)
        write_durably(path, planned.to_json().encode())
    finally:
        lock.release()
        Path(lock.lock_file).unlink(missing_ok=True)


def _taken(name: str) -> RequestError:
    return RequestError(409, f"{name!r} is there already; give another name")
