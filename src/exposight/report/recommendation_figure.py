"""A picture of which exposures to take: the features' windows, and the times that serve them."""

import textwrap
from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from exposight.planning import FeatureOutlook, Recommendation
from exposight.quantities import QUANTITIES
from exposight.report.figures import Still, draw_still, plain_axes
from exposight.report.palette import ACCENT, INK, OUTSIDE
from exposight.tables import number

_SURE, _MEDIAN = "#2d7f90", "#cfe1e5"
_FAILING, _FAILING_MEDIAN = "#d08a4e", "#f3e0cd"
_NOT_SETTABLE = "#eceff1"
_ROW_IN, _BAR = 0.21, 0.62
_NAMED = 60
"""More features than these have no names beside their rows."""
_REASON_WIDTH = 46
"""Characters of a line of reasons."""
_REASON_LINES = 2
_TICKS_MS = [0.01, 0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 50, 100, 200, 500, 1000, 2000, 5000]


def recommendation_picture(
    recommendation: Recommendation, achieved: Mapping[str, float] | None = None
) -> Still:
    """Draw each feature's exposure times as a bar, and the chosen times as lines.

    A bar's pale part is where the feature reaches the quality by the median, its dark part where
    it does with the confidence asked. A dot says which capture serves it. Features that will fail
    are drawn in another colour, with the reason; times that the sensor cannot be set to are
    grey.

    Parameters
    ----------
    recommendation : Recommendation
        What to draw.
    achieved : mapping of str to float, optional
        The best quality that was measured of each feature when the exposures were taken; it stands
        beside its row.
    """
    measured = achieved or {}
    rows = _ordered(recommendation)
    failing = any(row.status != "planned" for row in rows)
    named = len(rows) <= _NAMED

    def draw(figure: Figure) -> None:
        axes = figure.subplots()
        limits = _limits_ms(recommendation)
        sensor = recommendation.limits
        for low, high in ((limits[0], sensor.min_ms), (sensor.max_ms, limits[1])):
            if low < high:
                axes.axvspan(low, high, color=_NOT_SETTABLE, linewidth=0, zorder=0)
        for place, row in enumerate(rows):
            _draw_row(axes, recommendation, row, place, limits, measured, named=named)
            if row.feature in measured and named:
                _draw_achieved(axes, place, measured[row.feature], recommendation.need)
        if measured and named:
            axes.text(
                1.01, -0.95, "measured", transform=axes.get_yaxis_transform(), va="center",
                fontsize=7.5, color=INK,
            )  # fmt: skip
        for exposure_ms in recommendation.exposures_ms:
            axes.axvline(exposure_ms, color=INK, linewidth=1.3, zorder=3)
            axes.annotate(
                f"{number(exposure_ms)} ms", (exposure_ms, 1.0), (0, 4), ha="center", va="bottom",
                xycoords=axes.get_xaxis_transform(), textcoords="offset points",
                fontweight="bold", fontsize=8.5,
            )  # fmt: skip
        plain_axes(axes, _label(recommendation), "")
        axes.grid(visible=False, axis="y")
        axes.set(xscale="log", xlim=limits, ylim=(len(rows) - 0.4, -0.6))
        ticks = [tick for tick in _TICKS_MS if limits[0] <= tick <= limits[1]]
        axes.set_xticks(ticks, [f"{tick:g}" for tick in ticks])
        axes.minorticks_off()
        axes.set_yticks(range(len(rows)) if named else [], [r.feature for r in rows if named])
        axes.tick_params(axis="y", length=0)
        axes.spines["left"].set_visible(False)
        for label, row in zip(axes.get_yticklabels(), rows, strict=False):
            if row.status != "planned":
                label.set(color=OUTSIDE, fontweight="bold")
        _legend(figure, axes, recommendation, failing=failing)

    height = 1.35 + _ROW_IN * (len(rows) if named else 30)
    return draw_still("recommendation", recommendation.verdict, (8.2, height), draw)


def _ordered(recommendation: Recommendation) -> list[FeatureOutlook]:
    """Return the features from bright to dark, those without a window last."""
    middles = {
        name: float(np.sqrt(low * high)) if np.isfinite([low, high]).all() else np.inf
        for name, (low, high) in zip(
            recommendation.chances.features, recommendation.chances.windows_ms, strict=True
        )
    }
    return sorted(recommendation.features, key=lambda row: (middles[row.feature], row.feature))


