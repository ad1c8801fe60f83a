"""``exposight recommend``: which exposures to take of a view, and which features will fail."""

from pathlib import Path
from typing import Annotated

import polars as pl
from cyclopts import Parameter
from cyclopts.validators import Number

from exposight.cli.app import UsageError
from exposight.cli.exposure_options import ExposureOptions
from exposight.cli.forecast import ViewOptions, read_trial
from exposight.cli.picture_files import check_picture, write_picture
from exposight.cli.result import Fact, Result, Written, fact
from exposight.files import csv_of, write_durably
from exposight.models import WindowModel
from exposight.planning import CONFIDENCE, Prefer, Recommendation, SensorModels, check_confidence
from exposight.planning.outlook_table import who_fails
from exposight.tables import Column, Table, counted, number

_NO_VIEW = ViewOptions()
_USUAL = ExposureOptions()
_EXPOSURE_COLUMNS = (
    Column(name="order", label="take"),
    Column(name="exposure_ms"),
    Column(name="set_value", label="set to", digits=8),
    Column(name="set_unit", label=""),
    Column(name="covers", wraps=True),
)


def recommend_command(
    *models: Path,
    need: Annotated[float | None, Parameter(validator=Number(gt=0, lte=1))] = None,
    target: Annotated[str, Parameter(metavar="COLUMN")] = "p_norm",
    at_most: Annotated[float | None, Parameter(validator=Number(gt=0))] = None,
    at_least: Annotated[float | None, Parameter(validator=Number(gt=0))] = None,
    confidence: float = CONFIDENCE,
    prefer: Prefer = "margin",
    trial: Annotated[Path | None, Parameter(metavar="TABLE|CAMPAIGN")] = None,
    csv: Annotated[Path | None, Parameter(alias="-o")] = None,
    picture: Path | None = None,
    view: ViewOptions = _NO_VIEW,
    exposures: ExposureOptions = _USUAL,
) -> Result:
    r"""Recommend the exposures of a view, and name the features that will fail.

    The fewest exposure times that bring every feature which the sensor sees from a pose to the
    quality that is needed, with the confidence asked, in settings that the sensor can take. What
    cannot be brought there is served as well as may be, and named with the reason.

    For example:

        exposight recommend models/ --campaign door --view middle-x1-y1

        exposight recommend models/ --campaign door --view middle-x1-y1 --flicker 50 \
          --picture exposures.png

        exposight recommend models/ --campaign door --view middle-x1-y1 \
          --target diameter_error_mm --at-most 0.05

        exposight recommend models/ --sensor sensor.json --features features.csv \
          --robot-pose fanuc 12.5,-3,600,0,0,90 --limits zivid-2 --most 3

    Parameters
    ----------
    models
        quality.exposight-model, two model files, one for quality and one for exposure time, or the
        folder that holds them.
    need
        Quality that is asked for, p_norm; 0.75 by default.
    target
        Another quality, for which exposight train --target has trained a model, such as
        diameter_error_mm.
    at_most
        Limit of that quality where lower is better, in its unit; by default the strictest that is
        attained as surely as any.
    at_least
        The same where higher is better.
    confidence
        Chance with which each feature shall have it, between 0 and 1.
    prefer
        Of equally few exposures those that leave most margin, or those that take least time.
    trial
        Observations of this view, .csv or .parquet, or a campaign with captures of it.
    csv
        Write a row for each feature to this CSV file.
    picture
        Draw the features' exposure times and the chosen ones: .png or .svg.
    """
    check_confidence(confidence)
    if picture is not None:
        check_picture(picture)
    sensor_models = SensorModels.load(*models, target=target)
    need = _need(sensor_models, need, at_most, at_least)
    files = tuple(
        Written.at(path, kind, inputs=(*models, trial))
        for path, kind in ((csv, "recommendation"), (picture, "picture"))
        if path is not None
    )
    limits = exposures.exposure_limits(sensor_models.sensor)
    seen = view.seen()
    observed = None if trial is None else read_trial(trial, seen.name)
    recommendation = sensor_models.recommend(
        seen,
        limits,
        exposures.costs,
        need=need,
        confidence=confidence,
        prefer=prefer,
        trial=observed,
    )
    if csv is not None:
        write_durably(csv, csv_of(recommendation.frame))
    if picture is not None:
        from exposight.report import recommendation_picture  # takes seconds to import

        write_picture(picture, recommendation_picture(recommendation))
    return Result(
        title=_answer(recommendation),
        facts=_facts(recommendation),
        tables=(_exposure_table(recommendation), recommendation.table),
        notes=(*recommendation.notes, *exposures.notes(limits, sensor_models.sensor)),
        contradictions=() if observed is None else observed.contradictions,
        files=files,
    )


def _need(
    models: SensorModels, need: float | None, at_most: float | None, at_least: float | None
) -> float | None:
    """Return the quality that is asked for; refuse a limit of the wrong side."""
    given = {"--need": need, "--at-most": at_most, "--at-least": at_least}
    said = [option for option, value in given.items() if value is not None]
    allowed = "--need"
    if models.target != "p_norm" and isinstance(models.quality, WindowModel):
        allowed = "--at-most" if models.quality.window.sign < 0.0 else "--at-least"
    if said and said != [allowed]:
        msg = f"{models.target} is asked for by {allowed}, got {' and '.join(said)}"
        raise UsageError(msg)
    return given[allowed]


def _answer(recommendation: Recommendation) -> str:
    """Return what to take and who fails, in a line."""
    return "; ".join(filter(None, (recommendation.verdict, who_fails(recommendation.features))))


def _facts(recommendation: Recommendation) -> tuple[Fact, ...]:
    chosen = recommendation
    proof = "fewer cannot do it" if chosen.proven else "perhaps fewer can do it"
    limits, n = chosen.limits, len(chosen.features)
    return (
        fact("view", chosen.view, chosen.view),
        fact("exposures_ms", chosen.exposures_ms, ""),
        fact("target", chosen.target, ""),
        fact("need", chosen.need, ""),
        fact("confidence", chosen.confidence, ""),
        fact("prefer", chosen.prefer, ""),
        fact("proven", chosen.proven, ""),
        fact(
            "expected",
            chosen.expected,
            f"{number(chosen.expected, 3)} of {counted(n, 'visible feature')}; {proof}",
        ),
        fact("expected_misses", chosen.expected_misses, ""),
        fact("time_ms", chosen.time_ms, number(chosen.time_ms)),
        fact("limits", limits.name, f"{limits.name}, {limits.source}" if limits.source else None),
        fact("hidden", dict(chosen.hidden), ""),
    )


def _exposure_table(recommendation: Recommendation) -> Table:
    names = [column.name for column in _EXPOSURE_COLUMNS]
    rows = [{name: getattr(each, name) for name in names} for each in recommendation.exposures]
    if not rows:
        return Table(name="exposures", frame=pl.DataFrame(), columns=(), shown_rows=0)
    return Table.of("exposures", rows, _EXPOSURE_COLUMNS)
