"""Observations of a surface with a known lobe by a sensor with known limits, without simulator."""

from typing import Any

import numpy as np
import polars as pl
from scipy.special import ndtr, ndtri

from exposight.cell import ActiveSensor, sensor_preset
from exposight.models.ring_light import POSE_COLUMNS, RingLight, Rings, log_mean
from exposight.observing import ObservationTable

SENSOR = sensor_preset("comet-pro-ae")
LOG_RATIO, ROUGHNESS, LEVEL = 2.7, 0.26, 11.4
LOW, HIGH, BLACK = 6.0, 245.0, 10.0
OFFSET_MAX, OFFSET_MOD, GRAIN = 0.62, -0.16, 0.08
PERCENTS = (5, 25, 50, 75, 95)
EXPOSURES_MS = (5.0, 10.0, 20.0, 40.0, 80.0, 160.0, 320.0)


def observed(
    *,
    views: int = 12,
    features: int = 8,
    exposures_ms: tuple[float, ...] = EXPOSURES_MS,
    seed: int = 0,
    log_ratio: float = LOG_RATIO,
    level: float = LEVEL,
    names: str = "f{}",
    places: str = "v{}",
    best: float = 1.0,
    finish: str = "bare",
    sensor: ActiveSensor = SENSOR,
    low: float = LOW,
    **columns: Any,
) -> ObservationTable:
    """Return a table: features on a gently curved sheet, seen from random views."""
    rng = np.random.default_rng(seed)
    sheet = np.random.default_rng(7)
    at = sheet.uniform(-120.0, 120.0, (features, 2))
    effect = sheet.normal(0.0, 0.01, features)
    rows = []
    for view in range(views):
        shift = rng.uniform((-80.0, -80.0, -150.0), (80.0, 80.0, 150.0))
        for feature in range(features):
            x, y = at[feature]
            pose = (x + shift[0], y + shift[1], shift[2], 0.06 * y, -10.0 - 0.06 * x, 8.0)
            rows.append((names.format(feature), places.format(view), *pose))
    frame = pl.DataFrame(rows, schema=["feature", "view", *POSE_COLUMNS], orient="row")
    light = RingLight.of(Rings.of(frame), sensor)
    values, _ = light.log_radiance(log_ratio, ROUGHNESS)
    noise = rng.normal(0.0, 0.003, len(values)) + np.tile(effect, views)
    points = level + values + noise[:, None]
    log_radiance = log_mean(points)
    tables = []
    for time in exposures_ms:
        x = points + np.log(time)
        clipped = 1.0 - ndtr((np.log(HIGH) - x - OFFSET_MAX) / GRAIN).mean(axis=1)
        weak = ndtr((np.log(low) - x - OFFSET_MOD) / GRAIN).mean(axis=1)
        mean = np.minimum(BLACK + np.exp(log_radiance) * time, 200.0)
        quantiles = {
            f"i_{stem}_p{percent:02d}": _quantile(x + offset, percent, black)
            for stem, offset, black in (
                ("mean", 0.0, BLACK),
                ("max", OFFSET_MAX, BLACK),
                ("mod", OFFSET_MOD, 0.0),
            )
            for percent in PERCENTS
        }
        tables.append(
            frame.with_columns(
                exposure_ms=pl.lit(time),
                p_norm=pl.Series(best * np.clip(1.0 - clipped - weak, 0.0, 1.0)),
                i_avg=pl.Series(mean),
                i_mean=pl.Series(mean),
                clipped_share=pl.Series(np.clip(clipped, 0.0, 1.0)),
                stack_clipped_share=pl.Series(np.clip(clipped, 0.0, 1.0)),
                brightness_source=pl.lit("stripes-mean"),
                sensor=pl.lit(sensor.name),
                finish=pl.lit(finish),
                r_deg=pl.lit(0.0),
                **{name: pl.Series(value) for name, value in quantiles.items()},
            ).with_columns(**{name: pl.lit(value) for name, value in columns.items()})
        )
    whole = pl.concat(tables).sort("view", "feature", "exposure_ms")
    return ObservationTable.from_frame(whole)


def _quantile(values: np.ndarray, percent: int, black: float) -> np.ndarray:
    """Return a percentile of points with grain, in grey levels that clip."""
    spread = np.sqrt(GRAIN**2 + values.var(axis=1))
    out: np.ndarray = np.minimum(
        black + np.exp(values.mean(axis=1) + ndtri(percent / 100.0) * spread), 255.0
    )
    return out
