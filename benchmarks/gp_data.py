"""Problems for the Gaussian processes: of the paper's sizes, drawn from their own priors."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from exposight.gp import ChangePoint, Exponential, Kernel, RationalQuadratic

# Table 9 of the paper, dataset X: i_avg, then x, y, z in mm and w, p in degrees. Every row lies
# inside the change points, so that no library gains by leaving rows out.
_LOW = np.array([14.0, -325.0, -200.0, -188.0, -20.0, -20.0])
_HIGH = np.array([255.0, 233.0, 200.0, 169.0, 20.0, 20.0])
_START_SPREAD = 1.0


@dataclass(frozen=True, kw_only=True)
class Problem:
    """Observations, the form of their kernel, and where fits begin.

    Parameters
    ----------
    name : str
        Suffix of the figures.
    kernel : Kernel
        With the hyperparameters from which the targets were drawn.
    noise_variance : float
        Of the targets.
    x, y : (n, D) and (n,) ndarray
        Observations.
    starts : (3, p + 1) ndarray
        Natural logarithms of the hyperparameters, then of the noise variance.
    new : (100, D) ndarray
        Where to predict.
    """

    name: str
    kernel: Kernel
    noise_variance: float
    x: NDArray[np.float64]
    y: NDArray[np.float64]
    starts: NDArray[np.float64]
    new: NDArray[np.float64]


def quality_kernel() -> Kernel:
    """Return Eq. 9 over four inputs, every pair of them at a moderate distance."""
    smooth = RationalQuadratic(
        variance=0.3, length_scales=(60.0, 250.0, 200.0, 150.0), alpha=0.6, dims=(0, 1, 2, 3)
    )
    return smooth * ChangePoint(dim=0, minimum=10.0) * ChangePoint(dim=0, maximum=255.0)


def exposure_kernel() -> Kernel:
    """Return Eq. 21: a kernel of the brightness times one of the pose, the latter's variance 1."""
    return Exponential(variance=900.0, length_scales=(200.0,), dims=(0,)) * Exponential(
        variance=1.0,
        length_scales=(500.0, 400.0, 300.0, 40.0, 40.0),
        dims=(1, 2, 3, 4, 5),
        fixed=("variance",),
    )


def quality_problem() -> Problem:
    """Return Q: as many observations and inputs as the paper's q_k4."""
    return _problem("q", quality_kernel(), 0.003, rows=912, columns=4)


def exposure_problem() -> Problem:
    """Return E: as many observations and inputs as the paper's model on eX⁺⁺."""
    return _problem("e", exposure_kernel(), 9.0, rows=1936, columns=6)


def inputs(rng: np.random.Generator, rows: int, columns: int) -> NDArray[np.float64]:
    """Draw inputs from the box of dataset X."""
    return rng.uniform(_LOW[:columns], _HIGH[:columns], size=(rows, columns))


def _problem(
    name: str, kernel: Kernel, noise_variance: float, *, rows: int, columns: int
) -> Problem:
    rng = np.random.default_rng(2025)
    x = inputs(rng, rows, columns)
    covariance = kernel.value(x, x) + noise_variance * np.eye(rows)
    truth = np.append(kernel.log_parameters, np.log(noise_variance))
    # every start is off the truth, each in another direction
    starts = truth + _START_SPREAD * rng.standard_normal((3, len(truth)))
    return Problem(
        name=name,
        kernel=kernel,
        noise_variance=noise_variance,
        x=x,
        y=np.linalg.cholesky(covariance) @ rng.standard_normal(rows),
        starts=starts,
        new=inputs(rng, 100, columns),
    )
