"""The paper's study: its datasets, models, tables and findings, as data and functions."""

from exposight.paper.result import (
    SENSOR_KINDS,
    Dataset,
    DatasetRow,
    DependenceMatrix,
    EvaluationRole,
    Finding,
    HyperparameterRow,
    LearningCurve,
    LearningStep,
    Rung,
    RungEvaluation,
    Score,
    ScoreRow,
    SensorKind,
    StudyResult,
    StudySettings,
    StudyTables,
    TrainedRung,
)
from exposight.paper.study import run_study
from exposight.paper.tables import table_csv
