"""What observations lack for models that can be relied on, and how many captures that is."""

import math
from dataclasses import dataclass

import numpy as np
import polars as pl

from exposight.errors import ObservationError
from exposight.models.ring_data import DARK, FEW_CLIPPED, clipped_share, ring_data
from exposight.observing import ObservationTable
from exposight.tables import counted, number

_LEAST_RINGS = 3
"""`train_window` learns from so many at least."""
_GOOD_RINGS, _GOOD_GROUPS, _GOOD_EXPOSURES = 10, 4, 3
"""Below so many rings, features and views, and exposure times, bands rest on hardly anything."""
_DENSE, _SPARSE = 0.5, 0.1
_BRIGHT = 250.0


@dataclass(frozen=True, kw_only=True)
class TrainingNeeds:
    """Whether observations are enough to train on, and what would make models better.

    Parameters
    ----------
    can_train : bool
        Whether the default models can be trained at all.
    captures : int
        How many further captures would make the bands hold; 0 where none is needed.
    lacks : tuple of str
        What is missing, in words.
    any_measured : bool
        Whether a feature was measured at all.
    """

    can_train: bool
    captures: int
    lacks: tuple[str, ...]
    any_measured: bool = True

    def __str__(self) -> str:
        if not self.lacks:
            return "enough to train quality and exposure time"
        start = "enough to train quality" if self.can_train else "not enough to train"
        more = f"; about {counted(self.captures, 'more capture')}" if self.captures else ""
        return f"{start}: {'; '.join(self.lacks)}{more}"


def training_needs(table: ObservationTable) -> TrainingNeeds:
    """Return what observations lack for the default models (``docs/models.md``).

    Parameters
    ----------
    table : ObservationTable
        All that was observed so far.
    """
    measured = table.measured()
    frame = measured.frame
    n_views_taken = max(1, table.frame["view"].n_unique())
    exposures = sorted(table.frame["exposure_ms"].unique().to_list())
    if len(measured) == 0:
        return TrainingNeeds(
            can_train=False,
            captures=_GOOD_GROUPS * _GOOD_EXPOSURES,
            lacks=("no feature was measured in any capture",),
            any_measured=False,
        )
    lacks: list[str] = []
    can_train = True
    try:
        rings = len(ring_data(measured))
    except ObservationError as error:
        return TrainingNeeds(can_train=False, captures=0, lacks=(str(error),))
    views, features = frame["view"].n_unique(), frame["feature"].n_unique()
    per_view = rings / views
    more_views = max(0, _GOOD_GROUPS - views, math.ceil((_GOOD_RINGS - rings) / per_view))
    if rings < _LEAST_RINGS:
        can_train = False
        lacks.append(
            f"{counted(rings, 'ring')} of a feature in a view, at least {_LEAST_RINGS} are needed"
        )
    if more_views:
        lacks.append(f"{counted(more_views, 'more view')} (bands rest on {_GOOD_GROUPS} and more)")
    if features < _GOOD_GROUPS:
        lacks.append(f"only {counted(features, 'feature')} measured")
    said, more_times = _times(frame, exposures)
    lacks += said
    captures = more_views * (max(len(exposures), _GOOD_EXPOSURES)) + more_times * n_views_taken
    return TrainingNeeds(can_train=can_train, captures=captures, lacks=tuple(lacks))


def _times(frame: pl.DataFrame, exposures: list[float]) -> tuple[list[str], int]:
    """Return what the exposure times lack, and how many more there should be."""
    lacks, more = [], 0
    clipped = clipped_share(frame) > FEW_CLIPPED
    grey = frame["i_avg"].to_numpy().astype(np.float64)
    p_norm = frame["p_norm"].to_numpy().astype(np.float64)
    time = frame["exposure_ms"].to_numpy()
    if not clipped.any() and not (grey >= _BRIGHT).any():
        brightest = float(np.nanmax(grey[time == time.max()], initial=DARK))
        factor = max(1.5, _BRIGHT / brightest)
        lacks.append(
            f"exposure times should reach further: no ring is clipped at {number(time.max())} ms, "
            f"take one of about {number(factor * time.max())} ms too"
        )
        more += 1
    dark = (p_norm < _SPARSE) & (grey < _BRIGHT / 2) & ~clipped
    if not dark.any():
        lacks.append(
            f"no ring is too dark at {number(time.min())} ms, take one of about "
            f"{number(time.min() / 4)} ms too"
        )
        more += 1
    if not (p_norm > _DENSE).any():
        lacks.append(f"no ring reaches a p_norm of {_DENSE:g}")
    if len(exposures) + more < _GOOD_EXPOSURES:
        extra = _GOOD_EXPOSURES - len(exposures) - more
        lacks.append(f"{counted(len(exposures), 'exposure time')}, at least {_GOOD_EXPOSURES}")
        more += extra
    return lacks, more
