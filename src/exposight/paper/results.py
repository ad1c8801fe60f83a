"""What the paper's study yields: trained variants, scores, tables, curves, findings, as records."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal, TypeVar

import numpy as np
import polars as pl
from numpy.typing import NDArray

from exposight.errors import InputError
from exposight.models import Evaluation, GaussianProcessModel
from exposight.paper.datasets import Dataset
from exposight.paper.study_settings import SensorKind, StudySettings
from exposight.paper.variants import EvaluationRole, EvaluationSet, Variant
from exposight.statistics import RegressionScore

_Item = TypeVar("_Item")


@dataclass(frozen=True, kw_only=True, eq=False)
class Score:
    """How well a trained variant predicts one set of rows.

    Parameters
    ----------
    evaluation : EvaluationSet
        Which rows.
    result : Evaluation or None
        Rows, observed targets, predictions with their standard deviation; None where there are no
        such rows.
    """

    evaluation: EvaluationSet
    result: Evaluation | None

    @property
    def score(self) -> RegressionScore | None:
        """R² in percent; MSE, RMSE, MAE in the target's own unit (p_norm 0–1, or ms); coverage."""
        return None if self.result is None else self.result.score

    @property
    def relative_error_percent(self) -> float | None:
        """Mean of |predicted − true| / true, for exposure times only: they are above 0."""
        if self.result is None or self.result.model.target != "exposure_ms":
            return None
        error = np.abs(self.result.prediction.mean - self.result.observed) / self.result.observed
        return float(100.0 * error.mean())


@dataclass(frozen=True, kw_only=True, eq=False)
class TrainedVariant:
    """A variant, its model, and its scores.

    Parameters
    ----------
    variant : Variant
        Its form and data.
    model : GaussianProcessModel
        Trained on the random split's training side.
    scores : tuple of Score
        In the order of ``variant.evaluations``.
    """

    variant: Variant
    model: GaussianProcessModel
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
        known = ", ".join(f"{s.evaluation.role} on {s.evaluation.dataset}" for s in self.scores)
        msg = (
            f"variant {self.variant.name!r} has no score {role!r} on {dataset or 'any dataset'}; "
            f"it has {known}"
        )
        raise InputError(msg)


@dataclass(frozen=True, kw_only=True)
class LearningStep:
    """A variant trained on fewer rows.

    Parameters
    ----------
    n_train : int
        Training rows, drawn at random from the variant's training rows.
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
        Dataset that evaluates it.
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
        Name of the dataset whose training rows were used.
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
class Statement:
    """One of the paper's statements, with the measure and threshold that decide on it.

    Parameters
    ----------
    name : str
        Short and unique, for instance ``light-alone-exposure``.
    sensor : {'structured-light', 'stereo'}
        Sensor that measures it.
    statement : str
        What the paper says.
    source : str
        Section, table or figure of the paper.
    measure : str
        Description of the figure that is compared with the threshold.
    comparison : {'≥', '≤'}
        How the figure must compare with the threshold for the statement to hold.
    threshold : float
        In `unit`.
    unit : str
        Of figure and threshold; empty for a pure number.
    reason : str
        Why this threshold.
    explanation : str
        Cause where the statement does not hold on the simulated cell; else empty.
    paper_figure : float or None
        The same figure from the paper's numbers; None where they do not give it.
    """

    name: str
    sensor: SensorKind
    statement: str
    source: str
    measure: str
    comparison: Literal["≥", "≤"]
    threshold: float
    unit: str = ""
    reason: str
    explanation: str = ""
    paper_figure: float | None = None


@dataclass(frozen=True, kw_only=True)
class Finding(Statement):
    """A statement, and whether it holds here.

    Parameters
    ----------
    figure : float or None
        What came out; None where it cannot be computed (its rows were not measured).
    holds : bool or None
        Whether the statement is true here; None where the figure is.
    """

    figure: float | None
    holds: bool | None


@dataclass(frozen=True, kw_only=True, eq=False)
class StudyTables:
    """The paper's tables: ours beside the paper's, a row for each line.

    Parameters
    ----------
    scores : polars.DataFrame
        Tables 2 to 6, by the column ``table``. R², coverage and relative errors are in percent,
        RMSE and MAE in ``unit``, MSE in squared units of the target (p_norm 0–1, or ms²).
        Differences are ours minus the paper's. ``n`` is 0 where there is no row to evaluate, and
        figures are null then, as the paper's are where it has no such line.
    hyperparameters : polars.DataFrame
        Table 8, by ``variant``. Length scales of rational quadratic kernels are in GPy's
        convention, so that they can be compared with ``paper_value``. ``input`` is the column that
        a length scale or variance belongs to; empty where it belongs to none, ``all`` for several.
    datasets : polars.DataFrame
        Table 9; X is also listed by its planes ``X near``, ``X middle`` and ``X far``. Each range
        is a pair of columns that end in ``_low`` and ``_high``; the paper's begin with ``paper_``.
    """

    scores: pl.DataFrame
    hyperparameters: pl.DataFrame
    datasets: pl.DataFrame


@dataclass(frozen=True, kw_only=True, eq=False)
class StudyResult:
    """Everything that a report of the study needs.

    Parameters
    ----------
    settings : StudySettings
        What decided it.
    exposight_version : str
        The program.
    campaigns : tuple of str
        One line for each campaign: name, views, captures, simulated or recorded, and the share of
        the full study's views.
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
    findings: tuple[Finding, ...] = ()

    def dataset(self, name: str) -> Dataset:
        """Return a dataset by name; raise `InputError` where the study has none of this name."""
        return _named("dataset", name, {dataset.name: dataset for dataset in self.datasets})

    def variant(self, name: str) -> TrainedVariant:
        """Return a trained variant by name; raise `InputError` where there is none."""
        return _named("variant", name, {item.variant.name: item for item in self.variants})

    def dependence_in(self, dataset: str) -> DependenceMatrix:
        """Return a dataset's dependence matrix; raise `InputError` where there is none."""
        matrices = {matrix.dataset: matrix for matrix in self.dependence}
        return _named("dependence matrix of", dataset, matrices)

    def learning_curve(self, variant: str) -> LearningCurve:
        """Return a variant's learning curve; raise `InputError` where there is none."""
        curves = {curve.variant: curve for curve in self.learning_curves}
        return _named("learning curve of", variant, curves)


def _named(kind: str, name: str, items: Mapping[str, _Item]) -> _Item:
    if name not in items:
        msg = f"the study has no {kind} {name!r}; it has {', '.join(items) or 'none'}"
        raise InputError(msg)
    return items[name]
