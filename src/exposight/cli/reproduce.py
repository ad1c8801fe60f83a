"""``exposight reproduce``: the paper's study, in the simulated cell or on recorded campaigns."""

from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import polars as pl
from cyclopts import Parameter

from exposight.cli.result import Result, Written, fact
from exposight.cli.terminal import progress_bars
from exposight.errors import FileError, MissingFileError
from exposight.paper import StudyResult, StudySettings, run_study
from exposight.report import write_study
from exposight.tables import Column, Table
from exposight.workers import usual_workers

_SHOWN = (
    ("q_k1", "test"),
    ("q_k4", "test"),
    ("e_k1", "test"),
    ("e_k6", "test_inside"),
    ("e_k6_lin", "validation"),
    ("q_k4_s2", "test_inside"),
    ("e_k6_s2", "test_inside"),
)
"""Lines of Tables 2, 3 and 5 that tell most."""

_SETTINGS = StudySettings(workers=usual_workers())


def reproduce_command(
    *,
    output: Annotated[Path, Parameter(alias="-o")] = Path("paper"),
    settings: Annotated[StudySettings, Parameter("*")] = _SETTINGS,
) -> Result:
    """Repeat the paper's study and compare it with the published numbers.

    Measures the paper's datasets in a simulated cell (or reads recorded ones), trains its models,
    and writes report.html with its tables and figures beside the paper's. What is measured or
    trained is kept: run it again after an interruption and it goes on. The same seed gives the same
    report, to the last byte.

    For example:

        exposight reproduce --quick -o paper

    Parameters
    ----------
    output
        Folder for the report, tables, figures, observations and models.
    """
    _check_folders(output, settings.campaigns)
    with progress_bars(kept_in=output) as progress:
        result = run_study(output, settings, progress)
        written = write_study(output, result, progress)
    holds = [finding.holds for finding in result.findings]
    judged = len(holds) - holds.count(None)
    simulated = settings.campaigns is None
    return Result(
        facts=(
            *(fact(name, value, "") for name, value in asdict(settings).items()),
            fact("simulated", simulated, ""),
            fact("campaigns", result.campaigns, ""),
            fact("findings", [asdict(finding) for finding in result.findings], ""),
            fact("findings_true", holds.count(True), f"{holds.count(True)} of {judged} hold here"),
            fact("findings_false", holds.count(False), ""),
            fact("findings_open", holds.count(None)),
        ),
        tables=(_scores(result),),
        notes=("the numbers are the simulated cell's, not those of the authors' sensors and door",)
        if simulated
        else (),
        files=(
            Written(kind="report", path=written.report, replaced=False),
            Written(kind="tables", path=written.tables[0].parent, replaced=False),
            Written(kind="figures", path=written.figures[0].parent, replaced=False),
        ),
    )


def _check_folders(output: Path, campaigns: Path | None) -> None:
    """Find out now, not after minutes of work, that a folder cannot be used."""
    if output.exists() and not output.is_dir():
        msg = f"{output}: the output must be a folder, and this is a file; name another with -o"
        raise FileError(msg)
    if campaigns is not None and not campaigns.is_dir():
        msg = (
            f"{campaigns}: no such folder of campaigns; expected one that holds campaign folders "
            "or observation tables, such as inside or inside.csv (docs/the-paper.md)"
        )
        raise MissingFileError(msg)


def _scores(result: StudyResult) -> Table:
    frame = result.tables.scores
    lines = pl.DataFrame(_SHOWN, schema=["variant", "role"], orient="row")
    frame = lines.join(frame, on=["variant", "role"], maintain_order="left").filter(
        pl.col("table").is_in([2, 3, 5])
    )
    return Table(
        name="scores",
        frame=frame,
        columns=(
            Column(name="variant", label="model"),
            Column(name="role", label="data", wraps=True),
            Column(name="n"),
            Column(name="r2_percent", label="R² %\nhere", decimals=1),
            Column(name="paper_r2_percent", label="R² %\npaper", decimals=1),
            Column(name="rmse", label="RMSE\nhere", digits=3),
            Column(name="paper_rmse", label="RMSE\npaper", digits=3),
            Column(name="unit"),
        ),
        title="Scores on unseen features, beside the paper's",
    )
