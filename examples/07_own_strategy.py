"""A way of one's own to choose exposures, beside all others: thirty lines, as `docs/benchmark.md`.

Halving: one capture in the middle of the range, then the middle of what is left on the side where
most features are still to be had. The sweep here is made up; take that of the simulated cell by
``exposight compare --simulated --strategies geometric_3 --add examples/07_own_strategy.py``.
"""

import numpy as np
import polars as pl

import exposight as xs
from exposight.planning import Sweep, Trial, compare, strategy


@strategy("halving", "one capture in the middle, then towards what is too dark or too bright")
def halving(trial: Trial) -> None:
    """Measure a view: `take` captures, or look at a `trial` image; both count."""
    low, high = 0, len(trial.settings_ms) - 1
    while low <= high and trial.left:
        middle = (low + high) // 2
        rows = trial.take(float(trial.settings_ms[middle])).frame
        missing = rows.filter(~pl.col("feature").is_in(list(trial.had)))
        if missing.is_empty():
            return
        if np.median(missing["i_avg"]) > 90.0:
            high = middle - 1
        else:
            low = middle + 1


if __name__ == "__main__":
    light = np.random.default_rng(1).lognormal(0.0, 0.6, (12, 6))  # grey levels per ms
    rows = [
        {"view": f"v{v}", "feature": f"f{f}", "exposure_ms": t, "radius_mm": 5.0,
         "i_avg": min(light[v, f] * t, 255.0), "p_norm": float(25.0 < light[v, f] * t < 120.0)}
        for v in range(12) for f in range(6) for t in np.geomspace(4.0, 400.0, 24).round()
    ]  # fmt: skip
    poses = dict.fromkeys(("x_mm", "y_mm", "z_mm", "w_deg", "p_deg", "r_deg"), pl.lit(0.0))
    table = xs.ObservationTable.from_frame(pl.DataFrame(rows).with_columns(**poses))
    print(compare(Sweep.of(table), ["halving", "adaptive", "geometric_3"]))
