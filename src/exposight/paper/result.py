"""What the paper's study yields: typed records, nothing computed in them and nothing drawn.

Names of datasets, rungs and findings are plain: ``eX_plusplus`` is ᵉX⁺⁺, ``e_k6_star`` is ᵉk₆*, and
everything of the stereo sensor ends (rungs) or begins (datasets) with ``s2``.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from exposight.errors import InputError
from exposight.paper.rows import (
    SENSOR_KINDS,
    DatasetRow,
    DependenceMatrix,
    EvaluationRole,
    Finding,
    HyperparameterRow,
    LearningCurve,
    LearningStep,
    ScoreRow,
    SensorKind,
    StudyTables,
)

if TYPE_CHECKING:
    from exposight.evaluation import RegressionScore
    from exposight.models import Evaluation, ModelSpecification, TrainedModel
    from exposight.observing import ObservationTable

__all__ = [
    "SENSOR_KINDS",
    "Dataset",
    "DatasetRow",
    "DependenceMatrix",
    "EvaluationRole",
    "Finding",
    "HyperparameterRow",
    "LearningCurve",
    "LearningStep",
    "Rung",
    "RungEvaluation",
    "Score",
    "ScoreRow",
    "SensorKind",
    "StudyResult",
    "StudySettings",
    "StudyTables",
    "TrainedRung",
]


@dataclass(frozen=True, kw_only=True)
class StudySettings:
    """What decides a study.

    Parameters
    ----------
    sensors : tuple of {'structured-light', 'stereo'}
        Which of the paper's sensors.
    quick : bool
        Measure a share of the views (`exposight.paper.collection`) and train from fewer starts.
    seed : int, 0 or more
        Of the splits and the restarts; the simulated campaigns have the seeds of their plans.
    workers : int, 1 or more
        Processes that work at the same time; does not change the result.
    campaigns : Path or None
        Folder of recorded campaigns (`exposight.paper.collection`); None simulates them.

    Raises
    ------
    InputError
        If a sensor is unknown or there twice, none is given, the seed is negative, or there is no
        worker.
    """

    sensors: tuple[SensorKind, ...] = SENSOR_KINDS
    quick: bool = False
    seed: int = 1
    workers: int = 2
    campaigns: Path | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "sensors", tuple(self.sensors))
        unknown = [sensor for sensor in self.sensors if sensor not in SENSOR_KINDS]
        if unknown or not self.sensors or len(set(self.sensors)) < len(self.sensors):
            msg = (
                f"sensors must be one or both of {', '.join(SENSOR_KINDS)}, each once, got "
                f"{', '.join(map(repr, self.sensors)) or 'none'}"
            )
            raise InputError(msg)
        if self.seed < 0:
            msg = f"seed must be a whole number from 0 up, got {self.seed}"
            raise InputError(msg)
        if self.workers < 1:
            msg = f"a study needs at least 1 worker, got {self.workers}"
            raise InputError(msg)


@dataclass(frozen=True, kw_only=True, eq=False)
class Dataset:
    """One row of the paper's Table 9: measured observations of one kind, and how they are split.

    Parameters
    ----------
    name : str
        ``X``, ``X_test``, ``eX``, ``eX_test``, ``eX_plus``, ``eX_plusplus``, ``X_lighting_I`` (II,
        III), ``X_out``, and ``s2_X``, ``s2_X_test``, ``s2_eX``, ``s2_eX_test``, ``s2_X_out``.
    title : str
        For people.
    sensor : {'structured-light', 'stereo'}
        Which sensor measured it.
    features : tuple of str
        Features it was asked for, also where no row of one is left.
    p_norm_min : float or None
        Rows below are left out (Sect. 3.4.1); None keeps all.
    table : ObservationTable
        All its rows, measured ones only.
    train, validation : ObservationTable or None
        The two sides of the random split, as in the paper; None for what nothing learns from.
    train_by_view, validation_by_view : ObservationTable or None
        The two sides of a split by whole views with the same share.
    """

    name: str
    title: str
    sensor: SensorKind
    features: tuple[str, ...]
    p_norm_min: float | None
    table: ObservationTable
    train: ObservationTable | None = None
    validation: ObservationTable | None = None
    train_by_view: ObservationTable | None = None
    validation_by_view: ObservationTable | None = None


@dataclass(frozen=True, kw_only=True)
class RungEvaluation:
    """One line under a rung in Tables 2 to 6.

    Parameters
    ----------
    table : int
        The paper's table, 2 to 6.
    dataset : str
        Of `Dataset`: the rung's own for validation, else where the rows come from.
    role : str
        See `EvaluationRole`.
    paper_dataset : str
        As in the paper's table, for instance ``eX6_val_plusplus``.
    features : tuple of str
        Only these; empty for all of the dataset's.
    paper_features : str
        As in the paper's table, for instance ``f1-4_test``.
    inside : tuple of str
        Only rows inside the training rows' range in these columns, at the resolution of Table 9,
        whole mm and degrees; empty for all rows.
    """

    table: int
    dataset: str
    role: EvaluationRole
    paper_dataset: str
    paper_features: str
    features: tuple[str, ...] = ()
    inside: tuple[str, ...] = ()


@dataclass(frozen=True, kw_only=True)
class Rung:
    """One step of the ladder: a model, what it learns from, and what it is judged by.

    Parameters
    ----------
    name : str
        As the paper names the kernel: ``q_k4``, ``e_k4_plus``, ``e_k6_plusplus``, ``q_k4_s2``, …
    title : str
        For people.
    sensor : {'structured-light', 'stereo'}
        Which sensor's.
    specification : ModelSpecification
        Target, inputs and kernel.
    dataset : str
        Name of the dataset whose training side it learns from.
    evaluations : tuple of RungEvaluation
        In the order of the paper's tables.
    """

    name: str
    title: str
    sensor: SensorKind
    specification: ModelSpecification
    dataset: str
    evaluations: tuple[RungEvaluation, ...]

    @property
    def unit(self) -> Literal["%", "ms"]:
        """Unit of RMSE and MAE in tables: percent of full scale for p_norm, ms for exposures."""
        return "%" if self.specification.target == "p_norm" else "ms"


@dataclass(frozen=True, kw_only=True, eq=False)
class Score:
    """A trained rung held against one set of rows.

    Parameters
    ----------
    rung : str
        Name of the rung.
    evaluation : RungEvaluation
        Which rows.
    result : Evaluation or None
        Rows, observed targets, predictions with their standard deviation; None where there are no
        such rows.
    score : RegressionScore or None
        R² in percent; MSE, RMSE, MAE in the target's own unit (p_norm 0–1, or ms); coverage.
    relative_error_percent : float or None
        Mean of |predicted − true| / true in percent; None but for exposure times.
    """

    rung: str
    evaluation: RungEvaluation
    result: Evaluation | None
    score: RegressionScore | None
    relative_error_percent: float | None


@dataclass(frozen=True, kw_only=True, eq=False)
class TrainedRung:
    """A rung, its model, and its scores.

    Parameters
    ----------
    rung : Rung
        What it is.
    model : TrainedModel
        Trained on the random split's training side.
    path : Path
        The model's file, below the study's folder.
    scores : tuple of Score
        In the order of ``rung.evaluations``.
    """

    rung: Rung
    model: TrainedModel
    path: Path
    scores: tuple[Score, ...]

    def score(
        self, role: EvaluationRole, *, dataset: str | None = None, features: tuple[str, ...] = ()
    ) -> Score:
        """Return the score with this role, of this dataset, for these features (none: all).

        Raises
        ------
        InputError
            If there is none.
        """
        for score in self.scores:
            line = score.evaluation
            if line.role == role and dataset in (None, line.dataset) and features == line.features:
                return score
        msg = (
            f"rung {self.rung.name!r} has no score {role!r} on {dataset or 'any dataset'}; it has "
            + ", ".join(f"{s.evaluation.role} on {s.evaluation.dataset}" for s in self.scores)
        )
        raise InputError(msg)


@dataclass(frozen=True, kw_only=True, eq=False)
class StudyResult:
    """Everything a report of the study needs.

    Parameters
    ----------
    settings : StudySettings
        What was asked for.
    exposight_version : str
        The program.
    campaigns : tuple of str
        What was measured, one line for each campaign: its name, views, captures, and whether it
        was simulated or recorded, and which share of the views of the full study it has.
    datasets : tuple of Dataset
        In the order of Table 9.
    rungs : tuple of TrainedRung
        In the order of the paper's tables.
    tables : StudyTables
        Tables 2, 3, 4, 5, 6, 8, 9.
    dependence : tuple of DependenceMatrix
        One for each sensor (Fig. 20 and its counterpart).
    learning_curves : tuple of LearningCurve
        Figs. 22 and 23, structured light only.
    findings : tuple of Finding
        In the paper's order.
    """

    settings: StudySettings
    exposight_version: str
    campaigns: tuple[str, ...]
    datasets: tuple[Dataset, ...]
    rungs: tuple[TrainedRung, ...]
    tables: StudyTables
    dependence: tuple[DependenceMatrix, ...]
    learning_curves: tuple[LearningCurve, ...]
    findings: tuple[Finding, ...]

    def dataset(self, name: str) -> Dataset:
        """Return a dataset by name.

        Raises
        ------
        InputError
            If the study has none of this name.
        """
        for dataset in self.datasets:
            if dataset.name == name:
                return dataset
        known = ", ".join(dataset.name for dataset in self.datasets)
        msg = f"the study has no dataset {name!r}; it has {known}"
        raise InputError(msg)

    def rung(self, name: str) -> TrainedRung:
        """Return a trained rung by name.

        Raises
        ------
        InputError
            If the study has none of this name.
        """
        for trained in self.rungs:
            if trained.rung.name == name:
                return trained
        known = ", ".join(trained.rung.name for trained in self.rungs)
        msg = f"the study has no rung {name!r}; it has {known}"
        raise InputError(msg)
