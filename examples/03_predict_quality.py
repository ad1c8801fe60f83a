"""Train a quality model and ask it how sure it is, and whether it knows this region.

The observations are made up: quality rises at 20 grey levels, falls at 130, and the fall comes
earlier at the side. Two questions follow, one inside and one outside the range of the training.
"""

import numpy as np

from exposight.models import evaluate, model_named, train
from exposight.observing import Observation, ObservationTable

rng = np.random.default_rng(1)
observations = []
for i in range(300):
    i_avg, x_mm = rng.uniform(2, 220), rng.uniform(-200, 200)
    quality = 1 / (1 + np.exp((20 - i_avg) / 3)) / (1 + np.exp((i_avg - 130 + 0.15 * x_mm) / 8))
    p_norm = float(np.clip(quality + rng.normal(0, 0.02), 0, 1))
    observations.append(
        Observation(
            feature=f"f{i % 30}",
            view="v",
            exposure_ms=10.0,
            p_norm=p_norm,
            i_avg=i_avg,
            x_mm=x_mm,
            y_mm=0.0,
            z_mm=0.0,
            w_deg=0.0,
            p_deg=0.0,
            r_deg=0.0,
            radius_mm=5.0,
        )
    )
table = ObservationTable.from_observations(observations)
known = np.arange(len(table)) % 3 > 0
model = train(model_named("q_k3"), table.where(known), seed=1)
score = evaluate(model, table.where(~known)).score
print(f"unseen observations: R² {score.r2_percent:.1f} %, RMSE {100 * score.rmse:.1f} %")
for i_avg, z_mm, x_mm in ((80, 0, 50), (80, 0, 900)):
    answer = model.predict(i_avg=i_avg, z_mm=z_mm, x_mm=x_mm)
    knows = "inside" if answer.inside[0] else "outside"
    band = f"{answer.mean[0]:.2f} ± {2 * answer.std[0]:.2f}"
    print(f"i_avg {i_avg}, x {x_mm} mm: p_norm {band}, {knows} what it was trained on")
