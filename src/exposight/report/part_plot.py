"""The part in 3D as a view sees it, each feature's ring coloured by its quality.

All of it is in the sensor's TCP frame, whose axes are the camera's: x right, y down, z away.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import plotly.graph_objects as go
from markupsafe import escape
from numpy.typing import NDArray

from exposight.geometry import RigidTransform
from exposight.geometry.meshes.triangle_meshes import read_mesh
from exposight.report.figures import Plot, coordinates, layout, scene
from exposight.report.palette import ACCENT, INK, P_NORM_SCALE
from exposight.report.pictures import brighten, on_grid
from exposight.report.shown_view import ShownView

_GREYS = [[0.0, "#5d646c"], [1.0, "#eceef0"]]
_CLOUD_GREYS = [[0.0, "rgb(30,33,38)"], [1.0, "rgb(235,235,235)"]]
_UNLIT = {"ambient": 1.0, "diffuse": 0.0, "specular": 0.0, "fresnel": 0.0}
_LIGHT = np.array([-0.75, -0.65, -1.0])
"""Towards the lamp that shades the part: from the upper left, before it."""
_CONTRAST = 3.0
_CORNERS = 48
_POINTS = 25_000
_STRAY_SHARE = 0.005
"""Share of a cloud's points on each side that is left out: strays on the background."""
_NAMED = 30
"""More features than these are told apart by pointing at them alone."""
_TALL = 1.25
"""How much further away a part is seen that is as high as it is wide."""
_CAMERA = {"eye": {"x": -0.35, "y": -1.15, "z": 0.32}, "center": {"x": 0.0, "y": 0.0, "z": -0.05}}

# Lengths as shares of the largest extent of what is shown.
_BAND = (0.001, 0.013)
"""From and to how far beyond its edge a feature's ring is drawn: wider than it is measured."""
_LIFT = 0.0015
"""How far rings are drawn before the surface, so that it does not cover them."""
_NAMES = 0.04  # how far names stand before the surface: it must not cut them
_LETTER, _LINE, _GAP = 0.011, 0.024, 0.004
"""A letter's width, a line's height, and the gap between a name and its ring, at first."""

Box = tuple[float, float, float, float]


@dataclass(frozen=True, kw_only=True, eq=False)
class PartMesh:
    """A part's surface, to be drawn.

    Parameters
    ----------
    vertices : (n, 3) ndarray, mm
        In the part's frame.
    faces : (m, 3) ndarray of int
        Triangles, anticlockwise seen from outside.
    """

    vertices: NDArray[np.float32]
    faces: NDArray[np.int32]


def read_part_mesh(path: str | Path) -> PartMesh:
    """Read a part's surface in its own frame, as `read_mesh`; STL, PLY and OBJ in mm."""
    mesh = read_mesh(Path(path))
    # STL repeats a vertex in each of its triangles.
    vertices, places = np.unique(mesh.vertices.astype(np.float32), axis=0, return_inverse=True)
    return PartMesh(vertices=vertices, faces=places.ravel()[mesh.faces].astype(np.int32))


def part_plot(view: ShownView, mesh: PartMesh | None, unseen: frozenset[str]) -> Plot:
    """Draw a view's features on the part's mesh, else on the view's own cloud, else alone.

    Parameters
    ----------
    view : ShownView
        What was measured, and what was forecast.
    mesh : PartMesh, optional
        The part; it needs a view with captures, which tell where the part stands.
    unseen : frozenset of str
        Features that no model has seen: their names are bold.
    """
    drawing = go.Figure()
    centres = np.array([pose.translation_mm for pose in view.tcp_from_feature])
    surface = _add_surface(drawing, view, mesh)
    reach = np.concatenate([centres + view.radii_mm[:, None], centres - view.radii_mm[:, None]])
    shown = reach if surface is None else surface
    extent = float(np.ptp(shown, axis=0).max())
    if mesh is not None:
        _add_image_border(drawing, view, float(np.median(centres[:, 2])) - 2 * _LIFT * extent)
    if len(view.features) <= _NAMED:
        _add_names(drawing, view, centres, extent, unseen)
    points, faces = ring_mesh(view.tcp_from_feature, view.radii_mm, extent)
    shown = np.concatenate([shown, points])  # rings are drawn wider than they are
    kinds = {"measured": view.p_norm}
    if view.forecast is not None:
        kinds = {"predicted": view.forecast.taken.p_norm, **kinds}
    first = f"{next(iter(kinds))}-{view.main}"
    for kind, p_norm in kinds.items():
        for index in range(len(view.exposures_ms)):
            hints = _hints(view, index, unseen)
            drawing.add_mesh3d(
                **coordinates(points),
                **_triangles(faces),
                intensity=np.repeat(np.nan_to_num(p_norm[:, index]), 2 * _CORNERS).astype("f4"),
                colorscale=P_NORM_SCALE,
                cmin=0,
                cmax=1,
                showscale=False,
                lighting=_UNLIT,
                text=[text for text in hints for _ in range(2 * _CORNERS)],
                hovertemplate="%{text}<extra></extra>",
                meta=f"{kind}-{index}",
                visible=f"{kind}-{index}" == first,
            )
    drawing.update_layout(
        layout(
            margin={"l": 0, "r": 0, "t": 0, "b": 0},
            scene=scene(shown, _camera(shown)),
        )
    )
    return Plot.of(
        "part",
        drawing,
        menu="colour of the rings",
        choices={
            f"{kind}-{index}": f"{kind} at {exposure_ms:.4g} ms"
            for kind in kinds
            for index, exposure_ms in enumerate(view.exposures_ms)
        },
        chosen=first,
    )


