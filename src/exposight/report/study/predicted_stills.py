"""Stills of predictions beside observations: Figs. 5, 11, 14 and 15."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

import numpy as np
from matplotlib.patches import Circle

from exposight.models import P_NORM_MIN
from exposight.report.colours import ACCENT, INK, MUTED, OUTSIDE
from exposight.report.markup import fixed
from exposight.report.quantities import axis_math, column_math
from exposight.report.study.palette import feature_order, feature_style
from exposight.report.study.stills import draw_still, label_panel, plain_axes

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from exposight.paper import (
        BestAndWorst,
        CaptureForecast,
        FeatureForecast,
        KernelExamples,
        PredictedCurve,
    )
    from exposight.report.study.stills import Still


_BAND: Final[dict[str, Any]] = {"color": ACCENT, "alpha": 0.18, "linewidth": 0}


def kernel_still(data: KernelExamples) -> Still:
    """Draw the regression of a known function with two kernels (Fig. 5)."""

    def draw(figure: Figure) -> None:
        panels = figure.subplots(1, len(data.examples), sharey=True)
        for axes, own in zip(panels, data.examples, strict=True):
            axes.fill_between(
                own.x, own.mean - 2 * own.std, own.mean + 2 * own.std, label="±2σ", **_BAND
            )
            axes.plot(own.x, own.truth, color=INK, linestyle="--", label="truth, x·sin(2πx)")
            axes.plot(own.x, own.mean, color=ACCENT, label="mean")
            axes.plot(own.x_train, own.y_train, "o", color=INK, markersize=4, label="observed")
            plain_axes(axes, "x (1)", "f(x) (1)")
            label_panel(axes, own.kernel)
            axes.label_outer()
        figure.legend(*panels[0].get_legend_handles_labels(), loc="outside lower center", ncols=4)

    return draw_still(7.2, 3.0, draw)


def best_and_worst_still(data: BestAndWorst) -> Still:
    """Draw the curves that were predicted best, above those predicted worst (Figs. 11 and 14)."""
    columns = max(len(data.best), len(data.worst), 1)

    def draw(figure: Figure) -> None:
        panels = figure.subplots(2, columns, squeeze=False, sharex=True, sharey=_shares_y(data))
        for row, (word, curves) in zip(
            panels, (("best", data.best), ("worst", data.worst)), strict=True
        ):
            for axes in row[len(curves) :]:
                axes.set_visible(False)
            for place, (axes, own) in enumerate(zip(row, curves, strict=False), start=1):
                _curve_panel(axes, data, own)
                label_panel(axes, f"{word} {place}: {own.observed.feature}{_outside_mark(own)}")
        for axes in panels[:, 1:].flat:
            axes.set_ylabel("")
        for axes in panels[0]:
            axes.set_xlabel("")
        handles, labels = panels[0, 0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower center", ncols=3)

    return draw_still(7.6, 5.0, draw)


def _shares_y(data: BestAndWorst) -> bool:
    return data.target == "p_norm"


def _outside_mark(own: PredictedCurve) -> str:
    return "" if own.inside else " (extrapolated)"


def _curve_panel(axes: Axes, data: BestAndWorst, own: PredictedCurve) -> None:
    seen, quality = own.observed, data.target == "p_norm"
    style = feature_style(seen.feature)
    low, high = own.mean - 2 * own.std, own.mean + 2 * own.std
    axes.fill_between(own.i_avg, low, high, label="±2σ", **_BAND)
    axes.plot(own.i_avg, own.mean, color=ACCENT, label=f"{data.variant}, mean")
    axes.plot(
        seen.i_avg,
        seen.p_norm if quality else seen.exposure_ms,
        linestyle="none",
        marker=style.mark,
        markersize=5,
        markerfacecolor=style.colour if style.filled else "white",
        markeredgecolor=style.colour,
        markeredgewidth=1.4,
        label="observed, unseen feature",
    )
    plain_axes(axes, axis_math("i_avg"), axis_math(data.target))
    if quality:
        axes.set_xlim(0, 255)
        axes.set_xticks(range(0, 256, 50))
        axes.set_ylim(-0.35, 1.75)
        rmse = f"{100 * own.rmse:.3g} %"
    else:
        axes.set_ylim(min(0.0, float(low.min())), 1.3 * float(high.max()))
        rmse = f"{own.rmse:.3g} ms"
    axes.text(
        0.03,
        0.97,
        f"x {fixed(seen.x_mm, 0)}, y {fixed(seen.y_mm, 0)}, z {fixed(seen.z_mm, 0)} mm\n"
        f"RMSE {rmse}, {own.covered} of {len(seen.i_avg)} within 2σ",
        transform=axes.transAxes,
        va="top",
        fontsize=7.5,
        color=MUTED,
    )


def forecast_still(data: CaptureForecast) -> Still:
    """Draw one capture's unseen features: where they are, both predictions, the truth (Fig. 15)."""
    features = sorted(data.features, key=lambda own: feature_order(own.feature), reverse=True)

    def draw(figure: Figure) -> None:
        place, time, quality = figure.subplots(1, 3, width_ratios=(1.25, 1, 1))
        for own in features:
            _place(place, own)
        plain_axes(place, axis_math("x_mm"), axis_math("y_mm"))
        place.margins(0.25)
        place.set_aspect("equal", adjustable="datalim")
        place.invert_yaxis()
        label_panel(place, f"view {data.view}")
        rows = np.arange(len(features))
        _bars(time, features, [(own.exposure_mean_ms, own.exposure_std_ms) for own in features])
        time.axvline(data.exposure_ms, color=INK, linestyle="--", linewidth=1.0)
        plain_axes(time, axis_math("exposure_ms"), "")
        label_panel(time, f"dashed: true, {data.exposure_ms:g} ms")
        _bars(quality, features, [(own.p_norm_mean, own.p_norm_std) for own in features])
        for row, own in zip(rows, features, strict=True):
            style = feature_style(own.feature)
            quality.plot(
                own.p_norm, row, style.mark, color=style.colour, markersize=6, zorder=4,
                markerfacecolor="white", markeredgewidth=1.5,
            )  # fmt: skip
        plain_axes(quality, axis_math("p_norm"), "")
        label_panel(quality, "measured: open marks")
        time.set_yticks(rows, [_row_name(own) for own in features])
        quality.set_yticks(rows, ["" for _ in rows])
        for axes in (time, quality):
            axes.set_ylim(-0.6, len(features) - 0.4)

    return draw_still(8.4, 2.9, draw)


