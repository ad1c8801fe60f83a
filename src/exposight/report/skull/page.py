"""The page of the demonstration on the recorded skull."""

from __future__ import annotations

from typing import TYPE_CHECKING

from exposight.errors import CloudError, InputError
from exposight.report.markup import escape, number
from exposight.report.page import Section, facts, html_page, versions
from exposight.report.prediction_figure import prediction_figure
from exposight.report.quality_figure import quality_figure
from exposight.report.skull.cloud import cloud_figure
from exposight.report.skull.images import ring_figure, sweep_figure
from exposight.report.skull.summary import skull_summary
from exposight.report.skull.table import decoding_table
from exposight.report.tables import hyperparameter_table, score_tables

if TYPE_CHECKING:
    from exposight.demo import SkullResult


_TITLE = "A recorded skull: point-cloud quality and exposure time, predicted"
_LEAD = "Demonstration of exposight on a structured-light recording of a skull."


def skull_report(result: SkullResult) -> str:
    """Return the report of the demonstration on the skull as one self-contained HTML page.

    It only formats and draws what the result holds: the same result gives the same page.

    Parameters
    ----------
    result : SkullResult
        What `exposight.demo.run_skull` found.

    Raises
    ------
    CloudError
        If the cloud is not organised like the image.
    InputError
        If the result has no capture of the sweep, or no model.
    """
    _check(result)
    sections = (
        Section(title="Summary", body=skull_summary(result)),
        Section(title="What the camera saw", body=ring_figure(1, result) + sweep_figure(2, result)),
        Section(title="The cloud in 3D", body=cloud_figure(3, result)),
        Section(title="Quality over brightness", body=quality_figure(4, result)),
        Section(
            title="Predictions for unseen features",
            body=f'<div class="pair">{prediction_figure(5, result, "p_norm")}'
            f"{prediction_figure(6, result, 'exposure_ms')}</div>",
        ),
        Section(
            title="Numbers",
            body=decoding_table(result) + score_tables(result) + hyperparameter_table(result),
        ),
        Section(title="Settings, versions, sources", body=_settings(result)),
    )
    return html_page(_TITLE, _LEAD, sections)


def _check(result: SkullResult) -> None:
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


def _settings(result: SkullResult) -> str:
    settings, camera = result.settings, result.sensor.camera
    exposures = ", ".join(number(own, 4) for own in settings.exposures_ms())
    told = (
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
        versions(),
    )
    return (
        facts(told)
        + "<p>To repeat it, with the recording’s folder in place of <code>FOLDER</code>:</p>\n"
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
