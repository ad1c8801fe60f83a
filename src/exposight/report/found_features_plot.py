"""A part from CAD in 3D, in its own frame, with the outlines of what was found on it."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import plotly.graph_objects as go
import trimesh
from markupsafe import escape
from numpy.typing import NDArray

from exposight.cell import Feature
from exposight.report.figures import Plot, layout, scene_axis
from exposight.report.palette import ACCENT, INK
from exposight.report.part_plot import Box, label_boxes, overlap

_STEPS = 48
_GREYS = [[0.0, "#7f8891"], [1.0, "#f1f3f5"]]
_UNLIT = {"ambient": 1.0, "diffuse": 0.0, "specular": 0.0, "fresnel": 0.0}
_LAMP = (-0.5, 0.6)
"""How far right and up of the viewer the lamp stands."""
_SPREAD = 0.22
"""Standard deviation of the grey of what is seen, 0 to 1; gentle curves are drawn stronger."""

_TILT, _MORE_TILT = np.radians(25.0), np.radians(40.0)
"""How far the view leans from the normals: depth is seen, and holes are still round; more where
other features face aside."""
_STEEP = np.radians(40.0)
"""Faces above this elevation are seen from lower, others from higher: z stays up on the screen."""
_ALIKE = np.cos(np.radians(50.0))
"""Normals within this of each other are of one side."""

_FIELD_OF_VIEW = np.pi / 4
"""Plotly's, of the figure's height."""
_FILLED = 0.84
"""Share of the figure that the part fills at most; ticks need the rest, below most of all."""
_BELOW = 0.06
_WIDE, _NARROW = 1.45, 0.8
"""Width of the figure over its height, on a desk and on a phone."""

# Lengths as shares of the part's largest extent.
_LIFT, _NORMAL, _BEFORE = 0.001, 0.035, 0.05
_ROOM = 0.08
"""Around the part, so that nothing before it is cut."""
_LINE_WIDTH, _RING = 5, 0.006
_LARGE = 0.04
"""Features with more radius have their name within."""
_PHONE = 1.5
"""How much larger names are on a phone, beside the part."""


def found_features_plot(
    features: Sequence[Feature], vertices: NDArray[np.float32], faces: NDArray[np.int32]
) -> Plot:
    """Draw a part's mesh and its features, seen from the side that most of them face.

    Parameters
    ----------
    features : sequence of Feature
        At least one.
    vertices : (n, 3) ndarray, mm
    faces : (m, 3) ndarray of int32
    """
    low, high = vertices.min(axis=0).astype(float), vertices.max(axis=0).astype(float)
    extent = float((high - low).max())
    away = viewing_direction(np.array([-f.part_from_feature.z_axis for f in features]))
    drawing = go.Figure()
    x, y, z = vertices.T
    i, j, k = faces.T
    drawing.add_mesh3d(
        x=x, y=y, z=z, i=i, j=j, k=k,
        intensity=face_greys(vertices, faces, away), intensitymode="cell",
        colorscale=_GREYS, cmin=0, cmax=1, showscale=False, lighting=_UNLIT, hoverinfo="skip",
    )  # fmt: skip
    _add_outlines(drawing, features, extent)
    in_sight = _in_sight(features, vertices, faces, away)
    on_phone = _add_names(drawing, features, extent, away, in_sight)
    size = high - low + 2 * _ROOM * extent
    shown = vertices[np.linspace(0, len(vertices) - 1, min(len(vertices), 5000)).astype(int)]
    camera, further = _camera((shown - (low + high) / 2) / extent, away)
    drawing.update_layout(
        layout(
            margin={"l": 0, "r": 0, "t": 0, "b": 0},
            scene={
                **{
                    f"{name}axis": scene_axis(
                        f"{name} (mm)",
                        [centre - length / 2, centre + length / 2],
                        ticks=6 if length > 0.3 * extent else 2,
                    )
                    for name, centre, length in zip("xyz", (low + high) / 2, size, strict=True)
                },
                "aspectmode": "manual",
                "aspectratio": dict(zip("xyz", (size / extent).tolist(), strict=True)),
                "camera": camera,
                "dragmode": "turntable",
            },
            meta={"further": further, "names": on_phone},
        )
    )
    return Plot.of("part", drawing)


_UPRIGHT = 0.05


def viewing_direction(normals: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return from which direction most features are seen well: (3,), of length 1.

    The mean of the normals of the side that has most of them, leaned by 25° towards the horizon or
    away from it, so that the part's z is up.

    Parameters
    ----------
    normals : (n, 3) ndarray
        Outward, of length 1.
    """
    alike = normals @ normals.T > _ALIKE
    group = alike[np.argmax(alike.sum(axis=1))]
    x, y, z = normals[group].mean(axis=0)
    elevation, turn = np.arctan2(z, np.hypot(x, y)), np.arctan2(y, x)
    if abs(elevation) > _STEEP:
        # It leans to where the others face, else further aside, else to -y: then x is to the right.
        aside = normals[~group, :2].sum(axis=0)
        others = bool(np.hypot(*aside) > 0.2 * len(normals))
        if others:
            turn = np.arctan2(aside[1], aside[0])
        elif np.hypot(x, y) < _UPRIGHT:
            turn = -np.pi / 2
        elevation -= np.sign(elevation) * (_MORE_TILT if others else _TILT)
    else:
        elevation += _TILT if normals[:, 2].sum() > -0.1 else -_TILT
    return np.array(
        [
            np.cos(elevation) * np.cos(turn),
            np.cos(elevation) * np.sin(turn),
            np.sin(elevation),
        ]
    )


