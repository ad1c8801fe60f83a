"""From light to grey values: the lens's point spread, electrons, noise, quantisation, clipping.

For radiance L and exposure time t a pixel collects, on average,

    e = t·S·(1 + PRNU)·L + dark current·t      electrons,

scatters about that with the variance e + σ_read² (shot and read noise; the Poisson distribution is
taken as normal, above some ten electrons indistinguishable), and is read out as

    DN = clip(floor(black + gain·e + ½), 0, top),    gain = (top − black)/full well,

top being the largest grey level of the bit depth. The model is EMVA 1288's: linear until it clips.
"""

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numba
import numpy as np
from numpy.typing import NDArray

from exposight.cell import GREY_MAX, BitDepth, Image, full_scale, png_bytes
from exposight.compiled import njit
from exposight.errors import InputError, SensorError
from exposight.twin.light.view_light import TileLight
from exposight.twin.random_numbers import NORMAL_BITS, NORMAL_TABLE, mix_bits, stream_key

_FRAMES_PER_DRAW = 4
"""Frames whose noise comes from one 64-bit draw: as many as a fringe has steps."""
_MASK = np.uint64((1 << NORMAL_BITS) - 1)
_BITS = np.uint64(16)


@dataclass(frozen=True, kw_only=True)
class CameraElectronics:
    """What a camera makes of light.

    Parameters
    ----------
    electrons_per_ms : float, e⁻/ms per 1/mm²
        S: electrons that unit radiance brings in a millisecond. Holds the projector's power, the
        lens's aperture and the quantum efficiency.
    full_well_e : float, e⁻
        Electrons that bring a pixel from its black level to where it clips.
    black_level : float, grey levels 0–255
        Grey level without light; scaled with the bit depth.
    bit_depth : int, 8 to 16
        Of its grey levels.
    read_noise_e : float, e⁻
        σ_read.
    prnu : float
        Standard deviation of the pixels' sensitivities, relative.
    dark_current_e_per_s : float, e⁻/s
        Electrons without light.
    pattern_seed : int
        Tells one camera's fixed pattern (PRNU) from another's.

    Raises
    ------
    SensorError
        If a number is negative or not finite, or sensitivity or full well is 0.
    """

    # The rule, chosen once from exposure times and brightness in the paper: Table 9 gives 13 to
    # 244 grey levels for 5 to 150 ms on the middle plane. Bare sheet at the TCP, turned to the
    # middle of the training features' range (w = 6°, p = −1°), has 50 grey levels at 25 ms.
    electrons_per_ms: float = 2.3e8
    # A 4-megapixel sensor of that time (CMV4000, from a summary of its data sheet) has 13 500 e⁻,
    # 13 e⁻, at most 1 % of PRNU, and 125 e⁻/s at 25 °C. 0.8 %: the first prototype of the cell.
    full_well_e: float = 13_500.0
    # Table 9 of the paper, rows X: every exposure time of every place is there, and yet none has
    # less than 13 to 15 grey levels; places that are good at 350 ms would show 7 at 20 ms without
    # an offset. Both together ask for a black level of 7.3 to 13.
    black_level: float = 10.0
    bit_depth: BitDepth = 8
    read_noise_e: float = 13.0
    prnu: float = 0.008
    dark_current_e_per_s: float = 125.0
    pattern_seed: int = 1

    def __post_init__(self) -> None:
        positive = (self.electrons_per_ms, self.full_well_e)
        others = (self.read_noise_e, self.prnu, self.dark_current_e_per_s, self.pattern_seed)
        if not (
            all(0 < value < math.inf for value in positive)
            and all(0 <= value < math.inf for value in others)
            and 0 <= self.black_level < GREY_MAX / 2
            and self.prnu < 0.5
        ):
            msg = (
                "a camera's electronics needs a sensitivity and a full well above 0, noise, PRNU, "
                "dark current and seed of 0 or more, a PRNU below 0.5, and a black level from 0 to "
                f"below 127.5 of 255 grey levels, got {self}"
            )
            raise SensorError(msg)
        full_scale(self.bit_depth)  # refuses others

    @property
    def black(self) -> float:
        """Grey level without light, at the camera's bit depth."""
        return self.black_level * full_scale(self.bit_depth) / GREY_MAX

    @property
    def gain(self) -> float:
        """Grey levels per electron, at the camera's bit depth."""
        return (full_scale(self.bit_depth) - self.black) / self.full_well_e

    @property
    def pattern_key(self) -> np.uint64:
        """Key of the stream from which the pixels' sensitivities are drawn."""
        return stream_key(self.pattern_seed, 0x50524E55)

    def numbers(self, exposure_ms: float) -> NDArray[np.float32]:
        """Pack (t·S, dark electrons, σ_read², gain, PRNU, black level, top) for compiled loops.

        Raises
        ------
        InputError
            If the exposure time is not positive and finite.
        """
        if not 0 < exposure_ms < math.inf:
            msg = f"an exposure time must be above 0 ms and finite, got {exposure_ms}"
            raise InputError(msg)
        return np.array(
            [
                exposure_ms * self.electrons_per_ms,
                exposure_ms * self.dark_current_e_per_s / 1000.0,
                self.read_noise_e**2,
                self.gain,
                self.prnu,
                self.black,
                full_scale(self.bit_depth),
            ],
            dtype=np.float32,
        )


