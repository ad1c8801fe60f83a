"""Sweeps over exposure time: views of which every outcome is known, to judge strategies by.

A sweep is an observation table, recorded or simulated, in which each view was captured at many
exposure times. Whatever a strategy would take there, what it would have got is in the table.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from typing import TypeAlias

import numpy as np
import polars as pl
from numpy.typing import NDArray

from exposight.cell import PRESETS, ActiveSensor
from exposight.errors import ObservationError
from exposight.files import sha256_of
from exposight.models import P_NORM_MIN, black_level_of
from exposight.observing import ObservationTable
from exposight.planning.exposure_limits import ExposureLimits
from exposight.tables import counted, number

FloatArray: TypeAlias = NDArray[np.float64]

_POSE = (
    "feature", "view", "x_mm", "y_mm", "z_mm", "w_deg", "p_deg", "r_deg", "radius_mm", "n_pixels",
    "incidence_deg", "visibility", "sensor", "part", "finish", "tcp", "part_w_deg", "part_p_deg",
    "part_r_deg",
)  # fmt: skip
"""Columns that are known before a capture is taken."""

_IMAGE = (
    "i_avg", "i_std", "i_median", "i_p05", "i_p95", "clipped_share", "i_mean", "i_mean_p05",
    "i_mean_p25", "i_mean_p50", "i_mean_p75", "i_mean_p95", "brightness_source", "exposure_ms",
    "emulated",
)  # fmt: skip
"""What an image without patterns shows of a ring; no point and no modulation."""

_UNCLIPPED = 0.01
"""Share of clipped pixels up to which brightness is in proportion to exposure time."""


@dataclass(frozen=True, kw_only=True, eq=False)
class SweepView:
    """One view of a sweep: n features at m exposure times.

    Parameters
    ----------
    name : str
    features : tuple of str
        The n features that are visible.
    settings_ms : (m,) ndarray, ms
        Exposure times that a strategy may take, ascending.
    p_norm : (n, m) ndarray
        What comes of each.
    poses : polars.DataFrame
        What is known of the features before a capture is taken, a row for each.
    rows : tuple of ObservationTable
        What a capture at each exposure time shows, a row for each feature.
    """

    name: str
    features: tuple[str, ...]
    settings_ms: FloatArray
    p_norm: FloatArray
    poses: pl.DataFrame
    rows: tuple[ObservationTable, ...]

    @cached_property
    def images(self) -> tuple[ObservationTable, ...]:
        """What a trial image at each exposure time shows: brightness, and no quality."""
        frame = self.rows[0].frame
        hidden = [name for name in frame.columns if name not in (*_POSE, *_IMAGE)]
        nothing = [pl.lit(None, frame.schema[name]).alias(name) for name in hidden]
        return tuple(
            ObservationTable(frame=each.frame.with_columns(nothing), checked=True)
            for each in self.rows
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class Sweep:
    """Views whose every outcome is known.

    Parameters
    ----------
    name : str
        What results call it.
    views : tuple of SweepView
        In the order in which they are measured.
    need : float
        p_norm that a feature is to reach in one capture.
    sensor : ActiveSensor or None
        The sensor, where it is known.
    black_level : float, grey levels
        Brightness without light, which every camera's dark image tells.
    sha256 : str
        Of all outcomes and what is asked for: results are compared where it is the same.
    """

    name: str
    views: tuple[SweepView, ...]
    need: float
    sensor: ActiveSensor | None
    black_level: float
    sha256: str

    @classmethod
    def of(
        cls,
        table: ObservationTable,
        *,
        name: str = "sweep",
        need: float = P_NORM_MIN,
        limits: ExposureLimits | None = None,
        sensor: ActiveSensor | None = None,
    ) -> Sweep:
        """Return the sweep that a table holds.

        Parameters
        ----------
        table : ObservationTable
            Captures of views at several exposure times each. Features that a view does not see do
            not count in it.
        name : str
            What results call it.
        need : float
            p_norm that a feature is to reach.
        limits : ExposureLimits, optional
            Exposure times outside of them are left out.
        sensor : ActiveSensor, optional
            The preset that the table names by default.

        Raises
        ------
        ObservationError
            If nothing was measured, no view was measured at two allowed exposure times or more, or
            a feature has two rows at the same view and exposure time.
        """
        measured = table.measured()
        frame = measured.frame
        repeated = frame.select("feature", "view", "exposure_ms").is_duplicated()
        if repeated.any():
            row = frame.filter(repeated).row(0, named=True)
            msg = (
                f"a sweep has one row for each feature, view and exposure time; {row['feature']} "
                f"in {row['view']} has several at {number(row['exposure_ms'])} ms: drop repetitions"
            )
            raise ObservationError(msg)
        allowed = sorted(set(frame["exposure_ms"].to_list()))
        if limits is not None:
            allowed = [each for each in allowed if limits.allows(each)]
        places = {name: np.flatnonzero(rows) for name, rows in _by_view(measured)}
        views = [_view_of(measured.where(_mask(len(frame), at)), allowed) for at in places.values()]
        usable = tuple(view for view in views if view is not None)
        if not usable:
            times = frame["exposure_ms"].n_unique()
            msg = (
                "a comparison needs a sweep: views that were captured at two exposure times or "
                f"more; got {counted(len(views), 'view')} at {counted(times, 'exposure time')}"
                + (f", {len(allowed)} of them within the limits" if limits is not None else "")
                + ": measure each view at many exposure times, from too dark to clipped"
            )
            raise ObservationError(msg)
        outcomes = [need, *(f"{each.name}{each.features}" for each in usable)]
        outcomes += [each.settings_ms.tolist() for each in usable]
        outcomes += [each.p_norm.round(9).tolist() for each in usable]
        return cls(
            name=name,
            views=usable,
            need=need,
            sensor=sensor or _preset_of(frame),
            black_level=_black_level(measured),
            sha256=sha256_of(repr(outcomes).encode()),
        )

    @cached_property
    def pairs(self) -> int:
        """How many (feature, view) pairs some exposure time serves."""
        return sum(int((each.p_norm >= self.need).any(axis=1).sum()) for each in self.views)


def _by_view(table: ObservationTable) -> Iterable[tuple[str, NDArray[np.bool_]]]:
    names = table.names("view")
    return ((name, names == name) for name in dict.fromkeys(names.tolist()))


def _mask(length: int, places: NDArray[np.int64]) -> NDArray[np.bool_]:
    mask = np.zeros(length, dtype=np.bool_)
    mask[places] = True
    return mask


def _view_of(table: ObservationTable, allowed: list[float]) -> SweepView | None:
    """Return one view's sweep; None where fewer than two exposure times show all its features."""
    frame = table.frame
    features = tuple(frame["feature"].unique(maintain_order=True).to_list())
    counts = dict(frame.group_by("exposure_ms").len().iter_rows())
    settings = [each for each in allowed if counts.get(each) == len(features)]
    if len(settings) < 2:
        return None
    order = pl.DataFrame({"feature": features})
    rows = tuple(
        ObservationTable(
            frame=order.join(
                frame.filter(pl.col("exposure_ms") == each), on="feature", maintain_order="left"
            ).select(frame.columns),
            checked=True,
        )
        for each in settings
    )
    return SweepView(
        name=str(frame["view"][0]),
        features=features,
        settings_ms=np.array(settings),
        p_norm=np.stack([each.array(("p_norm",))[:, 0] for each in rows], axis=1),
        poses=rows[0].frame.select(_POSE),
        rows=rows,
    )


def _preset_of(frame: pl.DataFrame) -> ActiveSensor | None:
    names = set(frame["sensor"].drop_nulls().to_list())
    return next((each for each in PRESETS.values() if names == {each.name}), None)


def _black_level(table: ObservationTable) -> float:
    frame = table.frame
    clipped = frame["clipped_share"].fill_null(0.0) > _UNCLIPPED
    clear = frame.filter(~clipped & (frame["i_avg"] < 200.0))
    if clear.is_empty():
        return 0.0
    keys = clear.select(pl.concat_str("view", "feature", separator="\n")).to_series()
    ring = keys.rank("dense").to_numpy().astype(np.int64) - 1
    grey = clear["i_mean"].fill_null(clear["i_avg"]).to_numpy()
    return black_level_of(ring, grey, clear["exposure_ms"].to_numpy()) or 0.0
