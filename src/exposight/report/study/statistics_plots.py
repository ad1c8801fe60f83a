"""Interactive figures of dependence and learning: Figs. 20, 22 and 23."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import plotly.graph_objects as go
from plotly.subplots import make_subplots

from exposight.report.colours import ACCENT, INK, plotly_scale
from exposight.report.plots import axis, layout, plot
from exposight.report.quantities import column_name
from exposight.report.study.statistics_stills import DEPENDENCE_SCALE

if TYPE_CHECKING:
    from exposight.paper import DependenceMatrix, LearningCurve


def dependence_plot(name: str, data: DependenceMatrix) -> str:
    """Return the matrix of maximal information coefficients with their values."""
    names = [column_name(own) for own in data.columns]
    drawing = go.Figure()
    drawing.add_heatmap(
        x=names,
        y=names,
        z=np.round(data.values, 4),
        zmin=0,
        zmax=1,
        colorscale=plotly_scale(DEPENDENCE_SCALE),
        texttemplate="%{z:.2f}",
        xgap=1,
        ygap=1,
        colorbar={"title": {"text": "MIC (1)"}, "thickness": 14, "outlinewidth": 0},
        hovertemplate="%{y} and %{x}: %{z:.3f}<extra></extra>",
    )
    drawing.update_layout(
        layout(
            xaxis=axis("", showgrid=False, ticks=""),
            yaxis=axis("", showgrid=False, ticks="", autorange="reversed"),
            margin={"l": 60, "r": 20, "t": 16, "b": 40},
        )
    )
    return plot(name, drawing, kind="square")


def learning_plot(name: str, data: LearningCurve, unit: str) -> str:
    """Return R² and RMSE over the number of training observations.

    Parameters
    ----------
    name : str
        The place's id.
    data : LearningCurve
        The curve.
    unit : {'%', 'ms'}
        Of the RMSE.
    """
    factor = 100.0 if unit == "%" else 1.0
    numbers = [step.n_train for step in data.steps]
    r2 = [step.score.r2_percent for step in data.steps]
    rmse = [factor * step.score.rmse for step in data.steps]
    drawing = make_subplots(rows=1, cols=2, horizontal_spacing=0.1)
    panels = (
        ("R²", "%", r2, ACCENT, "circle"),
        ("RMSE", unit, rmse, INK, "square"),
    )
    for column, (score, its_unit, values, colour, symbol) in enumerate(panels, start=1):
        drawing.add_scatter(
            x=numbers,
            y=values,
            mode="lines+markers",
            line={"color": colour},
            marker={"symbol": symbol, "size": 8},
            hovertemplate=f"%{{x}} observations: {score} %{{y:.4g}} {its_unit}<extra></extra>",
            row=1,
            col=column,
        )
        drawing.update_xaxes(axis("training observations", rangemode="tozero"), row=1, col=column)
        drawing.update_yaxes(axis(f"{score} ({its_unit})"), row=1, col=column)
    drawing.update_yaxes(range=[min(0.0, *r2), 102], row=1, col=1)
    drawing.update_yaxes(range=[0, 1.15 * max(rmse)], row=1, col=2)
    drawing.update_layout(layout(showlegend=False, margin={"l": 60, "r": 20, "t": 16, "b": 56}))
    return plot(name, drawing, kind="low")
