"""The demonstration's page: one HTML file that needs neither network nor other files."""

from __future__ import annotations

import platform
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import scipy
from plotly.offline import get_plotlyjs

from exposight import __version__
from exposight.durable import write_durably
from exposight.errors import CloudError, InputError
from exposight.report.cloud_figure import cloud_figure
from exposight.report.images import ring_figure, sweep_figure
from exposight.report.markup import escape, number, section
from exposight.report.prediction_figure import prediction_figure
from exposight.report.quality_figure import quality_figure
from exposight.report.summary import summary
from exposight.report.tables import decoding_table, hyperparameter_table, score_tables

if TYPE_CHECKING:
    from exposight.demo import DemoResult

__all__ = ["demo_report", "write_demo_report"]

_TITLE = "Point-cloud quality and exposure time, predicted"
_SECTIONS = (
    "Summary",
    "What the camera saw",
    "The cloud in 3D",
    "Quality over brightness",
    "Predictions for unseen features",
    "Numbers",
    "Settings, versions, sources",
)
# The browser itself refuses to load anything: the page cannot come to need a network unnoticed.
_POLICY = (
    "default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; img-src data: blob:"
)


def demo_report(result: DemoResult) -> str:
    """Return the demonstration's report as one self-contained HTML page.

    It only formats and draws what the result holds: the same result gives the same page.

    Parameters
    ----------
    result : DemoResult
        What `exposight.demo.run_demo` found.

    Raises
    ------
    CloudError
        If the cloud is not organised like the image.
    InputError
        If the result has no capture of the sweep, or no model.
    """
    _check(result)
    bodies = (
        summary(result),
        ring_figure(1, result) + sweep_figure(2, result),
        cloud_figure(3, result),
        quality_figure(4, result),
        f'<div class="pair">{prediction_figure(5, result, "p_norm")}'
        f"{prediction_figure(6, result, 'exposure_ms')}</div>",
        decoding_table(result) + score_tables(result) + hyperparameter_table(result),
        _settings(result),
    )
    sections = "".join(
        section(number_, title, body)
        for number_, (title, body) in enumerate(zip(_SECTIONS, bodies, strict=True), start=1)
    )
    return _shell(sections)


def write_demo_report(path: str | Path, result: DemoResult) -> None:
    """Write the demonstration's report durably.

    Parameters
    ----------
    path : path
        The HTML file; its folder must exist, an older file is replaced.
    result : DemoResult
        What `exposight.demo.run_demo` found.

    Raises
    ------
    FileError
        If it cannot be written; an older file then stays whole.
    CloudError, InputError
        As `demo_report`.
    """
    write_durably(Path(path), demo_report(result).encode())


def _check(result: DemoResult) -> None:
    if not result.cloud.organised:
        msg = (
            "a report needs a cloud organised like the camera's image, (rows, columns, 3), got "
            f"shape {result.cloud.points.shape}; see Cloud.organise"
        )
        raise CloudError(msg)
    if not result.sweep or not result.results:
        msg = (
            "a report needs at least one capture of the sweep and one trained model, got "
            f"{len(result.sweep)} captures and {len(result.results)} models"
        )
        raise InputError(msg)


def _shell(sections: str) -> str:
    links = "".join(
        f'<a href="#s{number_}">{number_} {escape(title)}</a>'
        for number_, title in enumerate(_SECTIONS, start=1)
    )
    return (
        '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        f'<meta http-equiv="Content-Security-Policy" content="{_POLICY}">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>{_TITLE}</title>\n<style>\n{_resource('page.css')}</style>\n</head>\n<body>\n"
        f'<div class="page">\n<header>\n<h1>{_TITLE}</h1>\n'
        "<p>Demonstration of exposight on a structured-light recording of a skull.</p>\n"
        f"<nav>{links}</nav>\n"
        "<noscript><p>The interactive figures need JavaScript; pictures and tables do not.</p>"
        f"</noscript>\n</header>\n<main>\n{sections}</main>\n"
        f"<footer>Made by exposight {escape(__version__)}. This page loads nothing from anywhere."
        "</footer>\n</div>\n"
        f"<script>{_plotly_script()}</script>\n<script>\n{_resource('page.js')}</script>\n"
        "</body>\n</html>\n"
    )


def _plotly_script() -> str:
    return str(get_plotlyjs()).replace("</script", r"<\/script")


def _resource(name: str) -> str:
    return files("exposight.report").joinpath(name).read_text(encoding="utf-8")


def _settings(result: DemoResult) -> str:
    settings, camera = result.settings, result.sensor.camera
    exposures = ", ".join(number(own, 4) for own in settings.exposures_ms())
    facts = (
        ("features", f"{settings.features}, of which {len(result.train_features)} trained"),
        ("exposure times", f"{exposures} ms ({settings.steps_per_decade} steps a decade)"),
        ("seed", f"{settings.seed} (places, radii, split, restarts)"),
        ("optimiser", f"{settings.restarts} starts for each model"),
        ("sensor", escape(result.sensor.name)),
        (
            "camera",
            f"{camera.width} × {camera.height} px, focal length {number(camera.fx, 4)} px, TCP "
            f"{number(float(result.sensor.camera_from_tcp.translation_mm[2]), 3)} mm before it",
        ),
        (
            "versions",
            f"exposight {escape(__version__)}, numpy {escape(np.__version__)}, "
            f"scipy {escape(scipy.__version__)}, Python {escape(platform.python_version())}",
        ),
    )
    items = "".join(f"<dt>{name}</dt><dd>{text}</dd>" for name, text in facts)
    return (
        f'<dl class="facts">{items}</dl>\n'
        "<p>To repeat it, with the recording’s folder in place of <code>FOLDER</code>:</p>\n"
        "<pre>exposight demo --data FOLDER</pre>\n"
        "<p>The demonstration’s output folder holds the captures (<code>campaign</code>), every "
        "observation (<code>observations.csv</code>), the features (<code>features.csv</code>) and "
        "the trained models (<code>models</code>).</p>\n"
        "<p>Recording: J. Wilm, O. V. Olesen, R. Larsen, “SLStudio: Open-source framework for "
        "real-time structured light”, IPTA 2014. It belongs to its authors, whose repository is "
        "under GPLv3 or a commercial licence and names no separate one for the data; the pictures "
        "on this page are derived from it. exposight is under Apache-2.0, the inlined plotly.js "
        "under the MIT licence.</p>\n"
    )
