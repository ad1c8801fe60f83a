"""Rectification: two cameras' images turned so that a point lies on the same row of either.

Both look as if taken by one ideal camera at either place, whose x axis runs along the baseline.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import TypeVar

import cv2
import numpy as np
from numpy.typing import NDArray

from exposight.errors import ImageError, SensorError
from exposight.geometry import PinholeCamera, RigidTransform, averaged_camera

_Pixel = TypeVar("_Pixel", np.uint8, np.bool_)

ON_GRID_PX = 1e-3
"""Nearer than this to a pixel's centre is on it."""
_NARROWEST_COSINE = 0.5
"""The optical axes must not be more than 60° apart."""
_LARGEST_GROWTH = 4.0
"""A rectified image with more pixels than this times the recorded one is stretched too far."""


@dataclass(frozen=True, kw_only=True, eq=False)
class RectifiedPair:
    """Two cameras, and the ideal camera that both images are turned to (`rectify`).

    Parameters
    ----------
    first, second : PinholeCamera
        As calibrated, lens distortion included.
    camera : PinholeCamera
        Of the rectified images: no distortion, both images alike.
    rectified_from_first, rectified_from_second : (3, 3) ndarray
        Rotations into the rectified frame, whose x axis runs from the first to the second camera.
    baseline_mm : float, mm
        Distance between the cameras.
    """

    first: PinholeCamera
    second: PinholeCamera
    camera: PinholeCamera
    rectified_from_first: NDArray[np.float64]
    rectified_from_second: NDArray[np.float64]
    baseline_mm: float

    def disparity_px(self, depth_mm: float) -> float:
        """Return the disparity in px of points at a rectified depth in mm."""
        return self.camera.fx * self.baseline_mm / depth_mm

    def turn(
        self, first: NDArray[_Pixel], second: NDArray[_Pixel]
    ) -> tuple[NDArray[_Pixel], NDArray[_Pixel]]:
        """Rectify images (uint8) or masks (bool) of both cameras; 0 where they see nothing."""
        first_map, second_map = self._pixel_maps
        return _remap(first, first_map), _remap(second, second_map)

    def downsampled(self, ratio: int) -> RectifiedPair:
        """Return the pair of the images averaged over ratio × ratio px; kept."""
        if ratio not in self._smaller:
            first, second = (averaged_camera(each, ratio) for each in (self.first, self.second))
            self._smaller[ratio] = rectify(first, second, self.first_from_second)
        return self._smaller[ratio]

    @cached_property
    def _smaller(self) -> dict[int, RectifiedPair]:
        return {}

    @property
    def first_from_second(self) -> RigidTransform:
        """Where the second camera is, seen from the first."""
        back = self.rectified_from_first.T
        return RigidTransform(
            rotation=back @ self.rectified_from_second, translation_mm=self.baseline_mm * back[:, 0]
        )

    @cached_property
    def _pixel_maps(self) -> tuple[NDArray[np.float32] | None, NDArray[np.float32] | None]:
        return (
            _pixel_map(self.camera, self.first, self.rectified_from_first),
            _pixel_map(self.camera, self.second, self.rectified_from_second),
        )

    def second_pixels(self) -> NDArray[np.float32]:
        """Return where (2, rows, columns) the second camera sees the rectified pixels, in px."""
        pixels = self._pixel_maps[1]
        if pixels is None:
            columns, rows = np.meshgrid(np.arange(self.camera.width), np.arange(self.camera.height))
            return np.stack([columns, rows]).astype(np.float32)
        return pixels

    def disparity_range(self, depth_limits_mm: tuple[float, float]) -> tuple[float, float]:
        """Return the least and the greatest disparity in px between two depths.

        Parameters
        ----------
        depth_limits_mm : (float, float), mm
            Nearest and farthest Z in the first camera's frame.

        Raises
        ------
        ImageError
            Unless 0 < near < far.
        """
        near_mm, far_mm = depth_limits_mm
        if not 0 < near_mm < far_mm < math.inf:
            msg = f"stereo matching needs 0 < near < far in mm, got {near_mm} and {far_mm}"
            raise ImageError(msg)
        least, greatest = self.depth_scale()
        return self.disparity_px(far_mm * greatest), self.disparity_px(near_mm * least)

    def depth_scale(self) -> tuple[float, float]:
        """Return the least and the greatest rectified depth at Z = 1 of the first camera's rays."""
        rays = self.first.rays()
        towards = self.rectified_from_first[2]
        scale = rays @ towards[:2] + towards[2]
        return float(np.nanmin(scale)), float(np.nanmax(scale))


