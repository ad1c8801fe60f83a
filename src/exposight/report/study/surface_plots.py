"""Interactive figures of predictions over the sensor's x-y plane: Figs. 12, 24, 25 and 26."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from plotly.subplots import make_subplots

from exposight.report.colours import EXPOSURE_SCALE, P_NORM_SCALE, plotly_scale
from exposight.report.markup import escape, fixed
from exposight.report.plots import Choice, axis, choices, layout, plot
from exposight.report.quantities import axis_title, column_name
from exposight.report.study.surface_stills import SPREAD_SCALE

if TYPE_CHECKING:
    import plotly.graph_objects as go

    from exposight.paper import PredictionSurfaces


_GAP = 0.06


def surfaces_plot(name: str, data: PredictionSurfaces) -> str:
    """Return mean or 2σ, by a menu, for three brightnesses (rows) and depths (columns)."""
    menu = choices(
        name,
        "colours show",
        [Choice(key="mean", title="mean prediction"), Choice(key="spread", title="2σ")],
        "mean",
    )
    return menu + plot(name, _drawing(data), kind="grid")


def _drawing(data: PredictionSurfaces) -> go.Figure:
    rows, columns = len(data.i_avg), len(data.z_mm)
    drawing = make_subplots(
        rows=rows,
        cols=columns,
        shared_xaxes=True,
        shared_yaxes=True,
        horizontal_spacing=0.02,
        vertical_spacing=_GAP,
        column_titles=[f"z = {fixed(depth, 0)} mm" for depth in data.z_mm],
        row_titles=[f"<b>{column_name('i_avg')} = {grey:.0f}</b>" for grey in data.i_avg],
    )
    for row in range(rows):
        for column in range(columns):
            _add_panel(drawing, data, row, column)
    drawing.update_layout(layout(margin={"l": 60, "r": 20, "t": 40, "b": 56}, showlegend=False))
    drawing.update_xaxes(axis("", showgrid=False, range=[data.x_mm[0], data.x_mm[-1]]))
    # y points down in the camera's frame
    drawing.update_yaxes(axis("", showgrid=False, range=[data.y_mm[-1], data.y_mm[0]]))
    drawing.update_xaxes(title_text=axis_title("x_mm"), row=rows)
    drawing.update_yaxes(title_text=axis_title("y_mm"), col=1)
    drawing.for_each_annotation(lambda own: own.update(font={"size": 13}))
    return drawing


def _add_panel(drawing: go.Figure, data: PredictionSurfaces, row: int, column: int) -> None:
    quality = data.target == "p_norm"
    unit = "" if quality else " ms"
    mean, spread = data.mean[row, column], 2 * data.std[row, column]
    rows = len(data.i_avg)
    height = (1 - (rows - 1) * _GAP) / rows
    bar = {
        "len": height,
        "lenmode": "fraction",
        "y": 1 - row * (height + _GAP) - height / 2,
        "x": 1.035,
        "thickness": 12,
        "outlinewidth": 0,
    }
    scale = P_NORM_SCALE if quality else EXPOSURE_SCALE
    low, high = (
        (0.0, 1.0) if quality else (float(data.mean[row].min()), float(data.mean[row].max()))
    )
    widest = float(2 * (data.std.max() if quality else data.std[row].max()))
    named = axis_title(data.target)
    for key, values, colours, limits, title in (
        ("mean", mean, scale, (low, high), named),
        ("spread", spread, SPREAD_SCALE, (0.0, widest), f"2σ of {named}"),
    ):
        drawing.add_heatmap(
            x=data.x_mm.astype(np.float32),
            y=data.y_mm.astype(np.float32),
            z=values.astype(np.float32),
            customdata=(spread if key == "mean" else mean).astype(np.float32),
            colorscale=plotly_scale(colours),
            zmin=limits[0],
            zmax=limits[1],
            zsmooth="best",
            showscale=column == len(data.z_mm) - 1,
            colorbar={**bar, "title": {"text": title, "side": "top"}},
            meta=key,
            visible=key == "mean",
            hovertemplate=_hint(key, unit),
            row=row + 1,
            col=column + 1,
        )
    places = data.trained_mm[column]
    drawing.add_scatter(
        x=places[:, 0].astype(np.float32),
        y=places[:, 1].astype(np.float32),
        mode="markers",
        marker={"color": "white", "size": 4, "line": {"color": "black", "width": 0.6}},
        hoverinfo="skip",
        name=escape("trained"),
        row=row + 1,
        col=column + 1,
    )


def _hint(key: str, unit: str) -> str:
    mean, spread = ("%{z:.4g}", "%{customdata:.2g}")
    if key == "spread":
        mean, spread = ("%{customdata:.4g}", "%{z:.2g}")
    return f"x %{{x:.0f}}, y %{{y:.0f}} mm<br>{mean} ± {spread}{unit} (2σ)<extra></extra>"
