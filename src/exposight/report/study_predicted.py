"""Stills of predictions: Figs. 5, 11, 12, 14, 15 and 24 to 26."""

from typing import Any, Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import Figure
from matplotlib.patches import Circle
from matplotlib.patheffects import withStroke
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from exposight import paper
from exposight.models import P_NORM_MIN
from exposight.quantities import QUANTITIES
from exposight.report import palette
from exposight.report.figures import Still, draw_still, label_panel, plain_axes
from exposight.report.rendering import rounded

_BAND: Final[dict[str, Any]] = {"color": palette.ACCENT, "alpha": 0.18, "linewidth": 0}


def kernel_still(name: str, title: str, data: paper.KernelExamples) -> Still:
    """Draw the regression of a known function with two kernels (Fig. 5)."""

    def draw(figure: Figure) -> None:
        panels = figure.subplots(1, len(data.examples), sharey=True)
        for axes, example in zip(panels, data.examples, strict=True):
            x, mean, std = example.x, example.mean, example.std
            axes.fill_between(x, mean - 2 * std, mean + 2 * std, label="±2σ", **_BAND)
            axes.plot(
                x, example.truth, color=palette.INK, linestyle="--", label="truth, x·sin(2πx)"
            )
            axes.plot(x, mean, color=palette.ACCENT, label="mean")
            observed = example.x_train, example.y_train
            axes.plot(*observed, "o", color=palette.INK, markersize=4, label="observed")
            plain_axes(axes, "x (1)", "f(x) (1)")
            label_panel(axes, example.kernel)
            axes.label_outer()
        figure.legend(*panels[0].get_legend_handles_labels(), loc="outside lower center", ncols=4)

    return draw_still(name, title, (7.2, 3.0), draw)


