"""The summary: a few key numbers, and what the reader must know before believing them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from exposight.demo import NOMINAL_EXPOSURE_MS
from exposight.report.markup import escape, exact, model_name, number
from exposight.report.selection import model_results, named_result

if TYPE_CHECKING:
    from collections.abc import Iterator

    from exposight.demo import DemoResult, ModelResult

__all__ = ["summary"]


@dataclass(frozen=True, kw_only=True)
class _Key:
    """One number of a card: value and unit as HTML, and what it is of."""

    value: str
    unit: str
    meaning: str


@dataclass(frozen=True, kw_only=True)
class _Card:
    """A card: its title, and one or two numbers."""

    title: str
    keys: tuple[_Key, ...]


def summary(result: DemoResult) -> str:
    """Return the summary's cards and sentences."""
    cards = "".join(_card(card) for card in _cards(result) if card.keys)
    return f'<div class="cards">{cards}</div>\n{_sentences(result)}'


def _cards(result: DemoResult) -> Iterator[_Card]:
    yield _Card(
        title="Median distance to the authors’ cloud",
        keys=tuple(
            _Key(
                value=exact(own.agreement.median_mm, number(own.agreement.median_mm, 2)),
                unit="mm",
                meaning=escape(own.title),
            )
            for own in result.checks
        ),
    )
    yield _Card(
        title="<i>p</i><sub>norm</sub> RMSE on unseen features",
        keys=tuple(_quality_keys(result)),
    )
    yield _Card(
        title="Exposure-time RMSE on unseen features",
        keys=tuple(_exposure_keys(result)),
    )
    yield _Card(
        title="Measured over the exposure sweep",
        keys=(
            _Key(value=exact(len(result.views), str(len(result.views))), unit="",
                 meaning="features"),
            _Key(
                value=exact(len(result.table.measured()), str(len(result.table.measured()))),
                unit="",
                meaning="observations",
            ),
        ),
    )  # fmt: skip
    yield _Card(
        title="Overlap of unseen with training rings",
        keys=(
            _Key(
                value=exact(result.overlap, number(100 * result.overlap, 2)),
                unit="%",
                meaning="of their pixels: errors are optimistic",
            ),
        ),
    )


def _quality_keys(result: DemoResult) -> Iterator[_Key]:
    for name, meaning in (("q_k1", "brightness alone"), ("q_k4", "brightness and position")):
        own = named_result(result, name)
        if own is not None:
            percent = 100 * own.unseen.score.rmse
            yield _Key(
                value=exact(own.unseen.score.rmse, number(percent)),
                unit="%",
                meaning=f"{model_name(name)}, {meaning}",
            )


def _exposure_keys(result: DemoResult) -> Iterator[_Key]:
    results = model_results(result, "exposure_ms")
    if not results:
        return
    best = min(results, key=lambda own: own.unseen.score.rmse)
    own = named_result(result, "e_k6")
    if own is not None and own is not best:
        yield _exposure_key(own, "brightness and pose")
    yield _exposure_key(best, f"lowest of {len(results)} models")


def _exposure_key(result: ModelResult, meaning: str) -> _Key:
    rmse = result.unseen.score.rmse
    return _Key(
        value=exact(rmse, number(rmse)),
        unit="ms",
        meaning=f"{model_name(result.model.specification.name)}, {meaning}",
    )


def _card(card: _Card) -> str:
    keys = "".join(
        f'<p><span class="value">{key.value}<span class="unit"> {key.unit}</span></span> '
        f'<span class="meaning">{key.meaning}</span></p>'
        for key in card.keys
    )
    return f'<div class="card"><h3>{card.title}</h3>{keys}</div>'


def _sentences(result: DemoResult) -> str:
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
