"""``exposight propose``: the capture that would tell most of what is to be measured."""

import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
import polars as pl
from cyclopts import Group, Parameter
from cyclopts.types import PositiveInt

from exposight.cli.app import UsageError
from exposight.cli.candidate_views import (
    CandidateViews,
    candidate_views,
    is_plan,
    settable_exposures,
)
from exposight.cli.result import Fact, Result, Written, fact
from exposight.errors import InputError, SensorError
from exposight.models import (
    MODEL_SUFFIX,
    QUALITY,
    CaptureProposer,
    WindowModel,
    load_model,
    save_model,
)
from exposight.observing import ObservationTable, read_observations
from exposight.plans import write_plan
from exposight.tables import Column, Table, count, counted, number

_LEAST_GAIN = 0.03
"""Share of the uncertainty that a capture must take away to be worth it."""

_SHOWN_VIEWS = 12
_NAMED_CAPTURES = 4

_COLUMNS = (
    Column(name="view"),
    Column(name="exposure_ms"),
    Column(name="rings", decimals=1),
    Column(name="error_before", label="before\n%", digits=3, scale=100.0),
    Column(name="error_after", label="after\n%", digits=3, scale=100.0),
)


@Parameter("*", group=Group("What could be captured", sort_key=2))
@dataclass(frozen=True, kw_only=True)
class CandidateOptions:
    """Views, exposure times and what shall be known.

    Parameters
    ----------
    views
        Views that could be captured: a measuring plan (a name or a file), a campaign with its plan,
        or an observation table.
    exposures
        Exposure times, FIRST:LAST or one by one, ms; over the sensor's whole range by default.
    features
        With a plan: the part's features, CSV (docs/formats.md), in place of those of its scene.
    targets
        Views whose rings shall be known, in the same forms; those of --views by default.
    again
        Propose views of --captured, and views proposed before, once more.
    """

    views: Annotated[str, Parameter(metavar="PLAN|CAMPAIGN|TABLE")]
    exposures: Annotated[
        tuple[str, ...], Parameter(metavar="FIRST:LAST|MS...", consume_multiple=True)
    ] = ()
    features: Path | None = None
    targets: Annotated[str | None, Parameter(metavar="PLAN|CAMPAIGN|TABLE")] = None
    again: bool = False

    def read(self) -> tuple[CandidateViews, CandidateViews]:
        """Return what could be captured, and what shall be known.

        Raises
        ------
        UsageError
            If features are given where none are asked for.
        ExposightError
            If one of them cannot be used.
        """
        plans = is_plan(self.views), is_plan(self.targets or self.views)
        if self.features is not None and not any(plans):
            msg = f"--features goes with a measuring plan; {self.views} names its features itself"
            raise UsageError(msg)
        views = candidate_views(self.views, self.features)
        if self.targets is None:
            return views, views
        return views, candidate_views(self.targets, self.features)


