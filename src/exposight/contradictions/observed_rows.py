"""Rows of an observation table against what can be observed, wherever the table was made."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from exposight.contradictions.contradiction import Contradiction
from exposight.contradictions.rings import too_many_points

EXPOSURE_UNIT, ANGLE_UNIT = "exposure-unit", "angle-unit"
SHARE_UNIT, GREY_SCALE = "share-unit", "grey-scale"

_SHORTEST_MS, _LONGEST_MS = 0.1, 1000.0
"""Exposure times between which sensors of structured light take all of a sweep, as a rule."""
_UNITS = (("s", 1e3, "multiply"), ("µs", 1e-3, "divide"))

_PERCENT = (80.0, 125.0)
"""How often p_norm may be n_points over n_pixels to be percent."""
_MATTERS = 0.05
"""An angle that is more than noise, in degrees or radians."""
_ENOUGH = 5
"""Rows that tell something."""
_BETTER = 0.5
"""Of the difference in degrees, what the one in radians must be below to be right."""


def row_contradictions(
    p_norm: NDArray[np.float64],
    n_pixels: NDArray[np.float64],
    exposure_ms: NDArray[np.float64],
    names: Sequence[str],
    *,
    n_points: NDArray[np.float64] | None = None,
    i_avg: NDArray[np.float64] | None = None,
    turned_deg: NDArray[np.float64] | None = None,
    incidence_deg: NDArray[np.float64] | None = None,
) -> tuple[Contradiction, ...]:
    """Hold the rows of a table against what can be observed.

    Parameters
    ----------
    p_norm, n_pixels, exposure_ms : (n,) ndarray
        Points over pixels, pixels of the ring, exposure time in ms; NaN where not known.
    names : sequence of str
        Of the features.
    n_points, i_avg : (n,) ndarray, optional
        Points in the hollow cylinder, and mean grey value of the ring.
    turned_deg : (n, 3) ndarray, degrees, optional
        w, p and r.
    incidence_deg : (n,) ndarray, degrees, optional
        Between the camera's ray and the feature's normal.
    """
    found = [
        share_unit(p_norm, n_points, n_pixels),
        exposure_unit(exposure_ms),
        None if i_avg is None else grey_scale(i_avg, p_norm),
    ]
    if found[0] is None:
        found[0] = _percent_said(too_many_points(p_norm, n_pixels, names), p_norm)
    if turned_deg is not None:
        found.append(angle_unit(turned_deg, incidence_deg))
    return tuple(each for each in found if each is not None)


def share_unit(
    p_norm: NDArray[np.float64],
    n_points: NDArray[np.float64] | None,
    n_pixels: NDArray[np.float64],
) -> Contradiction | None:
    """Check that p_norm is a share, as n_points over n_pixels is, and not percent."""
    if n_points is None:
        return None
    with np.errstate(divide="ignore", invalid="ignore"):
        times = p_norm / (n_points / n_pixels)
    times = times[np.isfinite(times) & (p_norm > 0)]
    if times.size < _ENOUGH or not _PERCENT[0] <= np.median(times) <= _PERCENT[1]:
        return None
    return Contradiction(
        check=SHARE_UNIT,
        compared="p_norm against n_points over n_pixels",
        found=f"it is {float(np.median(times)):.0f} times as much (median of {times.size} rows)",
        explanation="p_norm is in percent: divide it by 100",
    )


def _percent_said(found: Contradiction | None, p_norm: NDArray[np.float64]) -> Contradiction | None:
    """Return a contradiction of too many points, with percent as what would explain it."""
    if found is None or np.nanmax(p_norm) <= 2.0:
        return found
    return replace(
        found, explanation=f"is p_norm in percent? divide it by 100. Else {found.explanation}"
    )


def grey_scale(i_avg: NDArray[np.float64], p_norm: NDArray[np.float64]) -> Contradiction | None:
    """Check that grey values are of 0–255, by rings that were seen though they would be black."""
    seen = np.isfinite(i_avg) & (p_norm > 0.5)
    if seen.sum() < _ENOUGH or not 0.0 < np.nanmax(i_avg) <= 1.0:
        return None
    return Contradiction(
        check=GREY_SCALE,
        compared="the table's grey values against the points that were seen",
        found=(
            f"i_avg is {float(np.nanmax(i_avg)):.3g} of 255 at most, and {int(seen.sum())} rings "
            "have most of their points"
        ),
        explanation="are they of 0–1? multiply them by 255",
        is_error=False,
    )


def angle_unit(
    turned_deg: NDArray[np.float64], incidence_deg: NDArray[np.float64] | None = None
) -> Contradiction | None:
    """Check that angles are in degrees.

    The tilt of a feature's normal against the camera's axis follows from w and p; the angle to the
    camera's ray, where the table has it, is another by the ray's angle to the axis only.

    Parameters
    ----------
    turned_deg : (n, 3) ndarray, degrees
        w, p and r of the rows.
    incidence_deg : (n,) ndarray, degrees, optional
        Between the camera's ray and the feature's normal; NaN where not known.
    """
    turned = turned_deg[np.isfinite(turned_deg).all(axis=1)]
    if len(turned) < _ENOUGH:
        return None
    incidence = np.full(len(turned_deg), np.nan) if incidence_deg is None else incidence_deg
    incidence = incidence[np.isfinite(turned_deg).all(axis=1)]
    tilt = np.abs(turned[:, :2]).max(axis=1)
    small = tilt.max() <= np.pi / 2 and np.abs(turned[:, 2]).max() <= np.pi
    if small and tilt.max() > _MATTERS:
        off, as_radians = (
            _off(incidence, _tilt_deg(turned)),
            _off(incidence, _tilt_deg(np.degrees(turned))),
        )
        return _in_radians(
            "w_deg, p_deg and r_deg",
            f"none of w_deg and p_deg is more than {tilt.max():.3g}",
            off,
            as_radians,
        )
    known = incidence[np.isfinite(incidence)]
    if known.size >= _ENOUGH and _MATTERS < known.max() <= np.pi / 2:
        tilts = _tilt_deg(turned)
        off, as_radians = _off(incidence, tilts), _off(np.degrees(incidence), tilts)
        if as_radians < _BETTER * off:
            return _in_radians(
                "incidence_deg", f"none of it is more than {known.max():.3g}", off, as_radians
            )
    return None


def _tilt_deg(turned_deg: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the angles between features' normals and the camera's axis, (n,) degrees."""
    w, p = np.radians(turned_deg[:, :2].T)
    cosine: NDArray[np.float64] = np.clip(np.cos(w) * np.cos(p), -1.0, 1.0)
    return np.asarray(np.degrees(np.arccos(cosine)), dtype=np.float64)


