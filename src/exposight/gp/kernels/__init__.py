"""Covariance functions: one contract, small classes that compose."""

from exposight.gp.kernels.base import Kernel, Parameter, Product, Quantity, Sum, kernel_from_dict
from exposight.gp.kernels.descriptions import register_kernel
from exposight.gp.kernels.leaves import Category, ChangePoint, Leaf, Linear
from exposight.gp.kernels.stationary import (
    Exponential,
    Matern32,
    Matern52,
    RationalQuadratic,
    SquaredExponential,
    Stationary,
    gpy_length_scale,
)
