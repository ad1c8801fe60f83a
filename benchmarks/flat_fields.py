"""A simulated camera before evenly lit flat fields: linearity and gain, as EMVA 1288 takes them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from exposight.twin.random_numbers import stream_key
from exposight.twin.sensors import CameraElectronics, expose

_SIDE_PX = 1024
_SATURATION_MS = 100.0
_LINEAR_SHARES = np.linspace(0.05, 0.95, 19)
"""Linearity is judged from 5 to 95 % of saturation (EMVA 1288, linearity)."""
_TRANSFER_SHARE = 0.7
"""The gain is fitted up to 70 % of saturation (EMVA 1288, photon transfer)."""
_SEED = 1


@dataclass(frozen=True, kw_only=True)
class FlatFields:
    """What two flat fields at each of many exposure times say about a camera.

    Parameters
    ----------
    linearity_percent : float, %
        Largest deviation of the mean electrons from a straight line over exposure time, relative
        to the line.
    gain_error_percent : float, %
        Of the gain recovered as the slope of variance over mean, against the true one; signed.
    """

    linearity_percent: float
    gain_error_percent: float


def take_flat_fields(electronics: CameraElectronics) -> FlatFields:
    """Take two flat fields at 19 exposure times and evaluate them."""
    exposures_ms = _LINEAR_SHARES * _SATURATION_MS
    pairs = [_pair(electronics, float(t), i) for i, t in enumerate(exposures_ms)]
    means = np.array([pair.mean() for pair in pairs])
    # The difference of two images: the fixed pattern goes, the temporal variance stays.
    variances = np.array([(pair[0] - pair[1]).var() / 2 for pair in pairs])
    electrons = means / electronics.gain
    # Relative deviations count, so that short exposures weigh as much as long ones.
    line = np.polyval(np.polyfit(exposures_ms, electrons, 1, w=1 / electrons), exposures_ms)
    low = means <= _TRANSFER_SHARE * 255
    # Without an offset a dark image clips at 0, so the line's intercept stands for its variance.
    gain = np.polyfit(means[low], variances[low], 1)[0]
    return FlatFields(
        linearity_percent=float(100 * np.abs(electrons / line - 1).max()),
        gain_error_percent=float(100 * (gain / electronics.gain - 1)),
    )


def _pair(electronics: CameraElectronics, exposure_ms: float, number: int) -> NDArray[np.float64]:
    """Return two images (2, rows, columns) of the same flat field."""
    radiance = electronics.full_well_e / (electronics.electrons_per_ms * _SATURATION_MS)
    flat = np.full((2, _SIDE_PX, _SIDE_PX), radiance, dtype=np.float32)
    return expose(flat, exposure_ms, electronics, noise_key=stream_key(_SEED, number)).astype(
        np.float64
    )
