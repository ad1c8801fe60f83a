"""What the paper's study yields: typed records, nothing computed in them and nothing drawn.

::

    settings      what decides a study
    datasets      Table 9's rows as measured, and how they are split
    rungs         models of the ladder: what each learns from, what judges it, how it did
    table_rows    lines of Tables 2 to 6, 8 and 9
    statistics    learning curves, dependence of variables
    finding       one of the paper's statements, judged
    study_result  all of it

Names of datasets, rungs and findings are plain: ``eX_plusplus`` is ᵉX⁺⁺, ``e_k6_star`` is ᵉk₆*, and
everything of the stereo sensor ends (rungs) or begins (datasets) with ``s2``.
"""

from exposight.paper.result.datasets import Dataset
from exposight.paper.result.finding import Finding
from exposight.paper.result.rungs import EvaluationRole, Rung, RungEvaluation, Score, TrainedRung
from exposight.paper.result.settings import SENSOR_KINDS, SensorKind, StudySettings
from exposight.paper.result.statistics import DependenceMatrix, LearningCurve, LearningStep
from exposight.paper.result.study_result import StudyResult
from exposight.paper.result.table_rows import DatasetRow, HyperparameterRow, ScoreRow, StudyTables
