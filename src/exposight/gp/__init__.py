"""Gaussian processes, pure: kernels that compose, exact regression, fitting."""

from exposight.gp.bounds import Bounds, DataScale
from exposight.gp.fitting import FitResult, StartResult, fit
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
from exposight.gp.regression import GaussianProcess, Prediction

__all__ = [
    "Bounds",
    "ChangePoint",
    "DataScale",
    "Exponential",
    "FitResult",
    "GaussianProcess",
    "Kernel",
    "Linear",
    "Matern32",
    "Matern52",
    "Parameter",
    "Prediction",
    "Product",
    "Quantity",
    "RationalQuadratic",
    "SquaredExponential",
    "StartResult",
    "Stationary",
    "Sum",
    "fit",
    "gpy_length_scale",
    "kernel_from_dict",
    "length_scale_from_gpy",
]
