"""The paper's figures as arrays, each from what the study already holds: Figs. 5, 10–17, 20–26."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from exposight.errors import InputError, ObservationError
from exposight.gp import Kernel, RationalQuadratic, SquaredExponential, fit
from exposight.paper import predictions
from exposight.paper.observed_curves import (
    BrightnessCurves,
    ExposureRow,
    TrainingPositions,
    extreme_radii,
    feature_positions,
    nearest_row,
    observed_curves,
)
from exposight.paper.prediction_surfaces import PredictionSurfaces, prediction_surfaces
from exposight.paper.results import DependenceMatrix, LearningCurve, StudyResult
from exposight.paper.study_settings import SensorKind
from exposight.workers import Progress, ignore_progress

_OBSERVATIONS = 7
_NOISE = 0.05
"""Standard deviation of the observations; the paper does not print it."""
_LOW, _HIGH = 0.0, 1.2
"""Where the observations lie; so close that seven show the function's turns."""
_DRAWN = (-0.4, 1.8)
_LENGTH_SCALE = 0.3
_ALPHA = 0.3
"""Fixed: fitted, it grows until the rational quadratic is a squared exponential. Table 8's quality
models have 0.004 to 0.39."""
_SEED = 1
_SAMPLES = 261


@dataclass(frozen=True, kw_only=True, eq=False)
class KernelExample:
    """One kernel's regression of f(x) = x·sin(2πx).

    Parameters
    ----------
    kernel : str
        What it is called.
    x, truth, mean, std : (m,) ndarray
        Where it is drawn, the function, the prediction and its standard deviation, noise left
        out: of the function, not of a new observation.
    x_train, y_train : (7,) ndarray
        The observations.
    """

    kernel: str
    x: NDArray[np.float64]
    truth: NDArray[np.float64]
    mean: NDArray[np.float64]
    std: NDArray[np.float64]
    x_train: NDArray[np.float64]
    y_train: NDArray[np.float64]


@dataclass(frozen=True, kw_only=True, eq=False)
class KernelExamples:
    """Both kernels on the same observations (Fig. 5)."""

    examples: tuple[KernelExample, ...]


def kernel_examples() -> KernelExamples:
    """Return the paper's two examples: squared exponential, rational quadratic."""
    x = np.linspace(_LOW, _HIGH, _OBSERVATIONS, dtype=np.float64)
    noise = np.random.default_rng(_SEED).normal(0.0, _NOISE, x.shape)
    y = example_function(x) + noise
    squared = SquaredExponential(variance=1.0, length_scales=(_LENGTH_SCALE,), dims=(0,))
    rational = RationalQuadratic(
        variance=1.0, length_scales=(_LENGTH_SCALE,), alpha=_ALPHA, dims=(0,), fixed=("alpha",)
    )
    return KernelExamples(
        examples=(
            _example("squared exponential", squared, x, y),
            _example(f"rational quadratic, α = {_ALPHA:g}", rational, x, y),
        )
    )


def example_function(x: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return f(x) = x·sin(2πx) (Sect. 2.2.2)."""
    return np.asarray(x * np.sin(2 * np.pi * x), dtype=np.float64)


def _example(
    name: str, kernel: Kernel, x: NDArray[np.float64], y: NDArray[np.float64]
) -> KernelExample:
    fitted = fit(
        kernel,
        x[:, None],
        y,
        rng=np.random.default_rng(_SEED),
        noise_variance=_NOISE**2,
        first_start="given",
        restarts=1,
    )
    drawn = np.linspace(*_DRAWN, _SAMPLES, dtype=np.float64)
    prediction = fitted.process.predict(drawn[:, None], include_noise=False)
    return KernelExample(
        kernel=name,
        x=drawn,
        truth=example_function(drawn),
        mean=prediction.mean,
        std=prediction.std,
        x_train=x,
        y_train=y,
    )


FigureData: TypeAlias = (
    KernelExamples
    | BrightnessCurves
    | predictions.BestAndWorst
    | PredictionSurfaces
    | ExposureRow
    | predictions.CaptureForecast
    | DependenceMatrix
    | TrainingPositions
    | LearningCurve
)

_STAGE = "computing the figures"
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
        Arrays; None where the study has no observations or no model for it.
    reason : str
        Why there are none; else empty.
    """

    number: int
    data: FigureData | None
    reason: str = ""


def study_figures(
    result: StudyResult, progress: Progress = ignore_progress
) -> tuple[StudyFigure, ...]:
    """Compute the arrays of Figs. 5, 10–17 and 20–26, those of the study's sensors.

    Parameters
    ----------
    result : StudyResult
        The study; its models predict, none is trained.
    progress : Progress
        Receives the figures that are computed.

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
        progress(_STAGE, len(figures), len(wanted))
        figures.append(_figure(number, compute))
    progress(_STAGE, len(figures), len(wanted))
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
        11: lambda: predictions.best_and_worst(
            "q_k4",
            result.variant("q_k4").model,
            "X_test",
            result.dataset("X_test").table,
            least_range=_LEAST_P_NORM_RANGE,
        ),
        12: partial(_surfaces, result, "q_k4", kind),
        13: partial(_exposure_row, result, "eX", kind),
        14: lambda: predictions.best_and_worst(
            "e_k6",
            result.variant("e_k6").model,
            "eX_test",
            result.dataset("eX_test").table,
            inside_only=True,
        ),
        15: lambda: predictions.capture_forecast(
            ("q_k4", result.variant("q_k4").model),
            ("e_k6", result.variant("e_k6").model),
            result.dataset("X_test").table,
        ),
        20: partial(result.dependence_in, "X"),
        21: lambda: TrainingPositions(
            dataset="X", features=feature_positions(result.dataset("X").table)
        ),
        22: partial(result.learning_curve, "q_k4"),
        23: partial(result.learning_curve, "e_k6"),
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


def _surfaces(result: StudyResult, variant: str, sensor: SensorKind) -> PredictionSurfaces:
    return prediction_surfaces(variant, result.variant(variant).model, sensor)


def _exposure_row(result: StudyResult, dataset: str, sensor: SensorKind) -> ExposureRow:
    curves = observed_curves(result.dataset(dataset).table)
    return ExposureRow(sensor=sensor, dataset=dataset, curves=nearest_row(curves))
