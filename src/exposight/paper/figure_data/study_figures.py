"""All figures of the study as arrays, each from what the study already holds."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, TypeAlias

from exposight.errors import InputError, ObservationError
from exposight.paper.figure_data.curves import (
    BrightnessCurves,
    ExposureRow,
    TrainingPositions,
    extreme_radii,
    feature_positions,
    nearest_row,
    observed_curves,
)
from exposight.paper.figure_data.extreme_predictions import BestAndWorst, best_and_worst
from exposight.paper.figure_data.kernel_example import KernelExamples, kernel_examples
from exposight.paper.figure_data.one_capture import CaptureForecast, capture_forecast
from exposight.paper.figure_data.surfaces import PredictionSurfaces, prediction_surfaces
from exposight.paper.result import DependenceMatrix, LearningCurve

if TYPE_CHECKING:
    from exposight.paper.result import SensorKind, StudyResult


FigureData: TypeAlias = (
    KernelExamples
    | BrightnessCurves
    | BestAndWorst
    | PredictionSurfaces
    | ExposureRow
    | CaptureForecast
    | DependenceMatrix
    | TrainingPositions
    | LearningCurve
)

_LEAST_P_NORM_RANGE = 0.5
"""A quality curve that neither rises nor falls says little about a prediction (Fig. 11)."""


@dataclass(frozen=True, kw_only=True, eq=False)
class StudyFigure:
    """One of the paper's figures.

    Parameters
    ----------
    number : int
        The paper's.
    data : FigureData or None
        What it shows; None where the study has no observations or no model for it.
    reason : str
        Why it has none; else empty.
    """

    number: int
    data: FigureData | None
    reason: str = ""


def study_figures(
    result: StudyResult, progress: Callable[[int, int], None] | None = None
) -> tuple[StudyFigure, ...]:
    """Compute the arrays of Figs. 5, 10–17 and 20–26, those of the study's sensors.

    Parameters
    ----------
    result : StudyResult
        The study; its models are asked, none is trained.
    progress : callable, optional
        Called with (figures done, figures in all).

    Returns
    -------
    tuple of StudyFigure
        By number.
    """
    wanted: dict[int, Callable[[], FigureData]] = {5: kernel_examples}
    if "structured-light" in result.settings.sensors:
        wanted |= _structured_light(result)
    if "stereo" in result.settings.sensors:
        wanted |= _stereo(result)
    figures: list[StudyFigure] = []
    for number, compute in sorted(wanted.items()):
        if progress is not None:
            progress(len(figures), len(wanted))
        figures.append(_figure(number, compute))
    if progress is not None:
        progress(len(figures), len(wanted))
    return tuple(figures)


def _figure(number: int, compute: Callable[[], FigureData]) -> StudyFigure:
    try:
        return StudyFigure(number=number, data=compute())
    except (InputError, ObservationError) as error:
        # A recorded campaign need not have what every figure shows; the others still can be.
        return StudyFigure(number=number, data=None, reason=str(error))


def _structured_light(result: StudyResult) -> dict[int, Callable[[], FigureData]]:
    kind: SensorKind = "structured-light"
    return {
        10: lambda: BrightnessCurves(
            sensor=kind, dataset="X", curves=observed_curves(result.dataset("X").table)
        ),
        11: lambda: best_and_worst(
            "q_k4",
            result.rung("q_k4").model,
            "X_test",
            result.dataset("X_test").table,
            least_range=_LEAST_P_NORM_RANGE,
        ),
        12: partial(_surfaces, result, "q_k4", kind),
        13: partial(_exposure_row, result, "eX", kind),
        14: lambda: best_and_worst(
            "e_k6",
            result.rung("e_k6").model,
            "eX_test",
            result.dataset("eX_test").table,
            inside_only=True,
        ),
        15: lambda: capture_forecast(
            ("q_k4", result.rung("q_k4").model),
            ("e_k6", result.rung("e_k6").model),
            result.dataset("X_test").table,
        ),
        20: partial(_dependence, result, "X"),
        21: lambda: TrainingPositions(
            dataset="X", features=feature_positions(result.dataset("X").table)
        ),
        22: partial(_learning_curve, result, "q_k4"),
        23: partial(_learning_curve, result, "e_k6"),
        24: partial(_surfaces, result, "e_k6", kind),
    }


def _stereo(result: StudyResult) -> dict[int, Callable[[], FigureData]]:
    kind: SensorKind = "stereo"
    return {
        16: lambda: BrightnessCurves(
            sensor=kind,
            dataset="s2_X",
            curves=extreme_radii(observed_curves(result.dataset("s2_X").table)),
        ),
        17: partial(_exposure_row, result, "s2_eX", kind),
        25: partial(_surfaces, result, "q_k4_s2", kind),
        26: partial(_surfaces, result, "e_k6_s2", kind),
    }


def _surfaces(result: StudyResult, rung: str, sensor: SensorKind) -> PredictionSurfaces:
    return prediction_surfaces(rung, result.rung(rung).model, sensor)


def _exposure_row(result: StudyResult, dataset: str, sensor: SensorKind) -> ExposureRow:
    curves = observed_curves(result.dataset(dataset).table)
    return ExposureRow(sensor=sensor, dataset=dataset, curves=nearest_row(curves))


def _dependence(result: StudyResult, dataset: str) -> DependenceMatrix:
    for own in result.dependence:
        if own.dataset == dataset:
            return own
    msg = f"the study has no dependence matrix of {dataset}, which Fig. 20 shows"
    raise InputError(msg)


def _learning_curve(result: StudyResult, rung: str) -> LearningCurve:
    for own in result.learning_curves:
        if own.rung == rung:
            return own
    msg = f"the study has no learning curve of {rung}, which Figs. 22 and 23 show"
    raise InputError(msg)
