"""Rows of the paper's Table 9 as measured: observations, and how they are split."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from exposight.observing import ObservationTable
    from exposight.paper.result.settings import SensorKind


@dataclass(frozen=True, kw_only=True, eq=False)
class Dataset:
    """One row of the paper's Table 9: measured observations of one kind, and how they are split.

    Parameters
    ----------
    name : str
        ``X``, ``X_test``, ``eX``, ``eX_test``, ``eX_plus``, ``eX_plusplus``, ``X_lighting_I`` (II,
        III), ``X_out``, and ``s2_X``, ``s2_X_test``, ``s2_eX``, ``s2_eX_test``, ``s2_X_out``.
    title : str
        For people.
    sensor : {'structured-light', 'stereo'}
        Which sensor measured it.
    features : tuple of str
        Features it was asked for, also where no row of one is left.
    p_norm_min : float or None
        Rows below are left out (Sect. 3.4.1); None keeps all.
    table : ObservationTable
        All its rows, measured ones only.
    train, validation : ObservationTable or None
        The two sides of the random split, as in the paper; None for what nothing learns from.
    train_by_view, validation_by_view : ObservationTable or None
        The two sides of a split by whole views with the same share.
    """

    name: str
    title: str
    sensor: SensorKind
    features: tuple[str, ...]
    p_norm_min: float | None
    table: ObservationTable
    train: ObservationTable | None = None
    validation: ObservationTable | None = None
    train_by_view: ObservationTable | None = None
    validation_by_view: ObservationTable | None = None