def ring_mesh(
    poses: Sequence[RigidTransform], radii_mm: NDArray[np.float64], extent_mm: float
) -> tuple[NDArray[np.float32], NDArray[np.int32]]:
    """Return flat bands round features: (features · 2 · corners, 3) mm and their triangles."""
    turn = np.linspace(0.0, 2 * np.pi, _CORNERS, endpoint=False)
    circle = np.stack([np.cos(turn), np.sin(turn), np.zeros_like(turn)], axis=1)
    here, after = np.arange(_CORNERS), np.roll(np.arange(_CORNERS), -1)
    quads = np.concatenate(
        [
            np.stack([here, here + _CORNERS, after], axis=1),
            np.stack([after, here + _CORNERS, after + _CORNERS], axis=1),
        ]
    )
    points, faces = [], []
    for index, (pose, radius_mm) in enumerate(zip(poses, radii_mm, strict=True)):
        for beyond in _BAND:
            local = circle * (radius_mm + beyond * extent_mm)
            local[:, 2] = -_LIFT * extent_mm  # a feature's z looks into the material
            points.append(pose.apply(local))
        faces.append(quads + index * 2 * _CORNERS)
    return np.concatenate(points).astype(np.float32), np.concatenate(faces).astype(np.int32)


def shading(vertices: NDArray[np.float32], faces: NDArray[np.int32]) -> NDArray[np.float32]:
    """Return how bright each vertex of a surface is drawn, 0 to 1; mean slope is 0.5."""
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


def _camera(points: NDArray[np.float32]) -> dict[str, dict[str, float]]:
    """Return a camera from which points are seen whole: further away from tall ones."""
    width, height, _ = np.ptp(points, axis=0)
    away = max(1.0, _TALL * float(height / max(width, height)))
    return {**_CAMERA, "eye": {axis: away * place for axis, place in _CAMERA["eye"].items()}}


def _triangles(faces: NDArray[np.int32]) -> dict[str, NDArray[np.int32]]:
    return {"i": faces[:, 0], "j": faces[:, 1], "k": faces[:, 2]}


def _add_surface(
    drawing: go.Figure, view: ShownView, mesh: PartMesh | None
) -> NDArray[np.float32] | None:
    """Draw mesh or cloud in the TCP frame, and return its points."""
    if view.sensor is None:
        return None
    tcp_from_camera = view.sensor.camera_from_tcp.inverse()
    if mesh is not None:
        tcp_from_part = tcp_from_camera @ view.captures[0].camera_from_part
        vertices = tcp_from_part.apply(mesh.vertices).astype(np.float32)
        drawing.add_mesh3d(
            **coordinates(vertices),
            **_triangles(mesh.faces),
            intensity=shading(vertices, mesh.faces),
            colorscale=_GREYS,
            cmin=0,
            cmax=1,
            showscale=False,
            lighting=_UNLIT,
            hoverinfo="skip",
        )
        return vertices
    capture = view.captures[view.main]
    if capture.cloud is None or not capture.cloud.organised or not capture.cloud.valid.any():
        return None
    valid = capture.cloud.valid
    grey = on_grid(brighten(capture.grey_levels()), valid.shape)[valid]
    points = capture.cloud.points[valid]
    low, high = np.quantile(points, [_STRAY_SHARE, 1 - _STRAY_SHARE], axis=0)
    inside = np.flatnonzero(((points >= low) & (points <= high)).all(axis=1))
    inside = inside[:: math.ceil(len(inside) / _POINTS)]
    shown = tcp_from_camera.apply(points[inside]).astype(np.float32)
    drawing.add_scatter3d(
        **coordinates(shown),
        mode="markers",
        marker={
            "size": 2, "color": np.rint(grey[inside]).astype(np.uint8), "colorscale": _CLOUD_GREYS,
            "cmin": 0, "cmax": 255,
        },
        hoverinfo="skip",
        showlegend=False,
    )  # fmt: skip
    return shown


def _add_image_border(drawing: go.Figure, view: ShownView, z_tcp_mm: float) -> None:
    """Draw what the image's border is in a plane before the sensor."""
    if view.sensor is None:
        return
    camera, tcp_from_camera = view.sensor.camera, view.sensor.camera_from_tcp.inverse()
    right, bottom = camera.width - 1.0, camera.height - 1.0
    corners = np.array([[0.0, 0.0], [right, 0.0], [right, bottom], [0.0, bottom], [0.0, 0.0]])
    slopes = np.column_stack([camera.undistort(corners), np.ones(len(corners))])
    rays = slopes @ tcp_from_camera.rotation.T
    origin = tcp_from_camera.translation_mm
    border = origin + rays * ((z_tcp_mm - origin[2]) / rays[:, 2])[:, None]
    drawing.add_scatter3d(
        **coordinates(border.astype(np.float32)),
        mode="lines",
        line={"color": ACCENT, "width": 4},
        hoverinfo="skip",
        showlegend=False,
    )


