"""The paper's figures, each with its caption: as stills for files, and for the page."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from exposight.models import I_AVG_MIN, P_NORM_MIN
from exposight.paper import (
    BestAndWorst,
    BrightnessCurves,
    CaptureForecast,
    DependenceMatrix,
    ExposureRow,
    KernelExamples,
    LearningCurve,
    PredictionSurfaces,
    TrainingPositions,
)
from exposight.report.markup import escape, figure, fixed, image_tag, model_name, number
from exposight.report.study.observed_plots import (
    brightness_plot,
    exposure_row_plot,
    positions_plot,
)
from exposight.report.study.observed_stills import (
    brightness_still,
    exposure_row_still,
    positions_still,
)
from exposight.report.study.predicted_stills import (
    best_and_worst_still,
    forecast_still,
    kernel_still,
)
from exposight.report.study.statistics_plots import dependence_plot, learning_plot
from exposight.report.study.statistics_stills import dependence_still, learning_still
from exposight.report.study.surface_plots import surfaces_plot
from exposight.report.study.surface_stills import surfaces_still
from exposight.report.study.words import SENSOR_TITLES, measured_in

if TYPE_CHECKING:
    from collections.abc import Callable

    from exposight.paper import FigureData, StudyFigure, StudyResult
    from exposight.report.study.stills import Still


_KERNELS = 5
_SHOWN_SIZE = 0.62
"""Of a still's pixels, so that it stays sharp on screens with more of them."""
_OPEN_MARKS = "Open marks are of unseen features."


@dataclass(frozen=True, kw_only=True, eq=False)
class DrawnFigure:
    """One of the paper's figures, drawn.

    Parameters
    ----------
    number : int
        The paper's.
    title : str
        What it shows, for lists and for who cannot see it.
    still : Still
        As a picture.
    interactive : str
        As a place on the page with its data, HTML; empty where the still says as much.
    caption : str
        HTML: what to see.
    """

    number: int
    title: str
    still: Still
    interactive: str
    caption: str


def drawn_figures(
    result: StudyResult,
    figures: tuple[StudyFigure, ...],
    progress: Callable[[int, int], None] | None = None,
) -> tuple[DrawnFigure, ...]:
    """Draw the figures that have data, in the paper's order.

    Parameters
    ----------
    result : StudyResult
        The study.
    figures : tuple of StudyFigure
        Its figures' arrays.
    progress : callable, optional
        Called with (figures drawn, figures in all).
    """
    drawn = []
    for done, own in enumerate(figures):
        if progress is not None:
            progress(done, len(figures))
        if own.data is not None:
            drawn.append(_with_origin(result, _drawn(own.number, own.data)))
    if progress is not None:
        progress(len(figures), len(figures))
    return tuple(drawn)


def figure_html(own: DrawnFigure) -> str:
    """Return a figure as it stands on the page, under the paper's number."""
    width, height = (round(_SHOWN_SIZE * side) for side in own.still.size)
    content = own.interactive or image_tag(own.still.png, "image/png", own.title, (width, height))
    return figure(own.number, content, own.caption)


def _with_origin(result: StudyResult, own: DrawnFigure) -> DrawnFigure:
    """Name the figure, and say where its observations come from; the kernels' have none."""
    origin = "" if own.number == _KERNELS else f" {measured_in(result)}"
    return replace(own, caption=f"<b>{escape(own.title)}.</b> {own.caption}{origin}")


def _drawn(number_: int, data: FigureData) -> DrawnFigure:
    match data:
        case KernelExamples():
            return _kernels(number_, data)
        case BrightnessCurves():
            return _brightness(number_, data)
        case BestAndWorst():
            return _curves(number_, data)
        case PredictionSurfaces():
            return _surfaces(number_, data)
        case ExposureRow():
            return _row(number_, data)
        case CaptureForecast():
            return _forecast(number_, data)
        case DependenceMatrix():
            return _dependence(number_, data)
        case TrainingPositions():
            return _positions(number_, data)
        case LearningCurve():
            return _learning(number_, data)


def _kernels(number_: int, data: KernelExamples) -> DrawnFigure:
    return DrawnFigure(
        number=number_,
        title="What the choice of a kernel does",
        still=kernel_still(data),
        interactive="",
        caption="The same seven noisy observations of a known function, and what two kernels make "
        "of them. Between the observations both are right; beyond them the band of ±2σ opens, "
        "faster with the rational quadratic, whose correlation near a point falls off faster.",
    )


def _brightness(number_: int, data: BrightnessCurves) -> DrawnFigure:
    chosen = " Here the smallest and the largest feature." if data.sensor == "stereo" else ""
    return DrawnFigure(
        number=number_,
        title=f"Quality over brightness, {SENSOR_TITLES[data.sensor]}",
        still=brightness_still(data),
        interactive=brightness_plot(f"figure-{number_}", data),
        caption=f"All observations of {escape(data.dataset)}, a panel for each feature; a thin "
        "line joins those of one view. The quality rises with the brightness, stays, and falls "
        "where pixels clip; at one brightness it differs between views, so brightness alone "
        "cannot tell it. Dotted: the "
        f"grey level of {I_AVG_MIN:g} below which the models say 0; dashed: the "
        f"{P_NORM_MIN:g} from which on exposure-time models learn.{chosen}",
    )


