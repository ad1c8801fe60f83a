"""From a pattern sequence to what a projector shows, frame by frame."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numba
import numpy as np
from numpy.typing import NDArray

from exposight.cell import Projector, sensor_preset
from exposight.compiled import njit
from exposight.errors import ImageError, SensorError
from exposight.imaging import AxisCoding, Fringe, PatternSequence
from exposight.twin.light import TileLight, projector_of


def fringe_sequence(
    periods: Sequence[float], projector: Projector, steps: int = 4
) -> PatternSequence:
    """Return fringes over a projector's columns, shifted in equal steps.

    Parameters
    ----------
    periods : sequence of float
        Periods of each fringe over the projector's width, from few to many; the first at most one.
    projector : Projector
        That shows them.
    steps : int
        Steps of each.

    Raises
    ------
    ImageError
        If the fringes do not ascend, or begin with more than one period.
    """
    fringes = tuple(
        Fringe(periods=count, frames=tuple(range(steps * i, steps * (i + 1))))
        for i, count in enumerate(periods)
    )
    return PatternSequence(
        name=f"{', '.join(f'{count:g}' for count in periods)} stripes, {steps} steps each",
        projector_width=projector.width,
        projector_height=projector.height,
        columns=AxisCoding(fringes=fringes),
    )


STRIPES = fringe_sequence((1, 8, 64), projector_of(sensor_preset("comet-pro-ae")))
"""Stripes of the twin's first prototype, over the 1920 columns of the paper's sensor's preset."""


def projected(sequence: PatternSequence, contrast: float) -> Patterns:
    """Return what a projector shows.

    Parameters
    ----------
    sequence : PatternSequence
        What each frame means. Frames that mean nothing show the mean light.
    contrast : float
        c₀ of the projector: dark parts pass (1 − c₀)/2 of the light, lit ones (1 + c₀)/2.
    """
    planes = np.zeros((sequence.n_frames, 2), dtype=np.int64)
    weights = np.zeros((sequence.n_frames, 2), dtype=np.float32)
    waves: dict[str, list[float]] = {"columns": [], "rows": []}
    n_planes = 0
    for axis, coding, size in sequence.axes():
        for fringe in coding.fringes:
            if 2 * fringe.periods > size:
                msg = (
                    f"a projector of {size} px along the {axis} cannot show {fringe.periods:g} "
                    "periods: a period needs two px or more"
                )
                raise ImageError(msg)
            shift = np.radians(coding.shown_deg(fringe, size))
            planes[list(fringe.frames)] = n_planes
            weights[list(fringe.frames)] = np.stack([np.cos(shift), np.sin(shift)], axis=-1)
            waves[axis].append(fringe.periods / size)
            n_planes += 1
    slides = sequence.slides()
    for frame in slides:
        planes[frame] = (n_planes, 0)
        weights[frame] = (1.0, 0.0)
        n_planes += 1
    return Patterns(
        column_waves=np.array(waves["columns"]),
        row_waves=np.array(waves["rows"]),
        slides=tuple(
            blurred_slide((0.5 * (1.0 + contrast * (2.0 * lit - 1.0))).astype(np.float32))
            for lit in slides.values()
        ),
        planes=planes,
        weights=weights,
    )


BLURS_PX = (0.5, 0.7, 1.0, 1.4, 2.0, 2.8, 4.0)
"""Blurs at which the pattern is kept, in projector px. Others are taken as the nearest of these:
below the first, the dots' own edges are as soft; beyond the last, hardly any contrast is left."""
_FULL = 65535.0  # transmittance 1 in 16 bits


_DOT_SEED = 1


@dataclass(frozen=True, kw_only=True)
class DotPattern:
    """A slide of random dots, one in every square cell.

    Parameters
    ----------
    cell_px, radius_px : float, projector px
        Side of the cells, and radius of the dots.

    Raises
    ------
    SensorError
        If dots are larger than their cells, or a size is not above 0.
    """

    # Roboception does not publish the pattern; chosen once. With the blur, these dots are about 3
    # camera px wide over the working volume, the least that digital image correlation asks for
    # (iDICs, *A good practices guide for digital image correlation*, 2018). They cover a quarter of
    # the slide: in the paper p_norm reaches 0.75 from 12 grey levels on (Table 9, stereo eX), which
    # takes a deviation of half the mean where 6 grey levels of texture are wanted.
    cell_px: float = 4.0
    radius_px: float = 1.1

    def __post_init__(self) -> None:
        if not 0 < 2 * self.radius_px <= self.cell_px < math.inf:
            msg = f"dots need 0 < 2·radius_px ≤ cell_px, got {self}"
            raise SensorError(msg)


def render_dots(
    width: int, height: int, contrast: float, dots: DotPattern | None = None
) -> NDArray[np.uint16]:
    """Draw a slide with random dots at all of `BLURS_PX`.

    Parameters
    ----------
    width, height : int, px
        Of the projector.
    contrast : float
        c₀: the dark parts pass (1 − c₀)/2 of the light, the dots (1 + c₀)/2.
    dots : DotPattern, optional
        Their sizes.

    Returns
    -------
    (blurs, height, width) ndarray of uint16
        Transmittance, 65535 for 1.
    """
    dots = dots or DotPattern()
    rows, columns = math.ceil(height / dots.cell_px), math.ceil(width / dots.cell_px)
    rng = np.random.default_rng(_DOT_SEED)
    place = np.stack(np.meshgrid(np.arange(rows), np.arange(columns), indexing="ij"), axis=-1)
    centres = (place + rng.random((rows, columns, 2))) * dots.cell_px - 0.5
    sharp = np.zeros((height, width), dtype=np.float32)
    _draw_discs(centres.reshape(-1, 2), dots.radius_px, sharp)
    light = 0.5 * (1.0 + contrast * (2.0 * sharp - 1.0))
    return blurred_slide(light)


