"""The door in 3D, each feature's ring coloured by its quality in the new view."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import plotly.graph_objects as go

from exposight.report.colours import ACCENT, INK, P_NORM_SCALE, plotly_scale
from exposight.report.door.labels import Ring, label_places
from exposight.report.door.words import exposure_title, feature_title
from exposight.report.images import p_norm_legend
from exposight.report.markup import figure, fixed, number
from exposight.report.plots import Choice, choices, layout, plot
from exposight.report.scene import coordinates, scene

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from exposight.demo import DoorResult, NewView
    from exposight.geometry import RigidTransform
    from exposight.observing import FeatureView


_NAME = "door"
_GREYS = [[0.0, "#5d646c"], [1.0, "#eceef0"]]
_UNLIT = {"ambient": 1.0, "diffuse": 0.0, "specular": 0.0, "fresnel": 0.0}
_LIGHT = np.array([-0.75, -0.65, -1.0])
"""Towards the lamp that shades the sheet: from the upper left, before it."""
_CONTRAST = 3.0
_BAND_MM = (1.0, 13.0)
"""From and to how far beyond a hole's edge its ring is drawn: wider than it is measured."""
_LIFT_MM = 1.5
"""How far rings are drawn before the sheet, so that it does not cover them."""
_NAMES_MM = 40.0  # how far names stand before the sheet: it must not cut them
_CORNERS = 48
_CHOSEN = 1  # of the three exposure times
_CAMERA = {
    "eye": {"x": -0.35, "y": -1.15, "z": 0.32},
    "center": {"x": 0.0, "y": 0.0, "z": -0.05},
}


def door_figure(number_: int, result: DoorResult) -> str:
    """Return the figure of the door, with a menu of what colours the rings."""
    view = result.new_view
    items = [
        Choice(key=_key(kind, index), title=f"{kind} at {exposure_title(view, index)}")
        for kind in ("predicted", "measured")
        for index in (_CHOSEN, 0, 2)
    ]
    menu = choices(_NAME, "colour of the rings", items, _key("predicted", _CHOSEN))
    caption = (
        "The door’s inside of bare sheet metal, and the rings of the features that the new view "
        "sees, coloured by their <i>p</i><sub>norm</sub> there (drawn wider than the 2 mm in "
        "which points are counted); the line bounds what the camera sees. Features that no model "
        "has seen have bold names. Choose in the menu what colours the rings: at the chosen "
        "exposure time prediction and measurement should look alike, at the shorter one dark "
        "rings lose their points, at the longer one bright ones. Drag to turn; point at a ring "
        "for its numbers."
    )
    content = menu + plot(_NAME, _drawing(result), kind="tall wide-plot")
    return figure(number_, content, caption, p_norm_legend())


def ring_mesh(
    views: tuple[FeatureView, ...], part_from_camera: RigidTransform
) -> tuple[NDArray[np.float32], NDArray[np.int32]]:
    """Return flat bands round the holes: (features · 2 · corners, 3) mm and their triangles."""
    turn = np.linspace(0.0, 2 * np.pi, _CORNERS, endpoint=False)
    circle = np.stack([np.cos(turn), np.sin(turn), np.zeros_like(turn)], axis=1)
    after = np.roll(np.arange(_CORNERS), -1)
    here = np.arange(_CORNERS)
    quads = np.concatenate(
        [
            np.stack([here, here + _CORNERS, after], axis=1),
            np.stack([after, here + _CORNERS, after + _CORNERS], axis=1),
        ]
    )
    points, faces = [], []
    for index, view in enumerate(views):
        part_from_feature = part_from_camera @ view.camera_from_feature
        for beyond_mm in _BAND_MM:
            local = circle * (view.feature.radius_mm + beyond_mm)
            local[:, 2] = -_LIFT_MM  # a feature's z looks into the material
            points.append(part_from_feature.apply(local))
        faces.append(quads + index * 2 * _CORNERS)
    return np.concatenate(points).astype(np.float32), np.concatenate(faces).astype(np.int32)