def _row_name(own: FeatureForecast) -> str:
    note = "" if own.p_norm >= P_NORM_MIN else f"\n{column_math('p_norm')} < {P_NORM_MIN:g}"
    return f"{own.feature}\n{column_math('i_avg')} {own.i_avg:.0f}{note}"


def _place(axes: Axes, own: FeatureForecast) -> None:
    style = feature_style(own.feature)
    ring = Circle(
        (own.x_mm, own.y_mm),
        own.radius_mm,
        facecolor="none",
        edgecolor=style.colour,
        linewidth=2,
        linestyle="-" if own.inside else ":",
    )
    axes.add_patch(ring)
    axes.plot(own.x_mm, own.y_mm, style.mark, color=style.colour, markersize=3.5)
    axes.annotate(
        own.feature + ("" if own.inside else "\nextrapolated"),
        (own.x_mm, own.y_mm),
        xytext=(0, -9 - 0.35 * own.radius_mm),
        textcoords="offset points",
        ha="center",
        va="top",
        fontsize=7.5,
    )


def _bars(axes: Axes, features: list[FeatureForecast], values: list[tuple[float, float]]) -> None:
    for row, (own, (mean, std)) in enumerate(zip(features, values, strict=True)):
        axes.errorbar(
            mean,
            row,
            xerr=2 * std,
            fmt="|",
            color=ACCENT if own.inside else OUTSIDE,
            markersize=11,
            markeredgewidth=2.2,
            elinewidth=1.4,
            capsize=3,
        )
