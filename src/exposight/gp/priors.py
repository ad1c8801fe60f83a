"""Priors of hyperparameters, for fits that know more than the observations say."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from exposight.errors import InputError
from exposight.gp.observations import FloatArray


@dataclass(frozen=True, kw_only=True)
class LogNormal:
    """A prior under which the logarithm of a hyperparameter is normal.

    Attributes
    ----------
    median : float
        In the hyperparameter's own unit.
    spread : float
        Standard deviation of its natural logarithm: two thirds of the prior lie between
        median · e^−spread and median · e^spread.

    Raises
    ------
    InputError
        If a value is not positive and finite.
    """

    median: float
    spread: float

    def __post_init__(self) -> None:
        if not all(value > 0.0 and math.isfinite(value) for value in (self.median, self.spread)):
            msg = (
                "a log-normal prior takes a positive median and spread, got "
                f"median={self.median!r}, spread={self.spread!r}"
            )
            raise InputError(msg)


NO_PRIORS: Mapping[str, LogNormal] = MappingProxyType({})
"""All hyperparameters count as equally likely."""


def check_priors(priors: Mapping[str, LogNormal], names: Sequence[str]) -> None:
    """Check that priors are of hyperparameters that a fit may change.

    Parameters
    ----------
    priors : mapping of str to LogNormal
    names : sequence of str
        Of the free hyperparameters.

    Raises
    ------
    InputError
        If a name is not among them.
    """
    if unknown := sorted(set(priors) - set(names)):
        msg = f"priors are given for {unknown}, but the free hyperparameters are {list(names)}"
        raise InputError(msg)


def log_prior(
    priors: Mapping[str, LogNormal], names: Sequence[str], logs: FloatArray
) -> tuple[float, FloatArray]:
    """Log density of the hyperparameters' logarithms, and its gradient.

    Parameters
    ----------
    priors : mapping of str to LogNormal
        By name; hyperparameters without one count as equally likely everywhere.
    names : sequence of str
        One for each logarithm.
    logs : (p,) array
        Natural logarithms.

    Returns
    -------
    value : float
    gradient : (p,) array
    """
    value, gradient = 0.0, np.zeros(len(logs))
    for index, name in enumerate(names):
        if (prior := priors.get(name)) is not None:
            z = (float(logs[index]) - math.log(prior.median)) / prior.spread
            value -= 0.5 * z**2 + math.log(prior.spread * math.sqrt(2.0 * math.pi))
            gradient[index] = -z / prior.spread
    return value, gradient
