"""A cell on paper: a few views in which brightness and quality follow formulas."""

from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest

from exposight.observing import Observation, ObservationTable
from exposight.paper import CAMPAIGNS, StudyResult, StudySettings, StudyTables

EXPOSURES_MS = (5.0, 10.0, 20.0, 40.0, 80.0)


def _observe(
    features: Iterable[str],
    views: int = 6,
    exposures_ms: Iterable[float] = EXPOSURES_MS,
    *,
    scale: float = 1.0,
) -> ObservationTable:
    """Return a row for each feature, view and exposure time.

    `scale` stretches all exposure times, and with them nothing else.
    """
    rng = np.random.default_rng(7)
    rows = []
    for number, feature in enumerate(features):
        for view in range(views):
            x, y, z = [*rng.uniform(-100, 100, 2).tolist(), (-165.0, -5.0, 155.0)[view % 3]]
            w, p = 5.0 + 0.01 * number, -2.0 + 0.2 * number
            grey_per_ms = 2.0 * (600 / (600 + z)) ** 2 * (1 + x / 400)
            for exposure in exposures_ms:
                i_avg = min(255.0, grey_per_ms * exposure)
                p_norm = float(np.interp(i_avg, [10, 25, 110, 150], [0.0, 1.0, 0.95, 0.0]))
                rows.append(
                    Observation(
                        feature=feature,
                        view=f"v{view}",
                        exposure_ms=scale * exposure,
                        p_norm=p_norm,
                        i_avg=i_avg,
                        x_mm=x,
                        y_mm=y,
                        z_mm=z,
                        w_deg=w,
                        p_deg=p,
                        r_deg=0.0,
                        radius_mm=3.0 + number,
                    )
                )
    return ObservationTable.from_observations(rows)


def _write_campaigns(folder: Path) -> Path:
    """Write a table for each of the study's campaigns, and return the folder."""
    for campaign in CAMPAIGNS:
        scale = 0.05 if campaign.sensor == "stereo" else 1.0
        table = _observe(campaign.features(), scale=scale)
        table.write(folder / f"{campaign.name}.csv")
    return folder


@pytest.fixture(scope="session")
def observe() -> Callable[..., ObservationTable]:
    return _observe


@pytest.fixture(scope="session")
def campaigns(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder with a table for each campaign of the study."""
    return _write_campaigns(tmp_path_factory.mktemp("campaigns"))


def _study(**parts: Any) -> StudyResult:
    """Return a study that has these parts only; of the tables, the scores."""
    scores = pl.DataFrame(parts.pop("scores", []), infer_schema_length=None)
    empty = pl.DataFrame()
    defaults = {
        "settings": StudySettings(),
        "exposight_version": "0",
        "campaigns": (),
        "datasets": (),
        "variants": (),
        "tables": StudyTables(scores=scores, hyperparameters=empty, datasets=empty),
        "dependence": (),
        "learning_curves": (),
    }
    return StudyResult(**defaults | parts)


@pytest.fixture(scope="session")
def study() -> Callable[..., StudyResult]:
    return _study
