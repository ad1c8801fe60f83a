"""Lines of the study's tables and figures, and its findings: plain records of numbers."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from exposight.evaluation import RegressionScore

__all__ = [
    "SENSOR_KINDS",
    "DatasetRow",
    "DependenceMatrix",
    "EvaluationRole",
    "Finding",
    "HyperparameterRow",
    "LearningCurve",
    "LearningStep",
    "ScoreRow",
    "SensorKind",
    "StudyTables",
]

SensorKind = Literal["structured-light", "stereo"]
"""The paper's two sensors: Zeiss COMET Pro AE, and rc_visard 65 with a dot projector (s2)."""

SENSOR_KINDS: tuple[SensorKind, ...] = ("structured-light", "stereo")
"""Both, in the paper's order."""

EvaluationRole = Literal["validation", "validation_by_view", "test", "test_inside", "extended"]
"""How evaluation rows relate to those trained on.

``validation``: the rest of the random split, as in the paper. ``validation_by_view``: the rest of a
split by whole views. ``test``: unseen features. ``test_inside``: of these, the rows inside the
training rows' box in x, y, z, w, p (the paper's "test,i"). ``extended``: Sects. 4.1 and 4.3.
"""


@dataclass(frozen=True, kw_only=True)
class ScoreRow:
    """A line of Tables 2 to 6: ours, the paper's, the difference (ours less the paper's).

    Parameters
    ----------
    table : int
        The paper's table, 2 to 6.
    rung, rung_title : str
        Name and title of the rung.
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
    rung: str
    rung_title: str
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
    """A line of Table 8: one hyperparameter of one rung.

    Parameters
    ----------
    rung : str
        Name of the rung.
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

    rung: str
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


@dataclass(frozen=True, kw_only=True)
class LearningStep:
    """A rung trained on fewer rows.

    Parameters
    ----------
    n_train : int
        Rows it learnt from, drawn at random from the rung's training rows.
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
    rung : str
        Name of the rung.
    dataset : str
        What it is judged by.
    role : {'test', 'test_inside'}
        All unseen rows, or those inside the box of all the rung's training rows.
    steps : tuple of LearningStep
        By growing number; the last has all rows.
    """

    rung: str
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