def blurred_slide(light: NDArray[np.float32]) -> NDArray[np.uint16]:
    """Blur a slide by all of `BLURS_PX`.

    Parameters
    ----------
    light : (height, width) ndarray of float32
        Share of the light that passes, 0–1; of height or width 1 where it is the same along an
        axis.

    Returns
    -------
    (blurs, height, width) ndarray of uint16
        Transmittance, 65535 for 1.
    """
    blurred = [cv2.GaussianBlur(light, (0, 0), blur) for blur in BLURS_PX]
    stack = [np.rint(image * _FULL).astype(np.uint16) for image in blurred]
    return np.stack(stack).reshape(-1, *light.shape)


def slide_radiance(tile: TileLight, slide: NDArray[np.uint16]) -> NDArray[np.float32]:
    """Return the light of a tile under a slide, before the lens.

    Parameters
    ----------
    tile : TileLight
        A rectangle of a traced view.
    slide : (blurs, height, width) ndarray of uint16
        From `blurred_slide`; its size is the projector's, or 1 where it is the same along an axis.

    Returns
    -------
    (rows, columns) ndarray of float32, 1/mm²
    """
    radiance = np.empty(tile.ambient.shape, dtype=np.float32)
    _light_slide(
        (tile.direct, tile.column, tile.row, tile.blur_px),
        (tile.indirect, tile.ambient),
        slide,
        np.array(BLURS_PX),
        float(slide[0].mean()),
        radiance,
    )
    return radiance


@njit(error_model="numpy")
def _draw_discs(centres: NDArray[np.float64], radius: float, image: NDArray[np.float32]) -> None:
    """Draw discs with edges that fall off over a pixel; centres are (row, column)."""
    reach = math.ceil(radius + 0.5)
    for i in range(len(centres)):
        y, x = centres[i, 0], centres[i, 1]
        for r in range(max(math.floor(y) - reach, 0), min(math.ceil(y) + reach + 1, len(image))):
            first, stop = max(math.floor(x) - reach, 0), math.ceil(x) + reach + 1
            for c in range(first, min(stop, image.shape[1])):
                share = min(max(radius + 0.5 - math.hypot(r - y, c - x), 0.0), 1.0)
                image[r, c] = max(image[r, c], share)


@njit(parallel=True, error_model="numpy")
def _light_slide(
    light: tuple[
        NDArray[np.float32], NDArray[np.float32], NDArray[np.float32], NDArray[np.float32]
    ],
    other: tuple[NDArray[np.float32], NDArray[np.float32]],
    slide: NDArray[np.uint16],
    blurs: NDArray[np.float64],
    mean: float,
    radiance: NDArray[np.float32],
) -> None:
    """Fill the radiance before the lens."""
    direct, column, row, blur = light
    indirect, ambient = other
    for r in numba.prange(radiance.shape[0]):
        for c in range(radiance.shape[1]):
            total = 0.0
            if direct[r, c] > 0.0:
                share = _share(slide, blurs, column[r, c], row[r, c], blur[r, c])
                total = direct[r, c] * share
            radiance[r, c] = (total + indirect[r, c] * mean) / _FULL + ambient[r, c]


@njit(inline="always", error_model="numpy")
def _share(
    slide: NDArray[np.uint16], blurs: NDArray[np.float64], u: float, v: float, blur: float
) -> float:
    """Return the light that passes at a place of the slide, linear in place and squared blur."""
    level = 0
    while level < blurs.size - 2 and blur > blurs[level + 1]:
        level += 1
    low, high = blurs[level] ** 2, blurs[level + 1] ** 2
    t = min(max((np.float64(blur) ** 2 - low) / (high - low), 0.0), 1.0)
    left, top = math.floor(u), math.floor(v)
    across, down = u - left, v - top
    total = 0.0
    for i in range(2):
        y = min(max(top + i, 0), slide.shape[1] - 1)
        for j in range(2):
            x = min(max(left + j, 0), slide.shape[2] - 1)
            weight = (down if i else 1.0 - down) * (across if j else 1.0 - across)
            total += weight * ((1.0 - t) * slide[level, y, x] + t * slide[level + 1, y, x])
    return total


@dataclass(frozen=True, kw_only=True, eq=False)
class Patterns:
    """Everything that a projector shows, one frame after another.

    A frame's light is the mean light of stripes plus two planes (`StripeTile.cosine` and ``sine``),
    each with a weight: a shifted fringe's phasor, or what a slide differs by.

    Parameters
    ----------
    column_waves, row_waves : (n,) ndarray, 1/px
        f/W of the fringes along the projector's columns, f/H along its rows.
    slides : tuple of (blurs, height, width) ndarray of uint16
        Other patterns (`blurred_slide`).
    planes : (frames, 2) ndarray of int64
        Each frame's two planes. Those of column fringes come first, then those of row fringes, then
        slides, which have no second plane.
    weights : (frames, 2) ndarray of float32
        Their weights: cos δ and sin δ of a fringe; 1 and 0 of a slide.
    """

    column_waves: NDArray[np.float64]
    row_waves: NDArray[np.float64]
    slides: tuple[NDArray[np.uint16], ...]
    planes: NDArray[np.int64]
    weights: NDArray[np.float32]
