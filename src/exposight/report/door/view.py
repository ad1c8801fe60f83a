"""The new view in numbers: how its exposure time was chosen, and what came of the forecast."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import plotly.graph_objects as go

from exposight.demo import EXPOSURE_MODEL, QUALITY_MODEL
from exposight.planning import WANTED_I_AVG
from exposight.report.colours import ACCENT, INK, MUTED
from exposight.report.door.words import EXPOSURE_WORDS, exposure_title, feature_title
from exposight.report.markup import Heading, escape, exact, figure, fixed, model_name, number, table
from exposight.report.plots import axis, layout, plot

if TYPE_CHECKING:
    from exposight.demo import DoorResult, NewView


_THIN = "rgba(11, 100, 119, 0.35)"
_BAR = "rgba(11, 100, 119, 0.45)"
_GAP = 0.03


def choice_figure(number_: int, result: DoorResult) -> str:
    """Return the figure of predicted quality over exposure time, and what was measured."""
    view = result.new_view
    caption = (
        f"Forecast before anything was taken. {model_name(EXPOSURE_MODEL)} says at which "
        f"exposure time each feature reaches a grey level of {WANTED_I_AVG:g}; brightness is "
        f"proportional to exposure time until pixels clip; {model_name(QUALITY_MODEL)} says which "
        "quality to expect at that brightness, averaged over how uncertain it is. Thin: each "
        "feature (dotted where no model has seen it). Thick: their mean, whose highest point is "
        f"the chosen {number(view.chosen_ms)} ms. Diamonds: the mean that was measured afterwards. "
        "The forecast is flatter than the truth because it averages over its own doubt."
    )
    return figure(number_, plot("choice", _choice_drawing(result)), caption)


def _choice_drawing(result: DoorResult) -> go.Figure:
    view = result.new_view
    drawing = go.Figure()
    for name, p_norm in zip(view.choice.features, view.choice.p_norm, strict=True):
        known = name in result.train_features
        drawing.add_scatter(
            x=view.choice.exposures_ms,
            y=p_norm.astype(np.float32),
            mode="lines",
            line={"color": _THIN, "width": 1.4, "dash": "solid" if known else "dot"},
            name=feature_title(result, name),
            hovertemplate="%{y:.2f} at %{x:.4g} ms",
            showlegend=False,
        )
    drawing.add_scatter(
        x=view.choice.exposures_ms,
        y=view.choice.p_norm.mean(axis=0),
        mode="lines",
        line={"color": ACCENT, "width": 3.5},
        name="predicted, mean over features",
        hovertemplate="%{y:.3f} at %{x:.4g} ms",
    )
    drawing.add_scatter(
        x=view.taken.exposures_ms,
        y=view.p_norm.mean(axis=0),
        mode="markers",
        marker={"color": INK, "size": 11, "symbol": "diamond"},
        name="measured, mean over features",
        hovertemplate="%{y:.3f} at %{x:.4g} ms",
    )
    drawing.add_vline(x=view.chosen_ms, line={"color": MUTED, "width": 1, "dash": "dash"})
    ticks = [1, 2, 5, 10, 20, 50, 100, 200, 500, 1000]
    drawing.update_layout(
        layout(
            xaxis=axis("exposure time (ms)", type="log", tickvals=ticks, ticktext=ticks),
            yaxis=axis("<i>p</i><sub>norm</sub> (1)", range=[-0.05, 1.1]),
        )
    )
    return drawing


def forecast_figure(number_: int, result: DoorResult) -> str:
    """Return the figure of predicted and measured p_norm of each feature."""
    score = result.new_view.score
    within = round((score.coverage_2sigma or 0.0) * score.n)
    caption = (
        "Each feature of the new view at the three exposure times: predicted with ±2σ, and "
        f"measured. {within} of {score.n} measured values lie in their band. Bold: features that "
        "no model has seen. The bands are wide where the brightness that a feature will have "
        "decides between a good cloud and none."
    )
    return figure(number_, plot("forecast", _forecast_drawing(result)), caption)


def _forecast_drawing(result: DoorResult) -> go.Figure:
    view = result.new_view
    names = [feature_title(result, name) for name in view.taken.features]
    drawing = go.Figure()
    panels = len(view.captures)
    width = (1 - _GAP * (panels - 1)) / panels
    settings = {}
    for index in range(panels):
        place = "" if index == 0 else str(index + 1)
        _add_panel(drawing, view, names, index, f"x{place}")
        start = index * (width + _GAP)
        settings[f"xaxis{place}"] = axis(
            f"<i>p</i><sub>norm</sub> (1)<br>at {exposure_title(view, index)}",
            domain=[start, start + width],
            range=[-0.7, 1.7],
            tickvals=[0, 0.5, 1],
        )
    settings["yaxis"] = axis("", autorange="reversed", ticks="", dtick=1)
    drawing.update_layout(layout(**settings))
    return drawing


def _add_panel(
    drawing: go.Figure, view: NewView, names: list[str], index: int, axis_name: str
) -> None:
    drawing.add_scatter(
        x=view.taken.p_norm[:, index],
        y=names,
        error_x={
            "array": 2 * view.taken.p_norm_std[:, index],
            "thickness": 5,
            "width": 0,
            "color": _BAR,
        },
        mode="markers",
        marker={"color": ACCENT, "size": 9},
        name="predicted ± 2σ",
        hovertemplate="predicted %{x:.2f} ± %{error_x.array:.2f}<extra>%{y}</extra>",
        xaxis=axis_name,
        legendgroup="predicted",
        showlegend=index == 0,
    )
    drawing.add_scatter(
        x=view.p_norm[:, index],
        y=names,
        mode="markers",
        marker={"color": INK, "size": 9, "symbol": "diamond"},
        name="measured",
        hovertemplate="measured %{x:.2f}<extra>%{y}</extra>",
        xaxis=axis_name,
        legendgroup="measured",
        showlegend=index == 0,
    )


def forecast_table(result: DoorResult) -> str:
    """Return the table of predicted and measured values of the new view."""
    view = result.new_view
    reaches = f"reaches grey level {WANTED_I_AVG:g}"
    headings = [
        Heading(text="feature"),
        Heading(text="trained", is_text=True),
        Heading(text="radius, mm"),
        Heading(text="at, ms", group=reaches),
        Heading(text="± 2σ, ms", group=reaches),
    ]
    for index in range(len(view.captures)):
        group = f"<i>p</i><sub>norm</sub> at {exposure_title(view, index)}"
        headings += [Heading(text=text, group=group) for text in ("predicted", "± 2σ", "measured")]
    chosen = f"<i>i</i><sub>avg</sub> at {exposure_title(view, EXPOSURE_WORDS.index('chosen'))}"
    headings += [Heading(text=text, group=chosen) for text in ("predicted", "measured")]
    rows = [_row(result, i) for i in range(len(view.views))]
    caption = (
        f"<b>The new view, feature by feature.</b> Predicted by {model_name(QUALITY_MODEL)} and "
        f"{model_name(EXPOSURE_MODEL)} before the view was taken."
    )
    return table(headings, rows, name="new-view", caption=caption)


def _row(result: DoorResult, i: int) -> list[str]:
    view, taken = result.new_view, result.new_view.taken
    seen = view.views[i]
    radius_mm = seen.feature.radius_mm
    cells = [
        escape(seen.feature.name),
        "yes" if seen.feature.name in result.train_features else "no",
        exact(radius_mm, fixed(radius_mm, 1)),
        exact(float(taken.wanted.mean[i]), fixed(taken.wanted.mean[i], 0)),
        exact(2 * float(taken.wanted.std[i]), fixed(2 * taken.wanted.std[i], 0)),
    ]
    for index in range(len(view.captures)):
        shares = taken.p_norm[i, index], 2 * taken.p_norm_std[i, index], view.p_norm[i, index]
        cells += [exact(float(own), fixed(own, 2)) for own in shares]
    chosen = EXPOSURE_WORDS.index("chosen")
    for i_avg in (taken.i_avg[i, chosen], view.i_avg[i, chosen]):
        cells.append(exact(float(i_avg), fixed(i_avg, 0)))
    return cells
