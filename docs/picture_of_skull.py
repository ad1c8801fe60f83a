"""The recorded skull: quality over brightness, and exposure times of unseen features."""

from __future__ import annotations

import os
import runpy
import tempfile
from pathlib import Path

import numpy as np
from matplotlib import pyplot as plt
from matplotlib.axes import Axes
from picture_style import ACCENT, ACCENT_2, INK, QUIET, save

from exposight.models import model_named
from exposight.report import CampaignReport, ModelResult


def _draw_quality(axes: Axes, result: CampaignReport, quality: ModelResult) -> None:
    """Draw p_norm over i_avg, and the one-dimensional model's mean and band."""
    table = result.table.measured()
    i_avg, p_norm, exposure_ms = table.array(["i_avg", "p_norm", "exposure_ms"]).T
    points = axes.scatter(
        i_avg, p_norm, c=exposure_ms, s=5, alpha=0.6, norm="log", cmap="cividis", linewidths=0
    )
    grid = np.linspace(0.0, 255.0, 512)
    prediction = quality.model.predict(i_avg=grid)
    low, high = prediction.mean - 2 * prediction.std, prediction.mean + 2 * prediction.std
    axes.fill_between(grid, low, high, color=ACCENT_2, alpha=0.15, linewidth=0)
    axes.plot(grid, prediction.mean, color=ACCENT_2, linewidth=1.8, label="ᵠGP₁, mean and 2σ")
    axes.set(
        xlim=(0, 255),
        ylim=(-0.05, 1.3),
        xlabel="brightness of the ring, $i_{avg}$ / grey level",
        ylabel="share of points, $p_{norm}$",
        title="Too dark, good, clipped",
    )
    axes.legend(loc="upper right", frameon=False)
    bar = axes.figure.colorbar(points, ax=axes, label="exposure time (emulated) / ms")
    bar.ax.minorticks_off()
    ticks = [2, 5, 10, 20, 50]
    bar.set_ticks(ticks, labels=[str(tick) for tick in ticks])


def _draw_exposure(axes: Axes, exposure: ModelResult) -> None:
    """Draw predicted over observed exposure times of unseen features."""
    unseen = exposure.evaluation
    inside = unseen.prediction.inside
    limit = 1.05 * float(max(unseen.observed.max(), unseen.prediction.mean.max()))
    axes.plot([0, limit], [0, limit], color=INK, linewidth=0.8)
    # the sweep's exposure times are few: spread the points sideways so that they can be seen
    shift = np.random.default_rng(0).uniform(-0.02, 0.02, inside.size) * unseen.observed
    for mask, colour, label in (
        (inside, ACCENT, "inside the training range"),
        (~inside, QUIET, "outside"),
    ):
        axes.errorbar(
            (unseen.observed + shift)[mask],
            unseen.prediction.mean[mask],
            yerr=2 * unseen.prediction.std[mask],
            fmt="o",
            markersize=2.5,
            elinewidth=0.4,
            alpha=0.5,
            color=colour,
            label=label,
        )
    score = unseen.score
    axes.set(
        xlim=(0, limit),
        ylim=(0, limit),
        xlabel="exposure time / ms",
        ylabel="predicted by ᵉGP₆ ± 2σ / ms",
        title=f"Features never seen: R² {score.r2_percent:.1f} %, RMSE {score.rmse:.2f} ms",
    )
    axes.legend(loc="upper left", frameon=False)


def draw_skull() -> None:
    """Run the example with two models and draw."""
    root = Path(__file__).parents[1]
    recordings = Path(os.environ.get("EXPOSIGHT_REAL_DATA", root.parent / "shared/data/real"))
    example = runpy.run_path(str(root / "examples" / "05_skull.py"))
    with tempfile.TemporaryDirectory() as folder:
        result = example["skull_report"](
            recordings / "skull",
            Path(folder),
            models=(model_named("q_k1"), model_named("e_k6")),
        )
    quality, exposure = result.results
    figure, (left, right) = plt.subplots(1, 2, figsize=(10, 4), layout="constrained")
    _draw_quality(left, result, quality)
    _draw_exposure(right, exposure)
    save(figure, "skull")
    plt.close(figure)
