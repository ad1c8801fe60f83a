"""What the paper's study yields: settings, datasets, model variants, scores, tables, findings.

Records only: nothing is computed in them and nothing drawn. Names of datasets, variants and
findings are plain: ``eX_plusplus`` is ᵉX⁺⁺, ``e_k6_star`` is ᵉk₆*, and everything of the stereo
sensor ends (variants) or begins (datasets) with ``s2``.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from exposight.errors import InputError

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from exposight.models import Evaluation, GaussianProcessModel, ModelSpecification
    from exposight.observing import ObservationTable
    from exposight.statistics import RegressionScore


SensorKind = Literal["structured-light", "stereo"]
"""The paper's two sensors: Zeiss COMET Pro AE, and rc_visard 65 with a dot projector (s2)."""

SENSOR_KINDS: tuple[SensorKind, ...] = ("structured-light", "stereo")
"""Both, in the paper's order."""


@dataclass(frozen=True, kw_only=True)
class StudySettings:
    """What decides a study.

    Parameters
    ----------
    sensors : tuple of {'structured-light', 'stereo'}
        Which of the paper's sensors.
    quick : bool
        Measure a share of the views (`exposight.paper.campaigns`) and train from fewer starts.
    seed : int, 0 or more
        Of the splits and the restarts; the simulated campaigns have the seeds of their plans.
    workers : int, 1 or more
        Processes that work at the same time; does not change the result.
    campaigns : Path or None
        Folder of recorded campaigns (`exposight.paper.campaigns`); None simulates them.

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


EvaluationRole = Literal["validation", "validation_by_view", "test", "test_inside", "extended"]
"""How evaluation rows relate to those trained on.

``validation``: the rest of the random split, as in the paper. ``validation_by_view``: the rest of a
split by whole views. ``test``: unseen features. ``test_inside``: of these, the rows inside the
training rows' box in x, y, z, w, p (the paper's "test,i"). ``extended``: Sects. 4.1 and 4.3.
"""


@dataclass(frozen=True, kw_only=True)
class EvaluationSet:
    """One line under a variant in Tables 2 to 6.

    Parameters
    ----------
    table : int
        The paper's table, 2 to 6.
    dataset : str
        Of `Dataset`: the variant's own for validation, else where the rows come from.
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
class Variant:
    """A model of the study: what it learns from, and what it is judged by.

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
    evaluations : tuple of EvaluationSet
        In the order of the paper's tables.
    """

    name: str
    title: str
    sensor: SensorKind
    specification: ModelSpecification
    dataset: str
    evaluations: tuple[EvaluationSet, ...]

    @property
    def unit(self) -> Literal["%", "ms"]:
        """Unit of RMSE and MAE in tables: percent of full scale for p_norm, ms for exposures."""
        return "%" if self.specification.target == "p_norm" else "ms"


@dataclass(frozen=True, kw_only=True, eq=False)
class Score:
    """A trained variant held against one set of rows.

    Parameters
    ----------
    variant : str
        Name of the variant.
    evaluation : EvaluationSet
        Which rows.
    result : Evaluation or None
        Rows, observed targets, predictions with their standard deviation; None where there are no
        such rows.
    score : RegressionScore or None
        R² in percent; MSE, RMSE, MAE in the target's own unit (p_norm 0–1, or ms); coverage.
    relative_error_percent : float or None
        Mean of |predicted − true| / true in percent; None but for exposure times.
    """

    variant: str
    evaluation: EvaluationSet
    result: Evaluation | None
    score: RegressionScore | None
    relative_error_percent: float | None


@dataclass(frozen=True, kw_only=True, eq=False)
class TrainedVariant:
    """A variant, its model, and its scores.

    Parameters
    ----------
    variant : Variant
        What it is.
    model : GaussianProcessModel
        Trained on the random split's training side.
    path : Path
        The model's file, below the study's folder.
    scores : tuple of Score
        In the order of ``variant.evaluations``.
    """

    variant: Variant
    model: GaussianProcessModel
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
            f"variant {self.variant.name!r} has no score {role!r} on {dataset or 'any dataset'}; "
            "it has "
            + ", ".join(f"{s.evaluation.role} on {s.evaluation.dataset}" for s in self.scores)
        )
        raise InputError(msg)


