"""Positions in another unit than mm: told by how far they reach."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import polars as pl

from exposight.cli.output import number

if TYPE_CHECKING:
    from exposight.models import GaussianProcessModel
    from exposight.observing import ObservationTable


_POSITIONS = ("x_mm", "y_mm", "z_mm")

_FAR_LESS = 0.01
"""A table in m reaches a thousandth as far as one in mm; a part's few features may, at times."""

_LEAST_MM = 5.0
"""A cell's positions reach farther from the TCP than this."""


def position_unit_remark(model: GaussianProcessModel, frame: pl.DataFrame) -> str:
    """Say that positions seem to be in m, if they reach far less than a model's own.

    Parameters
    ----------
    model : GaussianProcessModel
        Knows the range of the positions that it was trained on.
    frame : polars.DataFrame
        Has the model's inputs.

    Returns
    -------
    str
        Empty where there is nothing to say.
    """
    ranges = model.training_range
    known = [name for name in _POSITIONS if name in ranges]
    if not known:
        return ""
    values = frame.select(pl.col(known).cast(pl.Float64).fill_null(np.nan)).to_numpy()
    values = values[np.isfinite(values).all(axis=1)]
    if not len(values):
        return ""
    trained = np.array([ranges[name] for name in known])
    span, own_span = float(np.ptp(trained, axis=1).max()), float(np.ptp(values, axis=0).max())
    reach, own_reach = float(np.abs(trained).max()), float(np.abs(values).max())
    # One position alone has no span, and may be any.
    if not (0.0 < own_span < _FAR_LESS * span and own_reach < _FAR_LESS * reach):
        return ""
    return (
        f"{', '.join(known)} span {number(own_span, 3)} mm at most here, and "
        f"{number(span, 3)} mm where {model.name} was trained: are they in metres? "
        "positions are in mm, multiply by 1000 if so"
    )


def in_metres_remark(table: ObservationTable) -> str:
    """Say that a table's positions seem to be in m, if all lie next to the TCP."""
    measured = table.measured()
    if len(measured) == 0:
        return ""
    farthest = float(np.abs(measured.array(_POSITIONS)).max())
    if farthest >= _LEAST_MM:
        return ""
    return (
        f"no x_mm, y_mm or z_mm is farther than {number(farthest, 3)} mm from 0: are they in "
        "metres? positions are in mm, multiply by 1000 if so"
    )
