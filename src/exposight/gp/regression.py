"""Exact Gaussian-process regression: zero mean, Gaussian noise, float64."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg import blas, solve_triangular

from exposight.errors import InputError
from exposight.gp import observations
from exposight.gp.factor import Factor, append_rows, factorise
from exposight.gp.kernels import Kernel
from exposight.gp.likelihood import log_likelihood, noise_of, white_noise_log_likelihood
from exposight.gp.spectrum import Spectrum, within
from exposight.gp.tiling import (
    fill_tiles,
    fill_triangle,
    limit_blas,
    predict_in_chunks,
    row_blocks,
)
from exposight.workers import Progress, ignore_progress

# Rows predicted at once: large enough for matrix products at full speed, 30 MB at N = 2000.
_CHUNK = 2000
# Pairs of rows and observations from which on a prediction takes long enough to share it.
_MANY_PAIRS = 10_000_000
# Rows for each observation from which on eigenvalues pay, found on a sample of so many rows; and
# between which numbers of observations.
_MANY_ROWS, _SAMPLE, _FEW, _MANY = 20, 1000, 256, 4096


@dataclass(frozen=True, kw_only=True, eq=False)
class Prediction:
    """What a Gaussian process predicts.

    Attributes
    ----------
    mean : (m,) array
        In the unit of the targets.
    std : (m,) array
        Standard deviation, in the unit of the targets.
    """

    mean: observations.FloatArray
    std: observations.FloatArray


@dataclass(frozen=True, kw_only=True, eq=False)
class JointPrediction:
    """What a Gaussian process predicts of several rows together, for joint draws.

    Attributes
    ----------
    mean : (m,) array
        In the unit of the targets.
    covariance : (m, m) array
        Symmetric, positive semidefinite within rounding, in squared units of the targets.
    """

    mean: observations.FloatArray
    covariance: observations.FloatArray


@dataclass(frozen=True, kw_only=True, eq=False)
class GaussianProcess:
    """A zero-mean Gaussian process conditioned on observations; build it with `condition`.

    With K the covariance of the targets inside the kernel's gate, noise included, L L' = K and
    α = K⁻¹ y (Rasmussen and Williams 2006, Algorithm 2.1). The observations outside the gate take
    no part in it; their likelihood is that of white noise, exactly.

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
    row_noise : (n,) array or None
        Variance of each observation's further noise, read-only; None where there is none.
    log_marginal_likelihood : float
        log p(y | x, hyperparameters).
    jitter : float
        What had to be added to the covariance's diagonal to factorise it, in squared units of
        the target; 0 almost always.
    """

    kernel: Kernel
    noise_variance: float
    x: observations.FloatArray = field(repr=False)
    y: observations.FloatArray = field(repr=False)
    row_noise: observations.FloatArray | None = field(repr=False)
    log_marginal_likelihood: float
    jitter: float
    _active_x: observations.FloatArray = field(repr=False)
    _factor: Factor = field(repr=False)
    _alpha: observations.FloatArray = field(repr=False)

    @classmethod
    def condition(
        cls,
        kernel: Kernel,
        noise_variance: float,
        x: ArrayLike,
        y: ArrayLike,
        *,
        row_noise: ArrayLike | None = None,
    ) -> "GaussianProcess":
        """Condition a zero-mean prior on observations.

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
        row_noise : (n,) array, optional
            Variance of each observation's further noise, which new observations do not have; in
            squared units of the target.

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
        observations.check_noise_variance(noise_variance)
        inputs, targets, active = observations.check_observations(kernel, x, y)
        further = observations.check_row_noise(row_noise, observations=len(targets))
        noise = noise_of(noise_variance, further, active)
        with limit_blas(1):
            factor = factorise(kernel, noise, np.ascontiguousarray(inputs[active]))
        return cls._from_factor(factor, kernel, float(noise_variance), inputs, targets, further)

    @classmethod
    def _from_factor(
        cls,
        factor: Factor,
        kernel: Kernel,
        noise_variance: float,
        x: observations.FloatArray,
        y: observations.FloatArray,
        row_noise: observations.FloatArray | None,
    ) -> "GaussianProcess":
        """Condition on checked observations whose covariance has been factorised."""
        active = ~kernel.closed(x)
        with limit_blas(1):
            alpha = factor.solve(y[active])
        return cls(
            kernel=kernel,
            noise_variance=noise_variance,
            x=observations.read_only(x),
            y=observations.read_only(y),
            row_noise=None if row_noise is None else observations.read_only(row_noise),
            log_marginal_likelihood=log_likelihood(factor, alpha, y[active])
            + white_noise_log_likelihood(y[~active], noise_of(noise_variance, row_noise, ~active)),
            jitter=factor.jitter,
            _active_x=np.ascontiguousarray(x[active]),
            _factor=factor,
            _alpha=alpha,
        )

    @property
    def weights(self) -> observations.FloatArray:
        """α = K⁻¹ y of the observations inside the gate: a mean is their kernel's sum with α."""
        return self._alpha

    def with_observations(
        self, x: ArrayLike, y: ArrayLike, *, row_noise: ArrayLike | None = None
    ) -> "GaussianProcess":
        """Learn from more observations; the hyperparameters stay as they are.

        The same as `condition` on all of them, in squared instead of cubic time. A covariance
        that needed jitter, or that rounding leaves without a factor, is factorised afresh.

        Parameters
        ----------
        x : (k, D) array
            Inputs, columns as in training.
        y : (k,) array
            Targets.
        row_noise : (k,) array, optional
            As for `condition`.

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
        inputs = observations.check_inputs(x, columns=self.x.shape[1])
        targets = observations.check_targets(y, observations=len(inputs))
        all_x, all_y = np.vstack([self.x, inputs]), np.append(self.y, targets)
        further, noise = observations.check_row_noise(row_noise, observations=len(inputs)), None
        if self.row_noise is not None or further is not None:
            old, added = (
                np.zeros(rows) if known is None else known
                for rows, known in ((len(self.y), self.row_noise), (len(inputs), further))
            )
            noise = np.append(old, added)
        factor, active = None, ~self.kernel.closed(inputs)
        if self.jitter == 0.0:
            with limit_blas(1):
                factor = append_rows(
                    self._factor,
                    self.kernel,
                    noise_of(self.noise_variance, further, active),
                    self._active_x,
                    np.ascontiguousarray(inputs[active]),
                )
        if factor is None:
            return self.condition(self.kernel, self.noise_variance, all_x, all_y, row_noise=noise)
        return self._from_factor(factor, self.kernel, self.noise_variance, all_x, all_y, noise)

    def predict(
        self,
        x: ArrayLike,
        *,
        include_noise: bool = False,
        threads: int | None = None,
        progress: Progress = ignore_progress,
    ) -> Prediction:
        """Predict mean and standard deviation, in constant memory.

        Rasmussen and Williams 2006, Eq. 2.25 and 2.26. Of very many rows, twenty for each
        observation, standard deviations are right to 1e-4 of themselves (`Spectrum`), where that
        saves time.

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
        inputs = observations.check_inputs(x, columns=self.x.shape[1])
        # outside the gate nothing is left to predict: mean and variance are 0
        inside = ~self.kernel.closed(inputs)
        rows = np.flatnonzero(inside)
        mean, variance = np.zeros(len(inputs)), np.zeros(len(inputs))
        noise = self.noise_variance if include_noise else 0.0
        # computed once, on one thread, and before the threads that share it
        with limit_blas(1):
            _ = self._factor.inverse
            spectrum = self._spectrum(
                inputs[rows[:: max(1, len(rows) // _SAMPLE)]], len(rows), noise
            )

        def predict_rows(chunk: slice) -> None:
            some = chunk.start + np.flatnonzero(inside[chunk])
            mean[some], variance[some] = self._mean_and_variance(inputs[some], noise, spectrum)

        predict_in_chunks(
            predict_rows,
            len(inputs),
            chunk=_CHUNK,
            threads=threads,
            worthwhile=len(rows) * len(self._active_x) >= _MANY_PAIRS,
            progress=progress,
        )
        variance += noise
        return Prediction(mean=mean, std=np.sqrt(variance))

    def predict_jointly(self, x: ArrayLike, *, include_noise: bool = False) -> JointPrediction:
        """Predict mean and covariance of rows together; takes (m, m) and (m, n) memory.

        Rasmussen and Williams 2006, Eq. 2.24.

        Parameters
        ----------
        x : (m, D) array
            Inputs, columns as in training.
        include_noise : bool
            Whether the covariance is that of new observations, or that of the function underneath.

        Returns
        -------
        JointPrediction

        Raises
        ------
        ObservationError
            If the inputs are not a finite matrix with the columns of training.
        """
        inputs = observations.check_inputs(x, columns=self.x.shape[1])
        cross = np.empty((len(inputs), len(self._active_x)))
        fill_tiles(self.kernel, inputs, self._active_x, cross)
        mean = cross @ self._alpha
        covariance = np.empty((len(inputs), len(inputs)))
        for rows in row_blocks(len(inputs)):
            fill_triangle(self.kernel, inputs, rows, covariance)
        if len(inputs):
            with limit_blas(1):
                explained = self._factor.half_solve(cross.T)
                # C order's upper triangle is the lower one in BLAS
                blas.dsyrk(
                    -1.0, explained, beta=1.0, c=covariance.T, trans=1, lower=1, overwrite_c=1
                )
        symmetric = np.triu(covariance) + np.triu(covariance, 1).T
        diagonal = np.einsum("ii->i", symmetric)
        np.maximum(diagonal, 0.0, out=diagonal)  # as in `predict`
        if include_noise:
            diagonal += self.noise_variance
        return JointPrediction(mean=mean, covariance=symmetric)

    def leave_out(self, groups: ArrayLike) -> Prediction:
        """Predict each observation from those of all other groups; hyperparameters stay.

        In closed form: with g a group's rows, their residuals y − mean are (K⁻¹_gg)⁻¹ α_g and have
        the covariance (K⁻¹_gg)⁻¹ (Rasmussen and Williams 2006, Eq. 5.12, of one row; a block's
        inverse of it for several). It takes one inverse of K, whatever the number of groups.

        Parameters
        ----------
        groups : (n,) array
            Each observation's group, numbers or words; all different to leave out one at a time.

        Returns
        -------
        Prediction
            Of the n observations, noise included, their further noise too.

        Raises
        ------
        InputError
            If there is not one label for each observation.
        """
        labels = np.asarray(groups)
        if labels.shape != self.y.shape:
            msg = (
                f"groups must hold a label for each of the {len(self.y)} observations, got shape "
                f"{labels.shape}"
            )
            raise InputError(msg)
        residual, variance = self.y.copy(), np.full(len(self.y), self.noise_variance)
        if self.row_noise is not None:
            variance += self.row_noise
        near = np.flatnonzero(~self.kernel.closed(self.x))
        with limit_blas(1):
            factor = Factor(matrix=self._factor.matrix.copy(order="F"), jitter=self.jitter)
            inverse = factor.consume()
            order = np.unique(labels[near], return_inverse=True)[1]
            for group in range(order.max() + 1):
                rows = np.flatnonzero(order == group)
                # the lower triangle alone holds the inverse
                half = np.linalg.cholesky(inverse[np.ix_(rows, rows)])
                root = solve_triangular(half, np.eye(len(rows)), lower=True)
                residual[near[rows]] = root.T @ (root @ self._alpha[rows])
                variance[near[rows]] = np.einsum("ij,ij->j", root, root)
        return Prediction(mean=self.y - residual, std=np.sqrt(variance))

    def _mean_and_variance(
        self, x: observations.FloatArray, noise: float = 0.0, spectrum: Spectrum | None = None
    ) -> tuple[observations.FloatArray, observations.FloatArray]:
        """Predict checked inputs inside the gate; the variance without the noise."""
        cross = np.empty((len(x), len(self._active_x)))
        fill_tiles(self.kernel, x, self._active_x, cross)
        mean, prior = cross @ self._alpha, self.kernel.prior_variance(x)
        if spectrum is None:
            return mean, self._remaining(cross, prior)
        explained, error = spectrum.explain(cross, prior)
        variance = prior - explained
        coarse = np.flatnonzero(~within(error, variance + noise))
        if len(coarse):
            variance[coarse] = self._remaining(cross[coarse], prior[coarse])
        return mean, np.maximum(variance, 0.0)

    def _remaining(
        self, cross: observations.FloatArray, prior: observations.FloatArray
    ) -> observations.FloatArray:
        """Return what the observations leave of rows' variance; `cross` is overwritten."""
        explained = self._factor.half_solve(cross.T).T
        # rounding may leave a variance a hair below zero at a training point
        left: observations.FloatArray = prior - np.einsum("ij,ij->i", explained, explained)
        return np.maximum(left, 0.0, out=left)

    def _spectrum(
        self, sample: observations.FloatArray, rows: int, noise: float
    ) -> Spectrum | None:
        """Return the eigenvalues that predicting so many rows takes, where that saves time."""
        n = len(self._active_x)
        if self.row_noise is not None or rows < _MANY_ROWS * n or not _FEW <= n <= _MANY:
            return None
        cross = np.empty((len(sample), n))
        fill_tiles(self.kernel, sample, self._active_x, cross)
        prior = self.kernel.prior_variance(sample)
        variance = self._remaining(cross.copy(), prior)
        matrix = np.empty((n, n))
        for block in row_blocks(n):
            fill_triangle(self.kernel, self._active_x, block, matrix)
        total = self.noise_variance + self.jitter
        # C order's upper triangle is the lower one in LAPACK's
        return Spectrum.of(matrix.T, total, cross, prior, variance, noise)
