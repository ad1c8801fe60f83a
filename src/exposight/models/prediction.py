"""What a model says about rows: mean, band, and the distribution that they stand for."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr, ndtri

_LEAST = 1e-12
"""Standard deviations are no smaller where something is divided by them."""


class _Shape(NamedTuple):
    """A normal distribution, or two halves of some, of values or of their logarithms."""

    middle: NDArray[np.float64]
    below: NDArray[np.float64]
    above: NDArray[np.float64]
    log: bool


@dataclass(frozen=True, kw_only=True, eq=False)
class Prediction:
    """What a model predicts for n rows.

    Parameters
    ----------
    mean : (n,) ndarray
        In the target's unit.
    std : (n,) ndarray
        Standard deviation of a new observation, measurement noise included.
    inside : (n,) ndarray of bool
        Whether the inputs lie in the range of the training data. Outside, the model
        extrapolates, and the paper's test features show how far off it then may be (Table 3).
    low, high : (n,) ndarray, optional
        Quantiles of 2.3 % and 97.7 % of a new observation, in the target's unit; mean ± 2 std if
        left out, and never None afterwards.
    """

    mean: NDArray[np.float64]
    std: NDArray[np.float64]
    inside: NDArray[np.bool_]
    low: NDArray[np.float64] = None  # type: ignore[assignment]  # `__post_init__` replaces it
    high: NDArray[np.float64] = None  # type: ignore[assignment]

    def __post_init__(self) -> None:
        for name, side in (("low", -2.0), ("high", 2.0)):
            if getattr(self, name) is None:
                object.__setattr__(self, name, self.mean + side * self.std)

    def quantiles(self, levels: Sequence[float]) -> NDArray[np.float64]:
        """Return quantiles of new observations, (len(levels), n).

        Of normal distributions; where `low` and `high` do not lie evenly about the mean, of
        log-normal ones through both if they are positive, else of two normal halves.
        """
        shape, z = self._shape, ndtri(np.asarray(levels, dtype=np.float64))[:, None]
        values = shape.middle + z * np.where(z < 0.0, shape.below, shape.above)
        return np.asarray(np.exp(values) if shape.log else values, dtype=np.float64)

    def chance(self, need: float) -> NDArray[np.float64]:
        """Return the chance that new observations are at least `need`, (n,)."""
        shape = self._shape
        if shape.log and need <= 0.0:
            return np.ones_like(shape.middle)
        above = shape.middle - (np.log(need) if shape.log else need)
        width = np.where(above > 0.0, shape.below, shape.above)
        return np.asarray(ndtr(above / np.maximum(width, _LEAST)), dtype=np.float64)

    @cached_property
    def _shape(self) -> _Shape:
        if np.allclose(self.low + self.high, 2.0 * self.mean, rtol=1e-9, atol=_LEAST):
            return _Shape(self.mean, self.std, self.std, log=False)
        if (self.low > 0.0).all() and np.isfinite(self.high).all():
            low, high = np.log(self.low), np.log(self.high)
            width = 0.25 * (high - low)
            return _Shape(0.5 * (low + high), width, width, log=True)
        below, above = 0.5 * (self.mean - self.low), 0.5 * (self.high - self.mean)
        return _Shape(self.mean, below, above, log=False)
