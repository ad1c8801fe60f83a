"""A simulated camera measured as EMVA 1288 measures a real one: dark images and flat fields.

Release 4.0 Linear of the standard, by its names: the system gain K from the photon transfer, the
linearity error, the saturation capacity, signal-to-noise ratio, dynamic range, PRNU and DSNU. Two
things differ, because grey levels may be coarser than the noise: the photon transfer's line is
fitted with its intercept, and the intercept stands for the dark variance where dark images cannot
resolve it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from exposight.cell import GREY_MAX, ExposureRange, full_scale
from exposight.errors import SensorError
from exposight.twin.random_numbers import stream_key
from exposight.twin.sensors.exposure import CameraElectronics, expose
from exposight.workers import Progress, ignore_progress

STAGE = "flat fields"
_SIDE_PX = 1024
_AVERAGED_SIDE_PX, _AVERAGED_IMAGES = 512, 32
"""PRNU and DSNU are those of a mean over many images (EMVA 1288, spatial nonuniformity)."""
_LINEAR_SHARES = np.linspace(0.05, 0.95, 19)
"""Linearity is judged from 5 to 95 % of saturation (EMVA 1288, linearity)."""
_SHARES = np.concatenate([_LINEAR_SHARES, np.arange(0.96, 1.045, 0.01)])
"""Beyond, the exposure at which the variance is largest is looked for: the saturation."""
_TRANSFER_SHARE = 0.7
"""The gain is fitted up to 70 % of saturation (EMVA 1288, photon transfer)."""
_QUANTISATION = 1.0 / 12.0
_RESOLVED = 0.24
"""Least variance in DN² that quantisation lets us measure (EMVA 1288, temporal dark noise)."""
_UNDERFLOW = 0.005
"""Largest share of pixels at 0 in a dark image (EMVA 1288, black level)."""
_LEAST_DARK_RISE = 2.0  # grey levels (DN) over the exposure range: less tells no dark current


@dataclass(frozen=True, kw_only=True, eq=False)
class FlatFields:
    """What dark images and pairs of flat fields say about a camera.

    DN are grey levels at the camera's bit depth. NaN stands for what grey levels do not resolve.

    Parameters
    ----------
    share : (n,) ndarray
        Light of each pair of flat fields, as a share of what the table says saturates.
    mean : (n,) ndarray, DN
        Their mean above the black level.
    variance : (n,) ndarray, DN²
        Their temporal variance, half that of the two images' difference.
    deviation_percent : (n,) ndarray, %
        Of the mean from the straight line over the light; NaN beyond 95 % of saturation.
    black_level : float, grey levels 0–255
        Mean of the dark images at the shortest exposure time.
    dark_noise_dn, dark_noise_e : float, DN and e⁻
        Temporal dark noise; the former quantisation included, the latter not.
    is_dark_resolved : bool
        False where the dark variance is the intercept of the photon transfer.
    is_dark_clipped : bool
        True where more than 0.5 % of a dark image's pixels are 0.
    dark_current_e_per_s : float, e⁻/s
        From dark images at the shortest and the longest exposure time.
    gain_dn_per_e : float, DN/e⁻
        K: slope of variance over mean.
    linearity_error_percent : float, %
        Mean of the deviations' sizes.
    full_well_e : float, e⁻
        From the black level to the largest grey level.
    saturation_e : float, e⁻
        Saturation capacity: the mean at which the variance is largest.
    prnu_percent, dsnu_e : float, % and e⁻
        Standard deviation of the pixels' sensitivity and dark signal.
    """

    share: NDArray[np.float64]
    mean: NDArray[np.float64]
    variance: NDArray[np.float64]
    deviation_percent: NDArray[np.float64]
    black_level: float
    dark_noise_dn: float
    dark_noise_e: float
    is_dark_resolved: bool
    is_dark_clipped: bool
    dark_current_e_per_s: float
    gain_dn_per_e: float
    linearity_error_percent: float
    full_well_e: float
    saturation_e: float
    prnu_percent: float
    dsnu_e: float

    @property
    def snr_max(self) -> float:
        """Largest signal-to-noise ratio: that of the shot noise at saturation."""
        return math.sqrt(self.saturation_e)

    @property
    def dynamic_range_db(self) -> float:
        """Dynamic range, dB: saturation over the signal that equals its noise."""
        return dynamic_range_db(self.saturation_e, self.dark_noise_dn / self.gain_dn_per_e)


def dynamic_range_db(saturation_e: float, dark_noise_e: float) -> float:
    """Return the saturation over the least signal whose signal-to-noise ratio is 1, in dB.

    Parameters
    ----------
    saturation_e : float, e⁻
        Saturation capacity.
    dark_noise_e : float, e⁻
        Temporal dark noise, quantisation included.
    """
    return 20.0 * math.log10(saturation_e / (math.sqrt(dark_noise_e**2 + 0.25) + 0.5))


def quantised_noise_dn(electronics: CameraElectronics, noise_e: float) -> float:
    """Return a temporal noise in DN, quantisation included.

    Parameters
    ----------
    electronics : CameraElectronics
        The camera.
    noise_e : float, e⁻
        Without quantisation.
    """
    return math.hypot(electronics.gain * noise_e, math.sqrt(_QUANTISATION))


def take_flat_fields(
    electronics: CameraElectronics,
    exposure: ExposureRange,
    progress: Progress = ignore_progress,
) -> FlatFields:
    """Take dark images and flat fields with `expose`, as captures are taken, and evaluate them.

    Parameters
    ----------
    electronics : CameraElectronics
        The camera; its fixed pattern is left as it is.
    exposure : ExposureRange
        Up to the longest exposure time the light is constant; where the shortest one lets it, the
        exposure time alone varies.
    progress : Progress
        Receives the pairs that are taken.

    Raises
    ------
    SensorError
        If the dark current alone fills the pixels within the longest exposure time.
    """
    camera = _Camera(electronics, exposure)
    shortest, longest = exposure.min_ms, exposure.max_ms
    dark = camera.dark_images(shortest, 2, 0)
    black = _mean(dark)
    clipped = float((dark == 0).mean()) > _UNDERFLOW
    dark_variance = _temporal_variance(dark)
    rise = _mean(camera.dark_images(longest, 2, 1)) - black
    mean, variance = np.empty((2, _SHARES.size))
    for i, share in enumerate(_SHARES):
        progress(STAGE, i, _SHARES.size)
        pair = camera.flat_fields(float(share), 2, 2 + i)
        mean[i], variance[i] = _mean(pair) - black, _temporal_variance(pair)
    progress(STAGE, _SHARES.size, _SHARES.size)
    deviation = np.full(_SHARES.size, np.nan)
    n = _LINEAR_SHARES.size
    # Relative deviations count, so that dim images weigh as much as bright ones.
    line = np.polyval(np.polyfit(_LINEAR_SHARES, mean[:n], 1, w=1 / mean[:n]), _LINEAR_SHARES)
    deviation[:n] = 100 * (mean[:n] / line - 1)
    gain, intercept = _photon_transfer(mean, variance)
    resolved = dark_variance >= _RESOLVED and not clipped
    total = dark_variance if resolved else max(intercept, _QUANTISATION)
    prnu, dsnu = _nonuniformity(camera)
    top = full_scale(electronics.bit_depth)
    return FlatFields(
        share=_SHARES,
        mean=mean,
        variance=variance,
        deviation_percent=deviation,
        black_level=float(black * GREY_MAX / top),
        dark_noise_dn=math.sqrt(total),
        dark_noise_e=math.sqrt(total - _QUANTISATION) / gain,
        is_dark_resolved=resolved,
        is_dark_clipped=clipped,
        dark_current_e_per_s=(
            float(1000 * rise / gain / (longest - shortest))
            if rise >= _LEAST_DARK_RISE
            else math.nan
        ),
        gain_dn_per_e=gain,
        linearity_error_percent=float(np.abs(deviation[:n]).mean()),
        full_well_e=float((top - black) / gain),
        saturation_e=float(mean[variance.argmax()] / gain),
        prnu_percent=100 * prnu,
        dsnu_e=dsnu / gain,
    )


def _photon_transfer(
    mean: NDArray[np.float64], variance: NDArray[np.float64]
) -> tuple[float, float]:
    """Return the slope and the intercept of variance over mean; NaN where none is resolved."""
    low = (_SHARES <= _TRANSFER_SHARE) & (variance >= _RESOLVED)
    if low.sum() < 3:
        return math.nan, math.nan
    # A variance's own scatter is in proportion to it.
    gain, intercept = np.polyfit(mean[low], variance[low], 1, w=1 / variance[low])
    return float(gain), float(intercept)


def _nonuniformity(camera: _Camera) -> tuple[float, float]:
    """Return the PRNU, relative, and the DSNU in DN, each without what temporal noise adds."""
    dark = camera.dark_images(camera.exposure_ms(0.5), _AVERAGED_IMAGES, 1000)
    half = camera.flat_fields(0.5, _AVERAGED_IMAGES, 1001)
    spatial = [
        stack.mean(axis=0).var() - stack.var(axis=0, ddof=1).mean() / _AVERAGED_IMAGES
        for stack in (dark, half)
    ]
    signal = _mean(half) - _mean(dark)
    return (
        math.sqrt(max(spatial[1] - spatial[0], 0.0)) / signal,
        math.sqrt(max(spatial[0], 0.0)),
    )


def _mean(images: NDArray[np.float32]) -> float:
    return float(images.mean(dtype=np.float64))


def _temporal_variance(pair: NDArray[np.float32]) -> float:
    """Return the variance of two images without their fixed pattern."""
    return float((pair[0] - pair[1]).var(dtype=np.float64) / 2)


class _Camera:
    """A camera before an even light."""

    def __init__(self, electronics: CameraElectronics, exposure: ExposureRange) -> None:
        dark_e = electronics.dark_current_e_per_s * exposure.max_ms / 1000
        if dark_e >= 0.9 * electronics.full_well_e:
            msg = (
                f"a camera's dark current fills {dark_e:.0f} of {electronics.full_well_e:.0f} e⁻ "
                f"within the longest exposure time of {exposure.max_ms:g} ms; check "
                "dark_current_e_per_s, full_well_e and the range of exposure times"
            )
            raise SensorError(msg)
        self.electronics, self.exposure = electronics, exposure
        saturating_ms = exposure.max_ms / _SHARES[-1]
        light_e = electronics.full_well_e - dark_e / _SHARES[-1]
        self._saturating = light_e / (electronics.electrons_per_ms * saturating_ms)

    def flat_fields(self, share: float, count: int, number: int) -> NDArray[np.float32]:
        """Return images of light that is a share of what saturates.

        The exposure time is in proportion to it, as far as the camera can take it; the light then.
        """
        exposure_ms = self.exposure_ms(share)
        wanted_ms = self.exposure.max_ms * share / _SHARES[-1]
        return self._images(self._saturating * wanted_ms / exposure_ms, exposure_ms, count, number)

    def exposure_ms(self, share: float) -> float:
        """Return the exposure time for light that is a share of what saturates."""
        return float(max(self.exposure.max_ms * share / _SHARES[-1], self.exposure.min_ms))

    def dark_images(self, exposure_ms: float, count: int, number: int) -> NDArray[np.float32]:
        """Return images without light."""
        return self._images(0.0, exposure_ms, count, number)

    def _images(
        self, radiance: float, exposure_ms: float, count: int, number: int
    ) -> NDArray[np.float32]:
        """Return images (count, rows, columns) in DN; the number tells their noise from others'."""
        side_px = _SIDE_PX if count == 2 else _AVERAGED_SIDE_PX
        flat = np.full((side_px, side_px), radiance, dtype=np.float32)
        frames = np.zeros((count, 2), dtype=np.int64), np.zeros((count, 2), dtype=np.float32)
        light, key = (flat, flat[None], flat[None]), stream_key(1, number)
        grey = expose(light, frames, exposure_ms, self.electronics, noise_key=key)
        return grey.astype(np.float32)
