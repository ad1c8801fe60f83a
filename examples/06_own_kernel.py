"""A kernel of one's own, on the logarithm of exposure time, in tables beside the paper's models.

Exposure time goes with a power of brightness times what varies smoothly with the pose; learnt as a
logarithm it is never below 0. Campaign and study are miniatures of the simulated cell's.
"""

from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import ClassVar

import numpy as np
import polars as pl

import exposight as xs
from exposight import gp, measuring, models, paper, twin
from exposight.gp import FloatArray as Array


@gp.register_kernel
@dataclass(frozen=True, kw_only=True)
class PowerLaw(gp.Leaf):
    """k(x, x') = variance · ln(1 + x) · ln(1 + x'): a straight line over ln(1 + x)."""

    variance: float
    dim: int
    type_name: ClassVar[str] = "example/power-law"
    quantities: ClassVar = {"variance": gp.Quantity.VARIANCE}

    def fill(self, x: Array, y: Array, out: Array) -> None:  # noqa: D102
        np.outer(self.variance * np.log1p(x[:, self.dim]), np.log1p(y[:, self.dim]), out)

    def derivatives(self, x: Array, y: Array, weights: Array) -> Array:  # noqa: D102
        covariances = np.empty_like(weights)
        self.fill(x, y, covariances)
        return np.array([np.sum(weights * covariances)])

    def prior_variance(self, x: Array) -> Array:  # noqa: D102
        return self.variance * np.log1p(x[:, self.dim]) ** 2


pose = gp.Matern32(variance=1.0, length_scales=(1.0,) * 5, dims=(1, 2, 3, 4, 5))
kernel = PowerLaw(variance=1.0, dim=0) + pose
form = replace(models.model_named("e_k6"), name="e_power", kernel=kernel, target_scale="log")

if __name__ == "__main__":
    cell = twin.SimulatedCell.for_plan(plan := xs.plan_preset("small"), rings_only=True)
    with TemporaryDirectory() as name:
        folder = Path(name)
        measuring.measure_observations(plan, cell, workers=2).write(folder / "inside.csv")
        settings = paper.StudySettings(sensors=("structured-light",), quick=True, campaigns=folder)
        study = paper.add_to_study(paper.run_study(folder, settings), form, beside="e_k6")
        known, unseen = (study.dataset(name).table for name in ("eX_plusplus", "eX_test"))
        model = models.Training(specification=form, table=known, seed=1).run()
        xs.save_model(folder / "e_power.exposight-model", model)
        result = models.evaluate(xs.load_model(folder / "e_power.exposight-model"), unseen)
    both = pl.col("variant").is_in(["e_k6", "e_power"])
    scores = study.tables.scores.filter(both, pl.col("n") > 0)
    print(scores.select("variant", "role", "n", "rmse", "relative_error_percent"))
    print(f"no band reaches below {result.prediction.low.min():.1f} ms")
