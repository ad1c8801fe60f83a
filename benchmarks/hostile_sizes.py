"""Large tables and campaigns: time and peak memory of training, predicting and observing.

Each is measured in a process of its own, with its children.
"""

from __future__ import annotations

import numpy as np
import polars as pl

from exposight.cell import sensor_preset
from exposight.models.ring_light import POSE_COLUMNS, RingLight, Rings
from exposight.observing import ObservationTable


def large_table(rows: int, *, exposures: int = 2, seed: int = 1) -> ObservationTable:
    """Return a table as large as no campaign yet: rings of many features in many views.

    Light is that of the formula, with effects of features, views and rings; p_norm falls at both
    ends of a window, as a stripe projector's does.
    """
    rng, sensor = np.random.default_rng(seed), sensor_preset("comet-pro-ae")
    n = rows // exposures
    views = 100 if n >= 2000 else 20
    poses = np.column_stack(
        [
            rng.uniform(-150.0, 150.0, (n, 2)),
            rng.uniform(-60.0, 60.0, n),
            rng.uniform(-15.0, 15.0, (n, 2)),
            np.full(n, 5.0),
        ]
    )
    feature, view = np.arange(n) // views, np.arange(n) % views
    rings = Rings(
        features=tuple(f"f{i}" for i in feature),
        views=tuple(f"v{i}" for i in view),
        poses=poses,
        turns=np.zeros((n, 3)),
    )
    values, _ = RingLight.of(rings, sensor, projector=True).log_radiance(1.0, 0.3)
    log_radiance = np.log(np.mean(np.exp(values), axis=1))
    log_radiance += 1.5 - np.median(log_radiance)
    log_radiance += 0.05 * rng.standard_normal(feature.max() + 1)[feature]
    log_radiance += 0.02 * rng.standard_normal(views)[view] + 0.02 * rng.standard_normal(n)
    exposure_ms = np.exp(rng.uniform(np.log(5.0), np.log(90.0), (n, exposures))).ravel().round(3)
    ring = np.repeat(np.arange(n), exposures)
    light = np.exp(log_radiance[ring]) * exposure_ms
    grey = np.minimum(255.0, 3.0 + light)
    edges = (np.log(light / 12.0) / 0.1, np.log(light / 240.0) / 0.05)
    low, high = (0.5 * (1.0 + np.tanh(0.8 * edge)) for edge in edges)
    p_norm = np.clip(low * (1.0 - high) + 0.01 * rng.standard_normal(len(ring)), 0.0, 1.0)
    frame = pl.DataFrame(
        {
            "feature": np.array(rings.features)[ring],
            "view": np.array(rings.views)[ring],
            "exposure_ms": exposure_ms,
            "p_norm": p_norm,
            "i_avg": grey,
            **dict(zip(POSE_COLUMNS, poses[ring].T, strict=True)),
            "r_deg": 0.0,
            "i_mean": grey,
            "clipped_share": np.where(grey >= 250.0, 0.5, 0.0),
            "visibility": "visible",
            "emulated": False,
            "sensor": sensor.name,
        }
    )
    return ObservationTable.from_frame(frame)
