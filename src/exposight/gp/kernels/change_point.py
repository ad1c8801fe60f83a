"""The gate that switches a kernel off outside a range."""

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar, Self

import numpy as np

from exposight.errors import InputError
from exposight.gp.kernels.arguments import check_dims
from exposight.gp.kernels.leaf import Leaf
from exposight.gp.kernels.loops import close_outside
from exposight.gp.kernels.parameters import Parameter
from exposight.gp.observations import BoolArray, FloatArray


@dataclass(frozen=True, kw_only=True)
class ChangePoint(Leaf):
    """Change point kernel of Eq. 9 of the paper: 1 where both inputs are in range, else 0.

    Multiplied into a kernel it makes the prior, hence the prediction, exactly 0 outside the
    range. The limits belong to the range. It has no hyperparameters.

    Attributes
    ----------
    dim : int
        Column of the inputs that is compared with the limits, counted from 0.
    minimum, maximum : float, optional
        Limits in the unit of the column; at least one of them.

    Raises
    ------
    InputError
        If no limit is given, a limit is not finite, or they leave no range.
    """

    dim: int
    minimum: float | None = None
    maximum: float | None = None
    type_name: ClassVar[str] = "change_point"

    def __post_init__(self) -> None:
        (dim,) = check_dims((self.dim,), kernel="ChangePoint")
        object.__setattr__(self, "dim", dim)
        limits = [limit for limit in (self.minimum, self.maximum) if limit is not None]
        if not limits or not all(math.isfinite(limit) for limit in limits):
            msg = f"ChangePoint takes a finite minimum, maximum or both, got {limits}"
            raise InputError(msg)
        if len(limits) == 2 and limits[0] >= limits[1]:
            msg = f"ChangePoint's minimum must lie below its maximum, got {limits}"
            raise InputError(msg)

    @property
    def columns(self) -> tuple[int, ...]:
        """Columns of the inputs that this kernel reads."""
        return (self.dim,)

    @property
    def hyperparameters(self) -> tuple[Parameter, ...]:
        """None."""
        return ()

    def to_dict(self) -> dict[str, Any]:
        """Describe the kernel with what JSON can hold; `kernel_from_dict` reads it back."""
        return {
            "type": self.type_name,
            "dim": self.dim,
            "minimum": self.minimum,
            "maximum": self.maximum,
        }

    def _with_values(self, values: tuple[float, ...]) -> Self:
        del values
        return self

    @cached_property
    def _limits(self) -> tuple[float, float]:
        low = -math.inf if self.minimum is None else self.minimum
        return low, math.inf if self.maximum is None else self.maximum

    def closed(self, x: FloatArray) -> BoolArray:
        """See `Kernel.gate`."""
        low, high = self._limits
        out: BoolArray = (x[:, self.dim] < low) | (x[:, self.dim] > high)
        return out

    def fill(self, x: FloatArray, y: FloatArray, out: FloatArray) -> None:
        """See `Kernel.fill`."""
        out[:] = 1.0
        self.multiply(x, y, out)

    def multiply(self, x: FloatArray, y: FloatArray, out: FloatArray) -> None:
        """See `Kernel.multiply`."""
        close_outside(x, y, self.dim, *self._limits, out)

    def weigh(self, x: FloatArray, y: FloatArray, weights: FloatArray) -> FloatArray:
        """See `Kernel.weigh`: there is nothing to differentiate."""
        del x, y, weights
        return np.empty(0)

    def prior_variance(self, x: FloatArray) -> FloatArray:
        """See `Kernel.diagonal`."""
        return (~self.closed(x)).astype(np.float64)
