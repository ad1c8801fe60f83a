"""Where names stand in a drawing: beside their rings, clear of other rings and names."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Sequence


_LETTER_MM = 11.0
_LINE_MM = 24.0
"""A letter's width and a line's height, as large as they are on the part at first."""
_GAP_MM = 4.0

Box = tuple[float, float, float, float]


@dataclass(frozen=True, kw_only=True)
class Ring:
    """A ring as it is drawn, and its name.

    Parameters
    ----------
    name : str
        As it is read.
    x_mm, y_mm : float
        Its centre, right and down.
    radius_mm : float
        Its outer radius.
    """

    name: str
    x_mm: float
    y_mm: float
    radius_mm: float


@dataclass(frozen=True, kw_only=True)
class Label:
    """Where a name stands.

    Parameters
    ----------
    x_mm, y_mm : float
        The point at which it is anchored, right and down.
    position : str
        Where it stands to that point, in plotly's words.
    """

    x_mm: float
    y_mm: float
    position: str


def label_places(rings: Sequence[Ring]) -> list[Label]:
    """Return where each ring's name covers least of other rings and of names placed before.

    Above is preferred, then below, right and left.
    """
    taken: list[Box] = []
    labels = []
    for index, ring in enumerate(rings):
        others = [_square(own) for place, own in enumerate(rings) if place != index]
        candidates = _candidates(ring)
        covered = [
            sum(_overlap(box, other) for other in (*others, *taken)) for _, box in candidates
        ]
        label, box = candidates[covered.index(min(covered))]
        labels.append(label)
        taken.append(box)
    return labels


def _candidates(ring: Ring) -> list[tuple[Label, Box]]:
    x, y, away = ring.x_mm, ring.y_mm, ring.radius_mm + _GAP_MM
    width, height = _LETTER_MM * len(ring.name), _LINE_MM
    return [
        (
            Label(x_mm=x, y_mm=y - away, position="top center"),
            (x - width / 2, y - away - height, x + width / 2, y - away),
        ),
        (
            Label(x_mm=x, y_mm=y + away, position="bottom center"),
            (x - width / 2, y + away, x + width / 2, y + away + height),
        ),
        (
            Label(x_mm=x + away, y_mm=y, position="middle right"),
            (x + away, y - height / 2, x + away + width, y + height / 2),
        ),
        (
            Label(x_mm=x - away, y_mm=y, position="middle left"),
            (x - away - width, y - height / 2, x - away, y + height / 2),
        ),
    ]


def _square(ring: Ring) -> Box:
    x, y, radius = ring.x_mm, ring.y_mm, ring.radius_mm
    return x - radius, y - radius, x + radius, y + radius


def _overlap(one: Box, other: Box) -> float:
    width = min(one[2], other[2]) - max(one[0], other[0])
    height = min(one[3], other[3]) - max(one[1], other[1])
    return max(width, 0.0) * max(height, 0.0)
