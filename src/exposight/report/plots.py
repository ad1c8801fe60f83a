"""How interactive figures are put on the page: their data as JSON, drawn by one inlined script."""

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from exposight.report.colours import GRID, INK, MUTED
from exposight.report.markup import escape

if TYPE_CHECKING:
    from collections.abc import Sequence

    import plotly.graph_objects as go


FONT = 'system-ui, -apple-system, "Segoe UI", Roboto, "Helvetica Neue", Arial, sans-serif'


@dataclass(frozen=True, kw_only=True)
class Choice:
    """One entry of a menu that shows some traces of a figure.

    Parameters
    ----------
    key : str
        Traces whose ``meta`` is this are shown when it is chosen.
    title : str
        What the menu says.
    """

    key: str
    title: str


def axis(title: str, **settings: Any) -> dict[str, Any]:
    """Return an axis of the page's style; settings are plotly's."""
    style = {
        "title": {"text": title, "standoff": 10},
        "gridcolor": GRID,
        "linecolor": MUTED,
        "zeroline": False,
        "ticks": "outside",
        "tickcolor": MUTED,
        "automargin": True,
    }
    return {**style, **settings}


def layout(**settings: Any) -> dict[str, Any]:
    """Return a layout of the page's style; settings are plotly's."""
    style = {
        "font": {"family": FONT, "size": 13, "color": INK},
        "paper_bgcolor": "white",
        "plot_bgcolor": "white",
        "margin": {"l": 60, "r": 20, "t": 46, "b": 56},
        "hoverlabel": {"bgcolor": "white", "bordercolor": MUTED, "font": {"family": FONT}},
        "legend": {"orientation": "h", "x": 0, "y": 1.02, "yanchor": "bottom"},
        "template": "none",
    }
    return {**style, **settings}


def plot(name: str, drawing: go.Figure, *, kind: str = "") -> str:
    """Return the place of an interactive figure, and its data.

    Parameters
    ----------
    name : str
        The place's id.
    drawing : plotly Figure
        What is drawn there.
    kind : str
        Style class that gives its height.
    """
    return (
        f'<div class="plot {kind}" id="{name}"></div>\n'
        f"{data_block(f'{name}-figure', json.loads(drawing.to_json()))}"
    )


def data_block(name: str, data: Any) -> str:
    """Return data that the page's script reads, as JSON in which no tag can hide."""
    text = json.dumps(data, ensure_ascii=False, separators=(",", ":"), allow_nan=False)
    for character in "<>&\u2028\u2029":
        text = text.replace(character, f"\\u{ord(character):04x}")
    return f'<script type="application/json" id="{name}">{text}</script>\n'


def choices(name: str, label: str, items: Sequence[Choice], chosen: str) -> str:
    """Return a menu that chooses which traces the figure `name` shows.

    Parameters
    ----------
    name : str
        Id of the figure's place.
    label : str
        What is chosen.
    items : sequence of Choice
        The entries.
    chosen : str
        Key of the entry that is shown at first.
    """
    options = "".join(
        f'<option value="{escape(item.key)}"{" selected" if item.key == chosen else ""}>'
        f"{escape(item.title)}</option>"
        for item in items
    )
    return (
        f'<p class="control"><label for="{name}-menu">{escape(label)}</label> '
        f'<select id="{name}-menu" data-plot="{name}" autocomplete="off">{options}</select></p>\n'
    )
