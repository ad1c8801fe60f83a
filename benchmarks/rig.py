"""A small camera and projector before a step of known depth: frames of any pattern, and the truth.

The camera has 320 × 240 px; a box stands 35 mm before a tilted wall. Patterns are averaged over
each pixel, as a camera does.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from exposight.geometry import PinholeCamera, ProjectorCamera, RigidTransform

Coordinate = NDArray[np.float64]
Pattern = Callable[[Coordinate], Coordinate]
"""From projector coordinates in px to light, 0 to 1."""

WIDTH, HEIGHT, FOCAL_PX = 320, 240, 400.0
_WALL_MM, _STEP_MM = 520.0, 35.0
_NORMAL = np.array([0.12, 0.05, -1.0])
_SAMPLES = 5


class Rig:
    """A camera, and a projector beside it, before a step.

    Parameters
    ----------
    projector_px : (int, int), px
        Width and height of the projector's image.
    baseline_mm : float, mm
        From the camera to the projector, along x.
    seed : int
        Random seed of the camera's noise.
    from_camera : RigidTransform, optional
        Where the camera stands in the frame of the usual one, for a second camera.
    """

    def __init__(
        self,
        projector_px: tuple[int, int] = (1024, 768),
        *,
        baseline_mm: float = 120.0,
        seed: int = 1,
        usual_from_camera: RigidTransform | None = None,
    ) -> None:
        self.camera = PinholeCamera(
            width=WIDTH,
            height=HEIGHT,
            fx=FOCAL_PX,
            fy=FOCAL_PX,
            cx=(WIDTH - 1) / 2,
            cy=(HEIGHT - 1) / 2,
        )
        width, height = projector_px
        self.projector = PinholeCamera(
            width=width,
            height=height,
            fx=1.05 * width,
            fy=1.05 * width,
            cx=(width - 1) / 2,
            cy=(height - 1) / 2,
        )
        turn = np.degrees(np.arctan2(baseline_mm, _WALL_MM))
        usual_from_projector = RigidTransform.from_fanuc_wpr(
            [baseline_mm, 0.0, 0.0], 0.0, -turn, 0.0
        )
        self._usual_from_camera = usual_from_camera or RigidTransform()
        self.projector_from_camera = usual_from_projector.inverse() @ self._usual_from_camera
        self._rng = np.random.default_rng(seed)
        self.depth_mm = self._points(0.0, 0.0)[..., 2]
        self.white, self.black, self.noise = 190.0, 18.0, 1.0

    def _points(self, right_px: float, down_px: float) -> NDArray[np.float64]:
        """Return where pixels look (rows, columns, 3) in mm, in this camera's frame."""
        rays = np.dstack([self.camera.rays(), np.ones((HEIGHT, WIDTH))])
        rays = rays + np.array([right_px / FOCAL_PX, down_px / FOCAL_PX, 0.0])
        start = self._usual_from_camera.translation_mm
        along = rays @ self._usual_from_camera.rotation.T
        facing = -(along @ _NORMAL)
        wall = (_WALL_MM + start @ _NORMAL) / facing
        top = (_WALL_MM - _STEP_MM + start @ _NORMAL) / facing
        x, y = (start[i] + along[..., i] * top for i in (0, 1))
        depth = np.where((np.abs(x - 15) < 45) & (np.abs(y) < 60), top, wall)
        return np.asarray(rays * depth[..., None])

    def seen(self, right_px: float = 0.0, down_px: float = 0.0) -> tuple[Coordinate, Coordinate]:
        """Return the projector's column and row, px, that each pixel sees."""
        seen = self.projector.project(
            self.projector_from_camera.apply(self._points(right_px, down_px))
        )
        return seen[..., 0], seen[..., 1]

    def frame(
        self,
        pattern: Pattern,
        *,
        rows: bool = False,
        full_scale: int = 255,
        albedo: float | NDArray[np.float64] = 1.0,
    ) -> NDArray[np.float64]:
        """Return a frame of a pattern over the projector's columns, or over its rows."""
        light = np.zeros((HEIGHT, WIDTH))
        for shift in (np.arange(_SAMPLES) + 0.5) / _SAMPLES - 0.5:
            column, row = self.seen(0.0, shift) if rows else self.seen(shift, 0.0)
            lit = (np.abs(column - self.projector.cx) < self.projector.width / 2) & (
                np.abs(row - self.projector.cy) < self.projector.height / 2
            )
            light += np.where(lit, pattern(row if rows else column), 0.0)
        grey = self.black + albedo * (self.white - self.black) * light / _SAMPLES
        grey = grey + self._rng.normal(0.0, self.noise, grey.shape)
        return np.asarray(np.clip(np.rint(grey), 0, full_scale))

    def calibration(self, path: Path, *, translation_scale: float = 1.0) -> None:
        """Write the calibration as SLStudio does."""
        text = ProjectorCamera(
            camera=self.camera,
            projector=self.projector,
            projector_from_camera=self.projector_from_camera,
        ).to_slstudio()
        if translation_scale != 1.0:
            storage = cv2.FileStorage(text, cv2.FILE_STORAGE_READ | cv2.FILE_STORAGE_MEMORY)
            written = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
            for name in ("Kc", "kc", "Kp", "kp", "Rp", "Tp"):
                node = storage.getNode(name).mat()
                written.write(name, node * (translation_scale if name == "Tp" else 1.0))
            for name in ("frameWidth", "frameHeight", "screenResX", "screenResY"):
                written.write(name, int(storage.getNode(name).real()))
            written.release()
        else:
            path.write_text(text)


def lit(coordinate: Coordinate) -> Coordinate:
    """White."""
    return np.ones_like(coordinate)


def unlit(coordinate: Coordinate) -> Coordinate:
    """Black."""
    return np.zeros_like(coordinate)


def fringe(
    periods: float, shift_deg: float, *, size: int = 1024, gamma: float = 1.0, swing: float = 0.45
) -> Pattern:
    """Return a fringe: ½ + swing·cos(φ − shift), to the power of the projector's gamma."""
    return lambda u: (
        (0.5 + swing * np.cos(2 * np.pi * periods * u / size - np.radians(shift_deg))) ** gamma
    )


def bit(
    number: int,
    n_bits: int,
    *,
    size: int = 1024,
    width: float = 1.0,
    first: int = 0,
    binary: bool = False,
    inverse: bool = False,
) -> Pattern:
    """Return a bit of a Gray code, number 0 the most significant."""

    def pattern(u: Coordinate) -> Coordinate:
        column = np.clip(np.floor(u + 0.5), 0, size - 1)
        code = np.floor(column / width).astype(np.int64) + first
        word = code if binary else code ^ (code >> 1)
        value = (word >> (n_bits - 1 - number)) & 1
        return np.asarray(1.0 - value if inverse else value, dtype=np.float64)

    return pattern


def save(folder: Path, frames: Sequence[NDArray[np.float64]], dtype: type = np.uint8) -> None:
    """Write frames as PNG."""
    folder.mkdir(parents=True, exist_ok=True)
    for number, frame in enumerate(frames):
        cv2.imwrite(str(folder / f"frame_{number:02d}.png"), frame.astype(dtype))
