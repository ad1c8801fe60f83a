"""The light of a view under stripes, and the images that a camera takes of it.

Under a stripe pattern of f periods over the projector's W columns a pixel's radiance is

    L_n = ½A + ½Re(B·e^(−iδ_n)) + ½G + ambient,    B = c₀·Σ D_s·M_s·exp(i·2π·f·u_s/W),
    M_s = exp(−2·(π·σ_s·f/W)²),

A = Σ D_s over the pixel's samples, G the bounce, σ_s the pattern's blur. The camera's lens spreads
all of it, once for all exposures.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numba
import numpy as np

from exposight.compiled import njit
from exposight.twin.light import spread_by_lens
from exposight.twin.random_numbers import NORMAL_TABLE, mix_bits
from exposight.twin.sensors.exposure import FRAMES_PER_DRAW, grey_value, normals_of, pixel_gain

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
    cosine, sine : (fringes, rows, columns) ndarray of float32, 1/mm²
        Real and imaginary part of ½B of every fringe.
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


def stripe_light(view: ViewLight, stripes_per_px: NDArray[np.float64]) -> StripeLight:
    """Return what a traced view's light becomes under stripes and behind the lens.

    Parameters
    ----------
    view : ViewLight
        The traced view.
    stripes_per_px : (fringes,) ndarray, 1/px
        f/W of every fringe.
    """
    return StripeLight(
        camera=view.camera,
        camera_from_part=view.camera_from_part,
        is_whole=view.is_whole,
        tiles=tuple(_stripe_tile(tile, stripes_per_px, view) for tile in view.tiles),
        true_depth_mm=tuple(np.ascontiguousarray(t.depth_mm[t.inside]) for t in view.tiles),
    )


def _stripe_tile(tile: TileLight, waves: NDArray[np.float64], view: ViewLight) -> StripeTile:
    planes = np.empty((1 + 2 * waves.size, *tile.ambient.shape), dtype=np.float32)
    _phasors(
        (tile.direct, tile.column, tile.blur_px),
        (tile.indirect, tile.ambient),
        waves,
        view.model.projector.contrast,
        planes,
    )
    spread = spread_by_lens(planes, tile, view.model.camera.spread_px)
    return StripeTile(
        box=tile.box,
        even=spread[0],
        cosine=spread[1 : 1 + waves.size],
        sine=spread[1 + waves.size :],
    )


def expose_stripes(
    light: StripeLight,
    fringe: NDArray[np.int64],
    shifts_deg: NDArray[np.float64],
    electronics: CameraElectronics,
    exposure_ms: float,
    noise_key: np.uint64,
) -> list[NDArray[np.uint8]]:
    """Take stripe images at one exposure time.

    Parameters
    ----------
    light : StripeLight
        The view's light.
    fringe, shifts_deg : (n,) ndarray
        Number of each frame's fringe, and its shift δ in degrees.
    electronics : CameraElectronics
        The camera.
    exposure_ms : float, ms
        Of each frame.
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
    shift = np.radians(shifts_deg)
    shifts = np.stack([np.cos(shift), np.sin(shift)], axis=-1).astype(np.float32)
    stacks = []
    for tile in light.tiles:
        grey = np.empty((len(fringe), *tile.even.shape), dtype=np.uint8)
        _expose_stripes(
            (tile.even, tile.cosine, tile.sine),
            fringe,
            shifts,
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
    samples: tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.float32]],
    other: tuple[NDArray[np.float32], NDArray[np.float32]],
    waves: NDArray[np.float64],
    contrast: float,
    planes: NDArray[np.float32],
) -> None:
    """Fill ½A + ½G + ambient, then the real and the imaginary parts of ½B."""
    direct, column, blur = samples
    indirect, ambient = other
    n, n_waves = direct.shape[0], waves.size
    for r in numba.prange(planes.shape[1]):
        for c in range(planes.shape[2]):
            even = 0.0
            for k in range(n_waves):
                real, imaginary = 0.0, 0.0
                for s in range(n):
                    d = direct[s, r, c]
                    if d > 0.0:
                        blurred = math.pi * blur[s, r, c] * waves[k]
                        size = d * contrast * math.exp(-2.0 * blurred * blurred)
                        phase = 2.0 * math.pi * waves[k] * column[s, r, c]
                        real += size * math.cos(phase)
                        imaginary += size * math.sin(phase)
                planes[1 + k, r, c] = 0.5 * real / n
                planes[1 + n_waves + k, r, c] = 0.5 * imaginary / n
            for s in range(n):
                even += direct[s, r, c]
            planes[0, r, c] = 0.5 * (even / n + indirect[r, c]) + ambient[r, c]


@njit(parallel=True, error_model="numpy")
def _expose_stripes(
    light: tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.float32]],
    fringe: NDArray[np.int64],
    shift: NDArray[np.float32],
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
                    k = fringe[f]
                    stripe = cosine[k, r, c] * shift[f, 0] + sine[k, r, c] * shift[f, 1]
                    electrons = sensitivity * (even[r, c] + stripe) + camera[1]
                    grey[f, r, c] = grey_value(
                        electrons, normals_of(bits, table, i), camera[2], camera[3]
                    )
