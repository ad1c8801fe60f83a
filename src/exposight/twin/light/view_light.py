"""The light of a view, traced once for all its exposures.

Light is linear: what reaches a pixel is known once the scene has been traced from one position,
and every pattern at every exposure time follows by arithmetic (`exposight.twin.sensors`).
A view is traced as a whole, or in boxes round the features only; a pixel's light is the same.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from exposight.cell import ActiveSensor
from exposight.errors import InputError
from exposight.geometry import PinholeCamera, PixelBox, RigidTransform
from exposight.twin.light import optics
from exposight.twin.light.indirect import bounce
from exposight.twin.light.shading import Lamp, lamp_of, light_along_rays

HALO_PX = 2
"""Pixels traced beyond a box on every side, from which the lens spreads light into it."""
_BAND_RAYS = 1 << 18  # traced at a time: bounds the memory
_PROBE_PX = 8  # every how many pixels a view is probed for seeing anything at all


@dataclass(frozen=True, kw_only=True)
class LightModel:
    """Everything about the light that is not the sensor's geometry.

    Parameters
    ----------
    projector : ProjectorLens
        Contrast and blur of the pattern.
    camera : CameraLens
        Point spread and vignetting.
    lighting : {'I', 'II', 'III'} or float
        Light besides the projector's (`ambient_share`).
    indirect : bool
        Whether light takes the way by a second surface.
    lamp : float
        Power of the projector's lamp, as a share of the nominal one; other light stays.
    """

    projector: optics.ProjectorLens = field(default_factory=optics.ProjectorLens)
    camera: optics.CameraLens = field(default_factory=optics.CameraLens)
    lighting: optics.Lighting | float = "I"
    indirect: bool = True
    lamp: float = 1.0


@dataclass(frozen=True, kw_only=True, eq=False)
class TileLight:
    """The light of a rectangle of pixels, before the camera's lens spreads it.

    Parameters
    ----------
    box : PixelBox
        The pixels wanted.
    traced : PixelBox
        The pixels that the arrays hold: `box` and up to `HALO_PX` beyond it.
    direct, column, row, blur_px : (rows, columns) ndarray of float32
        Radiance of the fully lit projector in 1/mm², dimmed by the lens; where in the pattern the
        point lies and the pattern's blur there, in projector px (0 where unlit).
    indirect, ambient : (rows, columns) ndarray of float32, 1/mm²
        One bounce of the fully lit projector; light from elsewhere.
    depth_mm : (rows, columns) ndarray of float32, mm
        True depth Z behind the pixel's centre in the camera's frame, NaN where nothing is.
    """

    box: PixelBox
    traced: PixelBox
    direct: NDArray[np.float32]
    column: NDArray[np.float32]
    row: NDArray[np.float32]
    blur_px: NDArray[np.float32]
    indirect: NDArray[np.float32]
    ambient: NDArray[np.float32]
    depth_mm: NDArray[np.float32]

    @property
    def inside(self) -> tuple[slice, slice]:
        """Rows and columns of `box` in the arrays."""
        top, left = self.box.top - self.traced.top, self.box.left - self.traced.left
        height, width = self.box.bottom - self.box.top, self.box.right - self.box.left
        return slice(top, top + height), slice(left, left + width)


@dataclass(frozen=True, kw_only=True, eq=False)
class ViewLight:
    """The light that one camera of a sensor sees from one position.

    Parameters
    ----------
    camera : PinholeCamera
        The camera.
    camera_from_part : RigidTransform
        Where the part stands, seen from the sensor's first camera.
    model : LightModel
        What it was traced with.
    tiles : tuple of TileLight
        Disjoint; one for a whole frame.
    """

    camera: PinholeCamera
    camera_from_part: RigidTransform
    model: LightModel
    tiles: tuple[TileLight, ...]

    @property
    def is_whole(self) -> bool:
        """True where the whole frame was traced."""
        return len(self.tiles) == 1 and self.tiles[0].box == whole_frame(self.camera)


def whole_frame(camera: PinholeCamera) -> PixelBox:
    """Return the box of all of a camera's pixels."""
    return PixelBox(top=0, bottom=camera.height, left=0, right=camera.width)