@dataclass(frozen=True, kw_only=True)
class LearningStep:
    """A variant trained on fewer rows.

    Parameters
    ----------
    n_train : int
        Rows it learnt from, drawn at random from the variant's training rows.
    score : RegressionScore
        On unseen features, in the target's own unit (p_norm 0–1, or ms).
    """

    n_train: int
    score: RegressionScore


@dataclass(frozen=True, kw_only=True)
class LearningCurve:
    """Figs. 22 and 23: how scores on unseen features depend on the number of observations.

    Parameters
    ----------
    variant : str
        Name of the variant.
    dataset : str
        What it is judged by.
    role : {'test', 'test_inside'}
        All unseen rows, or those inside the box of all the variant's training rows.
    steps : tuple of LearningStep
        By growing number; the last has all rows.
    """

    variant: str
    dataset: str
    role: EvaluationRole
    steps: tuple[LearningStep, ...]


@dataclass(frozen=True, kw_only=True, eq=False)
class DependenceMatrix:
    """Fig. 20: maximal information coefficients of every two variables.

    Parameters
    ----------
    dataset : str
        Whose training rows.
    columns : tuple of str
        Columns of the observation table.
    values : (d, d) ndarray
        0–1, symmetric.
    """

    dataset: str
    columns: tuple[str, ...]
    values: NDArray[np.float64]

    def between(self, first: str, second: str) -> float:
        """Return the coefficient of two columns."""
        return float(self.values[self.columns.index(first), self.columns.index(second)])


@dataclass(frozen=True, kw_only=True)
class Finding:
    """One of the paper's statements, judged on this cell.

    Statement, measure, threshold and reason are data (``paper/data/findings.toml``), fixed before
    anything was evaluated.

    Parameters
    ----------
    name : str
        Short and unique, for instance ``light-alone-exposure``.
    sensor : str
        Which sensor's.
    statement : str
        What the paper says.
    source : str
        Where: section, table, figure.
    measure : str
        What the figure is, in words.
    figure : float or None
        What came out; None where it cannot be said (its rows were not measured).
    comparison : {'≥', '≤'}
        How the figure must stand to the threshold for the statement to be true.
    threshold : float
        In `unit`.
    unit : str
        Of figure and threshold; empty for a pure number.
    reason : str
        Why this threshold.
    paper_figure : float or None
        The same figure from the paper's numbers; None where they do not give it.
    holds : bool or None
        Whether it is true here; None where the figure is.
    explanation : str
        What was found to be the cause where it does not hold on the simulated cell; else empty.
    """

    name: str
    sensor: SensorKind
    statement: str
    source: str
    measure: str
    figure: float | None
    comparison: Literal["≥", "≤"]
    threshold: float
    unit: str
    reason: str
    paper_figure: float | None
    holds: bool | None
    explanation: str


@dataclass(frozen=True, kw_only=True)
class ScoreRow:
    """A line of Tables 2 to 6: ours, the paper's, the difference (ours less the paper's).

    Parameters
    ----------
    table : int
        The paper's table, 2 to 6.
    variant, variant_title : str
        Name and title of the variant.
    trained_on : str
        Name of the dataset it learnt from.
    n_train : int
        Rows it learnt from.
    dataset : str
        As in the paper's table; for splits by view ours, ending in ``_by_view``.
    role : str
        See `EvaluationRole`.
    features : str
        As in the paper's table.
    n : int
        Rows it is judged by; 0 where there are none, and all figures are None.
    unit : {'%', 'ms'}
        Of RMSE and MAE.
    r2_percent, mse, rmse, mae : float or None
        MSE in squared units of the target (p_norm 0–1, or ms²); RMSE and MAE in `unit`.
    relative_error_percent : float or None
        For exposure times only.
    coverage_1sigma_percent, coverage_2sigma_percent : float or None
        Share of the rows within one and two predicted standard deviations; calibrated normal
        predictions cover 68.3 and 95.4.
    paper_r2_percent, paper_mse, paper_rmse : float or None
        The paper's; None where it has no such line.
    r2_difference, rmse_difference : float or None
        Ours less the paper's, in percentage points, and in `unit`.
    """

    table: int
    variant: str
    variant_title: str
    trained_on: str
    n_train: int
    dataset: str
    role: EvaluationRole
    features: str
    n: int
    unit: Literal["%", "ms"]
    r2_percent: float | None
    mse: float | None
    rmse: float | None
    mae: float | None
    relative_error_percent: float | None
    coverage_1sigma_percent: float | None
    coverage_2sigma_percent: float | None
    paper_r2_percent: float | None
    paper_mse: float | None
    paper_rmse: float | None
    r2_difference: float | None
    rmse_difference: float | None


