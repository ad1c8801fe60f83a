"""Interactive figures of observations: Figs. 10, 13, 16, 17 and 21."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import plotly.graph_objects as go
from plotly.subplots import make_subplots

from exposight.models import I_AVG_MIN, P_NORM_MIN
from exposight.report.colours import MUTED
from exposight.report.markup import escape, fixed, number
from exposight.report.plots import axis, layout, plot
from exposight.report.quantities import axis_title
from exposight.report.scene import coordinates, scene
from exposight.report.study.palette import feature_order, feature_style, place_styles

if TYPE_CHECKING:
    from exposight.paper import (
        BrightnessCurves,
        ExposureRow,
        ObservedCurve,
        TrainingPositions,
    )


_SYMBOLS_3D = ("circle", "square", "diamond", "cross")  # of the few that plotly has in 3D
_CAMERA = {
    "eye": {"x": -0.8, "y": -1.3, "z": 0.55},
    "center": {"x": 0.0, "y": 0.0, "z": -0.06},
}
_COLUMNS = 2
_GAPS = (0.05, 0.12)  # between panels beside and below each other


def brightness_plot(name: str, data: BrightnessCurves) -> str:
    """Return p_norm over i_avg, a panel for each feature."""
    names = sorted({curve.feature for curve in data.curves}, key=feature_order)
    groups = [[curve for curve in data.curves if curve.feature == own] for own in names]
    rows = -(-len(names) // _COLUMNS)
    drawing = make_subplots(
        rows=rows,
        cols=_COLUMNS,
        shared_xaxes="all",
        shared_yaxes="all",
        horizontal_spacing=_GAPS[0],
        vertical_spacing=_GAPS[1] if rows > 1 else 0.0,
        subplot_titles=[
            f"<b>{escape(own[0].feature)}</b>, radius {own[0].radius_mm:.3g} mm, {len(own)} views"
            for own in groups
        ],
    )
    for place, own in enumerate(groups):
        _add_brightness(drawing, own, row=place // _COLUMNS + 1, column=place % _COLUMNS + 1)
    highest = max(1.0, *(float(curve.p_norm.max()) for curve in data.curves))
    line = {"color": MUTED, "width": 1, "dash": "dot"}
    drawing.add_vline(x=I_AVG_MIN, line=line)
    drawing.add_hline(y=P_NORM_MIN, line={**line, "dash": "dash"})
    drawing.update_layout(layout(showlegend=False, hovermode="closest"))
    drawing.update_xaxes(axis("", range=[0, 258], showticklabels=True))
    drawing.update_yaxes(axis("", range=[-0.04, 1.05 * highest]))
    drawing.update_xaxes(title_text=axis_title("i_avg"), row=rows)
    drawing.update_yaxes(title_text=axis_title("p_norm"), col=1)
    drawing.for_each_annotation(lambda own: own.update(font={"size": 13}))
    return plot(name, drawing, kind="grid" if rows > 1 else "")


def _add_brightness(
    drawing: go.Figure, curves: list[ObservedCurve], *, row: int, column: int
) -> None:
    style = feature_style(curves[0].feature)
    drawing.add_scatter(
        x=_joined([curve.i_avg for curve in curves]),
        y=_joined([curve.p_norm for curve in curves]),
        mode="lines+markers",
        line={"color": style.colour, "width": 0.5},
        marker={"color": style.colour, "symbol": style.symbol, "size": 5},
        opacity=0.8,
        text=_hints(curves),
        hovertemplate="%{text}<br>i<sub>avg</sub> %{x:.1f}, p<sub>norm</sub> %{y:.3f}"
        "<extra></extra>",
        row=row,
        col=column,
    )


def exposure_row_plot(name: str, data: ExposureRow) -> str:
    """Return t_exp over i_avg, a line for each position along x."""
    drawing = go.Figure()
    ordered = sorted(data.curves, key=lambda own: -own.slope_ms)
    for curve, place in zip(ordered, place_styles(len(ordered)), strict=True):
        style = feature_style(curve.feature)
        drawing.add_scatter(
            x=curve.i_avg.astype(np.float32),
            y=curve.exposure_ms.astype(np.float32),
            mode="lines+markers",
            line={"color": style.colour, "dash": place.dash},
            marker={"color": style.colour, "symbol": style.symbol, "size": 7},
            opacity=place.opacity,
            name=f"x = {fixed(curve.x_mm, 0)} mm",
            hovertemplate=f"x = {fixed(curve.x_mm, 0)} mm, {number(curve.slope_ms)} ms per grey "
            "level<br>i<sub>avg</sub> %{x:.1f}, %{y:.4g} ms<extra></extra>",
        )
    drawing.update_layout(
        layout(
            xaxis=axis(axis_title("i_avg"), rangemode="tozero"),
            yaxis=axis(axis_title("exposure_ms"), rangemode="tozero"),
            hovermode="closest",
        )
    )
    return plot(name, drawing)


def positions_plot(name: str, data: TrainingPositions) -> str:
    """Return where the training features stood to the sensor, in 3D."""
    drawing = go.Figure()
    ordered = sorted(data.features, key=lambda own: feature_order(own.feature))
    for index, own in enumerate(ordered):
        drawing.add_scatter3d(
            **coordinates(own.positions_mm.astype(np.float32)),
            mode="markers",
            marker={
                "color": feature_style(own.feature).colour,
                "symbol": _SYMBOLS_3D[index % len(_SYMBOLS_3D)],
                "size": 4,
            },
            name=f"{escape(own.feature)}, {len(own.positions_mm)} views",
            hovertemplate=f"<b>{escape(own.feature)}</b><br>x %{{x:.0f}}, y %{{z:.0f}}, "
            "z %{y:.0f} mm<extra></extra>",
        )
    everywhere = np.concatenate([own.positions_mm for own in ordered])
    drawing.update_layout(
        layout(
            margin={"l": 0, "r": 0, "t": 30, "b": 0},
            scene=scene(everywhere, _CAMERA, depth_ticks=6),
        )
    )
    return plot(name, drawing, kind="tall")


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
