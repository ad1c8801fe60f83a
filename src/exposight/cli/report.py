"""``exposight report``: one page of a campaign or table, and of what models make of it."""

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from exposight.cli.result import Result, Written, fact
from exposight.cli.terminal import progress_bars
from exposight.planning import ModelScores
from exposight.report import write_campaign_report


def report_command(
    source: Annotated[Path, Parameter("CAMPAIGN|TABLE")],
    /,
    *models: Path,
    output: Annotated[Path, Parameter(alias="-o")] = Path("report"),
    mesh: Path | None = None,
) -> Result:
    """Write a page about a campaign and models.

    The page shows which features are measured well at which exposure time, one view in full and,
    with models, how well they predict. It opens without a network.

    For example:

        exposight report door models/quality.exposight-model -o door-report

    Parameters
    ----------
    source
        A campaign's folder, or an observation table, .csv or .parquet.
    models
        Model files that train wrote; they are evaluated on the campaign or table.
    output
        Folder for report.html.
    mesh
        The part's surface in its own frame, in mm: STL, PLY or OBJ.
    """
    file = Written.at(output / "report.html", "report", inputs=(source, *models))
    with progress_bars() as progress:
        report, _ = write_campaign_report(source, models, output, mesh=mesh, progress=progress)
    scores = ModelScores(evaluations=tuple(result.evaluation for result in report.results))
    summary = report.summary
    return Result(
        title=report.title,
        facts=(
            fact("features", len(summary.features)),
            fact("views", summary.views),
            fact("captures", summary.captures),
            fact("observations", len(report.table)),
        ),
        tables=(scores.table,) if report.results else (),
        notes=scores.remarks,
        contradictions=report.table.contradictions,
        files=(file,),
    )
