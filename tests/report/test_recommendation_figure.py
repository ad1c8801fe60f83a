"""The picture of a recommendation: drawn for few and many features, with and without an answer."""

import numpy as np
import pytest

from exposight.planning import CaptureChances, ExposureLimits, recommend
from exposight.report import recommendation_picture

LIMITS = ExposureLimits(name="x", min_ms=2.0, max_ms=160.0, increment_ms=1.0)


def chosen(windows_ms, **hidden):
    """Recommend exposures for windows."""
    chances = CaptureChances.of_windows(
        windows_ms,
        LIMITS.settings(2.0, 160.0),
        features=[f"h{number}" for number in range(len(windows_ms))],
        std=0.05,
    )
    return recommend(chances, LIMITS, hidden=hidden)


@pytest.mark.parametrize(
    "windows_ms",
    [
        [(5.0, 20.0), (60.0, 150.0)],
        [(5.0, 20.0), (12.0, 12.4), (500.0, 900.0), (np.nan, np.nan)],
        [(np.nan, np.nan)],
        [(300.0, 900.0)],
        [(5.0 + place, 30.0 + 2 * place) for place in range(100)],
    ],
    ids=["two served", "failing", "no window", "none served", "a hundred"],
)
def test_it_is_drawn_the_same_every_time(windows_ms):
    recommendation = chosen(windows_ms, far="out of frame")
    still = recommendation_picture(recommendation)
    assert still.title == recommendation.verdict
    assert still.png.startswith(b"\x89PNG")
    assert still.svg == recommendation_picture(recommendation).svg


def test_features_that_fail_have_a_colour_of_their_own():
    served, failing = (
        recommendation_picture(chosen([window])).svg for window in ((5.0, 20.0), (12.0, 12.4))
    )
    assert b"#f3e0cd" in failing
    assert b"#f3e0cd" not in served
