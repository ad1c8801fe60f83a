"""The light of a view under stripes, behind the lens, once for all exposures.

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

import numba
import numpy as np
from numpy.typing import NDArray

from exposight.compiled import njit
from exposight.geometry import PixelBox, RigidTransform
from exposight.twin.light import TileLight, ViewLight
from exposight.twin.sensors.exposure import spread_by_lens
from exposight.twin.sensors.patterns import Patterns, slide_radiance


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
    camera_from_part : RigidTransform
        Where the part stands.
    is_whole : bool
        False where only boxes were traced.
    tiles : tuple of StripeTile
        Disjoint.
    """

    camera_from_part: RigidTransform
    is_whole: bool
    tiles: tuple[StripeTile, ...]


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
        camera_from_part=view.camera_from_part,
        is_whole=view.is_whole,
        tiles=tuple(_stripe_tile(tile, patterns, view) for tile in view.tiles),
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
