"""The paper's figures as typed arrays: Figs. 5, 10–17 and 20–26. Nothing here draws."""

from exposight.paper.figure_data.curves import (
    BrightnessCurves,
    ExposureRow,
    FeaturePositions,
    ObservedCurve,
    TrainingPositions,
    extreme_radii,
    feature_positions,
    nearest_row,
    observed_curves,
)
from exposight.paper.figure_data.extreme_predictions import (
    BestAndWorst,
    PredictedCurve,
    best_and_worst,
)
from exposight.paper.figure_data.kernel_example import (
    KernelExample,
    KernelExamples,
    kernel_examples,
)
from exposight.paper.figure_data.one_capture import (
    CaptureForecast,
    FeatureForecast,
    capture_forecast,
)
from exposight.paper.figure_data.study_figures import (
    FigureData,
    StudyFigure,
    study_figures,
)
from exposight.paper.figure_data.surfaces import PredictionSurfaces, prediction_surfaces
