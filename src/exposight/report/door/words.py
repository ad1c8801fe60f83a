"""How the door's report calls features and exposure times, the same everywhere."""

from __future__ import annotations

from typing import TYPE_CHECKING

from exposight.report.markup import escape, number

if TYPE_CHECKING:
    from exposight.demo import DoorResult, NewView


EXPOSURE_WORDS = ("shorter", "chosen", "longer")


def exposure_title(view: NewView, index: int) -> str:
    """Return one of the three exposure times that were taken, and which it is."""
    return f"{number(view.taken.exposures_ms[index])} ms ({EXPOSURE_WORDS[index]})"


def feature_title(result: DoorResult, name: str) -> str:
    """Return a feature's name, bold where no model has seen it."""
    return escape(name) if name in result.train_features else f"<b>{escape(name)}</b>"
