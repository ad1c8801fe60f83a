"""Which capture would tell most: the one that leaves least uncertain of the rings to be measured.

A capture measures the radiance of its view's rings, as far as they neither clip nor stay dark at
its exposure time. What it would leave uncertain of all target rings follows from the joint
covariance alone, before anything is captured (Cohn, Ghahramani and Jordan 1996, Sect. 4: the
expected variance of the learner, minimised).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypeAlias

import numpy as np
import polars as pl
from numpy.typing import NDArray
from scipy.special import ndtr

from exposight.errors import InputError
from exposight.models.window_model import WindowModel

FloatArray: TypeAlias = NDArray[np.float64]

_MEASURED_STD = 0.015
"""Of ln radiance, from one capture in which a ring is well exposed."""

_DARK = 3.0
"""Grey levels above black that a ring's mean must have to tell its radiance."""

_HEADROOM = 0.55
"""Mean brightness over the brightest frame's, in sinusoidal fringes: above that share of the limit
something clips."""


def propose_captures(
    model: WindowModel,
    candidates: pl.DataFrame,
    exposures_ms: Sequence[float],
    *,
    targets: pl.DataFrame | None = None,
) -> pl.DataFrame:
    """Rank captures by what they would tell of the rings that are to be measured.

    Parameters
    ----------
    model : WindowModel
        What is known so far.
    candidates : polars.DataFrame
        Rings of views that could be captured: ``feature``, ``view`` and poses, as
        `WindowModel.forecast` takes them.
    exposures_ms : sequence of float, ms
        Exposure times that could be set.
    targets : polars.DataFrame, optional
        Rings that are to be known; the candidates by default.

    Returns
    -------
    polars.DataFrame
        A row for each view, the most telling first: ``view``, ``exposure_ms``, ``rings`` (expected
        number of rings that it measures), ``error_before`` and ``error_after``, the root mean
        square of the standard deviation of the targets' ln radiance.

    Raises
    ------
    InputError
        If there is no candidate or no exposure time.
    """
    times = np.asarray(exposures_ms, dtype=np.float64)
    if candidates.height == 0 or times.size == 0:
        msg = (
            "a proposal needs at least one view that could be captured and one exposure time, got "
            f"{candidates.height} rings and {times.size} exposure times"
        )
        raise InputError(msg)
    names = ["feature", "view"]
    wanted = candidates if targets is None else targets
    both = pl.concat([candidates, wanted], how="diagonal_relaxed").unique(
        names, keep="first", maintain_order=True
    )
    place = {key: i for i, key in enumerate(both.select(names).iter_rows())}
    forecast = model.forecast(both, times)
    covariance, std = forecast.covariance, forecast.std
    goal = np.array([place[key] for key in wanted.select(names).iter_rows()])
    before = float(np.mean(std[goal] ** 2))
    usable = _chance_usable(forecast.mean, std, times, model)
    rows = []
    for view in candidates["view"].unique(maintain_order=True):
        keys = candidates.filter(pl.col("view") == view).select(names).iter_rows()
        rings = np.array([place[key] for key in keys])
        total = usable[rings].sum(axis=0)
        best, least, measured = 0, before, 0.0
        # the exposure times that leave most rings usable; others measure a subset, roughly
        for column in np.argsort(-total)[:3]:
            share = np.maximum(usable[rings, column], 1e-3)
            within = covariance[np.ix_(rings, rings)] + np.diag(_MEASURED_STD**2 / share)
            within += np.diag(np.diagonal(covariance)[rings] * (1.0 / share - 1.0))
            across = covariance[np.ix_(goal, rings)]
            gain = np.einsum("ij,ji->i", across, np.linalg.solve(within, across.T))
            after = float(np.mean(np.maximum(std[goal] ** 2 - gain, 0.0)))
            if after < least:
                best, least, measured = int(column), after, float(total[column])
        rows.append((view, float(times[best]), measured, before**0.5, least**0.5))
    schema = {
        "view": pl.String,
        "exposure_ms": pl.Float64,
        "rings": pl.Float64,
        "error_before": pl.Float64,
        "error_after": pl.Float64,
    }
    return pl.DataFrame(rows, schema=schema, orient="row").sort("error_after")


def _chance_usable(
    mean: FloatArray, std: FloatArray, times: FloatArray, model: WindowModel
) -> FloatArray:
    """Return the chance that a ring neither clips nor stays dark, (n, m)."""
    logs = mean[:, None] + np.log(times)
    spread = np.maximum(std[:, None], 0.05)
    high = model.window.span[1] + np.log(_HEADROOM)
    out: FloatArray = ndtr((high - logs) / spread) - ndtr((np.log(_DARK) - logs) / spread)
    return np.maximum(out, 0.0)
