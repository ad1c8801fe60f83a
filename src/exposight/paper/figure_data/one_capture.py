"""One capture of many features: measured, and predicted by both models (Fig. 15)."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from exposight.errors import ObservationError
from exposight.models import P_NORM_MIN
from exposight.paper.figure_data.training_poses import inside_training_poses

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from exposight.models import TrainedModel
    from exposight.observing import ObservationTable


@dataclass(frozen=True, kw_only=True)
class FeatureForecast:
    """One feature of a capture: measured, and predicted by both models.

    Parameters
    ----------
    feature : str
        Its name.
    x_mm, y_mm, z_mm, radius_mm : float
        Where it stood in the TCP frame, and its radius.
    i_avg : float
        Its brightness, grey level 0–255.
    p_norm, p_norm_mean, p_norm_std : float
        Quality: measured, predicted, standard deviation.
    exposure_mean_ms, exposure_std_ms : float
        Predicted exposure time for this brightness, and its standard deviation.
    inside : bool
        Whether its pose lies inside the box of both models' training poses.
    """

    feature: str
    x_mm: float
    y_mm: float
    z_mm: float
    radius_mm: float
    i_avg: float
    p_norm: float
    p_norm_mean: float
    p_norm_std: float
    exposure_mean_ms: float
    exposure_std_ms: float
    inside: bool


@dataclass(frozen=True, kw_only=True)
class CaptureForecast:
    """Unseen features of one capture (Fig. 15).

    Parameters
    ----------
    view : str
        The capture's view.
    exposure_ms : float
        Its true exposure time.
    quality_rung, exposure_rung : str
        The models' names.
    features : tuple of FeatureForecast
        By name.
    """

    view: str
    exposure_ms: float
    quality_rung: str
    exposure_rung: str
    features: tuple[FeatureForecast, ...]


def capture_forecast(
    quality: tuple[str, TrainedModel],
    exposure: tuple[str, TrainedModel],
    table: ObservationTable,
    *,
    exposure_near_ms: float = 27.0,
) -> CaptureForecast:
    """Predict for all features of the capture that shows most of them well enough.

    Parameters
    ----------
    quality, exposure : (str, TrainedModel)
        Names and models.
    table : ObservationTable
        Unseen features.
    exposure_near_ms : float
        Among captures that show equally many (with p_norm ≥ 0.75, then at all), the one nearest to
        this exposure time is taken; the paper shows 27 ms.

    Raises
    ------
    ObservationError
        If no feature is measured in the table.
    """
    measured = table.measured()
    if len(measured) == 0:
        msg = f"no measured row among {len(table)}: no capture to predict for"
        raise ObservationError(msg)
    view, exposure_ms = _fullest_capture(measured, exposure_near_ms)
    captured = measured.array(["exposure_ms"])[:, 0] == exposure_ms
    rows = measured.where((measured.names("view") == view) & captured)
    return CaptureForecast(
        view=view,
        exposure_ms=exposure_ms,
        quality_rung=quality[0],
        exposure_rung=exposure[0],
        features=tuple(_forecasts(quality[1], exposure[1], rows)),
    )


def _forecasts(
    quality: TrainedModel, exposure: TrainedModel, rows: ObservationTable
) -> list[FeatureForecast]:
    """Predict for each row, by the features' names."""
    q, e = quality.predict_table(rows), exposure.predict_table(rows)
    inside = _pose_inside(quality, rows) & _pose_inside(exposure, rows)
    values = rows.array(["x_mm", "y_mm", "z_mm", "radius_mm", "i_avg", "p_norm"])
    features = [
        FeatureForecast(
            feature=str(name),
            x_mm=float(own[0]),
            y_mm=float(own[1]),
            z_mm=float(own[2]),
            radius_mm=float(own[3]),
            i_avg=float(own[4]),
            p_norm=float(own[5]),
            p_norm_mean=float(q.mean[i]),
            p_norm_std=float(q.std[i]),
            exposure_mean_ms=float(e.mean[i]),
            exposure_std_ms=float(e.std[i]),
            inside=bool(inside[i]),
        )
        for i, (name, own) in enumerate(zip(rows.names("feature"), values, strict=True))
    ]
    return sorted(features, key=lambda own: own.feature)


def _fullest_capture(measured: ObservationTable, exposure_near_ms: float) -> tuple[str, float]:
    counted, good = (_captures(own) for own in (measured, measured.with_quality(P_NORM_MIN)))
    return min(
        counted,
        key=lambda key: (
            -good[key],
            -counted[key],
            abs(np.log(key[1] / exposure_near_ms)),
            key[0],
        ),
    )


def _captures(table: ObservationTable) -> Counter[tuple[str, float]]:
    """Count the rows of each view and exposure time."""
    exposures = table.array(["exposure_ms"])[:, 0].tolist()
    return Counter(zip(table.names("view").tolist(), exposures, strict=True))


def _pose_inside(model: TrainedModel, rows: ObservationTable) -> NDArray[np.bool_]:
    return inside_training_poses(model, rows.array(model.specification.inputs))