def propose_command(
    model_file: Annotated[Path, Parameter("MODEL")],
    /,
    *,
    captured: Annotated[
        tuple[Path, ...], Parameter(metavar="TABLE...", consume_multiple=True)
    ] = (),
    number_of_captures: Annotated[PositiveInt, Parameter("--count")] = 1,
    output: Annotated[Path | None, Parameter(alias="-o", metavar="MODEL")] = None,
    next_plan: Annotated[Path | None, Parameter(metavar="PLAN")] = None,
    options: CandidateOptions,
) -> Result:
    r"""Name the capture that would tell most of what is to be measured.

    The default models know how bright every ring is, and how sure that is. Of all views and
    exposure times that could be captured, this names the one that leaves least uncertain. What was
    captured meanwhile is learnt without a new fit.

    For example:

        exposight propose models --views small --count 3 --next-plan next.toml

        exposight propose models --views door --captured first.csv next.csv

    Parameters
    ----------
    model_file
        quality.exposight-model that train wrote, or its folder.
    captured
        Observations taken since the model was trained, .csv or .parquet.
    number_of_captures
        Propose so many captures, each the best after those before it.
    output
        Write the model that has learnt from --captured to this file.
    next_plan
        Write what is proposed as a measuring plan, .toml, for simulate and measure.
    """
    model_file = model_file / f"{QUALITY}{MODEL_SUFFIX}" if model_file.is_dir() else model_file
    files = _files(model_file, captured, output, next_plan)
    model = _quality_model(model_file)
    candidates, targets = options.read()
    if next_plan is not None and not candidates.poses:
        msg = f"--next-plan needs to know where views are, which {options.views} does not tell"
        raise UsageError(msg)
    _check_sensor(model, candidates)
    times_ms = settable_exposures(options.exposures, candidates.sensor or model.sensor)
    learnt: tuple[Fact, ...] = ()
    left, notes = candidates, []
    if captured:
        table = _captured(model, captured)
        left = candidates if options.again else candidates.without(table.frame["view"])
        notes += _known_before(model, table)
        model, learnt = _learnt(model, table)
    proposer = CaptureProposer.of(model, left.frame, times_ms, targets=targets.frame)
    captures, reason = _worth_it(proposer.sequence(number_of_captures, again=options.again))
    if output is not None:
        save_model(output, model)
    if next_plan is not None and captures.height:
        write_plan(next_plan, candidates.plan_of(captures))
    else:
        files = tuple(file for file in files if file.kind != "measuring plan")
        if next_plan is not None:
            left_there = "; the one that is there is an older one" if next_plan.exists() else ""
            notes.append(f"nothing is proposed, so {next_plan} was not written{left_there}")
    notes += model.remarks(left.frame)
    if 0 < captures.height < number_of_captures:
        notes.append(f"after {counted(captures.height, 'capture')} {reason}")
    n_views = len(proposer.views)
    return Result(
        title=_answer(proposer, captures),
        facts=(
            fact("captures", captures.to_dicts(), ""),
            *learnt,
            fact("views", n_views, f"{count(n_views)}, from {options.views}"),
            fact(
                "exposures_ms",
                times_ms,
                f"{len(times_ms)}, {number(min(times_ms))} to {number(max(times_ms))}",
            ),
            _target_fact(proposer),
        ),
        tables=_tables(captures, proposer.ranking()),
        notes=tuple(notes),
        files=files,
    )


# -- the model, and what was captured -----------------------------------------------------------


def _quality_model(path: Path) -> WindowModel:
    model = load_model(path)
    if isinstance(model, WindowModel):
        return model
    msg = (
        f"{path}: proposals need the default quality model, which knows how surely rings' "
        f"brightness follows from their poses; got {model.name} ({model.title}). Train it: "
        f"exposight train OBSERVATIONS, then give {QUALITY}{MODEL_SUFFIX}"
    )
    raise InputError(msg)


def _captured(model: WindowModel, paths: Sequence[Path]) -> ObservationTable:
    """Read what was captured since a model was trained."""
    tables = list(map(read_observations, paths))
    for path, table in zip(paths, tables, strict=True):
        if table.sha256 == model.provenance.observations_sha256:
            msg = f"{path}: {model.name} was trained on it; give what was captured since"
            raise InputError(msg)
    return ObservationTable.concat(tables)


def _known_before(model: WindowModel, table: ObservationTable) -> list[str]:
    rings, _ = model.radiance.rings(table.measured().frame)
    known = int(np.count_nonzero(model.radiance.learnt.knows(rings)))
    if known == 0:
        return []
    return [
        f"{model.name} has learnt from {count(known)} of the {counted(len(rings), 'ring')} in "
        "--captured before; captures that it knows already count twice"
    ]


def _learnt(model: WindowModel, table: ObservationTable) -> tuple[WindowModel, tuple[Fact, ...]]:
    """Return the model that has learnt from captures, too, and what to say of that."""
    start = time.perf_counter()
    model = model.with_observations(table)
    seconds = time.perf_counter() - start
    captures = table.frame.select("view", "exposure_ms").n_unique()
    text = (
        f"{counted(captures, 'capture')}, {counted(len(table.measured()), 'measured row')}, in "
        f"{number(1000 * seconds, 2)} ms without a new fit"
    )
    return model, (fact("learnt", captures, text), fact("learning_s", seconds, ""))


def _check_sensor(model: WindowModel, candidates: CandidateViews) -> None:
    sensor = candidates.sensor
    if sensor is not None and model.sensor is not None and sensor.name != model.sensor.name:
        msg = (
            f"{candidates.source} is of sensor {sensor.name!r}, {model.name} was trained on "
            f"{model.sensor.name!r}; train a model for it, or give views of that sensor"
        )
        raise SensorError(msg)


