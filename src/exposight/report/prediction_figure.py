"""Predicted over observed on the features that no model has seen, one menu for each target."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import plotly.graph_objects as go

from exposight.models import I_AVG_MIN
from exposight.report.colours import ACCENT, MUTED, OUTSIDE, rgb
from exposight.report.markup import escape, figure, number
from exposight.report.plots import Choice, axis, choices, layout, plot
from exposight.report.selection import model_results

if TYPE_CHECKING:
    from exposight.demo import DemoResult, ModelResult
    from exposight.models import Evaluation


@dataclass(frozen=True, kw_only=True)
class _Target:
    """How a target is drawn."""

    quantity: str
    unit: str
    preferred: str
    label: str
    told: str


_TARGETS = {
    "p_norm": _Target(
        quantity="<i>p</i><sub>norm</sub>",
        unit="1",
        preferred="q_k4",
        label="quality model",
        told="quality: see how near the points are to the diagonal; the row at 0 is of rings "
        f"darker than a grey level of {I_AVG_MIN:g}, where these models say 0 by design",
    ),
    "exposure_ms": _Target(
        quantity="exposure time",
        unit="ms",
        preferred="e_k6",
        label="exposure-time model",
        told="exposure time: see how well the exposure that gave a ring its brightness is found, "
        "and that the spread grows with the exposure",
    ),
}


def prediction_figure(number_: int, result: DemoResult, target: str) -> str:
    """Return the figure of one target, empty if no model predicts it.

    Parameters
    ----------
    number_ : int
        The figure's number.
    result : DemoResult
        What is drawn.
    target : {"p_norm", "exposure_ms"}
        The target.
    """
    results = model_results(result, target)
    if not results:
        return ""
    style = _TARGETS[target]
    names = [own.model.name for own in results]
    chosen = style.preferred if style.preferred in names else names[-1]
    place = f"predicted-{target}"
    menu = choices(
        place,
        style.label,
        [Choice(key=name, title=_title(own)) for name, own in zip(names, results, strict=True)],
        chosen,
    )
    caption = (
        f"Predicted over observed {style.told}. Bars are ±2σ for a new observation; orange "
        "diamonds lie outside the range of the training inputs, where a model extrapolates."
    )
    return figure(number_, menu + plot(place, _drawing(results, style, chosen)), caption)


def _title(result: ModelResult) -> str:
    specification = result.model.specification
    return f"{specification.name} – {specification.title}"


def _drawing(results: tuple[ModelResult, ...], style: _Target, chosen: str) -> go.Figure:
    drawing = go.Figure()
    low, high = _range(results)
    drawing.add_scatter(
        x=[low, high],
        y=[low, high],
        mode="lines",
        line={"color": MUTED, "width": 1, "dash": "dash"},
        name="predicted = observed",
        hoverinfo="skip",
    )
    for own in results:
        name = own.model.name
        for inside in (True, False):
            _add_points(drawing, own.unseen, style, name, inside=inside, shown=name == chosen)
    drawing.update_layout(
        layout(
            xaxis=axis(f"observed {style.quantity} ({style.unit})"),
            yaxis=axis(f"predicted {style.quantity} ({style.unit})"),
        )
    )
    return drawing


def _range(results: tuple[ModelResult, ...]) -> tuple[float, float]:
    observed = np.concatenate([own.unseen.observed for own in results])
    return min(0.0, float(observed.min())), float(observed.max()) * 1.02


def _add_points(
    drawing: go.Figure,
    evaluation: Evaluation,
    style: _Target,
    name: str,
    *,
    inside: bool,
    shown: bool,
) -> None:
    prediction = evaluation.prediction
    mask = prediction.inside == inside
    if not mask.any():
        return
    features = evaluation.table.names("feature")[mask]
    exposures = evaluation.table.array(["exposure_ms"])[mask, 0]
    colour = ACCENT if inside else OUTSIDE
    drawing.add_scatter(
        x=evaluation.observed[mask].astype(np.float32),
        y=prediction.mean[mask].astype(np.float32),
        error_y={
            "array": (2 * prediction.std[mask]).astype(np.float32),
            "thickness": 0.8,
            "width": 0,
            "color": _thinned(colour),
        },
        mode="markers",
        marker={"color": colour, "size": 5, "symbol": "circle" if inside else "diamond-open"},
        name="inside range" if inside else "outside",
        text=[
            f"{escape(feature)}, {number(float(exposure), 4)} ms"
            for feature, exposure in zip(features, exposures, strict=True)
        ],
        hovertemplate=(
            "<b>%{text}</b><br>observed %{x:.4g} "
            f"{_unit(style)}<br>predicted %{{y:.4g}} ± %{{error_y.array:.2g}} {_unit(style)}"
            "<extra></extra>"
        ),
        meta=name,
        visible=shown,
    )


def _unit(style: _Target) -> str:
    return "" if style.unit == "1" else style.unit


def _thinned(colour: str) -> str:
    red, green, blue = rgb(colour)
    return f"rgba({red},{green},{blue},0.2)"
