"""Exact Gaussian-process regression: zero mean, Gaussian noise, float64."""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from exposight.gp.arguments import check_noise_variance, check_observations, check_rows
from exposight.gp.chunks import in_chunks
from exposight.gp.factor import Factor, factorise
from exposight.gp.kernels import Kernel
from exposight.gp.likelihood import MarginalLikelihood, white_noise_log_likelihood
from exposight.gp.observations import FloatArray, check_inputs, check_targets, read_only
from exposight.gp.posterior import Posterior, Prediction
from exposight.gp.threads import limit_blas
from exposight.gp.updates import append_rows, remove_rows
from exposight.workers import Progress, ignore_progress

# Rows predicted at once: large enough for matrix products at full speed, 30 MB at N = 2000.
_CHUNK = 2000
# Pairs of rows and observations from which on a prediction takes long enough to share it.
_MANY_PAIRS = 10_000_000


@dataclass(frozen=True, kw_only=True, eq=False)
class GaussianProcess:
    """A zero-mean Gaussian process conditioned on observations; build it with `condition`.

    Attributes
    ----------
    kernel : Kernel
        Prior covariance.
    noise_variance : float
        Variance of the observations' Gaussian noise, in squared units of the target.
    x : (n, D) array
        Training inputs, read-only.
    y : (n,) array
        Training targets, read-only.
    log_marginal_likelihood : float
        log p(y | x, hyperparameters).
    jitter : float
        What had to be added to the covariance's diagonal to factorise it, in squared units of
        the target; 0 almost always.
    """

    kernel: Kernel
    noise_variance: float
    x: FloatArray = field(repr=False)
    y: FloatArray = field(repr=False)
    log_marginal_likelihood: float
    jitter: float
    _posterior: Posterior = field(repr=False)

    @classmethod
    def condition(
        cls, kernel: Kernel, noise_variance: float, x: ArrayLike, y: ArrayLike
    ) -> "GaussianProcess":
        """Condition a zero-mean prior on observations.

        Observations that the kernel multiplies by zero are left out of the factorisation; their
        likelihood is that of white noise, exactly.

        Parameters
        ----------
        kernel : Kernel
            Prior covariance.
        noise_variance : float
            Positive, in squared units of the target.
        x : (n, D) array
            Inputs, each column in its own unit.
        y : (n,) array
            Targets.

        Returns
        -------
        GaussianProcess

        Raises
        ------
        InputError
            If the noise variance is not positive.
        ObservationError
            If the arrays do not fit together, are not finite, are empty, or lie wholly outside
            the kernel's range.
        NotPositiveDefiniteError
            If the covariance matrix has no Cholesky factor, even with the largest jitter.
        """
        check_noise_variance(noise_variance)
        inputs, targets, active = check_observations(kernel, x, y)
        near = np.ascontiguousarray(inputs[active])
        with limit_blas(1):
            factor = factorise(kernel, noise_variance, near)
        return cls._from_factor(factor, kernel, float(noise_variance), inputs, targets)

    @classmethod
    def _from_factor(
        cls,
        factor: Factor,
        kernel: Kernel,
        noise_variance: float,
        x: FloatArray,
        y: FloatArray,
    ) -> "GaussianProcess":
        """Condition on checked observations whose covariance has been factorised."""
        active = ~kernel.closed(x)
        posterior = Posterior.of(factor, kernel, x[active], y[active])
        return cls(
            kernel=kernel,
            noise_variance=noise_variance,
            x=read_only(x),
            y=read_only(y),
            log_marginal_likelihood=posterior.log_marginal_likelihood
            + white_noise_log_likelihood(y[~active], noise_variance),
            jitter=factor.jitter,
            _posterior=posterior,
        )

    def with_observations(self, x: ArrayLike, y: ArrayLike) -> "GaussianProcess":
        """Learn from more observations; the hyperparameters stay as they are.

        The same as `condition` on all of them, in squared instead of cubic time. A covariance
        that needed jitter, or that rounding leaves without a factor, is factorised afresh.

        Parameters
        ----------
        x : (k, D) array
            Inputs, columns as in training.
        y : (k,) array
            Targets.

        Returns
        -------
        GaussianProcess
            Conditioned on the old observations, then the new ones; this one does not change.

        Raises
        ------
        ObservationError
            If the arrays do not fit together or are not finite.
        NotPositiveDefiniteError
            If the covariance matrix has no Cholesky factor, even with the largest jitter.
        """
        inputs = check_inputs(x, columns=self.x.shape[1])
        targets = check_targets(y, observations=len(inputs))
        everywhere, every = np.vstack([self.x, inputs]), np.append(self.y, targets)
        factor, near = None, np.ascontiguousarray(inputs[~self.kernel.closed(inputs)])
        if self.jitter == 0.0:
            with limit_blas(1):
                old = self._posterior
                factor = append_rows(old.factor, self.kernel, self.noise_variance, old.x, near)
        return self._rebuilt(factor, everywhere, every)

    def without_observations(self, rows: ArrayLike) -> "GaussianProcess":
        """Forget observations; the hyperparameters stay as they are.

        Parameters
        ----------
        rows : (k,) array of int
            Which ones, by their place in `x`, counted from 0.

        Returns
        -------
        GaussianProcess
            Conditioned on the others, in their order; this one does not change.

        Raises
        ------
        InputError
            If a row is not one of the observations'.
        ObservationError
            If no observation is left inside the kernel's range.
        """
        leaves = check_rows(rows, observations=len(self.y))
        x, y = self.x[~leaves], self.y[~leaves]
        factor, near = None, leaves[~self.kernel.closed(self.x)]
        if self.jitter == 0.0 and not near.all():
            factor = remove_rows(self._posterior.factor, np.flatnonzero(near))
        return self._rebuilt(factor, x, y)

    def _rebuilt(self, factor: Factor | None, x: FloatArray, y: FloatArray) -> "GaussianProcess":
        """Condition on other observations, by the factor of their covariance where there is one."""
        if factor is None:
            return self.condition(self.kernel, self.noise_variance, x, y)
        return self._from_factor(factor, self.kernel, self.noise_variance, x, y)

    def log_marginal_likelihood_gradient(self) -> FloatArray:
        """Gradient of the log marginal likelihood.

        Returns
        -------
        (p + 1,) array
            With respect to the kernel's `log_parameters`, then the log of the noise variance.
        """
        likelihood = MarginalLikelihood(self.x, self.y, active=~self.kernel.closed(self.x))
        return likelihood.value_and_gradient(self.kernel, self.noise_variance)[1]

    def predict(
        self,
        x: ArrayLike,
        *,
        include_noise: bool = False,
        threads: int | None = None,
        progress: Progress = ignore_progress,
    ) -> Prediction:
        """Predict mean and standard deviation, in constant memory.

        Parameters
        ----------
        x : (m, D) array
            Inputs, columns as in training.
        include_noise : bool
            Whether the standard deviation is that of a new observation, or that of the function
            underneath.
        threads : int, optional
            Chosen by the size of the task if left out; the numbers are the same with any.
        progress : Progress
            Called with the stage "predicting", rows done, and all rows.

        Returns
        -------
        Prediction

        Raises
        ------
        ObservationError
            If the inputs are not a finite matrix with the columns of training.
        InputError
            If fewer than one thread is asked for.
        """
        inputs = check_inputs(x, columns=self.x.shape[1])
        mean, variance = np.empty(len(inputs)), np.empty(len(inputs))
        posterior = self._posterior

        def predict_rows(rows: slice) -> None:
            mean[rows], variance[rows] = posterior.mean_and_variance(inputs[rows])

        # computed once, on one thread, and before the threads that share it
        with limit_blas(1):
            _ = posterior.factor.inverse
        self._in_chunks(predict_rows, len(inputs), threads, progress)
        if include_noise:
            variance += self.noise_variance
        return Prediction(mean=mean, std=np.sqrt(variance))

    def predict_mean(
        self,
        x: ArrayLike,
        *,
        threads: int | None = None,
        progress: Progress = ignore_progress,
    ) -> FloatArray:
        """Predict the mean alone, which takes no triangular solve and keeps no matrix.

        Parameters
        ----------
        x : (m, D) array
            Inputs, columns as in training.
        threads, progress
            As for `predict`.

        Returns
        -------
        (m,) array
            In the unit of the targets.

        Raises
        ------
        ObservationError
            If the inputs are not a finite matrix with the columns of training.
        InputError
            If fewer than one thread is asked for.
        """
        inputs = check_inputs(x, columns=self.x.shape[1])
        mean, posterior = np.empty(len(inputs)), self._posterior

        def predict_rows(rows: slice) -> None:
            mean[rows] = posterior.mean(inputs[rows])

        self._in_chunks(predict_rows, len(inputs), threads, progress)
        return mean

    def covariance(self, x: ArrayLike) -> FloatArray:
        """Posterior covariance of the function at several inputs, without noise.

        Parameters
        ----------
        x : (m, D) array
            Inputs, columns as in training.

        Returns
        -------
        (m, m) array
            In squared units of the target. `predict` costs far less where its diagonal is
            enough.

        Raises
        ------
        ObservationError
            If the inputs are not a finite matrix with the columns of training.
        """
        return self._posterior.covariance(check_inputs(x, columns=self.x.shape[1]))

    def leave_one_out(self) -> Prediction:
        """Predict every training target from all the others, in closed form.

        Rasmussen and Williams 2006, Eq. 5.12; the hyperparameters are those learnt from all of
        them.

        Returns
        -------
        Prediction
            Of new observations, noise included, shape (n,); 0 and the noise alone where the
            kernel's gate is closed.
        """
        active = ~self.kernel.closed(self.x)
        mean = np.zeros(len(self.y))
        variance = np.full(len(self.y), self.noise_variance)
        mean[active], variance[active] = self._posterior.leave_one_out()
        return Prediction(mean=mean, std=np.sqrt(variance))

    def _in_chunks(
        self,
        predict_rows: Callable[[slice], None],
        rows: int,
        threads: int | None,
        progress: Progress,
    ) -> None:
        """Call `predict_rows` with chunks of rows, in threads where that is worth it."""
        worthwhile = rows * len(self._posterior.x) >= _MANY_PAIRS
        in_chunks(
            predict_rows,
            rows,
            chunk=_CHUNK,
            threads=threads,
            worthwhile=worthwhile,
            stage="predicting",
            progress=progress,
        )
