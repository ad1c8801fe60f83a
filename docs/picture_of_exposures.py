"""One view under three exposures for three finishes, with clipped and missing pixels marked."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from matplotlib import pyplot as plt
from matplotlib.colors import to_rgb
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from picture_style import ACCENT, ACCENT_2, save

from exposight.cell import Part
from exposight.geometry import PixelBox
from exposight.observing import observe_capture, point_search, view_features
from exposight.plans import plan_preset, view_seed
from exposight.twin.light import SceneTracer
from exposight.twin.part import FINISHES
from exposight.twin.sensors import StripeSensor

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from numpy.typing import NDArray

    from exposight.cell import Feature
    from exposight.observing import FeatureView
    from exposight.plans import PlannedView
    from exposight.twin.part import Finish, Scene

_SHOWN: tuple[Finish, ...] = ("bare", "primer", "paint")
_TITLES = {"bare": "bare sheet metal", "primer": "primer", "paint": "paint"}
_VIEW, _FEATURE = "middle-x4-y3", "f3"
_MIDDLE_OF_TILE = (-15.0, 0.0, 0.0)  # mm beside the feature: a bead comes into the tile, too
_TILE_PX = (200, 300)
_GOOD_GREY = 60.0  # of the ring, in the middle column
_FACTORS = (0.14, 1.0, 2.7)
_RING = "#f0c000"
_CLIPPED, _MISSING, _OPACITY = ACCENT_2, ACCENT, 0.8


@dataclass(frozen=True, kw_only=True, eq=False)
class _Tile:
    """What one exposure gave around the feature."""

    exposure_ms: float
    image: NDArray[np.uint8]
    clipped: NDArray[np.bool_]
    missing: NDArray[np.bool_]
    i_avg: float
    p_norm: float


class _Station:
    """The sensor before the door in one finish."""

    def __init__(self, scene: Scene, tracer: SceneTracer) -> None:
        plan = plan_preset("x-middle")
        self.sensor = StripeSensor(sensor=plan.sensor)
        (self.view,) = (view for view in plan.views(scene.part) if view.name == _VIEW)
        feature = scene.part.feature(_FEATURE)
        self.box = _box(self.sensor, self.view, feature)
        only = Part(name=scene.part.name, features=(feature,))
        pose = self.view.camera_from_part
        self.seen = view_features(only, self.sensor.sensor, pose)
        self.light = self.sensor.look(tracer, pose, [self.box])

    def expose(self, exposure_ms: float) -> _Tile:
        seed = (*view_seed(1, self.view.name), round(1000 * exposure_ms))
        (stack,) = self.sensor.frames(self.light, exposure_ms, seed)
        capture = self.sensor.capture(self.light, exposure_ms, view=_VIEW, seed=seed)
        camera = self.sensor.sensor.camera
        (row,) = observe_capture(capture, self.seen, point_search(capture.cloud, camera))
        box = self.box
        missing = np.ones((camera.height, camera.width), dtype=np.bool_)
        pixels = np.rint(camera.project(capture.cloud.valid_points)).astype(np.int64)
        missing[pixels[:, 1], pixels[:, 0]] = False
        inside = slice(box.top, box.bottom), slice(box.left, box.right)
        return _Tile(
            exposure_ms=exposure_ms,
            image=np.asarray(capture.image)[inside],
            clipped=(np.asarray(stack.frames) == 255).any(axis=0),
            missing=missing[inside],
            i_avg=row.i_avg,
            p_norm=row.p_norm,
        )

    def sweep(self) -> list[_Tile]:
        """Expose darkly, well and brightly for this finish."""
        sensor = self.sensor.sensor
        trial = self.expose(10.0)
        black = self.sensor.electronics.black_level
        good_ms = trial.exposure_ms * (_GOOD_GREY - black) / (trial.i_avg - black)
        return [self.expose(sensor.nearest_exposure(good_ms * factor)) for factor in _FACTORS]


def _box(sensor: StripeSensor, view: PlannedView, feature: Feature) -> PixelBox:
    at_mm = feature.part_from_feature.translation_mm + _MIDDLE_OF_TILE
    camera = sensor.sensor.camera
    column, row = camera.project(view.camera_from_part.apply(at_mm)[None])[0]
    top, left = round(row) - _TILE_PX[0] // 2, round(column) - _TILE_PX[1] // 2
    return PixelBox(top=top, bottom=top + _TILE_PX[0], left=left, right=left + _TILE_PX[1])


def in_finish(scene: Scene, finish: Finish) -> Scene:
    """Return the door with its bare sheet, the inside, in another finish."""
    bare = FINISHES.index("bare")
    index = np.uint8(FINISHES.index(finish))
    return replace(scene, face_finish=np.where(scene.face_finish == bare, index, scene.face_finish))


def _ring(axes: Axes, station: _Station, seen: FeatureView) -> None:
    """Outline the ring that is measured."""
    angle = np.linspace(0.0, 2 * np.pi, 181)
    for beyond_mm in (3.0, 5.0):
        radius_mm = seen.feature.radius_mm + beyond_mm
        circle = np.stack([np.cos(angle), np.sin(angle), np.zeros_like(angle)], axis=-1)
        pixels = station.sensor.sensor.camera.project(
            seen.camera_from_feature.apply(radius_mm * circle)
        )
        axes.plot(
            pixels[:, 0] - station.box.left,
            pixels[:, 1] - station.box.top,
            color=_RING,
            linewidth=0.9,
        )


def _marked(colour: str, grey: NDArray[np.float64] | float) -> NDArray[np.float64]:
    """Return a colour laid over grey that still shines through."""
    return np.asarray(_OPACITY * np.array(to_rgb(colour)) + (1 - _OPACITY) * grey)


def _draw_tile(axes: Axes, tile: _Tile) -> None:
    grey = np.repeat(tile.image[..., None] / 255.0, 3, axis=-1)
    for mask, colour in ((tile.missing & ~tile.clipped, _MISSING), (tile.clipped, _CLIPPED)):
        grey[mask] = _marked(colour, grey[mask])
    axes.imshow(grey, interpolation="nearest")
    axes.set(xticks=[], yticks=[])
    axes.spines[:].set_visible(False)
    axes.set_title(
        f"{tile.exposure_ms:g} ms; ring: {tile.i_avg:.0f} grey levels, "
        f"points on {100 * tile.p_norm:.0f} %",
        fontsize=8.5,
        pad=3,
    )


def draw_exposures(scene: Scene, tracer: SceneTracer) -> None:
    """Draw one row of tiles for each finish; `tracer` is that of the scene as it is, bare."""
    figure, grid = plt.subplots(3, 3, figsize=(10, 7.3), layout="constrained")
    for row, finish in zip(grid, _SHOWN, strict=True):
        own = tracer if finish == "bare" else SceneTracer(in_finish(scene, finish))
        station = _Station(scene, own)
        for axes, tile in zip(row, station.sweep(), strict=True):
            _draw_tile(axes, tile)
            _ring(axes, station, station.seen[0])
        row[0].set_ylabel(_TITLES[finish], fontsize=11)
    figure.legend(
        handles=[
            Patch(
                facecolor=_marked(_CLIPPED, 1.0),
                label="no 3D point: clipped in one of the 12 stripe images",
            ),
            Patch(facecolor=_marked(_MISSING, 0.0), label="no 3D point: too dark, shadow, or hole"),
            Line2D([], [], color=_RING, label="ring that is measured"),
        ],
        loc="outside lower center",
        ncols=3,
        frameon=False,
    )
    figure.suptitle(
        f"Dark, good, bright: feature {_FEATURE} of the simulated door in three finishes"
    )
    save(figure, "exposures", dpi=130)
    plt.close(figure)