def averaged(image: NDArray[np.uint8], ratio: int) -> NDArray[np.uint8]:
    """Return an image averaged over ratio × ratio px; what is left at its end is cut off."""
    rows, columns = (size // ratio for size in image.shape)
    cut = image[: rows * ratio, : columns * ratio]
    small = cv2.resize(cut, (columns, rows), interpolation=cv2.INTER_AREA)
    return np.asarray(small, dtype=np.uint8)


def rectify(
    first: PinholeCamera, second: PinholeCamera, first_from_second: RigidTransform
) -> RectifiedPair:
    """Find the rotations and the ideal camera that put both images' rows side by side.

    The rectified x axis is the baseline, and z the mean of the optical axes as far as that allows.
    The rectified image has the first camera's focal length and holds all that it sees. Cameras that
    are ideal and aligned already come out as they are.

    Parameters
    ----------
    first, second : PinholeCamera
        The left and the right camera.
    first_from_second : RigidTransform
        Where the second camera is, seen from the first.

    Raises
    ------
    SensorError
        If the second camera is not to the right of the first, or they look in directions too
        different for one image plane.
    """
    offset = first_from_second.translation_mm
    baseline_mm = float(np.linalg.norm(offset))
    if not offset[0] > math.hypot(offset[1], offset[2]):
        place = ", ".join(f"{x:g}" for x in offset)
        msg = (
            "a stereo pair needs its second camera to the right of the first (along +x, more than "
            f"along y or z), got it at ({place}) mm; hand over the left camera as the first, and "
            "check that the pose is first_from_second"
        )
        raise SensorError(msg)
    ahead = first_from_second.rotation[:, 2]
    if ahead[2] < _NARROWEST_COSINE:
        apart_deg = math.degrees(math.acos(max(-1.0, ahead[2])))
        msg = (
            f"a stereo pair's optical axes may be at most 60° apart, got {apart_deg:.0f}°; check "
            "the rotation of the second camera"
        )
        raise SensorError(msg)
    x = offset / baseline_mm
    middle = np.array([0.0, 0.0, 1.0]) + ahead
    z = middle - (middle @ x) * x
    z /= np.linalg.norm(z)
    rectified_from_first = np.stack([x, np.cross(z, x), z])
    rectified_from_second = rectified_from_first @ first_from_second.rotation
    return RectifiedPair(
        first=first,
        second=second,
        camera=_common_camera((first, rectified_from_first), (second, rectified_from_second)),
        rectified_from_first=rectified_from_first,
        rectified_from_second=rectified_from_second,
        baseline_mm=baseline_mm,
    )


def _common_camera(*turned: tuple[PinholeCamera, NDArray[np.float64]]) -> PinholeCamera:
    """Return a camera with the first one's rows and the columns of both."""
    slopes = [_border_slopes(camera, rotation) for camera, rotation in turned]
    first = turned[0][0]
    focal_px = (first.fx + first.fy) / 2
    across, down = np.concatenate(slopes)[:, 0], slopes[0][:, 1]
    left, top = focal_px * float(across.min()), focal_px * float(down.min())
    right, bottom = focal_px * float(across.max()), focal_px * float(down.max())
    width, height = (
        math.ceil(high - low - ON_GRID_PX) + 1 for low, high in ((left, right), (top, bottom))
    )
    if width * height > _LARGEST_GROWTH * first.width * first.height:
        msg = (
            f"rectified images would grow to {width} × {height} px from {first.width} × "
            f"{first.height} px; check the cameras' distortion and the rotation between them"
        )
        raise SensorError(msg)
    # Rounded, so that an ideal camera's principal point comes out as it was.
    return PinholeCamera(
        width=width,
        height=height,
        fx=focal_px,
        fy=focal_px,
        cx=round(-left, 6),
        cy=round(-top, 6),
    )


def _border_slopes(camera: PinholeCamera, rotation: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return X/Z and Y/Z (n, 2) in the rectified frame of the rays round a camera's image."""
    rays = camera.rays()
    border = np.concatenate([rays[0], rays[-1], rays[:, 0], rays[:, -1]])
    border = border[np.isfinite(border).all(axis=1)]
    ahead = border @ rotation[:, :2].T + rotation[:, 2]
    if not len(ahead) or not (ahead[:, 2] > 0).all():
        msg = (
            "a stereo pair needs cameras whose whole images can be turned to one plane; check "
            "their distortion and the rotation between them"
        )
        raise SensorError(msg)
    return np.asarray(ahead[:, :2] / ahead[:, 2:])


def _pixel_map(
    rectified: PinholeCamera, camera: PinholeCamera, rotation: NDArray[np.float64]
) -> NDArray[np.float32] | None:
    """Return where (2, rows, columns) a camera sees the rectified pixels; None: where they are."""
    rays = rectified.rays()
    directions = np.concatenate([rays, np.ones((*rays.shape[:2], 1))], axis=-1) @ rotation
    pixels = camera.project(directions)
    columns, rows = np.meshgrid(np.arange(rectified.width), np.arange(rectified.height))
    same_size = (rectified.width, rectified.height) == (camera.width, camera.height)
    if same_size and np.abs(pixels - np.stack([columns, rows], axis=-1)).max() < ON_GRID_PX:
        return None
    outside = np.nan_to_num(pixels, nan=-1e4)
    return np.ascontiguousarray(np.moveaxis(outside, -1, 0), dtype=np.float32)


def _remap(image: NDArray[_Pixel], pixel_map: NDArray[np.float32] | None) -> NDArray[_Pixel]:
    if pixel_map is None:
        return image
    interpolation = cv2.INTER_NEAREST if image.dtype == np.bool_ else cv2.INTER_CUBIC
    turned = cv2.remap(
        image.astype(np.uint8, copy=False), pixel_map[0], pixel_map[1], interpolation
    )
    return turned.astype(image.dtype)
