"""What a model is before it is trained: target, inputs, kernel, and which rows it learns from."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

from exposight.quantities import QUANTITIES

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from exposight.gp import Kernel
    from exposight.observing import ObservationTable

Target = Literal["p_norm", "exposure_ms"]

UNITS = {
    name: QUANTITIES[name].unit
    for name in ("p_norm", "exposure_ms", "i_avg", "x_mm", "y_mm", "z_mm", "w_deg", "p_deg")
}
"""Unit of every variable that the paper's models read or predict (Table 1)."""


@dataclass(frozen=True, kw_only=True)
class ModelSpecification:
    """One of the paper's models, untrained.

    Parameters
    ----------
    name : str
        As in the paper, written plainly: ``q_k4`` is ᵠk₄, ``e_k6_star`` is ᵉk₆*.
    title : str
        What it is, for people.
    target : {"p_norm", "exposure_ms"}
        The column it predicts.
    inputs : tuple of str
        The columns it reads, in the paper's order.
    kernel : Kernel
        The kernel's form; training finds its hyperparameters and ignores their values here.
    p_norm_min : float or None
        Learn only from observations of at least this quality (Sect. 3.4.1); None for all.
    source : str
        Where in the paper it is defined.
    """

    name: str
    title: str
    target: Target
    inputs: tuple[str, ...]
    kernel: Kernel
    p_norm_min: float | None
    source: str

    def rows(self, table: ObservationTable) -> ObservationTable:
        """Return the measured rows that the model learns from and is judged by."""
        measured = table.measured()
        return measured if self.p_norm_min is None else measured.with_quality(self.p_norm_min)

    def data(self, table: ObservationTable) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return (n, d) inputs and (n,) targets of a table's rows, all of them."""
        return table.array(self.inputs), table.array([self.target])[:, 0]
