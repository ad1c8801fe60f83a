"""Covariance functions: one contract, small classes that compose."""

from exposight.gp.kernels.base import Kernel, Product, Sum
from exposight.gp.kernels.change_point import ChangePoint
from exposight.gp.kernels.description import kernel_from_dict
from exposight.gp.kernels.leaf import Leaf
from exposight.gp.kernels.linear import Linear
from exposight.gp.kernels.parameters import Parameter, Quantity
from exposight.gp.kernels.rational_quadratic import (
    RationalQuadratic,
    gpy_length_scale,
    length_scale_from_gpy,
)
from exposight.gp.kernels.stationary import (
    Exponential,
    Matern32,
    Matern52,
    SquaredExponential,
    Stationary,
)
