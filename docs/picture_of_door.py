"""The door from inside and outside, its features labelled by group."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib import pyplot as plt
from matplotlib.lines import Line2D
from matplotlib.patches import Circle
from picture_style import ACCENT, ACCENT_2, ACCENT_3, INK, QUIET, save

from exposight.geometry.ray_casting import MISS_MM
from exposight.twin.light import SceneTracer
from exposight.twin.part import FINISHES, OUTSIDE_ZONES

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from numpy.typing import NDArray

    from exposight.cell import Feature
    from exposight.twin.part import Scene

_EXTENT_MM = (-510.0, 510.0, -360.0, 360.0)
_PX_PER_MM = 2.2  # rays; half as many pixels are drawn, so that edges are smooth
_FAR_MM = 400.0
_TINT = {"bare": 0.80, "primer": 0.92, "paint": 0.52, "brushed": 0.70}
"""How light each finish is drawn: told apart, not measured."""
_GROUPS = (
    ("f1–f4: training", ACCENT, ("f1", "f2", "f3", "f4")),
    ("f5–f9: more training", ACCENT_3, ("f5", "f6", "f7", "f8", "f9")),
    (
        "f1_test–f4_test: never seen in training",
        ACCENT_2,
        ("f1_test", "f2_test", "f3_test", "f4_test"),
    ),
    (
        "f1_out–f5_out: outside, three finishes",
        "#a0478a",
        ("f1_out", "f2_out", "f3_out", "f4_out", "f5_out"),
    ),
)


@dataclass(frozen=True, kw_only=True)
class _Side:
    """From where the door is looked at; ``across`` is +1 where x goes to the right."""

    name: str
    look: float
    across: float


_INSIDE = _Side(name="inside", look=1.0, across=1.0)
_OUTSIDE = _Side(name="outside", look=-1.0, across=-1.0)


def _shaded(scene: Scene, tracer: SceneTracer, side: _Side) -> NDArray[np.float64]:
    """Return an orthographic picture (rows, columns) of grey from 0 to 1, NaN beside the door."""
    left, right, top, bottom = _EXTENT_MM
    x = np.arange(left, right, 1 / _PX_PER_MM) * side.across
    y = np.arange(top, bottom, 1 / _PX_PER_MM)
    grid = np.meshgrid(x, y)
    origins = np.stack([*grid, np.full_like(grid[0], -_FAR_MM * side.look)], axis=-1)
    origins = origins.reshape(-1, 3).astype(np.float32)
    directions = np.zeros_like(origins)
    directions[:, 2] = side.look
    distance, face, u, v, _ = tracer.first_hits(origins, directions)
    met = distance < MISS_MM
    faces = np.where(met, face, 0)
    corners = scene.corner_normals()[faces]
    weights = np.stack([1 - u - v, u, v], axis=-1)
    normal = np.einsum("nij,ni->nj", corners, weights)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)

    lamp = np.array([-0.62 * side.across, -0.55, -0.56 * side.look])  # from the upper left
    lamp /= np.linalg.norm(lamp)
    points = origins + directions * np.where(met, distance, 0.0)[:, None]
    points += 0.05 * normal
    towards = np.broadcast_to(200.0 * lamp, points.shape)
    dark = tracer.blocked(points.astype(np.float32), towards.astype(np.float32))
    light = np.clip(normal @ lamp, 0.0, None) * np.where(dark, 0.25, 1.0)
    facing = np.abs(normal[:, 2])
    tint = np.array([_TINT[finish] for finish in FINISHES])[scene.face_finish[faces]]
    grey = tint * (0.30 * facing + 1.15 * light)
    grey[~met] = np.nan
    return grey.reshape(y.size, x.size)


def _halved(image: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the mean of each 2 × 2 pixels over white."""
    rows, columns = (size // 2 * 2 for size in image.shape)
    white = np.where(np.isnan(image), 1.0, np.clip(image, 0.0, 1.0))[:rows, :columns]
    return white.reshape(rows // 2, 2, columns // 2, 2).mean(axis=(1, 3))


def _label(axes: Axes, feature: Feature, side: _Side, colour: str) -> None:
    x, y, _ = feature.part_from_feature.translation_mm
    x *= side.across
    radius = feature.radius_mm
    axes.add_patch(Circle((x, y), radius + 4.0, fill=False, edgecolor=colour, linewidth=1.8))
    axes.annotate(
        feature.name,
        (x + (radius + 4.0) * 0.71, y - (radius + 4.0) * 0.71),
        xytext=(2, 2),
        textcoords="offset points",
        color="white",
        fontsize=8.5,
        fontweight="bold",
        bbox={"boxstyle": "round,pad=0.18", "facecolor": colour, "edgecolor": "none"},
    )


def draw_door(scene: Scene, tracer: SceneTracer) -> None:
    """Draw the door from both sides."""
    figure, panels = plt.subplots(2, 1, figsize=(8, 11.4), layout="constrained")
    left, right, top, bottom = _EXTENT_MM
    for axes, side in zip(panels, (_INSIDE, _OUTSIDE), strict=True):
        image = _halved(_shaded(scene, tracer, side))
        axes.imshow(image, cmap="gray", vmin=0, vmax=1, extent=(left, right, bottom, top))
        axes.set(xlim=(left, right), ylim=(bottom, top), ylabel="y of the part / mm")
        axes.set_xlabel("x of the part / mm" + (", seen from behind" * (side is _OUTSIDE)))
        axes.spines[:].set_visible(False)
        axes.set_xticks(range(-400, 401, 200))
        axes.set_yticks(range(-300, 301, 100))
        if side is _OUTSIDE:
            axes.set_xticklabels([str(-tick).replace("-", "−") for tick in range(-400, 401, 200)])
        axes.tick_params(color=QUIET, labelcolor=INK)
        shown = [group for group in _GROUPS if (group[0] == _GROUPS[-1][0]) == (side is _OUTSIDE)]
        for _, colour, names in shown:
            for name in names:
                _label(axes, scene.part.feature(name), side, colour)
        rings: dict[str, Any] = {
            "marker": "o",
            "linestyle": "",
            "markersize": 9,
            "markeredgewidth": 1.8,
        }
        keys = [
            Line2D([], [], **rings, markerfacecolor="none", markeredgecolor=colour, label=label)
            for label, colour, _ in shown
        ]
        axes.legend(handles=keys, loc="lower center", bbox_to_anchor=(0.5, 0.99), frameon=False,
                    ncols=len(keys), handletextpad=0.2)  # fmt: skip
    panels[0].set_title("Inside: bare sheet metal, seen as the sensor sees it", pad=24)
    panels[1].set_title("Outside: primer, paint and brushed metal", pad=24)
    _name_zones(panels[1])
    save(figure, "door")
    plt.close(figure)


def _name_zones(axes: Axes) -> None:
    """Write each finish's name on its zone of the outside."""
    start = -500.0
    for border, finish in OUTSIDE_ZONES:
        end = min(border, 500.0)
        axes.text(-(start + end) / 2, -140, finish, ha="center", color=INK, fontsize=11)
        start = end
