"""The linear kernel."""

from dataclasses import dataclass, replace
from typing import Any, ClassVar, Self

import numpy as np

from exposight.errors import InputError
from exposight.gp.kernels.arguments import check_dims, check_fixed, check_positive
from exposight.gp.kernels.leaf import Leaf
from exposight.gp.kernels.parameters import Parameter, Quantity
from exposight.gp.observations import FloatArray


@dataclass(frozen=True, kw_only=True)
class Linear(Leaf):
    """Linear kernel, sum_d sigma_d² x_d x'_d: linear regression through the origin.

    Attributes
    ----------
    variances : tuple of float
        sigma_d², one for each of `dims`, in squared units of target over column; Table 8 of the
        paper lists them for its linear model.
    dims : tuple of int
        Columns of the inputs that the kernel reads, counted from 0.
    fixed : tuple of str
        Names of fields that fitting leaves alone, such as ``("variances",)``.

    Raises
    ------
    InputError
        If a variance is not positive and finite, their number does not match the dimensions, or
        a field to fix does not exist.
    """

    variances: tuple[float, ...]
    dims: tuple[int, ...]
    fixed: tuple[str, ...] = ()
    type_name: ClassVar[str] = "linear"

    def __post_init__(self) -> None:
        dims = check_dims(self.dims, kernel="Linear")
        variances = check_positive(self.variances, what="Linear.variances")
        if len(variances) != len(dims):
            msg = (
                f"Linear over {len(dims)} dimensions takes as many variances, got {len(variances)}"
            )
            raise InputError(msg)
        object.__setattr__(self, "dims", dims)
        object.__setattr__(self, "variances", variances)
        object.__setattr__(
            self, "fixed", check_fixed(self.fixed, allowed=("variances",), kernel="Linear")
        )

    @property
    def columns(self) -> tuple[int, ...]:
        """Columns of the inputs that this kernel reads."""
        return self.dims

    @property
    def hyperparameters(self) -> tuple[Parameter, ...]:
        """One variance a dimension."""
        return tuple(
            Parameter(
                name=f"variance[{dim}]",
                value=variance,
                quantity=Quantity.SLOPE_VARIANCE,
                dims=(dim,),
                free="variances" not in self.fixed,
            )
            for dim, variance in zip(self.dims, self.variances, strict=True)
        )

    def to_dict(self) -> dict[str, Any]:
        """Describe the kernel with what JSON can hold; `kernel_from_dict` reads it back."""
        return {
            "type": self.type_name,
            "variances": list(self.variances),
            "dims": list(self.dims),
            "fixed": list(self.fixed),
        }

    def _with_values(self, values: tuple[float, ...]) -> Self:
        return replace(self, variances=values)

    def fill(self, x: FloatArray, y: FloatArray, out: FloatArray) -> None:
        """See `Kernel.fill`."""
        np.matmul(x[:, self.dims] * np.array(self.variances), y[:, self.dims].T, out=out)

    def weigh(self, x: FloatArray, y: FloatArray, weights: FloatArray) -> FloatArray:
        """See `Kernel.weigh`."""
        products = np.sum(x[:, self.dims] * (weights @ y[:, self.dims]), axis=0)
        out: FloatArray = (products * np.array(self.variances))[self._free]
        return out

    def prior_variance(self, x: FloatArray) -> FloatArray:
        """See `Kernel.diagonal`."""
        out: FloatArray = x[:, self.dims] ** 2 @ np.array(self.variances)
        return out
