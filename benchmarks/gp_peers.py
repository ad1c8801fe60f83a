"""Gaussian processes of the paper's sizes, drawn from their priors, in ours and other libraries.

Each engine takes the natural logarithms of the hyperparameters in our order, whatever it
optimises itself.
"""

from __future__ import annotations

import warnings
from abc import ABC, abstractmethod
from dataclasses import dataclass
from importlib.util import find_spec
from typing import Any

import numpy as np
from numpy.typing import NDArray

from exposight.gp import (
    Bounds,
    ChangePoint,
    DataScale,
    Exponential,
    Kernel,
    RationalQuadratic,
    gpy_length_scale,
)
from exposight.gp.fitting import Search
from exposight.gp.likelihood import MarginalLikelihood

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


class Engine(ABC):
    """A library with one problem."""

    name: str

    @abstractmethod
    def evaluate(self, logs: NDArray[np.float64]) -> float:
        """Compute the log marginal likelihood and its gradient; return the former."""


class Exposight(Engine):
    """Our own, on one thread."""

    name = "exposight"

    def __init__(self, problem: Problem) -> None:
        self.kernel = problem.kernel
        self._likelihood = MarginalLikelihood(
            problem.x, problem.y, active=~problem.kernel.gate(problem.x), threads=1
        )
        self._search = Search(
            kernel=problem.kernel,
            limits=Bounds().log_limits(problem.kernel, DataScale.of(problem.x, problem.y)),
            max_iterations=1000,
        )
        self.evaluations = 0

    def evaluate(self, logs: NDArray[np.float64]) -> float:
        """See `Engine.evaluate`."""
        kernel = self.kernel.with_log_parameters(logs[:-1])
        return self._likelihood.value_and_gradient(kernel, float(np.exp(logs[-1])))[0]

    def fit(self, logs: NDArray[np.float64]) -> float:
        """Maximise the likelihood from one start; return the maximum."""
        result = self._search.run(self._likelihood, logs)
        self.evaluations += result.evaluations
        return result.log_marginal_likelihood


class GPy(Engine):
    """The authors' library."""

    name = "GPy"

    def __init__(self, problem: Problem) -> None:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            import GPy as library  # takes seconds, and warns
        self._problem = problem
        kern = library.kern
        if problem.name == "q":
            kernel = kern.RatQuad(4, ARD=True) * kern.DomainKernel(1, 10, 255, active_dims=[0])
            kernel.parts[1].fix()
        else:
            pose = kern.Exponential(5, ARD=True, active_dims=[1, 2, 3, 4, 5])
            kernel = kern.Exponential(1, active_dims=[0]) * pose
            pose.variance.fix(1.0)
        self.model = library.models.GPRegression(problem.x, problem.y[:, None], kernel)
        self.evaluations = 0

    def _set(self, logs: NDArray[np.float64]) -> None:
        *hyperparameters, noise_variance = np.exp(logs)
        if self._problem.name == "q":
            variance, *scales, alpha = hyperparameters
            theirs = [gpy_length_scale(own, alpha=alpha) for own in scales]
            values = [variance, *theirs, alpha, 1.0, noise_variance]
        else:
            variance, first, *scales = hyperparameters
            values = [variance, first, 1.0, *scales, noise_variance]
        # one update for all, in GPy's order; the 1 is the fixed variance of the second factor
        self.model[:] = values

    def evaluate(self, logs: NDArray[np.float64]) -> float:
        """See `Engine.evaluate`."""
        self._set(logs)
        return float(self.model.log_likelihood())

    def fit(self, logs: NDArray[np.float64]) -> float:
        """Maximise the likelihood from one start; return the maximum."""
        self._set(logs)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            run: Any = self.model.optimize("lbfgsb", max_iters=1000)
        self.evaluations += int(run.funct_eval) if hasattr(run, "funct_eval") else 0
        return float(self.model.log_likelihood())


