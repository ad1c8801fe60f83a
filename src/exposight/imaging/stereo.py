"""Stereo: two images of one scene, rectified and matched, become an organised cloud.

Both images are turned so that a point lies on the same row of either; how far it moved along the
row is its disparity d, and its depth is focal length · baseline / d. OpenCV's semi-global matching
(Hirschmüller, *Stereo processing by semiglobal matching and mutual information*, PAMI 2008) finds
the disparities. It fills nearly everything, also where there is nothing to match, so a match counts
only where both images show texture and are not clipped; what is left is fitted to a fraction of a
pixel by least squares.

The cloud is organised like the first camera's own image, as recorded, in that camera's frame.
"""

import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace

import cv2
import numba
import numpy as np
from numpy.typing import NDArray

from exposight.cell import Cloud
from exposight.compiled import njit
from exposight.contradictions import settle
from exposight.errors import ImageError
from exposight.imaging.disparity_fitting import DISPARITY_STEP, refined_disparity
from exposight.imaging.rectification import ON_GRID_PX, RectifiedPair, averaged
from exposight.imaging.stereo_match import MatchOutcome, StereoMatch, check_sizes
from exposight.imaging.stereo_rows import check_rows

_NO_PARTNER, _OUTSIDE = np.uint8(MatchOutcome.NO_PARTNER), np.uint8(MatchOutcome.OUTSIDE)

_LARGEST_DISPARITY_PX = 2000  # 1/16 px in 16 bits
_BLOCK_PX = 5
"""Side of the squares that are compared: dots are about 3 px wide, edges must stay sharp."""
_SMALL_STEP, _LARGE_STEP = 8 * _BLOCK_PX**2, 32 * _BLOCK_PX**2
"""Penalties for disparities that change by 1 px, and by more: OpenCV's recommendation."""
_UNIQUENESS_PERCENT = 5
"""The second best match must cost this much more: the low end of OpenCV's usual 5 to 15."""
_ISLAND_PX = 100
"""Smaller islands of disparity are chance matches: OpenCV's usual 50 to 200."""
_SAME_SURFACE_PX = 1.0
"""Neighbours whose disparities differ by less belong together."""


@dataclass(frozen=True, kw_only=True)
class StereoLimits:
    """When a match counts.

    Parameters
    ----------
    min_texture : float, grey levels
        Smallest standard deviation of the grey values round a pixel.
    max_clipped : float
        The share of clipped pixels round it must be below this; 0 to 1.
    window_px : int, px
        Side of the square round a pixel, odd.

    Raises
    ------
    ImageError
        If a limit makes no sense.
    """

    # Tried on simulated dots on primed sheet: with these the share of measured points rises, stays
    # and falls with the brightness as in the paper's Fig. 16.
    min_texture: float = 6.0
    max_clipped: float = 0.2
    window_px: int = 9

    def __post_init__(self) -> None:
        if not (
            0 <= self.min_texture < math.inf
            and 0 < self.max_clipped <= 1
            and self.window_px % 2 == 1
            and 1 < self.window_px < 100
        ):
            msg = (
                "stereo matching needs a texture of 0 grey levels or more, a clipped share above 0 "
                f"and up to 1, and an odd window from 3 to 99 px, got {self}"
            )
            raise ImageError(msg)


def matchable(image: NDArray[np.uint8], limits: StereoLimits | None = None) -> NDArray[np.bool_]:
    """Tell round which pixels an image has texture and is not clipped.

    Parameters
    ----------
    image : (rows, columns) ndarray of uint8
        As recorded: rectifying blurs clipped pixels.
    limits : StereoLimits, optional
        Texture, clipping and the window in which they are judged.

    Returns
    -------
    (rows, columns) ndarray of bool

    Raises
    ------
    ImageError
        If the image is not (rows, columns) of uint8.
    """
    limits = limits or StereoLimits()
    textured, unclipped = _judged(image, limits)
    return textured & unclipped


