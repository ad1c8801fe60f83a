"""Observations to rings: the radiance of each feature in each view, from all its captures.

A camera is linear until it clips (EMVA 1288): brightness = black level + L · t. One number for a
feature and view, its radiance L in grey levels per ms, thus says how bright the ring is at any
exposure time. Captures in which more than a few pixels clip only tell that L is at least so much.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import polars as pl
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar

from exposight.errors import ObservationError
from exposight.models.ring_light import POSE_COLUMNS, TURN_COLUMNS, Rings
from exposight.observing import ObservationTable

CLIPPED_COLUMNS = ("stack_clipped_share", "clipped_share")
"""Where tables say how much of a ring clips: in any frame, or in the one image."""

FEW_CLIPPED = 0.002
"""Share of clipped pixels up to which a mean brightness counts as unclipped."""

_RELATIVE, _GREY = 0.01, 0.4
"""Error of a ring's mean brightness: a share of it (light, linearity), and grey levels (rounding,
black level); both assumed. The scatter beyond them is learnt."""

DARK = 1.5
"""Grey levels above black below which a mean brightness only says that the ring is dark."""

_LEAST_PAIRS = 8
"""So many rings with several usable exposure times are needed to learn the black level."""

_SAME_POSE = 1.0
"""mm or degrees by which poses of one view may differ: they are read back, or aligned, anew."""

_ALIKE = 1.1
"""How many times as bright a capture that is taken again may be."""

_UNKNOWN_BLACK = 8.0
"""Grey levels by which a brightness is uncertain where the black level is not known; assumed:
cameras have 0 to some 16."""

GRAZING_DEG = 70.0
"""Rings seen from further off their normal are nothing that a sensor measures, often behind the
part's edge, and tell nothing of how the surface reflects: views are found up to 60°."""

RING_COLUMNS = ("feature", "view", *POSE_COLUMNS)


@dataclass(frozen=True, kw_only=True, eq=False)
class RingData:
    """The radiance of n rings, each of a feature in a view.

    Parameters
    ----------
    rings : Rings
        Where they are.
    incidence_deg : (n,) ndarray, degrees
        Between the camera's ray and the normal, as recorded; NaN where it was not.
    log_radiance : (n,) ndarray
        ln of grey levels per ms; where only a limit is known, that limit.
    variance : (n,) ndarray
        Of the measurement alone.
    limit : (n,) ndarray of int
        0 where it was measured, 1 where the ring is at least as bright, −1 where at most.
    black_level : float, grey levels
        Brightness without light; 0 where nothing tells it.
    black_level_known : bool
        Whether something does.
    source : str
        The column that brightness was read from, ``i_mean`` or ``i_avg``.
    """

    rings: Rings
    incidence_deg: NDArray[np.float64]
    log_radiance: NDArray[np.float64]
    variance: NDArray[np.float64]
    limit: NDArray[np.int64]
    black_level: float
    black_level_known: bool
    source: str

    def __len__(self) -> int:
        return len(self.rings)

    def take(self, places: NDArray[np.int64]) -> RingData:
        """Return some of the rings, in the order of `places`."""
        return replace(
            self,
            rings=self.rings.take(places),
            incidence_deg=self.incidence_deg[places],
            log_radiance=self.log_radiance[places],
            variance=self.variance[places],
            limit=self.limit[places],
        )

    def thinned(self, most: int) -> RingData:
        """Return at most so many rings: one of each feature and each view first, then any.

        Drawn with a fixed seed, so that the same table gives the same model; measured rings go
        before those of which only a limit is known.
        """
        if len(self) <= most:
            return self
        order = np.random.default_rng(0).permutation(len(self))
        order = order[np.argsort(self.limit[order] != 0, kind="stable")]
        first = np.zeros(len(self), dtype=np.bool_)
        for names in (self.rings.features, self.rings.views):
            _, places = np.unique(np.array(names)[order], return_index=True)
            first[order[places]] = True
        chosen = order[np.argsort(~first[order], kind="stable")][:most]
        return self.take(np.sort(chosen))


