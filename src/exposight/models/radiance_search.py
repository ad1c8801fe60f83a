"""How the radiance model's parameters are found: priors, covariance, the climb, and limits."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Literal, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize
from scipy.special import log_ndtr

from exposight.cell import ActiveSensor
from exposight.gp import Category, GaussianProcess, Kernel, Matern52, SquaredExponential, Sum
from exposight.gp.likelihood import MarginalLikelihood
from exposight.models.ring_data import RingData
from exposight.models.ring_light import RingLight, Rings, log_mean

FloatArray: TypeAlias = NDArray[np.float64]

MeanKind: TypeAlias = Literal["projector", "camera", "none"]
"""What the physical mean knows: the projector's pose; the camera's alone, from which light is then
taken to come; or nothing, which leaves a constant."""

POSITION, HALF, ANGLES, FEATURE, VIEW, SLOPES = (0, 1, 2), (3, 4), (5, 6), 7, 8, (9, 10, 11)
COLUMNS = 12
"""Columns of the process's inputs: position, half vector, angles, numbers of feature and view, and
the formula's derivatives."""

FORMULA_STD = np.array([30.0, 2.5, 1.2])
"""Prior standard deviation of c, which is free, of s ~ N(1, 2.5²) and of logit α ~ N(−1, 1.2²)."""

KNOWN_LOBE_STD = np.array([30.0, 0.3, 0.15])
"""The same, where the lobe was learnt on the same surface with another sensor."""

_UNLIT = -40.0
"""ln radiance of a ring that the formula leaves in the dark."""

_SOFT = 0.05
"""How uncertain a limit of ln radiance is: clipped pixels pull a mean down by some percent."""


class _Prior(NamedTuple):
    """Normal prior of a hyperparameter's natural logarithm, and its least value."""

    mean: float
    std: float
    least: float = -math.inf


def _variance(std: float, width: float = 1.5) -> _Prior:
    return _Prior(2.0 * math.log(std), width)


# Weak and log-normal. 14 % beyond a formula, 5 % from feature to feature, 2 % from view to view and
# ring to ring; part of the working volume, a lobe's width. Without a formula: a factor of four, the
# whole volume, 40°.
_BEYOND, _PRODUCT, _ALONE = _variance(0.14), _variance(0.5), _variance(1.4)
_OF_FEATURE, _OF_VIEW, _OF_RING = _variance(0.05, 1.0), _variance(0.02, 1.0), _variance(0.02, 1.0)
_OF_STRIPES = _variance(0.15, 0.5)
# Nothing shorter than the third numbers: it would be single rings'.
_MM, _SLOPE, _WIDE_MM, _WIDE_DEG = (
    _Prior(math.log(median), 0.7, math.log(least))
    for median, least in ((300.0, 75.0), (0.25, 0.05), (600.0, 75.0), (40.0, 5.0))
)


REACH = np.array([600.0] * 3 + [0.4] * 2 + [40.0] * 2 + [np.inf] * 5)
"""Largest length scales by which distances from what was learnt are measured: mm, parts of a half
vector, degrees; twice the medians of the priors, or nearly."""


