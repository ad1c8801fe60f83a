"""How a camera's lens spreads light over neighbouring pixels."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numba
import numpy as np

from exposight.compiled import njit

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from exposight.twin.light.view_light import TileLight


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
