"""The skull's summary: a few key numbers, and what the reader must know before believing them."""

from __future__ import annotations

from typing import TYPE_CHECKING

from exposight.demo import NOMINAL_EXPOSURE_MS
from exposight.report.cards import Card, Key, cards, count_key, model_cards
from exposight.report.markup import escape, exact, number

if TYPE_CHECKING:
    from collections.abc import Iterator

    from exposight.demo import SkullResult


def skull_summary(result: SkullResult) -> str:
    """Return the summary's cards and sentences."""
    return cards(_cards(result)) + _sentences(result)


def _cards(result: SkullResult) -> Iterator[Card]:
    yield Card(
        title="Median distance to the authors’ cloud",
        keys=tuple(
            Key(
                value=exact(own.agreement.median_mm, number(own.agreement.median_mm, 2)),
                unit="mm",
                meaning=escape(own.title),
            )
            for own in result.checks
        ),
    )
    yield from model_cards(result)
    yield Card(
        title="Measured over the exposure sweep",
        keys=(
            count_key(len(result.views), "features"),
            count_key(len(result.table.measured()), "observations"),
        ),
    )
    yield Card(
        title="Overlap of unseen with training rings",
        keys=(
            Key(
                value=exact(result.overlap, number(100 * result.overlap, 2)),
                unit="%",
                meaning="of their pixels: errors are optimistic",
            ),
        ),
    )


def _sentences(result: SkullResult) -> str:
    exposures = result.settings.exposures_ms()
    return (
        '<ul class="notes">\n'
        "<li>This page follows the whole method once on real stripe images of a skull: stripes "
        "are decoded to a point cloud, ring features are placed on its surface and measured, and "
        "Gaussian processes learn from half of the features what they then predict for the other "
        "half.</li>\n"
        "<li><strong>The exposure sweep is emulated</strong> from one recorded exposure, which "
        f"counts as a nominal {number(NOMINAL_EXPOSURE_MS, 2)} ms because the true one was not "
        f"handed down: for {number(exposures[0])} to {number(exposures[-1])} ms, its grey values "
        "are scaled, rounded and clipped, so the camera’s noise is scaled with them instead of "
        "being drawn anew.</li>\n"
        "<li><strong>The figures are optimistic</strong>: all features lie in one static view and "
        "a random half of them trained, so unseen rings share "
        f"{number(100 * result.overlap, 2)} % of their pixels with training rings.</li>\n</ul>\n"
    )
