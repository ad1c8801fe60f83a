"""Where a capture's points are, against where its features and its image say that they are."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from exposight.contradictions.contradiction import Contradiction

NO_HOLE, SMALL, OFF_PLANE, OUTSIDE, DARK = (
    "no-hole",
    "small-features",
    "points-off-plane",
    "outside-image",
    "points-in-the-dark",
)

_FILLED = 0.5
"""Of a hole's inner pixels see the surface, at most: a rim that is seen obliquely fills less."""
_EMPTY = 0.1
HALVED = "half as large they are holes: are the radii diameters?"
_FEWEST_CLOSED = 2
"""A single hole may have a plug, or a ground just below the surface; most of a view's have not."""
_FEWEST = 3


def holes(
    filled: NDArray[np.float64], half_filled: NDArray[np.float64], names: Sequence[str]
) -> Contradiction | None:
    """Check that there are holes where holes are said to be.

    Parameters
    ----------
    filled : (n,) ndarray
        Share of each hole's inner pixels that see the surface round it; NaN where not measured.
    half_filled : (n,) ndarray
        The same of a hole half as large: of one whose diameter was taken for its radius.
    names : sequence of str
        Of the features.
    """
    known = np.isfinite(filled)
    closed = known & (filled > _FILLED)
    n_closed, n_known = int(closed.sum()), int(known.sum())
    if n_closed < _FEWEST_CLOSED or 2 * n_closed <= n_known:
        return None
    which = [name for name, is_closed in zip(names, closed, strict=True) if is_closed]
    most = ", ".join(which[:4]) + (" and others" if n_closed > 4 else "")
    halved = float(np.median(half_filled[closed])) < _EMPTY
    return Contradiction(
        check=NO_HOLE,
        compared="the surface seen where features are said to be holes, against a hole",
        found=f"{n_closed} of {n_known} holes are filled with points of the surface ({most})",
        explanation=(
            HALVED
            if halved
            else "are features and pose those of this part, their places and radii in mm, x and y "
            "in their order, the pose not the inverse one?"
        ),
        is_error=False,
    )


_SMALL_MM = 0.5
"""Radius of holes that sensors with rings of 5 mm width are not asked about."""


def small_features(radius_mm: NDArray[np.float64]) -> Contradiction | None:
    """Check that the radii (n,) of features of any size, 0 for those without, are in mm."""
    sized = radius_mm[radius_mm > 0]
    if sized.size == 0 or float(sized.max()) >= _SMALL_MM:
        return None
    return Contradiction(
        check=SMALL,
        compared="the features' radii against what is measured by points round them",
        found=f"none is above {float(sized.max()):.3g} mm",
        explanation="are the features in m or inches? lengths are in mm",
        is_error=False,
    )


_OFF_MM = 4.0
"""Sheets are up to 2 or 3 mm thick, and either side of them may be meant by a feature's place."""


def off_plane(off_mm: NDArray[np.float64]) -> Contradiction | None:
    """Check that rings' points lie in their features' planes.

    Parameters
    ----------
    off_mm : (n,) ndarray, mm
        Median distance of the points in each hollow cylinder from the feature's plane, positive
        where they lie nearer to the sensor; NaN where there are few.
    """
    known = off_mm[np.isfinite(off_mm)]
    if known.size < _FEWEST:
        return None
    middle = float(np.median(known))
    alike = float(np.median(np.abs(known - middle)))
    if abs(middle) <= _OFF_MM or alike > 0.5 * abs(middle):
        return None
    way = "nearer to the sensor" if middle > 0 else "farther from the sensor"
    return Contradiction(
        check=OFF_PLANE,
        compared="the points in features' rings, against the features' planes",
        found=f"they lie {abs(middle):.3g} mm {way} in all rings alike",
        explanation="is the pose that of this capture, are the features on the side that is seen?",
        is_error=False,
    )


_ENOUGH_POINTS, _INSIDE = 1000, 0.9


def outside_image(n_inside: int, n_points: int) -> Contradiction | None:
    """Check that the points of a cloud project into the image.

    Parameters
    ----------
    n_inside, n_points : int
        Points that do, and points.
    """
    inside = n_inside / max(n_points, 1)
    if n_points < _ENOUGH_POINTS or inside >= _INSIDE:
        return None
    return Contradiction(
        check=OUTSIDE,
        compared="where a cloud's points project to, against the image",
        found=f"{100 * (1 - inside):.0f} % of them lie outside of it",
        explanation="is the cloud in the camera's frame and in mm, and is the camera, at this "
        "resolution, that of the image?",
        is_error=inside < 0.5,
    )


_BLACK, _DENSE = 1.5, 0.5
"""Grey levels of 255 at which stripes cannot be told, and a p_norm that asks for light."""


def points_in_the_dark(
    i_avg: NDArray[np.float64], p_norm: NDArray[np.float64]
) -> Contradiction | None:
    """Check that rings with points are lit.

    Parameters
    ----------
    i_avg : (n,) ndarray
        Mean grey level of each ring, 0–255.
    p_norm : (n,) ndarray
        Share of its pixels that have points.
    """
    known = np.isfinite(i_avg) & np.isfinite(p_norm)
    dense = known & (p_norm > _DENSE)
    dark = dense & (i_avg < _BLACK)
    if not dark.any() or 2 * int(dark.sum()) <= int(dense.sum()):
        return None
    return Contradiction(
        check=DARK,
        compared="the image's brightness where points were measured, against light",
        found=(
            f"{int(dark.sum())} of {int(dense.sum())} dense rings are black, grey level "
            f"{float(np.median(i_avg[dark])):.2g} of 255"
        ),
        explanation="is the image that of this capture, taken with light, and its bit depth right?",
        is_error=False,
    )
