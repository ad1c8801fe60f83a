"""Interactive figures of observations: Figs. 10, 13, 16, 17 and 21."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import plotly.graph_objects as go

from exposight.models import I_AVG_MIN, P_NORM_MIN
from exposight.report.colours import GRID, MUTED
from exposight.report.markup import escape, number
from exposight.report.plots import axis, layout, plot
from exposight.report.study.palette import feature_order, feature_style
from exposight.report.study.stills import signed
from exposight.report.study.words import column_name

if TYPE_CHECKING:
    from exposight.paper.figure_data import (
        BrightnessCurves,
        ExposureRow,
        ObservedCurve,
        TrainingPositions,
    )

__all__ = ["brightness_plot", "exposure_row_plot", "positions_plot"]

_GREY = f"{column_name('i_avg')} (grey level 0–255)"
_SYMBOLS_3D = ("circle", "square", "diamond", "cross")  # of the few that plotly has in 3D
_DASHES = ("solid", "dash", "dashdot", "dot")


def brightness_plot(name: str, data: BrightnessCurves) -> str:
    """Return p_norm over i_avg, a colour and mark for each feature."""
    drawing = go.Figure()
    for feature in sorted({curve.feature for curve in data.curves}, key=feature_order):
        curves = [curve for curve in data.curves if curve.feature == feature]
        style = feature_style(feature)
        drawing.add_scatter(
            x=_joined([curve.i_avg for curve in curves]),
            y=_joined([curve.p_norm for curve in curves]),
            mode="lines+markers",
            line={"color": style.colour, "width": 0.5},
            marker={"color": style.colour, "symbol": style.symbol, "size": 5},
            opacity=0.8,
            name=f"{escape(feature)}, radius {curves[0].radius_mm:.3g} mm",
            text=_hints(curves),
            hovertemplate="%{text}<br>i<sub>avg</sub> %{x:.1f}, "
            "p<sub>norm</sub> %{y:.3f}<extra></extra>",
        )
    line = {"color": MUTED, "width": 1, "dash": "dot"}
    drawing.add_vline(x=I_AVG_MIN, line=line)
    drawing.add_hline(y=P_NORM_MIN, line={**line, "dash": "dash"})
    drawing.update_layout(
        layout(
            xaxis=axis(_GREY, range=[0, 258]),
            yaxis=axis(f"{column_name('p_norm')} (1)", rangemode="tozero"),
            hovermode="closest",
        )
    )
    return plot(name, drawing)


def exposure_row_plot(name: str, data: ExposureRow) -> str:
    """Return t_exp over i_avg, a line for each position along x."""
    drawing = go.Figure()
    ordered = sorted(data.curves, key=lambda own: -own.slope_ms)
    for index, curve in enumerate(ordered):
        style = feature_style(curve.feature)
        drawing.add_scatter(
            x=curve.i_avg.astype(np.float32),
            y=curve.exposure_ms.astype(np.float32),
            mode="lines+markers",
            line={"color": style.colour, "dash": _DASHES[index % len(_DASHES)]},
            marker={"color": style.colour, "symbol": style.symbol, "size": 7},
            opacity=1.0 - 0.7 * index / max(1, len(ordered)),
            name=f"x = {signed(curve.x_mm)} mm",
            hovertemplate=f"x = {signed(curve.x_mm)} mm, {number(curve.slope_ms)} ms per grey level"
            "<br>i<sub>avg</sub> %{x:.1f}, %{y:.4g} ms<extra></extra>",
        )
    drawing.update_layout(
        layout(
            xaxis=axis(_GREY, rangemode="tozero"),
            yaxis=axis(f"{column_name('exposure_ms')} (ms)", rangemode="tozero"),
            hovermode="closest",
        )
    )
    return plot(name, drawing)


def positions_plot(name: str, data: TrainingPositions) -> str:
    """Return where the training features stood to the sensor, in 3D."""
    drawing = go.Figure()
    ordered = sorted(data.features, key=lambda own: feature_order(own.feature))
    for index, own in enumerate(ordered):
        x, y, z = own.positions_mm.T.astype(np.float32)
        drawing.add_scatter3d(
            x=x,
            y=z,
            z=-y,
            customdata=y,
            mode="markers",
            marker={
                "color": feature_style(own.feature).colour,
                "symbol": _SYMBOLS_3D[index % len(_SYMBOLS_3D)],
                "size": 4,
            },
            name=f"{escape(own.feature)}, {len(x)} views",
            hovertemplate=f"<b>{escape(own.feature)}</b><br>x %{{x:.0f}}, y %{{customdata:.0f}}, "
            "z %{y:.0f} mm<extra></extra>",
        )
    drawing.update_layout(
        layout(
            margin={"l": 0, "r": 0, "t": 30, "b": 0},
            scene={
                "xaxis": _axis_3d("x (mm)"),
                "yaxis": _axis_3d("z (mm)"),
                "zaxis": _axis_3d("−y (mm)"),
                "aspectmode": "data",
                "camera": {
                    "eye": {"x": -1.1, "y": -1.8, "z": 0.9},
                    "center": {"x": 0.0, "y": 0.0, "z": -0.2},
                },
            },
        )
    )
    return plot(name, drawing, kind="tall")


def _axis_3d(title: str) -> dict[str, Any]:
    return {"title": {"text": title}, "gridcolor": GRID, "backgroundcolor": "white"}


def _joined(parts: list[Any]) -> list[float | None]:
    """Return all parts in one list with a gap after each, so that no line joins two views."""
    joined: list[float | None] = []
    for part in parts:
        joined += [round(float(value), 4) for value in part]
        joined.append(None)
    return joined


def _hints(curves: list[ObservedCurve]) -> list[str]:
    hints = []
    for curve in curves:
        place = (
            f"<b>{escape(curve.feature)}</b>, x {curve.x_mm:.0f}, y {curve.y_mm:.0f}, "
            f"z {curve.z_mm:.0f} mm"
        )
        hints += [f"{place}, {exposure:.4g} ms" for exposure in curve.exposure_ms]
        hints.append("")
    return hints