def _off(incidence_deg: NDArray[np.float64], tilt_deg: NDArray[np.float64]) -> float:
    known = np.isfinite(incidence_deg)
    if known.sum() < _ENOUGH:
        return np.nan
    return float(np.median(np.abs(incidence_deg - tilt_deg)[known]))


def _in_radians(what: str, seen: str, off_deg: float, as_radians_deg: float) -> Contradiction:
    """Return the contradiction of angles that seem to be in radians."""
    told = as_radians_deg < _BETTER * off_deg
    evidence = (
        f", and incidence_deg is off the tilt by w and p by {off_deg:.3g}°, in radians by "
        f"{as_radians_deg:.3g}° (median)"
        if told
        else ""
    )
    return Contradiction(
        check=ANGLE_UNIT,
        compared=f"the table's angles {what} against those of a cell",
        found=f"{seen}{evidence}",
        explanation=(
            "they are in radians: multiply them by 180/π"
            if told
            else "are they in radians? multiply them by 180/π if so"
        ),
        is_error=bool(told),
    )


def exposure_unit(
    exposure_ms: NDArray[np.float64], limits_ms: tuple[float, float] | None = None
) -> Contradiction | None:
    """Check that exposure times are in ms.

    Parameters
    ----------
    exposure_ms : (n,) ndarray, ms
        Of a table's rows.
    limits_ms : (float, float), ms, optional
        The sensor's shortest and longest exposure time: where all times lie outside it is an
        error. Without them a warning tells of times that hardly any sensor takes.
    """
    times = exposure_ms[np.isfinite(exposure_ms)]
    if not times.size:
        return None
    low, high = float(times.min()), float(times.max())
    slack = 1e-6
    shortest, longest = limits_ms or (_SHORTEST_MS, _LONGEST_MS)
    outside = (times < shortest * (1 - slack)) | (times > longest * (1 + slack))
    if limits_ms is None and not (high < shortest or low > longest):
        return None
    if not outside.any():
        return None
    meant = next(
        (
            f"are they in {unit}? {verb} them by 1000"
            for unit, scale, verb in _UNITS
            if shortest <= low * scale * (1 + slack) and high * scale <= longest * (1 + slack)
        ),
        "check their unit, and the sensor",
    )
    whose = "those that the sensor takes" if limits_ms else "those that most sensors take"
    return Contradiction(
        check=EXPOSURE_UNIT,
        compared=f"the table's exposure times against {whose}",
        found=(
            f"{int(outside.sum())} of {times.size} rows have other times ({low:.4g} to {high:.4g} "
            f"ms) than {shortest:g} to {longest:g} ms"
        ),
        explanation=meant,
        is_error=limits_ms is not None and bool(outside.all()),
    )