class ScikitLearn(Engine):
    """scikit-learn, for E; its rational quadratic has one length scale only."""

    name = "scikit-learn"

    def __init__(self, problem: Problem) -> None:
        from sklearn.gaussian_process import GaussianProcessRegressor, kernels

        class Columns(kernels.Matern):  # type: ignore[misc]  # scikit-learn has no types
            """Matérn ½ of some of the columns."""

            def __init__(
                self, length_scale: Any = 1.0, columns: tuple[int, int] = (0, 1), nu: float = 0.5
            ) -> None:
                super().__init__(length_scale=length_scale, nu=nu)
                self.columns = columns

            def __call__(self, X: Any, Y: Any = None, eval_gradient: bool = False) -> Any:
                own = slice(*self.columns)
                other = None if Y is None else Y[:, own]
                return super().__call__(X[:, own], other, eval_gradient)

        kernel = (
            kernels.ConstantKernel() * Columns(1.0, (0, 1)) * Columns(np.ones(5), (1, 6))
            + kernels.WhiteKernel()
        )
        self._regressor = GaussianProcessRegressor(kernel, alpha=0.0, optimizer=None)
        self._regressor.fit(problem.x[:10], problem.y[:10])
        self._regressor.X_train_, self._regressor.y_train_ = problem.x, problem.y

    def evaluate(self, logs: NDArray[np.float64]) -> float:
        """See `Engine.evaluate`."""
        value, _ = self._regressor.log_marginal_likelihood(
            logs, eval_gradient=True, clone_kernel=False
        )
        return float(value)


class GPyTorch(Engine):
    """GPyTorch on the processor, its Cholesky factorisation forced."""

    name = "GPyTorch"

    def __init__(self, problem: Problem) -> None:
        import gpytorch  # type: ignore[import-not-found, import-untyped, unused-ignore]
        import torch  # type: ignore[import-not-found, unused-ignore]

        torch.set_num_threads(1)
        self._torch, self._gpytorch = torch, gpytorch
        x, y = torch.tensor(problem.x), torch.tensor(problem.y)

        class Model(gpytorch.models.ExactGP):  # type: ignore[misc, unused-ignore]
            """Zero mean and the kernel of E."""

            def __init__(self, likelihood: Any) -> None:
                super().__init__(x, y, likelihood)
                matern = gpytorch.kernels.MaternKernel
                self.mean_module = gpytorch.means.ZeroMean()
                self.brightness = matern(nu=0.5, active_dims=[0])
                self.pose = matern(nu=0.5, ard_num_dims=5, active_dims=[1, 2, 3, 4, 5])
                self.covar_module = gpytorch.kernels.ScaleKernel(self.brightness * self.pose)

            def forward(self, inputs: Any) -> Any:
                return gpytorch.distributions.MultivariateNormal(
                    self.mean_module(inputs), self.covar_module(inputs)
                )

        self._x, self._y = x, y
        self._noise = gpytorch.likelihoods.GaussianLikelihood().double()
        self._model = Model(self._noise).double()
        self._model.train()
        self._noise.train()
        self._objective = gpytorch.mlls.ExactMarginalLogLikelihood(self._noise, self._model)

    def evaluate(self, logs: NDArray[np.float64]) -> float:
        """See `Engine.evaluate`."""
        values = self._torch.tensor(np.exp(logs))
        self._model.covar_module.outputscale = values[0]
        self._model.brightness.lengthscale = values[1]
        self._model.pose.lengthscale = values[2:7]
        self._noise.noise = values[7]
        settings = self._gpytorch.settings
        self._model.zero_grad()
        with (
            settings.fast_computations(False, False, False),
            settings.cholesky_max_tries(1),
            settings.max_cholesky_size(10**6),
        ):
            value = self._objective(self._model(self._x), self._y)
            value.backward()
        return float(value.detach()) * len(self._y)


def gpytorch_installed() -> bool:
    """Say whether GPyTorch can be measured."""
    return find_spec("gpytorch") is not None