@dataclass(frozen=True, kw_only=True)
class HyperparameterRow:
    """A line of Table 8: one hyperparameter of one variant.

    Parameters
    ----------
    variant : str
        Name of the variant.
    parameter : str
        As the kernel names it, or ``noise_variance``.
    symbol : str
        For people: ``σ²``, ``ℓ``, ``α``, ``ε``.
    input : str
        The column it belongs to, for length scales and variances of one input; else empty.
    unit : str
        Of the value; empty for none.
    value : float
        Fitted, length scales in GPy's convention where it differs from ours, so that the two
        columns can be compared.
    paper_value : float or None
        The paper's; None where it prints none.
    at_bound : bool
        Whether the fit ended at a limit.
    """

    variant: str
    parameter: str
    symbol: str
    input: str
    unit: str
    value: float
    paper_value: float | None
    at_bound: bool


@dataclass(frozen=True, kw_only=True)
class DatasetRow:
    """A line of Table 9: what was obtained, and the paper's.

    Ranges are (least, greatest); None where there is no row, or the paper prints none.

    Parameters
    ----------
    dataset : str
        Name of the dataset; of X also its three planes, ``X near``, ``X middle``, ``X far``.
    sensor : str
        Which sensor's.
    features : str
        As in the paper's table.
    n, n_train, n_validation : int or None
        Observations; of the two sides only where it is split.
    n_features, n_views : int
        That are in it.
    p_norm, i_avg, exposure_ms, x_mm, y_mm, z_mm, w_deg, p_deg : (float, float) or None
        Ranges obtained.
    paper_n, paper_n_train : int or None
        The paper's counts.
    paper_p_norm, …, paper_p_deg : (float, float) or None
        The paper's ranges.
    """

    dataset: str
    sensor: SensorKind
    features: str
    n: int
    n_train: int | None
    n_validation: int | None
    n_features: int
    n_views: int
    p_norm: tuple[float, float] | None
    i_avg: tuple[float, float] | None
    exposure_ms: tuple[float, float] | None
    x_mm: tuple[float, float] | None
    y_mm: tuple[float, float] | None
    z_mm: tuple[float, float] | None
    w_deg: tuple[float, float] | None
    p_deg: tuple[float, float] | None
    paper_n: int | None
    paper_n_train: int | None
    paper_p_norm: tuple[float, float] | None
    paper_i_avg: tuple[float, float] | None
    paper_exposure_ms: tuple[float, float] | None
    paper_x_mm: tuple[float, float] | None
    paper_y_mm: tuple[float, float] | None
    paper_z_mm: tuple[float, float] | None
    paper_w_deg: tuple[float, float] | None
    paper_p_deg: tuple[float, float] | None


@dataclass(frozen=True, kw_only=True)
class StudyTables:
    """The paper's tables as rows.

    Parameters
    ----------
    scores : tuple of ScoreRow
        Tables 2, 3, 4, 5 and 6, told apart by ``ScoreRow.table``.
    hyperparameters : tuple of HyperparameterRow
        Table 8.
    datasets : tuple of DatasetRow
        Table 9.
    """

    scores: tuple[ScoreRow, ...]
    hyperparameters: tuple[HyperparameterRow, ...]
    datasets: tuple[DatasetRow, ...]


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
    variants : tuple of TrainedVariant
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
    variants: tuple[TrainedVariant, ...]
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

    def variant(self, name: str) -> TrainedVariant:
        """Return a trained variant by name.

        Raises
        ------
        InputError
            If the study has none of this name.
        """
        for trained in self.variants:
            if trained.variant.name == name:
                return trained
        known = ", ".join(trained.variant.name for trained in self.variants)
        msg = f"the study has no variant {name!r}; it has {known}"
        raise InputError(msg)
