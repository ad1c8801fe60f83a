"""Exposure times in another unit than ms: told by holding them against what a model knows."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from exposight.cli.output import number

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from exposight.models import GaussianProcessModel


_UNITS = {1e3: "s", 1e-3: "µs", 1e-6: "ns", 1e6: "another unit"}
"""Factors to ms, and the unit that each one speaks for."""

_MOST = 0.9
"""So many must fit with the factor, and fail to without it: a wide range may hold a few of both."""

_MARGIN = 3.0
"""Fitting is meant widely: a model may know the best of a sweep's exposure times only."""


def exposure_unit_remark(model: GaussianProcessModel, exposures: ArrayLike) -> str:
    """Say which unit exposure times seem to be in, if not in ms.

    Parameters
    ----------
    model : GaussianProcessModel
        Knows the range of its own: that of its training data where it predicts exposure times, else
        that of its sensor, where it has one.
    exposures : (n,) array_like
        As a table has them; NaN where it does not.

    Returns
    -------
    str
        Empty where there is nothing to say.
    """
    known = _range_ms(model)
    values = np.asarray(exposures, dtype=np.float64)
    values = values[np.isfinite(values)]
    if known is None or not values.size:
        return ""
    low, high = known

    def fitting(factor: float) -> float:
        scaled = factor * values
        return float(np.mean((low / _MARGIN <= scaled) & (scaled <= high * _MARGIN)))

    factor = max(_UNITS, key=fitting)
    if fitting(1.0) > 1.0 - _MOST or fitting(factor) < _MOST:
        return ""
    first, last = number(values.min()), number(values.max())
    remedy = f"multiply by {factor:.0f}" if factor > 1 else f"divide by {1 / factor:.0f}"
    return (
        f"the exposure times here, {first} to {last}, do not fit those of "
        f"{model.name}, {number(low)} to {number(high)} ms: they seem to be in "
        f"{_UNITS[factor]}; {remedy} in column exposure_ms, which is in ms"
    )


def _range_ms(model: GaussianProcessModel) -> tuple[float, float] | None:
    if model.target == "exposure_ms":
        return model.target_range
    if model.sensor is not None:
        return model.sensor.exposure.min_ms, model.sensor.exposure.max_ms
    return None