@dataclass(frozen=True, kw_only=True)
class Formula:
    """The physical mean with its parameters.

    Parameters
    ----------
    kind : {'projector', 'camera', 'none'}
        What it knows.
    level : float
        c, ln of grey levels · mm² per ms.
    log_ratio : float
        s, ln of specular over diffuse reflectance.
    logit_roughness : float
        ln(α/(1 − α)) of the lobe.
    """

    kind: MeanKind
    level: float = 0.0
    log_ratio: float = 1.0
    logit_roughness: float = -1.0

    @property
    def parameters(self) -> FloatArray:
        """c, s and logit α."""
        return np.array([self.level, self.log_ratio, self.logit_roughness])

    @property
    def roughness(self) -> float:
        """α of the lobe."""
        return 1.0 / (1.0 + math.exp(-self.logit_roughness))

    def with_parameters(self, values: FloatArray | Sequence[float]) -> Formula:
        """Return the formula with other c, s and logit α."""
        level, log_ratio, logit = map(float, values)
        return replace(self, level=level, log_ratio=log_ratio, logit_roughness=logit)

    def light(self, rings: Rings, sensor: ActiveSensor | None) -> RingLight | None:
        """Return light's way to rings; None where the formula knows nothing."""
        if self.kind == "none" or sensor is None:
            return None
        return RingLight.of(rings, sensor, projector=self.kind == "projector")

    def evaluate(self, light: RingLight | None, n: int) -> tuple[FloatArray, FloatArray]:
        """Return ln radiance of n rings, (n,), and its derivatives by the parameters, (n, 3)."""
        slopes = np.zeros((n, 3))
        slopes[:, 0] = 1.0
        if light is None:
            return np.full(n, self.level), slopes
        alpha = self.roughness
        values, by_point = light.log_radiance(self.log_ratio, alpha)
        mean = log_mean(values)
        share = np.exp(values - np.where(np.isfinite(mean), mean, 0.0)[:, None])
        share /= values.shape[1]
        slopes[:, 1] = np.einsum("ij,ij->i", share, by_point[0])
        slopes[:, 2] = np.einsum("ij,ij->i", share, by_point[1]) * alpha * (1.0 - alpha)
        return self.level + np.maximum(mean, _UNLIT), slopes


def covariance_of(kind: MeanKind, *, one_image: bool) -> tuple[Kernel, list[_Prior]]:
    """Return the covariance's form, and priors of its free hyperparameters and of the noise.

    Brightness of one stripe image (`one_image`) depends on where stripes lie, which a short length
    scale would follow at the places that were learnt from, and only there.
    """
    near = _Prior(_MM.mean, _MM.std, math.log(400.0)) if one_image else _MM

    def matern(dims: tuple[int, ...], scales: list[_Prior], variance: _Prior | None) -> Kernel:
        return Matern52(
            variance=1.0 if variance is None else math.exp(variance.mean),
            length_scales=tuple(math.exp(each.mean) for each in scales),
            dims=dims,
            fixed=() if variance else ("variance",),
        )

    terms: tuple[Kernel, ...]
    if kind == "none":  # nothing else carries the trend, which is smooth
        scales = [_WIDE_MM] * 3 + [_WIDE_DEG] * 2
        terms = (
            SquaredExponential(
                variance=math.exp(_ALONE.mean),
                length_scales=tuple(math.exp(each.mean) for each in scales),
                dims=(*POSITION, *ANGLES),
            ),
        )
        priors = [_ALONE, *scales]
    elif kind == "projector":
        terms = (
            matern(POSITION, [near] * 3, _BEYOND),
            matern(HALF, [_SLOPE] * 2, _BEYOND),
        )
        priors = [_BEYOND, *[near] * 3, _BEYOND, *[_SLOPE] * 2]
    else:  # what the half vector means then depends on the position
        terms = (matern(POSITION, [near] * 3, None) * matern(HALF, [_SLOPE] * 2, _PRODUCT),)
        priors = [*[near] * 3, _PRODUCT, *[_SLOPE] * 2]
    effects = (
        Category(variance=math.exp(_OF_FEATURE.mean), dim=FEATURE),
        Category(variance=math.exp(_OF_VIEW.mean), dim=VIEW),
    )
    return Sum(terms=(*terms, *effects)), [
        *priors,
        _OF_FEATURE,
        _OF_VIEW,
        _OF_STRIPES if one_image else _OF_RING,
    ]


def centred(priors: list[_Prior], process: GaussianProcess, free: int) -> list[_Prior]:
    """Centre priors on what another model found, narrower by half."""
    found = [each.value for each in process.kernel.free_parameters[: free - 1]]
    return [
        _Prior(math.log(value), 0.5 * prior.std, prior.least)
        for prior, value in zip(priors, [*found, process.noise_variance], strict=True)
    ]