# -- the answer ---------------------------------------------------------------------------------


def _worth_it(captures: pl.DataFrame) -> tuple[pl.DataFrame, str]:
    """Return the captures before the first that tells next to nothing, and why no more."""
    gain = 1.0 - captures["error_after"] / captures["error_before"]
    enough = (gain >= _LEAST_GAIN).to_list()
    if False in enough:
        return captures.head(enough.index(False)), "these views tell next to nothing more"
    return captures, "no view is left; --again captures some once more"


_WELL_KNOWN = 0.1
"""Uncertainty of ln brightness that is small beside a window of exposure times, a factor of four or
more."""


def _percent(error: float) -> str:
    return f"{number(100.0 * error, 2)} %"


def _answer(proposer: CaptureProposer, captures: pl.DataFrame) -> str:
    if captures.height == 0:
        worst = float(proposer.target_std.max())
        if worst > _WELL_KNOWN:
            return (
                "these views would tell next to nothing more: brightness of the least known target "
                f"stays uncertain by {_percent(worst)}"
            )
        return (
            "nothing more to learn from these views: every target's brightness is known to "
            f"{_percent(worst)} already"
        )
    named = [
        f"{view} at {number(exposure_ms)} ms"
        for view, exposure_ms in captures.select("view", "exposure_ms").iter_rows()
    ]
    after = captures["error_after"][-1]
    change = f"the uncertainty of brightness from {_percent(proposer.error)} to {_percent(after)}"
    if captures.height == 1:
        rings = counted(round(captures["rings"][0]), "ring")
        return f"capture view {named[0]}: it measures {rings} and takes {change}"
    listed = ", ".join(named[:_NAMED_CAPTURES]) + (" …" if len(named) > _NAMED_CAPTURES else "")
    return f"capture {listed}: together they take {change}"


def _target_fact(proposer: CaptureProposer) -> Fact:
    std, least = proposer.target_std, int(np.argmax(proposer.target_std))
    place = int(proposer.targets[least])
    ring = f"{proposer.rings.features[place]} in {proposer.rings.views[place]}"
    text = f"{counted(len(std), 'ring')}; the least known, {ring}, to {_percent(std[least])}"
    value = {"rings": len(std), "error": proposer.error, "largest_error": float(std[least])}
    return fact("targets", value, text)


def _tables(captures: pl.DataFrame, ranking: pl.DataFrame) -> tuple[Table, ...]:
    """Return the sequence, or the best views for the next capture; how all rank is for machines."""
    shown = Table(
        name="best_views",
        frame=ranking.head(_SHOWN_VIEWS),
        columns=_COLUMNS,
        title=f"The best capture of each view{_first(ranking.height)}",
    )
    if captures.height > 1:
        shown = Table(
            name="sequence",
            frame=captures.with_row_index("step", offset=1),
            columns=(Column(name="step"), *_COLUMNS),
            title="One after the other",
        )
    return shown, Table(name="ranking", frame=ranking, columns=(), shown_rows=0)


def _first(n_views: int) -> str:
    return f", the first {_SHOWN_VIEWS} of {count(n_views)}" if n_views > _SHOWN_VIEWS else ""


def _files(
    model_file: Path, captured: Sequence[Path], output: Path | None, next_plan: Path | None
) -> tuple[Written, ...]:
    """Return what is to be written, checked before anything that takes time."""
    inputs, files = (model_file, *captured), []
    if output is not None:
        if not captured:
            msg = "--output writes the model that has learnt from --captured; give that, too"
            raise UsageError(msg)
        if output.suffix != MODEL_SUFFIX:
            msg = f"--output writes a model file, *{MODEL_SUFFIX}; got the name {output.name}"
            raise UsageError(msg)
        files.append(Written.at(output, "model", inputs=inputs))
    if next_plan is not None:
        if next_plan.suffix.lower() != ".toml":
            msg = f"--next-plan writes TOML; got the name {next_plan.name}"
            raise UsageError(msg)
        files.append(Written.at(next_plan, "measuring plan", inputs=inputs))
    return tuple(files)
