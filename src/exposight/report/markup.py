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


_MODEL_NAME = re.compile(r"([qe])_k(\d)(?:_(plusplus|plus|star|lin))?(_s2)?")
_VARIANTS = {None: "", "plus": "+", "plusplus": "++", "star": "*", "lin": "lin"}
_NO_VALUE = "–"
_PLAIN_NUMBER = re.compile(r'(<data value="[^"]*")>([+−]?[\d\s]+(?:\.(\d+))?)</data>')
_SCRIPT = re.compile(r"(<script.*?</script>)", re.DOTALL)
_BEFORE_UNIT = re.compile(r"(?<=\d) (?=(?:%|ms|mm|px)(?!\w))|(?<=</data>) (?=(?:%|ms|mm|px)(?!\w))")


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


def fixed(value: float | None, digits: int, *, signed: bool = False) -> str:
    """Return a number with that many decimals, a dash where there is none; 0 is never negative.

    Parameters
    ----------
    value : float or None
        The number.
    digits : int
        Decimals.
    signed : bool
        True for a plus before positive numbers.
    """
    if value is None or not math.isfinite(value):
        return _NO_VALUE
    sign = "+" if signed else ""
    return f"{round(float(value), digits) + 0.0:{sign}.{digits}f}".replace("-", "−")


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


def with_unit(shown: str, unit: str) -> str:
    """Return a number, HTML, followed by its unit: after a space, but for degrees (SI brochure)."""
    if not unit:
        return shown
    return f"{shown}{'' if unit == '°' else ' '}{escape(unit)}"


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
    target, dimensions, variant, stereo = found.groups()
    above = _VARIANTS[variant] + ("s₂" if stereo else "")
    raised = f"<sup>{above}</sup>" if above else ""
    return f"<sup>{target}</sup><i>k</i><sub>{dimensions}</sub>{raised}"


def model_code(name: str) -> str:
    """Return a model's name as the paper prints it, and as files and commands write it."""
    return f"{model_name(name)} <code>{escape(name)}</code>"


def section(number_: int, title: str, body: str) -> str:
    """Return a numbered section; its address on the page is ``s`` and the number.

    No line breaks between a number and its unit.
    """
    parts = _SCRIPT.split(body)
    parts[::2] = [_BEFORE_UNIT.sub("\u00a0", own) for own in parts[::2]]
    return (
        f'<section id="s{number_}">\n<h2><span class="no">{number_}</span> {escape(title)}</h2>\n'
        f"{''.join(parts)}\n</section>\n"
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

    The decimal points of a column stand below each other, however many digits follow them.

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
    body = "\n".join(f"<tr>{_cells(headings, row)}</tr>" for row in _lined_up(headings, rows))
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


def _lined_up(
    headings: Sequence[Heading], rows: Sequence[Sequence[str]]
) -> Sequence[Sequence[str]]:
    """Give the numbers of each column what they lack to the most decimals, for the eye alone."""
    if not rows:
        return rows
    columns = [
        column if heading.is_text else _padded(column)
        for heading, column in zip(headings, zip(*rows, strict=True), strict=True)
    ]
    return list(zip(*columns, strict=True))


def _padded(cells: tuple[str, ...]) -> tuple[str, ...]:
    numbers = [_PLAIN_NUMBER.fullmatch(cell) for cell in cells]
    decimals = [len(own[3] or "") if own else 0 for own in numbers]
    padded = []
    for cell, found, own in zip(cells, numbers, decimals, strict=True):
        pad = ("" if own else ".") + "0" * (max(decimals) - own)
        if own == max(decimals) or not (found or cell == _NO_VALUE):
            padded.append(cell)
        elif found:
            padded.append(f'{found[1]} data-pad="{pad}">{found[2]}</data>')
        else:
            padded.append(f'<span data-pad="{pad}">{cell}</span>')
    return tuple(padded)
