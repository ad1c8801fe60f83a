"""One observation, and with it the columns of a table of observations."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields

import polars as pl

from exposight.observing.masks import Visibility


@dataclass(frozen=True, kw_only=True, slots=True)
class Observation:
    """One feature in one capture: a row of the table.

    Parameters
    ----------
    feature, view : str
        Names.
    exposure_ms : float, ms
        Exposure time (the paper's t_exp).
    p_norm : float or None
        Share of the ring's pixels that gave a 3D point (Eq. 5); None where not measured.
    i_avg : float or None
        Mean grey value of the ring, 0–255.
    x_mm, y_mm, z_mm : float, mm
        Position in the TCP frame.
    w_deg, p_deg, r_deg : float, degrees
        Orientation in the TCP frame.
    radius_mm : float, mm
        The feature's radius.
    n_points, n_pixels : int or None
        Points in the hollow cylinder (Eq. 4) and pixels of its ring (Eq. 6).
    i_std, i_median, i_p05, i_p95 : float or None
        Spread of the ring's grey values, 0–255.
    clipped_share : float or None
        Share of the ring's pixels at full scale, 0–1.
    incidence_deg : float, degrees
        Angle between the camera's ray and the feature's normal.
    visibility : str
        "visible", or the reason why the feature was not measured (`Visibility`).
    emulated : bool
        True where the exposure was emulated from another one.
    """

    feature: str
    view: str
    exposure_ms: float
    p_norm: float | None
    i_avg: float | None
    x_mm: float
    y_mm: float
    z_mm: float
    w_deg: float
    p_deg: float
    r_deg: float
    radius_mm: float
    n_points: int | None = None
    n_pixels: int | None = None
    i_std: float | None = None
    i_median: float | None = None
    i_p05: float | None = None
    i_p95: float | None = None
    clipped_share: float | None = None
    incidence_deg: float = math.nan
    visibility: str = Visibility.VISIBLE.value
    emulated: bool = False


_TYPES: dict[str, type[pl.DataType]] = {
    "str": pl.String,
    "float": pl.Float64,
    "float | None": pl.Float64,
    "int | None": pl.Int64,
    "bool": pl.Boolean,
}
SCHEMA = pl.Schema({field.name: _TYPES[str(field.type)] for field in fields(Observation)})
"""Column names and types of an observation table."""

REQUIRED = tuple(SCHEMA)[: tuple(SCHEMA).index("radius_mm") + 1]
"""Columns that every table has; the others may be left out."""
