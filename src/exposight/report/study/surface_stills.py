"""Stills of predictions over the sensor's x-y plane: Figs. 12, 24, 25 and 26."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.patheffects import withStroke
from matplotlib.ticker import MaxNLocator

from exposight.report.colours import EXPOSURE_SCALE, INK, P_NORM_SCALE
from exposight.report.markup import fixed
from exposight.report.quantities import axis_math
from exposight.report.study.stills import draw_still

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from numpy.typing import NDArray

    from exposight.paper import PredictionSurfaces
    from exposight.report.study.stills import Still


SPREAD_SCALE = ("#f4f6f8", "#d3dae1", "#aab7c4", "#7f90a2", "#586a7d")
"""2σ: the darker the less sure."""
_CONTOURS = 5


def surfaces_still(data: PredictionSurfaces) -> Still:
    """Draw the mean at the left, twice the standard deviation at the right."""

    def draw(figure: Figure) -> None:
        left, right = figure.subfigures(1, 2, wspace=0.03, squeeze=False)[0]
        _block(left, data, data.mean, is_spread=False)
        _block(right, data, 2 * data.std, is_spread=True)

    # Panels keep the plane's true proportions; the page shall not be filled with white.
    proportion = float(np.ptp(data.y_mm) / np.ptp(data.x_mm))
    height = 1.1 + len(data.i_avg) * max(0.75, 1.45 * proportion)
    return draw_still(11.0, height, draw)


def _block(
    figure: Figure, data: PredictionSurfaces, values: NDArray[np.float64], *, is_spread: bool
) -> None:
    quality = data.target == "p_norm"
    figure.suptitle(
        f"{'2σ of a new observation’s' if is_spread else 'mean'} {axis_math(data.target)}"
    )
    scale = SPREAD_SCALE if is_spread else P_NORM_SCALE if quality else EXPOSURE_SCALE
    colours = LinearSegmentedColormap.from_list("own", scale)
    panels = figure.subplots(len(data.i_avg), len(data.z_mm), sharex=True, sharey=True)
    # y points down in the camera's frame, as rows do in an image
    extent = float(data.x_mm[0]), float(data.x_mm[-1]), float(data.y_mm[-1]), float(data.y_mm[0])
    for row, grey in enumerate(data.i_avg):
        low, high = _limits(data, values, row, is_spread=is_spread)
        for column, depth in enumerate(data.z_mm):
            axes = panels[row, column]
            drawn = axes.imshow(
                values[row, column],
                extent=extent,
                cmap=colours,
                vmin=low,
                vmax=high,
                interpolation="bilinear",
            )
            _contours(axes, data, values[row, column], (low, high), is_spread=is_spread)
            _trained(axes, data.trained_mm[column])
            axes.set(xlim=extent[:2], ylim=extent[2:])
            axes.yaxis.set_major_locator(MaxNLocator(4))
            if row == 0:
                axes.set_title(f"z = {fixed(depth, 0)} mm")
            if row == len(data.i_avg) - 1:
                axes.set_xlabel(axis_math("x_mm"))
            if column == 0:
                axes.set_ylabel(f"$\\bf{{i_{{avg}} = {grey:.0f}}}$\n{axis_math('y_mm')}")
        figure.colorbar(drawn, ax=panels[row, :], shrink=0.9, pad=0.02, aspect=14)


def _limits(
    data: PredictionSurfaces, values: NDArray[np.float64], row: int, *, is_spread: bool
) -> tuple[float, float]:
    """Return a row's range of colours: 0–1 for p_norm; all depths of a brightness share one."""
    if is_spread:
        high = float(values.max() if data.target == "p_norm" else values[row].max())
        return 0.0, high
    if data.target == "p_norm":
        return 0.0, 1.0
    return float(values[row].min()), float(values[row].max())


def _contours(
    axes: Axes,
    data: PredictionSurfaces,
    values: NDArray[np.float64],
    limits: tuple[float, float],
    *,
    is_spread: bool,
) -> None:
    levels = np.linspace(*limits, _CONTOURS + 2)[1:-1]
    if data.target == "p_norm" and not is_spread:
        levels = np.array([0.25, 0.5, 0.75, 0.9])
    levels = levels[(levels > values.min()) & (levels < values.max())]
    if not len(levels):
        return
    lines = axes.contour(data.x_mm, data.y_mm, values, levels=levels, colors=INK, linewidths=0.6)
    digits = 2 if limits[1] < 2 else 1 if limits[1] < 20 else 0
    for text in axes.clabel(lines, fontsize=6, fmt=f"%.{digits}f"):
        text.set_path_effects([withStroke(linewidth=1.6, foreground="white")])


def _trained(axes: Axes, places: NDArray[np.float64]) -> None:
    axes.scatter(
        places[:, 0], places[:, 1], s=4, facecolor="white", edgecolor="black", linewidth=0.35
    )
