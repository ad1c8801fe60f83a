"""The page on which strategies are compared: who gets most with the fewest exposures."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, NullLocator

from exposight.files import write_durably
from exposight.planning import Comparison
from exposight.report.figures import Still, draw_still, plain_axes
from exposight.report.palette import ACCENT, INK, MUTED, OUTSIDE
from exposight.report.rendering import render_page
from exposight.tables import counted

_COLOURS = {"oracle": INK, "model": ACCENT, "rival": OUTSIDE}
_TICKS = (1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0, 15.0, 20.0)
_LINE_IN = 0.17
"""Height of a label's line."""


def write_comparison_page(comparison: Comparison, path: str | Path) -> None:
    """Write a comparison's page: one file that opens without a network.

    Raises
    ------
    FileError
        If it cannot be written.
    """
    write_durably(Path(path), comparison_page(comparison).encode())


def comparison_page(comparison: Comparison) -> str:
    """Return the page; the same comparison, the same page."""
    scores = comparison.scores.to_dicts()
    about = comparison.about
    return render_page(
        "comparison.html",
        title="Exposures compared",
        lead=f"{comparison.verdict}. On {comparison.sweep}: every outcome is known in "
        f"{counted(len(about['views']), 'view')}.",
        scores=sorted(scores, key=_order),
        drawing=comparison_still(scores),
        need=about["need"],
        pairs=about["pairs"],
        constants=about["constants"],
        confidence=about["confidence"],
        promises=any(score["promised"] is not None for score in scores),
        facts=tuple((name.replace("_", " "), _text(value)) for name, value in about.items()),
        sha256=comparison.sweep_sha256,
    )


def _order(score: dict[str, Any]) -> tuple[int, float]:
    return tuple(_COLOURS).index(score["kind"]), score["exposures"] + score["trial_images"]


def _text(value: Any) -> str:
    match value:
        case None:
            return "none"
        case dict():
            return ", ".join(f"{name} {each}" for name, each in value.items())
        case list():
            return ", ".join(map(str, value))
    return f"{value:g}" if isinstance(value, float) else str(value)


def comparison_still(scores: list[dict[str, Any]]) -> Still:
    """Draw the exposures that strategies take over the share of features that they cover.

    Each has its label at the right, joined to its mark by a line, so that none hides another; bars
    are 95 % intervals.
    """
    drawn = [each for each in scores if np.isfinite(each["exposures_over_oracle"] or np.nan)]
    drawn.sort(key=lambda each: (each["exposures_over_oracle"], each["covered_share"]))
    height = max(3.4, 0.9 + _LINE_IN * len(drawn))

    def draw(figure: Figure) -> None:
        axes, names = figure.subplots(1, 2, width_ratios=(3.0, 1.7))
        names.set_axis_off()
        names.set_xlim(0.0, 1.0)
        names.set_ylim(0.0, 1.0)
        most = max((each["exposures_over_oracle_high"] for each in drawn), default=1.0)
        least = min((each["covered_share_low"] for each in drawn), default=0.0)
        axes.set_yscale("log")
        axes.set_ylim(0.94, max(1.6, 1.08 * most))
        axes.set_xlim(100.0 * least - 3.0, 101.5)
        ticks = [tick for tick in _TICKS if tick <= max(1.6, 1.08 * most)]
        axes.yaxis.set_major_locator(FixedLocator(ticks))
        axes.yaxis.set_minor_locator(NullLocator())
        axes.yaxis.set_major_formatter(lambda value, _: f"{value:g}")
        low, high = np.log(axes.get_ylim())
        wanted = [(np.log(each["exposures_over_oracle"]) - low) / (high - low) for each in drawn]
        for each, place in zip(drawn, _apart(wanted, _LINE_IN / (height - 0.7)), strict=True):
            colour = _COLOURS[each["kind"]]
            x, y = 100.0 * each["covered_share"], each["exposures_over_oracle"]
            across = [
                [x - 100.0 * each["covered_share_low"]],
                [100.0 * each["covered_share_high"] - x],
            ]
            along = [
                [y - each["exposures_over_oracle_low"]],
                [each["exposures_over_oracle_high"] - y],
            ]
            axes.errorbar(
                x, y, xerr=np.maximum(across, 0.0), yerr=np.maximum(along, 0.0), fmt="o",
                color=colour, markersize=4.5, elinewidth=0.7, zorder=3,
            )  # fmt: skip
            label = names.annotate(
                each["strategy"], (x, y), xycoords=axes.transData, xytext=(0.0, place),
                textcoords=names.transData, va="center", color=colour, fontsize=8,
                fontweight="bold" if each["kind"] == "model" else "normal",
                arrowprops={"arrowstyle": "-", "color": MUTED, "linewidth": 0.4,
                            "shrinkB": 3, "relpos": (0.0, 0.5)},
                annotation_clip=False,
            )  # fmt: skip
            label.set_in_layout(False)  # it reaches from one panel into the other
        plain_axes(axes, "features covered (%)", "exposures and trial images over the oracle’s")

    return draw_still("strategies", "Exposures over features covered", (5.6, height), draw)


def _apart(wanted: list[float], gap: float) -> list[float]:
    """Return ascending places at least a gap apart, within 0 and 1 if they can be, near wishes."""
    places: list[float] = []
    for wish in wanted:
        places.append(max(wish, places[-1] + gap) if places else max(wish, 0.0))
    top = max(1.0, gap * (len(places) - 1))
    for i in reversed(range(len(places))):
        places[i] = min(places[i], top)
        top = places[i] - gap
    return places
