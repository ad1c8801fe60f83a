"""The paper's study: its datasets, model variants, tables, findings and figures, as data."""

import exposight.twin  # before plans: they import each other for now
from exposight.paper.campaigns import CAMPAIGNS, StudyCampaign, campaign_plan
from exposight.paper.datasets import DATASETS, build_dataset
from exposight.paper.figure_data import (
    FigureData,
    KernelExample,
    KernelExamples,
    StudyFigure,
    study_figures,
)
from exposight.paper.observed_curves import (
    BrightnessCurves,
    ExposureRow,
    FeaturePositions,
    ObservedCurve,
    TrainingPositions,
)
from exposight.paper.predictions import (
    BestAndWorst,
    CaptureForecast,
    FeatureForecast,
    PredictedCurve,
    PredictionSurfaces,
)
from exposight.paper.results import (
    SENSOR_KINDS,
    Dataset,
    DatasetRow,
    DependenceMatrix,
    EvaluationRole,
    EvaluationSet,
    Finding,
    HyperparameterRow,
    LearningCurve,
    LearningStep,
    Score,
    ScoreRow,
    SensorKind,
    StudyResult,
    StudySettings,
    StudyTables,
    TrainedVariant,
    Variant,
)
from exposight.paper.scores import score_variant
from exposight.paper.study import run_study
from exposight.paper.tables import table_csv
from exposight.paper.variants import VARIANTS
