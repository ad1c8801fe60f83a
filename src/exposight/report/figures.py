"""Figures of a page: their style, and how they reach the page.

Interactive ones are plotly's: their data as JSON, which one inlined script draws. Stills are
matplotlib's, and the same bytes every time.
"""

from __future__ import annotations

import io
import json
import re
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Final

import matplotlib as mpl
import plotly.graph_objects as go
from jinja2.utils import htmlsafe_json_dumps
from markupsafe import Markup
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine
from numpy.typing import NDArray

from exposight.report.palette import ACCENT, GRID, INK, MUTED

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
        "xaxis": scene_axis("x (mm)", x),
        "yaxis": scene_axis("z (mm), depth", z, ticks=2),
        "zaxis": scene_axis("y (mm), down", y[::-1]),
        "aspectmode": "manual",
        "aspectratio": {"x": size[0] / longest, "y": size[2] / longest, "z": size[1] / longest},
        "camera": camera,
        "dragmode": "turntable",
    }


def scene_axis(title: str, limits: list[float], ticks: int = 6) -> dict[str, Any]:
    """Return an axis of a scene, from the first limit to the second, with so many ticks at most."""
    return {
        "title": {"text": title},
        "range": limits,
        "nticks": ticks,
        "showbackground": False,
        "gridcolor": GRID,
        "zeroline": False,
        "showspikes": False,
    }


_DPI = 200
_SVG_DPI = 160
"""Only of surfaces and crowds of marks, which are pixels in a vector picture, too."""
_IDENTIFIERS = re.compile(r'(?<=\bid=")|(?<=href="#)|(?<=url\(#)')
_LEFT_OUT = re.compile(r"<metadata>.*?</metadata>|<style.*?</style>", re.DOTALL)
"""Names of formats, and a style that would hold for the whole page; page.css has its own."""
_STYLE: Final[dict[Any, Any]] = {
    "font.family": "DejaVu Sans",  # comes with matplotlib, so letters are the same everywhere
    "font.size": 9.0,
    "axes.titlesize": 9.0,
    "axes.labelsize": 9.0,
    "axes.labelcolor": INK,
    "axes.edgecolor": MUTED,
    "axes.linewidth": 0.8,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.axisbelow": True,
    "grid.color": GRID,
    "grid.linewidth": 0.8,
    "xtick.color": MUTED,
    "ytick.color": MUTED,
    "xtick.labelcolor": INK,
    "ytick.labelcolor": INK,
    "text.color": INK,
    "legend.frameon": False,
    "legend.fontsize": 8.0,
    "lines.linewidth": 1.4,
    "mathtext.fontset": "dejavusans",
    "axes.unicode_minus": True,
    "svg.fonttype": "path",
    "svg.hashsalt": "exposight",
}


@dataclass(frozen=True, kw_only=True, eq=False)
class Still:
    """A picture in two formats.

    Parameters
    ----------
    name : str
        Its id on a page.
    title : str
        What it shows, for who cannot see it.
    png, svg : bytes
        The files.
    width_in : float
        Width in inches.
    """

    name: str
    title: str
    png: bytes
    svg: bytes
    width_in: float

    def inline(self) -> Markup:
        """Return the picture as an element of a page, its identifiers made the page's only ones."""
        text = _LEFT_OUT.sub("", self.svg.decode())
        body = _IDENTIFIERS.sub(f"{self.name}-", text[text.index(">", text.index("<svg")) + 1 :])
        box = re.findall(r'viewBox="([^"]*)"', text)[0]
        return Markup(
            '<svg role="img" aria-label="{}" viewBox="{}" style="max-width:{}rem">{}'
        ).format(self.title, box, round(7 * self.width_in, 2), Markup(body))


def draw_still(
    name: str, title: str, size_in: tuple[float, float], draw: Callable[[Figure], None]
) -> Still:
    """Draw a picture in the page's style, independent of the caller's matplotlib settings.

    Parameters
    ----------
    name : str
        Its id on a page.
    title : str
        What it shows, for who cannot see it.
    size_in : (float, float)
        Width and height in inches.
    draw : callable
        Fills the figure it is given.
    """
    with mpl.rc_context():
        mpl.rcdefaults()
        mpl.rcParams.update(_STYLE)
        layout = ConstrainedLayoutEngine(w_pad=0.08, h_pad=0.06)
        figure = Figure(figsize=size_in, layout=layout)
        FigureCanvasAgg(figure)
        draw(figure)
        # Panels of equal scale need a second look at their labels; then the layout stands.
        layout.execute(figure)
        layout.execute(figure)
        figure.set_layout_engine(None)
        # No date and no program in the files: the same picture is the same bytes.
        png, svg = io.BytesIO(), io.BytesIO()
        figure.savefig(png, format="png", dpi=_DPI, metadata={"Software": None})
        figure.savefig(svg, format="svg", dpi=_SVG_DPI, metadata={"Date": None, "Creator": None})
    return Still(
        name=name, title=title, png=png.getvalue(), svg=svg.getvalue(), width_in=size_in[0]
    )


def plain_axes(axes: Axes, x: str, y: str) -> None:
    """Label both axes and draw a grid."""
    axes.set_xlabel(x)
    axes.set_ylabel(y)
    axes.grid(visible=True)


def label_panel(axes: Axes, text: str) -> None:
    """Put a panel's name above it, at its left."""
    axes.set_title(text, loc="left", color=ACCENT, fontweight="bold")
