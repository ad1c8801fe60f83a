"""p_norm over brightness: every observation, and what the one-dimensional quality model learnt."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import plotly.graph_objects as go

from exposight.models import I_AVG_MIN
from exposight.report.colours import ACCENT, BAND, EXPOSURE_SCALE, plotly_scale
from exposight.report.markup import escape, figure, model_name, number
from exposight.report.plots import axis, layout, plot
from exposight.report.selection import exposures_ms, named_result

if TYPE_CHECKING:
    from typing import Any

    from exposight.demo import DemoResult
    from exposight.models import GaussianProcessModel
    from exposight.observing import ObservationTable


_MODEL = "q_k1"
_GRID = np.linspace(0.0, 255.0, 511)
"""Grey levels at which the model is drawn."""
_COLOUR_TICKS = 6


def quality_figure(number_: int, result: DemoResult) -> str:
    """Return the figure of p_norm over i_avg."""
    model = named_result(result, _MODEL)
    drawing = go.Figure()
    if model is not None:
        _add_band(drawing, model.model)
    _add_observations(drawing, result)
    if model is not None:
        _add_mean(drawing, model.model)
    drawing.update_layout(
        layout(
            xaxis=axis("<i>i</i><sub>avg</sub> (grey level 0–255)", range=[0, 258]),
            yaxis=axis("<i>p</i><sub>norm</sub> (1)", rangemode="tozero"),
        )
    )
    told = (
        f" The line is the mean of {model_name(_MODEL)}, which knows nothing but brightness, and "
        "the band its ±2σ for a new observation; below a grey level of "
        f"{I_AVG_MIN:g} it says 0 by design, and that <i>p</i><sub>norm</sub> ends at 0 and about "
        "1 it does not know, so the band goes beyond."
        if model is not None
        else ""
    )
    caption = (
        "All observations: see that quality is poor where a ring is dark, good over a broad "
        f"middle, and lost again where its brightest pixels clip.{told} Click a legend entry "
        "to hide it."
    )
    return figure(number_, plot("quality", drawing), caption)


def _add_band(drawing: go.Figure, model: GaussianProcessModel) -> None:
    prediction = model.predict(i_avg=_GRID)
    edge = {"x": _GRID, "mode": "lines", "line": {"width": 0}, "hoverinfo": "skip"}
    low, high = prediction.mean - 2 * prediction.std, prediction.mean + 2 * prediction.std
    drawing.add_scatter(**edge, y=high, showlegend=False, legendgroup="band")
    drawing.add_scatter(
        **edge,
        y=low,
        fill="tonexty",
        fillcolor=BAND,
        name=f"{model_name(_MODEL)} ± 2σ",
        legendgroup="band",
    )


def _add_mean(drawing: go.Figure, model: GaussianProcessModel) -> None:
    drawing.add_scatter(
        x=_GRID,
        y=model.predict(i_avg=_GRID).mean,
        mode="lines",
        line={"color": ACCENT, "width": 3},
        name=f"{model_name(_MODEL)} mean",
        hovertemplate="predicted %{y:.3f} at %{x:.1f}<extra></extra>",
    )


def _add_observations(drawing: go.Figure, result: DemoResult) -> None:
    table = result.table.measured()
    trains = np.array([name in result.train_features for name in table.names("feature")])
    colours = _colours(exposures_ms(result))
    for mask, title, symbol in (
        (trains, "features that trained", "circle"),
        (~trains, "unseen features", "diamond"),
    ):
        marker = {**colours, "symbol": symbol, "showscale": symbol == "circle"}
        _add_rows(drawing, table.where(mask), title, marker)


def _add_rows(
    drawing: go.Figure, rows: ObservationTable, title: str, marker: dict[str, Any]
) -> None:
    values = rows.array(["i_avg", "p_norm", "exposure_ms"])
    drawing.add_scatter(
        x=values[:, 0],
        y=values[:, 1],
        mode="markers",
        marker={"color": np.log10(values[:, 2]), **marker},
        name=title,
        text=[escape(name) for name in rows.names("feature")],
        customdata=values[:, 2],
        hovertemplate=(
            "<b>%{text}</b>, %{customdata:.4g} ms<br>p<sub>norm</sub> %{y:.3f}<br>"
            "i<sub>avg</sub> %{x:.1f}<extra></extra>"
        ),
    )


def _colours(exposures: tuple[float, ...]) -> dict[str, Any]:
    every = max(1, -(-len(exposures) // _COLOUR_TICKS))
    ticks = exposures[::every]
    return {
        "size": 5,
        "opacity": 0.7,
        "colorscale": plotly_scale(EXPOSURE_SCALE),
        "cmin": float(np.log10(exposures[0])),
        "cmax": float(np.log10(exposures[-1])),
        "colorbar": {
            "title": {"text": "exposure time (ms)", "side": "right"},
            "tickvals": np.log10(ticks),
            "ticktext": [number(own, 2) for own in ticks],
            "thickness": 12,
            "outlinewidth": 0,
        },
    }
