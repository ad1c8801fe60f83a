"""Small pieces of HTML: escaped text, numbers, names of models, tables, figures."""

from __future__ import annotations

import base64
import html
import math
import re
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Sequence

__all__ = [
    "Heading",
    "count_cell",
    "escape",
    "exact",
    "figure",
    "image_tag",
    "model_name",
    "number",
    "section",
    "table",
]

_MODEL_NAME = re.compile(r"([qe])_k(\d)(?:_(plus|star|lin))?")
_VARIANTS = {"plus": "+", "star": "*", "lin": "lin"}
_NO_VALUE = "–"


@dataclass(frozen=True, kw_only=True)
class Heading:
    """A column's heading, and where needed the one above that it shares with its neighbours.

    Parameters
    ----------
    text : str
        HTML.
    group : str
        HTML; neighbours of the same group share one cell above.
    is_text : bool
        True for columns of words, which are aligned left; numbers are aligned right.
    """

    text: str
    group: str = ""
    is_text: bool = False


def escape(text: str) -> str:
    """Return text that HTML shows as it is, in attributes too."""
    return html.escape(text, quote=True)


def number(value: float | None, digits: int = 3) -> str:
    """Return a number with that many significant digits, a dash where there is none.

    Whole digits before the point are never rounded away: 1234.5 with three digits is 1234.
    """
    if value is None or not math.isfinite(value):
        return _NO_VALUE
    if value == 0:
        return "0"
    exponent = math.floor(math.log10(abs(value)))
    if exponent < -4 or exponent > 6:
        mantissa, power = f"{value:.{digits - 1}e}".split("e")
        return f"{mantissa.replace('-', '−')}·10<sup>{int(power)}</sup>".replace(">-", ">−")
    return f"{value:.{max(0, digits - 1 - exponent)}f}".replace("-", "−")


def exact(value: float | None, shown: str | None = None) -> str:
    """Return a number for people, with its full value for machines.

    Parameters
    ----------
    value : float or None
        The number; a dash is shown where there is none.
    shown : str, optional
        What people see; four significant digits by default.
    """
    if value is None or not math.isfinite(value):
        return _NO_VALUE
    return f'<data value="{value!r}">{number(value, 4) if shown is None else shown}</data>'


def count_cell(value: int) -> str:
    """Return a whole number for people, blanks between its thousands, and for machines."""
    return exact(value, f"{value:,}".replace(",", " "))


def model_name(name: str) -> str:
    """Return a model's name as the paper prints it, in HTML that plotly's texts take, too.

    Unknown names stay as they are.
    """
    found = _MODEL_NAME.fullmatch(name)
    if found is None:
        return escape(name)
    target, dimensions, variant = found.groups()
    above = f"<sup>{_VARIANTS[variant]}</sup>" if variant else ""
    return f"<sup>{target}</sup><i>k</i><sub>{dimensions}</sub>{above}"


def section(number_: int, title: str, body: str) -> str:
    """Return a numbered section; its address on the page is ``s`` and the number."""
    return (
        f'<section id="s{number_}">\n<h2><span class="no">{number_}</span> {escape(title)}</h2>\n'
        f"{body}\n</section>\n"
    )


def figure(number_: int, content: str, caption: str, legend: str = "") -> str:
    """Return a figure with its number and a caption, which is HTML."""
    return (
        f'<figure id="fig{number_}">\n{content}\n{legend}'
        f"<figcaption><b>Figure {number_}.</b> {caption}</figcaption>\n</figure>\n"
    )


def image_tag(data: bytes, media_type: str, alternative: str, size: tuple[int, int]) -> str:
    """Return an image that carries its own bytes.

    Parameters
    ----------
    data : bytes
        The image file.
    media_type : str
        For instance ``image/png``.
    alternative : str
        What is said in its place.
    size : (int, int)
        Width and height in px.
    """
    address = f"data:{media_type};base64,{base64.b64encode(data).decode()}"
    return f'<img src="{address}" alt="{escape(alternative)}" width="{size[0]}" height="{size[1]}">'


def table(
    headings: Sequence[Heading], rows: Sequence[Sequence[str]], *, name: str, caption: str
) -> str:
    """Return a table that scrolls sideways where it is wider than the page.

    Parameters
    ----------
    headings : sequence of Heading
        One for each column.
    rows : sequence of sequences of str
        Cells, HTML; the first of each row names it.
    name : str
        The table's id.
    caption : str
        HTML.
    """
    head = "".join(
        f'<th scope="col"{_alignment(heading)}>{heading.text}</th>' for heading in headings
    )
    body = "\n".join(f"<tr>{_cells(headings, row)}</tr>" for row in rows)
    return (
        f'<p class="caption" id="{name}-caption">{caption}</p>\n'
        f'<div class="wide" role="region" tabindex="0" aria-labelledby="{name}-caption">'
        f'<table id="{name}" aria-labelledby="{name}-caption">\n'
        f"<thead>{_groups(headings)}<tr>{head}</tr></thead>\n<tbody>\n{body}\n</tbody>\n"
        "</table></div>\n"
    )


def _alignment(heading: Heading) -> str:
    return ' class="words"' if heading.is_text else ""


def _groups(headings: Sequence[Heading]) -> str:
    if not any(heading.group for heading in headings):
        return ""
    runs: list[tuple[str, int]] = []
    for heading in headings:
        if runs and runs[-1][0] == heading.group:
            runs[-1] = (heading.group, runs[-1][1] + 1)
        else:
            runs.append((heading.group, 1))
    cells = "".join(
        f'<th scope="colgroup" colspan="{width}" class="group">{text}</th>'
        if text
        else f'<td colspan="{width}"></td>'
        for text, width in runs
    )
    return f"<tr>{cells}</tr>"


def _cells(headings: Sequence[Heading], row: Sequence[str]) -> str:
    first, *others = row
    cells = [f'<th scope="row">{first}</th>']
    for heading, cell in zip(headings[1:], others, strict=True):
        cells.append(f"<td{_alignment(heading)}>{cell}</td>")
    return "".join(cells)
