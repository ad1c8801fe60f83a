"""The shell of every report: one HTML file that needs neither network nor other files."""

from __future__ import annotations

import platform
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import scipy
from plotly.offline import get_plotlyjs

from exposight.files.durable import write_durably
from exposight.report.markup import escape, section
from exposight.version import __version__

if TYPE_CHECKING:
    from collections.abc import Iterable


# The browser itself refuses to load anything: the page cannot come to need a network unnoticed.
_POLICY = (
    "default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; img-src data: blob:"
)


@dataclass(frozen=True, kw_only=True)
class Section:
    """A section of a page: its title, and its body as HTML."""

    title: str
    body: str


def html_page(title: str, lead: str, sections: tuple[Section, ...]) -> str:
    """Return a self-contained page.

    Parameters
    ----------
    title : str
        What the browser's tab and the page's head say.
    lead : str
        What the page is about, in a sentence.
    sections : tuple of Section
        In their order.
    """
    numbered = list(enumerate(sections, start=1))
    links = "".join(
        f'<a href="#s{number_}">{number_} {escape(own.title)}</a>' for number_, own in numbered
    )
    body = "".join(section(number_, own.title, own.body) for number_, own in numbered)
    return (
        '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        f'<meta http-equiv="Content-Security-Policy" content="{_POLICY}">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        '<meta name="color-scheme" content="light dark">\n'
        f"<title>{escape(title)}</title>\n<style>\n{_resource('page.css')}</style>\n</head>\n<body>\n"
        f'<div class="page">\n<header>\n<h1>{escape(title)}</h1>\n'
        f"<p>{escape(lead)}</p>\n"
        f"<nav>{links}</nav>\n"
        "<noscript><p>The interactive figures need JavaScript; pictures and tables do not.</p>"
        f"</noscript>\n</header>\n<main>\n{body}</main>\n"
        f"<footer>Made by exposight {escape(__version__)}. This page loads nothing from anywhere."
        "</footer>\n</div>\n"
        f"<script>{_plotly_script()}</script>\n<script>\n{_resource('page.js')}</script>\n"
        "</body>\n</html>\n"
    )


def write_report(path: str | Path, page: str) -> None:
    """Write a report durably.

    Parameters
    ----------
    path : path
        The HTML file; its folder must exist, an older file is replaced.
    page : str
        The report.

    Raises
    ------
    FileError
        If it cannot be written; an older file then stays whole.
    """
    write_durably(Path(path), page.encode())


def facts(items: Iterable[tuple[str, str]]) -> str:
    """Return names and their values, both HTML, below each other."""
    rows = "".join(f"<dt>{name}</dt><dd>{text}</dd>" for name, text in items)
    return f'<dl class="facts">{rows}</dl>\n'


def versions() -> tuple[str, str]:
    """Return the versions of what the results rest on, as a fact."""
    return (
        "versions",
        f"exposight {escape(__version__)}, numpy {escape(np.__version__)}, "
        f"scipy {escape(scipy.__version__)}, Python {escape(platform.python_version())}",
    )


def _plotly_script() -> str:
    return str(get_plotlyjs()).replace("</script", r"<\/script")


def _resource(name: str) -> str:
    return files("exposight.report").joinpath(name).read_text(encoding="utf-8")
