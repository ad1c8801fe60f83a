"""What two models say about a view before anything is taken there.

The exposure-time model tells at which exposure time each feature reaches a wanted brightness. A
camera is linear until it clips (EMVA 1288), so the brightness at any other time follows in
proportion, and the quality model tells what to expect of it. This is not a plan yet: one exposure
time is chosen for the view, and no pose is.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from exposight.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from exposight.models import Prediction, Predictor
    from exposight.observing import FeatureView

WANTED_I_AVG = 80.0
"""Grey level, on the plateau of the paper's Fig. 10, which reaches from about 30 to about 120."""

_FULL_SCALE = 255.0
_NODES, _WEIGHTS = np.polynomial.hermite_e.hermegauss(15)


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
    """

    features: tuple[str, ...]
    exposures_ms: tuple[float, ...]
    wanted: Prediction
    i_avg: NDArray[np.float64]
    p_norm: NDArray[np.float64]
    p_norm_std: NDArray[np.float64]

    def best_exposure_ms(self) -> float:
        """Return the exposure time with the highest mean of p_norm over all features, in ms."""
        return self.exposures_ms[int(self.p_norm.mean(axis=0).argmax())]


def forecast_view(
    quality: Predictor,
    exposure: Predictor,
    views: Sequence[FeatureView],
    exposures_ms: Sequence[float],
) -> Forecast:
    """Predict the quality of features in a view at some exposure times.

    The exposure-time model's uncertainty is carried on: the quality is averaged over the
    brightness that the exposure time may lead to (Gauss–Hermite quadrature).

    Parameters
    ----------
    quality : Predictor
        Predicts p_norm from brightness and pose.
    exposure : Predictor
        Predicts the exposure time in ms from brightness and pose.
    views : sequence of FeatureView
        The features that the view sees.
    exposures_ms : sequence of float, ms
        Exposure times to look at.

    Raises
    ------
    InputError
        If there is no feature or no exposure time.
    """
    if not views or not exposures_ms:
        msg = (
            "a forecast needs at least one visible feature and one exposure time, got "
            f"{len(views)} and {len(exposures_ms)}"
        )
        raise InputError(msg)
    wanted = exposure.predict(**_columns(exposure, views, np.full((len(views), 1), WANTED_I_AVG)))
    times_ms = np.asarray(exposures_ms, dtype=np.float64)
    shortest_ms = float(times_ms.min()) / 10  # the normal distribution knows no least time
    nodes_ms = np.maximum(wanted.mean[:, None] + wanted.std[:, None] * _NODES, shortest_ms)
    brightness = np.minimum(
        WANTED_I_AVG * times_ms[:, None] / nodes_ms[:, None, :], _FULL_SCALE
    )  # (features, times, nodes)
    weights = _WEIGHTS / _WEIGHTS.sum()
    flat = brightness.reshape(len(views), -1)
    predicted = quality.predict(**_columns(quality, views, flat))
    mean, std = (own.reshape(brightness.shape) for own in (predicted.mean, predicted.std))
    p_norm = mean @ weights
    variance = (std**2 + mean**2) @ weights - p_norm**2
    return Forecast(
        features=tuple(view.feature.name for view in views),
        exposures_ms=tuple(times_ms.tolist()),
        wanted=wanted,
        i_avg=brightness @ weights,
        p_norm=p_norm,
        p_norm_std=np.sqrt(np.maximum(variance, 0.0)),
    )


def _columns(
    model: Predictor, views: Sequence[FeatureView], i_avg: NDArray[np.float64]
) -> dict[str, NDArray[np.float64]]:
    """Return a model's inputs by name for n views at (n, k) brightnesses, view by view."""
    poses = [view.tcp_from_feature.translation_mm.tolist() for view in views]
    x_mm, y_mm, z_mm = np.array(poses).T
    known = {
        "x_mm": x_mm,
        "y_mm": y_mm,
        "z_mm": z_mm,
        "w_deg": np.array([view.w_deg for view in views]),
        "p_deg": np.array([view.p_deg for view in views]),
    }
    return {
        name: i_avg.ravel() if name == "i_avg" else np.repeat(known[name], i_avg.shape[1])
        for name in model.inputs
    }
