"""Interactive figures: their style, and their data as JSON that one inlined script draws."""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from jinja2.utils import htmlsafe_json_dumps

from exposight.report.palette import GRID, INK, MUTED

if TYPE_CHECKING:
    import plotly.graph_objects as go
    from markupsafe import Markup
    from numpy.typing import NDArray

_FONT = 'system-ui, -apple-system, "Segoe UI", Roboto, "Helvetica Neue", Arial, sans-serif'


@dataclass(frozen=True, kw_only=True)
class Plot:
    """An interactive figure.

    Parameters
    ----------
    name : str
        Id of its place.
    json : Markup
        Plotly's data and layout, in which no tag can hide.
    menu : str
        Label of the menu that chooses which traces are shown.
    choices : dict of str to str
        The menu's entries, empty for a figure without a menu: traces whose ``meta`` is the key are
        shown when the title is chosen.
    chosen : str
        Key of the entry that is shown at first.
    """

    name: str
    json: Markup
    menu: str = ""
    choices: dict[str, str] = field(default_factory=dict)
    chosen: str = ""

    @classmethod
    def of(cls, name: str, drawing: go.Figure, **menu: Any) -> Plot:
        """Make a plot of a plotly figure; `menu` holds menu, choices and chosen."""
        return cls(name=name, json=htmlsafe_json_dumps(json.loads(drawing.to_json())), **menu)


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
        "font": {"family": _FONT, "size": 13, "color": INK},
        "paper_bgcolor": "white",
        "plot_bgcolor": "white",
        "margin": {"l": 60, "r": 20, "t": 46, "b": 56},
        "hoverlabel": {"bgcolor": "white", "bordercolor": MUTED, "font": {"family": _FONT}},
        "legend": {"orientation": "h", "x": 0, "y": 1.02, "yanchor": "bottom"},
        "template": "none",
    }
    return {**style, **settings}


def coordinates(points: NDArray[Any]) -> dict[str, NDArray[Any]]:
    """Lay the camera's axes into plotly's, whose z is up: its y is depth, its z the image's v."""
    return {"x": points[:, 0], "y": points[:, 2], "z": points[:, 1]}


def scene(points: NDArray[Any], camera: dict[str, Any]) -> dict[str, Any]:
    """Return a scene that holds (n, 3) points in mm, to scale, its axes with units.

    Parameters
    ----------
    points : (n, 3) ndarray, mm
        x right, y down, z away from the viewer.
    camera : dict
        Plotly's, from where the scene is seen at first.
    """
    low, high = (edge.astype(float).tolist() for edge in (points.min(0), points.max(0)))
    size = [max(top - bottom, 1.0) for bottom, top in zip(low, high, strict=True)]
    x, y, z = ([bottom, bottom + length] for bottom, length in zip(low, size, strict=True))
    longest = max(size)
    return {
        "xaxis": _scene_axis("x (mm)", x),
        "yaxis": _scene_axis("z (mm), depth", z, ticks=2),
        "zaxis": _scene_axis("y (mm), down", y[::-1]),
        "aspectmode": "manual",
        "aspectratio": {"x": size[0] / longest, "y": size[2] / longest, "z": size[1] / longest},
        "camera": camera,
        "dragmode": "turntable",
    }


def _scene_axis(title: str, limits: list[float], ticks: int = 6) -> dict[str, Any]:
    return {
        "title": {"text": title},
        "range": limits,
        "nticks": ticks,
        "showbackground": False,
        "gridcolor": GRID,
        "zeroline": False,
        "showspikes": False,
    }
