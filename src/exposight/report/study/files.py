"""The study's output: the page, every table as CSV, every figure as PNG and SVG."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import polars as pl

from exposight.files.durable import write_durably
from exposight.paper import study_figures, table_csv
from exposight.report.study.figures import drawn_figures
from exposight.report.study.page import study_report

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from exposight.paper import (
        DatasetRow,
        HyperparameterRow,
        ScoreRow,
        StudyResult,
    )

    Row = DatasetRow | HyperparameterRow | ScoreRow


@dataclass(frozen=True, kw_only=True)
class StudyFiles:
    """What was written.

    Parameters
    ----------
    report : Path
        The page.
    tables : tuple of Path
        CSV files.
    figures : tuple of Path
        PNG and SVG files.
    """

    report: Path
    tables: tuple[Path, ...]
    figures: tuple[Path, ...]


def write_study(
    folder: str | Path,
    result: StudyResult,
    progress: Callable[[str, int, int], None] | None = None,
) -> StudyFiles:
    """Write a study's report, tables and figures; what is there is replaced.

    Parameters
    ----------
    folder : path
        Is made if it does not exist.
    result : StudyResult
        The study.
    progress : callable, optional
        Called with (stage, done, total).

    Raises
    ------
    FileError
        If a file cannot be written.
    """
    folder = Path(folder)
    tell = progress or _silent
    figures = study_figures(result, lambda done, n: tell("computing the figures", done, n))
    drawn = drawn_figures(result, figures, lambda done, n: tell("drawing the figures", done, n))
    tell("writing the report", 0, 1)
    tables = _write_tables(folder / "tables", result)
    pictures = []
    (folder / "figures").mkdir(parents=True, exist_ok=True)
    for own in drawn:
        for suffix, data in (("png", own.still.png), ("svg", own.still.svg)):
            path = folder / "figures" / f"figure-{own.number:02d}.{suffix}"
            write_durably(path, data)
            pictures.append(path)
    report = folder / "report.html"
    write_durably(report, study_report(result, drawn, figures).encode())
    tell("writing the report", 1, 1)
    return StudyFiles(report=report, tables=tables, figures=tuple(pictures))


def _write_tables(folder: Path, result: StudyResult) -> tuple[Path, ...]:
    folder.mkdir(parents=True, exist_ok=True)
    tables = result.tables
    contents: dict[str, Sequence[Row]] = {
        f"table-{number}": [row for row in tables.scores if row.table == number]
        for number in sorted({row.table for row in tables.scores})
    }
    contents["table-8"] = tables.hyperparameters
    contents["table-9"] = tables.datasets
    texts = {name: table_csv(rows) for name, rows in contents.items()}
    findings = pl.DataFrame([asdict(own) for own in result.findings], infer_schema_length=None)
    texts["findings"] = findings.write_csv().encode()
    paths = []
    for name, text in texts.items():
        paths.append(folder / f"{name}.csv")
        write_durably(paths[-1], text)
    return tuple(paths)


def _silent(_stage: str, _done: int, _total: int) -> None:
    """Tell nobody."""
