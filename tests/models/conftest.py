"""A small synthetic cell: brightness grows with exposure, quality with brightness."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from exposight.cell import ActiveSensor, ExposureRange, sensor_preset
from exposight.models import GaussianProcessModel, ModelSpecification, Training
from exposight.observing import Observation, ObservationTable
from exposight.workers import Progress, ignore_progress


def synthetic_table(n: int = 60, seed: int = 0) -> ObservationTable:
    """Return n observations; about one in six has i_avg < 10, and p_norm 0."""
    rng = np.random.default_rng(seed)
    rows = []
    for i in range(n):
        x, y, z = rng.uniform(-150, 150, 3).tolist()
        w, p = rng.uniform(-10, 10, 2).tolist()
        reflectance = 2.0 * (600 / (600 + z)) ** 2 * np.cos(np.radians(w)) * np.cos(np.radians(p))
        i_avg = float(min(255.0, rng.uniform(3.0, 260.0)))
        exposure = i_avg / reflectance
        dark = i_avg < 10.0
        quality = float(np.clip(1.0 - np.exp(-i_avg / 30.0) + rng.normal(0, 0.01), 0, 1))
        rows.append(
            Observation(
                feature=f"f{i % 5}",
                view=f"v{i % 7}",
                exposure_ms=float(exposure),
                p_norm=0.0 if dark else quality,
                i_avg=i_avg,
                x_mm=x,
                y_mm=y,
                z_mm=z,
                w_deg=w,
                p_deg=p,
                r_deg=0.0,
                radius_mm=5.0,
                n_points=int(1000 * quality),
                n_pixels=1000,
                i_std=None,
                i_median=None,
                i_p05=None,
                i_p95=None,
                clipped_share=None,
                incidence_deg=abs(w),
                visibility="visible",
                emulated=False,
            )
        )
    return ObservationTable.from_observations(rows)


def train_quickly(
    specification: ModelSpecification,
    table: ObservationTable | None = None,
    progress: Progress = ignore_progress,
    **settings: object,
) -> GaussianProcessModel:
    given = {
        "seed": 5,
        "restarts": 1,
        "source": "synthetic.csv",
        "source_sha256": "ab" * 32,
        **settings,
    }
    table = synthetic_table() if table is None else table
    return Training(specification=specification, table=table, **given).run(progress)


@pytest.fixture(scope="session")
def wide_sensor() -> ActiveSensor:
    """A sensor that can have taken the synthetic tables' exposure times."""
    exposure = ExposureRange(min_ms=0.1, max_ms=1000.0, increment_ms=0.1)
    return replace(sensor_preset("rc-visard-65"), exposure=exposure)


@pytest.fixture
def table() -> ObservationTable:
    return synthetic_table()


@pytest.fixture(scope="session")
def make_table() -> Callable[..., ObservationTable]:
    return synthetic_table


@pytest.fixture(scope="session")
def trained() -> Callable[..., GaussianProcessModel]:
    return train_quickly