def without_grazing(table: ObservationTable) -> tuple[ObservationTable, int]:
    """Return a table without rings seen at more than `GRAZING_DEG`, and how many rows those were.

    Rows whose ``incidence_deg`` is not known stay.
    """
    frame = table.frame
    if "incidence_deg" not in frame.columns:
        return table, 0
    grazing = frame["incidence_deg"].cast(pl.Float64).fill_nan(None).fill_null(0.0) > GRAZING_DEG
    seen = grazing & frame["p_norm"].is_not_null()
    return table.where(~seen), int(seen.sum())


def brightness_column(table: ObservationTable) -> str:
    """Return ``i_mean`` where every measured row has it, else ``i_avg``."""
    frame = table.frame
    has_mean = "i_mean" in frame.columns and frame["i_mean"].null_count() == 0 and frame.height > 0
    return "i_mean" if has_mean else "i_avg"


def clipped_share(frame: pl.DataFrame) -> NDArray[np.float64]:
    """Return the share of each ring's pixels that clip: in any frame, or in the one image."""
    columns = [name for name in CLIPPED_COLUMNS if name in frame.columns]
    shares = frame.select(pl.coalesce(*columns, pl.lit(0.0)).cast(pl.Float64)).to_numpy()
    out: NDArray[np.float64] = shares[:, 0]
    return out


