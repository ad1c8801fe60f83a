"""Points that stand for missing ones: one place that many pixels of a cloud share.

Programs write -999, 9999, 1e10 or -10000 for what was not measured, and zeros that were moved with
the rest of a cloud are at one place, too. No sensor measures one place at many pixels.
"""

import numpy as np
from numpy.typing import NDArray

_SAMPLED = 20_000
"""Points from which a repeated one is found."""
_LEAST_SHARE, _LEAST = 0.01, 5
"""Share and number of points at one place from which they cannot be chance."""


def fill_point(points: NDArray[np.float32]) -> NDArray[np.float32] | None:
    """Return the one place at which a hundredth of a cloud's points or more are, or None.

    None, too, where several places repeat, as in clouds of coarse steps, or all points are there.

    Parameters
    ----------
    points : (..., 3) ndarray
        NaN where they are missing.
    """
    flat = points.reshape(-1, 3)
    sample = flat[:: max(1, len(flat) // _SAMPLED)]
    sample = np.ascontiguousarray(sample[np.isfinite(sample).all(axis=1)])
    if len(sample) < 2 * _LEAST:
        return None
    keys = sample.view([("x", np.float32), ("y", np.float32), ("z", np.float32)]).ravel()
    _, first, counts = np.unique(keys, return_index=True, return_counts=True)
    often = np.flatnonzero(counts >= max(_LEAST, _LEAST_SHARE * len(sample)))
    if len(often) != 1 or counts[often[0]] == len(sample):
        return None
    return np.asarray(sample[first[often[0]]])
