"""Pages: Jinja2 templates with autoescape, made into one HTML file that needs no other file.

Templates lie in ``templates``. What they are given is computed before: a template chooses, orders
and words. Text is escaped unless it is `markupsafe.Markup`.
"""

import itertools
import math
import platform
import re
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import scipy
from jinja2 import Environment, FileSystemLoader, StrictUndefined
from markupsafe import Markup, escape
from plotly.offline import get_plotlyjs

from exposight import __version__
from exposight.planning import DEFAULT_MODELS
from exposight.quantities import QUANTITIES, quantity
from exposight.tables import NO_VALUE, count, number

_TEMPLATES = Path(__file__).parent / "templates"
_MODEL_NAME = re.compile(r"([qe])_k(\d)(?:_(plusplus|plus|star|lin))?(_s2)?")
_VARIANTS = {None: "", "plus": "+", "plusplus": "++", "star": "*", "lin": "lin"}
_COLUMN = re.compile(rf"\b(?:{'|'.join(QUANTITIES)})\b")
_SCRIPT_OR_PICTURE = re.compile(r"(<script.*?</script>|<svg.*?</svg>)", re.DOTALL)
_BEFORE_UNIT = re.compile(r"(?<=\d) (?=(?:%|ms|mm|px)(?!\w))|(?<=</data>) (?=(?:%|ms|mm|px)(?!\w))")


@dataclass(frozen=True)
class Number:
    """A number for people, with its full value for machines; a dash where there is none.

    Parameters
    ----------
    value : float, int or None
        The number.
    shown : str
        What people see; Markup for powers of ten.
    """

    value: float | None
    shown: str

    def __html__(self) -> Markup:
        """Return the number as HTML; templates and Markup call this."""
        if self.value is None:
            return escape(self.shown)
        return Markup('<data value="{}">{}</data>').format(repr(self.value), self.shown)

    def __str__(self) -> str:
        return str(self.shown)


def significant(value: float | None, digits: int = 3, *, factor: float = 1.0) -> Number:
    """Return a number that is shown with that many significant digits.

    Whole digits before the point are never rounded away: 1234.5 with three digits is 1234.

    Parameters
    ----------
    value : float or None
        The number; None, infinity and NaN are a dash.
    digits : int
        Significant digits.
    factor : float
        The number is shown times this, such as 100 for a share in percent.
    """
    if value is None or not math.isfinite(value):
        return Number(None, NO_VALUE)
    value, shown = float(value), factor * float(value)
    if shown == 0:
        return Number(value, "0")
    exponent = math.floor(math.log10(abs(shown)))
    if exponent < -4 or exponent > 6:
        mantissa, power = f"{shown:.{digits - 1}e}".replace("-", "−").split("e")
        power = str(int(power.replace("−", "-"))).replace("-", "−")
        return Number(value, Markup("{}·10<sup>{}</sup>").format(mantissa, power))
    return Number(value, f"{shown:.{max(0, digits - 1 - exponent)}f}".replace("-", "−"))


def rounded(
    value: float | None, decimals: int, *, factor: float = 1.0, signed: bool = False
) -> Number:
    """Return a number that is shown with that many decimals; 0 is never negative.

    Parameters
    ----------
    value : float or None
        The number; None, infinity and NaN are a dash.
    decimals : int
        Decimals.
    factor : float
        The number is shown times this.
    signed : bool
        True for a plus before positive numbers.
    """
    if value is None or not math.isfinite(value):
        return Number(None, NO_VALUE)
    shown = round(factor * float(value), decimals) + 0.0
    return Number(float(value), f"{shown:{'+' if signed else ''}.{decimals}f}".replace("-", "−"))


def whole(value: int | None) -> Number:
    """Return a whole number, blanks between its thousands."""
    return Number(None, NO_VALUE) if value is None else Number(int(value), count(int(value)))


def model_name(name: str) -> Markup:
    """Return a model's name as the paper prints it, in HTML that plotly's texts take, too.

    The default models' names are set in italics; unknown ones stay as they are. Of models one after
    the other, ``q_k1+e_k6``, each is written so.
    """
    if name in DEFAULT_MODELS:
        return Markup("<i>{}</i>").format(name)
    if "+" in name:
        return Markup(" + ").join(map(model_name, name.split("+")))
    parts = _MODEL_NAME.fullmatch(name)
    if parts is None:
        return escape(name)
    target, dimensions, variant, stereo = parts.groups()
    above = _VARIANTS[variant] + ("s₂" if stereo else "")
    raised = Markup("<sup>{}</sup>").format(above) if above else ""
    return Markup("<sup>{}</sup><i>k</i><sub>{}</sub>{}").format(target, dimensions, raised)


def parameter_symbol(kind: str, inputs: Sequence[str]) -> Markup:
    """Return a hyperparameter's symbol with the inputs that it acts on.

    Parameters
    ----------
    kind : str
        What it measures, see `exposight.models.Hyperparameter`.
    inputs : sequence of str
        Columns; a variance without any is the noise's.
    """
    if kind == "variance":
        return Markup("σ²") if inputs else Markup("σ²<sub>n</sub>")
    of = Markup("({})").format(Markup(", ").join(Markup(quantity(name).html) for name in inputs))
    letter = {"length_scale": "ℓ", "slope_variance": "σ²", "alpha": "α"}.get(kind, kind)
    return escape(letter) + (of if inputs and kind != "alpha" else "")


def prose(text: str) -> Markup:
    """Return a plain sentence with typographic apostrophes and symbols in place of columns."""
    return Markup(_COLUMN.sub(lambda name: quantity(name[0]).html, escape(text.replace("'", "’"))))


def render_page(template: str, *, title: str, lead: str, **content: Any) -> str:
    """Return a self-contained page.

    Parameters
    ----------
    template : str
        The template of the page's sections.
    title : str
        What the browser's tab and the page's head say.
    lead : str
        What the page is about, in a sentence.
    **content
        What the template shows.
    """
    environment = Environment(
        loader=FileSystemLoader(_TEMPLATES),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    environment.filters |= {
        "significant": significant, "rounded": rounded, "whole": whole, "model": model_name,
        "prose": prose, "symbol": lambda name: Markup(quantity(name).html),
        "quantity": quantity, "parameter": parameter_symbol, "unbroken": _unbroken,
        "number": number,
    }  # fmt: skip
    sections: list[str] = []
    environment.globals |= {
        "sections": sections, "next_figure": partial(next, itertools.count(1)),
        "versions": f"exposight {__version__}, numpy {np.__version__}, scipy {scipy.__version__}, "
        f"Python {platform.python_version()}",
    }  # fmt: skip
    body = environment.get_template(template).render(**content)
    interactive = '<div class="plot' in body
    return environment.get_template("page.html").render(
        title=title,
        lead=lead,
        body=Markup(body),
        style=_raw("page.css"),
        script=_raw("page.js"),
        interactive=interactive,
        plotly=Markup(get_plotlyjs().replace("</script", r"<\/script")) if interactive else "",
        version=__version__,
    )


def _raw(name: str) -> Markup:
    return Markup((_TEMPLATES / name).read_text(encoding="utf-8"))


def _unbroken(body: Markup) -> Markup:
    """Keep numbers and their units on one line."""
    parts = _SCRIPT_OR_PICTURE.split(str(body))
    parts[::2] = [_BEFORE_UNIT.sub("\u00a0", text) for text in parts[::2]]
    return Markup("".join(parts))