def measurement_variance(above: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the variance of ln radiance from captures of some mean brightness.

    Parameters
    ----------
    above : ndarray, grey levels
        Mean brightness of a ring, above black.
    """
    out: NDArray[np.float64] = _RELATIVE**2 + (_GREY / above) ** 2
    return out


def black_level_of(
    group: NDArray[np.int64], grey: NDArray[np.float64], exposure_ms: NDArray[np.float64]
) -> float | None:
    """Find the brightness without light: what makes all rings' brightness proportional to time.

    Parameters
    ----------
    group : (m,) ndarray of int
        The ring of each unclipped capture.
    grey, exposure_ms : (m,) ndarray
        Its mean brightness, grey levels, and exposure time, ms.

    Returns
    -------
    float or None
        Grey levels; None where too few rings were taken at several exposure times.
    """
    counts = np.bincount(group)
    several = counts[group] > 1
    if np.count_nonzero(counts > 1) < _LEAST_PAIRS:
        return None
    group, grey, exposure_ms = group[several], grey[several], exposure_ms[several]

    def loss(black: float) -> float:
        above = np.maximum(grey - black, 0.05)
        weight = 1.0 / measurement_variance(above)
        value = np.log(above / exposure_ms)
        mean = np.bincount(group, weight * value) / np.maximum(np.bincount(group, weight), 1e-9)
        squared = weight * (value - mean[group]) ** 2
        robust = np.where(squared < 9.0, squared, 6.0 * np.sqrt(squared) - 9.0)
        return float(np.sum(robust - np.log(weight)))

    # A black level can be no brighter than the darkest ring, but for rounding.
    highest = float(grey.min()) + _GREY
    grid = np.linspace(-2.0, highest, 60)
    best = int(np.argmin([loss(black) for black in grid]))
    low, high = grid[max(best - 1, 0)], grid[min(best + 1, len(grid) - 1)]
    return float(minimize_scalar(loss, bounds=(low, high), method="bounded").x)


def _check_one_pose(rings: pl.DataFrame) -> None:
    """Check that a feature stays where it is in all captures of a view."""
    moved = rings.select(pl.max_horizontal(f"{name}_moved" for name in POSE_COLUMNS)).to_series()
    if moved.max() is None or float(moved.to_numpy().max()) <= _SAME_POSE:
        return
    row = rings.row(int(moved.arg_max() or 0), named=True)
    name = max(POSE_COLUMNS, key=lambda column: float(row[f"{column}_moved"]))
    msg = (
        f"feature {row['feature']!r} has several poses in view {row['view']!r} (column {name} "
        f"differs by {row[f'{name}_moved']:.3g}): if the rows are of several campaigns, give their "
        "views different names"
    )
    raise ObservationError(msg)


def _check_captures_agree(frame: pl.DataFrame, brightness: str) -> None:
    """Check that a capture that is there twice is as bright both times."""
    spread = (
        frame.group_by("feature", "view", "exposure_ms", maintain_order=True)
        .agg(pl.col(brightness).min().alias("least"), pl.col(brightness).max().alias("most"))
        .filter(pl.col("most") > _ALIKE * pl.col("least") + 2.0)
    )
    if spread.height == 0:
        return
    row = spread.row(0, named=True)
    msg = (
        f"feature {row['feature']!r} in view {row['view']!r} at {row['exposure_ms']:g} ms has "
        f"{brightness} {row['least']:.1f} in one row and {row['most']:.1f} in another "
        f"({spread.height} captures contradict themselves so): they are of different finishes, "
        "parts or campaigns; give them different views, or train on one"
    )
    raise ObservationError(msg)


def ring_data(table: ObservationTable, *, black_level: float | None = None) -> RingData:
    """Gather the radiance of every feature and view from a table's captures.

    Parameters
    ----------
    table : ObservationTable
        Measured rows are used.
    black_level : float, grey levels, optional
        Brightness without light, where it is known; found from the captures if left out.

    Raises
    ------
    ObservationError
        If there is no measured row, or a feature has several poses in one view.
    """
    measured = table.measured()
    if len(measured) == 0:
        msg = f"none of the table's {len(table)} rows was measured: there is no brightness in them"
        raise ObservationError(msg)
    source = brightness_column(measured)
    turns = [name for name in TURN_COLUMNS if name in measured.frame.columns]
    frame = measured.frame.with_columns(
        pl.struct("feature", "view").rank("dense").cast(pl.Int64).sub(1).alias("_ring"),
        pl.Series("_clipped", clipped_share(measured.frame)),
    )
    moved = (pl.col(*POSE_COLUMNS).max() - pl.col(*POSE_COLUMNS).min()).name.suffix("_moved")
    rings = (
        frame.group_by("_ring", maintain_order=True)
        .agg(pl.col(*RING_COLUMNS, "incidence_deg", *turns).first(), moved)
        .sort("_ring")
    )
    _check_one_pose(rings)
    _check_captures_agree(frame, source)
    group = frame["_ring"].to_numpy()
    grey = frame[source].to_numpy().astype(np.float64)
    exposure_ms = frame["exposure_ms"].to_numpy()
    usable = frame["_clipped"].to_numpy() <= FEW_CLIPPED
    if black_level is None:
        black_level = black_level_of(group[usable], grey[usable], exposure_ms[usable])
    black_level_known = black_level is not None
    black_level = black_level or 0.0
    above = grey - black_level
    bright = above > DARK
    measured_well = usable & bright
    uncertain = measurement_variance(np.maximum(above, DARK))
    if not black_level_known:
        uncertain += (_UNKNOWN_BLACK / np.maximum(above, DARK)) ** 2
    weight = 1.0 / uncertain
    value = np.log(np.maximum(above, DARK) / exposure_ms)
    n = rings.height
    total = np.bincount(group, weight * measured_well, minlength=n)
    known = total > 0
    log_radiance = np.bincount(group, weight * value * measured_well, minlength=n).astype(float)
    log_radiance[known] /= total[known]
    variance = np.where(known, 1.0 / np.maximum(total, 1e-9), 0.0)
    limit = np.where(known, 0, np.where(np.bincount(group, bright, minlength=n) > 0, 1, -1))
    for ring in np.flatnonzero(~known):
        rows = group == ring
        # Clipping lowers a mean: the brightest says most. A dark ring's longest capture does.
        log_radiance[ring] = value[rows & bright].max() if limit[ring] > 0 else value[rows].min()
    return RingData(
        rings=Rings.of(rings),
        incidence_deg=rings["incidence_deg"].to_numpy(),
        log_radiance=log_radiance,
        variance=variance,
        limit=limit.astype(np.int64),
        black_level=black_level,
        black_level_known=black_level_known,
        source=source,
    )
