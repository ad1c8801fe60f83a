"""The light of a view under stripes, and the images that a camera takes of it.

Under a stripe pattern of f periods over the projector's W columns a pixel's radiance is

    L_n = ½A + ½Re(B·e^(−iδ_n)) + ½G + ambient,    B = c₀·D·M·exp(i·2π·f·u/W),
    M = exp(−2·(π·σ·f/W)²),

A = D being the light of the fully lit projector, G the bounce, σ the pattern's blur; along the rows
likewise. Other patterns, as the bits of a Gray code, are slides. The camera's lens spreads all of
it, once for all exposures.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numba
import numpy as np

from exposight.compiled import njit
from exposight.twin.random_numbers import NORMAL_TABLE, mix_bits
from exposight.twin.sensors.exposure import (
    FRAMES_PER_DRAW,
    grey_value,
    normals_of,
    pixel_gain,
    spread_by_lens,
)
from exposight.twin.sensors.patterns import Patterns, slide_radiance

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from exposight.geometry import PinholeCamera, PixelBox, RigidTransform
    from exposight.twin.light import TileLight, ViewLight
    from exposight.twin.sensors.exposure import CameraElectronics


@dataclass(frozen=True, kw_only=True, eq=False)
class StripeTile:
    """The light of a rectangle of pixels behind the lens, for any stripe image.

    Parameters
    ----------
    box : PixelBox
        The pixels.
    even : (rows, columns) ndarray of float32, 1/mm²
        ½A + ½G + ambient: the mean over the steps of a fringe.
    cosine, sine : (n, rows, columns) ndarray of float32, 1/mm²
        Real and imaginary part of ½B of every fringe. After those of the fringes, ``cosine`` has
        what every other pattern's light differs by from `even`.
    """

    box: PixelBox
    even: NDArray[np.float32]
    cosine: NDArray[np.float32]
    sine: NDArray[np.float32]


@dataclass(frozen=True, kw_only=True, eq=False)
class StripeLight:
    """The light of a view under stripes, ready for exposures.

    Parameters
    ----------
    camera : PinholeCamera
        Whose pixels these are.
    camera_from_part : RigidTransform
        Where the part stands.
    is_whole : bool
        False where only boxes were traced.
    tiles : tuple of StripeTile
        Disjoint.
    true_depth_mm : tuple of (rows, columns) ndarray of float32, mm
        Of each tile; NaN where nothing is.
    """

    camera: PinholeCamera
    camera_from_part: RigidTransform
    is_whole: bool
    tiles: tuple[StripeTile, ...]
    true_depth_mm: tuple[NDArray[np.float32], ...]


def stripe_light(view: ViewLight, patterns: Patterns) -> StripeLight:
    """Return what a traced view's light becomes under patterns and behind the lens.

    Parameters
    ----------
    view : ViewLight
        The traced view.
    patterns : Patterns
        What is projected.
    """
    return StripeLight(
        camera=view.camera,
        camera_from_part=view.camera_from_part,
        is_whole=view.is_whole,
        tiles=tuple(_stripe_tile(tile, patterns, view) for tile in view.tiles),
        true_depth_mm=tuple(np.ascontiguousarray(t.depth_mm[t.inside]) for t in view.tiles),
    )


def _stripe_tile(tile: TileLight, patterns: Patterns, view: ViewLight) -> StripeTile:
    n_columns, n_rows = patterns.column_waves.size, patterns.row_waves.size
    n_fringes, n_slides = n_columns + n_rows, len(patterns.slides)
    planes = np.empty((1 + 2 * n_fringes + n_slides, *tile.ambient.shape), dtype=np.float32)
    cosine, sine = planes[1 : 1 + n_fringes], planes[1 + n_fringes : 1 + 2 * n_fringes]
    axes = [(patterns.column_waves, tile.column, 0)]  # of no wave too: it gives the mean
    axes += [(patterns.row_waves, tile.row, n_columns)] if n_rows else []
    for waves, place, first in axes:
        _phasors(
            (tile.direct, place, tile.blur_px),
            (tile.indirect, tile.ambient),
            waves,
            view.model.projector.contrast,
            planes[0],
            cosine[first : first + waves.size],
            sine[first : first + waves.size],
        )
    for plane, slide in zip(planes[1 + 2 * n_fringes :], patterns.slides, strict=True):
        plane[:] = slide_radiance(tile, slide) - planes[0]
    spread = spread_by_lens(planes, tile, view.model.camera.spread_px)
    slides = spread[1 + 2 * n_fringes :]
    cosine = spread[1 : 1 + n_fringes]
    if n_slides:
        cosine = np.concatenate([cosine, slides])
    sine = spread[1 + n_fringes : 1 + 2 * n_fringes] if n_fringes else cosine
    return StripeTile(box=tile.box, even=spread[0], cosine=cosine, sine=sine)


def expose_stripes(
    light: StripeLight,
    patterns: Patterns,
    electronics: CameraElectronics,
    exposure_ms: float,
    noise_key: np.uint64,
) -> list[NDArray[np.uint8]]:
    """Take all frames at one exposure time.

    Parameters
    ----------
    light : StripeLight
        The view's light under the patterns.
    patterns : Patterns
        What is projected.
    electronics : CameraElectronics
        The camera.
    exposure_ms : float, ms
        Exposure time of every frame.
    noise_key : uint64
        From `stream_key`; another one for every exposure.

    Returns
    -------
    list of (n, rows, columns) ndarray of uint8
        One for every tile. A pixel's grey values do not depend on the tiles.

    Raises
    ------
    InputError
        If the exposure time is not positive.
    """
    stacks = []
    for tile in light.tiles:
        grey = np.empty((len(patterns.planes), *tile.even.shape), dtype=np.uint8)
        _expose_stripes(
            (tile.even, tile.cosine, tile.sine),
            patterns.planes,
            patterns.weights,
            electronics.numbers(exposure_ms),
            (noise_key, electronics.pattern_key),
            NORMAL_TABLE,
            (tile.box.top, tile.box.left, light.camera.height, light.camera.width),
            grey,
        )
        stacks.append(grey)
    return stacks


@njit(parallel=True, error_model="numpy")
def _phasors(
    light: tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.float32]],
    other: tuple[NDArray[np.float32], NDArray[np.float32]],
    waves: NDArray[np.float64],
    contrast: float,
    mean: NDArray[np.float32],
    cosine: NDArray[np.float32],
    sine: NDArray[np.float32],
) -> None:
    """Fill ½A + ½G + ambient, and the real and the imaginary parts of ½B of every wave."""
    direct, place, blur = light
    indirect, ambient = other
    for r in numba.prange(mean.shape[0]):
        for c in range(mean.shape[1]):
            d = direct[r, c]
            for k in range(waves.size):
                cosine[k, r, c] = sine[k, r, c] = 0.0
                if d > 0.0:
                    blurred = math.pi * blur[r, c] * waves[k]
                    size = d * contrast * math.exp(-2.0 * blurred * blurred)
                    phase = 2.0 * math.pi * waves[k] * place[r, c]
                    cosine[k, r, c] = 0.5 * (size * math.cos(phase))
                    sine[k, r, c] = 0.5 * (size * math.sin(phase))
            mean[r, c] = 0.5 * (np.float64(d) + indirect[r, c]) + ambient[r, c]


@njit(parallel=True, error_model="numpy")
def _expose_stripes(
    light: tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.float32]],
    planes: NDArray[np.int64],
    weights: NDArray[np.float32],
    camera: NDArray[np.float32],
    keys: tuple[np.uint64, np.uint64],
    table: NDArray[np.float32],
    place: tuple[int, int, int, int],
    grey: NDArray[np.uint8],
) -> None:
    """Fill all frames; `place` is the tile's top and left and the image's height and width."""
    even, cosine, sine = light
    noise_key, pattern_key = keys
    top, left, height, width = place
    pixels = np.uint64(height * width)
    n_frames, rows, columns = grey.shape
    for r in numba.prange(rows):
        for c in range(columns):
            pixel = np.uint64((top + r) * width + left + c)
            sensitivity = camera[0] * pixel_gain(pattern_key, pixel, camera[4], table)
            for first in range(0, n_frames, FRAMES_PER_DRAW):
                draw = np.uint64(first // FRAMES_PER_DRAW) * pixels + pixel
                bits = mix_bits(noise_key, draw)
                for i in range(min(FRAMES_PER_DRAW, n_frames - first)):
                    f = first + i
                    first_plane, second_plane = planes[f, 0], planes[f, 1]
                    stripe = (
                        cosine[first_plane, r, c] * weights[f, 0]
                        + sine[second_plane, r, c] * weights[f, 1]
                    )
                    electrons = sensitivity * (even[r, c] + stripe) + camera[1]
                    grey[f, r, c] = grey_value(
                        electrons, normals_of(bits, table, i), camera[2], camera[3]
                    )
