"""See what a kernel assumes: Fig. 5 of the paper, and change points that switch a kernel off.

Give a folder to draw the pictures of docs/gallery.md into: picture_of_kernels.py docs/pictures
"""

import sys
from pathlib import Path

import numpy as np
from matplotlib import pyplot as plt
from matplotlib.axes import Axes
from numpy.typing import NDArray

from exposight.gp import ChangePoint, Kernel, RationalQuadratic, SquaredExponential, fit

Array = NDArray[np.float64]
plt.rcParams.update({"font.size": 9, "axes.spines.top": False, "axes.spines.right": False})
rng = np.random.default_rng(1)


def learn(axes: Axes, title: str, kernel: Kernel, x: Array, y: Array, t: Array) -> None:
    """Fit, predict at t, and draw."""
    process = fit(kernel, x[:, None], y, rng=rng, first_start="given").process
    answer = process.predict(t[:, None])
    band = answer.mean - 2 * answer.std, answer.mean + 2 * answer.std
    axes.fill_between(t, *band, color="#0072b2", alpha=0.2, linewidth=0, label="± 2σ")
    axes.plot(t, answer.mean, color="#0072b2", label="prediction")
    axes.plot(x, y, "o", color="#d55e00", markersize=4, label="observations")
    axes.set_title(title, fontsize=10)


# Fig. 5: seven noisy observations of x·sin(2πx), seen by two kernels
x, t = np.linspace(0.0, 1.2, 7), np.linspace(-0.4, 1.8, 400)
y = x * np.sin(2 * np.pi * x) + rng.normal(0.0, 0.05, 7)
se = SquaredExponential(variance=1.0, length_scales=(0.3,), dims=(0,))
rq = RationalQuadratic(variance=1.0, length_scales=(0.3,), alpha=0.3, dims=(0,), fixed=("alpha",))
fig_5, panels = plt.subplots(1, 2, figsize=(9, 3.4), sharey=True, layout="constrained")
learn(panels[0], "squared exponential", se, x, y, t)
learn(panels[1], "rational quadratic", rq, x, y, t)
for axes in panels:
    axes.plot(t, t * np.sin(2 * np.pi * t), "--", color="#888888", linewidth=1, label="x·sin(2πx)")
    axes.set(xlabel="x", ylim=(-2.6, 2.6))
panels[0].legend(frameon=False, loc="lower center")

# Change points: below 10 grey levels and above 255 there is no quality to predict
x, t = np.concatenate([[2.0, 4.0, 6.0, 8.0], np.linspace(11.0, 253.0, 30)]), np.arange(301.0)
y = (1 - np.exp(-x / 15)) / (1 + np.exp((x - 245) / 30)) + rng.normal(0.0, 0.03, x.shape)
y[x < 10] = 0.0
free = RationalQuadratic(variance=0.5, length_scales=(60.0,), alpha=1.0, dims=(0,))
gated = free * ChangePoint(dim=0, minimum=10.0) * ChangePoint(dim=0, maximum=255.0)
gates, panels = plt.subplots(1, 2, figsize=(9, 3.4), sharey=True, layout="constrained")
learn(panels[0], "without change points", free, x, y, t)
learn(panels[1], "with change points at 10 and 255", gated, x, y, t)
panels[0].set(xlabel="i_avg in grey levels", ylabel="p_norm", xlim=(0, 300), ylim=(-0.25, 1.25))
panels[1].set(xlabel="i_avg in grey levels", xlim=(0, 300))
panels[0].legend(frameon=False, loc="lower center")
for name, figure in (("kernels", fig_5), ("gates", gates)) if len(sys.argv) > 1 else ():
    figure.savefig(Path(sys.argv[1]) / f"{name}.png", dpi=140, metadata={"Software": None})