def disjoint_boxes(boxes: Sequence[PixelBox]) -> list[PixelBox]:
    """Return boxes that cover the given ones and share no pixel, in reading order.

    Overlapping boxes are joined, so that no point is measured twice.
    """
    done: list[PixelBox] = []
    for box in boxes:
        if box.empty:
            continue
        joined = box
        while True:
            touching = [other for other in done if _overlap(joined, other)]
            if not touching:
                break
            done = [other for other in done if other not in touching]
            for other in touching:
                joined = PixelBox(
                    top=min(joined.top, other.top),
                    bottom=max(joined.bottom, other.bottom),
                    left=min(joined.left, other.left),
                    right=max(joined.right, other.right),
                )
        done.append(joined)
    return sorted(done, key=lambda box: (box.top, box.left))


def _overlap(a: PixelBox, b: PixelBox) -> bool:
    rows = a.top < b.bottom and b.top < a.bottom
    return rows and a.left < b.right and b.left < a.right


def trace_view(
    tracer: optics.SceneTracer,
    sensor: ActiveSensor,
    camera_from_part: RigidTransform,
    *,
    model: LightModel | None = None,
    boxes: Sequence[PixelBox] | None = None,
    camera_index: int = 0,
) -> ViewLight:
    """Trace what one camera of a sensor sees from one position.

    Parameters
    ----------
    tracer : SceneTracer
        The scene.
    sensor : ActiveSensor
        With a projector.
    camera_from_part : RigidTransform
        Where the part stands, seen from the first camera.
    model : LightModel, optional
        Lenses and lighting.
    boxes : sequence of PixelBox, optional
        Pixels to trace, the whole frame by default. Boxes that overlap are joined.
    camera_index : int
        Which of the sensor's cameras looks.

    Raises
    ------
    InputError
        If the view sees nothing of the scene at all.
    SensorError
        If the sensor has no projector.
    """
    model = model or LightModel()
    eye = _Eye(
        sensor.cameras[camera_index],
        sensor.first_from_camera[camera_index].inverse() @ camera_from_part,
    )
    eye.check_sees(tracer)
    lamp = lamp_of(sensor, camera_from_part, model.projector)
    ambient = optics.ambient_share(model.lighting) * lamp.irradiance_at_tcp
    frame = whole_frame(eye.camera)
    wanted = [frame] if boxes is None else disjoint_boxes([_cut(box, frame) for box in boxes])
    tiles = tuple(_trace_tile(tracer, eye, lamp, model, box, ambient) for box in wanted)
    if model.lamp != 1.0:
        tiles = tuple(
            replace(tile, direct=model.lamp * tile.direct, indirect=model.lamp * tile.indirect)
            for tile in tiles
        )
    return ViewLight(camera=eye.camera, camera_from_part=camera_from_part, model=model, tiles=tiles)


def _cut(box: PixelBox, frame: PixelBox, margin: int = 0) -> PixelBox:
    return PixelBox(
        top=max(box.top - margin, frame.top),
        bottom=min(box.bottom + margin, frame.bottom),
        left=max(box.left - margin, frame.left),
        right=min(box.right + margin, frame.right),
    )


