"""An exposure plan carried out by a driver, as ``exposight measure`` is told."""

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from shlex import quote
from typing import Annotated, Any

import polars as pl
from cyclopts import Group, Parameter
from cyclopts.validators import Number

from exposight.cell import PRESETS, CampaignFolder, Driver, closing_driver
from exposight.cli.app import UsageError
from exposight.cli.merge import merge_command
from exposight.cli.result import Result, Written, fact
from exposight.cli.terminal import progress_bars
from exposight.errors import SensorError
from exposight.files import parse_toml, read_text
from exposight.measuring import measure_adaptively
from exposight.measuring.adaptive import models_remark
from exposight.measuring.decisions import DECISIONS_FILE, OUTCOMES_FILE
from exposight.planning import ExposurePlan, SensorModels, read_exposure_plan
from exposight.tables import Table, number
from exposight.twin import SimulatedCell, SimulatedCellSettings

EXPOSURE_PLAN_SUFFIX = ".json"
"""Measuring plans are TOML and YAML."""


@Parameter("*", group=Group("With an exposure plan", sort_key=3))
@dataclass(frozen=True, kw_only=True)
class LoopOptions:
    """Who decides in a closed loop, and what the simulated cell is like.

    Parameters
    ----------
    models
        Models that correct the plan by what captures show: quality.exposight-model, two model
        files, or the folder that holds them.
    open_loop
        Take the plan's captures as they are, without corrections.
    cell
        With --driver genicam or rc_visard the cell's file, TOML: its devices and commands, of any
        plan. Of the simulated cell its settings: the keys of a measuring plan's table [simulated]
        (docs/formats.md).
    finish
        Finish of the simulated part: bare, primer, paint, brushed, or one that --cell describes.
    lamp
        Power of the simulated projector's lamp as a share of the nominal one.
    merge
        Merge each view's captures afterwards (exposight merge) into this folder's campaign.
    rings_only
        Simulate only the neighbourhoods of the features' rings, in a fraction of the time.
    """

    models: Annotated[tuple[Path, ...], Parameter(consume_multiple=True)] = ()
    open_loop: bool = False
    cell: Path | None = None
    finish: str | None = None
    lamp: Annotated[float | None, Parameter(metavar="SHARE", validator=Number(gt=0))] = None
    rings_only: bool = False
    merge: Annotated[Path | None, Parameter(metavar="FOLDER")] = None

    @property
    def simulated(self) -> dict[str, Any]:
        """Settings of the simulated cell, as a plan's table has them."""
        table = {} if self.cell is None else dict(_read_toml(self.cell))
        given = {"finish": self.finish, "lamp": self.lamp, "rings_only": self.rings_only}
        return {**table, **{name: value for name, value in given.items() if value}}


NO_LOOP = LoopOptions()


def carry_out_loop(
    path: Path,
    output: Path,
    loop: LoopOptions,
    *,
    driver: Driver | None,
    clouds: bool,
) -> Result:
    """Carry out the exposure plan in a file, and return what became of its features.

    Parameters
    ----------
    path : Path
        The exposure plan.
    output : Path
        Folder of the campaign.
    loop : LoopOptions
        Who decides.
    driver : Driver or None
        Who takes the captures; None for the simulated cell.
    clouds : bool
        Whether clouds are kept.
    """
    if loop.open_loop == bool(loop.models):
        msg = "give --models, which correct the plan, or --open-loop to take it as it is"
        raise UsageError(msg)
    if driver is not None and loop.simulated:
        msg = "--cell, --finish, --lamp and --rings-only are of the simulated cell, not of others"
        raise UsageError(msg)
    if loop.merge is not None and (not clouds or loop.merge.exists()):
        msg = (
            "--merge makes a new campaign of clouds: leave out --no-clouds, and name a folder that "
            f"is not there yet, got {loop.merge}"
        )
        raise UsageError(msg)
    if loop.merge is not None and loop.simulated.get("rings_only"):
        msg = (
            "--merge needs whole clouds, and --rings-only simulates the rings alone: leave one out"
        )
        raise UsageError(msg)
    plan = read_exposure_plan(path)
    models = SensorModels.load(*loop.models) if loop.models else None
    before = len(CampaignFolder(output)) if (output / "campaign.json").is_file() else 0
    files = [
        Written.at(output, "campaign"),
        Written.at(output / DECISIONS_FILE, "decisions"),
        Written.at(output / OUTCOMES_FILE, "outcomes"),
    ]
    made = _simulated_cell(plan, models, loop) if driver is None else driver
    with progress_bars(kept_in=output) as progress, closing_driver(made):
        result = measure_adaptively(
            plan,
            made,
            output,
            models=models,
            clouds=clouds,
            progress=progress,
            tell=lambda decision: progress.line(str(decision)),
        )
    n_features, n_had = len(result.outcomes), len(result.succeeded)
    promised = plan.promise.expected_covered
    remark = models_remark(plan, models.checksums) if models is not None else ""
    told = Result(
        title=result.verdict,
        facts=(
            fact("sensor", plan.sensor),
            fact("captures", len(result.decisions)),
            fact("captures_before", before, number(before) if before else ""),
            fact("features", n_features, ""),
            fact("promised", promised, f"{number(promised, 3)} of {n_features}"),
            fact("achieved", n_had, f"{n_had} of {n_features}"),
            fact("succeeded", result.succeeded, ""),
            fact("failed", result.failed, ""),
        ),
        tables=(
            result.table,
            Table(name="decisions", frame=pl.DataFrame(result.decisions), columns=(), shown_rows=0),
        ),
        notes=tuple(filter(None, (remark,))),
        contradictions=result.contradictions,
        files=tuple(files),
        next_step=f"report {quote(str(output))}",
    )
    if loop.merge is None:
        return told
    if max(Counter(each.view for each in result.decisions).values(), default=0) < 2:
        note = "no view has several captures, so nothing was merged"
        return replace(told, notes=(*told.notes, note))
    merged = merge_command(output, output=loop.merge)
    return replace(
        told,
        facts=(*told.facts, fact("merged", merged.title)),
        tables=(*told.tables, *merged.tables[:-1]),
        notes=(*told.notes, *merged.notes),
        contradictions=tuple(dict.fromkeys((*told.contradictions, *merged.contradictions))),
        files=(*told.files, *merged.files),
    )


def _simulated_cell(
    plan: ExposurePlan, models: SensorModels | None, loop: LoopOptions
) -> SimulatedCell:
    """Return the simulated cell with the plan's sensor, round whose features it is traced."""
    known = [*PRESETS.values(), *([models.sensor] if models and models.sensor else [])]
    sensor = {each.name: each for each in known}.get(plan.sensor)
    if sensor is None:
        msg = (
            f"nobody describes the plan's sensor {plan.sensor!r}: give --models that were trained "
            "on it (exposight train --sensor)"
        )
        raise SensorError(msg)
    folder = None if loop.cell is None else loop.cell.parent
    settings = SimulatedCellSettings.of_table(loop.simulated, folder, str(loop.cell or "options"))
    return SimulatedCell(sensor, settings, features=[each.feature for each in plan.features])


def _read_toml(path: Path) -> Mapping[str, Any]:
    what = "file of the simulated cell's settings in TOML"
    return parse_toml(read_text(path, what), path, what)