def _add_names(
    drawing: go.Figure,
    view: ShownView,
    centres: NDArray[np.float64],
    extent: float,
    unseen: frozenset[str],
) -> None:
    radii = view.radii_mm + _BAND[1] * extent
    labels = label_places(view.features, centres[:, :2], radii, extent)
    places = np.array(
        [(x, y, z - _NAMES * extent) for (x, y, _), z in zip(labels, centres[:, 2], strict=True)]
    )
    drawing.add_scatter3d(
        **coordinates(places.astype(np.float32)),
        mode="text",
        text=[feature_title(name, unseen) for name in view.features],
        textposition=[position for _, _, position in labels],
        textfont={"size": 13, "color": INK},
        hoverinfo="skip",
        showlegend=False,
    )


@dataclass(frozen=True, kw_only=True)
class Label:
    """Where a name stands.

    Parameters
    ----------
    x, y : float
        The point at which it is anchored, right and down.
    side : str
        Plotly's word for the side of that point.
    box : (float, float, float, float)
        Left, top, right and bottom of the name.
    covered : float
        Area that it covers of rings and of names placed before.
    """

    x: float
    y: float
    side: str
    box: Box
    covered: float


def label_places(
    names: Sequence[str],
    centres_mm: NDArray[np.float64],
    radii_mm: NDArray[np.float64],
    extent_mm: float,
) -> list[tuple[float, float, str]]:
    """Return where each ring's name covers least of other rings and of names placed before.

    Above is preferred, then below, right and left.

    Returns
    -------
    list of (float, float, str)
        The point at which a name is anchored, right and down, and plotly's word for its side.
    """
    labels = label_boxes(names, centres_mm, radii_mm, extent_mm)
    return [(label.x, label.y, label.side) for label in labels]


def label_boxes(
    names: Sequence[str],
    centres_mm: NDArray[np.float64],
    radii_mm: NDArray[np.float64],
    extent_mm: float,
    *,
    only_free: bool = False,
) -> list[Label]:
    """Return the same as `label_places`, with how much of others each name covers.

    With `only_free` names that cover something are not written, and take no place from later ones.
    """
    gap, letter, line = _GAP * extent_mm, _LETTER * extent_mm, _LINE * extent_mm
    squares = [(x - r, y - r, x + r, y + r) for (x, y), r in zip(centres_mm, radii_mm, strict=True)]
    taken: list[Box] = []
    labels = []
    for index, (name, (x, y), radius) in enumerate(zip(names, centres_mm, radii_mm, strict=True)):
        away, half, height = radius + gap, letter * len(name) / 2, line / 2
        candidates = [
            (x, y - away, "top center", (x - half, y - away - line, x + half, y - away)),
            (x, y + away, "bottom center", (x - half, y + away, x + half, y + away + line)),
            (x + away, y, "middle right", (x + away, y - height, x + away + 2 * half, y + height)),
            (x - away, y, "middle left", (x - away - 2 * half, y - height, x - away, y + height)),
        ]
        others = [*squares[:index], *squares[index + 1 :], *taken]
        covered = [sum(overlap(box, other) for other in others) for *_, box in candidates]
        best = candidates[covered.index(min(covered))]
        labels.append(
            Label(
                x=float(best[0]), y=float(best[1]), side=best[2], box=best[3],
                covered=float(min(covered)),
            )
        )  # fmt: skip
        if not only_free or not min(covered):
            taken.append(best[3])
    return labels


def overlap(one: Box, other: Box) -> float:
    """Return the area that two boxes share."""
    width = min(one[2], other[2]) - max(one[0], other[0])
    height = min(one[3], other[3]) - max(one[1], other[1])
    return max(width, 0.0) * max(height, 0.0)


def feature_title(name: str, unseen: frozenset[str]) -> str:
    """Return a feature's name for plotly's texts, bold where no model has seen it."""
    return f"<b>{escape(name)}</b>" if name in unseen else str(escape(name))


def _hints(view: ShownView, index: int, unseen: frozenset[str]) -> list[str]:
    hints = []
    for i, name in enumerate(view.features):
        lines = [
            f"{feature_title(name, unseen)}, radius {view.radii_mm[i]:.3g} mm",
            f"{view.exposures_ms[index]:.4g} ms",
        ]
        if view.forecast is not None:
            taken = view.forecast.taken
            lines.append(
                f"predicted p<sub>norm</sub> {taken.p_norm[i, index]:.2f} (2σ: "
                f"{taken.p_norm_low[i, index]:.2f} to {taken.p_norm_high[i, index]:.2f})"
            )
        measured = view.p_norm[i, index]
        shown = "–" if np.isnan(measured) else f"{measured:.2f}"
        lines.append(f"measured p<sub>norm</sub> {shown}")
        hints.append("<br>".join(lines))
    return hints
