"""The cloud in 3D; a slider colours each ring by its p_norm at one of the sweep's exposures."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import plotly.graph_objects as go

from exposight.report.colours import P_NORM_SCALE, plotly_scale
from exposight.report.images import brighten, p_norm_legend
from exposight.report.markup import escape, figure, number
from exposight.report.plots import data_block, layout, plot
from exposight.report.scene import coordinates, scene
from exposight.report.selection import exposures_ms
from exposight.report.skull.selection import (
    nominal_capture,
    object_crop,
    ring_values,
    sample_cloud,
    visible_views,
)

if TYPE_CHECKING:
    from typing import Any

    from numpy.typing import NDArray

    from exposight.demo import SkullResult
    from exposight.report.skull.selection import Sample


_NAME = "cloud"
_POINTS = 25_000
_NO_RING = -1
_VALUE_DIGITS = 4
_CAMERA = {
    "eye": {"x": -0.25, "y": -1.5, "z": 0.05},
    "center": {"x": 0, "y": 0, "z": -0.08},
}
_GREYS = [[0.0, "rgb(30,33,38)"], [1.0, "rgb(235,235,235)"]]


def cloud_figure(number_: int, result: SkullResult) -> str:
    """Return the figure of the cloud with its slider."""
    crop = object_crop(result)
    sample = sample_cloud(result, crop, _POINTS)
    rings = ring_of_points(result, sample)
    caption = (
        f"The cloud at the nominal {number(nominal_capture(result).exposure_ms)} ms in the "
        f"camera’s frame, every {_nth(sample.step)}row and column, strays left out; the rings at "
        "the slider’s exposure: move it to see each take the colour of its "
        "<i>p</i><sub>norm</sub> there; surfaces that are best at short exposures are the first "
        "to be lost at long ones. "
        "Drag to turn; point at a ring for its numbers."
    )
    content = (
        _slider(result)
        + plot(_NAME, _drawing(result, sample, rings), kind="tall")
        + data_block(f"{_NAME}-rings", _ring_data(result, rings))
    )
    return figure(number_, content, caption, p_norm_legend())


def ring_of_points(result: SkullResult, sample: Sample) -> NDArray[np.int64]:
    """Tell which feature's ring each sampled point lies in.

    Returns
    -------
    (n,) ndarray of int
        Index into `visible_views`, the later one where rings overlap; -1 outside all rings.
    """
    rings = np.full(result.cloud.valid.shape, _NO_RING, dtype=np.int64)
    for index, view in enumerate(visible_views(result)):
        rings[view.rows, view.columns] = index
    return np.asarray(rings[sample.rows, sample.columns])


def _slider(result: SkullResult) -> str:
    exposures = exposures_ms(result)
    start = exposures.index(_first_shown_ms(result))
    return (
        f'<p class="control"><label for="{_NAME}-slider">exposure time</label> '
        f'<input type="range" id="{_NAME}-slider" min="0" max="{len(exposures) - 1}" step="1" '
        f'value="{start}" autocomplete="off"> <output id="{_NAME}-exposure"></output></p>\n'
    )


def _first_shown_ms(result: SkullResult) -> float:
    """Return the exposure time shown at first: the sweep's dark capture, where features differ."""
    exposures, dark_ms = exposures_ms(result), result.sweep[0].exposure_ms
    return dark_ms if dark_ms in exposures else exposures[0]


def _ring_data(result: SkullResult, rings: NDArray[np.int64]) -> dict[str, Any]:
    """Return what recolouring needs: values by exposure and feature, and each point's feature."""
    names = [view.feature.name for view in visible_views(result)]
    exposures = exposures_ms(result)
    nominal_ms = nominal_capture(result).exposure_ms
    return {
        "names": [escape(name) for name in names],
        "labels": [
            f"{number(own)} ms, {'recorded' if own == nominal_ms else 'emulated'}"
            for own in exposures
        ],
        "p_norm": [_values(result, own, "p_norm", names) for own in exposures],
        "i_avg": [_values(result, own, "i_avg", names) for own in exposures],
        "feature": rings[rings != _NO_RING].tolist(),
    }


def _values(
    result: SkullResult, exposure_ms: float, column: str, names: list[str]
) -> list[float | None]:
    values = ring_values(result, exposure_ms, column)
    return [round(values[name], _VALUE_DIGITS) if name in values else None for name in names]


def _drawing(result: SkullResult, sample: Sample, rings: NDArray[np.int64]) -> go.Figure:
    points = result.cloud.points[sample.rows, sample.columns]
    capture = nominal_capture(result)
    grey = np.rint(brighten(capture.grey_levels()[sample.rows, sample.columns])).astype(np.uint8)
    in_ring = rings != _NO_RING
    plain, ringed = points[~in_ring], points[in_ring]
    drawing = go.Figure()
    drawing.add_scatter3d(
        **coordinates(plain),
        mode="markers",
        marker={
            "size": 2, "color": grey[~in_ring], "colorscale": _GREYS, "cmin": 0, "cmax": 255,
        },
        hoverinfo="skip",
        showlegend=False,
    )  # fmt: skip
    drawing.add_scatter3d(
        **coordinates(ringed),
        mode="markers",
        marker={
            "size": 2.2, "colorscale": plotly_scale(P_NORM_SCALE), "cmin": 0, "cmax": 1,
            "color": _first_colours(result, rings[in_ring]),
        },
        hovertemplate="%{text}<extra></extra>",
        showlegend=False,
    )  # fmt: skip
    drawing.update_layout(
        layout(margin={"l": 0, "r": 0, "t": 0, "b": 0}, scene=scene(points, _CAMERA))
    )
    return drawing


def _first_colours(result: SkullResult, rings: NDArray[np.int64]) -> NDArray[np.float32]:
    names = [view.feature.name for view in visible_views(result)]
    values = _values(result, _first_shown_ms(result), "p_norm", names)
    return np.array(values, dtype=np.float32)[rings]  # None becomes NaN


def _nth(step: int) -> str:
    return {1: "", 2: "second ", 3: "third "}.get(step, f"{step}th ")