@njit(inline="always", error_model="numpy")
def _normal(bits: np.uint64, table: NDArray[np.float32], i: int) -> np.float32:
    """Return the i-th (0 … 3) standard normal number in 64 random bits."""
    return np.float32(table[np.int64((bits >> (_BITS * np.uint64(i))) & _MASK)])


@njit(inline="always", error_model="numpy")
def _pixel_gain(
    key: np.uint64, pixel: np.uint64, prnu: np.float32, table: NDArray[np.float32]
) -> np.float32:
    """Return 1 + PRNU of a pixel."""
    return np.float32(1.0) + prnu * _normal(mix_bits(key, pixel), table, 0)


@njit(inline="always", error_model="numpy")
def _grey_value(electrons: np.float32, normal: np.float32, camera: NDArray[np.float32]) -> float:
    """Return the grey value of a pixel from its mean electrons and a standard normal number."""
    noisy = electrons + normal * math.sqrt(max(electrons, np.float32(0.0)) + camera[2])
    level = math.floor(camera[5] + camera[3] * noisy + np.float32(0.5))
    return float(min(max(level, 0.0), camera[6]))


def expose(
    light: tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.float32]],
    frames: tuple[NDArray[np.int64], NDArray[np.float32]],
    exposure_ms: float,
    electronics: CameraElectronics,
    *,
    noise_key: np.uint64,
    place: tuple[int, int, int, int] | None = None,
) -> Image:
    """Take frames of a rectangle of pixels.

    Parameters
    ----------
    light : tuple of ndarray of float32, 1/mm²
        Behind the lens: (rows, columns) of what all frames share, and two stacks (m, rows, columns)
        of which each frame adds a weighted plane.
    frames : (n, 2) ndarray of int64, (n, 2) ndarray of float32
        Numbers of the two planes that each frame adds, and their weights.
    exposure_ms : float, ms
        Exposure time of each.
    electronics : CameraElectronics
        The camera.
    noise_key : uint64
        From `stream_key`; another one for every exposure.
    place : (int, int, int, int), px, optional
        The rectangle's top and left, and height and width of the image that it is part of; a whole
        image by default. A pixel's grey values do not depend on the rectangle.

    Returns
    -------
    (n, rows, columns) ndarray of uint8, or uint16 for more than 8 bits

    Raises
    ------
    InputError
        If the exposure time is not positive.
    """
    planes, weights = frames
    rows, columns = light[0].shape
    grey: Image = np.empty(
        (len(planes), rows, columns), dtype=np.uint8 if electronics.bit_depth == 8 else np.uint16
    )
    _expose(
        light,
        planes,
        weights,
        electronics.numbers(exposure_ms),
        (noise_key, electronics.pattern_key),
        NORMAL_TABLE,
        place or (0, 0, rows, columns),
        grey,
    )
    return grey


