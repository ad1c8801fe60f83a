"""Still pictures: how they look, and how they become the same bytes every time."""

from __future__ import annotations

import io
import re
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

import matplotlib as mpl
from markupsafe import Markup
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine

from exposight.report.palette import ACCENT, GRID, INK, MUTED

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from matplotlib.axes import Axes


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
    with _style():
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


@contextmanager
def _style() -> Iterator[None]:
    with mpl.rc_context():
        mpl.rcdefaults()
        mpl.rcParams.update(_STYLE)
        yield


def plain_axes(axes: Axes, x: str, y: str) -> None:
    """Label both axes and draw a grid."""
    axes.set_xlabel(x)
    axes.set_ylabel(y)
    axes.grid(visible=True)


def label_panel(axes: Axes, text: str) -> None:
    """Put a panel's name above it, at its left."""
    axes.set_title(text, loc="left", color=ACCENT, fontweight="bold")