def _curves(number_: int, data: BestAndWorst) -> DrawnFigure:
    quality = data.target == "p_norm"
    what = "quality" if quality else "exposure time"
    best, worst = (
        " to ".join(
            f"{100 * own.rmse:.3g} %" if quality else f"{own.rmse:.3g} ms"
            for own in (curves[0], curves[-1])
        )
        if curves
        else "none"
        for curves in (data.best, data.worst)
    )
    return DrawnFigure(
        number=number_,
        title=f"Best and worst predictions of the {what}",
        still=best_and_worst_still(data),
        interactive="",
        caption=f"{model_name(data.variant)} on unseen features in {data.judged} views of one "
        f"feature each: above the three with the smallest RMSE ({best}), below those with the "
        f"largest ({worst}). The line is the mean, the band ±2σ for a new observation. "
        f"{_OPEN_MARKS}",
    )


def _surfaces(number_: int, data: PredictionSurfaces) -> DrawnFigure:
    quality = data.target == "p_norm"
    pose = "" if quality else " for a sensor that faces the feature squarely"
    scale = "" if quality else " Each brightness has its own scale."
    what = "quality" if quality else "exposure time"
    return DrawnFigure(
        number=number_,
        title=f"Predicted {what} over the sensor’s field, {SENSOR_TITLES[data.sensor]}",
        still=surfaces_still(data),
        interactive=surfaces_plot(f"figure-{number_}", data),
        caption=f"{model_name(data.variant)}{pose}, at three depths (columns) and three "
        "brightnesses (rows); the menu changes to 2σ of a new observation. Small circles are "
        f"places where the model has learnt near that depth: away from them it extrapolates."
        f"{scale} Point at a place for its numbers.",
    )


def _row(number_: int, data: ExposureRow) -> DrawnFigure:
    first = data.curves[0]
    slopes = [curve.slope_ms for curve in data.curves]
    spread = (
        f"; from place to place the same grey level takes {number(min(slopes))} to "
        f"{number(max(slopes))} ms"
        if len(slopes) > 1
        else ""
    )
    return DrawnFigure(
        number=number_,
        title=f"Exposure time over brightness, {SENSOR_TITLES[data.sensor]}",
        still=exposure_row_still(data),
        interactive=exposure_row_plot(f"figure-{number_}", data),
        caption=f"Feature {escape(first.feature)} at {len(slopes)} "
        f"{'place' if len(slopes) == 1 else 'places'} along x, with "
        f"<i>p</i><sub>norm</sub> ≥ {P_NORM_MIN:g}, in a row of views with "
        f"y ≈ {fixed(first.y_mm, 0)} and z ≈ {fixed(first.z_mm, 0)} mm. "
        f"At one place the exposure time is proportional to the brightness{spread}.",
    )


def _dependence(number_: int, data: DependenceMatrix) -> DrawnFigure:
    return DrawnFigure(
        number=number_,
        title="How strongly the variables depend on each other",
        still=dependence_still(data),
        interactive=dependence_plot(f"figure-{number_}", data),
        caption=f"Maximal information coefficients of the training observations of "
        f"{escape(data.dataset)}: 0 for independent variables, 1 for a function without noise. "
        "Look along the first two rows: what could predict the quality, and the exposure time. "
        "<i>z</i><sub>tcp</sub> is overrated for the exposure time, because each depth has "
        "exposure times of its own.",
    )


def _positions(number_: int, data: TrainingPositions) -> DrawnFigure:
    return DrawnFigure(
        number=number_,
        title="Where the training features stood to the sensor",
        still=positions_still(data),
        interactive=positions_plot(f"figure-{number_}", data),
        caption=f"A point for each feature and view of {escape(data.dataset)}, in the sensor’s "
        "frame. The sensor’s positions make a grid; the features’ own places on the part spread "
        "it. Drag to turn.",
    )


def _forecast(number_: int, data: CaptureForecast) -> DrawnFigure:
    return DrawnFigure(
        number=number_,
        title="One capture: truth and predictions",
        still=forecast_still(data),
        interactive="",
        caption=f"The unseen features of view {escape(data.view)} taken at "
        f"{data.exposure_ms:g} ms: where they stood (rings in true size), the exposure time "
        f"that {model_name(data.exposure_variant)} gives for the brightness they had, and the "
        f"quality that {model_name(data.quality_variant)} expects beside the measured one. Bars "
        "are ±2σ; orange bars and dotted rings: the pose lies outside the range that trained. "
        f"{_OPEN_MARKS}",
    )


def _learning(number_: int, data: LearningCurve) -> DrawnFigure:
    quality = data.variant.startswith("q")
    unit, what = ("%", "quality") if quality else ("ms", "exposure time")
    inside = " inside the range that trained" if data.role == "test_inside" else ""
    return DrawnFigure(
        number=number_,
        title=f"Scores of a model of the {what} over the number of training observations",
        still=learning_still(data, unit),
        interactive=learning_plot(f"figure-{number_}", data, unit),
        caption=f"{model_name(data.variant)} trained on growing random shares of its observations, "
        f"judged by unseen features{inside}. Where the lines turn level, more observations of the "
        "same features do not help.",
    )
