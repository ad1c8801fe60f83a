"""The study's output: the page, every table as CSV, every figure as PNG and SVG."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from exposight.files.durable import write_durably
from exposight.paper import study_figures, table_files
from exposight.report.study.figures import drawn_figures
from exposight.report.study.page import study_report
from exposight.workers import Progress, ignore_progress

if TYPE_CHECKING:
    from exposight.paper import StudyResult


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
    progress: Progress = ignore_progress,
) -> StudyFiles:
    """Write a study's report, tables and figures; what is there is replaced.

    Parameters
    ----------
    folder : path
        Is made if it does not exist.
    result : StudyResult
        The study.
    progress : Progress
        Receives the figures that are computed and drawn.

    Raises
    ------
    FileError
        If a file cannot be written.
    """
    folder = Path(folder)
    figures = study_figures(result, progress)
    drawn = drawn_figures(result, figures, lambda done, n: progress("drawing the figures", done, n))
    progress("writing the report", 0, 1)
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
    progress("writing the report", 1, 1)
    return StudyFiles(report=report, tables=tables, figures=tuple(pictures))


def _write_tables(folder: Path, result: StudyResult) -> tuple[Path, ...]:
    folder.mkdir(parents=True, exist_ok=True)
    paths = []
    for name, text in table_files(result).items():
        paths.append(folder / name)
        write_durably(paths[-1], text)
    return tuple(paths)
