"""A predictor of one's own: saved, loaded, evaluated and used in forecasts like any other.

Quality is taken to be the mean over the nearest observations in brightness and position. The
observations are made up: quality rises at 20 grey levels and falls at 130.
"""

from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import polars as pl
from numpy.typing import NDArray

import exposight as xs
from exposight.models import Provenance, evaluate, input_array, register_predictor


@register_predictor
@dataclass(frozen=True, kw_only=True, eq=False)
class NearestMean(xs.Predictor):
    """Predicts the mean of the k nearest observations."""

    kind = "example/nearest-mean"

    x: NDArray[np.float64]
    y: NDArray[np.float64]
    k: int = 5

    def predict_frame(self, frame: pl.DataFrame) -> xs.Prediction:
        """Predict for a frame whose columns are the inputs."""
        distance = np.linalg.norm(input_array(self.name, frame)[:, None] - self.x, axis=2)
        near = np.argsort(distance, axis=1)[:, : self.k]
        far = np.take_along_axis(distance, near, axis=1)[:, -1]
        return xs.Prediction(
            mean=self.y[near].mean(axis=1), std=self.y[near].std(axis=1) + 0.01, inside=far < 50.0
        )


rng = np.random.default_rng(1)
i_avg, x_mm = rng.uniform(2, 220, 600), rng.uniform(-200, 200, 600)
p_norm = 1 / (1 + np.exp((20 - i_avg) / 3)) / (1 + np.exp((i_avg - 130 + 0.15 * x_mm) / 8))
columns = {"i_avg": i_avg, "x_mm": x_mm, "p_norm": p_norm, "feature": [f"f{i}" for i in range(600)]}
zeros = dict.fromkeys(("y_mm", "z_mm", "w_deg", "p_deg", "r_deg"), 0.0)
other = {"view": "front", "exposure_ms": 10.0, "radius_mm": 5.0, **zeros}
table = xs.ObservationTable.from_frame(
    pl.DataFrame(columns).with_columns(**{name: pl.lit(value) for name, value in other.items()})
)
train, test = table.split(by="feature", share=0.8, seed=1)
inputs = ("i_avg", "x_mm")
model = NearestMean(
    name="nearest", title="mean of neighbours", target="p_norm", inputs=inputs,
    provenance=Provenance.of(train), x=train.array(inputs), y=train.array(["p_norm"])[:, 0],
)  # fmt: skip
with TemporaryDirectory() as folder:
    xs.save_model(file := Path(folder) / "nearest.exposight-model", model)
    again = xs.load_model(file)
print(f"unseen observations: RMSE {100 * evaluate(again, test).score.rmse:.1f} %")
for x, inside in zip((50, 900), again.predict(i_avg=80.0, x_mm=[50.0, 900.0]).inside, strict=True):
    print(f"80 grey levels at x = {x} mm: {'known' if inside else 'unknown'}")
