"""What of any demonstration's result a figure shows: its exposure times, its models by name."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from exposight.demo import DemoResult, ModelResult


def exposures_ms(result: DemoResult) -> tuple[float, ...]:
    """Return the exposure times of the observations in ms, ascending."""
    return tuple(sorted(set(result.table.array(["exposure_ms"])[:, 0].tolist())))


def model_results(result: DemoResult, target: str) -> tuple[ModelResult, ...]:
    """Return the results of all models that predict ``p_norm`` or ``exposure_ms``."""
    return tuple(own for own in result.results if own.model.target == target)


def named_result(result: DemoResult, name: str) -> ModelResult | None:
    """Return the result of the model of this name, if it was trained."""
    return next((own for own in result.results if own.model.name == name), None)
