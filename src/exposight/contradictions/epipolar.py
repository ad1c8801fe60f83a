"""Rows of a rectified pair: a point lies on the same row of either image, or nothing fits."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from exposight.contradictions.contradiction import Contradiction

ROWS = "rows"

_MOST_PX = 1.0
"""Calibrated pairs are right to some tenths of a pixel; matchers bear about a pixel."""
_FEWEST_MATCHES = 12
"""Fewer say nothing."""
_FITTING_SHARE = 0.5
"""Of the points looked for, so many must be found on their row for an explanation to fit."""


def rows_correspond(
    row_offsets_px: NDArray[np.floating],
    looked_for: int,
    explanations: Mapping[str, float] | None = None,
) -> Contradiction | None:
    """Check that matches lie on the same rows of both rectified images.

    Parameters
    ----------
    row_offsets_px : (n,) ndarray, px
        How far below the row of its point in the first image each match lies in the second.
    looked_for : int
        How many points were looked for.
    explanations : mapping of str to float, optional
        What was tried, with the share of points that are then found on their row.

    Returns
    -------
    Contradiction or None
        An error where the median distance is above a pixel, or hardly any point was found and an
        explanation finds them.
    """
    compared = "rows of the first image against rows of the second, both rectified"
    fitting = max((explanations or {}).items(), key=lambda item: item[1], default=("", 0.0))
    explanation = (
        f"{fitting[0]} fits: {fitting[1]:.0%} of the points are found on their row"
        if fitting[1] >= _FITTING_SHARE
        else "check that both images and the calibration belong together, and that the images are "
        "what --raw or --rectified says"
    )
    if len(row_offsets_px) >= _FEWEST_MATCHES:
        apart_px = float(np.median(np.abs(row_offsets_px)))
        if apart_px > _MOST_PX:
            return Contradiction(
                check=ROWS,
                compared=compared,
                found=(
                    f"the median of {len(row_offsets_px)} matches lies {apart_px:.1f} px off its "
                    f"row ({np.percentile(row_offsets_px, 5):+.1f} to "
                    f"{np.percentile(row_offsets_px, 95):+.1f} px)"
                ),
                explanation=explanation,
            )
        if len(row_offsets_px) >= _FITTING_SHARE * looked_for:
            return None
    if fitting[1] >= _FITTING_SHARE:
        return Contradiction(
            check=ROWS,
            compared=compared,
            found=f"of {looked_for} points only {len(row_offsets_px)} were found where they can be",
            explanation=explanation,
        )
    return None
