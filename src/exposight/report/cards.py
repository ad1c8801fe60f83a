"""Cards of key numbers, and those that every demonstration has."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from exposight.report.markup import exact, model_name, number
from exposight.report.selection import model_results, named_result

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from exposight.demo import DemoResult, ModelResult


@dataclass(frozen=True, kw_only=True)
class Key:
    """One number of a card: value and unit as HTML, and what it is of."""

    value: str
    unit: str
    meaning: str


@dataclass(frozen=True, kw_only=True)
class Card:
    """A card: its title, and one or two numbers."""

    title: str
    keys: tuple[Key, ...]


def cards(items: Iterable[Card]) -> str:
    """Return cards as HTML; those without a number are left out."""
    return f'<div class="cards">{"".join(_card(item) for item in items if item.keys)}</div>\n'


def count_key(value: int, meaning: str) -> Key:
    """Return a whole number of things."""
    return Key(value=exact(value, str(value)), unit="", meaning=meaning)


def model_cards(result: DemoResult) -> Iterator[Card]:
    """Yield a card of the quality models and one of the exposure-time models."""
    yield Card(
        title="<i>p</i><sub>norm</sub> RMSE on unseen features",
        keys=tuple(_quality_keys(result)),
    )
    yield Card(
        title="Exposure-time RMSE on unseen features",
        keys=tuple(_exposure_keys(result)),
    )


def _quality_keys(result: DemoResult) -> Iterator[Key]:
    for name, meaning in (("q_k1", "brightness alone"), ("q_k4", "brightness and position")):
        own = named_result(result, name)
        if own is not None:
            percent = 100 * own.unseen.score.rmse
            yield Key(
                value=exact(own.unseen.score.rmse, number(percent)),
                unit="%",
                meaning=f"{model_name(name)}, {meaning}",
            )


def _exposure_keys(result: DemoResult) -> Iterator[Key]:
    plain = named_result(result, "e_k1")
    if plain is not None:
        yield _exposure_key(plain, "brightness alone")
    results = model_results(result, "exposure_ms")
    best = min(results, key=lambda own: own.unseen.score.rmse, default=None)
    if best is not None and best is not plain:
        yield _exposure_key(best, f"lowest of {len(results)} models")


def _exposure_key(result: ModelResult, meaning: str) -> Key:
    rmse = result.unseen.score.rmse
    return Key(
        value=exact(rmse, number(rmse)),
        unit="ms",
        meaning=f"{model_name(result.model.name)}, {meaning}",
    )


def _card(card: Card) -> str:
    keys = "".join(
        f'<p><span class="value">{key.value}<span class="unit"> {key.unit}</span></span> '
        f'<span class="meaning">{key.meaning}</span></p>'
        for key in card.keys
    )
    return f'<div class="card"><h3>{card.title}</h3>{keys}</div>'
