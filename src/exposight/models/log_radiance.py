"""The radiance of rings as a Gaussian process round what physics says of it.

    ln L = c + ln mean_k R_k + g_sensor(x, y, z) + g_surface(h) + a_feature + b_view + ε

R is `RingLight`'s formula; what the sensor does beyond it depends on position, what the surface
does beyond it on the half vector h; a and b are effects of feature and view. c, the lobe's s and
α, the variances and length scales are found at the maximum of their posterior, with gradients by
formula. What remains uncertain of c, s and α is kept by linearising the formula there, so that
few captures are not taken for many. Rings that clip, or stay dark, in all captures enter as
limits, by expectation propagation (Minka 2001).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.distance import cdist
from scipy.stats import chi2
from scipy.stats import t as student_t

from exposight.cell import ActiveSensor
from exposight.errors import InputError, ObservationError
from exposight.gp import GaussianProcess, Linear, Sum
from exposight.models.radiance_search import (
    ANGLES,
    COLUMNS,
    FEATURE,
    FORMULA_STD,
    HALF,
    KNOWN_LOBE_STD,
    POSITION,
    REACH,
    SLOPES,
    VIEW,
    Formula,
    MeanKind,
    Search,
    centred,
    covariance_of,
    with_limits,
)
from exposight.models.ring_data import RingData
from exposight.models.ring_light import RingLight, Rings

FloatArray: TypeAlias = NDArray[np.float64]


SEARCHED_RINGS = 1500
"""A dozen hyperparameters are found on so many rings at most; more hardly move them."""

SURPRISE = 1e-5
"""Chance below which brightness is not that of the surface that was learnt."""

SOFT_STD = 0.015
"""ln of brightness from one capture to the next: noise, rounding."""

SAME_PLACE_MM = 1.0
"""By how much poses of one view may differ: they are read back, or aligned, anew."""


def check_learnt_from(x: FloatArray, features: Sequence[str], views: Sequence[str]) -> None:
    """Check rings that a process was conditioned on: their columns, and numbers of names.

    Raises
    ------
    InputError
        If there are other columns, a name is there twice, or a number has no name.
    """
    if x.ndim != 2 or x.shape[1] != COLUMNS:
        msg = f"inputs.npy must have {COLUMNS} columns, got shape {x.shape}"
        raise InputError(msg)
    for what, names, column in (("feature", features, FEATURE), ("view", views, VIEW)):
        numbers = x[:, column]
        is_known = (numbers == np.rint(numbers)) & (numbers >= -1) & (numbers < len(names))
        if len(set(names)) < len(names) or not is_known.all():
            msg = f"inputs.npy must number each {what} as it is listed, and each is listed once"
            raise InputError(msg)


class RingPrediction(NamedTuple):
    """ln radiance of n rings: mean (n,), covariance (n, n), distance (n,) from what was learnt.

    The covariance holds `widening`, (n,), the factors of the standard deviations.
    """

    mean: FloatArray
    covariance: FloatArray
    distance: FloatArray
    light: RingLight | None
    widening: FloatArray


@dataclass(frozen=True, kw_only=True, eq=False)
class LogRadiance:
    """ln of rings' radiance, learnt; build it with `fit`.

    Parameters
    ----------
    formula : Formula
        The mean, with its parameters at the maximum of the posterior.
    formula_prior : ((float, float, float), (float, float, float))
        Mean and standard deviation of the prior of c, s and logit α.
    process : GaussianProcess
        What goes beyond the formula, conditioned on rings; its inputs are position, half vector,
        angles, numbers of feature and view, and the formula's derivatives.
    sensor : ActiveSensor or None
        Where its devices are.
    features, views : tuple of str
        Names by number.
    widening : (float, float)
        Factors of the standard deviation for unseen features and for unseen views of known
        features: Student's t for as many groups, and the conformal factor of leaving each out.
    evaluations : int
        Of the posterior.
    """

    formula: Formula
    formula_prior: tuple[tuple[float, ...], tuple[float, ...]]
    process: GaussianProcess
    sensor: ActiveSensor | None
    features: tuple[str, ...]
    views: tuple[str, ...]
    widening: tuple[float, float] = (1.0, 1.0)
    evaluations: int = 0

    @classmethod
    def fit(
        cls,
        data: RingData,
        sensor: ActiveSensor | None,
        *,
        kind: MeanKind = "projector",
        start_from: LogRadiance | None = None,
        same_surface: bool = False,
        evaluated: Callable[[], None] = lambda: None,
    ) -> LogRadiance:
        """Learn from rings.

        Parameters
        ----------
        data : RingData
            At least one whose radiance was measured.
        sensor : ActiveSensor or None
            Needed unless `kind` is 'none'.
        kind : {'projector', 'camera', 'none'}
            What the physical mean knows.
        start_from : LogRadiance, optional
            Of another surface or another sensor: its hyperparameters are the priors' centres.
        same_surface : bool
            Whether that is the same surface, whose lobe is known then.
        evaluated : callable
            Called after each evaluation of the posterior.

        Raises
        ------
        ObservationError
            If every ring clips or stays dark in all captures.
        """
        known = data.limit == 0
        if not known.any():
            msg = (
                f"all {len(data)} rings clip or stay dark in every capture, so nothing tells how "
                "bright they are; add captures at exposure times between"
            )
            raise ObservationError(msg)
        rings = data.rings
        features, views = (tuple(dict.fromkeys(names)) for names in (rings.features, rings.views))
        formula = Formula(kind=kind)
        light = formula.light(rings, sensor)
        kernel, priors = covariance_of(kind, one_image=data.source == "i_avg")
        if start_from is not None and start_from.formula.kind == kind:
            priors = centred(priors, start_from.process, len(priors))
        first, _ = formula.evaluate(light, len(data))
        level = float(np.median((data.log_radiance - first)[known]))
        formula, std = replace(formula, level=level), FORMULA_STD
        if same_surface and start_from is not None:
            known_lobe = start_from.formula.parameters
            formula, std = formula.with_parameters([level, *known_lobe[1:]]), KNOWN_LOBE_STD
        some = data.thinned(SEARCHED_RINGS)
        some_light = light if some is data else formula.light(some.rings, sensor)
        search = Search(some, some_light, formula, std, kernel, priors)
        x = _inputs(some.rings, some_light, formula, features, views)[0]
        found, logs, evaluations = search.run(x[some.limit == 0], evaluated)
        whole = kernel.with_log_parameters(logs[:-1]) + Linear(
            variances=tuple((std**2).tolist()), dims=SLOPES, fixed=("variances",)
        )
        x, mean = _inputs(rings, light, found, features, views)
        # the parameters' prior is not centred where they were found
        target = data.log_radiance - mean - x[:, SLOPES] @ (formula.parameters - found.parameters)
        process = GaussianProcess.condition(
            whole, float(np.exp(logs[-1])), x[known], target[known], row_noise=data.variance[known]
        )
        if not known.all():
            process = with_limits(process, x[~known], target[~known], data.limit[~known])
        model = cls(
            formula=found,
            formula_prior=(tuple(formula.parameters.tolist()), tuple(std.tolist())),
            process=process,
            sensor=sensor,
            features=features,
            views=views,
            evaluations=evaluations,
        )
        return replace(model, widening=model._widening())

    def _widening(self) -> tuple[float, float]:
        factors = []
        for column in (FEATURE, VIEW):
            groups = self.process.x[:, column]
            n = len(np.unique(groups))
            if n < 3:
                factors.append(float(student_t.ppf(0.977, 1)) / 2.0 if n < 2 else 2.5)
                continue
            left_out = self.process.leave_out(groups)
            score = np.abs(self.process.y - left_out.mean) / left_out.std
            quantile = float(np.quantile(score, min(1.0, 0.954 * (1.0 + 1.0 / len(score)))))
            factors.append(float(student_t.ppf(0.977, n - 1)) / 2.0 * max(1.0, quantile / 2.0))
        return factors[0], factors[1]

    def left_out(self, group: Literal["feature", "view"]) -> tuple[FloatArray, FloatArray]:
        """Return errors of ln radiance, and the standard deviations said, leaving groups out.

        Each ring is predicted from those of all other features, or views, in closed form.
        """
        column = FEATURE if group == "feature" else VIEW
        prediction = self.process.leave_out(self.process.x[:, column])
        return prediction.mean - self.process.y, prediction.std * self.widening[column - FEATURE]

    def predict(self, rings: Rings) -> RingPrediction:
        """Predict ln radiance of n rings jointly, the scatter from ring to ring included."""
        rings = self._views_told_apart(rings)
        light = self.formula.light(rings, self.sensor)
        x, mean = _inputs(rings, light, self.formula, self.features, self.views)
        joint = self.process.predict_jointly(x, include_noise=True)
        shift = x[:, SLOPES] @ self._shift
        unseen = x[:, FEATURE] < 0
        widening = np.where(unseen, *self.widening)
        return RingPrediction(
            mean=mean + shift + joint.mean,
            covariance=joint.covariance * np.outer(widening, widening),
            distance=self._distance(x),
            light=light,
            widening=widening,
        )

    def holds(self, rings: Rings) -> NDArray[np.bool_]:
        """Return whether rings were learnt: of a feature by that name, at that very pose."""
        x = self.process.x
        learnt = {
            (self.features[int(feature)], *place)
            for feature, place in zip(x[:, FEATURE], _places(x[:, POSITION]), strict=True)
        }
        places = zip(rings.features, _places(rings.positions), strict=True)
        return np.array([(name, *place) in learnt for name, place in places], dtype=np.bool_)

    @property
    def _shift(self) -> FloatArray:
        return np.array(self.formula_prior[0]) - self.formula.parameters

    def with_rings(self, data: RingData) -> LogRadiance:
        """Learn from more rings; the hyperparameters and the formula's parameters stay.

        Bands are widened anew, for as many features and views as there are then.
        """
        known = data.limit == 0
        rings = self._views_told_apart(data.rings.take(np.flatnonzero(known)))
        if len(rings) == 0:
            return self
        features = tuple(dict.fromkeys((*self.features, *rings.features)))
        views = tuple(dict.fromkeys((*self.views, *rings.views)))
        light = self.formula.light(rings, self.sensor)
        x, mean = _inputs(rings, light, self.formula, features, views)
        target = data.log_radiance[known] - mean - x[:, SLOPES] @ self._shift
        process = self.process.with_observations(x, target, row_noise=data.variance[known])
        model = replace(self, process=process, features=features, views=views)
        return replace(model, widening=model._widening())

    def surprise(self, data: RingData) -> float | None:
        """Return how many times as bright as expected rings are; None where that can be.

        Judged jointly, by what is uncertain of their radiance (chance below 1 in 100 000).
        """
        known = np.flatnonzero(data.limit == 0)
        if len(known) == 0:
            return None
        prediction = self.predict(data.rings.take(known))
        error = data.log_radiance[known] - prediction.mean
        within = prediction.covariance + np.diag(data.variance[known] + SOFT_STD**2)
        squared = float(error @ np.linalg.solve(within, error))
        if float(chi2.sf(squared, len(known))) >= SURPRISE:
            return None
        return math.exp(float(np.median(error)))

    @cached_property
    def _places(self) -> dict[tuple[str, str], FloatArray]:
        """Where each feature was in each view that was learnt, mm."""
        return {
            (self.features[int(row[FEATURE])], self.views[int(row[VIEW])]): row[list(POSITION)]
            for row in self.process.x
        }

    def _views_told_apart(self, rings: Rings) -> Rings:
        """Rename views that have the name of a learnt one, and features in other places."""
        places = zip(rings.keys, rings.positions, strict=True)
        elsewhere = {
            key[1]
            for key, place in places
            if key in self._places and np.abs(place - self._places[key]).max() > SAME_PLACE_MM
        }
        if not elsewhere:
            return rings
        views = (f"{view}, elsewhere" if view in elsewhere else view for view in rings.views)
        return replace(rings, views=tuple(views))

    def knows(self, rings: Rings) -> NDArray[np.bool_]:
        """Return which rings were learnt from: of the same feature and view, in the same place."""
        places = zip(rings.keys, rings.positions, strict=True)
        return np.array(
            [
                key in self._places and np.array_equal(place, self._places[key])
                for key, place in places
            ]
        )

    def spread(self, rings: Rings, light: RingLight | None) -> FloatArray:
        """Return ln radiance at the points of rings, (n, k), up to a constant of each ring."""
        if light is None:
            return self._beyond_at_points(rings, None)
        values, _ = light.log_radiance(self.formula.log_ratio, self.formula.roughness)
        if self.formula.kind == "projector":
            return values + self._surface_beyond(light.half)
        return values + self._beyond_at_points(rings, light)

    def _beyond_at_points(self, rings: Rings, light: RingLight | None) -> FloatArray:
        """Return what goes beyond the formula at the points of rings, effects aside."""
        points = rings.points()
        n, k = points.shape[:2]
        x = np.zeros((n * k, COLUMNS))
        x[:, POSITION] = points.reshape(-1, 3)
        x[:, ANGLES] = np.repeat(rings.poses[:, 3:5], k, axis=0)
        if light is not None:
            x[:, HALF] = light.half.reshape(-1, 2)
        kernel = self.process.kernel
        place = kernel.terms[0] if isinstance(kernel, Sum) else kernel
        values = place.value(x, self.process.x) @ self.process.weights
        out: FloatArray = values.reshape(n, k)
        return out

    def _surface_beyond(self, half: FloatArray) -> FloatArray:
        """Return g_surface, what the surface does beyond the formula, at half vectors (…, 2).

        Interpolated on a grid over the half vectors that were learnt from.
        """
        low, step, values = self._surface_grid
        place = np.clip((half - low) / step, 0.0, np.array(values.shape) - 1.000001)
        cell = place.astype(np.int64)
        (a, b), (i, j) = np.moveaxis(place - cell, -1, 0), np.moveaxis(cell, -1, 0)
        out: FloatArray = (1 - a) * ((1 - b) * values[i, j] + b * values[i, j + 1]) + a * (
            (1 - b) * values[i + 1, j] + b * values[i + 1, j + 1]
        )
        return out

    @cached_property
    def _surface_grid(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        kernel = self.process.kernel
        surface = kernel.terms[1] if isinstance(kernel, Sum) else kernel
        trained = self.process.x[:, HALF]
        scales = np.array([p.value for p in surface.parameters[1:]])
        margin = np.minimum(2.0 * scales, 0.3)
        low, high = trained.min(axis=0) - margin, trained.max(axis=0) + margin
        counts = np.clip(np.ceil((high - low) / (scales / 8.0)), 12, 80).astype(np.int64)
        axes = [np.linspace(*ends) for ends in zip(low, high, counts, strict=True)]
        x = np.zeros((int(counts.prod()), COLUMNS))
        x[:, HALF] = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 2)
        weights = self.process.weights
        values = (surface.value(x, self.process.x) @ weights).reshape(counts)
        return low, (high - low) / (counts - 1), values

    @cached_property
    def _scales(self) -> FloatArray:
        """Learnt length scales of positions, half vectors and angles; infinite where not read.

        Where nothing goes beyond the formula they grow without limit; it holds no farther than the
        prior's reach.
        """
        scales = np.full(COLUMNS, np.inf)
        for each in self.process.kernel.parameters:
            if each.quantity.value == "length_scale":
                dims = list(each.dims)
                scales[dims] = np.minimum(each.value, REACH[dims])
        return scales

    def _distance(self, x: FloatArray) -> FloatArray:
        """Return how far rings are from the nearest learnt one, in length scales, (n,).

        The farther of position and half vector, each to its own nearest ring: their terms add.
        """
        distances = []
        for dims in (POSITION, HALF, ANGLES):
            columns, scales = list(dims), self._scales[list(dims)]
            if not np.isfinite(scales).all():
                continue
            apart = cdist(x[:, columns] / scales, self.process.x[:, columns] / scales)
            distances.append(apart.min(axis=1))
        out: FloatArray = np.max(distances, axis=0)
        return out


def _places(positions: FloatArray) -> list[list[float]]:
    """Return positions to 0.1 µm, as tables keep them."""
    return (np.round(positions, 4) + 0.0).tolist()  # type: ignore[no-any-return]


def _codes(names: Sequence[str], known: Sequence[str]) -> list[float]:
    """Return names' places among the known ones; others count from −1 down, equal ones alike."""
    number = {name: float(place) for place, name in enumerate(known)}
    for name in names:
        number.setdefault(name, len(known) - 1.0 - len(number))
    return [number[name] for name in names]


def _inputs(
    rings: Rings,
    light: RingLight | None,
    formula: Formula,
    features: Sequence[str],
    views: Sequence[str],
) -> tuple[FloatArray, FloatArray]:
    """Return rings as the process reads them, (n, 12), and the formula's ln radiance, (n,)."""
    x = np.zeros((len(rings), COLUMNS))
    x[:, POSITION] = rings.positions
    x[:, ANGLES] = rings.poses[:, 3:5]
    if light is not None:
        x[:, HALF] = light.half.mean(axis=1)
    x[:, FEATURE] = _codes(rings.features, features)
    x[:, VIEW] = _codes(rings.views, views)
    mean, x[:, SLOPES] = formula.evaluate(light, len(rings))
    return x, mean