def shading(vertices: NDArray[np.float32], faces: NDArray[np.int32]) -> NDArray[np.float32]:
    """Return how bright each vertex of a sheet is drawn, 0 to 1; mean slope is 0.5."""
    corners = vertices[faces].astype(np.float64)
    crosses = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals = np.stack(
        [
            np.bincount(faces.ravel(), np.repeat(crosses[:, axis], 3), minlength=len(vertices))
            for axis in range(3)
        ],
        axis=1,
    )
    lengths = np.linalg.norm(normals, axis=1)
    lit = normals @ (_LIGHT / np.linalg.norm(_LIGHT)) / np.maximum(lengths, 1e-12)
    shade = 0.5 + _CONTRAST * (lit - np.median(lit)) / 2
    return np.asarray(np.clip(shade, 0.0, 1.0), dtype=np.float32)


def _key(kind: str, index: int) -> str:
    return f"{kind}-{index}"


def _drawing(result: DoorResult) -> go.Figure:
    view, mesh = result.new_view, result.mesh
    drawing = go.Figure()
    drawing.add_mesh3d(
        **coordinates(mesh.vertices),
        **_triangles(mesh.faces),
        intensity=shading(mesh.vertices, mesh.faces),
        colorscale=_GREYS,
        cmin=0,
        cmax=1,
        showscale=False,
        lighting=_UNLIT,
        hoverinfo="skip",
    )
    border = view.field_of_view_mm - [0.0, 0.0, 2 * _LIFT_MM]
    drawing.add_scatter3d(
        **coordinates(border.astype(np.float32)),
        mode="lines",
        line={"color": ACCENT, "width": 4},
        hoverinfo="skip",
        showlegend=False,
    )
    _add_names(drawing, result)
    part_from_camera = view.captures[_CHOSEN].camera_from_part.inverse()
    points, faces = ring_mesh(view.views, part_from_camera)
    values = {"predicted": view.taken.p_norm, "measured": view.p_norm}
    for kind, p_norm in values.items():
        for index in range(len(view.captures)):
            drawing.add_mesh3d(
                **coordinates(points),
                **_triangles(faces),
                intensity=np.repeat(p_norm[:, index], 2 * _CORNERS).astype(np.float32),
                colorscale=plotly_scale(P_NORM_SCALE),
                cmin=0,
                cmax=1,
                showscale=False,
                lighting=_UNLIT,
                text=[text for text in _hints(result, view, index) for _ in range(2 * _CORNERS)],
                hovertemplate="%{text}<extra></extra>",
                meta=_key(kind, index),
                visible=(kind, index) == ("predicted", _CHOSEN),
            )
    drawing.update_layout(
        layout(
            margin={"l": 0, "r": 0, "t": 0, "b": 0},
            scene=scene(mesh.vertices, _CAMERA, depth_ticks=2),
        )
    )
    return drawing


def _triangles(faces: NDArray[np.int32]) -> dict[str, NDArray[np.int32]]:
    return {"i": faces[:, 0], "j": faces[:, 1], "k": faces[:, 2]}


def _add_names(drawing: go.Figure, result: DoorResult) -> None:
    view = result.new_view
    part_from_camera = view.captures[_CHOSEN].camera_from_part.inverse()
    centres = [
        (part_from_camera @ own.camera_from_feature).translation_mm.tolist() for own in view.views
    ]
    labels = label_places(
        [
            Ring(
                name=own.feature.name,
                x_mm=x,
                y_mm=y,
                radius_mm=own.feature.radius_mm + _BAND_MM[1],
            )
            for own, (x, y, _) in zip(view.views, centres, strict=True)
        ]
    )
    places = np.array(
        [
            (label.x_mm, label.y_mm, z - _NAMES_MM)
            for label, (_, _, z) in zip(labels, centres, strict=True)
        ],
        dtype=np.float32,
    )
    drawing.add_scatter3d(
        **coordinates(places),
        mode="text",
        text=[feature_title(result, own.feature.name) for own in view.views],
        textposition=[label.position for label in labels],
        textfont={"size": 13, "color": INK},
        hoverinfo="skip",
        showlegend=False,
    )


def _hints(result: DoorResult, view: NewView, index: int) -> list[str]:
    taken = view.taken
    return [
        f"{feature_title(result, own.feature.name)}, radius {number(own.feature.radius_mm)} mm"
        f"<br>{exposure_title(view, index)}"
        f"<br>predicted p<sub>norm</sub> {fixed(taken.p_norm[i, index], 3)} ± "
        f"{fixed(2 * taken.p_norm_std[i, index], 2)} (2σ)"
        f"<br>measured p<sub>norm</sub> {fixed(view.p_norm[i, index], 3)}"
        for i, own in enumerate(view.views)
    ]