def _judged(
    image: NDArray[np.uint8], limits: StereoLimits
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Tell round which pixels an image has texture, and round which it is not clipped."""
    if image.ndim != 2 or image.dtype != np.uint8 or not image.size:
        msg = (
            "stereo matching needs grey images (rows, columns) of uint8, got "
            f"{image.dtype} of shape {image.shape}; convert them"
        )
        raise ImageError(msg)
    window = (limits.window_px, limits.window_px)
    n = limits.window_px**2
    total = cv2.boxFilter(image, cv2.CV_64F, window, normalize=False)
    squares = cv2.sqrBoxFilter(image, cv2.CV_64F, window, normalize=False)
    clipped = cv2.boxFilter((image == 255).astype(np.uint8), cv2.CV_32F, window, normalize=False)
    textured = n * squares - total**2 > (n * limits.min_texture) ** 2
    return np.asarray(textured), np.asarray(clipped < limits.max_clipped * n)


def match_pair(
    first_image: NDArray[np.uint8],
    second_image: NDArray[np.uint8],
    pair: RectifiedPair,
    *,
    depth_limits_mm: tuple[float, float],
    limits: StereoLimits | None = None,
    downsample: int = 1,
) -> Cloud:
    """Match two images and return the points that they show.

    Parameters
    ----------
    first_image, second_image : (rows, columns) ndarray of uint8
        As recorded by the two cameras, not rectified.
    pair : RectifiedPair
        The cameras (`rectify`); keep it, its maps are computed once.
    depth_limits_mm : (float, float), mm
        Nearest and farthest Z in the first camera's frame. Matching takes longer the nearer the
        near limit is.
    limits : StereoLimits, optional
        When a match counts.
    downsample : int
        Match at this fraction of the resolution: 2 averages 2 × 2 px, as sensors do whose clouds
        have half or a quarter of the image's rows and columns. Quicker by its cube.

    Returns
    -------
    Cloud
        Organised like the first image, or like the averaged one, in the first camera's frame. NaN
        where nothing matches uniquely and both ways, where either image is clipped or has no
        texture, and outside the limits.

    Raises
    ------
    ImageError
        If an image is not of its camera's size or not uint8, or the limits make no sense.
    """
    return _match(first_image, second_image, pair, depth_limits_mm, limits, downsample).cloud


def stereo_by_images(
    first_image: NDArray[np.uint8],
    second_image: NDArray[np.uint8],
    pair: RectifiedPair,
    *,
    depth_limits_mm: tuple[float, float],
    limits: StereoLimits | None = None,
    downsample: int = 1,
    others: Mapping[str, RectifiedPair] | None = None,
    despite: Collection[str] = (),
) -> StereoMatch:
    """Match as `match_pair`, after a check that rows correspond; tell why pixels have no point.

    Parameters
    ----------
    others : mapping of str to RectifiedPair, optional
        What else the cameras may be, to be tried where rows do not correspond (`check_rows`).
    despite : collection of str
        Names of checks that are to be passed over (`settle`).

    Raises
    ------
    ContradictionError
        If the images' rows do not correspond.
    """
    check_sizes(pair, first_image.shape, second_image.shape)
    contradiction = check_rows(
        first_image, second_image, pair, depth_limits_mm=depth_limits_mm, others=others
    )
    found = settle([contradiction], despite)
    match = _match(first_image, second_image, pair, depth_limits_mm, limits, downsample)
    return replace(match, contradictions=found)


def _match(
    first_image: NDArray[np.uint8],
    second_image: NDArray[np.uint8],
    pair: RectifiedPair,
    depth_limits_mm: tuple[float, float],
    limits: StereoLimits | None,
    downsample: int,
) -> StereoMatch:
    limits = limits or StereoLimits()
    images = (first_image, second_image)
    judged = [_judged(image, limits) for image in images]
    check_sizes(pair, first_image.shape, second_image.shape)
    if downsample != 1:
        pair = pair.downsampled(downsample)
        images = (averaged(first_image, downsample), averaged(second_image, downsample))
        # Averaging hides clipped pixels.
        unclipped = [
            each[downsample // 2 :: downsample, downsample // 2 :: downsample] for _, each in judged
        ]
        judged = [
            (_judged(image, limits)[0], each[: image.shape[0], : image.shape[1]])
            for image, each in zip(images, unclipped, strict=True)
        ]
    masks = [textured & unclipped for textured, unclipped in judged]
    lowest, count = _disparity_range(pair, depth_limits_mm)
    first, second = pair.turn(*images)
    steps = _disparities(first, second, lowest, count)
    _reject(steps, *pair.turn(masks[0], masks[1]), lowest)
    cv2.filterSpeckles(steps, (lowest - 1) * DISPARITY_STEP, _ISLAND_PX, DISPARITY_STEP)
    points = np.empty((*images[0].shape, 3), dtype=np.float32)
    outcome = np.full(images[0].shape, MatchOutcome.MATCHED, dtype=np.uint8)
    _fill_points(
        pair.first.rays(),
        refined_disparity(first, second, steps, lowest),
        pair.rectified_from_first,
        (pair.camera.fx, pair.camera.cx, pair.camera.cy, pair.baseline_mm),
        (float(depth_limits_mm[0]), float(depth_limits_mm[1])),
        points,
        outcome,
    )
    textured, clear = judged[0]
    missing = outcome == MatchOutcome.NO_PARTNER
    outcome[missing & ~textured] = MatchOutcome.NO_TEXTURE
    outcome[missing & ~clear] = MatchOutcome.CLIPPED
    return StereoMatch(cloud=Cloud(points=points), outcome=outcome)


def _disparity_range(pair: RectifiedPair, depth_limits_mm: tuple[float, float]) -> tuple[int, int]:
    """Return the lowest disparity in px and how many are tried."""
    least_px, greatest_px = pair.disparity_range(depth_limits_mm)
    lowest, highest = math.floor(least_px) - 1, math.ceil(greatest_px) + 1
    if highest > _LARGEST_DISPARITY_PX:
        nearest_mm = pair.disparity_px(1.0) / (_LARGEST_DISPARITY_PX - 1) / pair.depth_scale()[0]
        msg = (
            f"at {depth_limits_mm[0]:g} mm the images are {highest} px apart, more than "
            f"{_LARGEST_DISPARITY_PX}; raise the near limit to {math.ceil(nearest_mm)} mm or more"
        )
        raise ImageError(msg)
    return lowest, -(-(highest - lowest + 1) // DISPARITY_STEP) * DISPARITY_STEP


def _disparities(
    first: NDArray[np.uint8], second: NDArray[np.uint8], lowest: int, count: int
) -> NDArray[np.int16]:
    """Return the first rectified image's disparities in 1/16 px; below `lowest` where none."""
    matcher = cv2.StereoSGBM.create(
        minDisparity=lowest,
        numDisparities=count,
        blockSize=_BLOCK_PX,
        P1=_SMALL_STEP,
        P2=_LARGE_STEP,
        disp12MaxDiff=1,
        preFilterCap=63,
        uniquenessRatio=_UNIQUENESS_PERCENT,
        mode=cv2.STEREO_SGBM_MODE_SGBM_3WAY,
    )
    # OpenCV leaves out the columns that have not all disparities inside the second image.
    margin = lowest + count
    padded = [np.pad(image, ((0, 0), (margin, 0))) for image in (first, second)]
    disparity = matcher.compute(padded[0], padded[1])[:, margin:]
    return np.ascontiguousarray(disparity, dtype=np.int16)


@njit(parallel=True, error_model="numpy")
def _reject(
    steps: NDArray[np.int16],
    first_matchable: NDArray[np.bool_],
    second_matchable: NDArray[np.bool_],
    lowest: int,
) -> None:
    """Put those disparities below `lowest` whose pixel or partner cannot be matched."""
    columns = steps.shape[1]
    for r in numba.prange(steps.shape[0]):
        for c in range(columns):
            partner = math.floor(c - steps[r, c] / DISPARITY_STEP + 0.5)
            seen = 0 <= partner < columns
            if not (first_matchable[r, c] and seen and second_matchable[r, partner]):
                steps[r, c] = (lowest - 1) * DISPARITY_STEP


@njit(inline="always", error_model="numpy")
def _sample(disparity: NDArray[np.float32], u: float, v: float) -> float:
    """Return the disparity in px at a place between pixels, or NaN."""
    rows, columns = disparity.shape
    row, column = math.floor(v + 0.5), math.floor(u + 0.5)
    if not (0 <= row < rows and 0 <= column < columns):
        return math.nan
    nearest = np.float64(disparity[row, column])
    if abs(u - column) < ON_GRID_PX and abs(v - row) < ON_GRID_PX:
        return nearest
    top, left = math.floor(v), math.floor(u)
    if not (0 <= top < rows - 1 and 0 <= left < columns - 1):
        return nearest
    down, across = v - top, u - left
    total = 0.0
    for i in range(2):
        for j in range(2):
            value = np.float64(disparity[top + i, left + j])
            # Not across an edge: a mean of two surfaces would lie on neither.
            if not abs(value - nearest) <= _SAME_SURFACE_PX:
                return nearest
            weight = (down if i else 1.0 - down) * (across if j else 1.0 - across)
            total += weight * value
    return total


@njit(parallel=True, error_model="numpy")
def _fill_points(
    rays: NDArray[np.float64],
    disparity: NDArray[np.float32],
    rotation: NDArray[np.float64],
    numbers: tuple[float, float, float, float],
    depth_limits: tuple[float, float],
    points: NDArray[np.float32],
    outcome: NDArray[np.uint8],
) -> None:
    """Fill the points (rows, columns, 3) of the first camera's pixels, and change outcomes."""
    focal, cx, cy, baseline = numbers
    near, far = depth_limits
    for r in numba.prange(points.shape[0]):
        for c in range(points.shape[1]):
            points[r, c, :] = np.nan
            x, y = rays[r, c, 0], rays[r, c, 1]
            if np.isnan(x):
                outcome[r, c] = _NO_PARTNER
                continue
            ahead = rotation[2, 0] * x + rotation[2, 1] * y + rotation[2, 2]
            u = (rotation[0, 0] * x + rotation[0, 1] * y + rotation[0, 2]) / ahead * focal + cx
            v = (rotation[1, 0] * x + rotation[1, 1] * y + rotation[1, 2]) / ahead * focal + cy
            z = focal * baseline / (_sample(disparity, u, v) * ahead)
            if near <= z <= far:  # False for NaN
                points[r, c, 0] = x * z
                points[r, c, 1] = y * z
                points[r, c, 2] = z
            else:
                outcome[r, c] = _NO_PARTNER if np.isnan(z) else _OUTSIDE
