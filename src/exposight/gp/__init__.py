"""Gaussian processes, pure: kernels that compose, exact regression, fitting, committees."""

from exposight.gp.bounds import Bounds, DataScale
from exposight.gp.committee import Committee
from exposight.gp.committee_fitting import CommitteeFitResult, ShardTask, fit_committee
from exposight.gp.fitting import EVALUATIONS, FitResult, fit
from exposight.gp.kernels import (
    Category,
    ChangePoint,
    Exponential,
    Kernel,
    Leaf,
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
    register_kernel,
)
from exposight.gp.observations import FloatArray
from exposight.gp.regression import GaussianProcess, JointPrediction, Prediction
