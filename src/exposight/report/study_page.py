"""The paper's study as files: one page, every table as CSV, every figure as PNG and SVG."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from exposight import paper
from exposight.files import make_folder, write_durably
from exposight.models import I_AVG_MIN, P_NORM_MIN
from exposight.report import study_observed, study_predicted
from exposight.report.figures import Still
from exposight.report.rendering import render_page
from exposight.workers import Progress, ignore_progress

_SENSOR_TITLES = {"structured-light": "structured-light sensor", "stereo": "active stereo sensor"}
_DRAWING, _WRITING = "drawing the figures", "writing the report"


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


@dataclass(frozen=True, kw_only=True, eq=False)
class DrawnFigure:
    """One of the paper's figures, drawn.

    Parameters
    ----------
    number : int
        The paper's.
    data : FigureData
        What it shows; the page's template words its caption.
    still : Still
        The picture.
    """

    number: int
    data: paper.FigureData
    still: Still

    @property
    def kind(self) -> str:
        """What it shows: the name of the data's class."""
        return type(self.data).__name__


def write_study(
    folder: str | Path, result: paper.StudyResult, progress: Progress = ignore_progress
) -> StudyFiles:
    """Write a study's report, tables and figures; what is there is replaced.

    Parameters
    ----------
    folder : path
        Is made if it does not exist.
    result : StudyResult
        The study.
    progress : Progress
        Receives what is done.

    Raises
    ------
    FileError
        If a file cannot be written.
    """
    folder = make_folder(Path(folder))
    figures = paper.study_figures(result, progress)
    drawn = draw_figures(figures, progress)
    progress(_WRITING, 0, 1)
    tables = _write_all(folder / "tables", paper.table_files(result))
    pictures = _write_all(
        folder / "figures",
        {
            f"figure-{figure.number:02d}.{suffix}": data
            for figure in drawn
            for suffix, data in (("png", figure.still.png), ("svg", figure.still.svg))
        },
    )
    report = folder / "report.html"
    write_durably(report, study_page(result, drawn, figures).encode())
    progress(_WRITING, 1, 1)
    return StudyFiles(report=report, tables=tables, figures=pictures)


def _write_all(folder: Path, contents: dict[str, bytes]) -> tuple[Path, ...]:
    make_folder(folder)
    for name, data in contents.items():
        write_durably(folder / name, data)
    return tuple(folder / name for name in contents)


def draw_figures(
    figures: Sequence[paper.StudyFigure], progress: Progress = ignore_progress
) -> tuple[DrawnFigure, ...]:
    """Draw the figures that have data, in their order."""
    drawn = []
    for done, figure in enumerate(figures):
        progress(_DRAWING, done, len(figures))
        if figure.data is not None:
            still = _draw(f"figure-{figure.number}", figure.data)
            drawn.append(DrawnFigure(number=figure.number, data=figure.data, still=still))
    progress(_DRAWING, len(figures), len(figures))
    return tuple(drawn)


def _draw(name: str, data: paper.FigureData) -> Still:
    match data:
        case paper.KernelExamples():
            return study_predicted.kernel_still(name, "What the choice of a kernel does", data)
        case paper.BrightnessCurves():
            title = f"Quality over brightness, {_SENSOR_TITLES[data.sensor]}"
            return study_observed.brightness_still(name, title, data)
        case paper.BestAndWorst():
            title = f"Best and worst predictions of the {_target(data.target)}"
            return study_predicted.best_and_worst_still(name, title, data)
        case paper.PredictionSurfaces():
            title = f"Predicted {_target(data.target)} over the sensor’s field"
            return study_predicted.surfaces_still(
                name, f"{title}, {_SENSOR_TITLES[data.sensor]}", data
            )
        case paper.ExposureRow():
            title = f"Exposure time over brightness, {_SENSOR_TITLES[data.sensor]}"
            return study_observed.exposure_row_still(name, title, data)
        case paper.CaptureForecast():
            return study_predicted.forecast_still(name, "One capture: truth and predictions", data)
        case paper.DependenceMatrix():
            title = "How strongly the variables depend on each other"
            return study_observed.dependence_still(name, title, data)
        case paper.TrainingPositions():
            title = "Where the training features stood to the sensor"
            return study_observed.positions_still(name, title, data)
        case paper.LearningCurve():
            target = _target("p_norm" if data.variant.startswith("q") else "exposure_ms")
            title = f"Scores of a model of the {target} over the number of training observations"
            return study_observed.learning_still(name, title, data)


def _target(column: str) -> str:
    return "quality" if column == "p_norm" else "exposure time"


def study_page(
    result: paper.StudyResult,
    drawn: Sequence[DrawnFigure],
    figures: Sequence[paper.StudyFigure] = (),
) -> str:
    """Return the study's report as one self-contained HTML page; the same study, same page.

    Parameters
    ----------
    result : StudyResult
        The study.
    drawn : sequence of DrawnFigure
        Its figures, in their order.
    figures : sequence of StudyFigure
        All that were asked for; of those without data the page says why.
    """
    simulated = result.settings.campaigns is None
    where = "in a simulated measuring cell" if simulated else "on recorded campaigns"
    return render_page(
        "study.html",
        title="The paper’s study: point-cloud quality and exposure time, predicted",
        lead="“Exposure time and point cloud quality prediction for active 3D imaging sensors "
        f"using Gaussian process regression”, the paper’s study {where}. Tables and figures have "
        "the paper’s numbers.",
        result=result,
        simulated=simulated,
        sensor_titles=_SENSOR_TITLES,
        scores=list(result.tables.scores.iter_rows(named=True)),
        hyperparameters=list(result.tables.hyperparameters.iter_rows(named=True)),
        datasets=list(result.tables.datasets.iter_rows(named=True)),
        figures=drawn,
        left_out=[figure for figure in figures if figure.data is None],
        facts=_facts(result),
        command=_command(result),
        good=P_NORM_MIN,
        dark=I_AVG_MIN,
    )


def _facts(result: paper.StudyResult) -> list[tuple[str, str]]:
    settings = result.settings
    origin = "simulated"
    if settings.campaigns is not None:
        origin = f"recorded, read from the folder {settings.campaigns.name}"
    return [
        ("sensors", ", ".join(settings.sensors)),
        ("study", "quick" if settings.quick else "whole"),
        ("seed", f"{settings.seed} (splits, starts of the optimiser, learning curves)"),
        ("campaigns", origin),
        ("exposure-time models", f"learn from observations of p_norm ≥ {P_NORM_MIN:g}"),
    ]


def _command(result: paper.StudyResult) -> str:
    settings = result.settings
    words = ["exposight reproduce -o FOLDER"]
    if len(settings.sensors) == 1:
        words.append(f"--sensor {settings.sensors[0]}")
    if settings.quick:
        words.append("--quick")
    if settings.campaigns is not None:
        words.append("--campaigns CAMPAIGNS")
    words.append(f"--seed {settings.seed}")
    return " ".join(words)