def _run_ms(
    settings_ms: Sequence[float], chance: Sequence[float], least: float
) -> tuple[float, float] | None:
    """Return the exposure times about the best one at which a chance reaches a level."""
    best = int(np.argmax(chance))
    if chance[best] < least:
        return None
    first = last = best
    while first > 0 and chance[first - 1] >= least:
        first -= 1
    while last + 1 < len(chance) and chance[last + 1] >= least:
        last += 1
    return float(settings_ms[first]), float(settings_ms[last])


def _limits_ms(recommendation: Recommendation) -> tuple[float, float]:
    chances = recommendation.chances
    ends = chances.windows_ms[np.isfinite(chances.windows_ms)].tolist()
    ends = [*ends, *recommendation.exposures_ms] or chances.settings_ms[[0, -1]].tolist()
    return 0.8 * min(ends), 1.25 * max(ends)


def _draw_row(
    axes: Axes,
    recommendation: Recommendation,
    row: FeatureOutlook,
    place: int,
    limits_ms: tuple[float, float],
    measured: Mapping[str, float],
    *,
    named: bool,
) -> None:
    chances = recommendation.chances
    chance = chances.chance[chances.features.index(row.feature)].tolist()
    times = chances.settings_ms.tolist()
    fails = row.status != "planned"
    for span, colour, height in (
        (row.window_ms or _run_ms(times, chance, 0.5), _FAILING_MEDIAN if fails else _MEDIAN, _BAR),
        (_run_ms(times, chance, recommendation.confidence), _FAILING if fails else _SURE, _BAR),
    ):
        if span is not None:
            low, high = np.clip(span, *limits_ms)
            axes.barh(
                place, max(high - low, 0.01 * low), left=low, height=height, color=colour,
                linewidth=0, zorder=2,
            )  # fmt: skip
    if row.exposure_ms is not None:
        axes.plot(
            row.exposure_ms, place, "o", color="white", markeredgecolor=OUTSIDE if fails else INK,
            markersize=4.5, markeredgewidth=1.1, zorder=4,
        )  # fmt: skip
    if fails and named:
        lines = textwrap.wrap(row.reason, _REASON_WIDTH)
        if len(lines) > _REASON_LINES:
            lines = [*lines[: _REASON_LINES - 1], f"{lines[_REASON_LINES - 1]} …"]
        left = 1.07 if row.feature in measured else 1.01
        axes.text(
            left, place, "\n".join(lines), transform=axes.get_yaxis_transform(), va="center",
            color=OUTSIDE, fontsize=6.5, linespacing=0.95,
        )  # fmt: skip


def _draw_achieved(axes: Axes, place: int, quality: float, need: float) -> None:
    good = quality >= need
    axes.text(
        1.01, place, f"{quality:.2f}", transform=axes.get_yaxis_transform(), va="center",
        fontsize=7.5, color=_SURE if good else OUTSIDE, fontweight="normal" if good else "bold",
    )  # fmt: skip


def _label(recommendation: Recommendation) -> str:
    label = QUANTITIES["exposure_ms"].axis_math
    if not recommendation.hidden:
        return label
    hidden = textwrap.wrap(f"not seen: {', '.join(recommendation.hidden)}", 90)
    return "\n".join((label, *hidden[:3], *(["…"] if len(hidden) > 3 else [])))


def _legend(figure: Figure, axes: Axes, recommendation: Recommendation, *, failing: bool) -> None:
    share = f"{100 * recommendation.confidence:g} %"
    is_p_norm = recommendation.target == "p_norm"
    need = (
        f"{QUANTITIES['p_norm'].math} ≥ {recommendation.need:g}"
        if is_p_norm
        else recommendation.wish
    )
    bars = [
        (_MEDIAN, f"{need} by the median"),
        (_SURE, f"with {share} or more"),
        *([(_FAILING, "will fail, or may")] if failing else []),
    ]
    handles = [axes.barh(0, 0, color=colour, label=text) for colour, text in bars]
    dot = axes.plot([], [], "o", color="white", markeredgecolor=INK, label="capture that serves it")
    figure.legend(handles=[*handles, *dot], loc="outside lower center", ncols=4)
    axes.set_title(
        recommendation.verdict, loc="left", color=ACCENT, fontweight="bold", fontsize=8.5, pad=20
    )
