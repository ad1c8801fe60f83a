"""``exposight compare``: strategies on views whose every outcome is known."""

import runpy
from dataclasses import replace
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter
from cyclopts.types import PositiveInt
from cyclopts.validators import Number

from exposight.cell import CampaignFolder
from exposight.cli.app import UsageError
from exposight.cli.result import Result, Written, fact
from exposight.cli.terminal import progress_bars
from exposight.errors import ExposightError, FormatError, InputError, MissingFileError
from exposight.files import make_folder
from exposight.measuring import measure_observations
from exposight.models import MODEL_SUFFIX, P_NORM_MIN, Predictor, WindowModel, load_model
from exposight.observing import ObservationTable, observe_campaign, read_observations
from exposight.planning import (
    CONFIDENCE,
    Comparison,
    SensorModels,
    Sweep,
    compare,
    limits_named,
    read_comparison,
    write_comparison,
)
from exposight.planning.comparing.strategies import STRATEGIES
from exposight.plans import plan_preset
from exposight.report import write_comparison_page
from exposight.tables import counted
from exposight.twin import SimulatedCell
from exposight.workers import Progress, usual_workers

_SIMULATED = "sweep"
"""Plan of the simulated sweep, and the stem of its table."""


def compare_command(
    *models: Path,
    sweep: Annotated[Path | None, Parameter(metavar="CAMPAIGN|TABLE")] = None,
    simulated: bool = False,
    strategies: Annotated[
        tuple[str, ...], Parameter(metavar="NAME...", consume_multiple=True)
    ] = (),
    add: Annotated[tuple[Path, ...], Parameter(metavar="FILE.py...", consume_multiple=True)] = (),
    results_of_others: Annotated[
        tuple[Path, ...], Parameter("--with", metavar="RESULTS.json...", consume_multiple=True)
    ] = (),
    rehearse: Annotated[Path | None, Parameter(metavar="CAMPAIGN|TABLE")] = None,
    need: Annotated[float, Parameter(validator=Number(gt=0, lte=1))] = P_NORM_MIN,
    confidence: Annotated[float, Parameter(validator=Number(gt=0, lt=1))] = CONFIDENCE,
    limits: Annotated[str | None, Parameter(metavar="NAME|FILE")] = None,
    output: Annotated[Path, Parameter(alias="-o")] = Path("comparison"),
    workers: PositiveInt | None = None,
) -> Result:
    r"""Compare ways to choose exposure times on views whose every outcome is known.

    Each view of a sweep was captured at many exposure times, so that what any choice of them would
    have given is known. Every strategy measures every view: it is scored by the share of features
    that it covers, and by the captures and trial images that it takes for one of an oracle that
    knows all outcomes. docs/benchmark.md says how a method of one's own is added.

    For example:

        exposight compare models/ --simulated -o comparison

        exposight compare models/ --sweep door.csv --strategies open_loop geometric_3 \
          --add my_method.py

    Parameters
    ----------
    models
        Models to plan with: their folder, quality.exposight-model, or two of the paper's; several
        may be given. None of them may have learnt from the sweep.
    sweep
        Captures of each view at many exposure times: a campaign, or its table, .csv or .parquet.
    simulated
        Take 30 views of the simulated cell at 33 exposure times; simulated once into the output
        folder, where an interrupted run goes on.
    strategies
        Which to compare; all by default.
    add
        Python files that register strategies of your own, which are compared with the others.
    results_of_others
        Results that others got on the same sweep, to be shown beside.
    rehearse
        Choose the constants of strategies without models on these views; by default in hindsight on
        those compared, which is generous to them.
    need
        Quality that each feature shall reach, p_norm.
    confidence
        Chance that each feature shall have, of strategies with models.
    limits
        Only exposure times that a sensor can be set to, and as many a view as it takes: a profile's
        name or a TOML file (docs/formats.md).
    output
        Folder for results.json, results.csv and comparison.html.
    workers
        Simulate in this many processes.
    """
    if (sweep is None) != simulated:
        msg = "give either --sweep, a campaign or table of many exposure times, or --simulated"
        raise UsageError(msg)
    names = _added(add) + (strategies or tuple(STRATEGIES))
    pairs = models_from(models)
    if not pairs and strategies and any(_forecasts(name) for name in strategies):
        msg = f"{', '.join(filter(_forecasts, strategies))} plan with models: give some first"
        raise UsageError(msg)
    others = [read_comparison(path) for path in results_of_others]
    files = tuple(
        Written.at(output / name, kind, inputs=(*models, sweep, rehearse))
        for name, kind in (
            ("results.json", "results"),
            ("results.csv", "scores"),
            ("comparison.html", "page"),
        )
    )
    bounds = None if limits is None else limits_named(limits)
    kept = output / f"{_SIMULATED}.parquet"
    reused = simulated and kept.is_file()
    with progress_bars(kept_in=output if simulated else None) as progress:
        table = (
            _table_of(sweep, progress)
            if sweep is not None
            else _simulated(kept, workers or usual_workers(), progress)
        )
        name = _SIMULATED if sweep is None else sweep.stem
        compared = Sweep.of(table, name=name, need=need, limits=bounds)
        rehearsal, found = None, table.contradictions
        if rehearse is not None:
            views = _table_of(rehearse, progress)
            found = tuple(dict.fromkeys((*found, *views.contradictions)))
            rehearsal = Sweep.of(views, name=rehearse.stem, need=need, limits=bounds)
        comparison = compare(
            compared,
            names,
            models=pairs,
            rehearsal=rehearsal,
            limits=bounds,
            confidence=confidence,
            progress=progress,
        )
    learnt = _learnt_from(table, pairs)
    if learnt:
        about = {**comparison.about, "learnt_from_this_sweep": learnt}
        comparison = replace(comparison, about=about)
    for other in others:
        comparison = comparison.with_others(other)
    write_comparison(comparison, output)
    write_comparison_page(comparison, output / "comparison.html")
    return Result(
        title="; ".join((*learnt, comparison.verdict)),
        facts=(
            fact("sweep", comparison.sweep),
            fact("views", len(compared.views)),
            fact("pairs", compared.pairs, f"{compared.pairs} of feature and view can be covered"),
            fact("constants", comparison.about["constants"]),
            fact("sweep_sha256", comparison.sweep_sha256, ""),
            fact("verdict", comparison.verdict, ""),
        ),
        tables=(comparison.table,),
        notes=(*learnt, *_notes(comparison, table, kept if reused else None)),
        contradictions=found,
        files=files,
    )


