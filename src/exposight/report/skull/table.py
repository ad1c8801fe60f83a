"""The table of decoded pixels, and how far the clouds agree with the authors' own."""

from __future__ import annotations

from typing import TYPE_CHECKING

from exposight.report.markup import Heading, count_cell, escape, exact, number, table

if TYPE_CHECKING:
    from exposight.demo import SkullResult


def decoding_table(result: SkullResult) -> str:
    """Return the table of decoded pixels and of the agreement with the authors' cloud."""
    headings = (
        Heading(text="sequence", is_text=True),
        *(
            Heading(text=text, group="pixels")
            for text in ("decoded", "low modulation", "clipped", "ambiguous", "all")
        ),
        *(
            Heading(text=text, group="distance to the authors’ cloud")
            for text in ("common points", "median, mm", "90 %, mm")
        ),
        Heading(text="time, s"),
    )
    rows = []
    for check in result.checks:
        counts, agreement = check.counts, check.agreement
        pixels = (
            counts.decoded, counts.low_modulation, counts.clipped, counts.ambiguous, counts.pixels,
        )  # fmt: skip
        rows.append(
            [
                escape(check.title),
                *(count_cell(own) for own in pixels),
                count_cell(agreement.common_points),
                exact(agreement.median_mm, number(agreement.median_mm)),
                exact(agreement.p90_mm, number(agreement.p90_mm)),
                exact(check.seconds, number(check.seconds, 2)),
            ]
        )
    caption = (
        "<b>Decoding.</b> A pixel may carry several flags; most pixels with low modulation are "
        "the unlit background. Both sequences are held against the cloud that the recording’s "
        "authors made of the Gray code; 90 % is the 90th percentile. Time is from frames to cloud."
    )
    return table(headings, rows, name="decoding", caption=caption)
