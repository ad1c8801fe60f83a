"""What was counted in the rings of features, against what can be counted there."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from exposight.contradictions.contradiction import Contradiction

TOO_MANY, ELSEWHERE = "more-points-than-pixels", "points-elsewhere"

P_NORM_MAX = 1.1
"""A ring's pixels give at most a point each; the rest is for pixels cut by the ring's border."""
_ENOUGH_PIXELS = 100
"""The border cuts a few of a ring's pixels; below so many, that may be more than a tenth."""


_MATCHED_MAX = 1.25
"""Of one ring, where points are matched: windows of pixels smear depth, which moves points into a
tilted ring (the most seen in 256 simulated captures is 1.18)."""


def too_many_points(
    p_norm: NDArray[np.float64],
    n_pixels: NDArray[np.float64],
    names: Sequence[str],
    *,
    matched: bool = False,
) -> Contradiction | None:
    """Check that no ring has more points than pixels.

    Parameters
    ----------
    p_norm : (n,) ndarray
        Points over pixels; NaN where not measured.
    n_pixels : (n,) ndarray
        Pixels of each ring; NaN where not known.
    names : sequence of str
        Of the features.
    matched : bool
        True where the points come of two images that were matched.
    """
    measured = np.isfinite(p_norm)
    large = measured & ~(n_pixels < _ENOUGH_PIXELS)
    over = large & (p_norm > P_NORM_MAX)
    if not over.any():
        return None
    everywhere = 2 * int(over.sum()) > int(large.sum())
    if matched and not everywhere:
        over &= p_norm > _MATCHED_MAX
        if not over.any():
            return None
    which = dict.fromkeys(name for name, is_over in zip(names, over, strict=True) if is_over)
    most = ", ".join(list(which)[:4]) + (" and others" if len(which) > 4 else "")
    return Contradiction(
        check=TOO_MANY,
        compared="the points counted in a feature's ring against its pixels",
        found=(
            f"p_norm reaches {float(p_norm[over].max()):.2f} in {int(over.sum())} of "
            f"{int(large.sum())} rings ({most}), and no pixel gives more than one point"
        ),
        explanation=(
            "is the camera that of the image, the cloud of this image alone?"
            if everywhere
            else "is the normal of these features right? a tilted ring has fewer pixels"
        ),
        is_error=everywhere,
    )


_SEEN_SHARE = 0.5
"""Of a ring's pixels have a point: the sensor saw what is there."""
_NEARLY_NONE = 0.02
_MOST = 0.75
_ENOUGH_RINGS = 3
"""A clamp may stand before one feature or two."""


def points_elsewhere(
    seen_share: NDArray[np.float64],
    p_norm: NDArray[np.float64],
    off_mm: NDArray[np.float64],
) -> Contradiction | None:
    """Check that the points seen in rings' pixels lie where the features are said to be.

    Parameters
    ----------
    seen_share : (n,) ndarray
        Share of each ring's pixels that have a point, wherever it lies.
    p_norm : (n,) ndarray
        Share that lies in the feature's hollow cylinder.
    off_mm : (n,) ndarray, mm
        Median distance of the seen points from the feature's plane, NaN where none is seen;
        positive where they lie nearer to the sensor.
    """
    seen = seen_share >= _SEEN_SHARE
    if not seen.any() or seen.mean() < 0.5:
        return None
    missed = seen & (p_norm <= _NEARLY_NONE)
    if missed.sum() < _MOST * seen.sum():
        return None
    off = np.abs(off_mm[missed])
    nearer = float(np.mean(off_mm[missed] > 0))
    way = "nearer" if nearer > 0.8 else "farther" if nearer < 0.2 else "nearer or farther"
    return Contradiction(
        check=ELSEWHERE,
        compared="the points seen where features are expected, against the features' places",
        found=(
            f"in {int(missed.sum())} of {int(seen.sum())} rings points are seen, but none in the "
            f"hollow cylinder: they lie {float(np.median(off)):.3g} mm {way} (median)"
        ),
        explanation="is the part where the pose says, and is that camera_from_part in mm?",
        is_error=int(missed.sum()) >= _ENOUGH_RINGS,
    )
