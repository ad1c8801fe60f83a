"""Base of the kernels that are not composed of others."""

from abc import abstractmethod
from typing import Self

import numpy as np
from numpy.typing import ArrayLike

from exposight.gp.kernels.base import Kernel
from exposight.gp.kernels.parameters import Parameter, check_log_parameters
from exposight.gp.observations import BoolArray, FloatArray

__all__ = ["Leaf"]


class Leaf(Kernel):
    """A kernel that is not composed of others."""

    @property
    @abstractmethod
    def hyperparameters(self) -> tuple[Parameter, ...]:
        """The kernel's own hyperparameters, named without the kernel's name."""

    @abstractmethod
    def _with_values(self, values: tuple[float, ...]) -> Self:
        """Return the kernel with these values of all of its hyperparameters."""

    def with_log_parameters(self, vector: ArrayLike) -> Self:
        """See `Kernel.with_log_parameters`."""
        values = iter(np.exp(check_log_parameters(vector, self.free_parameters)))
        return self._with_values(
            tuple(float(next(values)) if own.free else own.value for own in self.hyperparameters)
        )

    def _leaves(self) -> tuple[tuple[str, tuple[Parameter, ...]], ...]:
        return ((self.type_name, self.hyperparameters),)

    def _gate(self, x: FloatArray) -> BoolArray:
        return np.zeros(len(x), dtype=np.bool_)

    def _free_only(self, derivatives: list[float]) -> FloatArray:
        """Keep the derivatives of the free hyperparameters."""
        return np.array(
            [
                derivative
                for derivative, own in zip(derivatives, self.hyperparameters, strict=True)
                if own.free
            ]
        )