@dataclass(frozen=True, eq=False)
class Search:
    """The climb to the posterior's maximum."""

    data: RingData
    light: RingLight | None
    formula: Formula  # at the centre of its prior
    formula_std: FloatArray
    kernel: Kernel
    priors: list[_Prior]

    def run(
        self, x: FloatArray, evaluated: Callable[[], None] = lambda: None
    ) -> tuple[Formula, FloatArray, int]:
        """Return the formula, the hyperparameters' logarithms (noise last), and evaluations.

        `evaluated` is called after each of them.
        """
        known = self.data.limit == 0
        y = self.data.log_radiance[known]
        likelihood = MarginalLikelihood(
            x, y, active=np.ones(len(y), dtype=np.bool_), row_noise=self.data.variance[known]
        )
        centre, std = (np.array([each[place] for each in self.priors]) for place in range(2))
        origin = self.formula.parameters
        free = 1 if self.light is None else 3

        def loss(vector: FloatArray) -> tuple[float, FloatArray]:
            parameters, logs = origin.copy(), vector[free:]
            parameters[:free] = vector[:free]
            mean, slopes = self.formula.with_parameters(parameters).evaluate(
                self.light, len(self.data)
            )
            value, by_logs, alpha = likelihood.evaluate(
                self.kernel.with_log_parameters(logs[:-1]),
                float(np.exp(logs[-1])),
                y - mean[known],
            )
            evaluated()
            z, z_formula = (logs - centre) / std, (parameters - origin) / self.formula_std
            by_formula = slopes[known].T @ alpha - z_formula / self.formula_std
            gradient = np.concatenate([by_formula[:free], by_logs - z / std])
            total = value - 0.5 * float(z @ z + z_formula @ z_formula)
            return -total / len(y), -gradient / len(y)

        limits = [(-50.0, 60.0), (-12.0, 12.0), (-8.0, 4.0)][:free]
        limits += [
            (max(each.least, each.mean - 6 * each.std), each.mean + 6 * each.std)
            for each in self.priors
        ]
        end = minimize(
            loss,
            np.concatenate([origin[:free], centre]),
            jac=True,
            method="L-BFGS-B",
            bounds=limits,
            options={"ftol": 1e-8, "gtol": 1e-4, "maxiter": 300},
        )
        parameters = origin.copy()
        parameters[:free] = end.x[:free]
        return self.formula.with_parameters(parameters), end.x[free:], int(end.nfev)


def with_limits(
    process: GaussianProcess, x: FloatArray, limit: FloatArray, sign: NDArray[np.int64]
) -> GaussianProcess:
    """Condition on values being above (sign 1) or below (−1) limits, as Gaussian sites."""
    prediction = process.predict(x, include_noise=True)
    mean, variance = prediction.mean, prediction.std**2
    precision, target = np.zeros(len(x)), np.zeros(len(x))
    best = process
    for _ in range(4):
        spread = np.sqrt(variance + _SOFT**2)
        z = sign * (mean - limit) / spread
        hazard = np.exp(-0.5 * z * z - 0.5 * math.log(2.0 * math.pi) - log_ndtr(z))
        new_mean = mean + sign * variance / spread * hazard
        new_variance = variance - (variance / spread) ** 2 * hazard * (hazard + z)
        precision = np.maximum(1.0 / np.maximum(new_variance, 1e-12) - 1.0 / variance, 1e-4)
        target = (new_mean / new_variance - mean / variance) / precision
        best = process.with_observations(x, target, row_noise=1.0 / precision)
        cavity = best.leave_out(np.arange(len(best.y)))
        mean = cavity.mean[-len(x) :]
        variance = np.maximum(cavity.std[-len(x) :] ** 2 - 1.0 / precision, 1e-9)
    return best