def face_greys(
    vertices: NDArray[np.float32], faces: NDArray[np.int32], away: NDArray[np.float64]
) -> NDArray[np.float32]:
    """Return how bright each triangle is drawn, 0 to 1, lit from the upper left of the viewer."""
    corners = vertices[faces].astype(np.float64)
    crosses = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    areas = np.linalg.norm(crosses, axis=1)
    normals = crosses / np.maximum(areas, 1e-30)[:, None]
    right, up = _screen(away)
    lamp = away + _LAMP[0] * right + _LAMP[1] * up
    lit = normals @ (lamp / np.linalg.norm(lamp))
    weights = areas * (normals @ away > 0.1)
    if not weights.any():
        weights = areas
    mean = np.average(lit, weights=weights)
    spread = float(np.sqrt(np.average((lit - mean) ** 2, weights=weights)))
    contrast = np.clip(_SPREAD / max(spread, 1e-6), 0.5, 3.0)
    return np.asarray(np.clip(0.62 + contrast * (lit - mean), 0.0, 1.0), dtype=np.float32)


def _screen(away: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the screen's right and up in the part's frame, z up."""
    right: NDArray[np.float64] = np.cross([0.0, 0.0, 1.0], away).astype(np.float64)
    right = np.divide(right, np.linalg.norm(right), dtype=np.float64)
    return right, np.cross(away, right).astype(np.float64)


def _camera(
    points: NDArray[np.float64], away: NDArray[np.float64]
) -> tuple[dict[str, dict[str, float]], float]:
    """Return plotly's camera that sees all points, and how much further away a phone needs it.

    Points are in plotly's units: the largest extent is 1, the part's middle 0.
    """
    right, up = _screen(away)
    half = np.tan(_FIELD_OF_VIEW / 2) * _FILLED

    def distance(centre: NDArray[np.float64], wide: float) -> float:
        across, high, near = ((points - centre) @ axis for axis in (right, up, away))
        return float(np.max(near + np.maximum(np.abs(across) / wide, np.abs(high)) / half))

    centre = np.zeros(3)
    for _ in range(4):  # what is nearer looks larger, and moves the middle
        depth = distance(centre, _WIDE) - (points - centre) @ away
        for axis in (right, up):
            seen = ((points - centre) @ axis) / depth
            centre = centre + axis * (seen.min() + seen.max()) / 2 * float(np.median(depth))
    wide = distance(centre, _WIDE)
    centre = centre - _BELOW * wide * half * up
    eye = centre + wide * away
    camera = {
        "eye": dict(zip("xyz", eye.tolist(), strict=True)),
        "center": dict(zip("xyz", centre.tolist(), strict=True)),
        "up": {"x": 0.0, "y": 0.0, "z": 1.0},
    }
    return camera, max(1.0, distance(centre, _NARROW) / wide)


def _add_outlines(drawing: go.Figure, features: Sequence[Feature], extent: float) -> None:
    lines, texts = [], []
    for feature in features:
        line = _outline(feature, extent)
        lines.append(line)
        texts += [_hint(feature)] * len(line)
    x, y, z = np.concatenate(lines).astype(np.float32).T
    drawing.add_scatter3d(
        x=x, y=y, z=z,
        mode="lines",
        line={"color": ACCENT, "width": _LINE_WIDTH},
        text=texts,
        hovertemplate="%{text}<extra></extra>",
        showlegend=False,
    )  # fmt: skip


def _add_names(
    drawing: go.Figure,
    features: Sequence[Feature],
    extent: float,
    away: NDArray[np.float64],
    in_sight: NDArray[np.bool_],
) -> list[bool]:
    """Write the names that have room, and return which of them have it on a phone, too."""
    right, up = _screen(away)
    order = sorted(np.flatnonzero(in_sight), key=lambda i: -_reach(features[i], extent))
    shown = [features[i] for i in order]
    centres = np.array([f.part_from_feature.translation_mm for f in shown]).reshape(-1, 3)
    flat = np.column_stack([centres @ right, -(centres @ up)])
    radii = np.array([_reach(f, extent) for f in shown]) + _RING * extent
    labels = label_boxes([f.name for f in shown], flat, radii, extent, only_free=True)
    free = [n for n, label in enumerate(labels) if label.covered == 0.0]
    if not free:
        return []
    moved = np.array([(labels[n].x, labels[n].y) for n in free]) - flat[free]
    places = (
        centres[free] + moved[:, :1] * right - moved[:, 1:] * up
        + _BEFORE * extent * away  # nothing of the surface may cut them
    )  # fmt: skip
    x, y, z = places.astype(np.float32).T
    drawing.add_scatter3d(
        x=x, y=y, z=z,
        mode="text",
        text=[str(escape(shown[n].name)) for n in free],
        textposition=[labels[n].side for n in free],
        textfont={"size": 12, "color": INK},
        hoverinfo="skip",
        showlegend=False,
    )  # fmt: skip
    taken: list[Box] = []
    on_phone = []
    for label in (labels[n] for n in free):
        left, top, end, bottom = label.box
        larger = (
            label.x + _PHONE * (left - label.x), label.y + _PHONE * (top - label.y),
            label.x + _PHONE * (end - label.x), label.y + _PHONE * (bottom - label.y),
        )  # fmt: skip
        on_phone.append(not any(overlap(larger, other) for other in taken))
        if on_phone[-1]:
            taken.append(larger)
    return on_phone


def _in_sight(
    features: Sequence[Feature],
    vertices: NDArray[np.float32],
    faces: NDArray[np.int32],
    away: NDArray[np.float64],
) -> NDArray[np.bool_]:
    """Return which features face the viewer, with nothing of the part before them."""
    normals = np.array([-f.part_from_feature.z_axis for f in features])
    centres = np.array([f.part_from_feature.translation_mm for f in features])
    lift = 2 * _LIFT * float(np.ptp(vertices, axis=0).max())
    ray: Any = trimesh.Trimesh(vertices, faces, process=False).ray  # trimesh does not tell its type
    directions = np.broadcast_to(away, centres.shape)
    hidden = np.asarray(ray.intersects_any(centres + lift * normals, directions))
    return np.asarray((normals @ away > 0.2) & ~hidden, dtype=np.bool_)


def _reach(feature: Feature, extent: float) -> float:
    """Return how far from its centre a feature's name stands, but for a gap."""
    half_width = feature.radius_mm if feature.width_mm is None else feature.width_mm / 2
    if half_width > _LARGE * extent:
        return 0.0
    return max(feature.radius_mm, (feature.length_mm or 0.0) / 2)


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
    local[: _STEPS + 1, 2] = -_LIFT * extent  # a feature's z looks into the material
    local[_STEPS + 1] = np.nan
    local[_STEPS + 3, 2] = -_NORMAL * extent
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
