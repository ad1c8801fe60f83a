"""A committee of exact experts, for tens to hundreds of thousands of observations.

The generalised robust Bayesian committee machine of Liu, Cai, Wang, Ong (2018), "Generalized
robust Bayesian committee machine for large-scale Gaussian process regression". A random sample of
the observations, the communication set, is known to every expert; the others are split by space.
What each expert's shard adds to the communication set's precision and mean is weighted by how much
the expert learnt from it.

Of the committees tried on 10 000 observations of a smooth p_norm (`benchmarks/gp_more_data.py`,
five experts) it lost least against the exact process: 3 to 5 % of the RMSE about the truth, where
the robust committee machine and the generalised product of experts lost 8 % and the surest expert
alone 10 %; and one standard deviation covered the truth as often as the exact process's did, where
the robust committee machine was far overconfident and the product of experts underconfident.

A committee pays off from about 3000 observations on. CPU seconds of an exact fit and of
`fit_committee` with its default sizes, three starts, one thread, and the RMSE of 1000 predictions
about the truth, for the same p_norm with noise of 0.03, exact / committee (exact fits of 3000 and
more rows are one evaluation times the 101 of the first):

====  =============  =======  =================
rows  fit            experts  RMSE
====  =============  =======  =================
2000  20 s / 3.5 s   1        0.0200 / 0.0202
3000  75 s / 7.5 s   1        0.0170 / 0.0170
4000  164 s / 7.2 s  2        0.0150 / 0.0151
6000  512 s / 12 s   3        0.0131 / 0.0135
====  =============  =======  =================

Every expert predicts every row. Skipping those that add nothing would not pay: with length scales
of a tenth of the box, twenty experts and three to six columns, 0.2 to 58 % of the predictions,
depending on the kernel, matter less than 1e-10, and finding out which takes half the time of a
prediction, because the communication set links rows to shards far from them.
"""

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from exposight.gp import observations
from exposight.gp.experts import CommunicationSet, Expert, check_shards, partition
from exposight.gp.kernels import Kernel
from exposight.gp.memory import DOUBLE_BYTES, check_memory
from exposight.gp.regression import Prediction
from exposight.gp.tiling import choose_threads, in_threads, limit_blas, predict_in_chunks
from exposight.workers import Progress, ignore_progress

# Rows predicted at once: 8 MB of covariances with an expert of 2000 observations.
_CHUNK = 500
# Pairs of rows and observations from which on a prediction takes long enough to share it.
_MANY_PAIRS = 1_000_000
# A variance counts as at least this share of the prior's, so that precisions stay finite.
_LEAST_SHARE = 1e-14


