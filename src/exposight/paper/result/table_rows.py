"""Lines of the paper's Tables 2 to 6, 8 and 9: ours beside the paper's."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

if TYPE_CHECKING:
    from exposight.paper.result.rungs import EvaluationRole
    from exposight.paper.result.settings import SensorKind


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