def models_from(paths: tuple[Path, ...]) -> tuple[SensorModels, ...]:
    """Return the pairs of models in files and folders; of the paper's two files make a pair.

    Raises
    ------
    InputError
        If files do not make pairs.
    FileError
        If one cannot be read.
    """
    pairs = [SensorModels.load(path) for path in paths if path.is_dir()]
    files = [path for path in paths if not path.is_dir()]
    for path in files:
        if path.suffix != MODEL_SUFFIX:
            msg = f"{path}: expected a model, {MODEL_SUFFIX}; observations are given by --sweep"
            raise FormatError(msg)
    loaded: list[Predictor] = [load_model(path) for path in files]
    alone = [model for model in loaded if model.kind == "window"]
    pairs += [SensorModels(quality=model) for model in alone]
    left = [model for model in loaded if model not in alone]
    exposures = [model for model in left if model.target == "exposure_ms"]
    qualities = [model for model in left if model.target == "p_norm"]
    if (qualities or exposures) and not (qualities and len(exposures) == 1):
        got = ", ".join(f"{model.name} ({model.target})" for model in left)
        msg = f"expected quality models and one exposure-time model for them, got {got}"
        raise InputError(msg)
    return (*pairs, *(SensorModels(quality=each, exposure=exposures[0]) for each in qualities))


def _forecasts(name: str) -> bool:
    return name in STRATEGIES and STRATEGIES[name].kind == "model"


def _added(paths: tuple[Path, ...]) -> tuple[str, ...]:
    """Run files that register strategies, and return the names of these."""
    before = set(STRATEGIES)
    for path in paths:
        if not path.is_file():
            msg = f"{path}: no such Python file"
            raise MissingFileError(msg)
        known = set(STRATEGIES)
        try:
            runpy.run_path(str(path))
        except ExposightError:
            raise
        except Exception as error:
            msg = f"{path} cannot be run: {type(error).__name__}: {error}"
            raise InputError(msg) from error
        if known == set(STRATEGIES):
            msg = f"{path} registers no strategy: decorate a function with @strategy(name, title)"
            raise InputError(msg)
    return tuple(name for name in STRATEGIES if name not in before)


def _table_of(path: Path, progress: Progress) -> ObservationTable:
    if path.is_dir():
        return observe_campaign(CampaignFolder(path), progress=progress)
    return read_observations(path)


def _simulated(path: Path, workers: int, progress: Progress) -> ObservationTable:
    """Return the simulated sweep's table, from its file if it is there."""
    if path.is_file():
        return read_observations(path)
    plan = plan_preset(_SIMULATED)
    make_folder(path.parent, "the comparison")
    cell = SimulatedCell.for_plan(plan, rings_only=True)
    return measure_observations(plan, cell, table_path=path, workers=workers, progress=progress)


def _notes(
    comparison: Comparison,
    table: ObservationTable,
    reused: Path | None,
) -> tuple[str, ...]:
    notes = []
    if comparison.about["constants"] == "in hindsight":
        notes.append(
            "constants of strategies without models were chosen in hindsight on these views, which "
            "is generous to them; --rehearse chooses them on others"
        )
    if bool(table.measured().frame["emulated"].any()):
        notes.append("emulated exposures are among the observations")
    if reused is not None:
        notes.append(f"{reused} was there and is used; remove it to simulate anew")
    return tuple(notes)


def _learnt_from(table: ObservationTable, pairs: tuple[SensorModels, ...]) -> tuple[str, ...]:
    """Say of each model that has learnt from the sweep that its scores tell nothing."""
    rings = table.measured().frame.unique(["feature", "view"], maintain_order=True)
    out = []
    for model in (pair.quality for pair in pairs):
        n = int(model.has_learnt(rings).sum()) if isinstance(model, WindowModel) else 0
        if n:
            what = f"{n} of {counted(rings.height, 'ring')} of this sweep"
        elif table.sha256 is not None and model.provenance.observations_sha256 == table.sha256:
            what = "this very table"
        else:
            continue
        out.append(f"{model.name} has learnt from {what}, so that its scores tell nothing")
    return tuple(out)
