"""Gaussian processes, pure: kernels that compose, exact regression, fitting, committees."""

from exposight.gp.bounds import Bounds, DataScale
from exposight.gp.committee import Committee
from exposight.gp.committee_fitting import CommitteeFitResult, fit_committee
from exposight.gp.fitting import FitResult, fit
from exposight.gp.kernels import (
    ChangePoint,
    Exponential,
    Kernel,
    Linear,
    Matern32,
    Matern52,
    Parameter,
    Product,
    Quantity,
    RationalQuadratic,
    SquaredExponential,
    Stationary,
    Sum,
    gpy_length_scale,
    kernel_from_dict,
    length_scale_from_gpy,
)
from exposight.gp.posterior import Prediction
from exposight.gp.priors import LogNormal
from exposight.gp.regression import GaussianProcess
from exposight.gp.search import StartResult