@dataclass(frozen=True, kw_only=True, eq=False)
class Committee:
    """Exact experts on shards of many observations; build it with `condition` or `fit_committee`.

    `kernel`, `noise_variance`, `x`, `y` and `shard` describe it completely: `from_shards` rebuilds
    the same committee from them. An expert keeps m (m + c) numbers for a shard of m observations
    and c shared ones: 24 kB an observation as `fit_committee` chooses them, 2.4 GB for a hundred
    thousand. They stay out of a pickle; where it is opened they are computed when first needed.

    Attributes
    ----------
    kernel : Kernel
        Prior covariance, shared by all.
    noise_variance : float
        Shared by all, in squared units of the target.
    x : (n, D) array
        Training inputs, read-only.
    y : (n,) array
        Training targets, read-only.
    shard : (n,) int array
        The number of the expert to whom each observation belongs, read-only; −1 for those that
        all experts share, and for those outside the kernel's gate, which no expert needs.
    jitter : float
        The largest amount that had to be added to a covariance's diagonal to factorise it, in
        squared units of the target; 0 almost always.
    """

    kernel: Kernel
    noise_variance: float
    x: observations.FloatArray = field(repr=False)
    y: observations.FloatArray = field(repr=False)
    shard: observations.IntArray = field(repr=False)
    jitter: float

    def __getstate__(self) -> dict[str, object]:
        """Return what describes the committee: a worker hands it over without the gigabytes."""
        return {name: value for name, value in self.__dict__.items() if name != "_conditioned"}

    @cached_property
    def _conditioned(self) -> "_Conditioned":
        return _condition(self.kernel, self.noise_variance, self.x, self.y, self.shard)

    @property
    def experts(self) -> int:
        """Their number."""
        return int(self.shard.max()) + 1

    @property
    def n_observations(self) -> int:
        """How many the experts know together; those outside the kernel's gate do not count."""
        conditioned = self._conditioned
        return len(conditioned.shared.x) + sum(len(each.x) for each in conditioned.experts)

    @classmethod
    def condition(
        cls,
        kernel: Kernel,
        noise_variance: float,
        x: ArrayLike,
        y: ArrayLike,
        *,
        rng: np.random.Generator,
        shard_size: int = 2000,
        communication: int = 1000,
        threads: int | None = None,
        progress: Progress = ignore_progress,
    ) -> "Committee":
        """Condition experts on their shards of the observations.

        Parameters
        ----------
        kernel : Kernel
            Prior covariance; its length scales also measure space when the shards are cut.
        noise_variance : float
            Positive, in squared units of the target.
        x : (n, D) array
            Inputs, each column in its own unit.
        y : (n,) array
            Targets.
        rng : numpy.random.Generator
            Draws the communication set.
        shard_size : int
            Observations of one expert, at most: larger shards are slower and nearer to the exact
            process.
        communication : int
            Observations that all experts share.
        threads : int, optional
            That build experts at the same time; chosen if left out.
        progress : Progress
            Called with the stage "conditioning", experts done, and all experts.

        Returns
        -------
        Committee

        Raises
        ------
        InputError
            If the noise variance is not positive, or a size cannot be.
        ObservationError
            If the arrays do not fit together, are not finite, or lie wholly outside the kernel's
            range.
        NotPositiveDefiniteError
            If a covariance matrix has no Cholesky factor, even with the largest jitter.
        """
        inputs, targets, active = observations.check_observations(kernel, x, y)
        near = np.flatnonzero(active)
        parts = partition(
            kernel, inputs[near], rng, shard_size=shard_size, communication=communication
        )
        shard = np.full(len(targets), -1)
        for number, rows in enumerate(parts.shards):
            shard[near[rows]] = number
        return cls.from_shards(
            kernel, noise_variance, inputs, targets, shard, threads=threads, progress=progress
        )

    @classmethod
    def from_shards(
        cls,
        kernel: Kernel,
        noise_variance: float,
        x: ArrayLike,
        y: ArrayLike,
        shard: ArrayLike,
        *,
        threads: int | None = None,
        progress: Progress = ignore_progress,
    ) -> "Committee":
        """Condition experts on observations that have been shared out already.

        Parameters
        ----------
        kernel, noise_variance, x, y, threads, progress
            As for `condition`.
        shard : (n,) array of int
            As the attribute: which expert each observation belongs to, −1 for all of them.

        Returns
        -------
        Committee

        Raises
        ------
        InputError
            If the noise variance is not positive, or the shards are not numbered from 0 without
            gaps beside a communication set.
        ObservationError, NotPositiveDefiniteError
            As for `condition`.
        OutOfMemoryError
            If the experts do not fit into memory.
        """
        observations.check_noise_variance(noise_variance)
        inputs, targets, active = observations.check_observations(kernel, x, y)
        owner = check_shards(shard, active)
        conditioned = _condition(
            kernel, noise_variance, inputs, targets, owner, threads=threads, progress=progress
        )
        committee = cls(
            kernel=kernel,
            noise_variance=float(noise_variance),
            x=observations.read_only(inputs),
            y=observations.read_only(targets),
            shard=observations.read_only(owner),
            jitter=max(
                conditioned.shared.factor.jitter, *(each.jitter for each in conditioned.experts)
            ),
        )
        committee.__dict__["_conditioned"] = conditioned
        return committee

    def predict(
        self,
        x: ArrayLike,
        *,
        include_noise: bool = False,
        threads: int | None = None,
        progress: Progress = ignore_progress,
    ) -> Prediction:
        """Predict mean and standard deviation, in constant memory.

        Far from all observations the prior returns.

        Parameters
        ----------
        x : (m, D) array
            Inputs, columns as in training.
        include_noise, threads, progress
            As for `GaussianProcess.predict`.

        Returns
        -------
        Prediction

        Raises
        ------
        ObservationError, InputError
            As for `GaussianProcess.predict`.
        """
        inputs = observations.check_inputs(x, columns=self.x.shape[1])
        # outside the gate nothing is left to predict: mean and variance are 0
        rows = np.flatnonzero(~self.kernel.closed(inputs))
        mean, variance = np.zeros(len(inputs)), np.zeros(len(inputs))

        def predict_rows(chunk: slice) -> None:
            mean[rows[chunk]], variance[rows[chunk]] = self._mean_and_variance(inputs[rows[chunk]])

        predict_in_chunks(
            predict_rows,
            len(rows),
            chunk=_CHUNK,
            threads=threads,
            worthwhile=len(rows) * self.n_observations >= _MANY_PAIRS,
            progress=progress,
        )
        if include_noise:
            variance += self.noise_variance
        return Prediction(mean=mean, std=np.sqrt(variance))

    def _mean_and_variance(
        self, x: observations.FloatArray
    ) -> tuple[observations.FloatArray, observations.FloatArray]:
        """Combine the experts at checked inputs inside the gate, each (n,)."""
        prior = self.kernel.prior_variance(x)
        least = _LEAST_SHARE * prior
        shared, experts = self._conditioned.shared, self._conditioned.experts
        known = shared.project(self.kernel, x)
        shared_mean = shared.whitened @ known
        shared_variance = np.maximum(prior - np.einsum("ij,ij->j", known, known), least)
        precision = 1.0 / shared_variance
        weighted = shared_mean / shared_variance
        for number, expert in enumerate(experts):
            gain = expert.gain(self.kernel, x, known)
            taken = np.einsum("ij,ij->j", gain, gain)
            variance = np.maximum(shared_variance - taken, least)
            mean = shared_mean + expert.whitened @ gain
            # how much the expert learnt from its shard; the first one's weight makes a committee
            # of one exact
            weight = 0.5 * np.log(shared_variance / variance) if number > 0 else 1.0
            precision += weight * (1.0 / variance - 1.0 / shared_variance)
            weighted += weight * (mean / variance - shared_mean / shared_variance)
        return weighted / precision, 1.0 / precision


