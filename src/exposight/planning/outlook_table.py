"""What becomes of features, as a frame, a table and remarks."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import polars as pl

from exposight.planning.outlook import FeatureOutlook
from exposight.tables import Column, Table


class _WhyNotPlanned(Column):
    """The reason of what is not planned; remarks give the others, together where alike."""

    def cell(self, row: Mapping[str, Any]) -> str:
        return super().cell(row) if row["status"] == "not planned" else ""


_COLUMNS = (
    Column(name="feature"),
    Column(name="status"),
    Column(name="view"),
    Column(name="exposure_ms", digits=4),
    Column(name="chance", label="chance\n%", decimals=1, scale=100.0),
    Column(name="window_low_ms", label="median window\nfrom, ms", digits=3),
    Column(name="window_high_ms", label="to\nms", digits=3),
    _WhyNotPlanned(name="reason", wraps=True),
)


def outlook_frame(features: Sequence[FeatureOutlook]) -> pl.DataFrame:
    """Return a row for each feature: columns as in `FeatureOutlook`, the window's ends apart."""
    windows = [each.window_ms or (None, None) for each in features]
    names = ("feature", "status", "chance", "view", "exposure_ms", "reason")
    types = {"view": pl.String, "exposure_ms": pl.Float64, "chance": pl.Float64}
    return pl.DataFrame(
        {name: [getattr(each, name) for each in features] for name in names},
        schema_overrides=types,
    ).with_columns(
        pl.Series("window_low_ms", [low for low, _ in windows], dtype=pl.Float64),
        pl.Series("window_high_ms", [high for _, high in windows], dtype=pl.Float64),
    )


def outlook_table(features: Sequence[FeatureOutlook], *, of_one_view: bool = False) -> Table:
    """Return the features, those that fail first."""
    frame = outlook_frame(features).with_columns(planned=pl.col("status") == "planned")
    left_out = {"view"} if of_one_view else set()
    if not any(each.reason for each in features if each.status == "not planned"):
        left_out.add("reason")
    return Table(
        name="features",
        frame=frame.sort("planned", "chance", "feature").drop("planned"),
        columns=tuple(column for column in _COLUMNS if column.name not in left_out),
    )


def failures(
    features: Sequence[FeatureOutlook], hidden: Mapping[str, str] | None = None
) -> tuple[str, ...]:
    """Return why features that are tried may fail, reasons that are alike together.

    Of those that are not planned the table says it (`outlook_table`).

    Parameters
    ----------
    features : sequence of FeatureOutlook
    hidden : mapping of str to str, optional
        Features that are not seen, and why.
    """
    reasons: dict[str, list[str]] = {}
    for each in features:
        if each.reason and each.status != "not planned":
            chance = f" ({100 * each.chance:.0f} %)" if each.status == "best effort" else ""
            reasons.setdefault(each.reason, []).append(f"{each.feature}{chance}")
    for name, reason in (hidden or {}).items():
        reasons.setdefault(f"not seen, {reason}", []).append(name)
    return tuple(f"{', '.join(names)}: {reason}" for reason, names in reasons.items())


def who_fails(features: Sequence[FeatureOutlook]) -> str:
    """Return the first of those that do not reach the confidence, in a phrase; empty if all do."""
    failing = [each for each in features if each.status != "planned"]
    if not failing:
        return ""
    if len(failing) == 1:
        (one,) = failing
        return f"{one.feature} fails" + (f" because {one.reason}" if one.reason else "")
    first, second = failing[0].feature, failing[1].feature
    if len(failing) == 2:
        return f"{first} and {second} fail"
    return f"{first}, {second} and {len(failing) - 2} more fail"