@njit(parallel=True, error_model="numpy")
def _expose(
    light: tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.float32]],
    planes: NDArray[np.int64],
    weights: NDArray[np.float32],
    camera: NDArray[np.float32],
    keys: tuple[np.uint64, np.uint64],
    table: NDArray[np.float32],
    place: tuple[int, int, int, int],
    grey: Image,
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
            sensitivity = camera[0] * _pixel_gain(pattern_key, pixel, camera[4], table)
            for first in range(0, n_frames, _FRAMES_PER_DRAW):
                draw = np.uint64(first // _FRAMES_PER_DRAW) * pixels + pixel
                bits = mix_bits(noise_key, draw)
                for i in range(min(_FRAMES_PER_DRAW, n_frames - first)):
                    f = first + i
                    first_plane, second_plane = planes[f, 0], planes[f, 1]
                    stripe = (
                        cosine[first_plane, r, c] * weights[f, 0]
                        + sine[second_plane, r, c] * weights[f, 1]
                    )
                    electrons = sensitivity * (even[r, c] + stripe) + camera[1]
                    grey[f, r, c] = _grey_value(electrons, _normal(bits, table, i), camera)


def frame_files(frames: Iterable[Image]) -> dict[str, bytes]:
    """Return frames, each (rows, columns), as names and contents of files, in their order."""
    return {f"frame-{i:02d}.png": png_bytes(frame) for i, frame in enumerate(frames)}


def spread_by_lens(
    planes: NDArray[np.float32], tile: TileLight, spread_px: float
) -> NDArray[np.float32]:
    """Convolve light with the lens's Gaussian point-spread function.

    Parameters
    ----------
    planes : (n, rows, columns) ndarray of float32
        Any linear measure of light on the pixels that were traced for a tile.
    tile : TileLight
        Says which of them are wanted.
    spread_px : float, px
        Standard deviation of the Gaussian; 0 for none.

    Returns
    -------
    (n, rows, columns) ndarray of float32
        On the pixels of the tile's box. At the frame's border, beyond which nothing was traced,
        the weights are renormed.
    """
    rows, columns = tile.inside
    shape = (rows.stop - rows.start, columns.stop - columns.start)
    spread = np.empty((len(planes), *shape), dtype=np.float32)
    _spread(planes, _kernel(spread_px), rows.start, columns.start, spread)
    return spread


def _kernel(spread_px: float) -> NDArray[np.float32]:
    """Return the five weights of a sampled Gaussian; (0, 0, 1, 0, 0) for no spread."""
    offset = np.arange(-2.0, 3.0)
    if spread_px == 0.0:
        return np.asarray(offset == 0, dtype=np.float32)
    weights = np.exp(-0.5 * (offset / spread_px) ** 2)
    return np.asarray(weights / weights.sum(), dtype=np.float32)


@njit(parallel=True, error_model="numpy")
def _spread(
    planes: NDArray[np.float32],
    kernel: NDArray[np.float32],
    top: int,
    left: int,
    spread: NDArray[np.float32],
) -> None:
    n, rows, columns = spread.shape
    height, width = planes.shape[1], planes.shape[2]
    for job in numba.prange(n * rows):
        plane, r = job // rows, job % rows
        line = np.zeros(width, dtype=np.float32)
        weight = np.float32(0.0)
        for i in range(-2, 3):
            y = r + top + i
            if 0 <= y < height:
                weight += kernel[i + 2]
                for x in range(width):
                    line[x] += kernel[i + 2] * planes[plane, y, x]
        for c in range(columns):
            total, across = np.float32(0.0), np.float32(0.0)
            for j in range(-2, 3):
                x = c + left + j
                if 0 <= x < width:
                    across += kernel[j + 2]
                    total += kernel[j + 2] * line[x]
            spread[plane, r, c] = total / (across * weight)
