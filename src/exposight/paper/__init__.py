"""The paper's study: its datasets, model variants, tables, findings and figures, as data."""

from exposight.paper.campaigns import CAMPAIGNS, campaign_plan
from exposight.paper.datasets import DATASETS, Dataset, build_dataset
from exposight.paper.figure_data import FigureData, KernelExamples, StudyFigure, study_figures
from exposight.paper.observed_curves import (
    BrightnessCurves,
    ExposureRow,
    ObservedCurve,
    TrainingPositions,
)
from exposight.paper.prediction_surfaces import PredictionSurfaces
from exposight.paper.predictions import (
    BestAndWorst,
    CaptureForecast,
    FeatureForecast,
    PredictedCurve,
)
from exposight.paper.results import (
    DependenceMatrix,
    Finding,
    LearningCurve,
    LearningStep,
    Score,
    StudyResult,
    StudyTables,
    TrainedVariant,
)
from exposight.paper.scores import score_variant
from exposight.paper.study import add_to_study, run_study
from exposight.paper.study_settings import StudySettings
from exposight.paper.study_tables import table_files
from exposight.paper.variants import VARIANTS, EvaluationRole, EvaluationSet, Variant