def best_and_worst_still(name: str, title: str, data: paper.BestAndWorst) -> Still:
    """Draw the curves that were predicted best, above those predicted worst (Figs. 11 and 14)."""
    columns = max(len(data.best), len(data.worst), 1)

    def draw(figure: Figure) -> None:
        shares_y = data.target == "p_norm"
        panels = figure.subplots(2, columns, squeeze=False, sharex=True, sharey=shares_y)
        for row, word, curves in zip(
            panels, ("best", "worst"), (data.best, data.worst), strict=True
        ):
            for axes in row[len(curves) :]:
                axes.set_visible(False)
            for place, (axes, curve) in enumerate(zip(row, curves, strict=False), start=1):
                _curve_panel(axes, data, curve)
                outside = "" if curve.inside else " (extrapolated)"
                label_panel(axes, f"{word} {place}: {curve.observed.feature}{outside}")
        for axes in panels[:, 1:].flat:
            axes.set_ylabel("")
        for axes in panels[0]:
            axes.set_xlabel("")
        handles, labels = panels[0, 0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower center", ncols=3)

    return draw_still(name, title, (7.6, 5.0), draw)


def _curve_panel(axes: Axes, data: paper.BestAndWorst, curve: paper.PredictedCurve) -> None:
    observed, quality = curve.observed, data.target == "p_norm"
    style = palette.feature_style(observed.feature)
    low, high = curve.mean - 2 * curve.std, curve.mean + 2 * curve.std
    axes.fill_between(curve.i_avg, low, high, label="±2σ", **_BAND)
    axes.plot(curve.i_avg, curve.mean, color=palette.ACCENT, label=f"{data.variant}, mean")
    axes.plot(
        observed.i_avg,
        observed.p_norm if quality else observed.exposure_ms,
        linestyle="none",
        marker=style.mark,
        markersize=5,
        markerfacecolor=style.colour if style.filled else "white",
        markeredgecolor=style.colour,
        markeredgewidth=1.4,
        label="observed, unseen feature",
    )
    plain_axes(axes, QUANTITIES["i_avg"].axis_math, QUANTITIES[data.target].axis_math)
    if quality:
        axes.set_xlim(0, 255)
        axes.set_xticks(range(0, 256, 50))
        axes.set_ylim(-0.35, 1.75)
        rmse = f"{100 * curve.rmse:.3g} %"
    else:
        axes.set_ylim(min(0.0, float(low.min())), 1.3 * float(high.max()))
        rmse = f"{curve.rmse:.3g} ms"
    axes.text(
        0.03,
        0.97,
        f"x {rounded(observed.x_mm, 0)}, y {rounded(observed.y_mm, 0)}, "
        f"z {rounded(observed.z_mm, 0)} mm\n"
        f"RMSE {rmse}, {curve.covered} of {len(observed.i_avg)} within 2σ",
        transform=axes.transAxes,
        va="top",
        fontsize=7.5,
        color=palette.MUTED,
    )


def forecast_still(name: str, title: str, data: paper.CaptureForecast) -> Still:
    """Draw one capture's unseen features: where they are, both predictions, the truth (Fig. 15)."""
    features = sorted(
        data.features, key=lambda row: palette.feature_order(row.feature), reverse=True
    )

    def draw(figure: Figure) -> None:
        place, time, quality = figure.subplots(1, 3, width_ratios=(1.25, 1, 1))
        for feature in features:
            _place(place, feature)
        plain_axes(place, QUANTITIES["x_mm"].axis_math, QUANTITIES["y_mm"].axis_math)
        place.margins(0.25)
        place.set_aspect("equal", adjustable="datalim")
        place.invert_yaxis()
        label_panel(place, f"view {data.view}")
        rows = np.arange(len(features))
        _bars(time, features, [(row.exposure_mean_ms, row.exposure_std_ms) for row in features])
        time.axvline(data.exposure_ms, color=palette.INK, linestyle="--", linewidth=1.0)
        plain_axes(time, QUANTITIES["exposure_ms"].axis_math, "")
        label_panel(time, f"dashed: true, {data.exposure_ms:g} ms")
        _bars(quality, features, [(row.p_norm_mean, row.p_norm_std) for row in features])
        for row, feature in zip(rows, features, strict=True):
            style = palette.feature_style(feature.feature)
            quality.plot(
                feature.p_norm, row, style.mark, color=style.colour, markersize=6, zorder=4,
                markerfacecolor="white", markeredgewidth=1.5,
            )  # fmt: skip
        plain_axes(quality, QUANTITIES["p_norm"].axis_math, "")
        label_panel(quality, "measured: open marks")
        time.set_yticks(rows, [_row_name(feature) for feature in features])
        quality.set_yticks(rows, ["" for _ in rows])
        for axes in (time, quality):
            axes.set_ylim(-0.6, len(features) - 0.4)

    return draw_still(name, title, (8.4, 2.9), draw)


def _row_name(feature: paper.FeatureForecast) -> str:
    note = "" if feature.p_norm >= P_NORM_MIN else f"\n{QUANTITIES['p_norm'].math} < {P_NORM_MIN:g}"
    return f"{feature.feature}\n{QUANTITIES['i_avg'].math} {feature.i_avg:.0f}{note}"


def _place(axes: Axes, feature: paper.FeatureForecast) -> None:
    style = palette.feature_style(feature.feature)
    ring = Circle(
        (feature.x_mm, feature.y_mm),
        feature.radius_mm,
        facecolor="none",
        edgecolor=style.colour,
        linewidth=2,
        linestyle="-" if feature.inside else ":",
    )
    axes.add_patch(ring)
    axes.plot(feature.x_mm, feature.y_mm, style.mark, color=style.colour, markersize=3.5)
    axes.annotate(
        feature.feature + ("" if feature.inside else "\nextrapolated"),
        (feature.x_mm, feature.y_mm),
        xytext=(0, -9 - 0.35 * feature.radius_mm),
        textcoords="offset points",
        ha="center",
        va="top",
        fontsize=7.5,
    )


def _bars(
    axes: Axes, features: list[paper.FeatureForecast], values: list[tuple[float, float]]
) -> None:
    for row, (feature, (mean, std)) in enumerate(zip(features, values, strict=True)):
        axes.errorbar(
            mean,
            row,
            xerr=2 * std,
            fmt="|",
            color=palette.ACCENT if feature.inside else palette.OUTSIDE,
            markersize=11,
            markeredgewidth=2.2,
            elinewidth=1.4,
            capsize=3,
        )


_CONTOURS = 5


def surfaces_still(name: str, title: str, data: paper.PredictionSurfaces) -> Still:
    """Draw the mean at the left, twice the standard deviation at the right."""

    def draw(figure: Figure) -> None:
        left, right = figure.subfigures(1, 2, wspace=0.03, squeeze=False)[0]
        _block(left, data, data.mean, is_spread=False)
        _block(right, data, 2 * data.std, is_spread=True)

    # Panels keep the plane's true proportions; the page shall not be filled with white.
    proportion = float(np.ptp(data.y_mm) / np.ptp(data.x_mm))
    height = 1.1 + len(data.i_avg) * max(0.75, 1.45 * proportion)
    return draw_still(name, title, (11.0, height), draw)


def _block(
    figure: Figure, data: paper.PredictionSurfaces, values: NDArray[np.float64], *, is_spread: bool
) -> None:
    quality = data.target == "p_norm"
    shown = "2σ of a new observation’s" if is_spread else "mean"
    figure.suptitle(f"{shown} {QUANTITIES[data.target].axis_math}")
    scale = (
        palette.SPREAD_SCALE
        if is_spread
        else palette.P_NORM_SCALE
        if quality
        else palette.EXPOSURE_SCALE
    )
    colours = LinearSegmentedColormap.from_list("scale", scale)
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
            x, y = data.trained_mm[column][:, :2].T
            axes.scatter(x, y, s=4, facecolor="white", edgecolor="black", linewidth=0.35)
            axes.set(xlim=extent[:2], ylim=extent[2:])
            axes.yaxis.set_major_locator(MaxNLocator(4))
            if row == 0:
                axes.set_title(f"z = {rounded(depth, 0)} mm")
            if row == len(data.i_avg) - 1:
                axes.set_xlabel(QUANTITIES["x_mm"].axis_math)
            if column == 0:
                axes.set_ylabel(f"$\\bf{{i_{{avg}} = {grey:.0f}}}$\n{QUANTITIES['y_mm'].axis_math}")
        figure.colorbar(drawn, ax=panels[row, :], shrink=0.9, pad=0.02, aspect=14)


def _limits(
    data: paper.PredictionSurfaces, values: NDArray[np.float64], row: int, *, is_spread: bool
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
    data: paper.PredictionSurfaces,
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
    lines = axes.contour(
        data.x_mm, data.y_mm, values, levels=levels, colors=palette.INK, linewidths=0.6
    )
    digits = 2 if limits[1] < 2 else 1 if limits[1] < 20 else 0
    for text in axes.clabel(lines, fontsize=6, fmt=f"%.{digits}f"):
        text.set_path_effects([withStroke(linewidth=1.6, foreground="white")])
