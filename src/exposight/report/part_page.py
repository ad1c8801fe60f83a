"""The page of a part from CAD: its mesh in 3D, and the features that were found on it."""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import plotly.graph_objects as go
from markupsafe import escape
from numpy.typing import NDArray

from exposight.cell import Feature, Part
from exposight.files import write_durably
from exposight.report.figures import Plot, layout
from exposight.report.palette import ACCENT, GRID, INK
from exposight.report.rendering import render_page
from exposight.tables import counted

_MOST_TRIANGLES = 60_000
"""More would make the page slow; the drawing alone is thinned."""

_NAMED = 60
_STEPS = 48
_GREY = "#c3c9cf"
_LIGHTING = {"ambient": 0.5, "diffuse": 0.7, "specular": 0.1, "roughness": 0.9, "fresnel": 0.0}


def write_part_page(
    path: Path,
    part: Part,
    vertices: NDArray[np.float64],
    faces: NDArray[np.int32],
    rows: Sequence[dict[str, Any]],
    notes: Sequence[str] = (),
) -> None:
    """Write the page: one file that opens without a network.

    Parameters
    ----------
    path : Path
        What is there is replaced.
    part : Part
        Its features are drawn.
    vertices : (n, 3) ndarray, mm
    faces : (m, 3) ndarray of int32
        The part's mesh.
    rows : sequence of dict
        The table of features.
    notes : sequence of str
        What was mended, and what was left out.

    Raises
    ------
    FileError
        If the disk refuses.
    """
    shown_vertices, shown_faces = thinned(vertices, faces, _MOST_TRIANGLES)
    size = np.ptp(vertices, axis=0)
    page = render_page(
        "part.html",
        title=part.name,
        lead=f"{counted(len(part.features), 'feature')} on a part of "
        f"{' × '.join(f'{extent:.4g}' for extent in size)} mm, "
        f"{counted(len(faces), 'triangle')}.",
        drawing=_drawing(part.features, shown_vertices, shown_faces),
        thinned=len(shown_faces) < len(faces),
        rows=rows,
        notes=notes,
        facts=(),
    )
    write_durably(path, page.encode())


def thinned(
    vertices: NDArray[np.float64], faces: NDArray[np.int32], most: int
) -> tuple[NDArray[np.float32], NDArray[np.int32]]:
    """Return a mesh of at most so many triangles: vertices in one cell of a grid become one."""
    if len(faces) <= most:
        return vertices.astype(np.float32), faces
    low = vertices.min(axis=0)
    extent = float(np.ptp(vertices, axis=0).max())
    n_cells = math.ceil(math.sqrt(most / 2))
    while True:
        cells = ((vertices - low) * (n_cells / extent)).astype(np.int64)
        keys = (cells[:, 0] * (n_cells + 1) + cells[:, 1]) * (n_cells + 1) + cells[:, 2]
        _, first, number = np.unique(keys, return_index=True, return_inverse=True)
        joined = number.ravel()[faces]
        a, b, c = joined.T
        joined = joined[(a != b) & (b != c) & (c != a)]
        _, kept = np.unique(np.sort(joined, axis=1), axis=0, return_index=True)
        if len(kept) <= most:
            return vertices[first].astype(np.float32), joined[np.sort(kept)].astype(np.int32)
        n_cells = math.floor(n_cells * 0.8)


def _drawing(
    features: Sequence[Feature], vertices: NDArray[np.float32], faces: NDArray[np.int32]
) -> Plot:
    extent = float(np.ptp(vertices, axis=0).max())
    drawing = go.Figure()
    x, y, z = vertices.T
    i, j, k = faces.T
    drawing.add_mesh3d(
        x=x, y=y, z=z, i=i, j=j, k=k,
        color=_GREY, flatshading=True, lighting=_LIGHTING, hoverinfo="skip",
    )  # fmt: skip
    lines, texts = [], []
    for feature in features:
        line = _outline(feature, extent)
        lines.append(line)
        texts += [_hint(feature)] * len(line)
    x, y, z = np.concatenate(lines).astype(np.float32).T
    drawing.add_scatter3d(
        x=x, y=y, z=z,
        mode="lines",
        line={"color": ACCENT, "width": 5},
        text=texts,
        hovertemplate="%{text}<extra></extra>",
        showlegend=False,
    )  # fmt: skip
    if len(features) <= _NAMED:
        places = [f.part_from_feature.apply([[0.0, 0.0, -0.05 * extent]])[0] for f in features]
        x, y, z = np.array(places, dtype=np.float32).T
        drawing.add_scatter3d(
            x=x, y=y, z=z,
            mode="text",
            text=[str(escape(feature.name)) for feature in features],
            textfont={"size": 12, "color": INK},
            hoverinfo="skip",
            showlegend=False,
        )  # fmt: skip
    axes = {
        f"{name}axis": {"title": {"text": f"{name} (mm)"}, "gridcolor": GRID, "zeroline": False}
        for name in "xyz"
    }
    drawing.update_layout(
        layout(
            margin={"l": 0, "r": 0, "t": 0, "b": 0},
            scene={**axes, "aspectmode": "data", "dragmode": "turntable"},
        )
    )
    return Plot.of("part", drawing)


def _outline(feature: Feature, extent: float) -> NDArray[np.float64]:
    """Return a feature's outline just above the surface, then its normal, then a gap."""
    turn = np.linspace(0.0, 2 * np.pi, _STEPS + 1)
    circle = feature.radius_mm * np.column_stack([np.cos(turn), np.sin(turn)])
    if feature.length_mm is not None and feature.width_mm is not None:
        core = (
            feature.length_mm / 2 - feature.radius_mm,
            feature.width_mm / 2 - feature.radius_mm,
        )
        circle = circle + np.sign(np.round(circle, 9)) * core
    local = np.zeros((_STEPS + 4, 3))
    local[: _STEPS + 1, :2] = circle
    local[: _STEPS + 1, 2] = -0.001 * extent  # a feature's z looks into the material
    local[_STEPS + 1] = np.nan
    local[_STEPS + 3, 2] = -0.04 * extent
    gap = np.full((1, 3), np.nan)
    placed = local @ feature.part_from_feature.rotation.T + feature.part_from_feature.translation_mm
    return np.concatenate([placed, gap])


def _hint(feature: Feature) -> str:
    x, y, z = feature.part_from_feature.translation_mm
    sizes = f"radius {feature.radius_mm:.4g} mm"
    if feature.length_mm is not None and feature.width_mm is not None:
        sizes = f"{feature.length_mm:.4g} × {feature.width_mm:.4g} mm"
    name = str(escape(feature.name))
    return f"{name}, {feature.kind}<br>{sizes}<br>at ({x:.2f}, {y:.2f}, {z:.2f}) mm"
