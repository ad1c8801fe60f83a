"""Stills of observations and of statistics of them: Figs. 10, 13, 16, 17 and 20 to 23."""

from itertools import cycle

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import Figure

from exposight import paper
from exposight.models import I_AVG_MIN, P_NORM_MIN
from exposight.quantities import QUANTITIES, quantity
from exposight.report.figures import Still, draw_still, label_panel, plain_axes
from exposight.report.palette import ACCENT, INK, MUTED, feature_order, feature_style
from exposight.report.rendering import rounded

_COLUMNS = 2
_PALEST = 0.45
"""Opacity of the last of several places of a feature; the first one's is 1."""


def brightness_still(name: str, title: str, data: paper.BrightnessCurves) -> Still:
    """Draw p_norm over i_avg, a panel for each feature (Figs. 10 and 16)."""
    names = sorted({curve.feature for curve in data.curves}, key=feature_order)
    rows = -(-len(names) // _COLUMNS)

    def draw(figure: Figure) -> None:
        panels = figure.subplots(rows, _COLUMNS, sharex=True, sharey=True, squeeze=False)
        for axes in panels.flat[len(names) :]:
            axes.set_visible(False)
        for axes, name in zip(panels.flat, names, strict=False):
            _brightness_panel(axes, [curve for curve in data.curves if curve.feature == name])
        for axes in panels.flat:
            axes.label_outer()

    return draw_still(name, title, (7.2, 0.5 + 2.3 * rows), draw)


def _brightness_panel(axes: Axes, curves: list[paper.ObservedCurve]) -> None:
    style = feature_style(curves[0].feature)
    for curve in curves:
        axes.plot(
            curve.i_avg,
            curve.p_norm,
            color=style.colour,
            linewidth=0.6,
            alpha=0.45,
            rasterized=True,
        )  # fmt: skip
    axes.scatter(
        np.concatenate([curve.i_avg for curve in curves]),
        np.concatenate([curve.p_norm for curve in curves]),
        s=9,
        marker=style.mark,
        facecolor=style.colour if style.filled else "white",
        edgecolor=style.colour,
        linewidth=0.6,
        alpha=0.85,
        zorder=3,
        rasterized=True,
    )
    axes.axvline(I_AVG_MIN, color=MUTED, linewidth=0.9, linestyle=":")
    axes.axhline(P_NORM_MIN, color=MUTED, linewidth=0.9, linestyle="--")
    axes.set_xlim(0, 258)
    axes.set_ylim(-0.04, None)
    plain_axes(axes, QUANTITIES["i_avg"].axis_math, QUANTITIES["p_norm"].axis_math)
    label_panel(
        axes, f"{curves[0].feature}, radius {curves[0].radius_mm:.3g} mm, {len(curves)} views"
    )


def exposure_row_still(name: str, title: str, data: paper.ExposureRow) -> Still:
    """Draw t_exp over i_avg at positions along x (Figs. 13 and 17)."""

    def draw(figure: Figure) -> None:
        axes = figure.subplots()
        # Name and curve in the order in which they end, so that lines and legend read alike.
        ordered = sorted(data.curves, key=lambda curve: -curve.slope_ms)
        opacities = np.linspace(1.0, _PALEST, len(ordered)).tolist()
        lines = cycle(("-", "--", "-.", ":"))
        for curve, opacity, line in zip(ordered, opacities, lines, strict=False):
            style = feature_style(curve.feature)
            grey = np.array([0.0, float(curve.i_avg.max())])
            axes.plot(grey, curve.slope_ms * grey, color=MUTED, linewidth=0.8, linestyle=line)
            axes.plot(
                curve.i_avg,
                curve.exposure_ms,
                color=style.colour,
                alpha=opacity,
                marker=style.mark,
                markersize=4.5,
                linestyle=line,
                label=f"x = {rounded(curve.x_mm, 0)} mm: {curve.slope_ms:.3g} ms per grey level",
            )
        axes.set_xlim(0, None)
        axes.set_ylim(0, None)
        plain_axes(axes, QUANTITIES["i_avg"].axis_math, QUANTITIES["exposure_ms"].axis_math)
        first = ordered[0]
        label_panel(
            axes,
            f"{first.feature}, y ≈ {rounded(first.y_mm, 0)} mm, z ≈ {rounded(first.z_mm, 0)} mm, "
            f"{QUANTITIES['p_norm'].math} ≥ {P_NORM_MIN:g}",
        )
        axes.legend(loc="upper left", bbox_to_anchor=(1.01, 1.0))

    return draw_still(name, title, (7.2, 3.2), draw)


def positions_still(name: str, title: str, data: paper.TrainingPositions) -> Still:
    """Draw where the training features stood, seen along and across the sensor's axis (Fig. 21)."""
    ordered = sorted(data.features, key=lambda feature: feature_order(feature.feature))

    def draw(figure: Figure) -> None:
        front, side = figure.subplots(1, 2)
        for feature in ordered:
            style = feature_style(feature.feature)
            x, y, z = feature.positions_mm.T
            dots = {
                "s": 16,
                "marker": style.mark,
                "facecolor": style.colour,
                "edgecolor": "white",
                "linewidth": 0.3,
                "label": f"{feature.feature}, {len(x)} views",
            }
            front.scatter(x, y, **dots)
            side.scatter(z, x, **dots)
        plain_axes(front, QUANTITIES["x_mm"].axis_math, QUANTITIES["y_mm"].axis_math)
        plain_axes(side, QUANTITIES["z_mm"].axis_math, QUANTITIES["x_mm"].axis_math)
        for axes in (front, side):
            axes.axhline(0, color=MUTED, linewidth=0.8)
            axes.axvline(0, color=MUTED, linewidth=0.8)
        front.invert_yaxis()  # y points down in the camera's frame
        label_panel(front, "as the camera sees it")
        label_panel(side, "from above, sensor at the left")
        front.set_aspect("equal", adjustable="datalim")
        figure.legend(*front.get_legend_handles_labels(), loc="outside lower center", ncols=4)

    return draw_still(name, title, (7.2, 3.7), draw)


DEPENDENCE_SCALE = ("#ffffff", "#cfe3e7", "#7db4bf", "#2f8494", "#0b4957")
_DARK = 0.55


def dependence_still(name: str, title: str, data: paper.DependenceMatrix) -> Still:
    """Draw the matrix of maximal information coefficients with their values (Fig. 20)."""
    names = [quantity(name).math for name in data.columns]

    def draw(figure: Figure) -> None:
        axes = figure.subplots()
        colours = LinearSegmentedColormap.from_list("scale", DEPENDENCE_SCALE)
        image = axes.imshow(data.values, cmap=colours, vmin=0, vmax=1)
        places = range(len(names))
        axes.set_xticks(places, names)
        axes.set_yticks(places, names)
        axes.tick_params(length=0)
        axes.spines[:].set_visible(False)
        for row in places:
            for column in places:
                value = float(data.values[row, column])
                axes.text(
                    column, row, f"{value:.2f}", ha="center", va="center", fontsize=7.5,
                    color="white" if value > _DARK else INK,
                )  # fmt: skip
        figure.colorbar(image, label="maximal information coefficient (1)", shrink=0.8)

    return draw_still(name, title, (6.2, 5.2), draw)


def learning_still(name: str, title: str, data: paper.LearningCurve) -> Still:
    """Draw R² and RMSE over the number of training observations (Figs. 22 and 23)."""
    numbers = [step.n_train for step in data.steps]
    shown = QUANTITIES["p_norm" if data.variant.startswith("q") else "exposure_ms"]
    rmse = [shown.error_factor * step.score.rmse for step in data.steps]
    r2 = [step.score.r2_percent for step in data.steps]

    def draw(figure: Figure) -> None:
        fit, error = figure.subplots(1, 2)
        fit.plot(numbers, r2, "o-", color=ACCENT)
        plain_axes(fit, "training observations", "R² (%)")
        label_panel(fit, f"{data.variant}: R² on unseen features")
        error.plot(numbers, rmse, "s-", color=INK)
        plain_axes(error, "training observations", f"RMSE ({shown.error_unit})")
        label_panel(error, f"{data.variant}: RMSE on unseen features")
        fit.set_ylim(min(0.0, *r2), 102)
        error.set_ylim(0, 1.15 * max(rmse))
        for axes in (fit, error):
            axes.set_xlim(0, None)

    return draw_still(name, title, (7.2, 2.9), draw)