@dataclass(frozen=True)
class _Conditioned:
    """What the experts and the communication set know: the factors of their covariances."""

    shared: CommunicationSet
    experts: tuple[Expert, ...]


def _condition(
    kernel: Kernel,
    noise_variance: float,
    x: observations.FloatArray,
    y: observations.FloatArray,
    owner: observations.IntArray,
    *,
    threads: int | None = None,
    progress: Progress = ignore_progress,
) -> _Conditioned:
    """Condition the experts on checked observations that have been shared out."""
    active = ~kernel.closed(x)
    sizes = np.bincount(owner[active] + 1)
    check_memory(
        DOUBLE_BYTES * int(np.sum(sizes[1:] * (sizes[1:] + sizes[0])) + sizes[0] ** 2),
        f"a committee of {len(sizes) - 1} experts on {int(sizes.sum())} observations",
        "take smaller shards or fewer rows",
    )
    numbers = range(int(owner.max()) + 1)
    with limit_blas(1):
        known = np.flatnonzero(active & (owner == -1))
        shared = CommunicationSet.condition(kernel, noise_variance, x[known], y[known])

        def build(number: int) -> Expert:
            rows = np.flatnonzero(active & (owner == number))
            return Expert.condition(shared, kernel, noise_variance, x[rows], y[rows])

        count = choose_threads(threads, worthwhile=len(numbers) > 1)
        experts = []
        for expert in in_threads(build, numbers, threads=count):
            experts.append(expert)
            progress("conditioning", len(experts), len(numbers))
    return _Conditioned(shared, tuple(experts))
