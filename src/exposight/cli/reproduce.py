"""``exposight reproduce``: the paper's study, in the simulated cell or on recorded campaigns."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from types import SimpleNamespace as Row
from typing import TYPE_CHECKING, Annotated

import typer

from exposight.cli.output import (
    JsonOption,
    count,
    note,
    number,
    print_json,
    print_line,
    print_table,
    progress_bars,
)
from exposight.errors import FileError, MissingFileError, did_you_mean
from exposight.paper import SENSOR_KINDS, SensorKind, StudySettings, run_study
from exposight.report.study import write_study
from exposight.workers import usual_workers

if TYPE_CHECKING:
    from exposight.paper import StudyResult
    from exposight.report.study import StudyFiles

_CORES = usual_workers()
_DEFAULTS = StudySettings()

_SHOWN = (
    ("q_k1", "test"),
    ("q_k4", "test"),
    ("e_k1", "test"),
    ("e_k6", "test_inside"),
    ("e_k6_lin", "test_inside"),
    ("q_k4_s2", "test_inside"),
    ("e_k6_s2", "test_inside"),
)
"""Lines of Tables 2, 3 and 5 that tell most."""
_ROLES = {"test": "unseen features", "test_inside": "unseen, inside trained range"}


_BOTH = "both"

_Output = Annotated[
    Path,
    typer.Option(
        "--output",
        "-o",
        metavar="FOLDER",
        help="Where report, tables, figures, observations and models are written and kept.",
    ),
]
_Sensor = Annotated[
    str,
    typer.Option(
        metavar="NAME",
        help=f"Which of the paper's sensors: {', '.join(SENSOR_KINDS)} or {_BOTH}.",
    ),
]
_Quick = Annotated[
    bool,
    typer.Option(
        "--quick", help="A share of the views where many are planned, and one start for each fit."
    ),
]
_Campaigns = Annotated[
    Path | None,
    typer.Option(
        metavar="FOLDER",
        help="Recorded campaigns or observation tables instead of the simulated cell "
        "(docs/the-paper.md says which names).",
    ),
]
_Seed = Annotated[int, typer.Option(min=0, help="Of splits and of the optimiser's starts.")]
_Workers = Annotated[int, typer.Option(min=1, help="Processes that work at the same time.")]


def reproduce_command(
    output: _Output = Path("paper"),
    sensor: _Sensor = _BOTH,
    quick: _Quick = False,
    campaigns: _Campaigns = None,
    seed: _Seed = _DEFAULTS.seed,
    workers: _Workers = _CORES,
    as_json: JsonOption = False,
) -> None:
    """Repeat the paper's study, and hold it against the published numbers.

    Measures the paper's datasets in a simulated cell (or reads recorded ones),
    trains its model variants, and writes report.html with its tables and
    figures beside the paper's. What is measured or trained is kept: run it
    again after an interruption and it goes on. The same seed gives the same
    report, to the last byte.

    For example:

      exposight reproduce --quick -o paper
    """
    _check_folders(output, campaigns)
    settings = StudySettings(
        sensors=_sensors(sensor), quick=quick, seed=seed, workers=workers, campaigns=campaigns
    )
    with progress_bars(keep=True, time_left=True) as progress:
        try:
            result = run_study(output, settings, progress)
            written = write_study(output, result, progress)
        except KeyboardInterrupt as error:
            msg = (
                f"stopped by Ctrl-C; what was measured or trained is kept in {output}, and the "
                "same command goes on"
            )
            raise KeyboardInterrupt(msg) from error
    if as_json:
        print_json(_document(result, written))
    else:
        _print(result, written)


def _sensors(name: str) -> tuple[SensorKind, ...]:
    """Return the study's sensors that a name stands for."""
    kinds = tuple(kind for kind in SENSOR_KINDS if name in {kind, _BOTH})
    if not kinds:
        known = (*SENSOR_KINDS, _BOTH)
        msg = f"expected one of {', '.join(known)}, got {name!r}{did_you_mean(name, known)}"
        raise typer.BadParameter(msg, param_hint="--sensor")
    return kinds


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


def _document(result: StudyResult, written: StudyFiles) -> dict[str, object]:
    judged = [own.holds for own in result.findings]
    return {
        "sensors": result.settings.sensors,
        "quick": result.settings.quick,
        "seed": result.settings.seed,
        "simulated": result.settings.campaigns is None,
        "campaigns": result.campaigns,
        "scores": result.tables.scores.rows(named=True),
        "findings": [asdict(own) for own in result.findings],
        "findings_true": judged.count(True),
        "findings_false": judged.count(False),
        "findings_open": judged.count(None),
        "report": written.report,
        "tables": written.tables,
        "figures": written.figures,
    }


def _print(result: StudyResult, written: StudyFiles) -> None:
    rows = [
        _cells(row)
        for variant, role in _SHOWN
        for row in (Row(**cells) for cells in result.tables.scores.iter_rows(named=True))
        if (row.variant, row.role) == (variant, role) and row.table in {2, 3, 5}
    ]
    print_line("")
    print_table(
        ("model", "judged by", "n", "R² %\nhere", "R² %\npaper", "RMSE\nhere", "RMSE\npaper"),
        rows,
        title="Scores on unseen features, beside the paper's",
        words=("judged by",),
    )
    judged = [own.holds for own in result.findings]
    left = judged.count(None)
    print_line("")
    print_line(
        f"{judged.count(True)} of {len(judged) - left} statements of the paper hold here"
        + (f"; {left} cannot be said" if left else "")
    )
    if result.settings.campaigns is None:
        note("the numbers are the simulated cell's, not those of the authors' sensors and door")
    print_line(f"report:  {written.report}")
    print_line(f"tables:  {written.tables[0].parent} ({len(written.tables)} CSV files)")
    print_line(
        f"figures: {written.figures[0].parent} ({len(written.figures) // 2}, as PNG and SVG)"
    )


def _cells(row: Row) -> tuple[str, ...]:
    return (
        row.variant,
        _ROLES[row.role],
        count(row.n),
        _fixed(row.r2_percent),
        _fixed(row.paper_r2_percent),
        f"{number(row.rmse, 3)} {row.unit}",
        f"{number(row.paper_rmse, 3)} {row.unit}",
    )


def _fixed(value: float | None) -> str:
    return "–" if value is None else f"{value:.1f}".replace("-", "−")
