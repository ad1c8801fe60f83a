"""Curves of camera and projector: grey levels to light, and phases that a gamma has bent.

A camera's response turns grey levels into light before anything is computed from them. A
projector's gamma makes of each sinusoid a wave with harmonics, of which N − 1, N + 1, 2N − 1, …
move the phase of N steps (Zhang & Yau, *Generic nonsinusoidal phase error correction for
three-dimensional shape measurement using a digital video projector*, Applied Optics 2007): much for
three steps, hardly for many. The shift depends on the phase alone, so a table takes it back.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from exposight.cell import full_scale
from exposight.errors import ImageError

_PHASES = 4096
"""Steps of a phase table over one period: linear between them, it is exact to 1e-6 of it."""


def light_of_levels(
    bit_depth: int,
    *,
    pairs: Sequence[tuple[float, float]] = (),
    gamma: float | None = None,
) -> NDArray[np.float64] | None:
    """Return the light of each grey level, on the scale of grey levels.

    Parameters
    ----------
    bit_depth : int
        Bits of a grey level.
    pairs : sequence of (float, float)
        Grey level and relative light in any unit, both rising, from level 0 to where the camera
        saturates; linear between them, and above the last.
    gamma : float, optional
        In place of pairs: light is the grey level to this power.

    Returns
    -------
    (2**bit_depth,) ndarray of float64, or None
        The largest grey level is its own light. None where neither pairs nor gamma are given: grey
        levels are light.

    Raises
    ------
    ImageError
        If both are given, pairs do not rise or do not begin at level 0, or the gamma is not from
        0.1 to 10.
    """
    top = full_scale(bit_depth)
    levels = np.arange(top + 1, dtype=np.float64)
    if gamma is not None:
        if pairs:
            msg = "a camera's response is given as camera_response or camera_gamma, got both"
            raise ImageError(msg)
        check_gamma(gamma, "camera_gamma")
        return np.asarray(top * (levels / top) ** gamma)
    if not pairs:
        return None
    known = np.asarray(pairs, dtype=np.float64)
    rises = known.shape[0] > 1 and bool((np.diff(known, axis=0) > 0).all())
    if not rises or known[0, 0] != 0 or known[0, 1] < 0 or not np.isfinite(known).all():
        msg = (
            "camera_response needs two or more pairs of grey level and relative light, both rising "
            f"from grey level 0 and light 0 or more, got {[list(pair) for pair in pairs][:4]}"
        )
        raise ImageError(msg)
    last, slope = known[-1], np.diff(known[-2:], axis=0)[0]
    light = np.interp(levels, known[:, 0], known[:, 1])
    beyond = levels > last[0]
    light[beyond] = last[1] + (levels[beyond] - last[0]) * slope[1] / slope[0]
    return np.asarray(light * (top / light[-1]))


def check_gamma(gamma: float, name: str) -> None:
    """Refuse a gamma that no camera or projector has.

    Raises
    ------
    ImageError
        If it is not from 0.1 to 10.
    """
    if not 0.1 <= gamma <= 10:
        msg = f"{name} must be from 0.1 to 10 (2.2 is usual, 1 for none), got {gamma:g}"
        raise ImageError(msg)


def phase_correction(
    steps_deg: Sequence[float], gamma: float, contrast: float = 1.0
) -> NDArray[np.float64]:
    """Return what is to be added to the phase of a fringe whose projector has a gamma.

    Parameters
    ----------
    steps_deg : sequence of float, degrees
        Phase shifts of the fringe.
    gamma : float
        The projector's light is its input v = ½·(1 + contrast·cos(φ − δ_k)) to this power.
    contrast : float
        Of the fringe as it is sent to the projector.

    Returns
    -------
    (4097,) ndarray of float64, periods
        For measured phases from −½ to ½ period.

    Raises
    ------
    ImageError
        If the gamma bends the steps so much that two phases look alike.
    """
    steps = np.radians(np.asarray(steps_deg, dtype=np.float64))
    phase = np.arange(_PHASES) / _PHASES - 0.5
    angle = 2.0 * np.pi * phase[:, None] - steps
    light = (0.5 * (1.0 + contrast * np.cos(angle))) ** gamma
    design = np.column_stack([np.ones_like(steps), np.cos(steps), np.sin(steps)])
    _, cosine, sine = np.linalg.pinv(design) @ light.T
    error = np.arctan2(sine, cosine) / (2.0 * np.pi) - phase
    error -= np.rint(error)
    measured = phase + error
    if not (np.diff(measured, append=measured[0] + 1.0) > 0).all():
        msg = (
            f"with a projector's gamma of {gamma:g}, {len(steps)} steps at {list(steps_deg)} "
            "degrees measure the same phase in two places; use more steps, or linearise the "
            "projector"
        )
        raise ImageError(msg)
    wanted = np.linspace(-0.5, 0.5, _PHASES + 1)
    return np.asarray(-np.interp(wanted, measured, error, period=1.0))
