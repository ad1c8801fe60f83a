"""What two models say about a view before anything is taken there.

The exposure-time model tells at which exposure time each feature reaches a wanted brightness. A
camera is linear until it clips (EMVA 1288), so the brightness at any other time follows in
proportion, and the quality model tells what to expect of it. This is not a plan yet: one exposure
time is chosen for the view, and no pose is.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import polars as pl
from numpy.typing import NDArray

from exposight.cell import GREY_MAX
from exposight.errors import InputError
from exposight.files import write_durably
from exposight.models import Prediction, Predictor
from exposight.observing import FeatureView, View, pose_columns
from exposight.quantities import QUANTITIES
from exposight.tables import Column, Table, counted

WANTED_I_AVG = 80.0
"""Grey level, on the plateau of the paper's Fig. 10, which reaches from about 30 to about 120."""

_COLUMNS = (
    Column(name="feature"),
    Column(name="i_avg", decimals=0),
    Column(name="p_norm", decimals=2),
    Column(name="p_norm_low", label="−2σ", decimals=2),
    Column(name="p_norm_high", label="+2σ", decimals=2),
    Column(name="inside", label="inside training"),
)

_NODES, _WEIGHTS = np.polynomial.hermite_e.hermegauss(15)
_MIDDLE = len(_NODES) // 2


@dataclass(frozen=True, kw_only=True, eq=False)
class Forecast:
    """What to expect of n features in a view at m exposure times.

    Parameters
    ----------
    features : tuple of str
        The n features.
    exposures_ms : tuple of float, ms
        The m exposure times.
    wanted : Prediction
        Exposure time in ms at which each feature has the brightness `WANTED_I_AVG`.
    i_avg : (n, m) ndarray, grey levels 0–255
        Brightness to expect.
    p_norm : (n, m) ndarray
        Mean of the quality to expect.
    p_norm_std : (n, m) ndarray
        Its standard deviation, that of the brightness included.
    inside : (n, m) ndarray of bool
        Whether both models were trained on such inputs; elsewhere they extrapolate.
    """

    features: tuple[str, ...]
    exposures_ms: tuple[float, ...]
    wanted: Prediction
    i_avg: NDArray[np.float64]
    p_norm: NDArray[np.float64]
    p_norm_std: NDArray[np.float64]
    inside: NDArray[np.bool_]

    @property
    def p_norm_band(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Mean ± twice the standard deviation, within what p_norm can be; each (n, m)."""
        scale = QUANTITIES["p_norm"]
        low, high = self.p_norm - 2 * self.p_norm_std, self.p_norm + 2 * self.p_norm_std
        return np.clip(low, scale.low, scale.high), np.clip(high, scale.low, scale.high)

    @property
    def frame(self) -> pl.DataFrame:
        """One row for each feature and exposure time.

        Columns ``feature``, ``exposure_ms``, ``i_avg``, ``p_norm``, ``p_norm_std``, ``p_norm_low``
        and ``p_norm_high`` (± 2σ, within 0 to 1), ``inside``.
        """
        n, m = self.p_norm.shape
        low, high = self.p_norm_band
        return pl.DataFrame(
            {
                "feature": np.repeat(np.array(self.features, dtype=object), m).tolist(),
                "exposure_ms": np.tile(self.exposures_ms, n),
                "i_avg": self.i_avg.ravel(),
                "p_norm": self.p_norm.ravel(),
                "p_norm_std": self.p_norm_std.ravel(),
                "p_norm_low": low.ravel(),
                "p_norm_high": high.ravel(),
                "inside": self.inside.ravel(),
            }
        )

    def best_exposure_ms(self) -> float:
        """Return the exposure time with the highest mean of p_norm over all features, in ms."""
        return self.exposures_ms[int(self.p_norm.mean(axis=0).argmax())]

    def write(self, path: str | Path) -> None:
        """Write `frame` as a CSV file, durably."""
        write_durably(Path(path), self.frame.write_csv().encode())

    @property
    def table(self) -> Table:
        """The features at the best exposure time."""
        best = self.best_exposure_ms()
        return Table(
            name="at_best_exposure",
            frame=self.frame.filter(pl.col("exposure_ms") == best),
            columns=_COLUMNS,
            title=f"best exposure time for {counted(len(self.features), 'feature')}: {best:g} ms",
        )

    def __str__(self) -> str:
        return f"{self.table.title}\n{self.table}"

    def _repr_html_(self) -> str:
        return f"<p>{self.table.title}</p>{self.table._repr_html_()}"


def forecast(
    quality: Predictor,
    exposure: Predictor,
    view: View | Sequence[FeatureView],
    exposures_ms: Sequence[float],
) -> Forecast:
    """Predict the quality of features in a view at some exposure times.

    The exposure-time model's uncertainty is carried on: the quality is averaged over the
    brightness that the exposure time may lead to (Gauss–Hermite quadrature).

    Parameters
    ----------
    quality : Predictor
        Predicts p_norm, from brightness or pose or both.
    exposure : Predictor
        Predicts the exposure time in ms, from brightness and perhaps pose.
    view : View or sequence of FeatureView
        The features that the view sees; of a `View`, those that can be measured.
    exposures_ms : sequence of float, ms
        Exposure times to look at.

    Raises
    ------
    InputError
        If there is no feature or no exposure time.
    ObservationError
        If a model reads what is only known of captures.
    """
    features = view.visible if isinstance(view, View) else tuple(view)
    if not len(features) or not len(exposures_ms):
        msg = (
            "a forecast needs at least one visible feature and one exposure time, got "
            f"{len(features)} and {len(exposures_ms)}"
        )
        raise InputError(msg)
    poses = pose_columns(features)
    wanted = exposure.predict(poses.with_columns(i_avg=pl.lit(WANTED_I_AVG)))
    times_ms = np.asarray(exposures_ms, dtype=np.float64)
    shortest_ms = float(times_ms.min()) / 10  # the normal distribution knows no least time
    nodes_ms = np.maximum(wanted.mean[:, None] + wanted.std[:, None] * _NODES, shortest_ms)
    brightness = np.minimum(
        WANTED_I_AVG * times_ms[:, None] / nodes_ms[:, None, :], GREY_MAX
    )  # (features, times, nodes)
    weights = _WEIGHTS / _WEIGHTS.sum()
    repeated = poses[np.repeat(np.arange(len(features)), brightness[0].size)]
    predicted = quality.predict(
        repeated.with_columns(
            pl.Series("i_avg", brightness.ravel()),
            pl.Series("exposure_ms", np.broadcast_to(times_ms[:, None], brightness.shape).ravel()),
        )
    )
    mean, std = (values.reshape(brightness.shape) for values in (predicted.mean, predicted.std))
    inside = predicted.inside.reshape(brightness.shape)[:, :, _MIDDLE]
    p_norm = mean @ weights
    variance = (std**2 + mean**2) @ weights - p_norm**2
    return Forecast(
        features=tuple(poses["feature"].to_list()),
        exposures_ms=tuple(times_ms.tolist()),
        wanted=wanted,
        i_avg=brightness @ weights,
        p_norm=p_norm,
        p_norm_std=np.sqrt(np.maximum(variance, 0.0)),
        inside=inside & wanted.inside[:, None],
    )
