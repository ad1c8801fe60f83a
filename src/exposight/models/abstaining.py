"""Why a ring's forecast should not be relied on: what was learnt does not reach it."""

from __future__ import annotations

import polars as pl

FAR = 1.0
"""Learnt length scales beyond which nothing was learnt."""

CURVED = (
    "a sphere's cap is curved, and what was learnt holds of flat rings; a trial capture shows it"
)


def curved(frame: pl.DataFrame) -> frozenset[str]:
    """Return the features of a frame whose measured surface is not flat."""
    if "kind" not in frame.columns:
        return frozenset()
    return frozenset(frame["feature"].filter(frame["kind"] == "sphere"))


def far_away(distance: float, telling_ms: float | None = None) -> str:
    """Say that nothing was learnt near a ring, and what capture would help; else nothing."""
    if distance <= FAR:
        return ""
    at = "" if telling_ms is None else f" at about {telling_ms:.3g} ms"
    return (
        f"{distance:.1f} length scales from anything learnt; a capture of this view{at} would tell"
    )