class _Eye:
    """A camera before the part: gives the rays of its pixels in the part's frame."""

    def __init__(self, camera: PinholeCamera, camera_from_part: RigidTransform) -> None:
        self.camera = camera
        self._part_from_camera = camera_from_part.inverse()

    def rays(
        self, rows: NDArray[np.int64], columns: NDArray[np.int64]
    ) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Return origins and directions (n, 3); a direction's length is that of Z = 1 mm."""
        slopes = self.camera.rays()[rows, columns]
        # Written out: a matrix product may round differently with the number of its rows.
        r = self._part_from_camera.rotation
        x, y = slopes[:, 0], slopes[:, 1]
        directions = np.empty((len(slopes), 3), dtype=np.float32)
        for i in range(3):
            directions[:, i] = r[i, 0] * x + r[i, 1] * y + r[i, 2]
        # A pixel without a ray gets no direction, which meets nothing; Embree takes NaN a thousand
        # times longer.
        directions[np.isnan(x)] = 0.0
        origins = np.empty_like(directions)
        origins[:] = self._part_from_camera.translation_mm
        return origins, directions

    def check_sees(self, tracer: optics.SceneTracer) -> None:
        """Check that some ray meets the scene."""
        rows, columns = np.meshgrid(
            np.arange(0, self.camera.height, _PROBE_PX),
            np.arange(0, self.camera.width, _PROBE_PX),
            indexing="ij",
        )
        origins, directions = self.rays(rows.ravel(), columns.ravel())
        if (tracer.first_hits(origins, directions)[1] < 0).all():
            msg = (
                f"the view sees nothing of the part: none of {rows.size} rays through the image "
                "meets it; check camera_from_part"
            )
            raise InputError(msg)


def _trace_tile(
    tracer: optics.SceneTracer,
    eye: _Eye,
    lamp: Lamp,
    model: LightModel,
    box: PixelBox,
    ambient_irradiance: float,
) -> TileLight:
    camera = eye.camera
    traced = _cut(box, whole_frame(camera), HALO_PX)
    height, width = traced.bottom - traced.top, traced.right - traced.left
    direct, column, row, blur_px, ambient, dimming = np.zeros((6, height, width), dtype=np.float32)
    depth = np.empty((height, width), dtype=np.float32)
    columns = np.arange(traced.left, traced.right)
    step = max(1, _BAND_RAYS // width)
    for start in range(traced.top, traced.bottom, step):
        band_rows = np.arange(start, min(start + step, traced.bottom))
        grid = np.meshgrid(band_rows, columns, indexing="ij")
        rows, cols = grid[0].ravel(), grid[1].ravel()
        shape = (band_rows.size, width)
        band = slice(start - traced.top, start - traced.top + band_rows.size)
        dimmed = _dimming(camera, rows, cols, model.camera.vignetting_exponent)
        dimming[band] = dimmed.reshape(shape)
        lit = light_along_rays(tracer, lamp, *eye.rays(rows, cols))
        direct[band] = (lit.radiance * dimmed).reshape(shape)
        column[band] = lit.column.reshape(shape)
        row[band] = lit.row.reshape(shape)
        blur_px[band] = lit.blur_px.reshape(shape)
        share = np.float32(ambient_irradiance / np.pi)
        ambient[band] = (lit.reflectance * dimmed * share).reshape(shape)
        depth[band] = lit.distance.reshape(shape)
    indirect = np.zeros_like(ambient)
    if model.indirect:
        image_shape = (camera.height, camera.width)
        indirect = bounce(tracer, lamp, eye.rays, depth, traced, image_shape)
        indirect *= dimming
    return TileLight(
        box=box,
        traced=traced,
        direct=direct,
        column=column,
        row=row,
        blur_px=blur_px,
        indirect=indirect,
        ambient=ambient,
        depth_mm=depth,
    )


def _dimming(
    camera: PinholeCamera, rows: NDArray[np.int64], columns: NDArray[np.int64], exponent: float
) -> NDArray[np.float32]:
    """Return cosᵏ of the angle off the optical axis of pixels; 0 where the lens gives no ray."""
    slopes = camera.rays()[rows, columns]
    square = 1.0 + slopes[:, 0] ** 2 + slopes[:, 1] ** 2
    return np.nan_to_num(square ** (-exponent / 2)).astype(np.float32)
