"""How well predictions match observations."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from exposight.errors import InputError, ObservationError
from exposight.statistics.vectors import FloatArray, check_vector


@dataclass(frozen=True, kw_only=True)
class RegressionScore:
    """Scores of a regression on one set of observations, as the paper tabulates them.

    Attributes
    ----------
    n : int
        Number of observations.
    r2_percent : float
        Coefficient of determination in percent; NaN where the observations are all alike.
    mse : float
        Mean squared error, in squared units of the target.
    rmse : float
        Its root, in the unit of the target.
    mae : float
        Mean absolute error, in the unit of the target.
    coverage_1sigma, coverage_2sigma : float or None
        Share of the observations within one and two predicted standard deviations, or within the
        predicted bands that stand for them; None where neither was given. A calibrated prediction
        covers 0.683 and 0.954.
    """

    n: int
    r2_percent: float
    mse: float
    rmse: float
    mae: float
    coverage_1sigma: float | None
    coverage_2sigma: float | None


def r2(observed: ArrayLike, predicted: ArrayLike) -> float:
    """Coefficient of determination, 1 − sum (y − ŷ)² / sum (y − ȳ)².

    Parameters
    ----------
    observed, predicted : (n,) array
        In the same unit.

    Returns
    -------
    float
        At most 1; negative where the observations' own mean would do better.

    Raises
    ------
    ObservationError
        If the arrays are empty, differ in shape, hold a NaN, or the observations are all alike,
        which leaves it undefined.
    """
    y, prediction = _check_pair(observed, predicted, "predicted")
    if np.all(y == y[0]):
        msg = (
            f"R² is undefined: all {len(y)} observations are {y[0]:g}; "
            "use rmse, or observations that vary"
        )
        raise ObservationError(msg)
    return 1.0 - float(np.sum((y - prediction) ** 2) / np.sum((y - y.mean()) ** 2))


def mse(observed: ArrayLike, predicted: ArrayLike) -> float:
    """Mean squared error, in squared units of the target.

    Parameters
    ----------
    observed, predicted : (n,) array
        In the same unit.

    Returns
    -------
    float

    Raises
    ------
    ObservationError
        If the arrays are empty, differ in shape, or hold a NaN.
    """
    y, prediction = _check_pair(observed, predicted, "predicted")
    return float(np.mean((y - prediction) ** 2))


def rmse(observed: ArrayLike, predicted: ArrayLike) -> float:
    """Root mean squared error, in the unit of the target.

    Parameters
    ----------
    observed, predicted : (n,) array
        In the same unit.

    Returns
    -------
    float

    Raises
    ------
    ObservationError
        If the arrays are empty, differ in shape, or hold a NaN.
    """
    return math.sqrt(mse(observed, predicted))


def mae(observed: ArrayLike, predicted: ArrayLike) -> float:
    """Mean absolute error, in the unit of the target.

    Parameters
    ----------
    observed, predicted : (n,) array
        In the same unit.

    Returns
    -------
    float

    Raises
    ------
    ObservationError
        If the arrays are empty, differ in shape, or hold a NaN.
    """
    y, prediction = _check_pair(observed, predicted, "predicted")
    return float(np.mean(np.abs(y - prediction)))


def coverage(observed: ArrayLike, mean: ArrayLike, std: ArrayLike, k: float) -> float:
    """Share of the observations within k predicted standard deviations of the mean.

    Parameters
    ----------
    observed, mean, std : (n,) array
        In the same unit; the standard deviation of a new observation, noise included.
    k : float
        Positive.

    Returns
    -------
    float
        0 to 1; for normal predictions that are calibrated, 0.683 at k = 1 and 0.954 at k = 2.

    Raises
    ------
    ObservationError
        If the arrays are empty, differ in shape, hold a NaN, or a standard deviation is
        negative.
    InputError
        If k is not positive.
    """
    y, centre = _check_pair(observed, mean, "mean")
    spread = _check_std(y, std)
    if not k > 0.0:
        msg = f"k must be positive, got {k!r}"
        raise InputError(msg)
    return float(np.mean(np.abs(y - centre) <= k * spread))


def score(
    observed: ArrayLike,
    predicted_mean: ArrayLike,
    std: ArrayLike | None = None,
    *,
    band: tuple[ArrayLike, ArrayLike] | None = None,
    inner_band: tuple[ArrayLike, ArrayLike] | None = None,
) -> RegressionScore:
    """Score predictions in the terms of the paper's Tables 2 and 3.

    Parameters
    ----------
    observed, predicted_mean : (n,) array
        In the same unit.
    std : (n,) array, optional
        Standard deviation of a new observation, noise included, in the same unit.
    band : pair of (n,) array, optional
        Low and high limit for 95.4 % of new observations, in the same unit; mean ± 2 std if left
        out.
    inner_band : pair of (n,) array, optional
        The same for 68.3 %; mean ± std if left out.

    Returns
    -------
    RegressionScore

    Raises
    ------
    ObservationError
        If the arrays are empty, differ in shape, hold a NaN, or a standard deviation is
        negative.
    """
    y, prediction = _check_pair(observed, predicted_mean, "predicted_mean")
    alike = bool(np.all(y == y[0]))
    within = [
        _share_within(y, limits) if limits is not None
        else None if std is None
        else coverage(y, prediction, std, k)
        for k, limits in ((1.0, inner_band), (2.0, band))
    ]  # fmt: skip
    return RegressionScore(
        n=len(y),
        r2_percent=math.nan if alike else 100.0 * r2(y, prediction),
        mse=mse(y, prediction),
        rmse=rmse(y, prediction),
        mae=mae(y, prediction),
        coverage_1sigma=within[0],
        coverage_2sigma=within[1],
    )


def _share_within(y: FloatArray, band: tuple[ArrayLike, ArrayLike]) -> float:
    low, high = (_check_pair(y, limit, "band")[1] for limit in band)
    return float(np.mean((low <= y) & (y <= high)))


def _check_pair(
    observed: ArrayLike, predicted: ArrayLike, name: str
) -> tuple[FloatArray, FloatArray]:
    y, prediction = check_vector(observed, "observed"), check_vector(predicted, name)
    if y.shape != prediction.shape:
        msg = f"{name} must match the {len(y)} observations, got {len(prediction)}"
        raise ObservationError(msg)
    return y, prediction


def _check_std(y: FloatArray, std: ArrayLike) -> FloatArray:
    spread = _check_pair(y, std, "std")[1]
    if np.any(spread < 0.0):
        row = int(np.flatnonzero(spread < 0.0)[0])
        msg = f"std must not be negative, got {spread[row]:g} in row {row}"
        raise ObservationError(msg)
    return spread
