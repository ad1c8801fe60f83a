"""Base of the kernels that are not composed of others."""

from abc import abstractmethod
from functools import cached_property
from typing import Self

import numpy as np

from exposight.gp.kernels.base import Kernel
from exposight.gp.kernels.parameters import Parameter
from exposight.gp.observations import BoolArray, FloatArray


class Leaf(Kernel):
    """A kernel that is not composed of others."""

    @property
    @abstractmethod
    def hyperparameters(self) -> tuple[Parameter, ...]:
        """The kernel's own hyperparameters, named without the kernel's name."""

    @abstractmethod
    def _with_values(self, values: tuple[float, ...]) -> Self:
        """Return the kernel with these values of all of its hyperparameters."""

    def _with_logs(self, logs: FloatArray) -> Self:
        values = iter(np.exp(logs))
        return self._with_values(
            tuple(float(next(values)) if own.free else own.value for own in self.hyperparameters)
        )

    def leaves(self) -> tuple[tuple[str, tuple[Parameter, ...]], ...]:
        """See `Kernel.leaves`."""
        return ((self.type_name, self.hyperparameters),)

    def closed(self, x: FloatArray) -> BoolArray:
        """See `Kernel.gate`."""
        return np.zeros(len(x), dtype=np.bool_)

    @cached_property
    def _free(self) -> BoolArray:
        """Which of the hyperparameters are free."""
        return np.array([own.free for own in self.hyperparameters], dtype=np.bool_)
